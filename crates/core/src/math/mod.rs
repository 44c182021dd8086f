//! Mathematics: vectors, rotations and spatial algebra over lanes, interleaved values, and random numbers.

pub(crate) mod disjoint_sets;
pub(crate) mod lane_arrays;
pub mod lanes;
pub mod precision;
pub mod random;
pub mod spatial;
