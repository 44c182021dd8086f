//! Numbers of constraints and entries for which a problem reserves memory.

use crate::constraints::{by_kind, each_kind};

by_kind! {
    /// Numbers of constraints and entries for which a problem and its iterate reserve memory. Filling them then allocates nothing.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub struct Capacity[] {
        /// Number of coordinates of the scaled velocity change w, one per degree of freedom. In these coordinates the kinetic energy is
        /// |w|^2 / 2.
        pub dimension: usize,
        /// Number of Jacobian entries of all scalar rows together.
        pub scalar_entries: usize,
        /// Largest number of coordinates at which one contact has Jacobian entries in any of its lanes.
        pub columns_per_contact: usize,
    } each same usize
}

impl Capacity {
    /// Capacity for `dimension` coordinates and no constraints. The caller then sets the number of constraints of each kind.
    pub fn of_coordinates(dimension: usize) -> Self {
        Self { dimension, ..Self::default() }
    }

    /// Total number of constraints of all kinds.
    pub(crate) fn constraints(&self) -> usize {
        let mut sum = 0;
        each_kind!([count: &self] => sum += count);
        sum
    }
}
