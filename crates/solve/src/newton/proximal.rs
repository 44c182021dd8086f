//! Outer loop of Newton's method: proximal steps of one island, from its warm start to the tolerance.
//!
//! A proximal step with kappa changes the impulses as if each row had the additional compliance 1 / rho, which acts on the change alone
//! (`ProximalStep`). With a large kappa, too many contacts change their mode for Newton's method to converge. A short step is a small
//! correction, and unlike a sweep it moves all contacts together: pseudo-transient continuation (Kelley & Keyes 1998). Its length depends
//! on how well Newton's method converges. Long steps from zero impulses give those of least norm (in the metric of 1/rho) if many impulses
//! are possible.
//!
//! Every loop has a bound. A search makes at most [`STEPS_RATIO`] times `Search::steps` Newton steps, and as many rounds. Besides its
//! Newton steps, each round evaluates the problem at most twice. The search ends when proximal steps with the largest kappa make no
//! progress.

use crate::newton::island::Island;
use crate::newton::proximal_step::ProximalStep;
use stepper_real::{Real, kernel};

/// First kappa: the ratio of the proximal step length to the step of the natural map, the function that is zero at the solution.
///
/// Measured on 107 problems of a G1, a Panda, two arms, a heap of thirty boxes and a wall: 10, 30, 100 and 300 need 5.7, 6.5, 8.1 and 9.8
/// Newton steps for the G1, 11.5, 11.0, 12.3 and 15.7 for the wall.
const FIRST_KAPPA: f64 = 30.0;
/// First kappa of a search for impulses of least norm.
const LEAST_NORM_KAPPA: f64 = 1e5;
/// Smallest kappa. If a proximal step with this kappa fails, the search ends.
const LEAST_KAPPA: f64 = 0.3;
/// Largest kappa. Nearly dependent rows need it. Newton's matrix is the identity plus kappa times another matrix; at this kappa the
/// identity is still above the rounding error.
const MOST_KAPPA: f64 = 1e12;
/// Kappa of the last proximal step, made after the tolerance has been met. It is left out if a contact slips and a constraint has another
/// mode with this kappa.
///
/// Measured on 455 searches of robots, grasps, heaps and a wall: this step converged in 43 of 53 searches without another mode, and in 6 of
/// 402 with one.
const LAST_KAPPA: f64 = 1e6;
/// Ratio of the residuals after and before a proximal step with the largest kappa above which the search ends.
const LEAST_PROGRESS: f64 = 0.9;
/// Error of a proximal step, as a fraction of the residual before the step.
const INNER_ERROR: f64 = 0.3;
/// Largest number of Newton steps of a proximal step. The step fails earlier if its error grows tenfold.
const MOST_STEPS: u32 = 6;
/// Largest number of Newton steps of a proximal step after which the next proximal step is longer.
const FEW_STEPS: u32 = 3;
/// Largest number of Newton steps of the last proximal step.
const LAST_STEPS: u32 = 2;
/// Largest number of Newton steps of an island, as a multiple of the limit that the caller sets.
pub const STEPS_RATIO: u32 = 6;

/// Limits and tolerance of [`Newton::solve`](crate::newton::Newton::solve). `T` has one tolerance, or one per lane.
#[derive(Clone, Copy, Debug)]
pub struct Search<T> {
    /// Limit of Newton steps of an island, and of rounds of the outer loop: they are at most [`STEPS_RATIO`] times this number.
    pub steps: u32,
    /// Residual at which the search stops, m/s.
    pub tolerance: T,
    /// Whether the search is for impulses of least norm (in the metric of 1/rho). They do not depend on the initial impulses or on the
    /// order of the rows. They meet the tolerance, or reduce the residual or its product with the sum of all impulses (a bound of the
    /// energy error).
    pub least_norm: bool,
}

/// Proximal-point method on one island: its workspace and its progress.
#[derive(Clone, Debug, Default)]
pub(super) struct ProximalPoint {
    /// Equation of the current proximal step.
    step: ProximalStep,
    /// Impulses with the smallest residual so far.
    best: SavedImpulses,
    /// Residual of `best`, m/s.
    best_residual: f64,
    /// Impulses before the current proximal step.
    before: SavedImpulses,
    /// Residual of the current impulses, m/s.
    residual: f64,
    /// Number of Newton steps in the current search.
    steps: u32,
    /// Number of rounds of the outer loop in the last search.
    pub(super) rounds: u32,
}

/// Copy of an island's impulses, with their scaled velocity change w.
#[derive(Clone, Debug, Default)]
struct SavedImpulses {
    /// Impulse of each row, N s.
    lambda: Vec<f64>,
    /// Scaled velocity change w by the impulses, in coordinates in which its kinetic energy is |w|^2 / 2.
    w: Vec<f64>,
}

