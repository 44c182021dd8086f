//! Separation of two cores along a direction, and the features of the shapes that face each other along it.

use crate::pair::Pair;
use crate::vectors::V;

/// Gap to which overlapping cores (shapes without their rounding radius) are moved apart before a search for their closest points. The
/// gap is relative to the smaller scale of the two shapes, see `Pair::least`.
pub(super) const GAP: f64 = 1e-3;
/// Difference below which the separations of two shapes along two directions count as equal, relative to the size of the pair.
pub(super) const EQUAL_SEPARATION: f64 = 1e-9;

/// Separation of the cores of two shapes along a direction, in the frame of the first shape. A core is the shape without its rounding
/// radius.
#[derive(Clone, Copy, Debug)]
pub(super) struct Separation {
    /// Unit vector from the first shape to the second.
    pub(super) normal: V,
    /// Distance along the normal of the cores (shapes without their rounding radius), m; negative if they overlap.
    pub(super) separation: f64,
    /// Point of each core (shape without its rounding radius) that is closest along the normal, m.
    pub(super) points: [V; 2],
}

/// Separation of the cores of two shapes, with the vertices and edges that are closest along its normal. A core is the shape without its
/// rounding radius.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facing {
    /// Separation, normal and closest points of the two cores.
    pub(super) found: Separation,
    /// Vertex of the first shape that is farthest along the normal, and vertex of the second shape that is farthest in the opposite
    /// direction.
    pub(super) corners: [u32; 2],
    /// For each vertex in `corners`, the vertex at the other end of the edge that is perpendicular to the normal. Equal to `corners` unless
    /// the normal is perpendicular to an edge of each shape.
    pub(super) ends: [u32; 2],
}

impl Facing {
    /// Separation `found` with the closest vertex of each shape, and without edges.
    pub(super) fn new(pair: &Pair<'_>, found: Separation) -> Self {
        let corners = pair.corners(found.normal);
        Self { found, corners, ends: corners }
    }
}
