//! Outer loop of Newton's method: proximal steps of one island, from its warm start to the tolerance.
//!
//! With De Saxce's terms constant the problem is convex, and proximal steps converge if it has a solution. Let kappa be the ratio of the
//! proximal step length to the step of the natural map, the function that is zero at the solution. After k steps the residual is at most
//! `D / (kappa sqrt(k))`, where D is the distance from the first impulses to the nearest solution (Rockafellar 1976, theorem 1; Guler 1991,
//! theorem 2.1). The solutions of nearly dependent rows are far away. Kappa therefore grows until every step reduces the residual to a
//! tenth. Rounding bounds kappa, see [`largest_kappa`].
//!
//! Every loop has a bound. A search makes at most `Search::steps` Newton steps, [`EXACT_RATIO`] times as many for the exact friction law,
//! and as many rounds. Besides its Newton steps, each round evaluates the problem at most twice. The search ends when a round changes
//! nothing.

use crate::newton::anderson::Anderson;
use crate::newton::augmented_lagrangian::AugmentedLagrangian;
use crate::newton::island::Island;
use stepper_real::Real;

/// Ratios kappa of the proximal step length to the step of the natural map, the function that is zero at the solution. The first ratio is
/// for the first proximal step, which corrects the result of sweeps; the second is for later steps.
///
/// Measured on 1,202 problems of humanoids that sweeps did not solve: a first kappa of 10 or 1e5 takes 10 to 20 % more Newton steps. A
/// later kappa of 1e4 or 1e6 takes as many, 1e7 twice as many.
const KAPPA: [f64; 2] = [1e3, 1e5];
/// Largest kappa: the ratio of the proximal step length to the step of the natural map, the function that is zero at the solution. The
/// search reaches this value if shorter proximal steps make too little progress: with mass ratios beyond 1e5, or with nearly dependent
/// rows.
///
/// Newton's matrix is the identity plus kappa times another matrix. At this kappa the identity is still above the rounding error.
const MOST_KAPPA: f64 = 1e12;
/// Smallest kappa: the ratio of the proximal step length to the step of the natural map, the function that is zero at the solution. The
/// search ends if Newton's matrix still has no factors when kappa would fall below this value.
const LEAST_KAPPA: f64 = 1e2;

/// First kappa of [`ProximalPoint::solve_exact`], in islands of at most [`SMALL`] coordinates and in larger ones. Kappa is the ratio of the
/// proximal step length to the step of the natural map, the function that is zero at the solution.
///
/// Measured on 53 problems of a wall hit by a ball and of a heap of thirty boxes that sweeps and convex steps had not solved. Other choices
/// were a first kappa of 10 or 1000, growth of kappa by a factor of 4, and 10 instead of [`MOST_STEPS`]. Each solves all problems too, and
/// changes the number of Newton steps by at most 15 %. On 280 problems of small islands, a first kappa of 300 or 3000 takes up to 20 % more
/// steps.
const FIRST_EXACT_KAPPA: [f64; 2] = [1e3, 1e2];
/// Smallest kappa with the exact friction law. Kappa is the ratio of the proximal step length to the step of the natural map, the function
/// that is zero at the solution. If a proximal step with this kappa fails, the search ends.
const LEAST_EXACT_KAPPA: f64 = 0.3;
/// Largest kappa with the exact friction law. Kappa is the ratio of the proximal step length to the step of the natural map, the function
/// that is zero at the solution.
const MOST_EXACT_KAPPA: f64 = 1e6;
/// Largest number of Newton steps of a proximal step with the exact friction law.
const MOST_STEPS: u32 = 6;
/// Largest number of Newton steps of a proximal step with the exact friction law after which the next proximal step is longer.
const FEW_STEPS: u32 = 4;
/// Largest number of Newton steps of the last proximal step, which is made after the tolerance has been met.
const LAST_STEPS: u32 = 2;
/// Largest number of Newton steps with the exact friction law, as a multiple of the limit that the caller sets.
///
/// Half of the 53 problems of `FIRST_EXACT_KAPPA` need more than 75 steps, the hardest 280.
pub const EXACT_RATIO: u32 = 6;

/// Number of Newton steps with the exact friction law that may fail to reduce the error before the attempt ends.
const PATIENCE: u32 = 3;

/// Largest number of coordinates of a small island (set of coupled constraints). In larger islands (a wall hit by a ball, a heap of thirty
/// boxes), hundreds of contacts switch between sticking, slipping and open at once.
pub(super) const SMALL: usize = 64;

