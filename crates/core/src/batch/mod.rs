//! Many environments of one model: their state, per-environment parameters, workers on threads, rollouts, and the simulation that users
//! call.

pub mod call;
mod capacity;
mod configuration;
mod engine;
pub mod environments;
mod exchange;
pub mod inputs;
pub mod parameter_overrides;
pub mod randomization;
mod ray_calls;
pub mod ray_query;
pub mod rollout;
pub mod saved_state;
mod saving;
mod sensors;
pub mod simulation;
pub mod state;
mod stepping;
pub mod worker;
mod worker_pool;
mod worst_row;

pub use worst_row::WorstRow;
