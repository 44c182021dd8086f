//! Contacts of two capsules. A ball is a capsule without length.

use stepper_real::{Mask, Real};

use crate::linear_algebra::*;
use crate::pairs::ContactPoint;

/// Capsule in each lane: the points within `radius` of a segment. A radius of 0 is the segment itself.
#[derive(Clone, Copy, Debug)]
pub struct Segment<R> {
    /// Centre of the capsule's segment, m.
    pub centre: V3<R>,
    /// Unit vector along the capsule's segment.
    pub axis: V3<R>,
    /// Half the length of the capsule's segment, m.
    pub half_length: R,
    /// Radius of the capsule, m.
    pub radius: R,
}

impl<R: Real> Segment<R> {
    /// Point of the segment at the signed distance `x` from its centre, m.
    #[inline(always)]
    pub(super) fn at(&self, x: R) -> V3<R> {
        add_scaled(self.centre, self.axis, x)
    }
}

/// Contacts of two capsules: one at their closest points, or two at the ends of the overlapping part of parallel capsules. The mask has the
/// lanes with a second contact.
///
/// The closest points of the segments are found by clamping each parameter in turn (Ericson, 2005, section 5.1.9).
#[inline(always)]
pub fn segments<R: Real>(a: &Segment<R>, b: &Segment<R>) -> ([ContactPoint<R>; 2], R::Mask) {
    let one = R::one();
    let r = sub(b.centre, a.centre);
    let cos = dot(a.axis, b.axis);
    let (ra, rb) = (dot(r, a.axis), dot(r, b.axis));
    let determinant = one - cos * cos;
    // Squared sine of 0.06 degrees. At smaller angles the error of the closest point exceeds a thousandth of the length.
    let parallel = determinant.lt(R::of(1e-6));

    let xa = ((ra - cos * rb) / R::select(parallel, one, determinant)).clamp(-a.half_length, a.half_length);
    let xb = (cos * xa - rb).clamp(-b.half_length, b.half_length);
    let xa = (cos * xb + ra).clamp(-a.half_length, a.half_length);

    // For parallel capsules: both ends of the part of a that overlaps b along the axis.
    let reach = (cos * b.half_length).abs();
    let (lo, hi) = ((ra - reach).max(-a.half_length), (ra + reach).min(a.half_length));
    let two = parallel.and(lo.lt(hi));
    let xa1 = R::select(two, lo, xa);
    let xb1 = R::select(two, (cos * lo - rb).clamp(-b.half_length, b.half_length), xb);
    let xb2 = (cos * hi - rb).clamp(-b.half_length, b.half_length);
    ([between(a.at(xa1), b.at(xb1), a.radius, b.radius), between(a.at(hi), b.at(xb2), a.radius, b.radius)], two)
}

/// Contact of two balls with the centres `p` and `q`, m.
#[inline(always)]
fn between<R: Real>(p: V3<R>, q: V3<R>, radius_p: R, radius_q: R) -> ContactPoint<R> {
    // Coinciding centres have no direction between them. Any direction separates the balls.
    let (normal, length, _) = direction(sub(q, p), [R::zero(), R::zero(), R::one()]);
    let distance = length - radius_p - radius_q;
    let pos = add_scaled(p, normal, radius_p + distance * R::of(0.5));
    ContactPoint { distance, pos, normal }
}
