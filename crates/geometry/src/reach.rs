//! How far to look for contacts, and where first.

use crate::approach::Approach;
use crate::facing::{Facing, Separation};
use crate::known::Known;
use crate::pair::Pair;
use crate::separating_plane::SeparatingPlane;
use crate::vectors::V;

/// How far to look, and where first.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// Distance beyond which nothing is a contact, m.
    pub prediction: f64,
    /// What is known of the pair from the last step: what is found is the same without it, later.
    pub known: Option<Known>,
    /// How hulls move: contacts that do not count within the step may be left out.
    pub approach: Option<Approach>,
    /// Relative rounding error of the poses.
    pub epsilon: f64,
}

impl Reach {
    /// Whether cores separated so are further apart than any contact.
    pub(super) fn is_beyond(&self, pair: &Pair<'_>, found: &Separation) -> bool {
        self.is_parted(found.normal, found.separation - pair.thickness(), pair.size)
    }

    /// Whether shapes of this size (m) that a plane parts by `gap` (m) have no contact.
    pub(super) fn is_parted(&self, normal: V, gap: f64, size: f64) -> bool {
        gap > self.prediction || self.approach.is_some_and(|a| a.keeps(normal, gap, size))
    }

    /// Whether no contact with the normal that was found counts.
    pub(super) fn is_left_out(&self, pair: &Pair<'_>, found: &Separation) -> bool {
        let gap = found.separation - pair.thickness();
        self.is_beyond(pair, found) || self.approach.is_some_and(|a| a.keeps_along(found.normal, gap, pair.size))
    }

    /// What two hulls know of one another afterwards.
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
