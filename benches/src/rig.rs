//! A step taken apart: the stages that [`stepper_core::internals::step::step`] calls, each to be repeated on its own.
//!
//! The step may call a stage more than once; put together here they make a plain step of the midpoint rule without a corrector, which is
//! only good for getting to the next moment.

use std::hint::black_box;

use stepper_core::internals::actuation::forces::{ActuatorForces, ForceState, Implicit, ImplicitServos};
use stepper_core::internals::collision::contact_set::Contacts;
use stepper_core::internals::collision::detection::GeomPoses;
use stepper_core::internals::compile::LaneModel;
use stepper_core::internals::constraints::{AssemblyInput, Constraints};
use stepper_core::internals::dynamics::implicit_weights::ImplicitWeights;
use stepper_core::internals::dynamics::inertia::{MassMatrix, NewtonEuler, bias_force};
use stepper_core::internals::dynamics::kinematics::{Kinematics, advance, displace};
use stepper_core::internals::math::spatial::{Inertia, V3, zero};
use stepper_core::internals::options::StepSettings;
use stepper_core::internals::stages::s01_actuate::actuate;
use stepper_core::internals::stages::s02_smooth::Smooth;
use stepper_core::internals::stages::s03_detect::detect;
use stepper_core::internals::stages::s04_assemble;
use stepper_core::internals::stages::s05_solve::solve;
use stepper_core::internals::stages::s06_integrate_velocity::integrate_velocity;
use stepper_core::internals::stages::s07_integrate_position::integrate_position;
use stepper_real::{Mask, Real, Scalar};

use crate::episode::Episode;
use crate::scenes::Scene;

/// A part of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Half a step along the velocity, to where forces are taken.
    Displace,
    /// Poses, axes and inertias.
    Kinematics,
    /// Mass matrix and its factors.
    Mass,
    /// Of it, the matrix alone.
    MassMatrix,
    /// Of it, a copy of the matrix and its factors.
    Factor,
    /// Actuators and springs.
    Actuate,
    /// Newton-Euler and the solve with the factors.
    Acceleration,
    /// Of it, recursive Newton-Euler alone.
    BiasForce,
    /// Contacts.
    Detect,
    /// Impulses of the same contacts in the last step.
    WarmStart,
    /// Rows of contacts and limits.
    Assemble,
    /// Impulses, from the warm start.
    Solve,
    /// Impulses to velocities.
    Velocity,
    /// Velocities to configurations.
    Position,
}

impl Part {
    /// All of them, in the order of a step.
    pub const ALL: [Part; 14] = [
        Part::Displace,
        Part::Kinematics,
        Part::Mass,
        Part::MassMatrix,
        Part::Factor,
        Part::Actuate,
        Part::Acceleration,
        Part::BiasForce,
        Part::Detect,
        Part::WarmStart,
        Part::Assemble,
        Part::Solve,
        Part::Velocity,
        Part::Position,
    ];

    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Part::Displace => "displace",
            Part::Kinematics => "kinematics",
            Part::Mass => "mass",
            Part::MassMatrix => "mass: matrix",
            Part::Factor => "mass: factors",
            Part::Actuate => "actuate",
            Part::Acceleration => "acceleration",
            Part::BiasForce => "acceleration: bias force",
            Part::Detect => "detect",
            Part::WarmStart => "detect: warm start",
            Part::Assemble => "assemble",
            Part::Solve => "solve",
            Part::Velocity => "velocity",
            Part::Position => "position",
        }
    }
}

/// A group of lanes in the midst of a midpoint step.
#[derive(Clone, Debug)]
pub struct Rig<R: Real> {
    /// Configuration.
    pub q: Vec<R>,
    /// Velocity.
    pub v: Vec<R>,
    settings: StepSettings,
    ctrl: Vec<R>,
    alive: R::Mask,
    kinematics: Kinematics<R>,
    smooth: Smooth<R>,
    poses: GeomPoses<R>,
    last: Contacts<R>,
    last_impulses: Vec<V3<R>>,
    last_scalars: Vec<R>,
    contacts: Contacts<R>,
    constraints: Constraints<R>,
    warm_scalars: Vec<R>,
    warm_contacts: Vec<[R; 3]>,
    matrix: MassMatrix<R>,
    factors: MassMatrix<R>,
    composite: Vec<Inertia<R>>,
    recursion: NewtonEuler<R>,
    bias: Vec<R>,
    actuator_forces: ActuatorForces<R>,
    none: Vec<R>,
    q_eval: Vec<R>,
    q_next: Vec<R>,
    v_free: Vec<R>,
    v_next: Vec<R>,
}

