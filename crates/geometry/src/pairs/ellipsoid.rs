//! Ellipsoids against a half space and a ball.

use stepper_real::{Mask, Real, Scalar};

use crate::linear_algebra::*;
use crate::pairs::ContactPoint;

/// An ellipsoid.
#[derive(Clone, Copy, Debug)]
pub struct Ellipsoid<R> {
    /// Centre, m.
    pub centre: V3<R>,
    /// Its axes are the columns.
    pub mat: M3<R>,
    /// Half axes, m.
    pub radii: V3<R>,
}

/// The half space below `origin` with outward normal `normal`, and the point of the ellipsoid that is farthest against the normal: with
/// m = A R^T n it is c - R A m / |m|, and |m| deep below the centre.
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

/// Newton steps at the most: enough for half axes of a ratio of 200, from anywhere; four or five are usual.
const STEPS: usize = 14;

/// A ball and an ellipsoid.
///
/// The point x of the surface nearest to the centre y has y - x along the gradient: with half axes e, x = e^2 y / (t + e^2), and t is the
/// largest root of |q(t)| = 1, q = e y / (t + e^2) (Eberly, *Distance from a Point to an Ellipse, an Ellipsoid, or a Hyperellipsoid*,
/// 2013). 1 / |q| is nearly linear in t, and Newton's method on it ascends to the root from where one entry of q is 1 (Conn, Gould, Toint,
/// *Trust-Region Methods*, 2000, section 7.3.3). Inside, that is the nearest way out.
#[inline(always)]
pub fn sphere_ellipsoid<R: Real>(centre: V3<R>, radius: R, ellipsoid: &Ellipsoid<R>) -> ContactPoint<R> {
    let (e, one, epsilon) = (ellipsoid.radii, R::one(), R::splat(R::Scalar::EPSILON) * R::of(4.0));
    let y = rotate_back(&ellipsoid.mat, sub(centre, ellipsoid.centre));
    let least = e[0].min(e[1]).min(e[2]);
    // With s = t + least^2, t + e^2 = s + more. On a plane of symmetry one side is as good as the other: take that of the sign.
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
    // The room along u, which errs by the square of what u does.
    let distance = dot(u, y) - norm(times(e, u)) - radius;
    let u = rotate(&ellipsoid.mat, u);
    let pos = add_scaled(centre, u, -(radius + distance * R::of(0.5)));
    ContactPoint { distance, pos, normal: scale(u, -one) }
}
