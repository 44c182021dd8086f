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
pub use proximal::{EXACT_RATIO, Search, Terms};
use proximal::{ProximalPoint, SMALL};
pub use response::{Response, Switch, SwitchDistance};
use stepper_real::{Mask, Real, Scalar};

/// Smallest limit of Newton steps per pass at which steps of the exact friction law are made, in small islands and in a last pass.
///
/// Half of the problems that need such steps take up to 75 of them, which is within [`EXACT_RATIO`] times this limit. Under a smaller limit
/// such steps reduce the residual but do not converge, and contacts that should stick then move. With five steps per pass, a pinched cube
/// slips (scene 31 of docs/benchmarks/atlas.md).
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

/// Result of Newton's method in one lane.
#[derive(Clone, Copy, Debug)]
struct LaneOutcome {
    /// Residual of the impulses, m/s.
    residual: f64,
    /// Number of Newton steps.
    steps: u32,
    /// Whether the residual of any island has become smaller or meets the tolerance.
    better: bool,
}

impl Newton {
    /// Improves the impulses of the lanes `lanes`, one lane after the other. Lanes whose residual meets the tolerance are skipped, except
    /// with [`Terms::LeastNorm`]. Lanes whose residual is not finite are always skipped.
    ///
    /// `residual` has the residual of each lane, m/s, and gets the new one. `step_counts` has numbers of Newton steps, which increase by
    /// the steps of this call. A residual may increase, but then remains within the tolerance. If many impulses are possible, the solver
    /// finds those near the start, or those of least norm for [`Terms::LeastNorm`].
    pub fn solve<'a, R: Real>(
        &mut self,
        system: impl Into<System<'a, R>>,
        iterate: &mut Iterate<R>,
        search: Search<R>,
        lanes: R::Mask,
        [residual, step_counts]: [&mut R; 2],
    ) {
        let system = system.into();
        let lanes = if search.terms == Terms::LeastNorm { lanes } else { lanes.and(residual.gt(search.tolerance)) };
        self.work = Work::default();
        let mut rest = lanes.and(residual.is_finite()).bits();
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            self.lane.gather(system, iterate, lane);
            let Search { steps, tolerance, terms } = search;
            let result = self.solve_lane::<R>(Search { steps, tolerance: tolerance.lane(lane).to_f64(), terms });
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
            self.gather_island(name);
            let before = self.island.residual(&mut self.v);
            let mut after = before;
            if search.terms == Terms::LeastNorm || before > search.tolerance {
                let [steps, rounds] = self.solve_island::<R>(search);
                result.steps += steps;
                let work = &mut self.work;
                *work = Work { islands: work.islands + 1, steps: work.steps + steps, rounds: work.rounds + rounds };
                for x in self.island.lambda.iter_mut().chain(&mut self.island.w) {
                    *x = R::Scalar::from_f64(*x).to_f64();
                }
                after = self.island.residual(&mut self.v);
            }
            // Both comparisons are false for a NaN, which is no solution.
            let better = after < before || after <= search.tolerance;
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
    fn solve_island<R: Real>(&mut self, search: Search<f64>) -> [u32; 2] {
        let Self { proximal, island, v, .. } = self;
        let [mut steps, mut rounds] = [0; 2];
        let (small, constant) = (island.w.len() <= SMALL, matches!(search.terms, Terms::Constant | Terms::LeastNorm));
        if constant || small && search.terms == Terms::ConstantThenExact {
            steps += proximal.solve::<R>(island, search);
            rounds += proximal.rounds;
        }
        let enough = !small || search.terms == Terms::Exact || search.steps >= MIN_STEPS_FOR_EXACT;
        if !constant && enough && (steps == 0 || island.residual(v) > search.tolerance) {
            steps += proximal.solve_exact::<R>(island, search);
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