impl<R: Real> Rig<R> {
    /// As many environments as there are lanes, in the state and with the first control of an episode; warm starts are cold.
    pub fn new(compiled: &LaneModel<R>, episode: &Episode) -> Self {
        use stepper_core::Field;
        let zeros = |n: usize| vec![R::zero(); n];
        let room = compiled.contact_points.min(16 + 4 * compiled.links.len());
        let mut rig = Self {
            q: zeros(compiled.nq),
            v: zeros(compiled.nv),
            settings: *episode.simulation().settings(),
            ctrl: zeros(compiled.actuators.len()),
            alive: R::Mask::splat(true),
            kinematics: Kinematics::new(compiled),
            smooth: Smooth::new(compiled),
            poses: GeomPoses::new(compiled),
            last: Contacts::new(room),
            last_impulses: vec![],
            last_scalars: zeros(compiled.limits.len() + compiled.frictions.len()),
            contacts: Contacts::new(room),
            constraints: Constraints::new(compiled, room),
            warm_scalars: vec![],
            warm_contacts: vec![],
            matrix: MassMatrix::new(compiled),
            factors: MassMatrix::new(compiled),
            composite: vec![zero(); compiled.links.len()],
            recursion: NewtonEuler::new(compiled),
            bias: zeros(compiled.nv),
            actuator_forces: ActuatorForces::new(compiled),
            none: zeros(compiled.nv),
            q_eval: zeros(compiled.nq),
            q_next: zeros(compiled.nq),
            v_free: zeros(compiled.nv),
            v_next: zeros(compiled.nv),
        };
        for lane in 0..R::LANES {
            for (field, to) in [(Field::Qpos, &mut rig.q), (Field::Qvel, &mut rig.v)] {
                let mut values = vec![0.0; to.len()];
                episode.simulation().get(field, lane, &mut values).expect("a field of an environment");
                set_lane(lane, &values, to);
            }
        }
        rig.control(&episode.controls()[0]);
        rig
    }

    /// Sets the controls, environment-major.
    pub fn control(&mut self, rows: &[f64]) {
        let n = self.ctrl.len();
        for lane in 0..R::LANES {
            set_lane(lane, &rows[lane * n..(lane + 1) * n], &mut self.ctrl);
        }
    }

    /// Makes a plain step.
    pub fn step(&mut self, compiled: &LaneModel<R>) {
        self.ready(compiled);
        std::mem::swap(&mut self.q, &mut self.q_next);
        std::mem::swap(&mut self.v, &mut self.v_next);
        std::mem::swap(&mut self.last, &mut self.contacts);
        self.last_impulses = self.last.data.iter().map(|slot| slot.impulse).collect();
        self.last_scalars.clone_from(&self.constraints.scalar_impulse);
    }

    /// Does every part once from the state and the warm start, so that each can be repeated with what it reads.
    pub fn ready(&mut self, compiled: &LaneModel<R>) {
        self.constraints.scalar_impulse.clone_from(&self.last_scalars);
        Part::ALL.into_iter().for_each(|part| self.once(compiled, part));
    }

    /// Does a part over and over at the same moment.
    pub fn repeat(&mut self, compiled: &LaneModel<R>, part: Part, times: u64) {
        for _ in 0..times {
            self.once(black_box(compiled), part);
        }
    }

