//! Penetration depth of overlapping shapes: the distance of the origin from the boundary of their Minkowski difference A - B.
//!
//! The expanding polytope algorithm (van den Bergen, 2001) grows a polytope inside the difference. Each iteration adds the point of the
//! difference that is farthest along the normal of the polytope's nearest face. If this point is on the face, the face is also a facet of
//! the difference. No other facet is closer to the origin.
//!
//! The difference of round shapes has few or no flat facets. For such shapes the search starts from an upper bound of the depth. It ends
//! when every face of the polytope is farther from the origin than this bound.

use crate::facing::Separation;
use crate::linear_algebra::*;
use crate::pair::{Pair, Vertex};
use crate::vectors::V;

/// Largest number of vertices that the expanding polytope algorithm adds.
const GROWTHS: usize = 160;
/// Tolerance of the search, relative to the size of the pair of shapes. The search ends if the next vertex is no farther from the
/// polytope's nearest face.
const ENOUGH: f64 = 1e-13;
/// Rounding error of a vertex's position, relative to the longest edge of a face: a few units in the last place.
const ROUNDING: f64 = 1e-15;

/// Triangle of the polytope that the expanding polytope algorithm grows.
#[derive(Clone, Copy, Debug)]
struct Face {
    /// Indices of the triangle's vertices in [`Polytope::vertices`], counter-clockwise seen from outside.
    corners: [u16; 3],
    /// Outward unit normal of the triangle.
    normal: V,
    /// Distance of the triangle's plane from the origin, m; infinite if the triangle has no area.
    distance: f64,
    /// Rounding error of the distance of a vertex from the plane, m. It is large for a narrow triangle.
    rounding: f64,
    /// Whether the vertex that is being added is on the outer side of the triangle's plane. The triangle is then removed.
    seen: bool,
}

/// Workspace of the expanding polytope algorithm: the polytope in the Minkowski difference A - B of two shapes.
#[derive(Clone, Debug, Default)]
pub(super) struct Polytope {
    /// Vertices of the polytope.
    vertices: Vec<Vertex>,
    /// Triangles of the polytope's surface.
    faces: Vec<Face>,
    /// Edges, as vertex indices, of the hole that remains after faces are removed.
    horizon: Vec<[u16; 2]>,
}

impl Polytope {
    /// Reserves memory for the largest possible polytope.
    pub(super) fn reserve(&mut self) {
        // Euler: a polytope of v corners has 2 v - 4 triangles, and 3 v - 6 edges.
        let v = GROWTHS + 4;
        self.vertices.reserve(v);
        self.faces.reserve(2 * v);
        self.horizon.reserve(3 * v);
    }

    /// Separation of two overlapping polytopes along the facet of the Minkowski difference A - B that is nearest to the origin.
    ///
    /// `start` is a tetrahedron that contains the origin. The result is `None` if `start` has fewer than four vertices, or if rounding
    /// hides the facet.
    pub(super) fn nearest_facet(&mut self, pair: &Pair<'_>, start: &[Vertex]) -> Option<Separation> {
        if start.len() < 4 {
            return None;
        }
        self.start(start);
        for _ in 0..GROWTHS {
            let nearest = *self.faces.iter().min_by(|f, g| f.distance.total_cmp(&g.distance))?;
            let vertex = pair.support(nearest.normal, [0.0; 3]);
            let gain = dot(nearest.normal, vertex.w) - nearest.distance;
            if gain.is_nan() {
                return None;
            }
            if gain <= ENOUGH * pair.size || self.vertices.iter().any(|v| v.names == vertex.names) {
                return Some(self.separation(&nearest, vertex));
            }
            if !self.grow(vertex, |_| 1e-3 * ENOUGH * pair.size) {
                return None;
            }
        }
        None
    }

