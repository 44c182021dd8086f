//! Residual of a solve: the error of the impulses, expressed as a velocity, m/s.

use crate::constraints::constraint_set::number_of;
use crate::iterate::{Iterate, energy};
use crate::problem::System;
use stepper_real::{Real, kernel};

/// Natural-map residual of the exact Coulomb problem in each lane, m/s (rad/s for angular rows).
///
/// The residual is `max_i |lambda_i - P_K(lambda_i - rho_i u_i)| / rho_i` over all active constraints i. Here lambda_i is the impulse, and
/// P_K the projection on the admissible impulses. The vector u_i is the velocity v of the rows. For a contact, De Saxce's term is added to
/// the normal velocity: `u = v + (mu |v_t|, 0, 0)`. The step is `rho_i = n / trace(G_ii)` for n rows, where G_ii is the block of the
/// Delassus matrix before elimination of equality rows.
#[inline(always)]
pub fn residual<'a, R: Real>(system: impl Into<System<'a, R>>, iterate: &Iterate<R>) -> R {
    let mut worst = R::zero();
    for_each_residual(
        system.into(),
        iterate,
        #[inline(always)]
        |r| worst = worst.max_or_nan(r),
    );
    worst
}

/// Calls `f` with the residual of each constraint, m/s: the scalar rows first, then the contacts. See [`residual`].
#[inline(always)]
#[expect(clippy::redundant_closure, reason = "a reference to the function would not be inlined")]
fn for_each_residual<R: Real>(system: System<'_, R>, iterate: &Iterate<R>, mut f: impl FnMut(R)) {
    let System { problem, scalars, contacts, .. } = system;
    problem.scalars.for_each_residual(
        scalars,
        &iterate.scalars,
        &iterate.w,
        #[inline(always)]
        |r| f(r),
    );
    problem.contacts.for_each_residual(contacts, &iterate.contacts, &iterate.w, f);
}

/// Sum of the magnitudes of the impulses of all scalar and normal rows, N s.
#[inline(always)]
fn sum_normal_impulses<R: Real>(system: System<'_, R>, iterate: &Iterate<R>) -> R {
    let sum = system.problem.scalars.sum_normal_impulses(system.scalars, &iterate.scalars, R::zero());
    system.problem.contacts.sum_normal_impulses(system.contacts, &iterate.contacts, sum)
}

/// Constraint of lane `lane` with the largest residual: its index, which counts the scalar rows first, and the residual, m/s.
///
/// `None` if all residuals are 0. A NaN counts as the largest.
pub fn worst_constraint<'a, R: Real>(system: impl Into<System<'a, R>>, iterate: &Iterate<R>, lane: usize) -> Option<(usize, f64)> {
    let system = system.into();
    kernel!(R, || {
        let mut worst = WorstConstraint::new(lane);
        for_each_residual(
            system,
            iterate,
            #[inline(always)]
            |r| worst.visit(r),
        );
        worst.worst
    })
}

/// Calls `f` for each active constraint of lane `lane`, with its coordinates (columns of the Jacobian), ascending, its residual, m/s, and
/// its normal impulse, N s.
pub fn for_each_load<'a, R: Real>(
    system: impl Into<System<'a, R>>,
    iterate: &Iterate<R>,
    lane: usize,
    mut f: impl FnMut(&mut dyn Iterator<Item = u32>, f64, f64),
) {
    let System { problem, scalars, contacts, .. } = system.into();
    problem.scalars.for_each_load(scalars, &iterate.scalars, &iterate.w, lane, &mut f);
    problem.contacts.for_each_load(contacts, &iterate.contacts, &iterate.w, lane, &mut f);
}

/// Search for the constraint of one lane with the largest error. It visits the scalar rows first, then the contacts.
pub(crate) struct WorstConstraint {
    lane: usize,
    /// Index of the next constraint. The caller sets it to 0 to begin again with the first constraint, for errors of another kind.
    pub(crate) next: usize,
    /// Index of the constraint with the largest error, and this error; `None` if all errors are 0.
    pub(crate) worst: Option<(usize, f64)>,
}

impl WorstConstraint {
    pub(crate) fn new(lane: usize) -> Self {
        Self { lane, next: 0, worst: None }
    }

    /// Compares the error of the next constraint with the largest one. A NaN counts as the largest.
    #[inline(always)]
    pub(crate) fn visit<R: Real>(&mut self, error: R) {
        let (error, most) = (number_of(error, self.lane), self.worst.map_or(0.0, |(_, most)| most));
        if error > most || error.is_nan() {
            self.worst = Some((self.next, error));
        }
        self.next += 1;
    }
}

/// Largest residual at which the impulses determine the kinetic energy, m/s, see [`energy_is_ambiguous`]. `negligible`, J, is added to the
/// kinetic energy.
#[inline(always)]
pub fn max_residual_for_energy<'a, R: Real>(system: impl Into<System<'a, R>>, iterate: &Iterate<R>, negligible: R) -> R {
    let impulse = sum_normal_impulses(system.into(), iterate);
    (energy(&iterate.w) + negligible) / impulse.max(R::of(f64::from(f32::MIN_POSITIVE)))
}

/// Lanes in which the impulses do not determine the kinetic energy, because of their residual.
///
/// An error of `residual` in all scalar and normal rows i has the work `residual sum_i |lambda_i|`. Residuals above 1e-6 m/s count as 1e-6
/// m/s. The energy is ambiguous if this work exceeds the kinetic energy |w|^2 / 2 of the velocity change plus `negligible`, J. This occurs
/// in a jam with almost no lever arm, where impulses a million times the load cancel. `negligible` excludes unloaded contacts, whose
/// impulses and velocities are both rounding error.
#[inline(always)]
pub fn energy_is_ambiguous<'a, R: Real>(system: impl Into<System<'a, R>>, iterate: &Iterate<R>, residual: R, negligible: R) -> R::Mask {
    let impulse = sum_normal_impulses(system.into(), iterate);
    (residual.min(R::of(1e-6)) * impulse).gt(energy(&iterate.w) + negligible)
}
