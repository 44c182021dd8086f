//! Search for the end of a flight and for the evaluation point of each mechanism, and computation of stages 1 to 3 there. The evaluation
//! point is the time in the step at which forces, contacts and rows are evaluated.

use stepper_real::{Mask, Real};

use crate::constraints::contact::restitution::any_elastic;
use crate::dynamics::kinematics::displace;
use crate::dynamics::mocap;
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::evaluate::first_impact::end_at_first_impacts;
use crate::integrators::evaluate::free_motion::{FreeMotion, advance_activations, compute_free_motion, transmit};
use crate::integrators::step_input::{StepContext, StepInput};
use crate::probe::{Probe, span};
use crate::stages::s03_detect::detect;

/// Finds the evaluation point of each mechanism (a time within the substep), and computes stages 1 to 3 there: forces, free velocity and
/// contacts.
///
/// With Euler's rule and the implicit rule, the point is the beginning of the substep, with the midpoint rule its middle. The midpoint rule
/// has an exception. A very fast body could pass through a thin geom before the middle, so its mechanism is evaluated at the beginning,
/// with those in contact with it. A flight ends at the first elastic impact of its lane. An impact is evaluated at its configuration.
///
/// The loop ends: mechanisms move to the beginning and never back, and the search for impacts makes at most
/// [`MAX_FLIGHT_CHANGES`](crate::tuning::MAX_FLIGHT_CHANGES) changes and one evaluation after them.
#[inline(always)]
pub(crate) fn locate<R: Real>(input: StepInput<'_, R>, evaluation: &mut Evaluation<R>, free: &mut FreeMotion<R>, probe: impl Probe) {
    evaluation.place(input.options, evaluation.substep.longest);
    let mut changes = 0;
    loop {
        let unreliable = evaluate(input, evaluation, free, probe);
        // A very fast body may be beyond a thin geom in the middle of the step. At the beginning, the geom is still ahead.
        let Evaluation { scheme, times, collision, contacts, substep, .. } = &mut *evaluation;
        let may_move = scheme.in_the_middle && (unreliable.any() || times.moved);
        if may_move && times.move_to_start(input.compiled, contacts, &collision.unreliable) {
            continue;
        }
        // Newton's method for the time of the first elastic impact: each change of the flight requires new forces and contacts.
        let searches = any_elastic(contacts) || substep.ends_at_impact.or(substep.is_searched).any();
        if !searches || !span!(probe, ImpactTimes, || end_at_first_impacts(input, evaluation, &free.v, changes)) {
            return;
        }
        changes += 1;
    }
}

/// Computes stages 1 to 3 (forces, free velocity, contacts) at the current evaluation points. Returns the lanes whose contacts are
/// unreliable, because geoms may have passed through each other before their evaluation point.
#[inline(always)]
fn evaluate<R: Real>(input: StepInput<'_, R>, evaluation: &mut Evaluation<R>, free: &mut FreeMotion<R>, probe: impl Probe) -> R::Mask {
    place_bodies(input, evaluation, free, probe);
    // A step that is evaluated for derivatives (it has `solved_overlaps`) keeps the active bounds of servos from the solution that is
    // differentiated.
    if evaluation.solved_overlaps.is_none() {
        free.actuator_forces.reset_active_bounds();
    }
    compute_free_motion(StepContext { input, evaluation }, free, probe);
    let unreliable = find_contacts(input, evaluation, free, probe);
    if input.compiled.adhesion.is_none() {
        return unreliable;
    }
    // Actuators pull on the contacts that were found. Their forces change the free velocity, which decides what other contacts are near.
    transmit(input, evaluation, free, true);
    free.actuator_forces.reset_active_bounds();
    compute_free_motion(StepContext { input, evaluation }, free, probe);
    find_contacts(input, evaluation, free, probe)
}

/// Computes stage 3: contacts at the evaluation points. Returns the lanes whose contacts are unreliable.
#[inline(always)]
fn find_contacts<R: Real>(input: StepInput<'_, R>, evaluation: &mut Evaluation<R>, free: &FreeMotion<R>, probe: impl Probe) -> R::Mask {
    let Evaluation { scheme, substep, kinematics, collision, contacts, .. } = evaluation;
    let StepInput { compiled, state, alive, .. } = input;
    // Contacts are near if they may touch within the longest flight.
    let times = [substep.longest, scheme.time_before];
    let unreliable = detect(compiled, kinematics, [&state.v, &free.v], times, alive, collision, contacts, probe);
    let impacts = substep.is_impact.and(alive);
    if impacts.any() {
        contacts.keep_touching(impacts, R::of(input.options.slop));
    }
    unreliable
}

/// Computes configuration, activations, poses, and moment arms of actuators at the evaluation points. With the implicit rule, also computes
/// the later configuration at which springs and servos are evaluated.
#[inline(always)]
fn place_bodies<R: Real>(input: StepInput<'_, R>, evaluation: &mut Evaluation<R>, free: &mut FreeMotion<R>, probe: impl Probe) {
    let StepInput { compiled, state, inputs, .. } = input;
    span!(probe, Displace, || {
        // Positions move at the velocity before the step.
        if evaluation.scheme.in_the_middle {
            evaluation.times.displace_before(compiled, &state.q, &state.v, &mut evaluation.q);
        } else {
            evaluation.q.copy_from_slice(&state.q);
        }
        advance_activations(input, evaluation);
        let scheme = evaluation.scheme;
        if scheme.looks_ahead() {
            displace(compiled, &evaluation.q, &state.v, scheme.time_ahead, &mut evaluation.q_ahead);
        }
    });
    let Evaluation { times, q, kinematics, substep, .. } = &mut *evaluation;
    span!(probe, Kinematics, || {
        let time_of = |mocap: usize| R::of(state.elapsed) + substep.offset + times.before(compiled.mechanisms.of_mocap[mocap]);
        mocap::pose_bodies(compiled, &inputs.mocap_trajectories, time_of, kinematics);
        kinematics.update(compiled, q);
    });
    span!(probe, Actuate, || transmit(input, evaluation, free, false));
}
