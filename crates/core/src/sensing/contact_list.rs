//! List of the contacts of a step for the sensors.

use crate::math::lanes::MAX_LANES;

/// Contact of one lane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contact {
    /// Geoms of the model, and their bodies.
    pub(super) geoms: [usize; 2],
    pub(super) bodies: [usize; 2],
    pub(super) distance: f64,
    pub(super) pos: [f64; 3],
    /// Normal and tangents.
    pub(super) axes: [[f64; 3]; 3],
    /// Force along these axes on the second body, N.
    pub(super) force: [f64; 3],
    /// Torque about these axes, N m.
    pub(super) torque: [f64; 3],
}

/// Contacts of a step for the sensors, lane by lane.
#[derive(Clone, Debug)]
pub(crate) struct Felt {
    pub(super) contacts: Vec<Contact>,
    /// Offsets of the contacts of every lane.
    pub(super) ends: [usize; MAX_LANES + 1],
}

impl Felt {
    /// Workspace for `most` contacts of all lanes.
    pub(super) fn new(most: usize) -> Self {
        Self { contacts: Vec::with_capacity(most), ends: [0; MAX_LANES + 1] }
    }
}
