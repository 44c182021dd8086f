//! Contacts whose gap the solved motion closes: their rows are activated, and the lanes are solved again.
//!
//! [`crate::constraints::approaching`] says which rows wait for this. The pairs that meet first are activated first, since an impact may
//! keep others from meeting: a ball that a floor stops does not strike the step that lies behind.

use stepper_real::{Mask, Real};
use stepper_solve::Outcome;

use crate::compile::LaneModel;
use crate::integrators::strike_search::StrikeQuery;
use crate::integrators::workspace::{Evaluation, Workspace};
use crate::options::StepSettings;
use crate::stages::s05_solve::{Estimate, solve};
use crate::stages::s06_integrate_velocity::integrate_velocity;

/// Number of solves in which pairs are activated in the order in which they meet. After that all that meet are activated.
const ORDERED_PASSES: usize = 6;

/// Number of predictions in which pairs are activated. The solves that follow activate the others.
const PREDICTED_PASSES: usize = 3;

/// Part of the linearised overlap that the true one must exceed in a predicted motion. A prediction leaves a part of gravity unsupported,
/// which is less than a tenth of a fast approach.
const PREDICTED_MARGIN: f64 = 0.1;

/// Activates the contacts that the predicted impulses do not keep from being struck, and predicts again with them.
#[inline(always)]
pub(crate) fn predict_strikes<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    estimate: &Estimate<R>,
    s: &mut Workspace<R>,
    lanes: R::Mask,
) {
    for _ in 0..PREDICTED_PASSES {
        let struck = activate(compiled, options, s, true, PREDICTED_MARGIN, false);
        if struck.none() {
            return;
        }
        estimate.repeat(options, struck.and(lanes), &mut s.constraints);
    }
}

/// Solves again with the contacts that the solved motion `next.v` strikes, until it strikes no other.
#[inline(always)]
pub(crate) fn solve_strikes<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    mut outcome: Outcome<R>,
) -> Outcome<R> {
    for pass in 0.. {
        let struck = activate(compiled, options, s, false, 0.0, pass >= ORDERED_PASSES);
        if struck.none() {
            break;
        }
        let (rows, mut room) = s.constraints.split();
        let again = solve(options, &s.state.v, struck, &rows, &mut room, &mut s.evaluation.contacts);
        outcome.replace(&again, struck);
        integrate_velocity(compiled, &s.free_motion.smooth.mass, &s.free_motion.v, &s.constraints, &mut s.next.v);
    }
    outcome
}

/// Activates the contacts that a motion strikes: the predicted one or `next.v`. Returns the lanes with any.
#[inline(always)]
fn activate<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    predicted: bool,
    margin: f64,
    ignores_order: bool,
) -> R::Mask {
    if s.constraints.deferred_lanes(s.alive).none() {
        return R::Mask::splat(false);
    }
    let Evaluation { kinematics, contacts, .. } = &s.evaluation;
    let query = StrikeQuery { compiled, kinematics, poses: &s.poses, contacts, options, lanes: s.alive, margin, ignores_order };
    if !s.strikes.list_candidates(&query, &s.constraints) {
        return R::Mask::splat(false);
    }
    let v = if predicted {
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
