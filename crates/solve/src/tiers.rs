//! Both tiers: sweeps over all lanes, then Newton's method for each lane that they leave.

use crate::newton::Newton;
use crate::{Iterate, Problem, pgs};
use stepper_real::Real;

/// How much each tier may do, and when it is enough.
#[derive(Clone, Copy, Debug)]
pub struct Settings<R> {
    /// Sweeps at the most; at least one is made.
    pub sweeps: u32,
    /// Newton steps at the most, per island; 0 leaves the second tier out.
    pub newton: u32,
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
    /// Newton steps made, over all islands.
    pub newton: R,
}

/// Improves the impulses of the lanes `lanes` until each meets the tolerance or the settings are used up.
pub fn solve<R: Real>(
    problem: &Problem<R>,
    iterate: &mut Iterate<R>,
    settings: Settings<R>,
    lanes: R::Mask,
    room: &mut Newton,
) -> Outcome<R> {
    let Settings { sweeps, newton, tolerance } = settings;
    let swept = pgs::solve(problem, iterate, pgs::Settings { sweeps, tolerance }, lanes);
    let mut outcome = Outcome { residual: swept.residual, sweeps: swept.sweeps, newton: R::zero() };
    if newton > 0 {
        room.solve(problem, iterate, newton, tolerance, lanes, [&mut outcome.residual, &mut outcome.newton]);
    }
    outcome
}
