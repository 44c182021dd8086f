//! Limits of the search for contacts of two solids, and the normal from which it starts.

use crate::approach::Approach;
use crate::cached_normal::CachedNormal;
use crate::facing::{Facing, Separation};
use crate::manifold::Reach;
use crate::pair::Pair;
use crate::separating_plane::SeparatingPlane;
use crate::vectors::V;

/// Limits of the search for contacts of two solids, and the normal from which it starts.
#[derive(Clone, Copy, Debug)]
pub struct SearchLimits {
    /// Largest distance of the surfaces at which a contact is added, m.
    pub max_distance: f64,
    /// Distance below which surfaces count as touching, m. Far points never replace the points of touching surfaces.
    pub touching: f64,
    /// Contact normal of the pair in the previous step, from which the search starts. This normal saves time, and changes the
    /// result by rounding errors at most.
    pub cached: Option<CachedNormal>,
    /// Relative motion of the two solids within the step. If it is given, contacts that cannot push within the step may be absent.
    pub approach: Option<Approach>,
    /// Relative rounding error of the solids' poses.
    pub epsilon: f64,
}

impl SearchLimits {
    /// Distances of the contact points.
    pub(super) fn reach(&self) -> Reach {
        Reach { max_distance: self.max_distance, touching: self.touching }
    }

    /// Whether the separation `found` proves that the pair has no contact within `self.max_distance` that can push within the step.
    pub(super) fn excludes(&self, pair: &Pair<'_>, found: &Separation) -> bool {
        self.excludes_gap(found.normal, found.separation - pair.rounding_radii(), pair.size)
    }

    /// Whether a separation of `gap`, m, along the unit vector `normal` proves that two shapes have no contact within `self.max_distance`
    /// that can push within the step. `size` is the size of the pair, m.
    pub(super) fn excludes_gap(&self, normal: V, gap: f64, size: f64) -> bool {
        gap > self.max_distance || self.approach.is_some_and(|a| a.is_separated(normal, gap, size))
    }

    /// Whether a contact with the normal and separation of `found` has a distance above `self.max_distance`, or cannot push within the
    /// step.
    pub(super) fn excludes_contact(&self, pair: &Pair<'_>, found: &Separation) -> bool {
        let gap = found.separation - pair.rounding_radii();
        self.excludes(pair, found) || self.approach.is_some_and(|a| a.excludes_normal(found.normal, gap, pair.size))
    }

    /// Normal, features and separating plane of two polyhedra, for the next step.
    pub(super) fn separating_plane(&self, pair: &Pair<'_>, facing: &Facing) -> SeparatingPlane {
        let Separation { normal, separation, .. } = facing.found;
        SeparatingPlane::new(pair, facing, self.approach.map_or(0.0, |a| a.spare_gap(normal, separation, pair.size)))
    }
}

impl From<f64> for SearchLimits {
    /// Limits with `max_distance` as the largest distance of a contact, m, without a cached normal or a motion. Surfaces within this
    /// distance count as touching.
    fn from(max_distance: f64) -> Self {
        Self { max_distance, touching: max_distance, cached: None, approach: None, epsilon: f64::EPSILON }
    }
}
