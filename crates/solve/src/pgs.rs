//! Projected Gauss-Seidel with the exact solution of every contact's own problem, with Anderson's acceleration: the fast tier.
//!
//! Rows are visited in a fixed order; each takes the impulse that solves it while the others stand. A lane stops when its residual
//! meets the tolerance, and from then on its mask keeps every one of its bits.

use crate::cone::{clamp, keep};
use crate::{Iterate, Problem, anderson, aside, residual};
use stepper_real::{Mask, Real};

/// When to stop.
#[derive(Clone, Copy, Debug)]
pub struct Settings<R> {
    /// Sweeps at the most; at least one is made.
    pub sweeps: u32,
    /// Residual at which each lane is done, m/s.
    pub tolerance: R,
}

/// How it went, per lane.
#[derive(Clone, Copy, Debug)]
pub struct Outcome<R: Real> {
    /// Residual of the impulses that were returned, m/s.
    pub residual: R,
    /// Sweeps made.
    pub sweeps: R,
}

/// Improves the impulses of the lanes `lanes` until each meets the tolerance or the sweeps run out.
///
/// A lane pauses when a sweep changes nothing by more than its threshold, which is cheap to know; when all have paused the residual is
/// taken, and who is above the tolerance goes on with a lower threshold. Every lane that goes on makes a sweep at least, so that rounds are no more
/// than sweeps.
pub fn solve<R: Real>(problem: &Problem<R>, iterate: &mut Iterate<R>, settings: Settings<R>, lanes: R::Mask) -> Outcome<R> {
    R::vectorize(
        #[inline(always)]
        || {
            let tolerance = settings.tolerance;
            let no = R::Mask::splat(false);
            let mut run = Run {
                running: lanes,
                threshold: tolerance,
                sweeps: R::zero(),
                most: f64::from(settings.sweeps.clamp(1, MOST_SWEEPS)),
                apart: no,
            };
            iterate.meet(problem, lanes);
            let (mut worst, mut unsolved) = (R::zero(), lanes);
            while unsolved.any() {
                run.sweep_until_paused(problem, iterate);
                worst = R::select(unsolved, residual(problem, iterate), worst);
                unsolved = unsolved.and(worst.gt(tolerance)).and(run.sweeps.lt(R::of(run.most)));
                run.running = unsolved;
                run.threshold = R::select(unsolved, run.threshold * R::of(0.25), run.threshold);
            }
            Outcome { residual: worst, sweeps: run.sweeps }
        },
    )
}

/// Improves the impulses of the lanes `lanes` until a sweep changes none by more than the tolerance, or the sweeps run out: an estimate, whose residual
/// nobody takes. Of `lanes`, those outside `moving` keep their impulses.
pub fn estimate<R: Real>(problem: &Problem<R>, iterate: &mut Iterate<R>, settings: Settings<R>, lanes: R::Mask, moving: R::Mask) {
    R::vectorize(
        #[inline(always)]
        || {
            let no = R::Mask::splat(false);
            let most = f64::from(settings.sweeps);
            let mut run = Run { running: moving, threshold: settings.tolerance, sweeps: R::zero(), most, apart: no };
            iterate.meet(problem, lanes);
            if moving.any() {
                run.sweep_until_paused(problem, iterate);
            }
        },
    )
}

/// Sweeps are counted in the lanes' numbers: in 32 bits one more than this would be as many.
const MOST_SWEEPS: u32 = 1 << 24;

/// How far the sweeps of each lane are.
pub(crate) struct Run<R: Real> {
    pub(crate) running: R::Mask,
    /// Change of a sweep at which a lane pauses, m/s.
    pub(crate) threshold: R,
    /// Sweeps made.
    pub(crate) sweeps: R,
    /// Sweeps at the most.
    pub(crate) most: f64,
    /// Lanes in which w and the impulses were added up apart.
    pub(crate) apart: R::Mask,
}

impl<R: Real> Run<R> {
    /// Sweeps until every lane has paused; w and the impulses agree then.
    #[inline(always)]
    fn sweep_until_paused(&mut self, problem: &Problem<R>, iterate: &mut Iterate<R>) {
        // Lanes that paused long ago start as those that did just now.
        anderson::begin(iterate);
        while self.running.any() {
            if !aside::pause(problem, iterate, self) {
                self.sweep(problem, iterate);
            }
        }
        if self.apart.any() {
            anderson::settle(iterate, problem, self.apart);
            self.apart = R::Mask::splat(false);
        }
    }

