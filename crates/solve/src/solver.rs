//! Solver of the constraint problem, which combines sweeps (Gauss-Seidel iterations) with Newton's method.
//!
//! First Newton's method finds a least-norm solution in newly loaded lanes: those in which redundant supports take up load for the first
//! time. Then some sweeps improve all lanes that are not solved. Then Newton's method and sweeps alternate in each unsolved lane. In newly
//! loaded lanes the alternation ends after its first run of Newton's method, because more sweeps would undo the even distribution of the
//! load.

use crate::cone::masked;
use crate::gauss_seidel::{self, SweepSettings};
use crate::iterate::Iterate;
use crate::newton::{Newton, Search};
use crate::outcome::Outcome;
use crate::problem::System;
use crate::residual::residual;
use serde::{Deserialize, Serialize};
use stepper_real::{Mask, Real, Scalar, kernel};

/// Limits of a solve.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Settings<R> {
    /// Largest number of sweeps (Gauss-Seidel iterations) in each pass. A pass is a number of sweeps followed by Newton steps. A lane that
    /// sweeps makes at least one sweep.
    pub sweeps: u32,
    /// Limit of Newton steps in each pass, per island: they are at most [`STEPS_RATIO`](crate::newton::STEPS_RATIO) times this number. A
    /// pass is a number of sweeps followed by Newton steps. With 0, Newton's method is not used.
    pub newton_steps: u32,
    /// Residual at which a lane is solved, m/s.
    pub tolerance: R,
    /// Residual above which a lane continues with Newton's method after the sweeps, m/s; at least the tolerance.
    pub newton_threshold: R,
    /// Residual at which the caller accepts impulses, m/s; at least the tolerance. If all contacts of a lane stick at such a residual, they
    /// do not slip in the result of Newton's method.
    pub accepted_residual: R,
}

impl<R: Real> Settings<R> {
    /// Settings with the limits `sweeps` and `newton_steps`, and with `tolerance` for all residuals, m/s.
    #[inline(always)]
    pub const fn new(sweeps: u32, newton_steps: u32, tolerance: R) -> Self {
        Self { sweeps, newton_steps, tolerance, newton_threshold: tolerance, accepted_residual: tolerance }
    }
}

impl<R> Settings<R> {
    /// Settings with the residuals that the function `f` returns for those of these settings.
    pub(crate) fn map<T>(self, f: impl Fn(R) -> T) -> Settings<T> {
        let Self { sweeps, newton_steps, .. } = self;
        let [tolerance, newton_threshold, accepted_residual] = [self.tolerance, self.newton_threshold, self.accepted_residual].map(f);
        Settings { sweeps, newton_steps, tolerance, newton_threshold, accepted_residual }
    }
}

/// Residual that the distribution of a load over redundant supports must meet, m/s. Newton's method solves newly loaded lanes above it for
/// impulses of least norm. In 32 bits, ten machine epsilons replace it. With a larger value, the distribution would depend on the order of
/// the supports.
///
/// Measured on a table of four legs that slides for half a second at 0.1 ms (scene 15 of docs/benchmarks/atlas.md). The order of its legs
/// changes the result by 2e-6 m with the value 1e-8, by 1e-7 m with 1e-9.
const LEAST_NORM_GOAL: f64 = 1e-9;

/// Speed above which a loaded contact counts as slipping, m/s. Its friction torque then depends on the distribution of the load.
const SLIPS: f64 = 1e-6;

/// Ratio of slip speeds after and before a pass with Newton's method, above which the pass made sticking contacts slip. The speed before
/// counts as at least the accepted residual.
///
/// Evidence: a mesh of 0.1 kg, held by 1.14 times the critical friction and shaken for 30 s, slips by 4.7 mm without the limit.
const MAX_SLIP_RATIO: f64 = 10.0;

/// Largest number of passes of a solve. Each pass makes sweeps and then Newton steps.
///
/// The two methods give each other a better start: sweeps find which contacts slip, and Newton's method solves problems with very different
/// masses.
///
/// Measured with an earlier Newton method on 32 of safety-gymnasium's racecars and doggos under random control, 400 steps. With one, two
/// and three passes between the first and the last, 0.17, 0.16 and 0.11 % of the racecar's steps are unsolved, and 0.27, 0.06 and 0.06 % of
/// the doggo's.
pub const PASSES: usize = 4;

/// Largest number of sweeps of the first pass, if Newton's method may follow. The other lanes of a group wait for lanes that need more.
///
/// Measured with the scenes of many contacts: with 12 sweeps a heap of thirty boxes takes 0.88 of the time, a standing wall 1.4 times as
/// long. In 32 bits, 25 instead of 50 sweeps change the time by 0.97 (0.92 to 1.05).
const FIRST_SWEEPS: u32 = 25;

