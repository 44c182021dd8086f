//! Workspace of the narrow phase.

use crate::expand::Polytope;
use crate::manifold::{Clipper, Point};

/// Workspace of the narrow phase, which is allocated once and reused for every pair.
#[derive(Clone, Debug, Default)]
pub struct Room {
    pub(super) clipper: Clipper,
    pub(super) polytope: Polytope,
    pub(super) triangles: Vec<u32>,
    pub(super) all: Vec<Point>,
    /// Triangle of each point in `all`.
    pub(super) owners: Vec<u32>,
    /// Whether each point in `all` belongs to the triangle that has it, not to a neighbour.
    pub(super) is_own: Vec<bool>,
}
