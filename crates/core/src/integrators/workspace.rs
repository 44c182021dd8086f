//! State of a group of lanes while it steps, and room to work.

use stepper_real::{Mask, Real};

use crate::actuation::affine_force::ActuatorDynamics;
use crate::actuation::forces::ActuatorForces;
use crate::collision::contact_set::Contacts;
use crate::collision::detection::GeomPoses;
use crate::compile::LaneModel;
use crate::constraints::constraint_set::Constraints;
use crate::dynamics::kinematics::Kinematics;
use crate::dynamics::mocap::MocapTrajectory;
use crate::integrators::impact_set::Impacts;
use crate::integrators::inputs::Inputs;
use crate::integrators::rk4::Rk4;
use crate::integrators::step_resolution::StepResolution;
use crate::math::spatial::*;
use crate::options::{Integrator, StepSettings};
use crate::stages::s02_smooth::Smooth;

/// State of a group of lanes while it steps, and room to work. Made once per thread, used for every group.
#[derive(Clone, Debug)]
pub struct Workspace<R: Real> {
    /// Configuration.
    pub q: Vec<R>,
    /// Velocity.
    pub v: Vec<R>,
    /// Activations.
    pub act: Vec<R>,
    /// Contacts of the last step: the warm start of the next.
    pub contacts: Contacts<R>,
    /// Constraints, and the impulses of limits and dry friction of the last step.
    pub constraints: Constraints<R>,
    /// Impulse of all constraints of the last step on the joints, if a servo's bounds ask for it.
    pub impulse: Vec<R>,
    /// Lanes that are environments.
    pub alive: R::Mask,
    /// Whether all of the above is the state of the group that is worked on: then it need not be loaded again.
    pub(crate) current: bool,
    /// Poses at which the dynamics are taken.
    pub kinematics: Kinematics<R>,
    pub(crate) inputs: Inputs<R>,
    /// Controls as the user gave them, nu; drive trains make `inputs` of them.
    pub(crate) given: Vec<R>,
    /// Ways of the mocap bodies during this call, and the time of it that has passed, s.
    pub(crate) mocap_trajectories: Vec<MocapTrajectory<R>>,
    pub(crate) elapsed: f64,
    pub(crate) new_contacts: Contacts<R>,
    pub(crate) smooth: Smooth<R>,
    pub(crate) v_free: Vec<R>,
    pub(crate) poses: GeomPoses<R>,
    pub(crate) rk4: Option<Rk4<R>>,
    pub(crate) actuator_forces: ActuatorForces<R>,
    pub(crate) applied: Vec<R>,
    pub(crate) q_eval: Vec<R>,
    pub(crate) q_ahead: Vec<R>,
    pub(crate) v_mean: Vec<R>,
    pub(crate) act_eval: Vec<R>,
    /// Velocity after the step with which inertial forces are taken.
    pub(crate) expected: Vec<R>,
    pub(crate) change: Vec<R>,
    /// Impacts of the step, and room for the velocity before them.
    pub(crate) impacts: Impacts<R>,
    pub(crate) before_impact: Vec<R>,
    pub(crate) step_resolution: StepResolution<R>,
    pub(crate) unresolved: R::Mask,
    pub(crate) q_next: Vec<R>,
    pub(crate) v_next: Vec<R>,
    pub(crate) act_next: Vec<R>,
}

impl<R: Real> Workspace<R> {
    /// Room for a compiled model.
    pub fn new(compiled: &LaneModel<R>, options: &StepSettings, max_contacts: usize) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        Self {
            q: zeros(compiled.nq),
            v: zeros(compiled.nv),
            act: zeros(compiled.na),
            contacts: Contacts::new(max_contacts).with_torques(compiled.has_rolling_friction),
            constraints: Constraints::new(compiled, max_contacts),
            impulse: zeros(if compiled.servos_are_bounded { compiled.nv } else { 0 }),
            alive: R::Mask::splat(true),
            current: false,
            kinematics: Kinematics::new(compiled),
            inputs: Inputs {
                ctrl: zeros(compiled.actuators.len()),
                actuator_dynamics: vec![ActuatorDynamics::default(); compiled.actuator_dynamics],
                qfrc: Vec::with_capacity(compiled.nv),
                xfrc: Vec::with_capacity(6 * compiled.bodies.len()),
            },
            given: zeros(compiled.actuators.len()),
            mocap_trajectories: compiled.mocap.iter().map(|m| MocapTrajectory::at(splat(m.pos), splat(m.quat))).collect(),
            elapsed: 0.0,
            new_contacts: Contacts::new(max_contacts).with_torques(compiled.has_rolling_friction),
            smooth: Smooth::new(compiled),
            v_free: zeros(compiled.nv),
            poses: GeomPoses::new(compiled),
            rk4: (options.integrator == Integrator::Rk4).then(|| Rk4::new(compiled)),
            actuator_forces: ActuatorForces::new(compiled),
            applied: zeros(compiled.nv),
            q_eval: zeros(compiled.nq),
            q_ahead: zeros(compiled.nq),
            v_mean: zeros(compiled.nv),
            act_eval: zeros(compiled.na),
            expected: zeros(compiled.nv),
            change: zeros(compiled.nv),
            impacts: Impacts::new(compiled),
            before_impact: zeros(compiled.nv),
            step_resolution: StepResolution::new(compiled),
            unresolved: R::Mask::splat(false),
            q_next: zeros(compiled.nq),
            v_next: zeros(compiled.nv),
            act_next: zeros(compiled.na),
        }
    }
}

impl<R: Real> Workspace<R> {
    /// Takes up parameters that are read before a step: where the geoms of the world are.
    pub(crate) fn update_static_poses(&mut self, compiled: &LaneModel<R>) {
        self.poses.update_static_poses(compiled);
    }
}
