//! Contacts whose gap the solved motion closes: their rows are activated and their lanes solved again.
//!
//! [`crate::constraints::approaching`] defines which rows are deferred. The pairs that touch first are activated first, because an impact
//! may prevent later ones. Example: a ball that lands on the floor does not hit the ledge behind its landing point.

use stepper_real::{Mask, Real};
use stepper_solve::Outcome;

use crate::compile::LaneModel;
use crate::integrators::strike_search::StrikeQuery;
use crate::integrators::workspace::{Evaluation, Workspace};
use crate::options::StepSettings;
use crate::stages::s05_solve::{Estimate, solve};
use crate::stages::s06_integrate_velocity::integrate_velocity;
use crate::tuning::{MAX_PREDICTIONS, ORDERED_PASSES, PREDICTED_MARGIN};

/// Motion of a step along which pairs are tested for a collision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SweptMotion {
    /// Motion by the impulses of the prediction.
    Predicted,
    /// Motion of the solution, `next.v`. With `ignores_order` every colliding pair counts, also behind an earlier collision.
    Solved { ignores_order: bool },
}

/// Activates the contacts that collide in the predicted motion, and repeats the prediction with them.
#[inline(always)]
pub(crate) fn predict_strikes<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    estimate: &Estimate<R>,
    s: &mut Workspace<R>,
    lanes: R::Mask,
) {
    for _ in 0..MAX_PREDICTIONS {
        let struck = activate_struck(compiled, options, s, SweptMotion::Predicted);
        if struck.none() {
            return;
        }
        estimate.repeat(options, struck.and(lanes), &mut s.constraints);
    }
}

/// Solves the lanes again with the contacts that collide in the solved motion `next.v`, until no other collides.
#[inline(always)]
pub(crate) fn solve_strikes<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    mut outcome: Outcome<R>,
) -> Outcome<R> {
    for pass in 0.. {
        let struck = activate_struck(compiled, options, s, SweptMotion::Solved { ignores_order: pass >= ORDERED_PASSES });
        if struck.none() {
            break;
        }
        let (rows, mut workspace) = s.constraints.split();
        let solved = solve(options, &s.state.v, struck, &rows, &mut workspace, &mut s.evaluation.contacts);
        outcome.replace(&solved, struck);
        integrate_velocity(compiled, &s.free_motion.smooth.mass, &s.free_motion.v, &s.constraints, &mut s.next.v);
    }
    outcome
}

/// Activates the contacts that collide in a motion. Returns the lanes with any.
#[inline(always)]
fn activate_struck<R: Real>(compiled: &LaneModel<R>, options: &StepSettings, s: &mut Workspace<R>, motion: SweptMotion) -> R::Mask {
    if s.constraints.deferred_lanes(s.alive).none() {
        return R::Mask::splat(false);
    }
    let (margin, ignores_order) = match motion {
        SweptMotion::Predicted => (PREDICTED_MARGIN, false),
        SweptMotion::Solved { ignores_order } => (0.0, ignores_order),
    };
    let Evaluation { kinematics, contacts, .. } = &s.evaluation;
    let query = StrikeQuery { compiled, kinematics, poses: &s.poses, contacts, options, lanes: s.alive, margin, ignores_order };
    if !s.strikes.list_candidates(&query, &s.constraints) {
        return R::Mask::splat(false);
    }
    let v = if motion == SweptMotion::Predicted {
        s.constraints.impulse_change(compiled, &s.free_motion.smooth.mass, &mut s.work.v_predicted);
        R::vectorize(
            #[inline(always)]
            || {
                for (v, &free) in s.work.v_predicted.iter_mut().zip(&s.free_motion.v) {
                    *v += free;
                }
            },
        );
        &s.work.v_predicted
    } else {
        &s.next.v
    };
    let struck = s.strikes.find(&query, v, &s.constraints);
    if struck.any() {
        s.constraints.activate(contacts, struck, |pair| s.strikes.lanes_of(pair));
    }
    struck
}
