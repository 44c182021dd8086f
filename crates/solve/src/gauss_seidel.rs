//! Projected Gauss-Seidel with the exact solution of every contact's local problem, and Anderson's acceleration: the fast solver.
//!
//! A sweep (one iteration) visits the rows in a fixed order. Each row gets the impulse that solves it while all other impulses stay
//! constant. A lane stops when its residual meets the tolerance, or after the largest number of sweeps. Later sweeps of other lanes do not
//! change its impulses, because every update is masked.

mod acceleration;
pub(crate) mod history;
mod sweep;

use crate::constraints::constraint_set::SweepLanes;
use crate::gauss_seidel::acceleration::reset_history;
use crate::gauss_seidel::sweep::Progress;
use crate::iterate::Iterate;
use crate::outcome::Outcome;
use crate::problem::{Problem, System};
use crate::residual::residual;
use stepper_real::{Mask, Real, kernel};

/// Limits of a solve by sweeps (Gauss-Seidel iterations).
#[derive(Clone, Copy, Debug)]
pub struct SweepSettings<R> {
    /// Largest number of sweeps (Gauss-Seidel iterations). At least one is made.
    pub sweeps: u32,
    /// Residual at which a lane is solved, m/s.
    pub tolerance: R,
}

/// Largest number of sweeps that any settings allow. Lanes count their sweeps in floating point, and floats of 32 bits cannot count beyond
/// it.
const MOST_SWEEPS: u32 = 1 << 24;

/// Improves the impulses of the lanes `lanes` until each lane meets the tolerance or has made the largest number of sweeps.
///
/// A sweep is one Gauss-Seidel iteration over all rows. A lane pauses when a sweep changes no velocity by more than the lane's threshold,
/// which is cheap to test. When all lanes have paused, the residual is evaluated. A lane above the tolerance then continues with a lower
/// threshold. It makes at least one sweep before the next evaluation, so that there are no more evaluations than sweeps.
pub fn solve<'a, R: Real>(
    system: impl Into<System<'a, R>>,
    iterate: &mut Iterate<R>,
    settings: SweepSettings<R>,
    lanes: R::Mask,
) -> Outcome<R> {
    let system = system.into();
    kernel!(R, || {
        let tolerance = settings.tolerance;
        let mut progress = Progress::new(lanes, tolerance, settings.sweeps.clamp(1, MOST_SWEEPS));
        iterate.solve_eliminated(system, lanes);
        let (mut worst, mut unsolved) = (R::zero(), lanes);
        while unsolved.any() {
            sweep_until_paused(system, iterate, &mut progress);
            if !system.needs_residual {
                unsolved = unsolved.and_not(progress.sweeps.lt(R::of(progress.most_sweeps)));
                if unsolved.none() {
                    break;
                }
            }
            worst = R::select(unsolved, residual(system, iterate), worst);
            unsolved = unsolved.and(worst.gt(tolerance)).and(progress.sweeps.lt(R::of(progress.most_sweeps)));
            progress.running = unsolved;
            progress.threshold = R::select(unsolved, progress.threshold * R::of(0.25), progress.threshold);
        }
        Outcome { residual: worst, sweeps: progress.sweeps, newton_steps: R::zero() }
    })
}

/// Replaces the impulses of the lanes `lanes` by the result of `sweeps` Gauss-Seidel iterations from zero. This estimate depends on the
/// problem alone.
pub fn sweep_from_zero<R: Real>(problem: &Problem<R>, iterate: &mut Iterate<R>, sweeps: u32, lanes: R::Mask) {
    let system = problem.into();
    kernel!(R, || {
        iterate.clear_impulses(lanes);
        iterate.solve_eliminated(system, lanes);
        for _ in 0..sweeps {
            iterate.sweep(system, SweepLanes { running: lanes, exact: lanes });
        }
    })
}

/// Estimates impulses by sweeps (Gauss-Seidel iterations) in the lanes `moving`, after solving the eliminated rows of the lanes `lanes`. A
/// lane stops when a sweep changes no velocity by more than the tolerance, or at the largest number of sweeps.
///
/// The residual is not evaluated. Lanes outside `moving` keep all impulses except those of eliminated rows.
pub fn estimate<R: Real>(problem: &Problem<R>, iterate: &mut Iterate<R>, settings: SweepSettings<R>, lanes: R::Mask, moving: R::Mask) {
    let system = problem.into();
    kernel!(R, || {
        let mut progress = Progress::new(moving, settings.tolerance, settings.sweeps);
        iterate.solve_eliminated(system, lanes);
        if moving.any() {
            sweep_until_paused(system, iterate, &mut progress);
        }
    })
}

/// Sweeps until every lane has paused. If the solve needs its residual (`System::needs_residual`), the scaled velocity change w is then
/// exactly the sum over the impulses, to the last bit.
#[inline(always)]
fn sweep_until_paused<R: Real>(system: System<'_, R>, iterate: &mut Iterate<R>, progress: &mut Progress<R>) {
    // All lanes restart without history, no matter when they paused. Their results then do not depend on other lanes.
    reset_history(iterate);
    while progress.running.any() {
        progress.sweep(system, iterate);
    }
    if system.needs_residual && progress.extrapolated.any() {
        iterate.recompute_w(system.problem, progress.extrapolated);
        progress.extrapolated = R::Mask::splat(false);
    }
}
