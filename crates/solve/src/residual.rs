//! The certificate: how far the impulses are from solving the problem, in m/s.

use crate::cone::{clamp, distance, keep, norm2, project};
use crate::{Iterate, Problem};
use stepper_real::Real;

/// Natural-map residual of the exact Coulomb problem, per lane, m/s (rad/s for angular rows):
/// `max_i |lambda_i - P_K(lambda_i - rho_i u_i)| / rho_i` with `rho_i = n / trace(G_ii)` for n rows, before separate
/// ones were taken out of them, and De Saxce's `u = v + (mu |v_t|, 0, 0)`.
#[inline(always)]
pub fn residual<R: Real>(problem: &Problem<R>, iterate: &Iterate<R>) -> R {
    let mut worst = R::zero();
    for (row, &lambda) in problem.scalars.iter().zip(&iterate.scalars) {
        let v = problem.scalar_velocity(row, &iterate.w) + row.compliance * lambda;
        let (mut rho, mut inv_rho) = (row.inv_diagonal, row.diagonal);
        if problem.separate > 0 {
            (rho, inv_rho) = (rho / row.whole, inv_rho * row.whole);
        }
        let mapped = clamp(lambda - rho * v, row.lo, row.hi);
        worst = worse(worst, keep(row.active, (lambda - mapped).abs() * inv_rho));
    }
    for (block, &lambda) in problem.contacts.iter().zip(&iterate.contacts) {
        let v = problem.contact_velocity_under(block, &iterate.w, &lambda);
        let u = [v[0] + block.mu * norm2(v[1], v[2]), v[1], v[2]];
        let moved = [lambda[0] - block.rho * u[0], lambda[1] - block.rho * u[1], lambda[2] - block.rho * u[2]];
        let mapped = project(moved, block.mu);
        worst = worse(worst, keep(block.active, distance(lambda, mapped) * block.inv_rho));
    }
    for (block, &lambda) in problem.wide.iter().zip(&iterate.wide) {
        let v = problem.wide_velocity_under(block, &iterate.w, &lambda);
        let mut slip = v[1] * v[1];
        for &v in &v[2..] {
            slip += v * v;
        }
        let mut moved = lambda;
        for k in 0..6 {
            moved[k] -= block.rho * v[k];
        }
        moved[0] -= block.rho * (block.mu * slip.sqrt());
        worst = worse(worst, keep(block.active, distance(lambda, project(moved, block.mu)) * block.inv_rho));
    }
    worst
}

/// Lanes in which what a residual of `residual` m/s (at most 1e-6) leaves open of the impulses' work, `residual sum_i |lambda_i|`, is more than the
/// kinetic energy |w|^2 / 2 of all that they change: impulses that cancel, a million times what they hold, where a jam has hardly a lever.
#[inline(always)]
pub fn undecided<R: Real>(problem: &Problem<R>, iterate: &Iterate<R>, residual: R) -> R::Mask {
    let (mut impulse, mut energy) = (R::zero(), R::zero());
    for (row, &lambda) in problem.scalars.iter().zip(&iterate.scalars) {
        impulse += keep(row.active, lambda.abs());
    }
    for (block, lambda) in problem.contacts.iter().zip(&iterate.contacts) {
        impulse += keep(block.active, lambda[0]);
    }
    for (block, lambda) in problem.wide.iter().zip(&iterate.wide) {
        impulse += keep(block.active, lambda[0]);
    }
    for &w in &iterate.w {
        energy += w * w;
    }
    (residual.min(R::of(1e-6)) * impulse).gt(energy * R::of(0.5))
}

/// The larger; a NaN on the right wins, so that it is never hidden.
#[inline(always)]
fn worse<R: Real>(a: R, b: R) -> R {
    R::select(b.le(a), a, b)
}
