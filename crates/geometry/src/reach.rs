//! Limits and start of the search for contacts.

use crate::approach::Approach;
use crate::facing::{Facing, Separation};
use crate::known::Known;
use crate::pair::Pair;
use crate::separating_plane::SeparatingPlane;
use crate::vectors::V;

/// Limits and start of the search for contacts of a pair.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// Distance beyond which nothing is a contact, m.
    pub prediction: f64,
    /// Result of the last step for this pair. It saves time and does not change the result.
    pub known: Option<Known>,
    /// Motion of two hulls within the step. With it, contacts that cannot push within the step may be left out.
    pub approach: Option<Approach>,
    /// Relative rounding error of the poses.
    pub epsilon: f64,
}

impl Reach {
    /// Whether the separation `found` proves that the pair has no contact.
    pub(super) fn is_beyond(&self, pair: &Pair<'_>, found: &Separation) -> bool {
        self.is_parted(found.normal, found.separation - pair.thickness(), pair.size)
    }

    /// Whether shapes of the size `size`, m, have no contact if their distance along `normal` is at least `gap`, m.
    pub(super) fn is_parted(&self, normal: V, gap: f64, size: f64) -> bool {
        gap > self.prediction || self.approach.is_some_and(|a| a.keeps(normal, gap, size))
    }

    /// Whether no contact with the normal of `found` can push within the step.
    pub(super) fn is_left_out(&self, pair: &Pair<'_>, found: &Separation) -> bool {
        let gap = found.separation - pair.thickness();
        self.is_beyond(pair, found) || self.approach.is_some_and(|a| a.keeps_along(found.normal, gap, pair.size))
    }

    /// Separating plane of two hulls for the next steps.
    pub(super) fn separating_plane(&self, pair: &Pair<'_>, facing: &Facing) -> SeparatingPlane {
        let Separation { normal, separation, .. } = facing.found;
        SeparatingPlane::new(pair, facing, self.approach.map_or(0.0, |a| a.spare(normal, separation, pair.size)))
    }
}

impl From<f64> for Reach {
    fn from(prediction: f64) -> Self {
        Self { prediction, known: None, approach: None, epsilon: f64::EPSILON }
    }
}
