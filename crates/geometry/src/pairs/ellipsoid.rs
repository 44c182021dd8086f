//! Contacts of ellipsoids with a half space and with a ball.

use stepper_real::{Mask, Real, Scalar};

use crate::linear_algebra::*;
use crate::pairs::ContactPoint;

/// Ellipsoid in each lane.
#[derive(Clone, Copy, Debug)]
pub struct Ellipsoid<R> {
    /// Centre of the ellipsoid, m.
    pub centre: V3<R>,
    /// Orientation of the ellipsoid. The columns are its axes.
    pub mat: M3<R>,
    /// Semi-axes of the ellipsoid, m.
    pub radii: V3<R>,
}

/// Contact of a half space and an ellipsoid, at the ellipsoid's lowest point. `origin` is a point of the boundary, m, and `normal` the
/// outward unit normal n.
///
/// Let A be the diagonal matrix of the semi-axes, R the orientation and m = A R^T n. The lowest point is c - R A m / |m|. It is |m| below
/// the centre c.
#[inline(always)]
pub fn plane_ellipsoid<R: Real>(origin: V3<R>, normal: V3<R>, ellipsoid: &Ellipsoid<R>) -> ContactPoint<R> {
    let n = rotate_back(&ellipsoid.mat, normal);
    let m = times(ellipsoid.radii, n);
    let length = norm(m);
    let lowest = rotate(&ellipsoid.mat, times(ellipsoid.radii, scale(m, R::one() / length)));
    let distance = dot(normal, sub(ellipsoid.centre, origin)) - length;
    let pos = add_scaled(sub(ellipsoid.centre, lowest), normal, -(distance * R::of(0.5)));
    ContactPoint { distance, pos, normal }
}

/// Largest number of Newton steps of [`sphere_ellipsoid`]. Four or five are usual. The limit suffices for any position, if no semi-axis is
/// longer than 200 times another.
const STEPS: usize = 14;

/// Contact of a ball and an ellipsoid.
///
/// Let y be the centre of the ball and x the closest point of the surface. The vector y - x is along the gradient at x, so that with the
/// semi-axes e, x = e^2 y / (t + e^2). Here t is the largest root of |q(t)| = 1 with q = e y / (t + e^2) (Eberly, *Distance from a Point to
/// an Ellipse, an Ellipsoid, or a Hyperellipsoid*, 2013). The function 1 / |q| is nearly linear in t. Newton's method on it starts where
/// one entry of q is 1, and ascends to the root (Conn, Gould, Toint, *Trust-Region Methods*, 2000, section 7.3.3). For a centre inside the
/// ellipsoid, the result is the direction of the smallest depth.
#[inline(always)]
pub fn sphere_ellipsoid<R: Real>(centre: V3<R>, radius: R, ellipsoid: &Ellipsoid<R>) -> ContactPoint<R> {
    let (e, one, epsilon) = (ellipsoid.radii, R::one(), R::splat(R::Scalar::EPSILON) * R::of(4.0));
    let y = rotate_back(&ellipsoid.mat, sub(centre, ellipsoid.centre));
    let least = e[0].min(e[1]).min(e[2]);
    // With s = t + least^2, t + e^2 = s + more. On a plane of symmetry both sides are equally close, and the sign of the coordinate (+0 or
    // -0) decides.
    let (mut more, mut off): (V3<R>, V3<R>) = (zero(), zero());
    let mut s = R::zero();
    for k in 0..3 {
        more[k] = (e[k] - least) * (e[k] + least);
        off[k] = y[k].abs().max(e[k] * epsilon).copysign(y[k]);
        s = s.max(e[k] * off[k].abs() - more[k]);
    }
    let mut moves = R::Mask::splat(true);
    for _ in 0..STEPS {
        let (mut square, mut slope) = (R::zero(), R::zero());
        for k in 0..3 {
            let inv = one / (s + more[k]);
            let q = e[k] * off[k] * inv;
            square += q * q;
            slope += q * q * inv;
        }
        let step = square / slope * (square.sqrt() - one);
        s = R::select(moves, s + step, s);
        moves = moves.and(step.abs().gt(s * epsilon));
        if moves.none() {
            break;
        }
    }
    let u = [off[0] / (s + more[0]), off[1] / (s + more[1]), off[2] / (s + more[2])];
    let u = scale(u, one / norm(u));
    // Gap along u. Its error is quadratic in the error of u.
    let distance = dot(u, y) - norm(times(e, u)) - radius;
    let u = rotate(&ellipsoid.mat, u);
    let pos = add_scaled(centre, u, -(radius + distance * R::of(0.5)));
    ContactPoint { distance, pos, normal: scale(u, -one) }
}
