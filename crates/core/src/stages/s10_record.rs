//! Stage 10: what the step says of itself.

use stepper_real::{Mask, Real};

/// Outcome of a step in one environment, as bits; 0 is a step to be trusted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Status(pub u32);

impl Status {
    /// Solved to the tolerance, finite, every contact held.
    pub const OK: Self = Self(0);
    /// The residual is above the tolerance.
    pub const NOT_CONVERGED: Self = Self(1);
    /// The step was not finite; the environment keeps its last finite state.
    pub const NON_FINITE: Self = Self(2);
    /// There were more contacts than room; the ones found last were left out.
    pub const CONTACTS_FULL: Self = Self(4);
    /// The step was too long for the motion: inertial forces of its velocities were left out, and its energy was kept from growing.
    pub const UNRESOLVED: Self = Self(8);
    /// Something moved so fast that it may have passed through something thin.
    pub const TUNNELLED: Self = Self(16);
}

/// The record of one step, lane by lane.
#[derive(Clone, Copy, Debug)]
pub struct Record<R: Real> {
    /// Residual, m/s.
    pub residual: R,
    /// Sweeps and Newton steps of the solver, together.
    pub iterations: R,
    /// Lanes whose residual is above the tolerance.
    pub not_converged: R::Mask,
    /// Lanes that kept their last finite state.
    pub non_finite: R::Mask,
    /// Lanes (bits) that left contacts out.
    pub contacts_full: u32,
    /// Lanes whose motion was too fast for the step.
    pub unresolved: R::Mask,
    /// Lanes in which something may have passed through something thin.
    pub tunnelled: R::Mask,
}

impl<R: Real> Record<R> {
    /// Flags of one lane.
    #[inline(always)]
    pub fn status(&self, lane: usize) -> Status {
        let flag = |bits: u32, status: Status| if bits >> lane & 1 == 1 { status.0 } else { 0 };
        Status(
            flag(self.not_converged.bits(), Status::NOT_CONVERGED)
                | flag(self.non_finite.bits(), Status::NON_FINITE)
                | flag(self.contacts_full, Status::CONTACTS_FULL)
                | flag(self.unresolved.bits(), Status::UNRESOLVED)
                | flag(self.tunnelled.bits(), Status::TUNNELLED),
        )
    }
}
