//! Search for the evaluation point of a step, and computation of stages 1 to 3 at this point. The evaluation point is the time in the step
//! at which forces, contacts and rows are evaluated.

use stepper_real::{Mask, Real};

use crate::constraints::restitution::any_elastic;
use crate::dynamics::kinematics::displace;
use crate::dynamics::mocap;
use crate::integrators::evaluation::Evaluation;
use crate::integrators::free_motion::{FreeMotion, advance_activations, compute_free_motion};
use crate::integrators::impact::move_to_first_impacts;
use crate::integrators::scheme::Scheme;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::probe::{Probe, span};
use crate::stages::s03_detect::detect;
use crate::tuning::MAX_EVALUATION_MOVES;

/// Finds the evaluation point of the step (a time within the step), and computes stages 1 to 3 at it: forces, free velocity and contacts.
///
/// With Euler's rule and the implicit rule, the point is the beginning of the step, with the midpoint rule its middle. The midpoint rule
/// has two exceptions. A very fast body could pass through a thin geom before the middle, so its lane is evaluated at the beginning. A lane
/// with an elastic impact is evaluated at the time of its first impact.
#[inline(always)]
pub(crate) fn locate<R: Real>(input: StepInput<'_, R>, evaluation: &mut Evaluation<R>, free: &mut FreeMotion<R>, probe: impl Probe) {
    evaluation.scheme = Scheme::new(input.options);
    evaluation.at_start = R::Mask::splat(false);
    evaluation.impact_lanes = R::Mask::splat(false);
    let unreliable = evaluate(input, evaluation, free, probe);
    // A very fast body may be beyond a thin geom in the middle of the step. At the beginning, the geom is still ahead.
    if unreliable.any() {
        evaluation.at_start = unreliable;
        evaluation.scheme.move_to(R::zero(), unreliable);
        evaluate(input, evaluation, free, probe);
    }
    if !evaluation.scheme.in_the_middle {
        return;
    }
    // Newton's method for the time of the first elastic impact: each move of the evaluation point requires new forces and contacts.
    for pass in 0..MAX_EVALUATION_MOVES {
        if !any_elastic(&evaluation.contacts) {
            return;
        }
        let moved = span!(probe, ImpactTimes, || move_to_first_impacts(input, evaluation, &free.v, pass == 0));
        if moved.none() {
            return;
        }
        evaluate(input, evaluation, free, probe);
    }
}

/// Computes stages 1 to 3 (forces, free velocity, contacts) at the current evaluation point. Returns the lanes whose contacts are
/// unreliable, because geoms may have passed through each other before this point.
#[inline(always)]
fn evaluate<R: Real>(input: StepInput<'_, R>, evaluation: &mut Evaluation<R>, free: &mut FreeMotion<R>, probe: impl Probe) -> R::Mask {
    place_bodies(input, evaluation, free, probe);
    // A step that is evaluated for derivatives (it has `solved_overlaps`) keeps the active bounds of servos from the solution that is
    // differentiated.
    if evaluation.solved_overlaps.is_none() {
        free.actuator_forces.reset_active_bounds();
    }
    compute_free_motion(StepContext { input, evaluation }, free, probe);
    let Evaluation { scheme, kinematics, collision, contacts, .. } = evaluation;
    let StepInput { compiled, state, alive, .. } = input;
    detect(compiled, kinematics, [&state.v, &free.v], [scheme.h, scheme.time_before], alive, collision, contacts, probe)
}

/// Computes configuration, activations, poses, and moment arms of actuators at the evaluation point. With the implicit rule, also computes
/// the later configuration at which springs and servos are evaluated.
#[inline(always)]
fn place_bodies<R: Real>(input: StepInput<'_, R>, evaluation: &mut Evaluation<R>, free: &mut FreeMotion<R>, probe: impl Probe) {
    let StepInput { compiled, state, inputs, .. } = input;
    span!(probe, Displace, || {
        let scheme = evaluation.scheme;
        // Positions move at the velocity before the step.
        if scheme.in_the_middle {
            displace(compiled, &state.q, &state.v, scheme.time_before, &mut evaluation.q);
        } else {
            evaluation.q.copy_from_slice(&state.q);
        }
        advance_activations(input, evaluation);
        if scheme.looks_ahead() {
            displace(compiled, &evaluation.q, &state.v, scheme.time_ahead, &mut evaluation.q_ahead);
        }
    });
    let Evaluation { scheme, q, kinematics, .. } = evaluation;
    span!(probe, Kinematics, || {
        mocap::pose_bodies(compiled, &inputs.mocap_trajectories, R::of(state.elapsed) + scheme.time_before, kinematics);
        kinematics.update(compiled, q);
    });
    span!(probe, Actuate, || free.actuator_forces.transmit(compiled, kinematics, &state.v, scheme.time_ahead));
}
