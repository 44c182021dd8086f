//! Workspace of a step: all of its values, in buffers that a worker allocates once.

use stepper_real::{Mask, Real};

use crate::actuation::affine_force::ActuatorDynamics;
use crate::actuation::forces::ActuatorForces;
use crate::collision::contact_set::Contacts;
use crate::compile::LaneModel;
use crate::constraints::equality::active_equalities::ActiveEqualities;
use crate::constraints::row_builder::RowBuilder;
use crate::constraints::{ConstraintProblem, PositionSolution, VelocitySolution};
use crate::dynamics::mocap::MocapTrajectory;
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::evaluate::free_motion::FreeMotion;
use crate::integrators::inputs::Inputs;
use crate::integrators::mujoco::workspace::MujocoWorkspace;
use crate::integrators::rk4::Rk4;
use crate::integrators::state::State;
use crate::integrators::step_resolution::StepResolution;
use crate::integrators::substeps::buffers::Buffers;
use crate::integrators::velocity::collision_search::CollisionSearch;
use crate::math::spatial::*;
use crate::options::{ContactLaw, Integrator, StepSettings};
use crate::sensing::{SensorWorkspace, errors};

/// Workspace of the sensors in a step.
#[derive(Clone, Debug)]
pub(crate) struct Sensors<R: Real> {
    /// Readings, and intermediate results that several sensors share.
    pub(crate) workspace: SensorWorkspace<R>,
    /// Forces of the actuators at the state that the sensors read.
    pub(crate) actuator_forces: ActuatorForces<R>,
    /// Acceleration (v+ - v) / h of the last step, nv.
    pub(crate) acceleration: Vec<R>,
    /// Workspace of the error models; `None` until the first reading.
    pub(crate) error_work: Option<errors::Work<R>>,
}

/// Workspace of a step: state, inputs and all intermediate results. A worker creates it once and uses it for every group.
#[derive(Clone, Debug)]
pub struct Workspace<R: Real> {
    pub(crate) state: State<R>,
    pub(crate) inputs: Inputs<R>,
    /// Controls before the actuator pipelines, nu. Without pipelines, the controls are in `inputs` only.
    pub(crate) user_controls: Vec<R>,
    /// Lanes that have an environment.
    pub(crate) alive: R::Mask,
    /// Whether the workspace already contains the state of the group of environments that will be stepped next.
    pub(crate) current: bool,
    pub(crate) evaluation: Evaluation<R>,
    pub(crate) free_motion: FreeMotion<R>,
    pub(crate) problem: ConstraintProblem<R>,
    pub(crate) builder: RowBuilder<R>,
    pub(crate) velocity: VelocitySolution<R>,
    pub(crate) position: PositionSolution<R>,
    pub(crate) sensors: Sensors<R>,
    /// Search for the deferred contacts (left out of the solve) that collide in the predicted or solved motion.
    pub(crate) collisions: CollisionSearch<R>,
    /// Energy balance and limits of motions that are too fast for the time step.
    pub(crate) step_resolution: StepResolution<R>,
    /// Runge-Kutta method with hard contact; `None` with other integrators.
    pub(crate) rk4: Option<Rk4<R>>,
    /// Buffers of steps that are divided into parts; `None` before the first such step.
    pub(crate) substep_buffers: Option<Box<Buffers<R>>>,
    /// Constraint problem and integrators of MuJoCo's contact law; `None` with hard contact.
    pub(crate) mujoco: Option<Box<MujocoWorkspace<R>>>,
}

impl<R: Real> Workspace<R> {
    /// Workspace for a compiled model.
    pub fn new(compiled: &LaneModel<R>, options: &StepSettings, max_contacts: usize) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        let [q, v, act] = [compiled.nq, compiled.nv, compiled.na].map(|n| move || vec![R::zero(); n]);
        let hard = options.contact == ContactLaw::Hard;
        // The problem of MuJoCo's law is in `mujoco`.
        let hard_contacts = if hard { max_contacts } else { 0 };
        let contacts = || Contacts::new(max_contacts).with_torques(compiled.has_rolling_friction);
        let mut workspace = Self {
            state: State { q: q(), v: v(), act: act(), contacts: contacts(), impulse: v(), time: vec![0.0; R::LANES], elapsed: 0.0 },
            inputs: Inputs {
                ctrl: zeros(compiled.actuators.len()),
                actuator_dynamics: vec![ActuatorDynamics::default(); compiled.num_actuator_dynamics],
                qfrc: Vec::with_capacity(compiled.nv),
                xfrc: Vec::with_capacity(6 * compiled.bodies.len()),
                active_equalities: ActiveEqualities::new(compiled),
                mocap_trajectories: compiled.mocap.iter().map(|m| MocapTrajectory::at(splat(m.pos), splat(m.quat))).collect(),
            },
            user_controls: zeros(compiled.actuators.len()),
            alive: R::Mask::splat(true),
            current: false,
            evaluation: Evaluation::new(compiled, options, contacts()),
            free_motion: FreeMotion::new(compiled),
            problem: ConstraintProblem::new(compiled, hard_contacts),
            builder: RowBuilder::new(compiled),
            velocity: VelocitySolution::new(compiled, hard_contacts),
            position: PositionSolution::new(compiled, hard_contacts),
            sensors: Sensors {
                workspace: SensorWorkspace::new(compiled, max_contacts),
                actuator_forces: ActuatorForces::new(compiled),
                acceleration: v(),
                error_work: None,
            },
            collisions: CollisionSearch::new(compiled, max_contacts),
            step_resolution: StepResolution::new(compiled),
            rk4: (options.integrator == Integrator::Rk4 && hard).then(|| Rk4::new(compiled)),
            substep_buffers: None,
            mujoco: MujocoWorkspace::new(compiled, options, max_contacts),
        };
        if options.error.is_some() {
            workspace.substep_buffers = Some(workspace.new_buffers(compiled));
        }
        workspace
    }

    /// Buffers of steps that are divided into parts.
    pub(super) fn new_buffers(&self, compiled: &LaneModel<R>) -> Box<Buffers<R>> {
        Buffers::new(compiled, &self.state, &self.velocity.scalar_impulse, &self.evaluation.collision.narrow_phase.new_planes)
    }

    /// Lanes in which the last step clamped the force of an actuator, in any of its parts.
    #[inline(always)]
    pub(crate) fn saturated(&self, compiled: &LaneModel<R>, actuator: usize) -> R::Mask {
        match &self.substep_buffers {
            Some(buffers) if buffers.was_used => buffers.saturated[actuator],
            _ => self.free_motion.actuator_forces.is_saturated(compiled, actuator),
        }
    }

    /// Fills with NaN the vectors that a step must compute before it reads them.
    ///
    /// A test then detects reads of results of the last step. Kinematics, contacts, mass matrix, actuator forces and constraint rows are
    /// not filled.
    pub(crate) fn poison(&mut self) {
        self.evaluation.poison();
        self.free_motion.poison();
        self.velocity.v.fill(R::of(f64::NAN));
        self.position.poison();
        self.collisions.poison();
        self.step_resolution.poison();
    }
}
