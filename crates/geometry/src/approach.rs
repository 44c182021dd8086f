//! Which gap two moving hulls cannot close within a step.
//!
//! A contact joins a point x of the first and a point y of the second with y - x = d n', n' being the direction between the nearest points
//! of both. Where a plane with the normal n parts the hulls by g > 0, the nearest points are so too: d cos(a) >= g for the angle a between
//! n and n'. Stage 3 takes the contact up only if d < 2 h c + slack, where c = -n' . u and u is the velocity of the second as seen from the
//! first. For every n', 2 c cos(a) <= |u| - n . u, and so there is none where
//!
//! ```text
//! g >= h (|u| - n . u) + slack
//! ```
//!
//! for all u that the contact may see: u = v + w x r, where r reaches to points halfway between the hulls, all of them in a ball. The
//! normal that is reported may be one that separates worse by e, see `prefer_face`: it is then at most (2 e / g)^(1/2) away from n', and 2
//! c h greater by 2 h |u| times this. Once n' is known there is none where
//!
//! ```text
//! g >= 2 h (-n' . u) + slack
//! ```

use stepper_real::{Mask, Real};

use crate::facing::ALIKE;
use crate::linear_algebra::*;

/// What coordinates and ways may be off by, as a share of the size: they may be in single precision, and faces of a hull this uneven.
pub(super) const HAIR: f64 = 4e-6;

/// How two bodies move as seen from the first, in its frame, in a step.
#[derive(Clone, Copy, Debug)]
pub struct Approach<R = f64> {
    /// Way of the second where it is at the centre of the ball that all contacts are in, m.
    pub way: V3<R>,
    /// Angle that the second turns by, rad.
    pub turn: V3<R>,
    /// Radius of that ball, m.
    pub radius: R,
    /// Distance below which a contact counts however slow it is, m.
    pub slack: R,
}

impl<R: Real> Approach<R> {
    /// What hulls that a plane with the normal `n` (unit, from the first to the second) parts by `gap` have to spare: where it is not
    /// negative, no contact can count within the step; `size` is that of both, m.
    #[inline(always)]
    pub(super) fn spare(&self, n: V3<R>, gap: R, size: f64) -> R {
        let fastest = self.fastest();
        let along = dot(n, self.way) - self.swing(n);
        let tilt = (R::of(2.0 * ALIKE * size) / gap).sqrt();
        gap - (fastest * (R::one() + R::of(2.0) * tilt) - along + self.slack + self.hair(size, fastest))
    }

    /// Whether none can.
    #[inline(always)]
    pub(super) fn keeps(&self, n: V3<R>, gap: R, size: f64) -> R::Mask {
        gap.gt(self.slack).and(self.spare(n, gap, size).ge(R::zero()))
    }

    /// Whether no contact with the normal `n`, `gap` long or longer, can count within the step.
    #[inline(always)]
    pub(super) fn keeps_along(&self, n: V3<R>, gap: R, size: f64) -> R::Mask {
        let closing = (self.swing(n) - dot(n, self.way)).max(R::zero());
        gap.ge(R::of(2.0) * closing + self.slack + self.hair(size, self.fastest()))
    }

    /// Greatest components of y - x against each axis and along it, m, over the contacts (x, y) that can count.
    ///
    /// With the displacement u, a contact along the unit vector n is shorter than -2 n . u + slack. For every unit vector d,
    /// (-2 n . u) n . d <= |u| - u . d.
    pub(super) fn max_components(&self, size: f64) -> [V3<R>; 2] {
        let (fastest, turn) = (self.fastest(), self.turn.map(|x| x * x));
        let least = self.slack + self.hair(size, fastest);
        let swing: V3<R> = array_of(|k| (turn[(k + 1) % 3] + turn[(k + 2) % 3]).sqrt() * self.radius);
        [array_of(|k| fastest + self.way[k] + swing[k] + least), array_of(|k| fastest - self.way[k] + swing[k] + least)]
    }

    /// Bound on the displacement of the second in two steps, perpendicular to the unit vector `n`, m.
    pub(super) fn sideways(&self, n: V3<R>) -> R {
        let along = dot(n, self.way);
        let displacement = (dot(self.way, self.way) - along * along).max(R::zero()).sqrt() + norm(self.turn) * self.radius;
        displacement + displacement
    }

    /// Bound on the way of the second in the ball, m.
    #[inline(always)]
    fn fastest(&self) -> R {
        norm(self.way) + norm(self.turn) * self.radius
    }

    /// Bound on what the turn adds to the way along the unit vector `n`, m.
    #[inline(always)]
    fn swing(&self, n: V3<R>) -> R {
        norm(cross(n, self.turn)) * self.radius
    }

    #[inline(always)]
    fn hair(&self, size: f64, fastest: R) -> R {
        R::of(HAIR) * (R::of(size) + fastest)
    }

    /// Approach of one lane.
    #[inline(always)]
    pub fn lane(&self, lane: usize) -> Approach {
        let [radius, slack] = of_lane(&[self.radius, self.slack], lane);
        Approach { way: of_lane(&self.way, lane), turn: of_lane(&self.turn, lane), radius, slack }
    }
}
