//! Euler's rule, semi-implicit: forces and constraint rows at the configuration before the step, then q+ = q (+) h v+.
//!
//! First order. Some forces are implicit: damping of joints (unless the model makes it explicit), springs and dampers of tendons and soft
//! equalities, and servos of actuator dynamics. All other forces use the velocity before the step, as in MuJoCo's `Euler`.

use stepper_real::Real;

use crate::dynamics::implicit_weights::ImplicitWeights;
use crate::integrators::scheme::Scheme;

/// Integration scheme of Euler's rule for a time step of `h` seconds.
#[inline(always)]
pub(crate) fn scheme<R: Real>(h: R) -> Scheme<R> {
    let none = R::zero();
    let weights = ImplicitWeights { damping: h, stiffness: none, step: none };
    Scheme {
        h,
        time_before: none,
        time_after: h,
        time_ahead: none,
        weights,
        velocity_weight: none,
        in_the_middle: false,
        looks_ahead: false,
        implicit_forces: false,
    }
}
