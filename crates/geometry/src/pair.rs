//! Pair of convex shapes in the frame of the first one.

use crate::linear_algebra::*;
use crate::polyhedron::Polyhedron;
use crate::shape::ConvexShape;
use crate::vectors::{Pose, V, along_axis, extent, from_columns, neg};

/// Distance below which two features of shapes count as equal in double precision, relative to the size of the pair (sum of bounding
/// radii).
const EQUAL: f64 = 1e-9;

/// Rounding error of a relative pose, in units in the last place of the coordinates of both shapes. Evidence: with a value of 8, a tower of
/// ten boxes keeps the order of its contacts, at the origin and 3 m away from it.
const POSE_ROUNDINGS: f64 = 8.0;

/// Pair of convex shapes. All quantities are in the frame of the first shape.
pub(super) struct Pair<'a> {
    /// First shape of the pair.
    pub(super) a: &'a ConvexShape,
    /// Second shape of the pair.
    pub(super) b: &'a ConvexShape,
    /// Position of the second shape's frame in the frame of the first, m.
    pub(super) pos: V,
    /// Orientation of the second shape's frame in the frame of the first.
    pub(super) mat: M3<f64>,
    /// Vector from the centre of the first shape to that of the second, m.
    pub(super) apart: V,
    /// Size of the pair: sum of the bounding radii, m.
    pub(super) size: f64,
    /// Distance below which two features of the shapes count as equal, m. It exceeds rounding errors, so that bodies at rest keep their
    /// contact points.
    pub(super) tolerance: f64,
}

/// Vertex of the Minkowski difference of two cores (shapes without their rounding radius): w = x - y, with x in the first core and y in the
/// second.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Vertex {
    /// Position x - y in the Minkowski difference of the cores, m.
    pub(super) w: V,
    /// Point of the first core from which the vertex w = x - y is made, m.
    pub(super) x: V,
    /// Point of the second core from which the vertex w = x - y is made, m.
    pub(super) y: V,
    /// Numbers of the two vertices, one of each shape, from which the vertex w = x - y is made, see [`ConvexShape::corner`].
    pub(super) names: [u32; 2],
}

impl<'a> Pair<'a> {
    /// Pair of two shapes with poses in the world.
    pub(super) fn new(a: &'a ConvexShape, pose_a: &Pose, b: &'a ConvexShape, pose_b: &Pose) -> Self {
        let pos = rotate_back(&pose_a.mat, sub(pose_b.pos, pose_a.pos));
        let mat = from_columns(std::array::from_fn(|k| rotate_back(&pose_a.mat, column(&pose_b.mat, k))));
        Self::between(a, b, pos, mat)
    }

    /// Pair whose second shape has the pose `pos`, `mat` in the frame of the first.
    pub(super) fn between(a: &'a ConvexShape, b: &'a ConvexShape, pos: V, mat: M3<f64>) -> Self {
        let apart = sub(add(pos, rotate(&mat, b.centre())), a.centre());
        Self { a, b, pos, mat, apart, size: a.bound() + b.bound(), tolerance: EQUAL * (a.bound() + b.bound()) }
    }

    /// Pair whose tolerance accounts for poses in the world with the relative rounding error `epsilon`.
    pub(super) fn rounded(mut self, epsilon: f64, pose_a: &Pose, pose_b: &Pose) -> Self {
        let coordinates: f64 = pose_a.pos.iter().chain(&pose_b.pos).map(|x| x.abs()).sum();
        self.tolerance = self.tolerance.max(POSE_ROUNDINGS * epsilon * (coordinates + self.size));
        self
    }

    /// Smaller of the two shapes' scales (about half of the smallest extent), m, see [`ConvexShape::least`]. Shapes of scale 0 are ignored.
    pub(super) fn least(&self) -> f64 {
        match (self.a.least(), self.b.least()) {
            (0.0, x) | (x, 0.0) => x,
            (x, y) => x.min(y),
        }
    }

    /// Whether the bounding balls of the two shapes are at most `max_distance`, m, apart. False if a pose is not finite.
    pub(super) fn is_near(&self, max_distance: f64) -> bool {
        let reach = self.size + max_distance;
        reach >= 0.0 && dot(self.apart, self.apart) <= reach * reach && self.is_finite()
    }

    /// Whether all numbers of the relative pose are finite.
    pub(super) fn is_finite(&self) -> bool {
        self.pos.iter().chain(&self.mat).all(|x| x.is_finite())
    }

    /// Whether both cores (shapes without their rounding radius) are polytopes, segments or points.
    pub(super) fn is_polytope(&self) -> bool {
        self.a.is_polytope() && self.b.is_polytope()
    }

