//! Inputs of a step.

use stepper_real::Real;

use crate::actuation::affine_force::ActuatorDynamics;
use crate::dynamics::mocap::MocapTrajectory;

/// Controls, applied forces and mocap trajectories of a step.
#[derive(Clone, Debug)]
pub struct Inputs<R: Real> {
    /// Controls after the actuator pipelines, nu.
    pub ctrl: Vec<R>,
    /// Actuator dynamics that act within a step.
    pub actuator_dynamics: Vec<ActuatorDynamics<R>>,
    /// Forces on the joints, nv, N or N m; empty when there are none.
    pub qfrc: Vec<R>,
    /// Wrenches on the bodies (force, torque), 6 nbody, N and N m; empty when there are none.
    pub xfrc: Vec<R>,
    /// Trajectories of the mocap bodies during the call.
    pub(crate) mocap_trajectories: Vec<MocapTrajectory<R>>,
}
