//! Weights of damping and stiffness in the mass matrix.

use stepper_real::{Mask, Real};

/// Shares of damping and stiffness in the mass matrix.
#[derive(Clone, Copy, Debug)]
pub struct ImplicitWeights<R> {
    /// Time by which damping is multiplied, s.
    pub damping: R,
    /// Squared time by which stiffness is multiplied, s^2; zero takes springs and servos explicitly.
    pub stiffness: R,
    /// Time step by which more is taken of what a step does not resolve, s; zero takes as much of all.
    pub step: R,
}

impl<R: Real> ImplicitWeights<R> {
    /// Whether more is taken of any damping, so that its share must be known.
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

    /// Damping that a spring gets with that share.
    #[inline(always)]
    pub(crate) fn drag(self, share: R, stiffness: R) -> R {
        R::of(1.5) * share * self.step * stiffness
    }
}
