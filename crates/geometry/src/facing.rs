//! Separation of two cores along a direction, and the features of the shapes that face each other along it.

use crate::pair::Pair;
use crate::vectors::V;

/// Gap across which the closest points of overlapping cores are searched for, relative to their smallest extent. The cores are moved apart
/// to this gap.
pub(super) const GAP: f64 = 1e-3;
/// Difference below which two separations count as equal, relative to the size of the pair.
pub(super) const EQUAL_SEPARATION: f64 = 1e-9;

/// Separation of the cores of two shapes along a direction, in the frame of the first shape.
#[derive(Clone, Copy, Debug)]
pub(super) struct Separation {
    /// Unit vector from the first shape to the second.
    pub(super) normal: V,
    /// Distance of the cores along the normal, m; negative if they overlap.
    pub(super) separation: f64,
    /// Point of each core that is closest along the normal, m.
    pub(super) points: [V; 2],
}

/// Separation of two cores, with the vertices and edges that are closest along its normal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facing {
    /// Separation along the normal.
    pub(super) found: Separation,
    /// Corner of the first core that is farthest along the normal, and corner of the second core that is farthest in the opposite
    /// direction.
    pub(super) corners: [u32; 2],
    /// Other end of an edge from each of the `corners`, if the normal is perpendicular to an edge of each core. Otherwise equal to
    /// `corners`.
    pub(super) ends: [u32; 2],
}

impl Facing {
    /// Separation with the closest corner of each core, and without edges.
    pub(super) fn new(pair: &Pair<'_>, found: Separation) -> Self {
        let corners = pair.corners(found.normal);
        Self { found, corners, ends: corners }
    }
}
