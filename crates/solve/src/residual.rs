//! The certificate: how far the impulses are from solving the problem, in m/s.

use crate::constraints::ConstraintSet;
use crate::iterate::Iterate;
use crate::problem::Problem;
use stepper_real::Real;

/// Natural-map residual of the exact Coulomb problem, per lane, m/s (rad/s for angular rows):
/// `max_i |lambda_i - P_K(lambda_i - rho_i u_i)| / rho_i` with `rho_i = n / trace(G_ii)` for n rows, before elimination of separate
/// ones, and De Saxce's `u = v + (mu |v_t|, 0, 0)`.
#[inline(always)]
pub fn residual<R: Real>(problem: &Problem<R>, iterate: &Iterate<R>) -> R {
    let mut worst = R::zero();
    worst = problem.scalars.residual(&iterate.scalars, &iterate.w, worst);
    worst = problem.contacts.residual(&iterate.contacts, &iterate.w, worst);
    problem.rolling_contacts.residual(&iterate.rolling_contacts, &iterate.w, worst)
}

/// Lanes in which the work that a residual of `residual` m/s (at most 1e-6) leaves open, `residual sum_i |lambda_i|`, is more than the
/// kinetic energy |w|^2 / 2 of the whole change: impulses cancel there, a million times what they hold, where a jam has hardly a lever arm.
#[inline(always)]
pub fn undecided<R: Real>(problem: &Problem<R>, iterate: &Iterate<R>, residual: R) -> R::Mask {
    let mut impulse = problem.scalars.sum_normal_impulses(&iterate.scalars, R::zero());
    impulse = problem.contacts.sum_normal_impulses(&iterate.contacts, impulse);
    impulse = problem.rolling_contacts.sum_normal_impulses(&iterate.rolling_contacts, impulse);
    let mut energy = R::zero();
    for &w in &iterate.w {
        energy += w * w;
    }
    (residual.min(R::of(1e-6)) * impulse).gt(energy * R::of(0.5))
}
