//! Room to work: made once, reused for every pair.

use crate::expand::Polytope;
use crate::manifold::{Clipper, Point};

/// Room to work: made once, reused for every pair.
#[derive(Clone, Debug, Default)]
pub struct Room {
    pub(super) clipper: Clipper,
    pub(super) polytope: Polytope,
    pub(super) triangles: Vec<u32>,
    pub(super) all: Vec<Point>,
}
