//! Inputs of a step: controls, applied forces, active equalities and mocap trajectories.

use stepper_real::Real;

use crate::actuation::affine_force::ActuatorDynamics;
use crate::constraints::equality::active_equalities::ActiveEqualities;
use crate::dynamics::mocap::MocapTrajectory;

/// Controls, applied forces, active equalities and mocap trajectories of a step.
#[derive(Clone, Debug)]
pub struct Inputs<R: Real> {
    /// Controls after the actuator pipelines (delay, lag ...), nu.
    pub ctrl: Vec<R>,
    /// Actuator dynamics that act within a step.
    pub actuator_dynamics: Vec<ActuatorDynamics<R>>,
    /// Applied generalized forces (`qfrc_applied`), nv, N or N m; empty without any.
    pub qfrc: Vec<R>,
    /// Applied force and torque on each body (`xfrc_applied`), 6 nbody, N and N m; empty without any.
    pub xfrc: Vec<R>,
    /// Lanes in which each equality of the model is active.
    pub(crate) active_equalities: ActiveEqualities<R>,
    /// Trajectories of the mocap bodies during the call of `step`.
    pub(crate) mocap_trajectories: Vec<MocapTrajectory<R>>,
}