/// Choice of when Newton's method recomputes De Saxce's terms mu |v_t|, which make Coulomb's law a cone condition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Terms {
    /// De Saxce's terms mu |v_t| are constant in each convex problem, and recomputed between problems.
    Constant,
    /// De Saxce's terms mu |v_t| are constant first. If that does not solve an island, the friction law is exact. In islands with many
    /// contacts, the law is exact from the beginning.
    ConstantThenExact,
    /// The friction law is exact: De Saxce's terms mu |v_t| follow the velocities in every Newton step.
    Exact,
    /// Terms as in [`Terms::Constant`], for the impulses of least norm (in the metric of 1/rho) if many impulses are possible.
    ///
    /// These impulses do not depend on the initial impulses or on the order of the rows. They meet the tolerance, or have a smaller
    /// residual than before.
    LeastNorm,
}

/// Limits, tolerance and method of [`Newton::solve`](crate::newton::Newton::solve). `T` has one tolerance, or one per lane.
#[derive(Clone, Copy, Debug)]
pub struct Search<T> {
    /// Largest number of Newton steps of an island, and of rounds of the outer loop; [`EXACT_RATIO`] times as many for the exact friction
    /// law.
    pub steps: u32,
    /// Residual at which the search stops, m/s.
    pub tolerance: T,
    /// Treatment of De Saxce's terms mu |v_t| of Coulomb's law.
    pub terms: Terms,
}

/// Proximal-point method on one island: its workspace and its progress.
#[derive(Clone, Debug, Default)]
pub(super) struct ProximalPoint {
    /// Convex function that a proximal step minimises.
    lagrangian: AugmentedLagrangian,
    /// Acceleration of the fixed point of De Saxce's terms mu |v_t|.
    anderson: Anderson,
    /// Velocities of all rows of the island at the current impulses, m/s.
    v: Vec<f64>,
    /// De Saxce's terms mu |v_t| at the current velocities, m/s.
    image: Vec<f64>,
    /// Impulses with the smallest residual so far.
    best: SavedImpulses,
    /// Impulses before an attempt of the exact friction law.
    before: SavedImpulses,
    /// Residual of the current impulses, m/s.
    residual: f64,
    /// Number of Newton steps in the current search.
    steps: u32,
    /// Number of rounds of the outer loop in the last search.
    pub(super) rounds: u32,
}

/// Copy of an island's impulses, with their scaled velocity change w and their residual.
#[derive(Clone, Debug, Default)]
struct SavedImpulses {
    /// Impulse of each row, N s.
    lambda: Vec<f64>,
    /// Scaled velocity change w by the impulses, in coordinates in which its kinetic energy is |w|^2 / 2.
    w: Vec<f64>,
    /// Residual of the saved impulses, m/s.
    residual: f64,
}

impl SavedImpulses {
    /// Copies the impulses of an island. `residual` is their residual, m/s.
    fn save(&mut self, rows: &Island, residual: f64) {
        self.lambda.clone_from(&rows.lambda);
        self.w.clone_from(&rows.w);
        self.residual = residual;
    }

    /// Copies the saved impulses back to an island.
    fn restore(&self, rows: &mut Island) {
        rows.lambda.clone_from(&self.lambda);
        rows.w.clone_from(&self.w);
    }
}

