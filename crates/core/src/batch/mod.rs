//! Many environments of one model: their state, parameters of their own, workers on threads, rollouts, and the simulation that users call.

pub mod call;
pub mod environments;
mod exchange;
pub mod randomization;
pub mod rollout;
pub mod saved_state;
mod sensors;
pub mod simulation;
pub mod state;
pub mod worker;
mod worst_row;

pub use environments::*;
pub use worst_row::WorstRow;
