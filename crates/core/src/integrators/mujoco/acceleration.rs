//! Constrained acceleration at one state: stages 1 to 5.

use stepper_real::{Mask, Real};
use stepper_solve::Outcome;
use stepper_solve::soft::Effort;

use crate::actuation::forces::{ForceState, Implicit};
use crate::compile::LaneModel;
use crate::constraints::assembler::{Assembler, AssemblyInput};
use crate::constraints::equality::RowInput;
use crate::constraints::soft::SoftInput;
use crate::dynamics::kinematics::advance;
use crate::dynamics::mocap;
use crate::integrators::mujoco::discrete::assemble_effective_mass;
use crate::integrators::recomputed::Recomputed;
use crate::integrators::workspace::Workspace;
use crate::options::{Integrator, StepSettings};
use crate::probe::{Counter, Probe, Span};
use crate::stages::s01_actuate::actuate;
use crate::stages::s03_detect::detect;
use crate::tuning::LOOK_AHEAD;

/// Computes the constrained acceleration at the state in `s.state` (stages 1 to 5) into the soft system.
///
/// The solve starts from the impulse of the last step, or from the previous acceleration.
pub(super) fn accelerate<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    h: R,
    s: &mut Workspace<R>,
    from_impulse: bool,
    probe: impl Probe,
) -> Outcome<R> {
    prepare(compiled, options, h, s, Recomputed::Configuration, probe);
    probe.span(Span::Solve, || solve(compiled, options, h, s, from_impulse))
}

/// Stages 1 to 4 at the state in `s.state`, as far as it has changed since the last call.
pub(super) fn prepare<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    h: R,
    s: &mut Workspace<R>,
    recomputed: Recomputed,
    probe: impl Probe,
) {
    s.evaluation.act.copy_from_slice(&s.state.act);
    if recomputed == Recomputed::Configuration {
        s.evaluation.q.copy_from_slice(&s.state.q);
        probe.span(Span::Kinematics, || {
            mocap::pose_bodies(compiled, &s.inputs.mocap_trajectories, R::of(s.state.elapsed), &mut s.evaluation.kinematics);
            s.evaluation.kinematics.update(compiled, &s.evaluation.q);
        });
    }
    match options.integrator {
        Integrator::Discrete => free_acceleration_at_end(compiled, h, s, probe),
        _ => free_acceleration(compiled, h, s, recomputed, probe),
    }
    if recomputed == Recomputed::Configuration {
        let ahead = if s.evaluation.solved_overlaps.is_some() { R::of(LOOK_AHEAD) } else { R::zero() };
        find_contacts(compiled, ahead, s, probe);
    }
    // Friction losses of actuator dynamics bound rows of dry friction.
    if recomputed != Recomputed::Forces || compiled.lossy {
        probe.span(Span::Assemble, || assemble(compiled, options, h, s));
    }
}

/// Stages 1 and 2: explicit forces, and the free acceleration.
fn free_acceleration<R: Real>(compiled: &LaneModel<R>, h: R, s: &mut Workspace<R>, recomputed: Recomputed, probe: impl Probe) {
    probe.count(Counter::Evaluations, || 1.0);
    let kinematics = &s.evaluation.kinematics;
    let motion = &mut s.free_motion;
    if recomputed == Recomputed::Configuration {
        probe.span(Span::MassMatrix, || motion.smooth.assemble_mass(compiled, kinematics, Implicit::<R>::none().weights));
    }
    if let Some(system) = &mut s.problem.soft {
        match recomputed {
            Recomputed::Configuration => system.mass.copy_from_slice(&motion.smooth.mass.entries),
            // Stage 6 adds implicit terms to the entries.
            Recomputed::Velocity | Recomputed::Forces => motion.smooth.mass.entries.copy_from_slice(&system.mass),
        }
    }
    probe.span(Span::MassFactors, || motion.smooth.complete_mass(compiled, kinematics, Implicit::none()));
    probe.span(Span::Actuate, || find_forces(compiled, s));
    probe.span(Span::Acceleration, || move_freely(compiled, h, s));
}

/// Free acceleration of a discrete step, with springs, dampers, servos and drag evaluated at the end of the step.
fn free_acceleration_at_end<R: Real>(compiled: &LaneModel<R>, h: R, s: &mut Workspace<R>, probe: impl Probe) {
    probe.count(Counter::Evaluations, || 1.0);
    let explicit = Implicit::<R>::none().weights;
    probe.span(Span::MassMatrix, || s.free_motion.smooth.assemble_mass(compiled, &s.evaluation.kinematics, explicit));
    probe.span(Span::Actuate, || find_forces(compiled, s));
    probe.span(Span::MassFactors, || assemble_effective_mass(compiled, h, s));
    probe.span(Span::Acceleration, || move_freely(compiled, h, s));
}

