//! Workspace of the classical Runge-Kutta method, for MuJoCo's contact law.

use stepper_real::Real;

/// Workspace of the Runge-Kutta method: sums and rates.
#[derive(Clone, Debug)]
pub(crate) struct RungeKuttaStages<R: Real> {
    /// Weighted sums over the Runge-Kutta stages: of displacement rates, of accelerations, and of activation rates.
    pub(super) sum: [Vec<R>; 3],
    /// Displacement rates and activation rates at the last Runge-Kutta stage that was evaluated.
    pub(super) rate: [Vec<R>; 2],
}

impl<R: Real> RungeKuttaStages<R> {
    pub(crate) fn new(nv: usize, na: usize) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        Self { sum: [nv, nv, na].map(zeros), rate: [nv, na].map(zeros) }
    }
}
