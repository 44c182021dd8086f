//! Augmented-Lagrangian Newton: the robust solver, for the lanes that sweeps do not bring to the tolerance.
//!
//! The solver treats each island (set of coupled constraints) of each lane in scalar f64. The unknown is w, whose metric is the identity.
//! The problem is convex if De Saxce's terms `s_i = mu_i |v_t,i|` are constant. The proximal method solves it by a few minimisations over
//! w of
//!
//! ```text
//! 1/2 |w|^2 + sum_i |P_K(lambda_i - rho_i (Y_i w + g_i + s_i))|^2 / (2 rho_i),      then lambda <- P_K(...)
//! ```
//!
//! by Newton's method with an exact line search (Rockafellar 1976). For contacts this is also the outer fixed point on s of Cadoux 2009 and
//! Acary & Cadoux 2013. The steps are rho_i = kappa dim / trace(G_ii), where dim is the number of rows. The factor kappa is so large that
//! one or two proximal steps are enough. Redundant supports do no harm, because the matrix is the identity plus a positive semidefinite
//! one. If many impulses are possible, the solver finds those near the start, or those of least norm if the first step starts from zero.
//!
//! Between the minimisations s is recomputed, with Anderson's acceleration. After the first minimisation the solver also tries steps of the
//! exact friction law, including s, whose matrix is not symmetric. Close to the solution such steps converge at once; otherwise the solver
//! rejects them.
//!
//! With many contacts the outer loop on s does not converge. For such islands, and after a failure of the loop, all proximal steps are of
//! the exact friction law, and short at first (`ProximalPoint::solve_exact`).
//!
//! Convergence of s is not proven, and Coulomb's law may have no solution or several (Painleve 1895). The residual gives the error.

mod anderson;
mod augmented_lagrangian;
mod dense;
mod island;
mod lane;
mod ordering;
mod proximal;
mod response;
mod skyline;

use crate::iterate::Iterate;
use crate::problem::System;
use island::Island;
use lane::Lane;
use ordering::{Islands, Ordering};
use proximal::{Criteria, ProximalPoint, SMALL};
pub use proximal::{EXACT_RATIO, Terms};
pub use response::{Response, Switch, SwitchDistance};
use stepper_real::{Mask, Real, Scalar};

/// Smallest limit of Newton steps per pass at which steps of the exact friction law are made, in small islands and in a last pass.
///
/// Half of the problems that need such steps take up to 75 of them, which is within [`EXACT_RATIO`] times this limit. Such steps under a
/// smaller limit would reduce the residual, but contacts that have not converged move. With five steps per pass, a pinched cube slips
/// (scene 31 of docs/benchmarks/atlas.md).
pub(crate) const MIN_STEPS_FOR_EXACT: u32 = 13;

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
    /// Velocities of the island's rows, m/s.
    v: Vec<f64>,
    /// Indices of the lane's constraints that are in the island.
    members: Vec<usize>,
    /// Effort of the last call of Newton's method.
    work: Work,
}

/// Effort of the last call of Newton's method, in all its lanes and islands together.
///
/// With a limit of n steps, there are at most n Newton steps and n rounds per island. With the exact friction law, there are at most
/// [`EXACT_RATIO`] n of each. These limits bound the time for which other lanes wait.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Number of islands (sets of coupled constraints) on which Newton's method worked.
    pub islands: u32,
    /// Number of Newton steps. Each factorises a matrix and evaluates at most some 30 points along its direction.
    pub steps: u32,
    /// Number of rounds of the outer loop of Newton's method. Each evaluates the problem a few times.
    pub rounds: u32,
}

/// Limits and tolerance of [`Newton::solve`].
#[derive(Clone, Copy, Debug)]
pub struct Search<R> {
    /// Largest number of Newton steps of an island; [`EXACT_RATIO`] times as many for the exact friction law.
    pub steps: u32,
    /// Residual at which the search stops, m/s.
    pub tolerance: R,
    /// Treatment of De Saxce's terms mu |v_t| of Coulomb's law.
    pub terms: Terms,
}

/// Criteria at which Newton's method stops in each lane of a group.
#[derive(Clone, Copy, Debug)]
struct LaneCriteria<R> {
    /// Largest number of Newton steps of an island.
    steps: u32,
    /// Residual at which the search stops, m/s.
    tolerance: R,
    /// Whether to find the impulses of least norm among many possible ones, instead of those near the start.
    least_norm: bool,
    /// Treatment of De Saxce's terms mu |v_t| of Coulomb's law.
    terms: Terms,
}

/// Result of Newton's method in one lane.
#[derive(Clone, Copy, Debug)]
struct LaneOutcome {
    /// Residual of the impulses, m/s.
    residual: f64,
    /// Number of Newton steps.
    steps: u32,
    /// Whether the residual of any island has become smaller.
    better: bool,
}