/// Stage 1: all forces at the state, explicit.
fn find_forces<R: Real>(compiled: &LaneModel<R>, s: &mut Workspace<R>) {
    let (motion, kinematics) = (&mut s.free_motion, &s.evaluation.kinematics);
    motion.actuator_forces.release();
    motion.actuator_forces.transmit(compiled, kinematics, &s.state.v, R::zero());
    let at = ForceState::state(&s.state.q, &s.state.v, &s.state.act, &s.inputs.ctrl, &s.inputs.actuator_dynamics);
    actuate(compiled, &at, None, &mut motion.actuator_forces);
    if compiled.lossy {
        motion.actuator_forces.dissipate(compiled, &s.inputs.actuator_dynamics, false);
    }
    motion.smooth.apply(compiled, kinematics, [&s.inputs.qfrc, &s.inputs.xfrc], &mut motion.applied);
    add_tendon_springs(compiled, &s.state.q, &s.state.v, &mut motion.applied);
}

/// Stage 2: free acceleration by the factored matrix, and the free velocity after the step.
fn move_freely<R: Real>(compiled: &LaneModel<R>, h: R, s: &mut Workspace<R>) {
    let motion = &mut s.free_motion;
    motion.accelerate(compiled, &s.evaluation.kinematics, &s.state.v, &s.state.v);
    advance(&s.state.v, &motion.smooth.acc, h, &mut motion.v);
}

/// Adds the explicit forces of springs and dampers of fixed tendons.
fn add_tendon_springs<R: Real>(compiled: &LaneModel<R>, q: &[R], v: &[R], forces: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
            for tendon in &compiled.tendons {
                let Some((spring, rest)) = &tendon.spring else { continue };
                let length = tendon.length.value(q);
                let stretch = length - length.max(R::splat(rest[0])).min(R::splat(rest[1]));
                let force = -(R::splat(spring.stiffness) * stretch) - R::splat(spring.damping) * tendon.length.rate(v);
                for &(_, dof, coefficient) in &tendon.length.terms {
                    forces[dof] += R::splat(coefficient) * force;
                }
            }
        },
    )
}

/// Stage 3: contacts at the configuration, and those that close within `ahead` s.
fn find_contacts<R: Real>(compiled: &LaneModel<R>, ahead: R, s: &mut Workspace<R>, probe: impl Probe) {
    let none = R::zero();
    let (kinematics, v) = (&s.evaluation.kinematics, &s.state.v);
    detect(compiled, kinematics, [v, v], [ahead, none], s.alive, &mut s.evaluation.poses, &mut s.evaluation.contacts, probe);
    probe.span(Span::WarmStart, || s.evaluation.contacts.choose_tangents());
    probe.count(Counter::Contacts, || s.evaluation.contacts.count[..R::LANES].iter().sum::<usize>() as f64);
}

/// Stage 4: assembles the soft rows.
fn assemble<R: Real>(compiled: &LaneModel<R>, options: &StepSettings, h: R, s: &mut Workspace<R>) {
    let Some(softness) = &compiled.softness else { return };
    let assembly = AssemblyInput {
        q: &s.state.q,
        v: &s.state.v,
        motion: &s.free_motion.smooth.newton_euler,
        v_free: &s.state.v,
        losses: &s.free_motion.actuator_forces.losses,
        h,
        time_before: R::zero(),
        in_the_middle: false,
        closing_fraction: R::one(),
        solved_overlaps: s.evaluation.solved_overlaps.as_deref(),
        alive: s.alive,
    };
    let row = RowInput { compiled, options, kinematics: &s.evaluation.kinematics, mass: &s.free_motion.smooth.mass, assembly: &assembly };
    let input = SoftInput { row, softness, effective: s.mujoco.effective.as_ref() };
    let mut assembler = Assembler { problem: &mut s.problem, velocity: &mut s.velocity, builder: &mut s.builder };
    assembler.assemble_soft(input, &mut s.evaluation.contacts);
}

/// Stage 5: solves the soft problem. The residual is the velocity that the remaining imbalance of forces causes in a step.
fn solve<R: Real>(compiled: &LaneModel<R>, options: &StepSettings, h: R, s: &mut Workspace<R>, from_impulse: bool) -> Outcome<R> {
    let constrained = s.problem.constrained;
    let mut outcome = Outcome { residual: R::zero(), sweeps: R::zero(), newton_steps: R::zero() };
    let (smooth, problem, contacts) = (&s.free_motion.smooth, &mut s.problem, &s.evaluation.contacts);
    if let Some(system) = &mut problem.soft {
        if from_impulse && constrained.any() {
            system.start_from_impulse(compiled, &smooth.mass, &smooth.acc, &s.state.impulse, h);
        }
        system.accelerate_freely(&smooth.acc, constrained);
        if constrained.any() {
            let effort = Effort { steps: options.iterations, tolerance: R::of(options.tolerance) / h };
            let solved = system.solve(compiled, &smooth.mass, &smooth.acc, effort, constrained);
            (outcome.residual, outcome.newton_steps) = (solved.residual * h, solved.steps);
        }
    }
    if let Some(effort) = compiled.softness.as_ref().and_then(|softness| softness.noslip).filter(|_| constrained.any()) {
        outcome.sweeps = problem.remove_slip(compiled, &smooth.mass, &smooth.acc, effort, contacts);
    }
    problem.store_soft_impulses(h, &mut s.evaluation.contacts, &mut s.velocity.scalar_impulse, &mut s.state.impulse);
    outcome
}
