//! Values of a step, each written by one stage: state and inputs, evaluation point, free motion, problem, and both solutions.

use stepper_real::{Mask, Real};

use crate::actuation::affine_force::ActuatorDynamics;
use crate::actuation::forces::{ActuatorForces, ForceState};
use crate::collision::contact_set::Contacts;
use crate::collision::detection::GeomPoses;
use crate::compile::LaneModel;
use crate::constraints::row_builder::RowBuilder;
use crate::constraints::solved_overlaps::SolvedOverlaps;
use crate::constraints::{ConstraintProblem, PositionSolution, VelocitySolution};
use crate::dynamics::kinematics::Kinematics;
use crate::dynamics::mocap::MocapTrajectory;
use crate::integrators::impact_set::Impacts;
use crate::integrators::inputs::Inputs;
use crate::integrators::mujoco::workspace::MujocoWorkspace;
use crate::integrators::rk4::Rk4;
use crate::integrators::scheme;
use crate::integrators::scheme::Scheme;
use crate::integrators::step_resolution::StepResolution;
use crate::integrators::strike_search::StrikeSearch;
use crate::math::spatial::*;
use crate::options::{ContactLaw, Integrator, StepSettings};
use crate::sensing::{SensorWorkspace, errors};
use crate::stages::s02_smooth::Smooth;

/// State of a group of lanes: with the scalar impulses of the constraints, all that a step hands to the next.
#[derive(Clone, Debug)]
pub(crate) struct State<R: Real> {
    /// Configuration, nq.
    pub(crate) q: Vec<R>,
    /// Velocity, nv.
    pub(crate) v: Vec<R>,
    /// Activations, na.
    pub(crate) act: Vec<R>,
    /// Contacts of the last step: the warm start of the next.
    pub(crate) contacts: Contacts<R>,
    /// Impulse of all constraints of the last step on the joints, nv.
    pub(crate) impulse: Vec<R>,
    /// Simulated time of every lane, s: in 64 bits, since it is a sum of many steps.
    pub(crate) time: Vec<f64>,
    /// Time since the call began, s. The poses of mocap bodies follow from it.
    pub(crate) elapsed: f64,
}

/// Input of a step, which the step does not change until it accepts the next state.
#[derive(Clone, Copy)]
pub(crate) struct StepInput<'a, R: Real> {
    pub(crate) compiled: &'a LaneModel<R>,
    pub(crate) options: &'a StepSettings,
    pub(crate) state: &'a State<R>,
    pub(crate) inputs: &'a Inputs<R>,
    /// Lanes that are environments.
    pub(crate) alive: R::Mask,
}

/// Evaluation point of a step, with the step's input. Stages 4 to 8 read it and do not change it.
#[derive(Clone, Copy)]
pub(crate) struct Place<'a, R: Real> {
    pub(crate) input: StepInput<'a, R>,
    pub(crate) evaluation: &'a Evaluation<R>,
}