    #[inline(never)]
    fn once(&mut self, compiled: &LaneModel<R>, part: Part) {
        let h = R::of(self.settings.timestep);
        let half = R::of(0.5 * self.settings.timestep);
        let weights = ImplicitWeights { damping: half, stiffness: half * half, step: h };
        match part {
            Part::Displace => displace(compiled, &self.q, &self.v, half, &mut self.q_eval),
            Part::Kinematics => self.kinematics.update(compiled, &self.q_eval),
            Part::Mass => {
                let implicit =
                    Implicit { weights, servos: &self.actuator_forces.weight, arms: &self.actuator_forces.arms, drag_at: Some(&self.v) };
                self.smooth.factor_mass(compiled, &self.kinematics, implicit);
            }
            Part::MassMatrix => self.mass_matrix(compiled, weights),
            Part::Factor => self.factor(compiled),
            Part::Actuate => {
                let at = ForceState::state(&self.q_eval, &self.v, &[], &self.ctrl, &[]);
                actuate(compiled, &at, Some(ImplicitServos { weights, all: true }), &mut self.actuator_forces);
            }
            Part::Acceleration => {
                self.smooth.acceleration(compiled, &self.kinematics, [&self.actuator_forces.tau, &self.none], &self.v, &self.v);
                advance(&self.v, &self.smooth.acc, h, &mut self.v_free);
            }
            Part::BiasForce => self.bias_force(compiled),
            Part::Detect => {
                let velocities = [&self.v[..], &self.v_free[..]];
                detect(compiled, &self.kinematics, velocities, [h, R::zero()], self.alive, &mut self.poses, &mut self.contacts);
            }
            Part::WarmStart => {
                // It uses up what it reads.
                for (slot, &impulse) in self.last.data.iter_mut().zip(&self.last_impulses) {
                    slot.impulse = impulse;
                }
                self.contacts.prepare(&mut self.last);
            }
            Part::Assemble => {
                let motion = &self.smooth.work;
                let (losses, closing) = (&self.actuator_forces.losses[..], R::one());
                let (q, v, v_free, alive) = (&self.q_eval[..], &self.v[..], &self.v_free[..], self.alive);
                let moment = AssemblyInput { q, v, motion, v_free, losses, h, lead: half, closing, alive };
                s04_assemble::assemble(
                    compiled,
                    &self.settings,
                    &self.kinematics,
                    &self.smooth.mass,
                    &moment,
                    &mut self.contacts,
                    &mut self.constraints,
                );
                self.warm_scalars.clone_from(&self.constraints.iterate.scalars);
                self.warm_contacts.clone_from(&self.constraints.iterate.contacts);
            }
            Part::Solve => self.solve(),
            Part::Velocity => {
                integrate_velocity(compiled, &self.smooth.mass, &self.v_free, &self.constraints, &mut self.v_next);
            }
            Part::Position => integrate_position(compiled, &self.q_eval, &self.v_next, half, &mut self.q_next),
        }
    }

    /// Solves from the warm start that the assembly made, every time.
    fn solve(&mut self) {
        let Constraints { problem, iterate, .. } = &mut self.constraints;
        R::vectorize(
            #[inline(always)]
            || {
                iterate.clear();
                iterate.scalars.extend_from_slice(&self.warm_scalars);
                iterate.contacts.extend_from_slice(&self.warm_contacts);
                iterate.compute_w(problem);
            },
        );
        solve(&self.settings, &self.v, self.constraints.constrained, &mut self.constraints, &mut self.contacts);
    }

    fn mass_matrix(&mut self, compiled: &LaneModel<R>, weights: ImplicitWeights<R>) {
        R::vectorize(
            #[inline(always)]
            || {
                self.matrix.assemble(compiled, &self.kinematics, &mut self.composite);
                self.matrix.add_joints(compiled, weights, &mut []);
            },
        );
    }

    fn factor(&mut self, compiled: &LaneModel<R>) {
        R::vectorize(
            #[inline(always)]
            || {
                self.factors.entries.copy_from_slice(&self.matrix.entries);
                self.factors.factor(compiled);
            },
        );
    }

    fn bias_force(&mut self, compiled: &LaneModel<R>) {
        R::vectorize(
            #[inline(always)]
            || bias_force(compiled, &self.kinematics, &self.v, &mut self.recursion, &mut self.bias),
        );
    }
}

fn set_lane<R: Real>(lane: usize, values: &[f64], to: &mut [R]) {
    for (to, &x) in to.iter_mut().zip(values) {
        to.set_lane(lane, Scalar::from_f64(x));
    }
}

/// The same group at several moments of an episode, so that no single one of them is typical for all.
pub fn moments<R: Real>(compiled: &LaneModel<R>, scene: &Scene, count: usize) -> Vec<Rig<R>> {
    use stepper_core::{Level, Precision};
    let level = *Level::available().last().unwrap_or(&Level::Baseline);
    let episode = Episode::new(scene, 0, R::LANES, Precision::F64, level);
    let mut rig = Rig::new(compiled, &episode);
    let calls = episode.controls().iter().cycle().take(count);
    calls
        .map(|control| {
            rig.control(control);
            (0..Episode::hold()).for_each(|_| rig.step(compiled));
            rig.clone()
        })
        .collect()
}
