//! One island, from its warm start to the tolerance: the outer loop.

use super::anderson::Anderson;
use super::island::Island;
use super::penalty::{Penalty, slip};
use stepper_real::Real;

/// kappa of the first proximal step, which corrects what sweeps left, and of the others.
///
/// Measured on 1,202 problems that sweeps left of humanoids: beginning with 10 or with 1e5 takes 10 to 20 % more Newton steps; 1e4 and 1e6
/// at the end as many, 1e7 twice as many.
const KAPPA: [f64; 2] = [1e3, 1e5];
/// Where proximal steps are too short (mass ratios beyond 1e5), no more.
const MOST_KAPPA: f64 = 1e9;
/// No less, however tight the tolerance.
const LEAST_KAPPA: f64 = 1e2;

/// Where a search stops.
#[derive(Clone, Copy, Debug)]
pub(super) struct Goal {
    /// Residual, m/s.
    pub(super) tolerance: f64,
    /// Newton steps at the most.
    pub(super) steps: u32,
    /// Whether, of many possible impulses, the least are sought, instead of those near the start.
    pub(super) least: bool,
}

/// Room for an island, and how far its search has come.
#[derive(Clone, Debug, Default)]
pub(super) struct Descent {
    penalty: Penalty,
    anderson: Anderson,
    v: Vec<f64>,
    image: Vec<f64>,
    /// The answer with the least residual.
    best: Answer,
    /// Where an implicit try began.
    before: Answer,
    /// Residual of the last impulses.
    now: f64,
    steps: u32,
}

/// Impulses with their w and residual.
#[derive(Clone, Debug, Default)]
struct Answer {
    lambda: Vec<f64>,
    w: Vec<f64>,
    residual: f64,
}

impl Answer {
    fn keep(&mut self, rows: &Island, residual: f64) {
        self.lambda.clone_from(&rows.lambda);
        self.w.clone_from(&rows.w);
        self.residual = residual;
    }

    fn give(&self, rows: &mut Island) {
        rows.lambda.clone_from(&self.lambda);
        rows.w.clone_from(&self.w);
    }
}

impl Descent {
    /// Improves `rows`; returns the Newton steps that it took. What it leaves is never worse than what it found, unless the least impulses are
    /// sought.
    pub(super) fn solve<R: Real>(&mut self, rows: &mut Island, goal: Goal) -> u32 {
        let stiffest = stiffest(rows, goal.tolerance);
        let (mut kappa, mut bold) = (KAPPA[0].min(stiffest), KAPPA[1].min(stiffest));
        self.penalty.reset(rows);
        self.steps = 0;
        self.now = rows.residual(&mut self.v);
        self.best.keep(rows, self.now);
        self.forget_slip(rows);
        if goal.least {
            // A proximal step from zero; the search for it begins at the motion that is known.
            rows.lambda.fill(0.0);
            self.best.residual = f64::INFINITY;
            kappa = kappa.max(KAPPA[1].min(stiffest));
        }
        // A try of the exact law that fails makes the next one wait twice as long and begin with a smaller kappa.
        let (mut wait, mut pause) = (1, 1);
        while self.steps < goal.steps && self.best.residual > goal.tolerance && self.now.is_finite() {
            if wait == 0 {
                self.penalty.kappa = bold;
                if self.implicit::<R>(rows, goal) {
                    bold = (10.0 * bold).min(kappa);
                    pause = 1;
                    continue;
                }
                bold = (bold / 30.0).max(1.0);
                (wait, pause) = (pause, 2 * pause);
            }
            wait -= 1;
            self.penalty.kappa = kappa;
            let before = self.now;
            self.minimise::<R>(rows, goal);
            self.adopt(rows);
            let off = self.renew_slip(rows);
            // What is left though the slips are right is left by proximal steps that are too short.
            let short = self.now > 0.1 * before && off < 0.1 * self.now;
            kappa = if short { 10.0 * kappa } else { kappa }.max(KAPPA[1]).min(stiffest);
        }
        self.best.give(rows);
        self.steps
    }

    /// De Saxce's terms at the present velocities `v`, and no history.
    fn forget_slip(&mut self, rows: &Island) {
        let slips = rows.blocks.iter().map(|block| slip(block, &self.v[block.rows.clone()]));
        self.penalty.slip.clear();
        self.penalty.slip.extend(slips);
        self.anderson.restart(rows.blocks.len());
    }

    /// The next De Saxce's terms; returns by how much the last ones were wrong, m/s.
    fn renew_slip(&mut self, rows: &Island) -> f64 {
        self.image.clear();
        self.image.extend(rows.blocks.iter().map(|block| slip(block, &self.v[block.rows.clone()])));
        let off = self.image.iter().zip(&self.penalty.slip).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()));
        self.anderson.next(&mut self.penalty.slip, &self.image);
        off
    }

    /// The convex problem, with De Saxce's terms held. While they are far from right it need not be exact.
    fn minimise<R: Real>(&mut self, rows: &mut Island, goal: Goal) {
        let enough = 0.1 * goal.tolerance.max(0.1 * self.now.min(1e-3));
        let mut error = self.penalty.evaluate(rows, false);
        // An error that is not a number ends it too.
        while error > enough && error.is_finite() && self.steps < goal.steps {
            self.steps += 1;
            error = self.penalty.advance::<R>(rows, false);
        }
    }

    /// Tries a proximal step on the exact law; true when that lowers the residual, else nothing has changed.
    fn implicit<R: Real>(&mut self, rows: &mut Island, goal: Goal) -> bool {
        self.before.keep(rows, self.now);
        let mut error = self.penalty.evaluate(rows, true);
        while error > 0.1 * goal.tolerance {
            let last = error;
            self.steps += 1;
            error = self.penalty.advance::<R>(rows, true);
            let falls = error < 0.9 * last;
            if !falls || self.steps >= goal.steps {
                self.before.give(rows);
                return false;
            }
        }
        self.adopt(rows);
        if self.now < 0.9 * self.before.residual {
            self.forget_slip(rows);
            return true;
        }
        self.before.give(rows);
        self.now = self.before.residual;
        false
    }

    /// The proximal step's impulses become the present ones; the best are kept.
    fn adopt(&mut self, rows: &mut Island) {
        rows.lambda.copy_from_slice(&self.penalty.z);
        rows.refresh();
        self.now = rows.residual(&mut self.v);
        if self.now < self.best.residual {
            self.best.keep(rows, self.now);
        }
    }
}

/// The kappa whose rounding leaves velocities within the tolerance: z errs by about rho times the rounding of the velocities that cancel.
fn stiffest(rows: &Island, tolerance: f64) -> f64 {
    let fastest = rows.g.iter().fold(0.0, |most: f64, g| most.max(g.abs()));
    MOST_KAPPA.min(0.1 * tolerance / (f64::EPSILON * fastest)).max(LEAST_KAPPA)
}
