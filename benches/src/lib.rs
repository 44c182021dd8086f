//! Shared parts of the benchmarks: robot models made in code, repeatable runs, a clock, time measurement within a step, and scenes in the
//! engine rapier for comparison.
//!
//! All times are processor time of one thread that is pinned to one core. Other load of the machine only affects caches.

pub mod boxes;
pub mod clock;
pub mod counted;
pub mod derivative;
pub mod episode;
pub mod floor;
pub mod npz;
pub mod parts;
pub mod peers;
pub mod recorder;
pub mod replay;
pub mod report;
pub mod scenes;
