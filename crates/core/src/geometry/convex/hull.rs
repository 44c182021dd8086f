//! Convex hulls of points, with their faces.

use thiserror::Error;

use super::V;
use super::blocks::{Block, Ring, SIDE, rings};
use super::quickhull;
use super::shape::furthest;
use crate::spatial::*;

/// Points are taken for coplanar within this share of the hull's size: vertices of mesh files are in single precision ...
const COPLANAR: f64 = 1e-6;
/// ... and within this share of its thickness: the faces of a thin one are no more bent than those of a thick one.
const COPLANAR_THICKNESS: f64 = 1e-3;
/// Of a product of two vectors, as a share of their lengths.
const ROUNDING: f64 = 2e-15;
/// A face is exactly flat within this share.
const EXACT: f64 = 1e-12;
/// Points that are searched one after the other; in larger hulls the search climbs along edges.
const FEW: usize = 40;

/// Why points have no hull.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum HullError {
    /// Fewer than four points.
    #[error("fewer than four points")]
    TooFew,
    /// All on one plane, line or point, up to rounding.
    #[error("its points lie on one plane")]
    Flat,
    /// Not finite.
    #[error("a coordinate is not finite")]
    NotFinite,
}

/// A flat face.
#[derive(Clone, Debug, PartialEq)]
pub struct Face {
    /// Outward unit normal.
    pub normal: V,
    /// Its vertices, counter-clockwise seen from outside.
    pub vertices: Vec<u32>,
}

/// The convex hull of points, in their frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Hull {
    points: Vec<V>,
    triangles: Vec<[u32; 3]>,
    faces: Vec<Face>,
    /// Faces around every point.
    around: Vec<Vec<u32>>,
    /// Points across an edge from every point: those of point v are in `rings[first[v]..first[v + 1]]`.
    rings: Vec<Ring>,
    first: Vec<u32>,
    blocks: Vec<Block>,
    /// Points furthest along the directions through the cells of a cube's sides: where searches begin.
    start: Vec<u32>,
    /// Points furthest along the axes and against them.
    extreme: [usize; 6],
    centre: V,
    bound: f64,
    least: f64,
}

impl Hull {
    /// The convex hull of points (m).
    ///
    /// # Errors
    /// [`HullError`] where they are not finite, or span no volume.
    pub fn new(points: &[V]) -> Result<Self, HullError> {
        if points.iter().flatten().any(|x| !x.is_finite()) {
            return Err(HullError::NotFinite);
        }
        if points.len() < 4 {
            return Err(HullError::TooFew);
        }
        let triangles = quickhull::triangles(points).ok_or(HullError::Flat)?;
        // Its corners alone, in their order.
        let corners: std::collections::BTreeSet<u32> = triangles.iter().flatten().copied().collect();
        let place: std::collections::BTreeMap<u32, u32> = corners.iter().copied().zip(0..).collect();
        let points: Vec<V> = corners.iter().map(|&v| points[v as usize]).collect();
        Self::from_triangles(points, triangles.iter().map(|t| t.map(|v| place[&v])).collect())
    }

    fn from_triangles(points: Vec<V>, triangles: Vec<[u32; 3]>) -> Result<Self, HullError> {
        let (volume, area, centre) = volume(&points, &triangles);
        let bound = points.iter().map(|p| norm(sub(*p, centre))).fold(0.0, f64::max);
        if volume <= 0.0 || volume.is_nan() {
            return Err(HullError::Flat);
        }
        // A ball within it has no larger radius than 3 volume / area.
        let thickness = 3.0 * volume / area;
        let faces = merge(&points, &triangles, (COPLANAR * bound).min(COPLANAR_THICKNESS * thickness));
        let mut around = vec![vec![]; points.len()];
        for (f, face) in faces.iter().enumerate() {
            face.vertices.iter().for_each(|&v| around[v as usize].push(f as u32));
        }
        let (rings, first) = rings(&points, &triangles);
        let blocks = points.chunks(SIDE).map(Block::new).collect();
        let start = if points.len() > FEW { starts(&points) } else { vec![] };
        let extreme = std::array::from_fn(|k| {
            let mut d = [0.0; 3];
            d[k / 2] = if k % 2 == 0 { 1.0 } else { -1.0 };
            furthest(&points, d)
        });
        let depth = |f: &Face| dot(f.normal, sub(points[f.vertices[0] as usize], centre));
        let least = faces.iter().map(depth).fold(f64::INFINITY, f64::min);
        Ok(Self { points, triangles, faces, around, rings, first, blocks, start, extreme, centre, bound, least })
    }

