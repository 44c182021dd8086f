//! Stages 7 and 8 of a step: the configuration after it, and its correction.

use stepper_real::{Mask, Real, kernel};

use crate::collision::tunnelling::{TestedMotion, may_have_passed};
use crate::constraints::{ConstraintProblem, PositionSolution, VelocitySolution};
use crate::integrators::evaluation::Evaluation;
use crate::integrators::free_motion::FreeMotion;
use crate::integrators::impact::prepare_position_solve;
use crate::integrators::overlap_progress::revert_ineffective_corrections;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::integrators::step_outcome::StepOutcome;
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

/// Lanes whose positions stage 8 corrects, lanes in which a contact bounces, and lanes with infeasible constraints.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CorrectedLanes<R: Real> {
    /// Lanes with a position correction.
    all: R::Mask,
    /// Lanes in which a contact bounces. Their corrected position is the one after the rebound.
    rebounding: R::Mask,
    /// Lanes whose constraints are proven infeasible.
    pub(crate) infeasible: Infeasible<R>,
}

/// Computes stage 8: the configuration after the step with corrected position errors, in `position.q_corrected`. Returns the corrected
/// lanes.
#[inline(always)]
pub(crate) fn correct_positions<R: Real>(
    context: StepContext<'_, R>,
    free: &FreeMotion<R>,
    problem: &ConstraintProblem<R>,
    velocity: &mut VelocitySolution<R>,
    position: &mut PositionSolution<R>,
) -> CorrectedLanes<R> {
    let StepContext { input: StepInput { compiled, options, .. }, evaluation } = context;
    let impacts = prepare_position_solve(context, free, problem, &mut velocity.impulses, position);
    let (lanes, rebounding) = (problem.needs_position_solve.or(impacts), problem.rebounding_at_step_end.or(impacts));
    if lanes.none() {
        return CorrectedLanes { all: lanes, rebounding, infeasible: Infeasible::none() };
    }
    let (contacts, h) = (&evaluation.contacts, evaluation.scheme.h);
    let rows = PositionInput { compiled, options, problem, mass: &free.smooth.mass, contacts, lanes, rebounding, h };
    let infeasible = stabilise(&rows, velocity, position);
    CorrectedLanes { all: lanes, rebounding, infeasible }
}

/// Lanes in which one geom may have passed through another (tunnelling check).
///
/// The check assumes motion at a constant velocity from the evaluation point. Usually this is the velocity after the step. In lanes with a
/// rebound, it is a fraction of that velocity plus the velocity of the position correction. The fraction is the part of the step after the
/// evaluation point. If an impact moved the evaluation point, the check includes the motion before it, at the velocity before the step.
#[inline(always)]
pub(crate) fn find_tunnelling<R: Real>(
    input: StepInput<'_, R>,
    evaluation: &mut Evaluation<R>,
    velocity: &VelocitySolution<R>,
    position: &mut PositionSolution<R>,
    corrected: CorrectedLanes<R>,
    outcome: &StepOutcome<R>,
) -> R::Mask {
    let Evaluation { scheme, times, kinematics, collision, .. } = evaluation;
    let PositionSolution { tested_velocity, correction, .. } = position;
    // Without impulses and without a prediction, `velocity.v` is the free velocity with which stage 3 searched for contacts.
    let is_free = !outcome.impulses_act && !scheme.predicts();
    let rebounding = corrected.all.and(corrected.rebounding);
    // Velocity of the tested motion, in each lane.
    let v = if rebounding.none() {
        &velocity.v
    } else {
        for (dof, (tested, (&v, &correction))) in tested_velocity.iter_mut().zip(velocity.v.iter().zip(&*correction)).enumerate() {
            let part = times.after(input.compiled.mechanism_of(dof)) / scheme.h;
            *tested = R::select(rebounding, v * part + correction, v);
        }
        &*tested_velocity
    };
    let motion = TestedMotion { velocity: v, is_free, time: scheme.h, contacts_at_end: false };
    let passed = may_have_passed(input.compiled, kinematics, motion, input.alive, collision);
    // Each step checks the path from its evaluation point to that of the next step. If an impact moved the evaluation point of this step,
    // the path from the beginning of the step to this point is checked here.
    let (impact_lanes, latest) = times.latest_impact();
    let moved = impact_lanes.and(input.alive).and(latest.gt(R::zero()));
    if moved.none() {
        return passed;
    }
    let flight = TestedMotion { velocity: &input.state.v, is_free: false, time: latest, contacts_at_end: true };
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
    kernel!(R, || {
        for (q, &corrected) in position.q.iter_mut().zip(&position.q_corrected) {
            *q = R::select(all, corrected, *q);
        }
    });
}