    /// Sets the polytope to the tetrahedron with these vertices.
    fn start(&mut self, corners: &[Vertex]) {
        self.vertices.clear();
        self.vertices.extend(corners);
        self.faces.clear();
        let at = |i: usize| corners[i].w;
        let inside_out = dot(sub(at(3), at(0)), cross(sub(at(1), at(0)), sub(at(2), at(0)))) > 0.0;
        for [i, j, k] in [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]] {
            self.add(if inside_out { [i, k, j] } else { [i, j, k] });
        }
    }

    /// Sets the polytope from which [`Polytope::shallower`] starts.
    ///
    /// The polytope has the vertices of `tetrahedron` if there are four, else four other vertices of the Minkowski difference A - B. The
    /// vertices `more` are then added.
    pub(super) fn enclose(&mut self, pair: &Pair<'_>, tetrahedron: &[Vertex], more: &[Vertex]) {
        if tetrahedron.len() == 4 {
            self.start(tetrahedron);
        } else {
            let directions = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
            self.start(&directions.map(|d| pair.support(d, [0.0; 3])));
        }
        for vertex in more {
            self.grow(*vertex, |face| face.rounding);
        }
    }

    /// Unit normal along which the overlap is shallower than `depth` by more than `least`, both in m. `None` if no such normal exists, or
    /// if the polytope has reached its largest size.
    ///
    /// A further call continues with the same polytope.
    pub(super) fn shallower(&mut self, pair: &Pair<'_>, depth: f64, least: f64) -> Option<V> {
        for _ in self.vertices.len()..GROWTHS {
            let at = (0..self.faces.len()).min_by(|&f, &g| self.faces[f].distance.total_cmp(&self.faces[g].distance))?;
            let Face { normal, distance, rounding, .. } = self.faces[at];
            if distance >= depth - least {
                return None;
            }
            let vertex = pair.support(normal, [0.0; 3]);
            let reach = dot(normal, vertex.w);
            if reach - distance <= rounding || !self.grow(vertex, |face| face.rounding) {
                // Up to rounding, this is a face of the difference.
                self.faces[at].distance = f64::INFINITY;
            }
            if reach < depth - least {
                return Some(normal);
            }
        }
        None
    }

    /// Separation along the normal of a facet of the Minkowski difference A - B. The closest points are where the normal through the origin
    /// meets the facet.
    ///
    /// `furthest` is the vertex of A - B that is farthest along the normal.
    fn separation(&self, facet: &Face, furthest: Vertex) -> Separation {
        let corners = facet.corners.map(|c| &self.vertices[c as usize]);
        let [a, b, c] = corners.map(|c| c.w);
        let n = facet.normal;
        let share = [dot(n, cross(b, c)), dot(n, cross(c, a)), dot(n, cross(a, b))];
        let sum = share[0] + share[1] + share[2];
        let mix = |get: fn(&Vertex) -> V| (0..3).fold([0.0; 3], |p, k| add_scaled(p, get(corners[k]), share[k] / sum));
        Separation { normal: n, separation: -dot(n, furthest.w), points: [mix(|c| c.x), mix(|c| c.y)] }
    }

    /// Adds a vertex outside the polytope.
    ///
    /// Triangles are removed if the vertex is on the outer side of their plane by more than `rounding`, m. New triangles connect the vertex
    /// with the edges of the hole that remains. The result is false, without any change, if rounding prevents a single closed hole.
    fn grow(&mut self, vertex: Vertex, rounding: impl Fn(&Face) -> f64) -> bool {
        let new = self.vertices.len() as u16;
        self.horizon.clear();
        let mut seen = 0;
        for face in &mut self.faces {
            face.seen = dot(face.normal, vertex.w) - face.distance > rounding(face);
            if !face.seen {
                continue;
            }
            seen += 1;
            let [a, b, c] = face.corners;
            for [i, j] in [[a, b], [b, c], [c, a]] {
                // An edge between two removed faces is not an edge of the hole.
                match self.horizon.iter().position(|e| *e == [j, i]) {
                    Some(known) => drop(self.horizon.swap_remove(known)),
                    None => self.horizon.push([i, j]),
                }
            }
        }
        // The removed triangles form a disc without an inner vertex exactly if the hole has two edges more than there are triangles.
        if self.horizon.len() != seen + 2 {
            return false;
        }
        self.vertices.push(vertex);
        let mut k = 0;
        while k < self.faces.len() {
            if self.faces[k].seen {
                self.faces.swap_remove(k);
            } else {
                k += 1;
            }
        }
        for e in 0..self.horizon.len() {
            let [i, j] = self.horizon[e];
            self.add([i, j, new]);
        }
        true
    }

    /// Adds a triangle with these vertices, counter-clockwise seen from outside.
    fn add(&mut self, corners: [u16; 3]) {
        let [a, b, c] = corners.map(|i| self.vertices[i as usize].w);
        let (u, v) = (sub(b, a), sub(c, a));
        let area = cross(u, v);
        let twice = norm(area);
        let face = if twice > 0.0 {
            let normal = scale(area, 1.0 / twice);
            let across = sub(v, u);
            let longest = dot(u, u).max(dot(v, v)).max(dot(across, across));
            // Longest edge divided by the triangle's height over it.
            let slenderness = longest / twice;
            Face { corners, normal, distance: dot(normal, a), rounding: ROUNDING * longest.sqrt() * slenderness.max(1.0), seen: false }
        } else {
            Face { corners, normal: [0.0; 3], distance: f64::INFINITY, rounding: 0.0, seen: false }
        };
        self.faces.push(face);
    }
}
