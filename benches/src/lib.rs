//! What the benches share: robots made in code, runs that start again from the same state, a clock, a probe of the step, and rapier as a
//! peer.
//!
//! All times are processor time of one thread pinned to one core: what else the machine does costs nothing but cache.

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
