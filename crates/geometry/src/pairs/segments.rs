//! Capsules among themselves, a ball being a capsule without length.

use stepper_real::{Mask, Real};

use crate::linear_algebra::*;
use crate::pairs::ContactPoint;

/// A capsule: the points within `radius` of a segment.
#[derive(Clone, Copy, Debug)]
pub struct Segment<R> {
    /// Middle of the segment, m.
    pub centre: V3<R>,
    /// Unit direction.
    pub axis: V3<R>,
    /// Half the length, m.
    pub half_length: R,
    /// Radius, m.
    pub radius: R,
}

impl<R: Real> Segment<R> {
    #[inline(always)]
    fn at(&self, x: R) -> V3<R> {
        add_scaled(self.centre, self.axis, x)
    }
}

/// The contact at the closest points of two capsules; where they are parallel, the contacts at both ends of their overlap. The mask says
/// where the second one exists.
///
/// Closest points of segments by clamping each parameter in turn (Ericson 2005, section 5.1.9).
#[inline(always)]
pub fn segments<R: Real>(a: &Segment<R>, b: &Segment<R>) -> ([ContactPoint<R>; 2], R::Mask) {
    let one = R::one();
    let r = sub(b.centre, a.centre);
    let cos = dot(a.axis, b.axis);
    let (ra, rb) = (dot(r, a.axis), dot(r, b.axis));
    let determinant = one - cos * cos;
    // Below this the closest point is ill-defined to more than a thousandth of the length: sin of 0.06 degrees, squared.
    let parallel = determinant.lt(R::of(1e-6));

    let xa = ((ra - cos * rb) / R::select(parallel, one, determinant)).clamp(-a.half_length, a.half_length);
    let xb = (cos * xa - rb).clamp(-b.half_length, b.half_length);
    let xa = (cos * xb + ra).clamp(-a.half_length, a.half_length);

    // Where parallel, the two ends of the stretch of a that lies beside b.
    let reach = (cos * b.half_length).abs();
    let (lo, hi) = ((ra - reach).max(-a.half_length), (ra + reach).min(a.half_length));
    let two = parallel.and(lo.lt(hi));
    let xa1 = R::select(two, lo, xa);
    let xb1 = R::select(two, (cos * lo - rb).clamp(-b.half_length, b.half_length), xb);
    let xb2 = (cos * hi - rb).clamp(-b.half_length, b.half_length);
    ([between(a.at(xa1), b.at(xb1), a.radius, b.radius), between(a.at(hi), b.at(xb2), a.radius, b.radius)], two)
}

/// Two balls.
#[inline(always)]
fn between<R: Real>(p: V3<R>, q: V3<R>, radius_p: R, radius_q: R) -> ContactPoint<R> {
    let d = sub(q, p);
    let length = norm(d);
    // Centres that coincide have no direction between them; any will separate them.
    let apart = length.gt(R::zero());
    let up = [R::zero(), R::zero(), R::one()];
    let normal = select(apart, scale(d, R::one() / R::select(apart, length, R::one())), up);
    let distance = length - radius_p - radius_q;
    let pos = add_scaled(p, normal, radius_p + distance * R::of(0.5));
    ContactPoint { distance, pos, normal }
}
