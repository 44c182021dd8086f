//! Stages of a step, numbered in their order, one file each. No stage imports another: they share only small structs.

pub mod s01_actuate;
pub mod s02_smooth;
pub mod s03_detect;
pub mod s04_assemble;
pub mod s05_solve;
pub mod s06_integrate_velocity;
pub mod s07_integrate_position;
pub mod s08_stabilise;
pub mod s09_sense;
pub mod s10_record;
