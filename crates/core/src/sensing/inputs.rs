//! Inputs and workspace of the sensors in stage 9.

use stepper_real::Real;

use crate::actuation::forces::ActuatorForces;
use crate::collision::contact_set::Contacts;
use crate::compile::{LaneModel, ModelStructure};
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;
use crate::sensing::contact_list::SensedContacts;

/// Inputs of the sensors: the state after a step, and the results of the step.
#[derive(Debug)]
pub struct SensorInput<'a, R: Real> {
    /// Configuration after the step, nq.
    pub q: &'a [R],
    /// Velocity after the step, nv.
    pub v: &'a [R],
    /// Simulated time after the step, s.
    pub time: R,
    /// Length of the step, s.
    pub h: R,
    /// Mean acceleration (v+ - v) / h of the step, which includes impulses, nv.
    pub acceleration: &'a [R],
    /// Forces of the actuators in the step.
    pub actuator_forces: &'a ActuatorForces<R>,
    /// Force (N) and torque (N m) that the user applied to every body (`xfrc_applied`), 6 nbody; empty if none.
    pub xfrc: &'a [R],
    /// Impulses of scalar constraint rows, such as limits and dry friction.
    pub scalar_impulse: &'a [R],
    /// Contacts of the step with their impulses.
    pub contacts: &'a Contacts<R>,
}

/// State and results of a step from which sensors read, in all lanes.
#[derive(Clone, Copy, Debug)]
pub struct SensorView<'a, R: Real> {
    /// Compiled model.
    pub compiled: &'a LaneModel<R>,
    /// Poses of the frames after the step.
    pub kinematics: &'a Kinematics<R>,
    /// Inputs of the sensors.
    pub input: &'a SensorInput<'a, R>,
    /// Orientation of every frame, see [`SensorWorkspace::orientation`].
    pub orientations: &'a [[R; 4]],
    /// Spatial velocity of every link, see [`SensorWorkspace::velocity`].
    pub velocities: &'a [V6<R>],
    /// Spatial acceleration of every link, see [`SensorWorkspace::acceleration`].
    pub accelerations: &'a [V6<R>],
    /// Force and torque on every subtree with a force or torque sensor, see [`SensorWorkspace::site_forces`].
    pub site_forces: &'a [[V3<R>; 2]],
    pub(crate) sensed_contacts: &'a SensedContacts,
}

/// Workspace that all sensors share. The caller writes the poses of mocap frames to `kinematics` and `orientation`.
#[derive(Clone, Debug)]
pub struct SensorWorkspace<R: Real> {
    /// True readings of all sensors.
    pub truth: Vec<R>,
    /// Orientation of every frame as a quaternion (w, x, y, z); empty if no sensor reads one.
    pub orientation: Vec<[R; 4]>,
    /// Spatial velocity of every link at the reference point of its kinematic tree, world axes.
    pub velocity: Vec<V6<R>>,
    /// Spatial acceleration of every link at the reference point of its kinematic tree, world axes. Gravity is included as an upward
    /// acceleration of the world.
    pub acceleration: Vec<V6<R>>,
    /// For each subtree with a force or torque sensor, force (N) and torque (N m) that the parent body exerts on it.
    pub site_forces: Vec<[V3<R>; 2]>,
    pub(crate) sensed_contacts: SensedContacts,
    pub(crate) order: Vec<(f64, usize)>,
}

impl<R: Real> SensorWorkspace<R> {
    /// Creates the workspace of the sensors for a compiled model.
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
            site_forces: vec![[zero(); 2]; sensing.force_sites.len()],
            sensed_contacts: SensedContacts::new(if sensing.needs.contacts { max_contacts * R::LANES } else { 0 }),
            order: Vec::with_capacity(if sensing.needs.contacts { max_contacts } else { 0 }),
        }
    }
}