impl<'a, R: Real> Place<'a, R> {
    /// Where forces are evaluated. Velocity-dependent forces that are not implicit use the velocity `v_at`.
    pub(crate) fn forces_at(&self, v_at: &'a [R]) -> ForceState<'a, R> {
        let Place { input: StepInput { state, inputs, .. }, evaluation: Evaluation { scheme, q, q_ahead, act, .. } } = *self;
        let Inputs { ctrl, actuator_dynamics, .. } = inputs;
        ForceState { q: scheme.springs_at(q, q_ahead), v: &state.v, v_at, act, ctrl, actuator_dynamics }
    }
}

/// Point in the step at which forces, contacts and rows are evaluated.
#[derive(Clone, Debug)]
pub(crate) struct Evaluation<R: Real> {
    /// Scheme of the step, with the evaluation time of each lane.
    pub(crate) scheme: Scheme<R>,
    /// Lanes that are evaluated at the start of the step in spite of the midpoint rule, because their bodies are fast.
    pub(crate) at_start: R::Mask,
    /// Configuration at which everything is evaluated, nq.
    pub(crate) q: Vec<R>,
    /// Configuration at which the implicit rule evaluates springs and servos, nq.
    pub(crate) q_ahead: Vec<R>,
    /// Activations at which forces are evaluated, na.
    pub(crate) act: Vec<R>,
    /// Poses at `q`.
    pub(crate) kinematics: Kinematics<R>,
    /// Poses of the geoms, with the cache of collision detection.
    pub(crate) poses: GeomPoses<R>,
    /// Contacts at `q`.
    pub(crate) contacts: Contacts<R>,
    /// Impacts of the step.
    pub(crate) impacts: Impacts<R>,
    /// Overlaps of the nominal step, while the step is differentiated.
    pub(crate) solved_overlaps: Option<Box<SolvedOverlaps<R>>>,
}

impl<R: Real> Evaluation<R> {
    /// Chooses the tangents of the contacts, with the impulses of the same contacts in `last`, which is overwritten.
    #[inline(always)]
    pub(crate) fn match_contacts(&mut self, compiled: &LaneModel<R>, last: &mut Contacts<R>) {
        self.contacts.close_rounded_gaps(norm(compiled.params.gravity()) * self.scheme.h * self.scheme.h);
        self.contacts.prepare(last);
    }
}

/// Motion without constraints, and the forces that cause it.
#[derive(Clone, Debug)]
pub(crate) struct FreeMotion<R: Real> {
    /// Mass matrix, bias forces and acceleration.
    pub(crate) smooth: Smooth<R>,
    /// Forces of actuators and springs.
    pub(crate) actuator_forces: ActuatorForces<R>,
    /// Generalized forces that the user applies, nv.
    pub(crate) applied: Vec<R>,
    /// Velocity after the step without constraints, nv.
    pub(crate) v: Vec<R>,
    /// Velocity after the step at which inertial forces are evaluated, nv.
    pub(crate) v_expected: Vec<R>,
    /// Impulse of constraints on the joints that servos at their bounds expect, nv.
    pub(crate) expected_impulse: Vec<R>,
    /// Impulse of the step's constraints on the joints, nv.
    pub(crate) impulse: Vec<R>,
    /// Lanes whose motion the time step does not resolve.
    pub(crate) unresolved: R::Mask,
    /// Lanes whose motion is so fast that the error of the time step may add energy.
    pub(crate) may_gain: R::Mask,
    /// Lanes of `may_gain` in which the error of the time step adds energy.
    pub(crate) gains: R::Mask,
    /// Buffers of the functions that compute the free motion.
    pub(crate) scratch: Scratch<R>,
}

/// Scratch buffers of the free motion, each named after its content, nv. A function that reads one has filled it before.
#[derive(Clone, Debug)]
pub(crate) struct Scratch<R: Real> {
    /// Change of the velocity by the impulses of constraints.
    pub(crate) impulse_change: Vec<R>,
    /// Change of the velocity that servos expect.
    pub(crate) expected_change: Vec<R>,
    /// Impulses on the joints.
    pub(crate) impulse: Vec<R>,
    /// Velocity at which velocity-dependent forces are evaluated.
    pub(crate) v_mean: Vec<R>,
    /// The same, where inertial forces are left out in some lanes.
    pub(crate) v_forces: Vec<R>,
    /// Free velocity with recomputed forces.
    pub(crate) v_free_corrected: Vec<R>,
    /// Difference of that from the free velocity before.
    pub(crate) free_change: Vec<R>,
    /// Free velocity in the middle of an impact.
    pub(crate) v_half: Vec<R>,
    /// Velocity before impacts, or its change.
    pub(crate) before_impact: Vec<R>,
}

/// Workspace of the sensors.
#[derive(Clone, Debug)]
pub(crate) struct Sensors<R: Real> {
    /// Readings, and what sensors share.
    pub(crate) workspace: SensorWorkspace<R>,
    /// Forces of the actuators at the state that is read.
    pub(crate) actuator_forces: ActuatorForces<R>,
    /// Acceleration (v+ - v) / h of the last step, nv.
    pub(crate) acceleration: Vec<R>,
    /// Workspace of the error models, made with the first.
    pub(crate) error_work: Option<errors::Work<R>>,
}

/// Workspace of a step: its state, its input and the value of every pass. A worker makes it once and uses it for every group.
#[derive(Clone, Debug)]
pub struct Workspace<R: Real> {
    pub(crate) state: State<R>,
    pub(crate) inputs: Inputs<R>,
    /// Controls as the user gave them, nu; actuator pipelines turn them into `inputs`.
    pub(crate) user_controls: Vec<R>,
    /// Lanes that are environments.
    pub(crate) alive: R::Mask,
    /// Whether the state is that of the group that is worked on, so that it need not be loaded again.
    pub(crate) current: bool,
    pub(crate) evaluation: Evaluation<R>,
    pub(crate) free_motion: FreeMotion<R>,
    pub(crate) problem: ConstraintProblem<R>,
    pub(crate) builder: RowBuilder<R>,
    pub(crate) velocity: VelocitySolution<R>,
    pub(crate) position: PositionSolution<R>,
    pub(crate) sensors: Sensors<R>,
    /// Search for the contacts that the solved motion closes.
    pub(crate) strikes: StrikeSearch<R>,
    /// Energy balance of fast motions.
    pub(crate) step_resolution: StepResolution<R>,
    /// Runge-Kutta scheme with hard contact.
    pub(crate) rk4: Option<Rk4<R>>,
    /// Integrators of MuJoCo's contact law.
    pub(crate) mujoco: MujocoWorkspace<R>,
}

impl<R: Real> FreeMotion<R> {
    /// Computes the acceleration by all forces, see [`Smooth::acceleration`]: `v` is the velocity before the step, `v_bias` the one at which
    /// inertial forces are evaluated.
    pub(crate) fn accelerate(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R], v_bias: &[R]) {
        self.smooth.acceleration(compiled, kinematics, [&self.actuator_forces.tau, &self.applied], v, v_bias);
    }
}

