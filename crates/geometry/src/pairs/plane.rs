//! A half space against a ball, and against the corners of a box.

use stepper_real::Real;

use crate::linear_algebra::*;
use crate::pairs::ContactPoint;

/// The half space below `origin` with outward normal `normal`, and a ball.
#[inline(always)]
pub fn plane_sphere<R: Real>(origin: V3<R>, normal: V3<R>, centre: V3<R>, radius: R) -> ContactPoint<R> {
    let distance = dot(normal, sub(centre, origin)) - radius;
    let pos = sub(centre, scale(normal, radius + distance * R::of(0.5)));
    ContactPoint { distance, pos, normal }
}

/// The half space and the corner of a box whose signs are the bits of `corner`.
#[inline(always)]
pub fn plane_box<R: Real>(origin: V3<R>, normal: V3<R>, centre: V3<R>, mat: &M3<R>, half: V3<R>, corner: usize) -> ContactPoint<R> {
    let sign = |k: usize| if corner >> k & 1 == 1 { half[k] } else { -half[k] };
    let point = add(centre, rotate(mat, [sign(0), sign(1), sign(2)]));
    plane_sphere(origin, normal, point, R::zero())
}
