//! Workspace of MuJoCo's integrators.

use stepper_real::Real;

use crate::compile::LaneModel;
use crate::constraints::soft::EffectiveMass;
use crate::integrators::mujoco::stages::RungeKuttaStages;
use crate::integrators::mujoco::unsymmetric::Unsymmetric;
use crate::options::{ContactLaw, Integrator, StepSettings};

/// Workspace of the integrator that the options select; empty with hard contact.
#[derive(Clone, Debug)]
pub(crate) struct MujocoWorkspace<R: Real> {
    /// Stages of the Runge-Kutta method.
    pub(crate) runge_kutta: Option<RungeKuttaStages<R>>,
    /// Matrix of the fully implicit rule.
    pub(crate) unsymmetric: Option<Unsymmetric<R>>,
    /// Matrix of the discrete rule.
    pub(crate) effective: Option<EffectiveMass<R>>,
}

impl<R: Real> MujocoWorkspace<R> {
    /// Workspace for a compiled model and the integrator of `options`.
    pub(crate) fn new(compiled: &LaneModel<R>, options: &StepSettings) -> Self {
        let uses = |integrator| options.contact == ContactLaw::Mujoco && options.integrator == integrator;
        Self {
            runge_kutta: uses(Integrator::Rk4).then(|| RungeKuttaStages::new(compiled.nq, compiled.nv, compiled.na)),
            unsymmetric: uses(Integrator::Implicit).then(|| Unsymmetric::new(compiled)),
            effective: uses(Integrator::Discrete).then(|| EffectiveMass::new(compiled)),
        }
    }
}
