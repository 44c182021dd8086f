//! Limits of the search for contacts of two solids, and the normal from which it starts.

use crate::approach::Approach;
use crate::facing::Separation;
use crate::pair::Pair;
use crate::vectors::V;

/// Limits of the search for contacts of two solids, and the normal from which it starts.
#[derive(Clone, Copy, Debug)]
pub struct SearchLimits {
    /// Largest distance of the surfaces at which a contact is added, m.
    pub max_distance: f64,
    /// Distance below which a contact point touches, m. If no point is as near, the nearest ones count instead.
    ///
    /// Points that touch are reduced without regard to farther ones. The touching points of a manifold are therefore the same for every
    /// `max_distance`, and for every speed of the shapes.
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
}

impl From<f64> for SearchLimits {
    /// Limits with `max_distance` as the largest distance of a contact, m, without a cached normal or a motion. Surfaces within this
    /// distance count as touching.
    fn from(max_distance: f64) -> Self {
        Self { max_distance, touching: max_distance, cached: None, approach: None, epsilon: f64::EPSILON }
    }
}

/// Contact normal of two polyhedra in the previous step, from which the next search starts. This normal saves time, and changes the result
/// by rounding errors at most.
#[derive(Clone, Copy, Debug)]
pub struct CachedNormal {
    /// Unit normal from the first polyhedron to the second, in the frame of the first.
    pub(super) normal: V,
    /// Edge of each polyhedron to which the normal was perpendicular, as the indices of its two vertices. If both indices are equal, the
    /// normal was found at this vertex. `None` if only the normal is known.
    pub(super) edges: Option<[[u32; 2]; 2]>,
}

impl From<V> for CachedNormal {
    fn from(normal: V) -> Self {
        Self { normal, edges: None }
    }
}
