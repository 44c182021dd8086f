//! One step of a group of environments: the sequence of its ten stages.

use stepper_real::{Mask, Real, kernel};

use crate::compile::LaneModel;
use crate::integrators::acceptance::accept;
use crate::integrators::devices::{ActuatorDevices, Devices};
use crate::integrators::evaluate::evaluation::Substep;
use crate::integrators::evaluate::locate::locate;
use crate::integrators::mujoco;
use crate::integrators::observation::observe;
use crate::integrators::position::positions::{accept_corrections, correct_positions, find_tunnelling, integrate_positions};
use crate::integrators::step_input::{StepContext, StepInput};
use crate::integrators::step_outcome::{StepOutcome, record};
use crate::integrators::substeps::step_in_parts;
use crate::integrators::velocity::velocity_loop::VelocityLoop;
use crate::integrators::workspace::Workspace;
use crate::options::{ContactLaw, StepSettings};
use crate::probe::{Counter, Probe, span};
use crate::stages::s05_solve::{share_sticking_loads, store_impulses};
use crate::stages::s10_record::Record;

/// Advances a group of environments by `options.timestep` seconds, and returns the record of the step. The workspace `s` has the state and
/// the inputs, and receives the next state.
///
/// The order is: stages 1 to 8, acceptance of the next state, stage 10, stage 9. With hard contact, loops in `locate` and
/// `solve_velocities` repeat some of stages 1 to 6. With MuJoCo's law, its Runge-Kutta method makes stages 1 to 5 four times. A step with an
/// elastic impact, or one that keeps an error, repeats stages 1 to 8 and 10 for each of its parts (`step_in_parts`).
///
/// The stages call kernels: functions that are compiled once for every lane type and CPU level. This function is a kernel too, because it
/// has lane masks, which are vectors. Outside a kernel every operation on a vector is a function call.
pub fn step<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    devices: &mut Devices<'_, R::Scalar>,
    probe: impl Probe,
) -> Record<R> {
    kernel!(R, || {
        probe.count(Counter::GroupSteps, || 1.0);
        if options.poison {
            s.poison();
        }
        // The narrow phase starts from the separating planes that it found in the last step.
        s.evaluation.collision.narrow_phase.begin_step();
        // 1 actuate, first part: the actuator pipelines (delay, lag ...) convert the user's controls.
        span!(probe, ActuatorPipelines, || {
            if let Some(ActuatorDevices { pipelines, memory }) = &mut devices.actuators {
                let Workspace { state, user_controls, inputs, alive, .. } = s;
                let (state, outputs) = ([&state.q[..], &state.v[..]], (&mut inputs.ctrl[..], &mut inputs.actuator_dynamics[..]));
                pipelines.advance(compiled, devices.group, user_controls, state, *alive, options.timestep, memory, outputs);
            }
        });
        s.evaluation.substep = Substep::whole(options);
        s.evaluation.divided = R::Mask::splat(false);
        if let Some(buffers) = &mut s.substep_buffers {
            buffers.was_used = false;
        }
        let solved = match options.contact {
            ContactLaw::Hard => options.error.is_none().then(|| solve_step(compiled, options, s, probe)),
            // Stages 1 to 7 with MuJoCo's contact law. The law has no stage 8, because it includes overlaps and errors of closed loops.
            ContactLaw::Mujoco => Some(mujoco::solve_step(compiled, options, s, probe)),
        };
        let Some(outcome) = solved.filter(|_| s.evaluation.substep.ends_at_impact.none()) else {
            // Stages 1 to 8 and 10 in parts, because an impact ends the first flight, or to keep an error. Stage 9 follows.
            let record = step_in_parts(compiled, options, s, solved, |s, solved| make_part(compiled, options, s, solved, probe));
            span!(probe, Sense, || sense_state(compiled, options, s, devices));
            return record;
        };
        let accepted = span!(probe, Accept, || accept(compiled, s, options.timestep));
        // 10 record, before stage 9: sensors read the contacts that the state keeps.
        let Workspace { state, inputs, evaluation, free_motion, problem, velocity, alive, .. } = s;
        let input = StepInput { compiled, options, state, inputs, alive: *alive };
        let end = (R::of(state.elapsed), &mut evaluation.kinematics);
        let record = span!(probe, Record, || record(input, end, free_motion, problem, velocity, &outcome, accepted));
        // Contacts that are still deferred (left out by the solver) are not stored for the next step: their gap seemed to close, but
        // their geoms passed each other without touching. `solve_velocities` has activated those whose gap stays open, which the state
        // keeps.
        problem.remove_deferred(&mut state.contacts, accepted.finite);
        // 9 sense
        span!(probe, Sense, || sense_state(compiled, options, s, devices));
        record
    })
}

/// Executes stage 9: sensors and actuator pipelines at the state after the step.
#[inline(always)]
fn sense_state<R: Real>(compiled: &LaneModel<R>, options: &StepSettings, s: &mut Workspace<R>, devices: &mut Devices<'_, R::Scalar>) {
    let Workspace { state, inputs, evaluation, velocity, sensors, alive, .. } = s;
    if let Some(ActuatorDevices { pipelines, memory }) = &mut devices.actuators {
        // Sensors and derived quantities of the new state read the outputs of the pipelines at the end of the step.
        pipelines.write_outputs_after_step(compiled, devices.group, memory, (&mut inputs.ctrl, &mut inputs.actuator_dynamics));
    }
    let input = StepInput { compiled, options, state, inputs, alive: *alive };
    observe(input, velocity, &mut evaluation.kinematics, sensors, devices);
}

