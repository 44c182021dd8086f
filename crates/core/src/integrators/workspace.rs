//! Workspace of a step: its inputs and results, grouped by the stage that computes them, and scratch buffers.

use stepper_real::{Mask, Real};

use crate::actuation::affine_force::ActuatorDynamics;
use crate::actuation::forces::ActuatorForces;
use crate::collision::contact_set::Contacts;
use crate::collision::detection::GeomPoses;
use crate::compile::LaneModel;
use crate::constraints::constraint_set::Constraints;
use crate::constraints::soft::EffectiveMass;
use crate::dynamics::kinematics::Kinematics;
use crate::dynamics::mocap::MocapTrajectory;
use crate::integrators::impact_set::Impacts;
use crate::integrators::inputs::Inputs;
use crate::integrators::mujoco::stages::RungeKuttaStages;
use crate::integrators::mujoco::unsymmetric::Unsymmetric;
use crate::integrators::rk4::Rk4;
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
}

/// Where a scheme takes the step.
#[derive(Clone, Debug)]
pub(crate) struct Evaluation<R: Real> {
    /// Configuration at which everything is taken, nq.
    pub(crate) q: Vec<R>,
    /// Configuration ahead of it, at which the implicit rule takes springs and servos, nq.
    pub(crate) q_ahead: Vec<R>,
    /// Activations at which forces are taken, na.
    pub(crate) act: Vec<R>,
    /// Poses at `q`.
    pub(crate) kinematics: Kinematics<R>,
    /// Contacts at `q`.
    pub(crate) contacts: Contacts<R>,
}

/// Motion without constraints, and the forces that make it.
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
    /// Velocity after the step with which inertial forces are taken, nv.
    pub(crate) v_expected: Vec<R>,
    /// Lanes whose motion the time step does not resolve.
    pub(crate) unresolved: R::Mask,
    /// Lanes whose motion is so fast that the error of the time step may make energy.
    pub(crate) may_gain: R::Mask,
    /// Those of them in which it does.
    pub(crate) gains: R::Mask,
}

/// State after the step; afterwards the buffer of the state after the next.
#[derive(Clone, Debug)]
pub(crate) struct NextState<R: Real> {
    /// Configuration, nq.
    pub(crate) q: Vec<R>,
    /// Velocity, nv.
    pub(crate) v: Vec<R>,
    /// Activations, na.
    pub(crate) act: Vec<R>,
}

