//! Separation of two cores along a direction, and the features that face each other along it.

use crate::pair::Pair;
use crate::vectors::V;

/// Gap by which overlapping cores are moved apart for a search of the closest points, relative to their smallest extent.
pub(super) const GAP: f64 = 1e-3;
/// Difference below which two separations count as equal, relative to the size.
pub(super) const ALIKE: f64 = 1e-9;

/// Separation of the cores of two shapes along a direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Separation {
    /// Unit normal from the first to the second shape, in the first one's frame.
    pub(super) normal: V,
    /// Distance of the cores along the normal, m; negative if they overlap.
    pub(super) separation: f64,
    /// Points of the cores that are nearest along the normal.
    pub(super) points: [V; 2],
}

/// Separation with the features where it was found.
///
/// `corners` are the corner of the first core that is farthest along the normal, and the corner of the second one in the opposite
/// direction. `ends` are the other ends of two edges from these corners, if the normal is perpendicular to both edges; else they equal
/// `corners`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facing {
    pub(super) found: Separation,
    pub(super) corners: [u32; 2],
    pub(super) ends: [u32; 2],
}

impl Facing {
    pub(super) fn new(pair: &Pair<'_>, found: Separation) -> Self {
        let corners = pair.corners(found.normal);
        Self { found, corners, ends: corners }
    }
}
