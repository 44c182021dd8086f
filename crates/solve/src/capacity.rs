//! Sizes that a solve reserves memory for.

/// Numbers of rows and entries that a problem and its iterate reserve, so that filling them allocates nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Capacity {
    /// Coordinates of w.
    pub dimension: usize,
    /// Scalar rows.
    pub scalars: usize,
    /// Entries of all scalar rows together.
    pub scalar_entries: usize,
    /// Contacts with sliding friction.
    pub contacts: usize,
    /// Contacts with torsional or rolling friction.
    pub rolling_contacts: usize,
    /// Coordinates that one contact can touch in any of its lanes.
    pub contact_support: usize,
}

impl Capacity {
    /// Number of unknowns: coordinates of w, and impulses of all rows.
    pub(crate) fn unknowns(&self) -> usize {
        self.dimension + self.scalars + 3 * self.contacts + 6 * self.rolling_contacts
    }

    /// Number of constraints: scalar rows and contacts.
    pub(crate) fn constraints(&self) -> usize {
        self.scalars + self.contacts + self.rolling_contacts
    }
}