impl SavedImpulses {
    /// Copies the impulses of an island.
    fn save(&mut self, rows: &Island) {
        self.lambda.clone_from(&rows.lambda);
        self.w.clone_from(&rows.w);
    }

    /// Copies the saved impulses back to an island.
    fn restore(&self, rows: &mut Island) {
        rows.lambda.clone_from(&self.lambda);
        rows.w.clone_from(&self.w);
    }
}

impl ProximalPoint {
    /// Improves the impulses of the island `rows`, whose residual is `residual`, m/s, by proximal steps. Returns the number of
    /// Newton steps.
    ///
    /// The residual never increases, unless impulses of least norm are sought.
    pub(super) fn solve<R: Real>(&mut self, rows: &mut Island, residual: f64, search: Search<f64>) -> u32 {
        self.step.reset(rows);
        (self.steps, self.rounds) = (0, 0);
        (self.residual, self.best_residual) = (residual, residual);
        self.best.save(rows);
        let most_steps = search.steps.saturating_mul(STEPS_RATIO);
        let (mut kappa, mut inner_error) = (FIRST_KAPPA, INNER_ERROR * self.residual.max(search.tolerance));
        // Whether the error of a proximal step must be below the tolerance, however large the residual is.
        let mut is_exact = false;
        if search.least_norm {
            // A proximal step from zero impulses. Newton's method starts at the current motion.
            rows.lambda.fill(0.0);
            self.best_residual = f64::INFINITY;
            (kappa, inner_error) = (LEAST_NORM_KAPPA, 0.1 * search.tolerance);
        }
        while self.steps < most_steps && self.best_residual > search.tolerance && self.residual.is_finite() {
            self.rounds += 1;
            let last = self.residual;
            match self.make_step::<R>(rows, kappa, inner_error, most_steps) {
                Some(_) if kappa >= MOST_KAPPA && self.residual > LEAST_PROGRESS * last => {
                    if is_exact {
                        break;
                    }
                    // Further Newton steps of the same proximal step reduce the rounding error of the velocities.
                    is_exact = true;
                }
                Some(1) => kappa = (10.0 * kappa).min(MOST_KAPPA),
                Some(steps) if steps <= FEW_STEPS => kappa = (3.0 * kappa).min(MOST_KAPPA),
                Some(_) => {}
                None if kappa <= LEAST_KAPPA || is_exact => break,
                None => kappa = (0.3 * kappa).max(LEAST_KAPPA),
            }
            inner_error = if is_exact { 0.1 * search.tolerance } else { INNER_ERROR * self.residual.max(search.tolerance) };
        }
        // The remaining error of a held body would accumulate from one time step to the next. One more proximal step with a large kappa
        // removes nearly all of it. Where a contact slips and another mode follows, such a step seldom converges.
        let is_solved = self.steps > 0 && self.steps < most_steps && self.best_residual <= search.tolerance;
        if is_solved && (rows.fastest_slip() <= search.tolerance || kernel!(R, || self.step.keeps_modes(rows, LAST_KAPPA))) {
            self.rounds += 1;
            self.make_step::<R>(rows, LAST_KAPPA, 0.1 * search.tolerance, most_steps.min(self.steps + LAST_STEPS));
        }
        self.best.restore(rows);
        self.steps
    }

    /// Makes a proximal step with an error of at most `enough`, m/s. Returns its number of Newton steps.
    ///
    /// Returns `None`, and changes no impulse, if Newton's method does not converge. `most_steps` limits the Newton steps of the whole
    /// search.
    fn make_step<R: Real>(&mut self, rows: &mut Island, kappa: f64, enough: f64, most_steps: u32) -> Option<u32> {
        self.step.kappa = kappa;
        self.before.save(rows);
        let start = kernel!(R, || self.step.evaluate(rows));
        for taken in 1..=MOST_STEPS {
            if self.steps >= most_steps {
                break;
            }
            self.steps += 1;
            let error = self.step.advance::<R>(rows);
            if error <= enough {
                kernel!(R, || self.accept_step(rows));
                return Some(taken);
            }
            // A NaN ends the loop too.
            if error.partial_cmp(&(10.0 * start)) != Some(std::cmp::Ordering::Less) {
                break;
            }
        }
        self.before.restore(rows);
        None
    }

    /// Replaces the impulses of an island by those of a proximal step, and saves them if their residual is the smallest so far.
    #[inline(always)]
    fn accept_step(&mut self, rows: &mut Island) {
        rows.lambda.copy_from_slice(&self.step.z);
        rows.compute_w();
        self.residual = rows.residual();
        if self.residual < self.best_residual {
            self.best_residual = self.residual;
            self.best.save(rows);
        }
    }
}
