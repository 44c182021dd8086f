//! A direction that separates two cores, and the features that face each other along it.

use crate::pair::Pair;
use crate::vectors::V;

/// The gap that is opened, as a share of the least extent.
pub(super) const GAP: f64 = 1e-3;
/// Separations that differ by less than this share of the size are alike.
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

/// A separation with the corners of the cores that are furthest along its normal and against it, and the other ends of the edges there that
/// it is across; the corners again, where it is across none.
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
