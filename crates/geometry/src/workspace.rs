//! Workspace of the narrow phase.

use crate::expand::Polytope;
use crate::manifold::{Clipper, Point};

/// Buffers of the narrow phase, which are allocated once and reused for every pair.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
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
}
