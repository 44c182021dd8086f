//! Workspace of the classical Runge-Kutta method, for MuJoCo's contact law.

use stepper_real::Real;

/// Workspace of the Runge-Kutta method.
#[derive(Clone, Debug)]
pub(crate) struct RungeKuttaStages<R: Real> {
    /// Weighted sums of displacement rates, accelerations and rates of activations.
    pub(super) sum: [Vec<R>; 3],
    /// Displacement rate of the last stage, and its rate of activations.
    pub(super) rate: [Vec<R>; 2],
}

impl<R: Real> RungeKuttaStages<R> {
    pub(crate) fn new(nv: usize, na: usize) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        Self { sum: [nv, nv, na].map(zeros), rate: [nv, na].map(zeros) }
    }
}
