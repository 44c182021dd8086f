//! Factors that convert implicit damping and stiffness to added inertia in the mass matrix.

use stepper_real::{Mask, Real};

/// Factors that convert implicit damping d and stiffness k to added inertia: `damping * d + stiffness * k`, kg or kg m^2.
#[derive(Clone, Copy, Debug)]
pub struct ImplicitWeights<R> {
    /// Factor of the damping, s; zero makes damping explicit.
    pub damping: R,
    /// Factor of the stiffness, s^2; zero makes springs explicit.
    pub stiffness: R,
    /// Time step h, s, if the step evaluates a late fraction of the damping (`late_fraction`); otherwise zero.
    pub late_step: R,
}

impl<R: Real> ImplicitWeights<R> {
    /// Whether the step evaluates a fraction of the damper `damping` at its end instead of its middle, in any lane. Then
    /// [`Self::late_fraction`] gives the fraction.
    #[inline(always)]
    pub(crate) fn has_late_fraction(self, damping: R) -> bool {
        (self.late_step * damping).gt(R::zero()).any()
    }

    /// Late fraction s = z / (6 + z) of a damper, from 0 to 1: the fraction that the step evaluates at its end instead of its middle (see
    /// [`crate::actuation::forces`]).
    ///
    /// z is the time step times `rate`, the ratio of damping to inertia, 1/s.
    #[inline(always)]
    pub(crate) fn late_fraction(self, rate: R) -> R {
        let z = self.late_step * rate;
        z / (R::of(6.0) + z)
    }

    /// Additional damping 3/2 s h k of a spring with the stiffness k (`stiffness`) and the time step h. Here s (`late`) is the result of
    /// [`Self::late_fraction`] for the spring's damper.
    #[inline(always)]
    pub(crate) fn spring_damping(self, late: R, stiffness: R) -> R {
        R::of(1.5) * late * self.late_step * stiffness
    }
}