impl<R: Real> Workspace<R> {
    /// Workspace for a compiled model.
    pub fn new(compiled: &LaneModel<R>, options: &StepSettings, max_contacts: usize) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        let [q, v, act] = [compiled.nq, compiled.nv, compiled.na].map(|n| move || vec![R::zero(); n]);
        let hard = options.contact == ContactLaw::Hard;
        let none = R::Mask::splat(false);
        let contacts = || Contacts::new(max_contacts).with_torques(compiled.has_rolling_friction);
        Self {
            state: State { q: q(), v: v(), act: act(), contacts: contacts(), impulse: v(), time: vec![0.0; R::LANES], elapsed: 0.0 },
            inputs: Inputs {
                ctrl: zeros(compiled.actuators.len()),
                actuator_dynamics: vec![ActuatorDynamics::default(); compiled.actuator_dynamics],
                qfrc: Vec::with_capacity(compiled.nv),
                xfrc: Vec::with_capacity(6 * compiled.bodies.len()),
                mocap_trajectories: compiled.mocap.iter().map(|m| MocapTrajectory::at(splat(m.pos), splat(m.quat))).collect(),
            },
            user_controls: zeros(compiled.actuators.len()),
            alive: R::Mask::splat(true),
            current: false,
            evaluation: Evaluation {
                scheme: scheme(options),
                at_start: none,
                q: q(),
                q_ahead: q(),
                act: act(),
                kinematics: Kinematics::new(compiled),
                poses: GeomPoses::new(compiled),
                contacts: contacts(),
                impacts: Impacts::new(compiled),
                solved_overlaps: None,
            },
            free_motion: FreeMotion {
                smooth: Smooth::new(compiled),
                actuator_forces: ActuatorForces::new(compiled),
                applied: v(),
                v: v(),
                v_expected: v(),
                expected_impulse: v(),
                impulse: v(),
                unresolved: none,
                may_gain: none,
                gains: none,
                scratch: Scratch {
                    impulse_change: v(),
                    expected_change: v(),
                    impulse: v(),
                    v_mean: v(),
                    v_forces: v(),
                    v_free_corrected: v(),
                    free_change: v(),
                    v_half: v(),
                    before_impact: v(),
                },
            },
            problem: ConstraintProblem::new(compiled, max_contacts),
            builder: RowBuilder::new(compiled),
            velocity: VelocitySolution::new(compiled, max_contacts),
            position: PositionSolution::new(compiled, max_contacts),
            sensors: Sensors {
                workspace: SensorWorkspace::new(compiled, max_contacts),
                actuator_forces: ActuatorForces::new(compiled),
                acceleration: v(),
                error_work: None,
            },
            strikes: StrikeSearch::new(compiled, max_contacts),
            step_resolution: StepResolution::new(compiled),
            rk4: (options.integrator == Integrator::Rk4 && hard).then(|| Rk4::new(compiled)),
            mujoco: MujocoWorkspace::new(compiled, options),
        }
    }

    /// Updates the poses of the geoms of the world, after their parameters have changed.
    pub(crate) fn update_static_poses(&mut self, compiled: &LaneModel<R>) {
        self.evaluation.poses.update_static_poses(compiled);
    }

    /// Fills with NaN the vectors that a step computes before it reads them: a number left by the step before would pass for one of this
    /// step (as Drake's `icf_data.h` does). Kinematics, contacts, mass matrix, actuator forces and constraint rows are not filled.
    pub(crate) fn poison(&mut self) {
        let Self {
            evaluation, free_motion: FreeMotion { applied, v, v_expected, expected_impulse, scratch, .. }, velocity, position, ..
        } = self;
        let Scratch { impulse_change, expected_change, impulse, v_mean, v_forces, v_free_corrected, free_change, .. } = scratch;
        let Scratch { v_half, before_impact, .. } = scratch;
        let PositionSolution { q, act, v_free, carried, correction, q_corrected, .. } = position;
        let computed = [
            [&mut evaluation.q, &mut evaluation.q_ahead, &mut evaluation.act, applied, v, v_expected, expected_impulse],
            [impulse_change, expected_change, impulse, v_mean, v_forces, v_free_corrected, free_change],
            [&mut velocity.v, q, act, v_free, carried, correction, q_corrected],
        ];
        computed.into_iter().flatten().chain([v_half, before_impact]).for_each(|buffer| buffer.fill(R::of(f64::NAN)));
        self.strikes.poison();
        self.step_resolution.poison();
    }
}
