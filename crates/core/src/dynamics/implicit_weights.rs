//! Weights of damping and stiffness in the mass matrix.

use stepper_real::{Mask, Real};

/// Shares of damping and stiffness in the mass matrix.
#[derive(Clone, Copy, Debug)]
pub struct ImplicitWeights<R> {
    /// Time factor of the implicit damping, s.
    pub damping: R,
    /// Squared time factor of the implicit stiffness, s^2; zero makes springs and servos explicit.
    pub stiffness: R,
    /// Time step for the additional share of unresolved damping, s; zero for no additional share.
    pub step: R,
}

impl<R: Real> ImplicitWeights<R> {
    /// Whether damping has an additional share, so that it must be computed.
    #[inline(always)]
    pub(crate) fn fits(self, damping: R) -> bool {
        (self.step * damping).gt(R::zero()).any()
    }

    /// Additional share of a damping at the end of the step, from 0 to 1, for a rate of damping d / m, 1/s.
    #[inline(always)]
    pub(crate) fn share(self, rate: R) -> R {
        let z = self.step * rate;
        z / (R::of(6.0) + z)
    }

    /// Damping that a spring receives with that share.
    #[inline(always)]
    pub(crate) fn drag(self, share: R, stiffness: R) -> R {
        R::of(1.5) * share * self.step * stiffness
    }
}
