//! List of the contacts of a step, as input of the contact sensors.

use crate::math::lanes::MAX_LANES;

/// Contact in one lane, as input of the contact sensors.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contact {
    /// Indices of the two geoms in the model. `bodies` has the indices of their bodies.
    pub(super) geoms: [usize; 2],
    pub(super) bodies: [usize; 2],
    pub(super) distance: f64,
    pub(super) pos: [f64; 3],
    /// Unit vectors of the contact's normal and two tangents, in world axes.
    pub(super) axes: [[f64; 3]; 3],
    /// Force on the second body along the normal and the tangents, N.
    pub(super) force: [f64; 3],
    /// Torque on the second body about the normal and the tangents, N m.
    pub(super) torque: [f64; 3],
}

/// Contacts of a step in all lanes, as input of the sensors.
#[derive(Clone, Debug)]
pub(crate) struct SensedContacts {
    pub(super) contacts: Vec<Contact>,
    /// Index of each lane's first contact in `contacts`. The next entry is the end of the lane's contacts.
    pub(super) ends: [usize; MAX_LANES + 1],
}

impl SensedContacts {
    /// Workspace for at most `most` contacts in all lanes together.
    pub(super) fn new(most: usize) -> Self {
        Self { contacts: Vec::with_capacity(most), ends: [0; MAX_LANES + 1] }
    }
}
