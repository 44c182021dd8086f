//! Convex hulls of points, with their faces.

use parry3d_f64::math::Vector;
use parry3d_f64::transformation::try_convex_hull;
use thiserror::Error;

use super::V;
use super::shape::furthest;
use crate::spatial::*;

/// Points are taken for coplanar within this share of the hull's size: vertices of mesh files are in single precision.
const COPLANAR: f64 = 1e-6;
/// Points that are searched one after the other; in larger hulls the search climbs along edges.
const FEW: usize = 40;

/// Why points have no hull.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum HullError {
    /// Fewer than four points.
    #[error("fewer than four points")]
    TooFew,
    /// All on one plane, line or point.
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
    /// Points across an edge from every point.
    beside: Vec<Vec<u32>>,
    /// Points furthest along the axes and against them: where searches begin.
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
        let given: Vec<Vector> = points.iter().map(|&[x, y, z]| Vector::new(x, y, z)).collect();
        let (corners, triangles) = try_convex_hull(&given).map_err(|_| HullError::Flat)?;
        let points: Vec<V> = corners.iter().map(|p| [p.x, p.y, p.z]).collect();
        Self::from_triangles(points, triangles)
    }

    fn from_triangles(points: Vec<V>, triangles: Vec<[u32; 3]>) -> Result<Self, HullError> {
        let (volume, centre) = volume(&points, &triangles);
        let bound = points.iter().map(|p| norm(sub(*p, centre))).fold(0.0, f64::max);
        if volume <= COPLANAR * bound.powi(3) || volume.is_nan() {
            return Err(HullError::Flat);
        }
        let faces = merge(&points, &triangles, COPLANAR * bound);
        let mut around = vec![vec![]; points.len()];
        for (f, face) in faces.iter().enumerate() {
            face.vertices.iter().for_each(|&v| around[v as usize].push(f as u32));
        }
        let mut beside: Vec<Vec<u32>> = vec![vec![]; points.len()];
        for t in &triangles {
            (0..3).for_each(|k| beside[t[k] as usize].push(t[(k + 1) % 3]));
        }
        let extreme = std::array::from_fn(|k| {
            let mut d = [0.0; 3];
            d[k / 2] = if k % 2 == 0 { 1.0 } else { -1.0 };
            furthest(&points, d)
        });
        let depth = |f: &Face| dot(f.normal, sub(points[f.vertices[0] as usize], centre));
        let least = faces.iter().map(depth).fold(f64::INFINITY, f64::min);
        Ok(Self { points, triangles, faces, around, beside, extreme, centre, bound, least })
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

    /// The vertex furthest along `d`. On a convex surface a vertex with no better neighbour is the best.
    pub(super) fn support(&self, d: V) -> usize {
        if self.points.len() <= FEW {
            return furthest(&self.points, d);
        }
        let axis = super::shape::widest(d);
        let mut at = self.extreme[2 * axis + usize::from(d[axis] < 0.0)];
        let mut most = dot(self.points[at], d);
        loop {
            let mut next = at;
            for &v in &self.beside[at] {
                let x = dot(self.points[v as usize], d);
                if x > most {
                    (next, most) = (v as usize, x);
                }
            }
            if next == at {
                return at;
            }
            at = next;
        }
    }

    /// The vertices across an edge from a vertex.
    pub(super) fn beside(&self, vertex: usize) -> &[u32] {
        &self.beside[vertex]
    }

    /// The faces around a vertex.
    pub(super) fn faces_around(&self, vertex: usize) -> &[u32] {
        &self.around[vertex]
    }

    /// The face around the vertex furthest along `d` whose normal is nearest to it.
    pub(super) fn facing(&self, d: V) -> usize {
        let mut best = (f64::NEG_INFINITY, 0);
        for &f in &self.around[self.support(d)] {
            let x = dot(self.faces[f as usize].normal, d);
            if x > best.0 {
                best = (x, f as usize);
            }
        }
        best.1
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

/// Volume and its centre: tetrahedra from a point of it to the triangles.
fn volume(points: &[V], triangles: &[[u32; 3]]) -> (f64, V) {
    let origin = points[0];
    let (mut sum, mut moment) = (0.0, [0.0; 3]);
    for t in triangles {
        let [a, b, c] = t.map(|i| sub(points[i as usize], origin));
        let six = dot(a, cross(b, c));
        sum += six;
        moment = add_scaled(moment, add(add(a, b), c), six / 4.0);
    }
    (sum / 6.0, add_scaled(origin, moment, 1.0 / sum))
}

/// Triangles on one plane become one face; the largest decide the planes.
fn merge(points: &[V], triangles: &[[u32; 3]], tolerance: f64) -> Vec<Face> {
    let corner = |t: usize, k: usize| points[triangles[t][k % 3] as usize];
    let area = |t: usize| cross(sub(corner(t, 1), corner(t, 0)), sub(corner(t, 2), corner(t, 0)));
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
