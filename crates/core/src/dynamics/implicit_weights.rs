//! Weights with which damping and stiffness enter the mass matrix, if they are implicit.

use stepper_real::{Mask, Real};

/// Weights that convert damping d and stiffness k to added inertia: `damping * d + stiffness * k`, kg or kg m^2.
#[derive(Clone, Copy, Debug)]
pub struct ImplicitWeights<R> {
    /// Weight of damping, s; zero makes damping explicit.
    pub damping: R,
    /// Weight of stiffness, s^2; zero makes springs explicit.
    pub stiffness: R,
    /// Time step from which the extra share s of damping is computed, s. Zero disables the extra share (see [`crate::actuation::forces`]).
    pub step: R,
}

impl<R: Real> ImplicitWeights<R> {
    /// Whether a damping has an extra share s in any lane. If so, [`Self::extra_share`] must be called.
    #[inline(always)]
    pub(crate) fn has_extra_share(self, damping: R) -> bool {
        (self.step * damping).gt(R::zero()).any()
    }

    /// Extra share s = z / (6 + z) of a damper that the step evaluates at its end, from 0 to 1. z is the time step times `rate`, the ratio
    /// d / m of damping to inertia, 1/s.
    #[inline(always)]
    pub(crate) fn extra_share(self, rate: R) -> R {
        let z = self.step * rate;
        z / (R::of(6.0) + z)
    }

    /// Additional damping 3/2 s h k of a spring with stiffness k, where s is the extra share of its damper.
    #[inline(always)]
    pub(crate) fn spring_damping(self, share: R, stiffness: R) -> R {
        R::of(1.5) * share * self.step * stiffness
    }
}
