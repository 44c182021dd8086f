//! Memory sizes of a solve.

use crate::constraints::{by_kind, each_kind};

by_kind! {
    /// Numbers of constraints and entries for which a problem and its iterate reserve memory, so that filling them allocates nothing.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub struct Capacity[] {
        /// Number of coordinates of w.
        pub dimension: usize,
        /// Number of entries of all scalar rows together.
        pub scalar_entries: usize,
        /// Number of coordinates that one contact can touch in any of its lanes.
        pub contact_support: usize,
    } each count
}

impl Capacity {
    /// Capacity for no constraints in `dimension` coordinates. The caller sets the numbers of each kind.
    pub fn of_coordinates(dimension: usize) -> Self {
        Self { dimension, ..Self::default() }
    }

    /// Number of constraints.
    pub(crate) fn constraints(&self) -> usize {
        let mut sum = 0;
        each_kind!([count: &self] => sum += count);
        sum
    }
}
