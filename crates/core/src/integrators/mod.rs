//! Integration schemes: the times in a step at which forces and contacts are evaluated, and the parts of a step that all schemes share.

pub(crate) mod acceptance;
pub(crate) mod collision_search;
pub(crate) mod contact_activation;
pub mod devices;
pub(crate) mod evaluation;
pub(crate) mod free_motion;
pub(crate) mod impact;
pub mod inputs;
pub(crate) mod locate;
pub(crate) mod mechanism_motion;
pub mod mujoco;
pub mod observation;
pub(crate) mod overlap_progress;
pub(crate) mod positions;
pub(crate) mod predict;
pub(crate) mod recomputed;
pub mod rk4;
pub mod scheme;
pub(crate) mod solve_velocities;
pub(crate) mod state;
pub(crate) mod step_input;
pub(crate) mod step_outcome;
pub mod step_resolution;
pub(crate) mod velocity_loop;
pub mod workspace;