impl ProximalPoint {
    /// Improves the impulses of the island `rows` by proximal steps with constant De Saxce's terms mu |v_t|. Returns the number of Newton
    /// steps.
    ///
    /// The residual never increases, unless impulses of least norm are sought.
    pub(super) fn solve<R: Real>(&mut self, rows: &mut Island, search: Search<f64>) -> u32 {
        self.start(rows);
        self.reset_slip(rows);
        let mut most = largest_kappa(&self.lagrangian.slip, search.tolerance);
        let mut kappa = KAPPA[0].min(most);
        if search.terms == Terms::LeastNorm {
            // A proximal step from zero impulses. Newton's method starts at the current motion.
            rows.lambda.fill(0.0);
            self.best.residual = f64::INFINITY;
            kappa = kappa.max(KAPPA[1].min(most));
        }
        let mut implicit_kappa = kappa;
        // A failed attempt of the exact friction law doubles the number of rounds before the next one (`rounds_to_try`) and reduces its
        // kappa. A successful attempt is a proximal step and increases the next kappa. With friction it may succeed without reducing the
        // residual.
        let (mut rounds_to_try, mut next_wait) = (1, 1);
        // Kappa at which the matrix had no factors.
        let mut broken = f64::INFINITY;
        while self.steps < search.steps && self.rounds < search.steps && self.best.residual > search.tolerance && self.residual.is_finite()
        {
            self.rounds += 1;
            if rounds_to_try == 0 {
                self.lagrangian.kappa = implicit_kappa;
                let last = self.residual;
                if self.try_implicit::<R>(rows, search) && (self.residual < 0.9 * last || implicit_kappa < KAPPA[1].min(most)) {
                    implicit_kappa = (10.0 * implicit_kappa).min(KAPPA[1]).min(most);
                    next_wait = 1;
                    continue;
                }
                implicit_kappa = (implicit_kappa / 30.0).max(1.0);
                (rounds_to_try, next_wait) = (next_wait, 2 * next_wait);
            }
            rounds_to_try -= 1;
            self.lagrangian.kappa = kappa;
            let before = self.residual;
            if !self.minimise::<R>(rows, search) {
                // Repeats the step with a kappa whose matrix has factors, from the last finite result.
                rows.w.clone_from(&self.best.w);
                broken = kappa;
                kappa *= 0.01;
                if kappa < LEAST_KAPPA {
                    break;
                }
                continue;
            }
            let moved = self.accept_step(rows);
            let off = self.recompute_slip(rows);
            // A residual that remains although De Saxce's terms are right is caused by proximal steps that are too short.
            let short = self.residual > 0.1 * before && off < 0.1 * self.residual;
            most = largest_kappa(&self.lagrangian.slip, search.tolerance).min(0.01 * broken);
            let last = kappa;
            kappa = if short { 10.0 * kappa } else { kappa }.max(KAPPA[1]).min(most);
            if !moved && off == 0.0 && kappa == last {
                break;
            }
        }
        self.best.restore(rows);
        self.steps
    }

    /// Improves the impulses of the island `rows` by proximal steps with the exact friction law. Returns the number of Newton steps. The
    /// length of a proximal step depends on how well Newton's method converges.
    ///
    /// With De Saxce's terms mu |v_t| constant, the fixed-point iteration does not converge if hundreds of contacts stick, slip and open
    /// at once. A long step of the exact friction law switches too many contacts for Newton's method. A short step is a small correction,
    /// and unlike a sweep it moves all contacts together: pseudo-transient continuation (Kelley & Keyes 1998).
    pub(super) fn solve_exact<R: Real>(&mut self, rows: &mut Island, search: Search<f64>) -> u32 {
        self.start(rows);
        let small = rows.w.len() <= SMALL;
        // The other steps of the limit are for the search with constant terms.
        let ratio = if small && search.terms == Terms::ConstantThenExact { EXACT_RATIO - 1 } else { EXACT_RATIO };
        let most_steps = search.steps.saturating_mul(ratio);
        let mut kappa = FIRST_EXACT_KAPPA[usize::from(!small)];
        while self.steps < most_steps && self.best.residual > search.tolerance && self.residual.is_finite() {
            self.rounds += 1;
            self.lagrangian.kappa = kappa;
            match self.step_exactly::<R>(rows, search, most_steps) {
                Some((_, false)) if kappa >= MOST_EXACT_KAPPA => break,
                Some((steps, _)) if steps <= FEW_STEPS => kappa = (2.0 * kappa).min(MOST_EXACT_KAPPA),
                Some(_) => {}
                None if kappa <= LEAST_EXACT_KAPPA => break,
                None => kappa = (0.3 * kappa).max(LEAST_EXACT_KAPPA),
            }
        }
        // The remaining error of a sticking contact would accumulate from step to step. One more long proximal step removes nearly all of
        // it.
        if self.steps > 0 && self.best.residual <= search.tolerance {
            self.rounds += 1;
            self.lagrangian.kappa = MOST_EXACT_KAPPA;
            self.step_exactly::<R>(rows, search, most_steps.min(self.steps + LAST_STEPS));
        }
        self.best.restore(rows);
        self.steps
    }

    /// Resets the workspace for the search of an island.
    fn start(&mut self, rows: &Island) {
        self.lagrangian.reset(rows);
        (self.steps, self.rounds) = (0, 0);
        self.residual = rows.residual(&mut self.v);
        self.best.save(rows, self.residual);
    }

    /// Makes a proximal step with the exact friction law. Its error is at most a tenth of the current residual, or of the tolerance if that
    /// is larger. Returns its number of Newton steps, and whether it changed any impulse.
    ///
    /// Returns `None`, and changes nothing, if Newton's method does not converge. `most_steps` limits the Newton steps of the whole search.
    fn step_exactly<R: Real>(&mut self, rows: &mut Island, search: Search<f64>, most_steps: u32) -> Option<(u32, bool)> {
        self.before.save(rows, self.residual);
        let start = self.lagrangian.evaluate(rows, true);
        let enough = 0.1 * self.residual.max(search.tolerance);
        for taken in 1..=MOST_STEPS {
            if self.steps >= most_steps {
                break;
            }
            self.steps += 1;
            let error = self.lagrangian.advance::<R>(rows, true);
            if error <= enough {
                return Some((taken, self.accept_step(rows)));
            }
            // A NaN ends the loop too.
            if error.partial_cmp(&(10.0 * start)) != Some(std::cmp::Ordering::Less) {
                break;
            }
        }
        self.before.restore(rows);
        None
    }

