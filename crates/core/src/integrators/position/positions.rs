//! Stages 7 and 8 of a step: the configuration after it, and its correction.

use stepper_real::{Mask, Real};

use crate::collision::tunnelling::{TestedMotion, may_have_passed};
use crate::constraints::{ConstraintProblem, PositionSolution, VelocitySolution};
use crate::dynamics::kinematics::select_into;
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::evaluate::free_motion::FreeMotion;
use crate::integrators::position::overlap_progress::revert_ineffective_corrections;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::probe::{Probe, span};
use crate::stages::s01_actuate::advance_activation;
use crate::stages::s07_integrate_position::integrate_position;
use crate::stages::s08_stabilise::{Infeasible, PositionInput, stabilise};

/// Computes stage 7: integrates positions from the evaluation point to the end of the step, with the velocity after the step. Also advances
/// the actuator activations over the whole step.
#[inline(always)]
pub(crate) fn integrate_positions<R: Real>(
    context: StepContext<'_, R>,
    velocity: &VelocitySolution<R>,
    position: &mut PositionSolution<R>,
    probe: impl Probe,
) {
    let StepContext { input: StepInput { compiled, state, inputs, .. }, evaluation: Evaluation { scheme, times, q, act, .. } } = context;
    span!(probe, IntegratePosition, || {
        integrate_position(compiled, q, &velocity.v, times, &mut position.q);
        advance_activation(compiled, &state.act, act, &inputs.ctrl, scheme.h, &mut position.act);
    });
}

/// Lanes whose positions stage 8 corrects, and lanes with infeasible constraints.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CorrectedLanes<R: Real> {
    /// Lanes with a position correction.
    all: R::Mask,
    /// Lanes of `all` in which a contact bounces in a flight without an end.
    rebounding: R::Mask,
    /// Lanes whose constraints are proven infeasible.
    pub(crate) infeasible: Infeasible<R>,
}

/// Computes stage 8: the configuration after the step with corrected position errors, in `position.q_corrected`. Returns the corrected
/// lanes. Impacts correct no positions.
#[inline(always)]
pub(crate) fn correct_positions<R: Real>(
    context: StepContext<'_, R>,
    free: &FreeMotion<R>,
    problem: &ConstraintProblem<R>,
    velocity: &mut VelocitySolution<R>,
    position: &mut PositionSolution<R>,
) -> CorrectedLanes<R> {
    let StepContext { input: StepInput { compiled, options, .. }, evaluation } = context;
    let lanes = problem.needs_position_solve.and_not(evaluation.substep.is_impact);
    if lanes.none() {
        return CorrectedLanes { all: lanes, rebounding: lanes, infeasible: Infeasible::none() };
    }
    position.copy_rows(problem);
    position.v_free.copy_from_slice(&free.v);
    let (contacts, h) = (&evaluation.contacts, evaluation.scheme.h);
    let rebounding = lanes.and(problem.impact_lanes());
    let rows = PositionInput { compiled, options, problem, mass: &free.smooth.mass, contacts, lanes, rebounding, h };
    let infeasible = stabilise(&rows, velocity, position);
    CorrectedLanes { all: lanes, rebounding, infeasible }
}

/// Lanes in which one geom may have passed through another (tunnelling check).
///
/// The check assumes motion at the velocity after the step, from the evaluation point of this step to that of the next one. A flight that
/// ends at an impact is checked to its end. After an impact, the check includes the motion from there to the evaluation point, at the
/// velocity before the flight. Impacts move nothing.
#[inline(always)]
pub(crate) fn find_tunnelling<R: Real>(
    input: StepInput<'_, R>,
    evaluation: &mut Evaluation<R>,
    velocity: &VelocitySolution<R>,
    position: &mut PositionSolution<R>,
    CorrectedLanes { rebounding, .. }: CorrectedLanes<R>,
    impulses_act: bool,
) -> R::Mask {
    let Evaluation { scheme, substep, times, kinematics, collision, .. } = evaluation;
    let PositionSolution { scratch: tested_velocity, correction, .. } = position;
    let flights = input.alive.and_not(substep.is_impact);
    // Without impulses and without a prediction, `velocity.v` is the free velocity with which stage 3 searched for contacts.
    let is_free = !impulses_act && !scheme.implicit_forces;
    // Very fast bodies are evaluated at the beginning of the flight.
    let before = R::select(times.lanes_at_start(), R::zero(), scheme.time_before);
    let time = R::select(substep.ends_at_impact, scheme.h - before, times.closing);
    let tested = if rebounding.none() {
        &velocity.v
    } else {
        // The corrected motion is not that of the rebound.
        let part = (scheme.h - scheme.time_before) / scheme.h;
        for (tested, (&v, &correction)) in tested_velocity.iter_mut().zip(velocity.v.iter().zip(&*correction)) {
            *tested = R::select(rebounding, v * part + correction, v);
        }
        &*tested_velocity
    };
    let motion = TestedMotion { velocity: tested, is_free, time, contacts_at_end: false };
    let passed = may_have_passed(input.compiled, kinematics, motion, flights, collision);
    let moved = substep.follows_impact.and(flights);
    if moved.none() {
        return passed;
    }
    let flight = TestedMotion { velocity: &input.state.v, is_free: false, time: before, contacts_at_end: true };
    passed.or(may_have_passed(input.compiled, kinematics, flight, moved, collision))
}

/// Replaces the configuration after the step by the corrected one in the corrected lanes. In infeasible lanes without a rebound, an island
/// keeps its uncorrected positions if the correction does not reduce its overlaps ([`revert_ineffective_corrections`]).
#[inline(always)]
pub(crate) fn accept_corrections<R: Real>(
    input: StepInput<'_, R>,
    evaluation: &mut Evaluation<R>,
    problem: &ConstraintProblem<R>,
    velocity: &mut VelocitySolution<R>,
    position: &mut PositionSolution<R>,
    corrected: CorrectedLanes<R>,
) {
    let CorrectedLanes { all, rebounding, infeasible } = corrected;
    if all.none() {
        return;
    }
    // Lanes with a rebound always keep their correction.
    let jammed = infeasible.lanes.and_not(rebounding);
    if jammed.any() {
        revert_ineffective_corrections(input, evaluation, problem, &mut velocity.islands, position, jammed);
    }
    select_into(&mut position.q, &position.q_corrected, all);
}
