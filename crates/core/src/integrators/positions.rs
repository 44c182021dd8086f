//! Stages 7 and 8: the configuration after the step.

use stepper_real::{Mask, Real};

use crate::collision::tunnelling::{TakenStep, may_have_passed};
use crate::constraints::{ConstraintProblem, PositionSolution, VelocitySolution};
use crate::integrators::impact::prepare_position_solve;
use crate::integrators::overlap_progress::revert_ineffective_corrections;
use crate::integrators::step_outcome::StepOutcome;
use crate::integrators::step_values::{Evaluation, FreeMotion, Place, StepInput};
use crate::probe::{Probe, Span};
use crate::stages::s01_actuate::advance_activation;
use crate::stages::s07_integrate_position::integrate_position;
use crate::stages::s08_stabilise::{PositionInput, stabilise};

/// Stage 7, with actuator activations.
#[inline(always)]
pub(crate) fn integrate_positions<R: Real>(
    place: Place<'_, R>,
    velocity: &VelocitySolution<R>,
    position: &mut PositionSolution<R>,
    probe: impl Probe,
) {
    let Place { input: StepInput { compiled, state, inputs, .. }, evaluation: Evaluation { scheme, q, act, .. } } = place;
    probe.span(Span::IntegratePosition, || {
        integrate_position(compiled, q, &velocity.v, scheme.time_after, &mut position.q);
        advance_activation(compiled, &state.act, act, &inputs.ctrl, scheme.h, &mut position.act);
    });
}

/// Lanes in which a geom may have passed through a thin one.
#[inline(always)]
pub(crate) fn find_tunnelling<R: Real>(
    input: StepInput<'_, R>,
    evaluation: &mut Evaluation<R>,
    velocity: &VelocitySolution<R>,
    outcome: &StepOutcome<R>,
) -> R::Mask {
    let Evaluation { scheme, kinematics, poses, .. } = evaluation;
    let is_free = !outcome.impulses_act && !scheme.corrects;
    let step = TakenStep { velocity: &velocity.v, is_free, h: scheme.h, contacts_at_end: false };
    may_have_passed(input.compiled, kinematics, step, input.alive, poses)
}

/// Stage 8: corrects the positions after the step, and returns the lanes that are proven infeasible.
///
/// The solve starts from the impulses of the velocity solution and overwrites them.
#[inline(always)]
pub(crate) fn correct_positions<R: Real>(
    input: StepInput<'_, R>,
    evaluation: &mut Evaluation<R>,
    free: &FreeMotion<R>,
    problem: &ConstraintProblem<R>,
    velocity: &mut VelocitySolution<R>,
    position: &mut PositionSolution<R>,
) -> R::Mask {
    let impacts = prepare_position_solve(Place { input, evaluation }, free, problem, &mut velocity.impulses, position);
    let (lanes, rebounding) = (problem.needs_position_solve.or(impacts), problem.rebounding.or(impacts));
    if lanes.none() {
        return lanes;
    }
    let (contacts, h) = (&evaluation.contacts, evaluation.scheme.h);
    let rows = PositionInput { problem, mass: &free.smooth.mass, contacts, lanes, rebounding, h };
    let infeasible = stabilise(input.compiled, input.options, &rows, velocity, position);
    // Bouncing contacts keep their correction: it leads to the position after the rebound.
    let jammed = infeasible.and_not(rebounding);
    if jammed.any() {
        revert_ineffective_corrections(input, evaluation, problem, position, jammed);
    }
    R::vectorize(
        #[inline(always)]
        || {
            for (q, &corrected) in position.q.iter_mut().zip(&position.q_corrected) {
                *q = R::select(lanes, corrected, *q);
            }
        },
    );
    infeasible
}
