//! Inputs of stage 9: poses and motions of frames, masses, rays, contacts; random numbers and the errors of real sensors.

use stepper_real::Real;

use crate::actuation::forces::ActuatorForces;
use crate::collision::contact_set::Contacts;
use crate::compile::ModelStructure;
use crate::math::spatial::*;
use crate::sensing::contact_list::Felt;

/// Inputs of the sensors: the state after a step, and the results of the step.
#[derive(Debug)]
pub struct SensorInput<'a, R: Real> {
    /// Configuration.
    pub q: &'a [R],
    /// Velocity.
    pub v: &'a [R],
    /// Simulated time, s.
    pub time: R,
    /// Length of the step, s.
    pub h: R,
    /// Acceleration (v+ - v) / h of the step, impulses included.
    pub acceleration: &'a [R],
    /// Forces of the actuators.
    pub actuator_forces: &'a ActuatorForces<R>,
    /// Applied wrenches (force, torque), 6 nbody; empty without any.
    pub xfrc: &'a [R],
    /// Impulses of limits and dry friction.
    pub scalar_impulse: &'a [R],
    /// Contacts with their impulses.
    pub contacts: &'a Contacts<R>,
}

/// Workspace that all sensors share. The caller places mocap frames in `kinematics` and in `orientation`.
#[derive(Clone, Debug)]
pub struct SensorWorkspace<R: Real> {
    /// Readings of ideal sensors.
    pub truth: Vec<R>,
    /// Orientation of every frame as a quaternion; empty when no sensor reads one.
    pub orientation: Vec<[R; 4]>,
    /// Velocity of every link about its tree's reference point.
    pub velocity: Vec<V6<R>>,
    /// Acceleration of every link about its tree's reference point. Gravity is included as an upward acceleration of the world.
    pub acceleration: Vec<V6<R>>,
    /// Force and torque of the parent on every subtree of the compiled model's list.
    pub carried: Vec<[V3<R>; 2]>,
    pub(crate) felt: Felt,
    pub(crate) order: Vec<(f64, usize)>,
}

impl<R: Real> SensorWorkspace<R> {
    /// Workspace for a compiled model.
    pub fn new(compiled: &ModelStructure<R::Scalar>, max_contacts: usize) -> Self {
        let sensing = &compiled.sensing;
        let links = if sensing.needs.velocities { compiled.links.len() } else { 0 };
        let frames = if sensing.quaternions { compiled.nframe() } else { 0 };
        let one = [R::one(), R::zero(), R::zero(), R::zero()];
        Self {
            truth: vec![R::zero(); sensing.width],
            orientation: vec![one; frames],
            velocity: vec![zero(); links],
            acceleration: vec![zero(); links],
            carried: vec![[zero(); 2]; sensing.carried.len()],
            felt: Felt::new(if sensing.needs.contacts { max_contacts * R::LANES } else { 0 }),
            order: Vec::with_capacity(if sensing.needs.contacts { max_contacts } else { 0 }),
        }
    }
}