    /// Its vertices, m.
    pub fn points(&self) -> &[V] {
        &self.points
    }

    /// Its surface, counter-clockwise seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Its flat faces.
    pub fn faces(&self) -> &[Face] {
        &self.faces
    }

    pub(super) fn face(&self, f: usize) -> &Face {
        &self.faces[f]
    }

    /// Centre of its volume, m.
    pub fn centre(&self) -> V {
        self.centre
    }

    /// Radius of a ball about its centre that holds it, m.
    pub(super) fn bound(&self) -> f64 {
        self.bound
    }

    /// From its centre to the nearest face, m.
    pub(super) fn least(&self) -> f64 {
        self.least
    }

    /// The least q, m, for which the ball of radius (q + e) about p - q m, `m` being a unit vector, holds all vertices.
    pub(super) fn curve(&self, p: V, m: V, e: f64) -> f64 {
        let mut q = 0.0;
        for block in &self.blocks {
            // With d = p - w: d . d - e^2 <= 2 q (d . m + e).
            let (along, most) = (add_scaled(scale(p, -2.0), m, 2.0 * q), 2.0 * q * (dot(p, m) + e) + e * e - dot(p, p));
            if block.highest(along) > most {
                let needed = block.points().map(|w| {
                    let d = sub(p, w);
                    (dot(d, d) - e * e) / (2.0 * (dot(d, m) + e))
                });
                q = needed.fold(q, f64::max);
            }
        }
        q
    }

    /// The vertex furthest along `d`. On a convex surface a vertex with no better neighbour is the best.
    pub(super) fn support(&self, d: V) -> usize {
        if self.points.len() <= FEW {
            return furthest(&self.points, d);
        }
        self.climb(self.start[cell(d)] as usize, d)
    }

    /// The vertex furthest along `d`, from one that is nearly so.
    pub(super) fn climb(&self, from: usize, d: V) -> usize {
        // Among what is equal up to rounding there is nothing to climb, and around a flat face a long way to go.
        let level = ROUNDING * self.bound * (d[0].abs() + d[1].abs() + d[2].abs());
        let mut at = from;
        // No vertex comes twice, but for what underflow makes of a direction.
        for _ in 0..self.points.len() {
            let mut best = (level, at);
            for ring in self.rings(at) {
                let rise = ring.along(d);
                let higher = |a: f64, b: f64| if a > b { a } else { b };
                let four: [f64; 4] = std::array::from_fn(|k| higher(rise[k], rise[k + 4]));
                let highest = higher(higher(four[0], four[2]), higher(four[1], four[3]));
                if highest > best.0 {
                    let k = (0..SIDE).fold(0, |k, i| if rise[i] == highest { i } else { k });
                    best = (highest, ring.to[k] as usize);
                }
            }
            if best.1 == at {
                break;
            }
            at = best.1;
        }
        at
    }

    fn rings(&self, vertex: usize) -> &[Ring] {
        &self.rings[self.first[vertex] as usize..self.first[vertex + 1] as usize]
    }

    /// The faces around a vertex.
    pub(super) fn faces_around(&self, vertex: usize) -> &[u32] {
        &self.around[vertex]
    }

