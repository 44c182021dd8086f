//! Mathematics without bodies: vectors, rotations and spatial algebra over lanes, interleaved numbers, random numbers.

pub mod lanes;
pub mod precision;
pub mod random;
pub mod spatial;
