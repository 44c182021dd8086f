//! Constrained acceleration at one state with MuJoCo's contact law: stages 1 to 5.

use stepper_real::{Mask, Real, kernel};
use stepper_solve::Outcome;
use stepper_solve::soft::Effort;

use crate::actuation::forces::{ForceState, Implicit};
use crate::collision::adhesion::set_adhesive_arms;
use crate::compile::{LaneModel, PathLengths};
use crate::constraints::VelocitySolution;
use crate::constraints::assembler::RowState;
use crate::constraints::row_builder::RowBuilder;
use crate::constraints::soft::{SoftAssembler, SoftInput, SoftSystem};
use crate::dynamics::kinematics::{advance, select_into};
use crate::dynamics::mocap;
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::evaluate::free_motion::FreeMotion;
use crate::integrators::evaluate::recomputed::Recomputed;
use crate::integrators::mujoco::implicit::add_along_tendons;
use crate::integrators::mujoco::workspace::StageState;
use crate::integrators::step_input::StepInput;
use crate::probe::{Counter, Probe, span};
use crate::stages::s01_actuate::actuate;
use crate::stages::s03_detect::detect;
use crate::tuning::LOOK_AHEAD;

/// Results and buffers of the constrained acceleration at one state.
pub(super) struct Acceleration<'a, R: Real> {
    pub(super) evaluation: &'a mut Evaluation<R>,
    pub(super) free: &'a mut FreeMotion<R>,
    pub(super) system: &'a mut SoftSystem<R>,
    pub(super) velocity: &'a mut VelocitySolution<R>,
    pub(super) builder: &'a mut RowBuilder<R>,
}

