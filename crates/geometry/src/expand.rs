//! Depth of overlapping polytopes: the facet of their difference that is nearest to the origin.
//!
//! The expanding polytope algorithm (van den Bergen 2001): a polytope inside the difference grows at its nearest face until that face is
//! one of the difference. All its other faces are then further away, so no way out is shorter.
//!
//! The difference of round bodies has few faces or none. The search then starts from a depth that is known, and ends where all faces of the
//! polytope are further away than that.

use crate::facing::Separation;
use crate::linear_algebra::*;
use crate::pair::{Pair, Vertex};
use crate::vectors::V;

/// Times that it may grow.
const GROWTHS: usize = 160;
/// What it may still gain is rounding below this share of the pair's size.
const ENOUGH: f64 = 1e-13;
/// Rounding error of a corner, as a share of the longest edge of a face: a few units in the last place.
const ROUNDING: f64 = 1e-15;

#[derive(Clone, Copy, Debug)]
struct Face {
    corners: [u16; 3],
    /// Outward, unit.
    normal: V,
    /// From the origin, m; infinite where the face has no area.
    distance: f64,
    /// Rounding error of the distance of other corners from the plane, m: large for a narrow triangle.
    rounding: f64,
    /// Whether the corner that the polytope takes up is beyond the plane.
    seen: bool,
}

/// Room for a polytope.
#[derive(Clone, Debug, Default)]
pub(super) struct Polytope {
    vertices: Vec<Vertex>,
    faces: Vec<Face>,
    horizon: Vec<[u16; 2]>,
}

impl Polytope {
    /// Room for the largest that there can be.
    pub(super) fn reserve(&mut self) {
        // Euler: a polytope of v corners has 2 v - 4 triangles, and 3 v - 6 edges.
        let v = GROWTHS + 4;
        self.vertices.reserve(v);
        self.faces.reserve(2 * v);
        self.horizon.reserve(3 * v);
    }

    /// Separation along the facet of A - B that is nearest to the origin. `start` is a tetrahedron that contains the origin. The result is
    /// `None` if `start` is not a tetrahedron, or if rounding hides the facet.
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

    /// Starts from a tetrahedron.
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

    /// Starts the search of [`Polytope::shallower`] from corners of A - B: four of a tetrahedron, if there are so many, and `more` of them.
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

    /// A direction along which the overlap is less deep than `depth` by more than `least` (m); `None` if there is none, or if the polytope
    /// has grown as far as it may. A call after a shorter way was found goes on from there.
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
                // The face is one of the difference up to rounding.
                self.faces[at].distance = f64::INFINITY;
            }
            if reach < depth - least {
                return Some(normal);
            }
        }
        None
    }

    /// What the normal of a facet separates, `furthest` being the furthest corner that way, and where the normal through the origin meets
    /// it.
    fn separation(&self, facet: &Face, furthest: Vertex) -> Separation {
        let corners = facet.corners.map(|c| &self.vertices[c as usize]);
        let [a, b, c] = corners.map(|c| c.w);
        let n = facet.normal;
        let share = [dot(n, cross(b, c)), dot(n, cross(c, a)), dot(n, cross(a, b))];
        let sum = share[0] + share[1] + share[2];
        let mix = |get: fn(&Vertex) -> V| (0..3).fold([0.0; 3], |p, k| add_scaled(p, get(corners[k]), share[k] / sum));
        Separation { normal: n, separation: -dot(n, furthest.w), points: [mix(|c| c.x), mix(|c| c.y)] }
    }

    /// Takes up a corner outside: faces that it is beyond by more than `rounding` (m) make way for faces between it and the horizon. False,
    /// without any change, where rounding makes no single outline of the horizon.
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
                // An edge between two faces that go is no horizon.
                match self.horizon.iter().position(|e| *e == [j, i]) {
                    Some(known) => drop(self.horizon.swap_remove(known)),
                    None => self.horizon.push([i, j]),
                }
            }
        }
        // Triangles that make a disc without a corner inside.
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

    fn add(&mut self, corners: [u16; 3]) {
        let [a, b, c] = corners.map(|i| self.vertices[i as usize].w);
        let (u, v) = (sub(b, a), sub(c, a));
        let area = cross(u, v);
        let twice = norm(area);
        let face = if twice > 0.0 {
            let normal = scale(area, 1.0 / twice);
            let across = sub(v, u);
            let longest = dot(u, u).max(dot(v, v)).max(dot(across, across));
            // The longest edge, divided by the height over it.
            let slenderness = longest / twice;
            Face { corners, normal, distance: dot(normal, a), rounding: ROUNDING * longest.sqrt() * slenderness.max(1.0), seen: false }
        } else {
            Face { corners, normal: [0.0; 3], distance: f64::INFINITY, rounding: 0.0, seen: false }
        };
        self.faces.push(face);
    }
}
