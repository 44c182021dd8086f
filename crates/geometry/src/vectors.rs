//! Vectors in f64, and poses of shapes.

use stepper_real::Scalar;

use crate::linear_algebra::*;

/// Vector in f64.
pub(crate) type V = V3<f64>;

/// Identity matrix.
pub(super) const IDENTITY: M3<f64> = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

/// Pose of a shape in the world frame.
#[derive(Clone, Copy, Debug)]
pub struct Pose {
    /// Position of the shape's frame, m.
    pub pos: V,
    /// Rotation matrix of the shape's frame, row by row. Its columns are the axes of the shape.
    pub mat: M3<f64>,
}

impl Pose {
    /// Pose from numbers of the scalar type `S` that were converted to f64. The axes of a pose in single precision are made orthogonal up
    /// to the rounding of f64, because faces would otherwise not be perpendicular to their normals.
    ///
    /// The method is one step of Newton's method for the polar decomposition without an inverse, which squares the error (Higham, 2008,
    /// section 8.3).
    #[inline]
    pub fn of_scalar<S: Scalar>(pos: V, mat: M3<f64>) -> Self {
        if !S::IS_SINGLE {
            return Self { pos, mat };
        }
        let gram = mat_mul_transposed(&mat, &mat);
        let half: M3<f64> = array_of(|i| 1.5 * IDENTITY[i] - 0.5 * gram[i]);
        Self { pos, mat: mat_mul(&half, &mat) }
    }
}

/// Index of the point that is farthest along `d`. If several points are equally far, it is the first of them.
pub(super) fn furthest(points: &[V], d: V) -> usize {
    let mut best = 0;
    let mut most = f64::NEG_INFINITY;
    for (i, p) in points.iter().enumerate() {
        let x = dot(*p, d);
        if x > most {
            (best, most) = (i, x);
        }
    }
    best
}

/// Smallest and largest coordinates of points, m; zeros without points.
pub(super) fn extent(points: impl Iterator<Item = V> + Clone) -> [V; 2] {
    [f64::min, f64::max].map(|pick: fn(f64, f64) -> f64| points.clone().reduce(|p, q| array_of(|k| pick(p[k], q[k]))).unwrap_or_default())
}

/// Unit vector x / |x|, or `fallback` if x is 0.
pub(super) fn unit_or(x: V, fallback: V) -> V {
    let length = norm(x);
    if length > 0.0 { scale(x, 1.0 / length) } else { fallback }
}

/// Vector -x.
pub(super) fn neg(x: V) -> V {
    [-x[0], -x[1], -x[2]]
}

/// Vector along the axis `k`, with the length and the sign of `x`.
#[inline(always)]
pub(super) fn along_axis(k: usize, x: f64) -> V {
    let mut v = [0.0; 3];
    v[k] = x;
    v
}

/// Matrix with these columns.
#[inline(always)]
pub(super) fn from_columns([a, b, c]: [V; 3]) -> M3<f64> {
    [a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2]]
}

/// Index of the coordinate with the largest absolute value. If several are equal, it is the first of them.
pub(super) fn widest(d: V) -> usize {
    let a = d.map(f64::abs);
    if a[0] >= a[1] && a[0] >= a[2] {
        0
    } else if a[1] >= a[2] {
        1
    } else {
        2
    }
}