    /// One sweep of the lanes that are running.
    #[inline(always)]
    pub(crate) fn sweep(&mut self, problem: &Problem<R>, iterate: &mut Iterate<R>) {
        let change = sweep(problem, iterate, self.running, self.sweeps.lt(R::of(EXACT_SWEEPS)));
        self.sweeps += keep(self.running, R::one());
        self.running = self.running.and(change.gt(self.threshold)).and(self.sweeps.lt(R::of(self.most)));
        if self.running.any() {
            self.apart = self.apart.or(anderson::accelerate(iterate, self.running));
        }
    }
}

/// Sweeps with the exact solution of every contact; what they have not brought home goes on with the weaker update.
///
/// Against limits of light joints the exact solutions of a contact can cycle. Measured on 64 humanoids under random control at 5 ms with 200
/// sweeps: the worst residual of a step falls from 7 m/s to 2 mm/s, and steps above 1e-6 m/s from 1.06 to 0.84 %; with the weaker
/// update from the beginning they are 2.7 %.
const EXACT_SWEEPS: f64 = 25.0;

/// One visit of every row that is not separate, with the exact solution of a contact in the lanes `exact`; returns the largest change as a velocity, m/s.
#[inline(always)]
fn sweep<R: Real>(problem: &Problem<R>, iterate: &mut Iterate<R>, running: R::Mask, exact: R::Mask) -> R {
    let mut change = R::zero();
    for (i, row) in problem.scalars.iter().enumerate().skip(problem.separate) {
        let lanes = running.and(row.active);
        if lanes.none() {
            continue;
        }
        let lambda = iterate.scalars[i];
        let v = problem.scalar_velocity(row, &iterate.w) + row.compliance * lambda;
        let next = clamp(lambda - v * row.inv_diagonal, row.lo, row.hi);
        let d = keep(lanes, next - lambda);
        iterate.scalars[i] = R::select(lanes, next, lambda);
        if moves(d) {
            problem.add_scalar(row, d, &mut iterate.w);
        }
        change = change.max(d.abs() * row.diagonal);
    }
    for (i, block) in problem.contacts.iter().enumerate() {
        let lanes = running.and(block.active);
        // Towards the end few lanes are left, with few rows.
        if lanes.none() {
            continue;
        }
        let lambda = iterate.contacts[i];
        let v = problem.contact_velocity_under(block, &iterate.w, &lambda);
        let (mut next, slip) = block.solve(v, lambda, iterate.slip[i], lanes);
        if lanes.and_not(exact).any() {
            let weak = block.relax(v, lambda);
            for k in 0..3 {
                next[k] = R::select(exact, next[k], weak[k]);
            }
        }
        let mut d = lambda;
        for k in 0..3 {
            d[k] = keep(lanes, next[k] - lambda[k]);
            iterate.contacts[i][k] = R::select(lanes, next[k], lambda[k]);
        }
        iterate.slip[i] = R::select(lanes, slip, iterate.slip[i]);
        let most = d[0].abs().max(d[1].abs()).max(d[2].abs());
        if moves(most) {
            problem.add_contact(block, d, &mut iterate.w);
        }
        change = change.max(most * block.inv_rho);
    }
    if problem.wide.is_empty() { change } else { change.max(sweep_wide(problem, iterate, running, exact)) }
}

/// Whether any lane's impulse changes: many limits and contacts stay open from sweep to sweep. Nothing would come of adding their zeros, since no
/// sum is ever -0.
#[inline(always)]
fn moves<R: Real>(d: R) -> bool {
    !d.eq(R::zero()).all()
}

/// The visits of the contacts with six rows.
#[inline(always)]
fn sweep_wide<R: Real>(problem: &Problem<R>, iterate: &mut Iterate<R>, running: R::Mask, exact: R::Mask) -> R {
    let mut change = R::zero();
    for (i, block) in problem.wide.iter().enumerate() {
        let lanes = running.and(block.active);
        if lanes.none() {
            continue;
        }
        let lambda = iterate.wide[i];
        let v = problem.wide_velocity_under(block, &iterate.w, &lambda);
        let (mut next, slip) = block.solve(v, lambda, iterate.wide_slip[i], lanes);
        if lanes.and_not(exact).any() {
            let weak = block.relax(v, lambda);
            for k in 0..6 {
                next[k] = R::select(exact, next[k], weak[k]);
            }
        }
        let (mut d, mut most) = (lambda, R::zero());
        for k in 0..6 {
            d[k] = keep(lanes, next[k] - lambda[k]);
            most = most.max(d[k].abs());
            iterate.wide[i][k] = R::select(lanes, next[k], lambda[k]);
        }
        iterate.wide_slip[i] = R::select(lanes, slip, iterate.wide_slip[i]);
        if moves(most) {
            problem.add_wide(block, d, &mut iterate.w);
        }
        change = change.max(most * block.inv_rho);
    }
    change
}
