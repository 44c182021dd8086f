//! Activation of deferred contacts, which the solver leaves out until the motion closes their gap.
//!
//! [`crate::constraints::approaching`] defines which contacts are deferred. The pairs that touch first are activated first, because their
//! impact may prevent later collisions. Example: a ball that lands on the floor does not hit the ledge behind its landing point.
//!
//! The impulses of the predicted motion are approximate, so that a body sinks a little into its supports. It then seems to collide with the
//! edge of the next support, although both supports have the same height. A predicted collision is doubtful if the error of the prediction
//! can cause its overlap. The contact of a doubtful collision is active only in the prediction. Stage 5 starts without it, and activates it
//! if the solved motion has the collision too.

use stepper_real::{Mask, Real};
use stepper_solve::residual;

use crate::constraints::{ConstraintProblem, VelocitySolution};
use crate::integrators::collision_search::{CollisionQuery, CollisionSearch};
use crate::integrators::evaluation::Evaluation;
use crate::integrators::free_motion::FreeMotion;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::stages::s05_solve::ImpulsePredictor;
use crate::tuning::{MAX_PREDICTIONS, PREDICTED_ERROR_RATIO, PREDICTED_MARGIN};

/// Motion of a step in which the collision search looks for colliding pairs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SweptMotion {
    /// Motion with the predicted impulses, before the solve.
    Predicted,
    /// Motion of the solver's solution. With `includes_later_collisions`, every colliding pair counts, even after an earlier collision of
    /// the same bodies.
    Solved { includes_later_collisions: bool },
}

/// Activates the deferred contacts that collide in the predicted motion, and repeats the prediction of the impulses with them.
#[inline(always)]
pub(crate) fn predict_collisions<R: Real>(
    context: StepContext<'_, R>,
    free: &FreeMotion<R>,
    problem: &mut ConstraintProblem<R>,
    velocity: &mut VelocitySolution<R>,
    collisions: &mut CollisionSearch<R>,
    (predictor, lanes): (&ImpulsePredictor<R>, R::Mask),
) {
    for _ in 0..MAX_PREDICTIONS {
        let colliding = activate_colliding(context, free, problem, velocity, collisions, SweptMotion::Predicted);
        if colliding.none() {
            return;
        }
        predictor.repeat(context.input.options, colliding.and(lanes), problem, velocity);
    }
}

/// Activates the deferred contacts whose pairs collide in the given motion, so that the solver includes their rows. Returns the lanes with
/// such a contact.
#[inline(always)]
pub(crate) fn activate_colliding<R: Real>(
    context: StepContext<'_, R>,
    free: &FreeMotion<R>,
    problem: &mut ConstraintProblem<R>,
    velocity: &mut VelocitySolution<R>,
    collisions: &mut CollisionSearch<R>,
    motion: SweptMotion,
) -> R::Mask {
    let StepContext { input: StepInput { compiled, options, alive, .. }, evaluation: Evaluation { kinematics, contacts, collision, .. } } =
        context;
    if problem.deferred_lanes(alive).none() {
        return R::Mask::splat(false);
    }
    let (margin, error, includes_later_collisions) = match motion {
        SweptMotion::Predicted => (PREDICTED_MARGIN, overlap_error(problem, velocity), false),
        SweptMotion::Solved { includes_later_collisions } => (0.0, R::zero(), includes_later_collisions),
    };
    let query =
        CollisionQuery { compiled, kinematics, collision, contacts, options, lanes: alive, margin, error, includes_later_collisions };
    if !collisions.list_candidates(&query, problem, &velocity.impulses.w) {
        return R::Mask::splat(false);
    }
    // The solved motion has the velocity `velocity.v`. The predicted motion has the free velocity plus the change by predicted impulses.
    if motion == SweptMotion::Predicted {
        velocity.velocity_after(compiled, &free.smooth.mass, &free.v, &mut collisions.v_predicted);
    }
    let colliding = collisions.find(&query, motion == SweptMotion::Predicted, &velocity.v, problem);
    if colliding.any() {
        problem.activate(velocity, contacts, colliding, |pair| collisions.lanes_of(pair));
    }
    colliding
}

/// Overlap that the error of the predicted impulses may cause on a path, m: the residual times the closing time times a factor.
fn overlap_error<R: Real>(problem: &ConstraintProblem<R>, velocity: &VelocitySolution<R>) -> R {
    R::vectorize(
        #[inline(always)]
        || residual(&problem.rows, &velocity.impulses) * problem.closing_time * R::of(PREDICTED_ERROR_RATIO),
    )
}
