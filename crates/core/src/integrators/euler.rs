//! Euler's rule, semi-implicit: everything at the configuration before the step, then q+ = q (+) h v+.
//!
//! First order. Implicit are the joints' damping (unless the model asks for it explicitly), springs and dampers of tendons and soft
//! equalities, and the servos of actuator dynamics; all other forces are taken at the velocity before the step, as in MuJoCo's `Euler`.

use stepper_real::Real;

use crate::dynamics::implicit_weights::ImplicitWeights;
use crate::integrators::scheme::Scheme;

/// Steps of `h` seconds.
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
        corrects: false,
    }
}
