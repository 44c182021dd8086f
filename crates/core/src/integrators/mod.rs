//! Schemes of integration over shared stages: where a step is taken, its solution, impacts, and what a step is too long for.

pub mod acceptance;
pub mod corrected_forces;
pub mod evaluation;
pub mod free_motion;
pub mod impact;
pub mod impact_set;
pub mod inputs;
pub mod rk4;
pub mod scheme;
pub mod solution;
pub mod step_resolution;
pub mod workspace;
