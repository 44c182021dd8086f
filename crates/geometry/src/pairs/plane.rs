//! Contacts of a half space with a ball, and with the corners of a box.

use stepper_real::Real;

use crate::linear_algebra::*;
use crate::pairs::ContactPoint;

/// Contact of a half space and a ball, or a point such as one of a cylinder's rim if `radius` is 0. `origin` is a point of the boundary, m,
/// and `normal` the outward unit normal.
#[inline(always)]
pub fn plane_sphere<R: Real>(origin: V3<R>, normal: V3<R>, centre: V3<R>, radius: R) -> ContactPoint<R> {
    let distance = dot(normal, sub(centre, origin)) - radius;
    let pos = sub(centre, scale(normal, radius + distance * R::of(0.5)));
    ContactPoint { distance, pos, normal }
}

/// Contact of a half space and one corner of a box. Bit k of `corner` is 1 if the corner is on the positive side of the box's axis k.
///
/// `origin` is a point of the boundary, m, and `normal` the outward unit normal. `centre`, `mat` and `half` are position, orientation and
/// half sizes of the box.
#[inline(always)]
pub fn plane_box<R: Real>(origin: V3<R>, normal: V3<R>, centre: V3<R>, mat: &M3<R>, half: V3<R>, corner: usize) -> ContactPoint<R> {
    let sign = |k: usize| if corner >> k & 1 == 1 { half[k] } else { -half[k] };
    let point = add(centre, rotate(mat, [sign(0), sign(1), sign(2)]));
    plane_sphere(origin, normal, point, R::zero())
}
