//! Narrow phase of collision detection: its buffers.

use crate::expand::Polytope;
use crate::manifold::{Clipper, Manifold, Point};
use crate::solid::Solid;

/// Narrow phase of collision detection: finds the contact points of pairs of solids. It contains its workspace and the result of the last
/// call.
#[derive(Clone, Debug, Default)]
pub struct Narrow {
    /// Buffers for the computation of contact points along a normal.
    pub(super) clipper: Clipper,
    /// Buffers of the expanding polytope algorithm.
    pub(super) polytope: Polytope,
    /// Indices of the triangles of a surface that are near the other shape of the pair.
    pub(super) triangles: Vec<u32>,
    /// Contact points of these triangles.
    pub(super) all: Vec<Point>,
    /// Triangle to which each contact point in `all` belongs.
    pub(super) owners: Vec<u32>,
    /// Whether each contact point in `all` is kept, because no other triangle is much closer to it.
    pub(super) is_own: Vec<bool>,
    /// Contact points of the last pair of solids.
    pub(super) found: Manifold,
}

impl Narrow {
    /// Narrow phase with enough memory for pairs of these solids. Later calls allocate only if a shape touches very many triangles of a
    /// surface.
    pub fn for_solids<'a>(solids: impl Iterator<Item = &'a Solid>) -> Self {
        let corners = solids.map(|s| if let Solid::Convex(shape) = s { shape.corners() } else { 0 }).max().unwrap_or(0);
        let mut narrow = Self::default();
        if corners > 0 {
            narrow.clipper.reserve(corners);
            narrow.polytope.reserve();
            narrow.triangles.reserve(256);
            narrow.all.reserve(256);
            narrow.owners.reserve(256);
            narrow.is_own.reserve(256);
            narrow.found.points.reserve(256);
        }
        narrow
    }
}
