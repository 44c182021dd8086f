//! Implicit integration scheme (integrator `implicit`): Euler's rule with springs, dampers and servos at the end of the step. Other
//! velocity-dependent forces use the predicted velocity there.
//!
//! First order, and L-stable in springs and dampers (backward Euler): it dissipates the energy of motions that it cannot resolve.

use stepper_real::Real;

use crate::dynamics::implicit_weights::ImplicitWeights;
use crate::integrators::scheme::Scheme;

/// Integration scheme of the implicit rule for a time step of `h` seconds.
#[inline(always)]
pub(crate) fn scheme<R: Real>(h: R) -> Scheme<R> {
    let none = R::zero();
    let weights = ImplicitWeights { damping: h, stiffness: h * h, step: none };
    Scheme {
        h,
        time_before: none,
        time_after: h,
        time_ahead: h,
        weights,
        velocity_weight: R::one(),
        in_the_middle: false,
        looks_ahead: true,
        implicit_forces: true,
    }
}
