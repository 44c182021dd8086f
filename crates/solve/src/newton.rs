//! Proximal Newton method on the exact friction law: the robust solver, for the lanes that sweeps do not bring to the tolerance.
//!
//! The solver treats each island (set of coupled constraints) of each lane in scalar f64. The unknown is the scaled velocity change w;
//! |w|^2 / 2 is its kinetic energy. The rows have the velocities Y w + g. A proximal step solves
//!
//! ```text
//! lambda' = P(lambda - rho (Y w + g)),   w = Y^T lambda'
//! ```
//!
//! by Newton's method, where P is the map of Alart and Curnier (Computer Methods in Applied Mechanics and Engineering 92, 1991). For a
//! contact, the normal impulse is max(0, x_n). The tangential one is x_t, shortened to mu times the normal impulse. Fixed points
//! `lambda' = lambda` solve the exact Coulomb problem. The step size is rho = kappa dim / trace(G_ii), where dim is the number of rows of
//! a constraint and G_ii its block of the Delassus matrix. Compliances are left out here. Redundant supports do no harm, because Newton's
//! matrix is the identity plus a part that is positive semidefinite if no contact slips. If many impulses are possible, the solver finds
//! those near the start, or those of least norm if the first step starts from zero.
//!
//! Convergence is not proven, and Coulomb's law may have no solution or several (Painleve 1895). The residual gives the error.

mod island;
mod lane;
mod ordering;
mod proximal;
mod proximal_step;
mod response;
mod skyline;

use crate::iterate::Iterate;
use crate::problem::System;
use island::Island;
use lane::Lane;
use ordering::{Islands, Ordering};
use proximal::ProximalPoint;
pub use proximal::{STEPS_RATIO, Search};
pub use response::{Response, Switch, SwitchDistance};
use stepper_real::{Mask, Real, Scalar, kernel};

/// Newton's method with its workspace, one per thread. The workspace grows with the largest problem so far.
#[derive(Clone, Debug, Default)]
pub struct Newton {
    /// Buffer for the rows of one lane.
    lane: Lane,
    /// Buffer for the rows of one island, whose coordinates are in the order of the factors.
    island: Island,
    /// Islands (sets of coupled constraints) of the lane.
    islands: Islands,
    /// Order of the island's coordinates.
    ordering: Ordering,
    /// Proximal-point method of one island.
    proximal: ProximalPoint,
    /// Indices of the lane's constraints that are in the island.
    members: Vec<usize>,
    /// Effort of the last call of Newton's method.
    work: Work,
}

/// Effort of the last call of Newton's method, in all its lanes and islands together.
///
/// With a limit of n steps, there are at most [`STEPS_RATIO`] n Newton steps and as many rounds per island. These limits bound the time for
/// which other lanes wait.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Number of islands (sets of coupled constraints) on which Newton's method worked.
    pub islands: u32,
    /// Number of Newton steps. Each factorises a matrix and evaluates at most four points along its direction.
    pub steps: u32,
    /// Number of rounds of the outer loop of Newton's method. Each evaluates the problem a few times.
    pub rounds: u32,
}

/// Result of Newton's method in one lane.
#[derive(Clone, Copy, Debug)]
struct LaneOutcome {
    /// Residual of the impulses, m/s.
    residual: f64,
    /// Number of Newton steps.
    steps: u32,
    /// Whether the result of any island replaces the impulses before it.
    better: bool,
}

impl Newton {
    /// Improves the impulses of the lanes `lanes`, one lane after the other. Lanes whose residual meets the tolerance are skipped, except
    /// in a search for least norm. Lanes whose residual is not finite are always skipped.
    ///
    /// `residual` has the residual of each lane, m/s, and gets the new one. `step_counts` has numbers of Newton steps, which increase by
    /// the steps of this call. A residual may increase if it remains within the tolerance, or in a search for least norm if its product
    /// with the sum of the impulses decreases. If many impulses are possible, the solver finds those near the start, or those of least norm
    /// if the search is for these.
    pub fn solve<'a, R: Real>(
        &mut self,
        system: impl Into<System<'a, R>>,
        iterate: &mut Iterate<R>,
        search: Search<R>,
        lanes: R::Mask,
        [residual, step_counts]: [&mut R; 2],
    ) {
        let system = system.into();
        let lanes = if search.least_norm { lanes } else { lanes.and(residual.gt(search.tolerance)) };
        self.work = Work::default();
        let mut rest = lanes.and(residual.is_finite()).bits();
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            kernel!(R, || self.lane.gather(system, iterate, lane));
            let Search { steps, tolerance, least_norm } = search;
            let result = self.solve_lane::<R>(Search { steps, tolerance: tolerance.lane(lane).to_f64(), least_norm });
            if result.better {
                self.lane.scatter(lane, iterate);
                residual.set_lane(lane, Scalar::from_f64(result.residual));
            }
            step_counts.set_lane(lane, step_counts.lane(lane) + Scalar::from_f64(f64::from(result.steps)));
        }
    }

    /// Numbers of islands, Newton steps and rounds of the last solve.
    pub fn work(&self) -> Work {
        self.work
    }

    /// Solves all islands of the lane that has been gathered. Impulses are rounded to the precision of `R`, and their residual is that
    /// after rounding.
    fn solve_lane<R: Real>(&mut self, search: Search<f64>) -> LaneOutcome {
        let mut result = LaneOutcome { residual: 0.0, steps: 0, better: false };
        self.islands.find(&self.lane);
        self.ordering.list_blocks(&self.lane);
        for name in 0..self.islands.count {
            let before = kernel!(R, || {
                self.gather_island(name);
                self.island.residual()
            });
            let energy_before = before * self.island.total_impulse();
            let mut after = before;
            if search.least_norm || before > search.tolerance {
                let steps = self.proximal.solve::<R>(&mut self.island, before, search);
                result.steps += steps;
                let work = &mut self.work;
                *work = Work { islands: work.islands + 1, steps: work.steps + steps, rounds: work.rounds + self.proximal.rounds };
                for x in self.island.lambda.iter_mut().chain(&mut self.island.w) {
                    *x = R::Scalar::from_f64(*x).to_f64();
                }
                after = kernel!(R, || self.island.residual());
            }
            // All comparisons are false for a NaN, which is no solution.
            let mut better = after < before || after <= search.tolerance;
            // Of contradictory targets, smaller impulses may have a larger residual. The bound of the energy error decreases all the same.
            better |= search.least_norm && after * self.island.total_impulse() < energy_before;
            if better {
                self.island.scatter(&mut self.lane, &self.members, &self.ordering.coordinates);
                result.better = true;
            }
            result.residual = result.residual.max(if better { after } else { before });
        }
        result
    }

    /// Gathers the rows of the island with the index `name` from the lane.
    #[inline(always)]
    fn gather_island(&mut self, name: usize) {
        let Self { lane, island, islands, ordering, members, .. } = self;
        members.clear();
        members.extend((0..lane.blocks.len()).filter(|&i| islands.of_block[i] as usize == name));
        ordering.order_island(lane, members[0]);
        island.gather(lane, members, &ordering.coordinates, &ordering.number);
    }
}

#[cfg(test)]
mod tests;
