//! Moreau's midpoint rule: forces and constraint rows at q_mid = q (+) h/2 v, then q+ = q_mid (+) h/2 v+ (Moreau 1988).
//!
//! Second order in free flight and between impacts, which are evaluated at their times (`impact.rs`). Springs, dampers and servos
//! follow the implicit midpoint rule, which is A-stable and keeps the energy of linear springs ([`crate::actuation::forces`]).

use stepper_real::Real;

use crate::dynamics::implicit_weights::ImplicitWeights;
use crate::integrators::scheme::Scheme;

/// Integration scheme of the midpoint rule for a time step of `h` seconds.
#[inline(always)]
pub(crate) fn scheme<R: Real>(h: R) -> Scheme<R> {
    let half = h * R::of(0.5);
    let weights = ImplicitWeights { damping: half, stiffness: half * half, step: h };
    let velocity_weight = R::of(0.5);
    Scheme {
        h,
        time_before: half,
        time_after: half,
        time_ahead: R::zero(),
        weights,
        velocity_weight,
        in_the_middle: true,
        looks_ahead: false,
        implicit_forces: true,
    }
}