impl Newton {
    /// Improves the impulses of the lanes `lanes` whose residual is above the tolerance, lane by lane.
    ///
    /// `outcome` holds the residuals, which are replaced, and the numbers of Newton steps, which increase by the steps of this call. No
    /// residual increases. If many impulses are possible, the solver finds those near the start.
    pub fn solve<'a, R: Real>(
        &mut self,
        system: impl Into<System<'a, R>>,
        iterate: &mut Iterate<R>,
        Search { steps, tolerance, terms }: Search<R>,
        lanes: R::Mask,
        outcome: [&mut R; 2],
    ) {
        let lanes = lanes.and(outcome[0].gt(tolerance));
        let criteria = LaneCriteria { steps, tolerance, least_norm: false, terms };
        self.solve_lanes(system.into(), iterate, criteria, lanes, outcome);
    }

    /// Finds the impulses of least norm (in the metric of 1/rho) of the lanes `lanes`, if many impulses are possible.
    ///
    /// These impulses do not depend on the initial impulses or on the order of the rows. They meet the tolerance, or have a smaller
    /// residual than before. `outcome` holds the residuals, which are replaced, and the numbers of Newton steps, which increase by the
    /// steps of this call.
    pub fn solve_least_norm<'a, R: Real>(
        &mut self,
        system: impl Into<System<'a, R>>,
        iterate: &mut Iterate<R>,
        steps: u32,
        tolerance: R,
        lanes: R::Mask,
        outcome: [&mut R; 2],
    ) {
        let criteria = LaneCriteria { steps, tolerance, least_norm: true, terms: Terms::Constant };
        self.solve_lanes(system.into(), iterate, criteria, lanes, outcome);
    }

    /// Numbers of islands, Newton steps and rounds of the last solve.
    pub fn work(&self) -> Work {
        self.work
    }

    /// Solves the lanes `lanes`, one after the other. The last argument holds the residuals and the numbers of Newton steps, which are
    /// updated.
    fn solve_lanes<R: Real>(
        &mut self,
        system: System<'_, R>,
        iterate: &mut Iterate<R>,
        criteria: LaneCriteria<R>,
        lanes: R::Mask,
        [residual, taken]: [&mut R; 2],
    ) {
        self.work = Work::default();
        let mut rest = lanes.and(residual.is_finite()).bits();
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            self.lane.gather(system, iterate, lane);
            let own = Criteria {
                tolerance: criteria.tolerance.lane(lane).to_f64(),
                steps: criteria.steps,
                least_norm: criteria.least_norm,
                terms: criteria.terms,
            };
            let result = self.solve_lane::<R>(own);
            if result.better {
                self.lane.scatter(lane, iterate);
                residual.set_lane(lane, Scalar::from_f64(result.residual));
            }
            taken.set_lane(lane, taken.lane(lane) + Scalar::from_f64(f64::from(result.steps)));
        }
    }

    /// Solves all islands of the lane that has been gathered. Impulses are rounded to the precision of `R`, and their residual is that
    /// after rounding.
    fn solve_lane<R: Real>(&mut self, criteria: Criteria) -> LaneOutcome {
        let mut result = LaneOutcome { residual: 0.0, steps: 0, better: false };
        self.islands.find(&self.lane);
        self.ordering.list_blocks(&self.lane);
        for name in 0..self.islands.count {
            self.gather_island(name);
            let before = self.island.residual(&mut self.v);
            let mut after = before;
            if criteria.least_norm || before > criteria.tolerance {
                let [steps, rounds] = self.solve_island::<R>(criteria);
                result.steps += steps;
                let work = &mut self.work;
                *work = Work { islands: work.islands + 1, steps: work.steps + steps, rounds: work.rounds + rounds };
                for x in self.island.lambda.iter_mut().chain(&mut self.island.w) {
                    *x = R::Scalar::from_f64(*x).to_f64();
                }
                after = self.island.residual(&mut self.v);
            }
            // Both comparisons are false for a NaN, which is no solution.
            let better = after < before || after <= criteria.tolerance;
            if better {
                self.island.scatter(&mut self.lane, &self.members, &self.ordering.coordinates);
                result.better = true;
            }
            result.residual = result.residual.max(if better { after } else { before });
        }
        result
    }

    /// Improves the impulses of the island that has been gathered. Returns the number of Newton steps and the number of rounds of the outer
    /// loop.
    fn solve_island<R: Real>(&mut self, criteria: Criteria) -> [u32; 2] {
        let Self { proximal, island, v, .. } = self;
        let [mut steps, mut rounds] = [0; 2];
        let (small, constant) = (island.w.len() <= SMALL, criteria.terms == Terms::Constant);
        if constant || small && criteria.terms == Terms::ConstantThenExact {
            steps += proximal.solve::<R>(island, criteria);
            rounds += proximal.rounds;
        }
        let enough = !small || criteria.terms == Terms::Exact || criteria.steps >= MIN_STEPS_FOR_EXACT;
        if !constant && enough && (steps == 0 || island.residual(v) > criteria.tolerance) {
            steps += proximal.solve_exact::<R>(island, criteria);
            rounds += proximal.rounds;
        }
        [steps, rounds]
    }

    /// Gathers the rows of the island with the index `name` from the lane.
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