/// Improves the impulses of the lanes `lanes` until each meets the tolerance or the limits in `settings` are reached.
///
/// Newly loaded lanes, in which redundant supports take up load for the first time, begin with Newton's method from zero impulses. Sweeps
/// would favour the rows that they visit first.
pub fn solve<'a, R: Real>(
    system: impl Into<System<'a, R>>,
    iterate: &mut Iterate<R>,
    settings: Settings<R>,
    lanes: R::Mask,
    newton: &mut Newton,
) -> Outcome<R> {
    let system = system.into();
    kernel!(R, || {
        let Settings { sweeps, newton_steps, tolerance, newton_threshold, accepted_residual } = settings;
        let mut outcome = Outcome { residual: R::zero(), sweeps: R::zero(), newton_steps: R::zero() };
        let (mut rest, newly_loaded) = (lanes, lanes.and(system.problem.newly_loaded));
        if newton_steps > 0 && newly_loaded.any() {
            let goal = R::of(LEAST_NORM_GOAL).max(R::of(<R::Scalar as Scalar>::EPSILON.to_f64() * 10.0));
            let (before, slip) = kernel!(R, || {
                iterate.solve_eliminated(system, newly_loaded);
                (residual(system, iterate), fastest_slip(system, iterate))
            });
            outcome.residual = masked(newly_loaded, before);
            let redistributed = newly_loaded.and(before.gt(goal).or(slip.gt(R::of(SLIPS))));
            let search = Search { steps: newton_steps, tolerance: goal, least_norm: true };
            newton.solve(system, iterate, search, redistributed, [&mut outcome.residual, &mut outcome.newton_steps]);
            // A newly loaded lane that meets its tolerance needs no sweeps, with one exception: a lane that hardly moves, whose tolerance
            // is the goal or less. There, sweeps bring the motion to rest, and hardly change the distribution of the load.
            rest = lanes.and_not(newly_loaded.and(outcome.residual.le(tolerance)).and(tolerance.gt(goal)));
        }
        let first_sweeps = if newton_steps > 0 { sweeps.min(FIRST_SWEEPS) } else { sweeps };
        sweep_lanes(system, iterate, SweepSettings { sweeps: first_sweeps, tolerance }, rest, &mut outcome);
        let mut left = lanes.and(outcome.residual.gt(newton_threshold));
        if newton_steps == 0 || left.none() {
            return outcome;
        }
        let search = Search { steps: newton_steps, tolerance, least_norm: false };
        let sweeps = SweepSettings { sweeps, tolerance };
        // A position correction whose residual need not be exact makes one pass. The next step corrects the remaining errors.
        let passes = if system.needs_residual { PASSES } else { 1 };
        for pass in 0..passes {
            left = left.and(outcome.residual.gt(newton_threshold));
            if left.none() {
                break;
            }
            let (mut snapshot, before) = (std::mem::take(&mut iterate.snapshot), outcome.residual);
            snapshot.save(iterate, left);
            // Coulomb's law may have several solutions. Contacts that stick within the accepted residual are in one of them.
            let accepted = left.and(before.le(accepted_residual)).and_not(newly_loaded);
            let slip_before = if accepted.any() { fastest_slip(system, iterate) } else { R::zero() };
            let mut worse = if pass == 0 { R::Mask::splat(false) } else { left };
            if pass > 0 {
                sweep_lanes(system, iterate, sweeps, left, &mut outcome);
            }
            let unsolved = left.and(outcome.residual.gt(newton_threshold));
            newton.solve(system, iterate, search, unsolved, [&mut outcome.residual, &mut outcome.newton_steps]);
            // A pass after the first that increases the residual is undone. So is a pass that makes sticking contacts slip.
            worse = worse.and_not(outcome.residual.le(before));
            if accepted.any() {
                let most = slip_before.max(accepted_residual) * R::of(MAX_SLIP_RATIO);
                let leaves = accepted.and(fastest_slip(system, iterate).gt(most));
                (worse, left) = (worse.or(leaves), left.and_not(leaves));
            }
            snapshot.restore(iterate, worse);
            outcome.residual = R::select(worse, before, outcome.residual);
            iterate.snapshot = snapshot;
            // In newly loaded lanes, more sweeps would undo the even distribution of the load.
            left = left.and_not(newly_loaded);
        }
        outcome
    })
}

/// Largest slip speed of all contacts with a positive normal impulse, m/s.
#[inline(always)]
fn fastest_slip<R: Real>(system: System<'_, R>, iterate: &Iterate<R>) -> R {
    system.problem.contacts.fastest_slip(system.contacts, &iterate.contacts, &iterate.w)
}

/// Improves the impulses of the lanes `lanes` by sweeps, and updates the outcome.
#[inline(always)]
fn sweep_lanes<R: Real>(
    system: System<'_, R>,
    iterate: &mut Iterate<R>,
    settings: SweepSettings<R>,
    lanes: R::Mask,
    outcome: &mut Outcome<R>,
) {
    if lanes.any() {
        outcome.replace(&gauss_seidel::solve(system, iterate, settings, lanes), lanes);
    }
}
