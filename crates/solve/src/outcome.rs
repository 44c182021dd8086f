//! Result of a solve: its residual and its effort.

use stepper_real::Real;

/// Result of a solve, in each lane.
#[derive(Clone, Copy, Debug)]
pub struct Outcome<R: Real> {
    /// Residual of the returned impulses, m/s.
    pub residual: R,
    /// Number of sweeps (Gauss-Seidel iterations) of each lane.
    pub sweeps: R,
    /// Number of Newton steps of each lane, over all its islands.
    pub newton_steps: R,
}

impl<R: Real> Outcome<R> {
    /// Replaces the residual by that of a second solve, `again`, in the lanes `lanes`. In all lanes, adds the numbers of sweeps and Newton
    /// steps of the second solve.
    #[inline(always)]
    pub fn replace(&mut self, again: &Self, lanes: R::Mask) {
        self.residual = R::select(lanes, again.residual, self.residual);
        self.sweeps += again.sweeps;
        self.newton_steps += again.newton_steps;
    }
}