    /// Sets De Saxce's terms mu |v_t| to those at the current velocities of the island, and discards the history of Anderson's
    /// acceleration.
    fn reset_slip(&mut self, rows: &Island) {
        let slips = rows.blocks.iter().map(|block| block.set.slip(&self.v[block.rows.clone()]));
        self.lagrangian.slip.clear();
        self.lagrangian.slip.extend(slips);
        self.anderson.restart(rows.blocks.len());
    }

    /// Computes the next values of De Saxce's terms mu |v_t|, with Anderson's acceleration. Returns the largest difference between the
    /// previous values and those at the current velocities, m/s.
    fn recompute_slip(&mut self, rows: &Island) -> f64 {
        self.image.clear();
        self.image.extend(rows.blocks.iter().map(|block| block.set.slip(&self.v[block.rows.clone()])));
        let off = self.image.iter().zip(&self.lagrangian.slip).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()));
        self.anderson.next(&mut self.lagrangian.slip, &self.image);
        off
    }

    /// Solves the convex problem of one proximal step with constant De Saxce's terms mu |v_t| by Newton's method. The error of the
    /// solution, m/s, is at most a hundredth of the current residual and at most 1e-5, or a tenth of the tolerance if that is larger.
    ///
    /// The search ends earlier at the largest number of Newton steps. Returns false if the matrix has no factors, or if the error is not
    /// finite.
    fn minimise<R: Real>(&mut self, rows: &mut Island, search: Search<f64>) -> bool {
        let enough = 0.1 * search.tolerance.max(0.1 * self.residual.min(1e-3));
        let mut error = self.lagrangian.evaluate(rows, false);
        // A NaN error ends the loop too.
        while error > enough && error.is_finite() && self.steps < search.steps {
            self.steps += 1;
            error = self.lagrangian.advance::<R>(rows, false);
        }
        error.is_finite()
    }

    /// Attempts a proximal step with the exact friction law. Returns whether Newton's method converged. If it did not, the impulses are
    /// unchanged.
    fn try_implicit<R: Real>(&mut self, rows: &mut Island, search: Search<f64>) -> bool {
        self.before.save(rows, self.residual);
        let mut error = self.lagrangian.evaluate(rows, true);
        let (mut least, mut patience) = (error, PATIENCE);
        while error > 0.1 * search.tolerance {
            self.steps += 1;
            error = self.lagrangian.advance::<R>(rows, true);
            // Steps that find which contacts slip need not reduce the error.
            if error < 0.9 * least {
                least = error;
            } else if patience > 0 && error.is_finite() {
                patience -= 1;
            } else {
                patience = 0;
                least = f64::NAN;
            }
            if least.is_nan() || self.steps >= search.steps {
                self.before.restore(rows);
                return false;
            }
        }
        self.accept_step(rows);
        self.reset_slip(rows);
        true
    }

    /// Replaces the impulses of an island by those of a proximal step, and saves them if their residual is the smallest so far. Returns
    /// whether any impulse has changed.
    fn accept_step(&mut self, rows: &mut Island) -> bool {
        let moved = rows.lambda != self.lagrangian.z;
        rows.lambda.copy_from_slice(&self.lagrangian.z);
        rows.compute_w();
        self.residual = rows.residual(&mut self.v);
        if self.residual < self.best.residual {
            self.best.save(rows, self.residual);
        }
        moved
    }
}

/// Largest kappa at which rounding leaves velocities within the tolerance, m/s. Kappa is the ratio of the proximal step length to the step
/// of the natural map, the function that is zero at the solution.
///
/// Velocities of rows that push are small at the end of a proximal step. They are sums of ever smaller changes, so that their rounding is
/// small however fast other bodies move. In a slipping contact, rho times De Saxce's term cancels against mu times the length of the
/// tangential argument of the projection. The difference has a rounding error of rho times that of the slip velocity.
fn largest_kappa(slip: &[f64], tolerance: f64) -> f64 {
    let fastest = slip.iter().fold(0.0, |most: f64, s| most.max(*s));
    (0.1 * tolerance / (f64::EPSILON * fastest)).clamp(LEAST_KAPPA, MOST_KAPPA)
}
