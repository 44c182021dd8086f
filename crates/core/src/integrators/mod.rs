//! Schemes of integration, and what a step is too long for.

pub mod impact;
pub mod rk4;
pub mod step_resolution;