    /// The face around a vertex whose normal is nearest to `d`.
    pub(super) fn facing_at(&self, vertex: usize, d: V) -> usize {
        let mut best = (f64::NEG_INFINITY, 0);
        for &f in &self.around[vertex] {
            let x = dot(self.faces[f as usize].normal, d);
            if x > best.0 {
                best = (x, f as usize);
            }
        }
        best.1
    }

    /// The vertex across the edge of a vertex that is nearest to right angles to `d`, the first of equals.
    pub(super) fn level(&self, vertex: usize, d: V) -> usize {
        let mut best = (f64::INFINITY, vertex);
        for ring in self.rings(vertex) {
            let rise = ring.along(d);
            for k in 0..SIDE {
                // 0 / 0 where there is none: never less.
                let square = rise[k] * rise[k] / ring.square[k];
                if square < best.0 {
                    best = (square, ring.to[k] as usize);
                }
            }
        }
        best.1
    }

    /// How far a point over a face is from its outline, m; negative beside it, and where the face is flat only up to the tolerance of its making.
    pub(super) fn room_over(&self, face: usize, p: V) -> f64 {
        let Face { normal, vertices } = &self.faces[face];
        let n = vertices.len();
        let corner = |k: usize| self.points[vertices[k % n] as usize];
        let o = corner(0);
        let mut room = f64::INFINITY;
        for k in 0..n {
            let (q, r) = (corner(k), corner(k + 1));
            if n > 3 && dot(*normal, sub(q, o)).abs() > EXACT * self.bound {
                return f64::NEG_INFINITY;
            }
            let inwards = cross(*normal, sub(r, q));
            let x = dot(inwards, sub(p, q)) / norm(inwards);
            if x <= 0.0 {
                return x;
            }
            room = room.min(x);
        }
        room
    }

    /// Normals of faces that may separate it from something at `towards`: all of a small hull, else those that face it around the
    /// vertices furthest that way and along the axes.
    pub(super) fn directions(&self, towards: V, mut visit: impl FnMut(V)) {
        if self.faces.len() <= FEW {
            self.faces.iter().for_each(|f| visit(f.normal));
            return;
        }
        let starts = self.extreme.into_iter().chain([self.support(towards)]);
        for vertex in starts {
            self.around[vertex].iter().for_each(|&f| visit(self.faces[f as usize].normal));
        }
    }
}

/// Cells along the edge of a side of the cube of [`Hull::start`].
const CELLS: usize = 16;

/// The cell of the cube's surface that a direction points to.
fn cell(d: V) -> usize {
    let k = super::shape::widest(d);
    let side = 2 * k + usize::from(d[k] < 0.0);
    let scale = 0.5 * CELLS as f64 / d[k].abs();
    // Saturating: 0 / 0 has some cell too.
    let at = |x: f64| ((x * scale + 0.5 * CELLS as f64) as usize).min(CELLS - 1);
    (side * CELLS + at(d[(k + 1) % 3])) * CELLS + at(d[(k + 2) % 3])
}

/// The points furthest along the directions through the middles of all cells.
fn starts(points: &[V]) -> Vec<u32> {
    let middle = |i: usize| (2 * i + 1) as f64 / CELLS as f64 - 1.0;
    let through = |c: usize| {
        let (side, at) = (c / (CELLS * CELLS), c % (CELLS * CELLS));
        let (k, mut d) = (side / 2, [0.0; 3]);
        d[k] = if side % 2 == 0 { 1.0 } else { -1.0 };
        d[(k + 1) % 3] = middle(at / CELLS);
        d[(k + 2) % 3] = middle(at % CELLS);
        d
    };
    (0..6 * CELLS * CELLS).map(|c| furthest(points, through(c)) as u32).collect()
}

