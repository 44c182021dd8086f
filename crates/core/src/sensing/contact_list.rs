//! The contacts of a moment, as sensors feel them.

use crate::math::lanes::MAX_LANES;

/// One contact of one lane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contact {
    /// Geoms of the model, and their bodies.
    pub(super) geoms: [usize; 2],
    pub(super) bodies: [usize; 2],
    pub(super) distance: f64,
    pub(super) pos: [f64; 3],
    /// Normal and tangents.
    pub(super) axes: [[f64; 3]; 3],
    /// Along them, on the second body, N.
    pub(super) force: [f64; 3],
    /// About them, N m.
    pub(super) torque: [f64; 3],
}

/// The contacts of a moment, lane by lane.
#[derive(Clone, Debug)]
pub(crate) struct Felt {
    pub(super) contacts: Vec<Contact>,
    /// Offsets of the contacts of every lane.
    pub(super) ends: [usize; MAX_LANES + 1],
}

impl Felt {
    /// Workspace for a number of contacts of all lanes.
    pub(super) fn new(most: usize) -> Self {
        Self { contacts: Vec::with_capacity(most), ends: [0; MAX_LANES + 1] }
    }
}
