//! Augmented-Lagrangian Newton: the second tier, for the lanes that sweeps do not bring to the tolerance.
//!
//! Per lane and island, in scalar f64. The unknown is w, whose metric is the identity. With De Saxce's terms s_i = mu_i |v_t,i| held, the
//! problem is convex, and the proximal method solves it by a few minimisations over w of
//!
//! ```text
//! 1/2 |w|^2 + sum_i |P_K(lambda_i - rho_i (Y_i w + g_i + s_i))|^2 / (2 rho_i),      then lambda <- P_K(...)
//! ```
//!
//! (Rockafellar 1976; for contacts Cadoux 2009 and Acary & Cadoux 2013, whose outer fixed point on s this is too) by Newton's method with an
//! exact line search. The steps rho_i = kappa dim / trace(G_ii) are so long that one or two proximal steps are enough, and what is hyperstatic
//! does no harm: the matrix is the identity plus a positive semidefinite one. Of many possible forces those near the start are taken, or
//! the least, if the first step starts from zero.
//! Between the minimisations s is renewed, with Anderson's acceleration; and after the first, steps on the exact law are tried, s included, whose
//! matrix is not symmetric: near the answer they converge at once, and where they do not they are taken back.
//!
//! Nothing proves that s converges, and Coulomb's law may have no solution or several (Painleve 1895). The residual says how it went.

mod anderson;
mod cone;
mod dense;
mod descent;
mod island;
mod lane;
mod order;
mod penalty;
mod skyline;
#[cfg(test)]
mod tests;

use crate::{Iterate, Problem};
use descent::{Descent, Goal};
use island::Island;
use lane::Lane;
use order::{Islands, Order};
use stepper_real::{Mask, Real, Scalar};

/// Room to work, made once per thread; it grows with the largest problem that it has seen.
#[derive(Clone, Debug, Default)]
pub struct Newton {
    lane: Lane,
    /// Its coordinates are in the order of the factors.
    island: Island,
    islands: Islands,
    order: Order,
    descent: Descent,
    v: Vec<f64>,
    /// Blocks of the lane that the island has.
    members: Vec<usize>,
    work: Work,
}

/// What the last call has done in all its lanes and islands together. With at most n steps asked for, there are at most n steps and n rounds an
/// island, whatever the numbers are: what a lane can cost its neighbours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Islands searched.
    pub islands: u32,
    /// Newton steps: each factorises a matrix and looks at some 30 points along its direction at the most.
    pub steps: u32,
    /// Rounds: each evaluates the problem a few times.
    pub rounds: u32,
}

/// A [`Goal`] for every lane.
#[derive(Clone, Copy, Debug)]
struct Aim<R> {
    steps: u32,
    tolerance: R,
    least: bool,
}

/// How it went in one lane.
#[derive(Clone, Copy, Debug)]
struct Verdict {
    residual: f64,
    steps: u32,
    /// Whether any island has a smaller residual than before.
    better: bool,
}

impl Newton {
    /// Improves the impulses of the lanes `lanes` whose `residual` is above the tolerance, each alone, by at most `steps` Newton steps an
    /// island. Replaces their residuals and adds the Newton steps to `taken`. No lane ends with a larger residual than it had. Of many possible
    /// impulses it takes those near the start.
    pub fn solve<R: Real>(
        &mut self,
        problem: &Problem<R>,
        iterate: &mut Iterate<R>,
        steps: u32,
        tolerance: R,
        lanes: R::Mask,
        outcome: [&mut R; 2],
    ) {
        let lanes = lanes.and(outcome[0].gt(tolerance));
        self.search(problem, iterate, Aim { steps, tolerance, least: false }, lanes, outcome);
    }

    /// The same for all of `lanes`, but of many possible impulses it takes the least (in the metric of 1/rho), whatever came before and whatever
    /// the order of the rows. Those it leaves meet the tolerance, or have a smaller residual than they had.
    pub fn share<R: Real>(
        &mut self,
        problem: &Problem<R>,
        iterate: &mut Iterate<R>,
        steps: u32,
        tolerance: R,
        lanes: R::Mask,
        outcome: [&mut R; 2],
    ) {
        self.search(problem, iterate, Aim { steps, tolerance, least: true }, lanes, outcome);
    }

    /// What the last call has done.
    pub fn work(&self) -> Work {
        self.work
    }

    fn search<R: Real>(
        &mut self,
        problem: &Problem<R>,
        iterate: &mut Iterate<R>,
        aim: Aim<R>,
        lanes: R::Mask,
        [residual, taken]: [&mut R; 2],
    ) {
        self.work = Work::default();
        let mut rest = lanes.and(residual.is_finite()).bits();
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            self.lane.gather(problem, iterate, lane);
            let goal = Goal { tolerance: aim.tolerance.lane(lane).to_f64(), steps: aim.steps, least: aim.least };
            let verdict = self.solve_lane::<R>(goal);
            if verdict.better {
                self.lane.scatter(lane, iterate);
                residual.set_lane(lane, Scalar::from_f64(verdict.residual));
            }
            taken.set_lane(lane, taken.lane(lane) + Scalar::from_f64(f64::from(verdict.steps)));
        }
    }

    /// All islands of the lane. Impulses are left as numbers of the lanes' precision, and so they are judged.
    fn solve_lane<R: Real>(&mut self, goal: Goal) -> Verdict {
        let mut verdict = Verdict { residual: 0.0, steps: 0, better: false };
        self.islands.find(&self.lane);
        self.order.prepare(&self.lane);
        for name in 0..self.islands.count {
            self.take_island(name);
            let before = self.island.residual(&mut self.v);
            let mut after = before;
            if goal.least || before > goal.tolerance {
                let steps = self.descent.solve::<R>(&mut self.island, goal);
                verdict.steps += steps;
                let Work { islands, steps: all, rounds } = self.work;
                self.work = Work { islands: islands + 1, steps: all + steps, rounds: rounds + self.descent.rounds };
                for x in self.island.lambda.iter_mut().chain(&mut self.island.w) {
                    *x = R::Scalar::from_f64(*x).to_f64();
                }
                after = self.island.residual(&mut self.v);
            }
            // An answer that is not a number is none.
            let better = after < before || after <= goal.tolerance;
            if better {
                self.island.give(&mut self.lane, &self.members, &self.order.coordinates);
                verdict.better = true;
            }
            verdict.residual = verdict.residual.max(if better { after } else { before });
        }
        verdict
    }

    /// Copies the rows of an island.
    fn take_island(&mut self, name: usize) {
        let Self { lane, island, islands, order, members, .. } = self;
        members.clear();
        members.extend((0..lane.blocks.len()).filter(|&i| islands.of_block[i] as usize == name));
        order.island(lane, members[0]);
        island.take(lane, members, &order.coordinates, &order.number);
    }
}