impl<R: Real> Acceleration<'_, R> {
    /// Computes the constrained acceleration at the state `stage` (stages 1 to 5 of the step), and stores it in `system`.
    ///
    /// With `from_impulse` the solver starts from the constraint impulse of the last step, otherwise from the acceleration of the previous
    /// call.
    #[inline(always)]
    pub(super) fn compute(&mut self, input: StepInput<'_, R>, stage: &StageState<R>, from_impulse: bool, probe: impl Probe) -> Outcome<R> {
        self.prepare(input, stage, Recomputed::Configuration, probe);
        span!(probe, Solve, || self.solve(input, from_impulse))
    }

    /// Computes stages 1 to 4, from forces to constraint rows, at the state `stage`. `recomputed` is the part of the state that changed
    /// since the last call.
    #[inline(always)]
    pub(super) fn prepare(&mut self, input: StepInput<'_, R>, stage: &StageState<R>, recomputed: Recomputed, probe: impl Probe) {
        let StepInput { compiled, state, inputs, .. } = input;
        let moved = recomputed == Recomputed::Configuration;
        self.evaluation.act.copy_from_slice(&stage.act);
        if moved {
            self.evaluation.q.copy_from_slice(&stage.q);
            span!(probe, Kinematics, || {
                let Evaluation { q, kinematics, .. } = &mut *self.evaluation;
                mocap::pose_bodies(compiled, &inputs.mocap_trajectories, |_| R::of(state.elapsed), kinematics);
                kinematics.update(compiled, q);
            });
            self.find_contacts(input, stage, probe);
        }
        self.free_acceleration(input, stage, recomputed, probe);
        // Friction losses of actuator dynamics bound the rows of dry friction.
        if recomputed != Recomputed::Forces || compiled.lossy {
            span!(probe, Assemble, || self.assemble(input, stage));
        }
    }

    /// Computes stages 1 and 2: forces, and acceleration and velocity without constraints. `recomputed` selects the parts that have
    /// changed.
    #[inline(always)]
    fn free_acceleration(&mut self, input: StepInput<'_, R>, stage: &StageState<R>, recomputed: Recomputed, probe: impl Probe) {
        probe.count(Counter::Evaluations, || 1.0);
        let compiled = input.compiled;
        if recomputed == Recomputed::Configuration {
            let explicit = Implicit::<R>::none().weights;
            span!(probe, MassMatrix, || {
                let (smooth, kinematics) = (&mut self.free.smooth, &self.evaluation.kinematics);
                smooth.assemble_mass(compiled, kinematics, explicit);
                add_along_tendons(compiled, &kinematics.paths, R::one(), |spring| spring.inertia, &mut smooth.mass.entries);
            });
        }
        span!(probe, Actuate, || self.compute_forces(input, stage));
        let Self { evaluation: Evaluation { kinematics, .. }, free, system, .. } = self;
        span!(probe, MassFactors, || {
            match recomputed {
                Recomputed::Configuration => system.mass.copy_from_slice(&free.smooth.mass.entries),
                // Stage 6 added its implicit terms to the entries of the mass matrix. This restores the entries.
                Recomputed::Velocity | Recomputed::Forces => free.smooth.mass.entries.copy_from_slice(&system.mass),
            }
            free.smooth.complete_mass(compiled, kinematics, Implicit::none());
        });
        span!(probe, Acceleration, || {
            free.accelerate(compiled, kinematics, &stage.v, &stage.v);
            advance(&stage.v, &free.smooth.acc, R::of(input.options.timestep), &mut free.v);
        });
    }

    /// Computes stage 1: all forces at the state `stage`, without implicit terms.
    #[inline(always)]
    fn compute_forces(&mut self, input: StepInput<'_, R>, stage: &StageState<R>) {
        let StepInput { compiled, options, inputs, .. } = input;
        let (free, Evaluation { kinematics, contacts, .. }) = (&mut *self.free, &*self.evaluation);
        free.touches.copy_from_slice(&kinematics.paths.touches);
        free.actuator_forces.reset_active_bounds();
        free.actuator_forces.transmit(compiled, (kinematics, &stage.q), (&stage.v, R::zero()));
        set_adhesive_arms(compiled, kinematics, contacts, free.actuator_forces.adhesive_arms());
        let numbers = [&stage.q[..], &stage.v, &stage.act];
        let forces = ForceState::state(numbers, R::of(options.timestep), &inputs.ctrl, &inputs.actuator_dynamics);
        actuate(compiled, &forces, None, &mut free.actuator_forces);
        if compiled.lossy {
            free.actuator_forces.compute_losses(compiled, &inputs.actuator_dynamics, &stage.v, None);
        }
        free.smooth.apply(compiled, kinematics, [&inputs.qfrc, &inputs.xfrc], &mut free.applied);
        add_tendon_springs(compiled, &kinematics.paths, &stage.q, &stage.v, &mut free.applied);
    }

    /// Computes stage 3: contacts at the configuration of `stage`. If the step is being differentiated, contacts that will close soon are
    /// found too.
    #[inline(always)]
    fn find_contacts(&mut self, input: StepInput<'_, R>, stage: &StageState<R>, probe: impl Probe) {
        let Evaluation { kinematics, collision, contacts, solved_overlaps, .. } = &mut *self.evaluation;
        let ahead = R::of(if solved_overlaps.is_some() { LOOK_AHEAD } else { 0.0 });
        detect(input.compiled, kinematics, [&stage.v; 2], [ahead, R::zero()], input.alive, collision, contacts, probe);
        span!(probe, WarmStart, || contacts.choose_tangents());
        probe.count(Counter::Contacts, || contacts.count[..R::LANES].iter().sum::<usize>() as f64);
    }

    /// Computes stage 4: assembles the rows of MuJoCo's contact law.
    #[inline(always)]
    fn assemble(&mut self, input: StepInput<'_, R>, stage: &StageState<R>) {
        let StepInput { compiled, inputs, alive, .. } = input;
        let Self { evaluation, free, system, builder, .. } = self;
        let Some(softness) = &compiled.softness else { return };
        let state = RowState {
            compiled,
            kinematics: &evaluation.kinematics,
            mass: &free.smooth.mass,
            q: &stage.q,
            v: &stage.v,
            motion: &free.smooth.newton_euler,
            v_free: &stage.v,
            losses: &free.actuator_forces.losses,
            active_equalities: &inputs.active_equalities,
            solved_overlaps: evaluation.solved_overlaps.as_deref(),
            alive,
        };
        SoftAssembler { input: SoftInput { state, softness }, builder, system }.assemble(&mut evaluation.contacts);
    }

    /// Computes stage 5: solves for the acceleration. The residual is the velocity that the remaining force imbalance would cause in a
    /// step, m/s.
    #[inline(always)]
    fn solve(&mut self, input: StepInput<'_, R>, from_impulse: bool) -> Outcome<R> {
        let StepInput { compiled, options, state, .. } = input;
        let Self { evaluation, free, system, velocity, .. } = self;
        let (h, constrained, smooth) = (R::of(options.timestep), system.constrained.any(), &free.smooth);
        let mut outcome = Outcome { residual: R::zero(), sweeps: R::zero(), newton_steps: R::zero() };
        if from_impulse && constrained {
            system.start_from_impulse(compiled, &smooth.mass, &smooth.acc, &state.impulse, h);
        }
        select_into(&mut system.acceleration, &smooth.acc, system.constrained.not());
        if constrained {
            let effort = Effort { steps: options.iterations, tolerance: R::of(options.tolerance) / h };
            let solved = system.solve(compiled, &smooth.mass, &smooth.acc, effort);
            (outcome.residual, outcome.newton_steps) = (solved.residual * h, solved.steps);
            if let Some(effort) = compiled.softness.as_ref().and_then(|softness| softness.noslip) {
                outcome.sweeps = system.remove_slip(compiled, &smooth.mass, &smooth.acc, effort, &evaluation.contacts);
            }
        }
        system.store_impulses(h, &mut evaluation.contacts, &mut velocity.scalar_impulse, &mut free.constraint_impulse);
        outcome
    }
}

/// Adds the forces of springs and dampers of tendons at the configuration `q` and the velocity `v` to the generalized forces
/// `forces`.
pub(crate) fn add_tendon_springs<R: Real>(compiled: &LaneModel<R>, paths: &PathLengths<R>, q: &[R], v: &[R], forces: &mut [R]) {
    kernel!(R, || {
        for tendon in &compiled.tendons {
            let Some((spring, stretch)) = tendon.stretch(q, paths) else { continue };
            let force = -(R::splat(spring.stiffness) * stretch) - R::splat(spring.damping) * tendon.length.rate(v, paths);
            tendon.length.for_each_arm(
                paths,
                #[inline(always)]
                |dof, arm| forces[dof] += arm * force,
            );
        }
    })
}
