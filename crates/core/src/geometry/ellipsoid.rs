//! Ellipsoids against a half space.

use stepper_real::Real;

use crate::contacts::ContactPoint;
use crate::spatial::*;

/// An ellipsoid.
#[derive(Clone, Copy, Debug)]
pub struct Ellipsoid<R> {
    /// m
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
