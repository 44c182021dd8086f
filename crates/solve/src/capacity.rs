//! Numbers of constraints and entries for which a problem reserves memory.

/// Numbers of constraints and entries for which a problem and its iterate reserve memory. Filling them then allocates nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Capacity {
    /// Number of coordinates of the scaled velocity change w, one per degree of freedom. In these coordinates the kinetic energy is
    /// |w|^2 / 2.
    pub dimension: usize,
    /// Number of scalar rows: equalities, limits and dry friction.
    pub scalars: usize,
    /// Number of Jacobian entries of all scalar rows together.
    pub scalar_entries: usize,
    /// Number of contacts with three rows.
    pub contacts: usize,
    /// Number of contacts with four rows, which have torsional friction.
    pub torsional_contacts: usize,
    /// Number of contacts with six rows, which have rolling friction.
    pub rolling_contacts: usize,
    /// Largest number of coordinates at which one contact has Jacobian entries in any of its lanes.
    pub columns_per_contact: usize,
}

impl Capacity {
    /// Capacity for `dimension` coordinates and no constraints. The caller then sets the number of constraints of each kind.
    pub fn of_coordinates(dimension: usize) -> Self {
        Self { dimension, ..Self::default() }
    }

    /// Number of contacts with any number of rows.
    pub fn all_contacts(&self) -> usize {
        self.contacts + self.torsional_contacts + self.rolling_contacts
    }

    /// Number of rows of all contacts together.
    pub(crate) fn contact_rows(&self) -> usize {
        3 * self.contacts + 4 * self.torsional_contacts + 6 * self.rolling_contacts
    }
}