/// Volume, area and the centre of the volume: tetrahedra from a point of it to the triangles, none of which counts less than nothing.
fn volume(points: &[V], triangles: &[[u32; 3]]) -> (f64, f64, V) {
    let origin = points[0];
    let (mut sum, mut area, mut moment) = (0.0, 0.0, [0.0; 3]);
    for t in triangles {
        let six = -quickhull::outside(points, *t, 0);
        let [a, b, c] = t.map(|i| sub(points[i as usize], origin));
        sum += six;
        area += 0.5 * norm(area_of([a, b, c]));
        moment = add_scaled(moment, add(add(a, b), c), six / 4.0);
    }
    (sum / 6.0, area, add_scaled(origin, moment, 1.0 / sum))
}

/// Twice the area of a triangle along its normal, from its two shorter edges: of a narrow one nothing else is left of two long ones.
fn area_of(corners: [V; 3]) -> V {
    let edges: [V; 3] = std::array::from_fn(|k| sub(corners[(k + 1) % 3], corners[k]));
    let square = edges.map(|e| dot(e, e));
    let longest = (0..3).fold(0, |best, k| if square[k] > square[best] { k } else { best });
    cross(edges[(longest + 1) % 3], edges[(longest + 2) % 3])
}

/// Triangles on one plane become one face; the largest decide the planes.
fn merge(points: &[V], triangles: &[[u32; 3]], tolerance: f64) -> Vec<Face> {
    let corner = |t: usize, k: usize| points[triangles[t][k % 3] as usize];
    let area = |t: usize| area_of([corner(t, 0), corner(t, 1), corner(t, 2)]);
    let mut across = std::collections::BTreeMap::new();
    for (t, v) in triangles.iter().enumerate() {
        (0..3).for_each(|k| {
            across.insert((v[k], v[(k + 1) % 3]), t);
        });
    }
    let mut order: Vec<usize> = (0..triangles.len()).collect();
    order.sort_by(|&a, &b| norm(area(b)).total_cmp(&norm(area(a))).then(a.cmp(&b)));
    let mut taken = vec![false; triangles.len()];
    let mut faces = vec![];
    for seed in order {
        if taken[seed] {
            continue;
        }
        let normal = super::unit_or(area(seed), [0.0; 3]);
        let on_plane = |t: usize| (0..3).all(|k| dot(normal, sub(corner(t, k), corner(seed, 0))).abs() <= tolerance);
        let (mut patch, mut next) = (vec![], vec![seed]);
        taken[seed] = true;
        while let Some(t) = next.pop() {
            patch.push(t);
            for k in 0..3 {
                let neighbour = across.get(&(triangles[t][(k + 1) % 3], triangles[t][k]));
                if let Some(&n) = neighbour.filter(|&&n| !taken[n] && on_plane(n) && dot(normal, area(n)) >= 0.0) {
                    taken[n] = true;
                    next.push(n);
                }
            }
        }
        faces.push(outline(&patch, triangles, patch.iter().fold([0.0; 3], |sum, &t| add(sum, area(t))), normal));
    }
    faces.retain(|f: &Face| f.vertices.len() >= 3);
    faces
}

/// The face made of some triangles: its boundary, in order.
fn outline(patch: &[usize], triangles: &[[u32; 3]], area: V, fallback: V) -> Face {
    let edges = patch.iter().flat_map(|&t| (0..3).map(move |k| (triangles[t][k], triangles[t][(k + 1) % 3])));
    let mut boundary: std::collections::BTreeMap<u32, u32> = std::collections::BTreeMap::new();
    let all: std::collections::BTreeSet<(u32, u32)> = edges.collect();
    for &(a, b) in &all {
        if !all.contains(&(b, a)) {
            boundary.insert(a, b);
        }
    }
    let mut vertices = vec![];
    if let Some((&start, _)) = boundary.iter().next() {
        let mut at = start;
        while let Some(next) = boundary.remove(&at) {
            vertices.push(at);
            at = next;
        }
    }
    Face { normal: super::unit_or(area, fallback), vertices }
}
