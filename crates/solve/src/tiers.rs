//! Both tiers: Newton's method first for lanes whose loads must be shared, sweeps over all the others, then Newton's method for each lane that they
//! leave.

use crate::cone::{keep, norm2};
use crate::newton::Newton;
use crate::{Iterate, Problem, pgs, residual};
use stepper_real::{Mask, Real, Scalar};

/// How much each tier may do, and when it is enough.
#[derive(Clone, Copy, Debug)]
pub struct Settings<R> {
    /// Sweeps at the most in each pass; at least one is made.
    pub sweeps: u32,
    /// Newton steps at the most in each pass, per island; 0 leaves the second tier out.
    pub newton: u32,
    /// Residual at which each lane is done, m/s.
    pub tolerance: R,
    /// Residual above which a lane that sweeps have left goes on to the second tier, m/s; at least the tolerance.
    pub rough: R,
}

/// How it went, per lane.
#[derive(Clone, Copy, Debug)]
pub struct Outcome<R: Real> {
    /// Residual of the impulses that were returned, m/s.
    pub residual: R,
    /// Sweeps made.
    pub sweeps: R,
    /// Newton steps made, over all islands.
    pub newton: R,
}

impl<R: Real> Outcome<R> {
    /// Takes over how another solution of the lanes `lanes` went, and counts what it took.
    #[inline(always)]
    pub fn replace(&mut self, again: &Self, lanes: R::Mask) {
        self.residual = R::select(lanes, again.residual, self.residual);
        self.sweeps += again.sweeps;
        self.newton += again.newton;
    }
}

/// Residual above which the load of hyperstatic lanes is shared anew, m/s: what is left moves it from point to point.
///
/// Measured on a table of four legs that slides for half a second at 0.1 ms (scene 15 of the atlas): the order of its legs matters by 2e-6 m
/// with 1e-8, by 1e-7 m with 1e-9.
const SHARED: f64 = 1e-9;

/// Speed of a loaded contact from which on it slips, m/s: then friction's torque depends on how the load is shared.
const SLIPS: f64 = 1e-6;

/// Times that sweeps and then Newton's method have a go. Each leaves the other a start of another kind: sweeps find which contacts slip, Newton's method
/// what they cannot move.
///
/// Measured on 32 of safety-gymnasium's racecars and doggos under random control, 400 steps: one pass leaves 0.17 and 0.27 % of the steps unsolved,
/// two leave 0.16 and 0.06 %, three 0.11 and 0.06 %.
pub const PASSES: usize = 3;

/// Tangential speed of the fastest contact that carries load, m/s.
#[inline(always)]
fn fastest_slip<R: Real>(problem: &Problem<R>, iterate: &Iterate<R>) -> R {
    let mut most = R::zero();
    for (block, lambda) in problem.contacts.iter().zip(&iterate.contacts) {
        let v = problem.contact_velocity(block, &iterate.w);
        most = most.max(keep(block.active.and(lambda[0].gt(R::zero())), norm2(v[1], v[2])));
    }
    most
}

/// Improves the impulses of the lanes `lanes` until each meets the tolerance or the settings are used up.
///
/// Sweeps favour the rows that they visit first, a proximal step from zero favours none. So hyperstatic lanes begin with Newton's method, and
/// sweeps improve what it left.
pub fn solve<R: Real>(
    problem: &Problem<R>,
    iterate: &mut Iterate<R>,
    settings: Settings<R>,
    lanes: R::Mask,
    room: &mut Newton,
) -> Outcome<R> {
    let Settings { sweeps, newton, tolerance, rough } = settings;
    let mut outcome = Outcome { residual: R::zero(), sweeps: R::zero(), newton: R::zero() };
    let (mut rest, shared) = (lanes, lanes.and(problem.hyperstatic));
    if newton > 0 && shared.any() {
        let goal = R::of(SHARED).max(R::of(<R::Scalar as Scalar>::EPSILON.to_f64() * 10.0));
        let (left, slip) = R::vectorize(
            #[inline(always)]
            || {
                iterate.meet(problem, shared);
                (residual(problem, iterate), fastest_slip(problem, iterate))
            },
        );
        outcome.residual = keep(shared, left);
        let anew = shared.and(left.gt(goal).or(slip.gt(R::of(SLIPS))));
        room.share(problem, iterate, newton, goal, anew, [&mut outcome.residual, &mut outcome.newton]);
        // What hardly moves is brought to a standstill by sweeps: their changes are too small to matter.
        rest = lanes.and_not(shared.and(outcome.residual.le(tolerance)).and(tolerance.gt(goal)));
    }
    let sweeps = pgs::Settings { sweeps, tolerance };
    sweep(problem, iterate, sweeps, rest, &mut outcome);
    let mut left = lanes.and(outcome.residual.gt(rough));
    if newton == 0 || left.none() {
        return outcome;
    }
    room.solve(problem, iterate, newton, tolerance, left, [&mut outcome.residual, &mut outcome.newton]);
    // Sweeps would undo an even sharing.
    left = left.and_not(shared);
    for _ in 1..PASSES {
        left = left.and(outcome.residual.gt(rough));
        if left.none() {
            break;
        }
        let (mut kept, before) = (std::mem::take(&mut iterate.kept), outcome.residual);
        kept.keep(iterate, left);
        sweep(problem, iterate, sweeps, left, &mut outcome);
        let unsolved = left.and(outcome.residual.gt(rough));
        room.solve(problem, iterate, newton, tolerance, unsolved, [&mut outcome.residual, &mut outcome.newton]);
        let worse = left.and_not(outcome.residual.le(before));
        kept.give(iterate, worse);
        outcome.residual = R::select(worse, before, outcome.residual);
        iterate.kept = kept;
    }
    outcome
}

/// The first tier, in the lanes `lanes`.
fn sweep<R: Real>(problem: &Problem<R>, iterate: &mut Iterate<R>, settings: pgs::Settings<R>, lanes: R::Mask, outcome: &mut Outcome<R>) {
    if lanes.any() {
        let swept = pgs::solve(problem, iterate, settings, lanes);
        outcome.residual = R::select(lanes, swept.residual, outcome.residual);
        outcome.sweeps += swept.sweeps;
    }
}
