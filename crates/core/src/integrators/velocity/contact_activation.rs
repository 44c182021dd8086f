//! Activation of deferred contacts, which the solver leaves out until their geoms collide in the predicted or solved motion.
//!
//! [`crate::constraints::contact::approaching`] defines which contacts are deferred. The pairs that touch first are activated first,
//! because their impact may prevent later collisions. Example: a ball that lands on the floor does not hit the ledge behind its landing
//! point.
//!
//! The impulses of the predicted motion are approximate, so that a body sinks a little into its supports. It then seems to collide with the
//! edge of the next support, although both supports have the same height. A predicted collision is doubtful if the error of the prediction
//! can cause its overlap. The contact of a doubtful collision is active only in the prediction. It is deferred again for the solve, and
//! activated if the solved motion has the collision too.

use stepper_real::{Mask, Real, kernel};
use stepper_solve::residual;

use crate::integrators::step_input::StepContext;
use crate::integrators::velocity::collision_search::CollisionQuery;
use crate::integrators::velocity::velocity_loop::VelocityLoop;
use crate::stages::s05_solve::ImpulsePredictor;
use crate::stages::s06_integrate_velocity::integrate_velocity;
use crate::tuning::{MAX_PREDICTIONS, PREDICTED_ERROR_RATIO, PREDICTED_MARGIN};

/// Motion of a step in which the collision search looks for colliding pairs.
#[derive(Clone, Copy, Debug)]
pub(crate) enum SweptMotion<R: Real> {
    /// Motion with the predicted impulses, before the solve. Only the earliest collision of each kinematic tree counts.
    Predicted,
    /// Motion of the solver's solution. In the lanes `finds_all`, every colliding pair counts. In the others, only the earliest collision
    /// of each kinematic tree counts.
    Solved { finds_all: R::Mask },
}

impl<R: Real> VelocityLoop<'_, R> {
    /// Activates the deferred contacts that collide in the predicted motion, and repeats the prediction of the impulses with them, in the
    /// lanes `lanes`. A new prediction may cause new collisions; there are at most [`MAX_PREDICTIONS`] repetitions.
    #[inline(always)]
    pub(crate) fn predict_collisions(&mut self, predictor: &ImpulsePredictor<R>, lanes: R::Mask) {
        for _ in 0..MAX_PREDICTIONS {
            let colliding = self.activate_colliding(SweptMotion::Predicted);
            if colliding.none() {
                return;
            }
            predictor.repeat(self.context.input.options, colliding.and(lanes), self.problem, self.velocity);
        }
    }

    /// Activates the deferred contacts whose pairs collide in the given motion, so that the solver includes their rows. Returns the lanes
    /// with such a contact.
    #[inline(always)]
    pub(crate) fn activate_colliding(&mut self, motion: SweptMotion<R>) -> R::Mask {
        let StepContext { input, evaluation } = self.context;
        let Self { free, problem, velocity, collisions, .. } = self;
        if problem.deferred_lanes(input.alive).none() {
            return R::Mask::splat(false);
        }
        let predicted = matches!(motion, SweptMotion::Predicted);
        let (overlap_fraction, error, finds_all) = match motion {
            SweptMotion::Predicted => {
                let residual = kernel!(R, || residual(&problem.rows, &velocity.impulses));
                (PREDICTED_MARGIN, residual * R::of(PREDICTED_ERROR_RATIO), R::Mask::splat(false))
            }
            SweptMotion::Solved { finds_all } => (0.0, R::zero(), finds_all),
        };
        let query = CollisionQuery { problem, input, evaluation, overlap_fraction, error, finds_all };
        if !collisions.list_candidates(&query, &velocity.impulses.w) {
            return R::Mask::splat(false);
        }
        // The solved motion has the velocity `velocity.v`. The predicted motion has the free velocity plus the change by predicted
        // impulses.
        if predicted {
            integrate_velocity(input.compiled, &free.smooth.mass, &free.v, &velocity.impulses, &mut collisions.v_by_predicted_impulses);
        }
        let colliding = collisions.find(&query, predicted, &velocity.v);
        if colliding.any() {
            problem.activate(velocity, &evaluation.contacts, colliding, |pair| collisions.lanes_of(pair));
        }
        colliding
    }
}