    /// Sum of the rounding radii of both shapes, m, see [`ConvexShape::radius`].
    pub(super) fn rounding_radii(&self) -> f64 {
        self.a.radius() + self.b.radius()
    }

    /// Point of the second shape, without its rounding radius, that is farthest along `d`. The point and `d` are in the frame of the first
    /// shape.
    pub(super) fn support_b(&self, d: V) -> V {
        self.place(self.b.support(rotate_back(&self.mat, d)))
    }

    /// Smallest and largest coordinates of the second shape, without its rounding radius, in the frame of the first shape, m.
    ///
    /// `ends` are the ends of the second shape's axis, if it is a ball or capsule.
    pub(super) fn extent_b(&self, ends: Option<&[V]>) -> [V; 2] {
        if let Some(ends) = ends {
            return extent(ends.iter().copied());
        }
        [-1.0, 1.0].map(|sign| array_of(|k| self.support_b(along_axis(k, sign))[k]))
    }

    /// Vertex of the Minkowski difference A - (B + shift) that is farthest along `d`. A and B are the two shapes without their rounding
    /// radii. The shift is in m.
    pub(super) fn support(&self, d: V, shift: V) -> Vertex {
        let (x, i) = self.a.corner(d);
        let (y, j) = self.b.corner(rotate_back(&self.mat, neg(d)));
        let y = add(self.place(y), shift);
        Vertex { w: sub(x, y), x, y, names: [i, j] }
    }

    /// Vertex of the Minkowski difference A - (B + shift) at the corners `names` of two polyhedra A and B. The shift is in m.
    pub(super) fn vertex(&self, names: [u32; 2], shift: V) -> Vertex {
        let (x, y) = (self.a.support_at(names[0], shift), self.place(self.b.support_at(names[1], shift)));
        let y = add(y, shift);
        Vertex { w: sub(x, y), x, y, names }
    }

    /// Separation of the cores (shapes without their rounding radius) along the unit vector `n`, m; negative if they overlap. `n` points
    /// from the first shape to the second.
    pub(super) fn separation(&self, n: V) -> f64 {
        dot(n, self.support_b(neg(n))) - dot(n, self.a.support(n))
    }

    /// Separation of the cores (shapes without their rounding radius) along the unit vector `n`, m, and the closest vertex of each core.
    ///
    /// The search for these vertices starts at the given ones. `n` points from the first shape to the second.
    pub(super) fn separation_near(&self, n: V, [i, j]: [u32; 2]) -> (f64, [u32; 2]) {
        let ((x, i), (y, j)) = (self.a.climb(i, n), self.b.climb(j, rotate_back(&self.mat, neg(n))));
        (dot(n, self.place(y)) - dot(n, x), [i, j])
    }

    /// Point `p` of the second shape's frame, in the frame of the first, m.
    #[inline(always)]
    pub(super) fn place(&self, p: V) -> V {
        add(self.pos, rotate(&self.mat, p))
    }

    /// Index of the vertex of the first shape that is farthest along `n`. The second index is that of the vertex of the second shape that
    /// is farthest in the opposite direction. The indices are 0 for shapes other than hulls and boxes.
    pub(super) fn corners(&self, n: V) -> [u32; 2] {
        let of = |shape: &ConvexShape, d: V| if shape.polyhedron().is_some() { shape.corner(d).1 } else { 0 };
        [of(self.a, n), of(self.b, rotate_back(&self.mat, neg(n)))]
    }

    /// The shapes as polyhedra, if the second is a hull and the first a hull or a box. Searches of such a pair start from the result of
    /// the previous step.
    #[inline(always)]
    pub(super) fn polyhedra(&self) -> Option<[Polyhedron<'a>; 2]> {
        self.a.polyhedron().zip(self.b.polyhedron().filter(|_| self.b.is_hull())).map(|(a, b)| [a, b])
    }

    /// Component along `n` of the vector from vertex i of the first shape to vertex j of the second, m. For a shape other than a hull
    /// or box, the support point replaces the vertex.
    pub(super) fn apart_at(&self, n: V, [i, j]: [u32; 2]) -> f64 {
        let y = self.place(self.b.support_at(j, rotate_back(&self.mat, neg(n))));
        dot(n, sub(y, self.a.support_at(i, n)))
    }

    /// Unit normal of the face of each shape that faces the other along `n`, among the faces at the vertices `corners`.
    ///
    /// Both normals point from the first shape to the second. `None` for a shape without flat faces.
    pub(super) fn flats(&self, n: V, corners: [u32; 2]) -> [Option<V>; 2] {
        let b = self.b.flat(rotate_back(&self.mat, neg(n)), corners[1]);
        [self.a.flat(n, corners[0]), b.map(|m| neg(rotate(&self.mat, m)))]
    }
}
