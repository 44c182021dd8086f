//! Schemes of integration over shared stages: where a step is taken, its solution, impacts, and what a step is too long for.

pub mod acceptance;
pub mod corrected_forces;
pub mod devices;
pub mod euler;
pub mod evaluation;
pub mod free_motion;
pub(crate) mod held_overlaps;
pub mod impact;
pub mod impact_set;
pub mod implicit;
pub mod inputs;
pub mod midpoint;
pub mod mujoco;
pub mod observation;
pub(crate) mod overlap_progress;
pub(crate) mod recomputed;
pub(crate) mod response;
pub mod rk4;
pub mod scheme;
pub mod solution;
pub mod step_resolution;
pub(crate) mod strike_search;
pub(crate) mod struck_contacts;
pub mod workspace;

use stepper_real::Real;

use crate::options::{Integrator, StepSettings};
use scheme::Scheme;

/// The scheme that the options name.
pub(crate) fn scheme<R: Real>(options: &StepSettings) -> Scheme<R> {
    let h = R::of(options.timestep);
    match options.integrator {
        Integrator::Euler => euler::scheme(h),
        Integrator::Midpoint => midpoint::scheme(h),
        Integrator::Implicit | Integrator::ImplicitFast | Integrator::Discrete => implicit::scheme(h),
        Integrator::Rk4 => rk4::scheme(h),
    }
}
