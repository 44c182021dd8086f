//! Vectors in f64, and where a shape is.

use crate::linear_algebra::*;

/// A vector in f64.
pub(crate) type V = V3<f64>;

/// Where a shape is: its origin and its axes (columns) in the world.
#[derive(Clone, Copy, Debug)]
pub struct Pose {
    /// Position, m.
    pub pos: V,
    /// Rotation, row by row.
    pub mat: M3<f64>,
}

impl Pose {
    /// A pose of 32 bits, whose axes are at right angles up to their rounding alone: made so up to that of 64 bits, else no face would be
    /// flat along its own normal.
    ///
    /// A step of Newton's method for the polar decomposition without an inverse squares what is wrong (Higham 2008, section 8.3).
    #[inline]
    pub fn widened(pos: V, mat: M3<f64>) -> Self {
        let gram = mat_mul_transposed(&mat, &mat);
        let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let half: M3<f64> = array_of(|i| 1.5 * identity[i] - 0.5 * gram[i]);
        Self { pos, mat: mat_mul(&half, &mat) }
    }
}

/// The first of the points furthest along `d`.
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

/// x / |x|, or the fallback where x is 0.
pub(super) fn unit_or(x: V, fallback: V) -> V {
    let length = norm(x);
    if length > 0.0 { scale(x, 1.0 / length) } else { fallback }
}

/// -x
pub(super) fn neg(x: V) -> V {
    [-x[0], -x[1], -x[2]]
}

/// The coordinate of largest magnitude, the first of equals.
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
