//! Bound on the relative motion of two bodies within a step. With this bound, detection leaves out contacts that cannot push: contacts
//! that carry no force within the step.
//!
//! A contact joins a point x of the first body and a point y of the second with y - x = d n'. Here d is the distance, and n' the unit
//! vector between the nearest points of both. Let a plane with the unit normal n separate the bodies by g > 0. Then d cos(a) >= g, where a
//! is the angle between n and n'.
//!
//! Detection (stage 3) adds a contact only if d < 2 h c + slack. Here h is the time step, c = -n' . u the closing speed, and u the velocity
//! of the second body relative to the first. For every n', 2 c cos(a) <= |u| - n . u. No contact is therefore added if
//!
//! ```text
//! g >= h (|u| - n . u) + slack
//! ```
//!
//! for all u = v + w x r that a contact may have. All vectors r are in a ball, because contacts are halfway between the bodies.
//!
//! The contact normal may be the normal of a face whose separation is smaller by up to e (`prefer_face` in `separation.rs`). The angle
//! between such a normal and n' is at most (2 e / g)^(1/2). It increases 2 c h by at most 2 h |u| times this angle. Once n' is known, no
//! contact is added if
//!
//! ```text
//! g >= 2 h (-n' . u) + slack
//! ```

use stepper_real::{Mask, Real};

use crate::facing::EQUAL_SEPARATION;
use crate::linear_algebra::*;

/// Error of coordinates, displacements and face planes, relative to the size of the bodies. Coordinates may have single precision.
pub(super) const COORDINATE_ROUNDING: f64 = 4e-6;

/// Motion of a second body relative to a first one within a step, in the frame of the first body; one pair of bodies in each lane.
///
/// All contacts of the pair are inside a ball. The displacement is measured at its centre.
#[derive(Clone, Copy, Debug)]
pub struct Approach<R = f64> {
    /// Displacement of the second body at the centre of the ball that contains all contacts, m.
    pub displacement: V3<R>,
    /// Rotation vector of the second body within the step, rad.
    pub rotation: V3<R>,
    /// Radius of the ball that contains all contacts of the two bodies, m.
    pub radius: R,
    /// Distance below which detection adds a contact at any closing speed, m.
    pub slack: R,
}

impl<R: Real> Approach<R> {
    /// Part of the gap between two bodies that their motion within the step cannot close, m. If it is not negative, no contact can push
    /// (carry force) within the step.
    ///
    /// `n` is the unit normal of a separating plane, from the first body to the second. `gap` is the separation along it, m. `size` is the
    /// sum of the bounding radii, m.
    #[inline(always)]
    pub(super) fn spare_gap(&self, n: V3<R>, gap: R, size: R) -> R {
        let most = self.max_displacement();
        let along = dot(n, self.displacement) - self.rotation_along(n);
        let tilt = (R::of(2.0 * EQUAL_SEPARATION) * size / gap).sqrt();
        gap - (most * (R::one() + R::of(2.0) * tilt) - along + self.slack + self.rounding(size, most))
    }

    /// Lanes in which no contact can push within the step, because a plane separates the bodies.
    ///
    /// `n` is the unit normal of the plane, from the first body to the second. `gap` is the separation along it, m. `size` is the sum of
    /// the bounding radii, m.
    #[inline(always)]
    pub(super) fn is_separated(&self, n: V3<R>, gap: R, size: R) -> R::Mask {
        gap.gt(self.slack).and(self.spare_gap(n, gap, size).ge(R::zero()))
    }

    /// Lanes in which a contact with the unit normal `n` and a distance of at least `gap`, m, cannot push within the step.
    ///
    /// The normal points from the first body to the second. `size` is the sum of the bounding radii, m.
    #[inline(always)]
    pub(super) fn excludes_normal(&self, n: V3<R>, gap: R, size: R) -> R::Mask {
        let closing = (self.rotation_along(n) - dot(n, self.displacement)).max(R::zero());
        gap.ge(R::of(2.0) * closing + self.slack + self.rounding(size, self.max_displacement()))
    }

    /// Bounds of y - x over all contacts that can push within the step, m, with x on the first body and y on the second.
    ///
    /// The first vector bounds the components opposite to the three axes, the second the components along them. `size` is the sum of the
    /// bounding radii, m. A contact along the unit vector n is shorter than -2 n . u + slack, where u is the displacement. For every unit
    /// vector d, (-2 n . u) n . d <= |u| - u . d.
    pub(super) fn max_components(&self, size: R) -> [V3<R>; 2] {
        let (most, turn) = (self.max_displacement(), self.rotation.map(|x| x * x));
        let least = self.slack + self.rounding(size, most);
        let swing: V3<R> = array_of(|k| (turn[(k + 1) % 3] + turn[(k + 2) % 3]).sqrt() * self.radius);
        [array_of(|k| most + self.displacement[k] + swing[k] + least), array_of(|k| most - self.displacement[k] + swing[k] + least)]
    }

    /// Upper bound on the displacement of the second body relative to the first within two steps, perpendicular to the unit vector `n`, m.
    pub(super) fn sideways(&self, n: V3<R>) -> R {
        let along = dot(n, self.displacement);
        let displacement =
            (dot(self.displacement, self.displacement) - along * along).max(R::zero()).sqrt() + norm(self.rotation) * self.radius;
        displacement + displacement
    }

    /// Upper bound on the displacement within the step of those points of the second body that can be in contact, m.
    #[inline(always)]
    fn max_displacement(&self) -> R {
        norm(self.displacement) + norm(self.rotation) * self.radius
    }

    /// Upper bound on the displacement along the unit vector `n` that the rotation adds at a contact, m.
    #[inline(always)]
    fn rotation_along(&self, n: V3<R>) -> R {
        norm(cross(n, self.rotation)) * self.radius
    }

    /// Rounding error of the distance between two bodies, m, see [`COORDINATE_ROUNDING`]. `most` is the largest displacement and `size` the
    /// sum of the bounding radii, m.
    #[inline(always)]
    fn rounding(&self, size: R, most: R) -> R {
        R::of(COORDINATE_ROUNDING) * (size + most)
    }

    /// Relative motion of the pair of bodies in the lane `lane`.
    #[inline(always)]
    pub fn lane(&self, lane: usize) -> Approach {
        let [radius, slack] = of_lane(&[self.radius, self.slack], lane);
        Approach { displacement: of_lane(&self.displacement, lane), rotation: of_lane(&self.rotation, lane), radius, slack }
    }
}
