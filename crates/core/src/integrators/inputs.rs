//! What the user says to a step.

use crate::actuation::affine_force::ActuatorDynamics;

/// What the user says to a step.
#[derive(Clone, Debug)]
pub struct Inputs<R> {
    /// Controls, nu, as actuator pipelines hand them on.
    pub ctrl: Vec<R>,
    /// Actuator dynamics that act within a step.
    pub actuator_dynamics: Vec<ActuatorDynamics<R>>,
    /// Forces on the joints, nv, N or N m; empty when there are none.
    pub qfrc: Vec<R>,
    /// Wrenches on the bodies (force, torque), 6 nbody, N and N m; empty when there are none.
    pub xfrc: Vec<R>,
}
