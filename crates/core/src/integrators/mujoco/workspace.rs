//! Workspace of MuJoCo's integrators.

use stepper_real::Real;

use crate::compile::LaneModel;
use crate::constraints::soft::SoftSystem;
use crate::integrators::mujoco::unsymmetric::Unsymmetric;
use crate::integrators::state::State;
use crate::options::{Integrator, StepSettings};

/// State at which the acceleration is evaluated: the state before the step, or a Runge-Kutta stage.
#[derive(Clone, Debug)]
pub(crate) struct StageState<R: Real> {
    /// Configuration, nq.
    pub(crate) q: Vec<R>,
    /// Velocity, nv.
    pub(crate) v: Vec<R>,
    /// Activations, na.
    pub(crate) act: Vec<R>,
}

impl<R: Real> StageState<R> {
    /// Copies configuration, velocity and activations from the state before the step.
    pub(crate) fn copy_from(&mut self, state: &State<R>) {
        self.q.copy_from_slice(&state.q);
        self.v.copy_from_slice(&state.v);
        self.act.copy_from_slice(&state.act);
    }
}

/// Workspace of the Runge-Kutta method: sums and rates.
#[derive(Clone, Debug)]
pub(crate) struct RungeKuttaStages<R: Real> {
    /// Weighted sums over the Runge-Kutta stages: of displacement rates, of accelerations, and of activation rates.
    pub(super) sum: [Vec<R>; 3],
    /// Displacement rates and activation rates at the last Runge-Kutta stage that was evaluated.
    pub(super) rate: [Vec<R>; 2],
}

/// Workspace of a step with MuJoCo's contact law: its constraint problem, and the integrator that the options select.
#[derive(Clone, Debug)]
pub(crate) struct MujocoWorkspace<R: Real> {
    /// Constraint problem, its solver, and the acceleration.
    pub(crate) system: SoftSystem<R>,
    /// State at which the acceleration is evaluated.
    pub(crate) stage: StageState<R>,
    /// Runge-Kutta stages; `None` with other integrators.
    pub(crate) runge_kutta: Option<RungeKuttaStages<R>>,
    /// Matrix of the integrator `implicit`; `None` with other integrators.
    pub(crate) unsymmetric: Option<Unsymmetric<R>>,
}

impl<R: Real> MujocoWorkspace<R> {
    /// Workspace for a compiled model and the integrator of `options`; `None` with hard contact.
    pub(crate) fn new(compiled: &LaneModel<R>, options: &StepSettings, max_contacts: usize) -> Option<Box<Self>> {
        let softness = compiled.softness.as_ref()?;
        let uses = |integrator| options.integrator == integrator;
        let [nq, nv, na] = [compiled.nq, compiled.nv, compiled.na];
        let zeros = |n: usize| vec![R::zero(); n];
        Some(Box::new(Self {
            system: SoftSystem::new(compiled, softness, max_contacts),
            stage: StageState { q: zeros(nq), v: zeros(nv), act: zeros(na) },
            runge_kutta: uses(Integrator::Rk4).then(|| RungeKuttaStages { sum: [nv, nv, na].map(zeros), rate: [nv, na].map(zeros) }),
            unsymmetric: uses(Integrator::Implicit).then(|| Unsymmetric::new(compiled)),
        }))
    }
}
