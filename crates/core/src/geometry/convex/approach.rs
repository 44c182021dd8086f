//! Which gap two moving hulls cannot close within a step.
//!
//! A contact joins a point x of the first and a point y of the second with y - x = d n', n' being the direction between the nearest points of
//! both. Where a plane with the normal n parts the hulls by g > 0, the nearest points are so too: d cos(a) >= g for the angle a between n and n'.
//! Stage 3 takes the contact up only if d < 2 h c + slack, where c = -n' . u and u is the velocity of the second as seen from the first. For
//! every n', 2 c cos(a) <= |u| - n . u, and so there is none where
//!
//! ```text
//! g >= h (|u| - n . u) + slack
//! ```
//!
//! for all u that the contact may see: u = v + w x r, where r reaches to points halfway between the hulls, all of them in a ball. The normal
//! that is reported may be one that separates worse by e, see `prefer_face`: it is then at most (2 e / g)^(1/2) away from n', and 2 c h greater by
//! 2 h |u| times this.

use super::V;
use super::separation::ALIKE;
use crate::spatial::*;

/// What coordinates and ways may be off by, as a share of the size: they may be in single precision, and faces of a hull this uneven.
const HAIR: f64 = 4e-6;

/// How two bodies move as seen from the first, in its frame, in a step.
#[derive(Clone, Copy, Debug)]
pub struct Approach {
    /// Way of the second where it is at the centre of the ball that all contacts are in, m.
    pub way: V,
    /// Angle that the second turns by, rad.
    pub turn: V,
    /// Radius of that ball, m.
    pub radius: f64,
    /// Distance below which a contact counts however slow it is, m.
    pub slack: f64,
}

impl Approach {
    /// Whether no contact of hulls that a plane with the normal `n` (unit, from the first to the second) parts by `gap` can count within the
    /// step; `size` is that of both, m.
    pub(super) fn keeps(&self, n: V, gap: f64, size: f64) -> bool {
        if gap <= self.slack {
            return false;
        }
        let fastest = norm(self.way) + norm(self.turn) * self.radius;
        let along = dot(n, self.way) - norm(cross(n, self.turn)) * self.radius;
        let tilt = (2.0 * ALIKE * size / gap).sqrt();
        gap >= fastest * (1.0 + 2.0 * tilt) - along + self.slack + HAIR * (size + fastest)
    }
}
