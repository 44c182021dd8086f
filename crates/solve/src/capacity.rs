//! Sizes that a solve reserves memory for.

use crate::constraints::{by_kind, each_kind};

by_kind! {
    /// Numbers of constraints and entries that a problem and its iterate reserve, so that filling them allocates nothing.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub struct Capacity[] {
        /// Coordinates of w.
        pub dimension: usize,
        /// Entries of all scalar rows together.
        pub scalar_entries: usize,
        /// Coordinates that one contact can touch in any of its lanes.
        pub contact_support: usize,
    } each count
}

impl Capacity {
    /// Capacity for no constraints in `dimension` coordinates; the caller sets how many there are of each kind.
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