/// Makes the part of a step in `s.evaluation.substep`. Returns its record, and the lanes (bits) that keep their whole state. The time of
/// the state does not advance. If stages 1 to 8 are made already, `solved` is their outcome.
#[inline(never)]
fn make_part<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    solved: Option<StepOutcome<R>>,
    probe: impl Probe,
) -> (Record<R>, u32) {
    kernel!(R, || {
        let outcome = solved.unwrap_or_else(
            #[inline(always)]
            || solve_step(compiled, options, s, probe),
        );
        let accepted = span!(probe, Accept, || accept(compiled, s, 0.0));
        let Workspace { state, inputs, evaluation, free_motion, problem, velocity, alive, .. } = s;
        let (substep, length) = (&evaluation.substep, R::select(evaluation.substep.is_impact, R::zero(), evaluation.scheme.h));
        let end = (R::of(state.elapsed) + substep.offset + length, &mut evaluation.kinematics);
        let input = StepInput { compiled, options, state, inputs, alive: *alive };
        let record = span!(probe, Record, || record(input, end, free_motion, problem, velocity, &outcome, accepted));
        problem.remove_deferred(&mut state.contacts, accepted.finite);
        (Record { substeps: R::one(), ..record }, accepted.kept)
    })
}

/// Executes stages 1 to 8 of a step, or of a part of it, with hard contact: from actuator forces to corrected positions.
///
/// The function is compiled separately, because `step` and `make_part` call it.
#[inline(never)]
fn solve_step<R: Real>(compiled: &LaneModel<R>, options: &StepSettings, s: &mut Workspace<R>, probe: impl Probe) -> StepOutcome<R> {
    kernel!(R, || solve_stages(compiled, options, s, probe))
}

#[inline(always)]
fn solve_stages<R: Real>(compiled: &LaneModel<R>, options: &StepSettings, s: &mut Workspace<R>, probe: impl Probe) -> StepOutcome<R> {
    let Workspace { state, inputs, evaluation, free_motion: free, problem, builder, velocity, position, .. } = s;
    let (collisions, step_resolution, alive) = (&mut s.collisions, &mut s.step_resolution, s.alive);
    // 1 actuate, 2 smooth dynamics, 3 detect, at the evaluation point of the step. A loop in `locate` moves this point in lanes with fast
    // bodies or impacts.
    locate(StepInput { compiled, options, state, inputs, alive }, evaluation, free, probe);
    span!(probe, WarmStart, || evaluation.match_contacts(compiled, &mut state.contacts));
    probe.count(Counter::Contacts, || evaluation.contacts.count[..R::LANES].iter().sum::<usize>() as f64);
    let input = StepInput { compiled, options, state, inputs, alive };
    let context = StepContext { input, evaluation };
    // 4 assemble, 5 solve, 6 integrate velocity. A loop in `solve_velocities` repeats stages 5 and 6, and sometimes stage 4, until the
    // solution satisfies the assumptions of the assembly or a limit is reached. After an assembly, stages 1 and 2 recompute the forces that
    // depend on the predicted velocity. With Euler's rule there is no prediction.
    let mut velocity_loop = VelocityLoop { context, free, problem, velocity, builder, collisions };
    let (solver, doubtful) = velocity_loop.solve_velocities(probe);
    let impulses_act = velocity_loop.velocity.impulses.changes_velocity();
    // Velocities are limited in islands whose motion is too fast for the time step or whose kinetic energy the solver's residual may change
    // noticeably (ambiguous energy).
    let [ambiguous, limited] = span!(probe, GuardEnergy, || velocity_loop.limit_speed(step_resolution, solver.residual));
    // With the Runge-Kutta method, the energy of smooth trees is not checked here: stage 7 replaces their solution.
    if let Some(rk4) = &mut s.rk4 {
        rk4.find_smooth_trees(context, problem, free);
    }
    let replaced = |mechanism: usize| s.rk4.as_ref().map_or(R::Mask::splat(false), |rk4| rk4.is_smooth(compiled, mechanism));
    let energy_unresolved = span!(probe, GuardEnergy, || step_resolution.find_energy_gain(context, free, velocity, replaced)).or(doubtful);
    if options.poison {
        free.scratch.poison();
        collisions.poison();
    }
    // 7 integrate position. Smooth trees get velocity and position of the Runge-Kutta method.
    integrate_positions(StepContext { input, evaluation }, velocity, position, probe);
    if let Some(rk4) = &mut s.rk4 {
        span!(probe, Rk4, || rk4.replace_smooth_trees(StepContext { input, evaluation }, free, velocity, position));
    }
    // The impulses of the step are stored here, because stage 8 solves again and overwrites them.
    span!(probe, IntegrateVelocity, || {
        share_sticking_loads(options, &state.v, problem, velocity);
        store_impulses(problem, velocity, &mut evaluation.contacts);
        free.constraint_impulse.copy_from_slice(&velocity.impulses.w);
        free.smooth.mass.momentum(compiled, &mut free.constraint_impulse);
    });
    // 8 stabilise
    let corrected = span!(probe, Stabilise, || correct_positions(StepContext { input, evaluation }, free, problem, velocity, position));
    let tunnelled = span!(probe, Tunnelling, || find_tunnelling(input, evaluation, velocity, position, corrected, impulses_act));
    span!(probe, Stabilise, || accept_corrections(input, evaluation, problem, velocity, position, corrected));
    if options.poison {
        velocity.poison_impulses();
    }
    let context = StepContext { input, evaluation };
    span!(probe, GuardEnergy, || step_resolution.limit_energy(context, problem, &free.v, velocity, &position.q, limited));
    // The generalized impulse of this step replaces that of the last step, which `compute_free_motion` has read.
    std::mem::swap(&mut state.impulse, &mut free.constraint_impulse);
    StepOutcome { solver, ambiguous, infeasible: corrected.infeasible, tunnelled, energy_unresolved }
}
