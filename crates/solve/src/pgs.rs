//! Projected Gauss-Seidel with the exact solution of every contact's own problem: the fast tier.
//!
//! Rows are visited in a fixed order; each takes the impulse that solves it while the others stand. A lane stops when its residual
//! meets the tolerance, and from then on its mask keeps every one of its bits.

use crate::cone::{clamp, keep};
use crate::{Iterate, Problem, nncg, residual};
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
/// taken, and who is above the tolerance goes on with a lower threshold.
pub fn solve<R: Real>(problem: &Problem<R>, iterate: &mut Iterate<R>, settings: Settings<R>, lanes: R::Mask) -> Outcome<R> {
    R::vectorize(
        #[inline(always)]
        || {
            let tolerance = settings.tolerance;
            let mut outcome = Outcome { residual: R::zero(), sweeps: R::zero() };
            let (mut running, mut unsolved, mut threshold) = (lanes, lanes, tolerance);
            let limit = R::of(f64::from(settings.sweeps.max(1)));
            nncg::begin(iterate);
            while unsolved.any() {
                let change = sweep(problem, iterate, running);
                outcome.sweeps += keep(running, R::one());
                running = running.and(change.gt(threshold)).and(outcome.sweeps.lt(limit));
                if running.any() {
                    nncg::accelerate(iterate, running);
                    continue;
                }
                outcome.residual = R::select(unsolved, residual(problem, iterate), outcome.residual);
                unsolved = unsolved.and(outcome.residual.gt(tolerance)).and(outcome.sweeps.lt(limit));
                running = unsolved;
                threshold = R::select(unsolved, threshold * R::of(0.25), threshold);
            }
            outcome
        },
    )
}

/// One visit of every row; returns the largest change as a velocity, m/s.
#[inline(always)]
fn sweep<R: Real>(problem: &Problem<R>, iterate: &mut Iterate<R>, running: R::Mask) -> R {
    let mut change = R::zero();
    for (i, row) in problem.scalars.iter().enumerate() {
        let v = problem.scalar_velocity(row, &iterate.w);
        let lambda = iterate.scalars[i];
        let next = clamp(lambda - v * row.inv_diagonal, row.lo, row.hi);
        let d = keep(running.and(row.active), next - lambda);
        iterate.scalars[i] = R::select(running.and(row.active), next, lambda);
        problem.add_scalar(row, d, &mut iterate.w);
        change = change.max(d.abs() * row.diagonal);
    }
    for (i, block) in problem.contacts.iter().enumerate() {
        let lanes = running.and(block.active);
        let v = problem.contact_velocity(block, &iterate.w);
        let lambda = iterate.contacts[i];
        let (next, slip) = block.solve(v, lambda, iterate.slip[i], lanes);
        let mut d = lambda;
        for k in 0..3 {
            d[k] = keep(lanes, next[k] - lambda[k]);
            iterate.contacts[i][k] = R::select(lanes, next[k], lambda[k]);
        }
        iterate.slip[i] = R::select(lanes, slip, iterate.slip[i]);
        problem.add_contact(block, d, &mut iterate.w);
        change = change.max(d[0].abs().max(d[1].abs()).max(d[2].abs()) * block.inv_rho);
    }
    change
}
