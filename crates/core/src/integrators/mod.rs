//! Integration schemes: the times in a step at which forces and contacts are evaluated, and the parts of a step that all schemes share.

pub(crate) mod acceptance;
pub(crate) mod assemble;
pub(crate) mod collision_search;
pub(crate) mod contact_activation;
pub(crate) mod controls;
pub mod devices;
pub(crate) mod energy_guard;
pub mod euler;
pub(crate) mod evaluation;
pub(crate) mod free_motion;
pub(crate) mod impact;
pub(crate) mod impact_set;
pub mod implicit;
pub mod inputs;
pub(crate) mod locate;
pub mod midpoint;
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
pub mod workspace;

use stepper_real::Real;

use crate::options::{Integrator, StepSettings};
use scheme::Scheme;

/// Integration scheme for hard contact of the integrator that the options select. `ImplicitFast` and `Discrete`, which the options allow
/// only with MuJoCo's law, count as `Implicit` here.
#[inline(always)]
pub(crate) fn scheme<R: Real>(options: &StepSettings) -> Scheme<R> {
    let h = R::of(options.timestep);
    match options.integrator {
        Integrator::Euler => euler::scheme(h),
        Integrator::Midpoint => midpoint::scheme(h),
        Integrator::Implicit | Integrator::ImplicitFast | Integrator::Discrete => implicit::scheme(h),
        Integrator::Rk4 => rk4::scheme(h),
    }
}
