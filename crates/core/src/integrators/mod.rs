//! Parts of a step, between the ten stages: division into substeps, evaluation, the loop for velocities, positions, and integration
//! schemes.

pub(crate) mod acceptance;
pub mod devices;
pub mod evaluate;
pub mod inputs;
pub mod mujoco;
pub mod observation;
pub(crate) mod position;
pub mod rk4;
pub(crate) mod state;
pub(crate) mod step_input;
pub(crate) mod step_outcome;
pub mod step_resolution;
pub mod substeps;
pub(crate) mod velocity;
pub mod workspace;