/// Scratch buffers, each named after its content. Nothing here outlives the function that fills it and those that it calls, except
/// where that is said.
#[derive(Clone, Debug)]
pub(crate) struct Work<R: Real> {
    /// Change of the velocity by the impulses of constraints, nv.
    pub(crate) impulse_change: Vec<R>,
    /// Change of the velocity that servos reckon with, nv.
    pub(crate) expected_change: Vec<R>,
    /// Impulses on the joints, nv.
    pub(crate) impulse: Vec<R>,
    /// Velocity at which velocity-dependent forces are taken, nv.
    pub(crate) v_mean: Vec<R>,
    /// The same, where inertial forces are left out in some lanes, nv.
    pub(crate) v_forces: Vec<R>,
    /// Free velocity with forces that were taken again, nv.
    pub(crate) v_free_corrected: Vec<R>,
    /// Its difference from that before, nv.
    pub(crate) free_change: Vec<R>,
    /// Free velocity in the middle of an impact, nv.
    pub(crate) v_half: Vec<R>,
    /// Velocity before impacts, or its change, nv.
    pub(crate) before_impact: Vec<R>,
    /// Velocity by which positions lack what went on from the time of an impact, nv.
    pub(crate) carried: Vec<R>,
    /// Free velocity with which stage 8 solves for the positions of lanes with impacts, nv: from [`super::impact::prepare_position_solve`]
    /// to stage 8.
    pub(crate) v_positions: Vec<R>,
    /// Velocity after the step that the predicted impulses lead to, nv.
    pub(crate) v_predicted: Vec<R>,
    /// Velocity of the correction of positions, nv.
    pub(crate) correction: Vec<R>,
    /// Corrected configuration, nq.
    pub(crate) q_corrected: Vec<R>,
    /// Velocity of lanes whose energy is kept from growing, nv.
    pub(crate) v_limited: Vec<R>,
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

/// All that a step works on. Made once per thread, used for every group.
#[derive(Clone, Debug)]
pub struct Workspace<R: Real> {
    pub(crate) state: State<R>,
    pub(crate) inputs: Inputs<R>,
    pub(crate) evaluation: Evaluation<R>,
    pub(crate) free_motion: FreeMotion<R>,
    /// Constraint problem and its solution, and the impulses of all scalar rows of the last step (the warm start).
    pub(crate) constraints: Constraints<R>,
    pub(crate) next: NextState<R>,
    pub(crate) work: Work<R>,
    pub(crate) sensors: Sensors<R>,
    /// Lanes that are environments.
    pub(crate) alive: R::Mask,
    /// Whether the state is that of the group that is worked on: then it need not be loaded again.
    pub(crate) current: bool,
    /// Controls as the user gave them, nu; actuator pipelines make `inputs` of them.
    pub(crate) user_controls: Vec<R>,
    /// Ways of the mocap bodies during this call, and the time of it that has passed, s.
    pub(crate) mocap_trajectories: Vec<MocapTrajectory<R>>,
    pub(crate) elapsed: f64,
    /// Poses of the geoms, and what collision detection remembers.
    pub(crate) poses: GeomPoses<R>,
    /// Poses at a corrected configuration.
    pub(crate) corrected_kinematics: Kinematics<R>,
    /// Impacts of the step.
    pub(crate) impacts: Impacts<R>,
    /// Search for the contacts that the solved motion closes.
    pub(crate) strikes: StrikeSearch<R>,
    /// Workspace of the guard of the energy.
    pub(crate) step_resolution: StepResolution<R>,
    /// Workspace of the Runge-Kutta scheme, where it is used.
    pub(crate) rk4: Option<Rk4<R>>,
    /// Workspace of the same for MuJoCo's contact law.
    pub(crate) stages: Option<RungeKuttaStages<R>>,
    /// Matrix of the fully implicit rule of the same.
    pub(crate) unsymmetric: Option<Unsymmetric<R>>,
    /// Matrix of the discrete rule of the same.
    pub(crate) effective: Option<EffectiveMass<R>>,
}

impl<R: Real> FreeMotion<R> {
    /// Acceleration by all forces, see [`Smooth::acceleration`]: `v` is the velocity before the step, `v_bias` that of inertial forces.
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
        let contacts = || Contacts::new(max_contacts).with_torques(compiled.has_rolling_friction);
        Self {
            state: State { q: q(), v: v(), act: act(), contacts: contacts(), impulse: v(), time: vec![0.0; R::LANES] },
            inputs: Inputs {
                ctrl: zeros(compiled.actuators.len()),
                actuator_dynamics: vec![ActuatorDynamics::default(); compiled.actuator_dynamics],
                qfrc: Vec::with_capacity(compiled.nv),
                xfrc: Vec::with_capacity(6 * compiled.bodies.len()),
            },
            evaluation: Evaluation { q: q(), q_ahead: q(), act: act(), kinematics: Kinematics::new(compiled), contacts: contacts() },
            free_motion: FreeMotion {
                smooth: Smooth::new(compiled),
                actuator_forces: ActuatorForces::new(compiled),
                applied: v(),
                v: v(),
                v_expected: v(),
                unresolved: R::Mask::splat(false),
                may_gain: R::Mask::splat(false),
                gains: R::Mask::splat(false),
            },
            constraints: Constraints::new(compiled, max_contacts),
            next: NextState { q: q(), v: v(), act: act() },
            work: Work {
                impulse_change: v(),
                expected_change: v(),
                impulse: v(),
                v_mean: v(),
                v_forces: v(),
                v_free_corrected: v(),
                free_change: v(),
                v_half: v(),
                before_impact: v(),
                carried: v(),
                v_positions: v(),
                v_predicted: v(),
                correction: v(),
                q_corrected: q(),
                v_limited: v(),
            },
            sensors: Sensors {
                workspace: SensorWorkspace::new(compiled, max_contacts),
                actuator_forces: ActuatorForces::new(compiled),
                acceleration: v(),
                error_work: None,
            },
            alive: R::Mask::splat(true),
            current: false,
            user_controls: zeros(compiled.actuators.len()),
            mocap_trajectories: compiled.mocap.iter().map(|m| MocapTrajectory::at(splat(m.pos), splat(m.quat))).collect(),
            elapsed: 0.0,
            poses: GeomPoses::new(compiled),
            corrected_kinematics: Kinematics::new(compiled),
            impacts: Impacts::new(compiled),
            strikes: StrikeSearch::new(compiled, max_contacts),
            step_resolution: StepResolution::new(compiled),
            rk4: (options.integrator == Integrator::Rk4 && hard).then(|| Rk4::new(compiled)),
            unsymmetric: (options.integrator == Integrator::Implicit && !hard).then(|| Unsymmetric::new(compiled)),
            effective: (options.integrator == Integrator::Discrete && !hard).then(|| EffectiveMass::new(compiled)),
            stages: (options.integrator == Integrator::Rk4 && !hard).then(|| RungeKuttaStages::new(compiled.nq, compiled.nv, compiled.na)),
        }
    }

    /// Takes up parameters that are read before a step: where the geoms of the world are.
    pub(crate) fn update_static_poses(&mut self, compiled: &LaneModel<R>) {
        self.poses.update_static_poses(compiled);
    }

    /// Fills with NaN the vectors that a step computes before it reads them: a number left by the step before would pass for one of this
    /// step (as Drake's `icf_data.h` does). Kinematics, contacts, mass matrix, actuator forces and constraint rows are not filled.
    pub(crate) fn poison(&mut self) {
        let Self { evaluation, free_motion, next, work, .. } = self;
        let Work { impulse_change, expected_change, impulse, v_mean, v_forces, v_free_corrected, free_change, .. } = work;
        let Work { v_half, before_impact, carried, v_positions, v_predicted, correction, q_corrected, v_limited, .. } = work;
        let made = [
            [&mut evaluation.q, &mut evaluation.q_ahead, &mut evaluation.act, &mut free_motion.applied, &mut free_motion.v],
            [&mut free_motion.v_expected, &mut next.q, &mut next.v, &mut next.act, impulse_change],
            [expected_change, impulse, v_mean, v_forces, v_free_corrected],
            [free_change, v_half, before_impact, carried, v_positions],
        ];
        made.into_iter().flatten().chain([v_predicted, correction, q_corrected, v_limited]).for_each(|buffer| buffer.fill(R::of(f64::NAN)));
    }
}
