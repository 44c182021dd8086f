//! Acceptance of a solution: whether it determines the energy, and whether the next state is finite.

use stepper_real::{Mask, Real, Scalar};
use stepper_solve::Outcome;

use crate::compile::LaneModel;
use crate::constraints::constraint_set::Constraints;
use crate::dynamics::kinematics::all_finite;
use crate::integrators::workspace::Workspace;
use crate::math::lanes::each_of;
use crate::math::spatial::*;
use crate::options::StepSettings;
use crate::stages::s05_solve::solve_to;
use crate::stages::s06_integrate_velocity::integrate_velocity;
use crate::tuning::{MAX_TRUSTED_RESIDUAL, TARGET_RATIO};

/// Lanes whose impulses do not determine the kinetic energy.
///
/// The residual is above [`MAX_TRUSTED_RESIDUAL`], or small against the velocities but not against their energy, because enormous impulses
/// cancel.
pub(crate) fn ambiguous<R: Real>(options: &StepSettings, s: &Workspace<R>, residual: R) -> R::Mask {
    let Constraints { problem, iterate, constrained, .. } = &s.constraints;
    R::vectorize(
        #[inline(always)]
        || {
            let unsolved = s.alive.and(residual.gt(R::of(MAX_TRUSTED_RESIDUAL.max(10.0 * options.tolerance))));
            let negligible = s.free_motion.smooth.mass.energy_at(R::of(options.tolerance));
            unsolved.or(s.alive.and(*constrained).and(stepper_solve::energy_is_ambiguous(problem, iterate, residual, negligible)))
        },
    )
}

/// Solves lanes again whose residual meets the tolerance but leaves the energy ambiguous.
///
/// In a jam, impulses a million times the load cancel, and the residual must be smaller by that factor.
#[inline(always)]
pub(crate) fn resolve_ambiguous<R: Real>(compiled: &LaneModel<R>, options: &StepSettings, s: &mut Workspace<R>, outcome: &mut Outcome<R>) {
    let lanes = ambiguous(options, s, outcome.residual).and(outcome.residual.le(R::of(options.tolerance)));
    if lanes.any() {
        solve_further(compiled, options, s, lanes, outcome);
    }
}

/// Solves the lanes `lanes` to the residual at which the impulses determine the energy, as far as rounding permits.
#[cold]
#[inline(never)]
fn solve_further<R: Real>(compiled: &LaneModel<R>, options: &StepSettings, s: &mut Workspace<R>, lanes: R::Mask, outcome: &mut Outcome<R>) {
    let tolerance = R::vectorize(
        #[inline(always)]
        || {
            let Constraints { problem, iterate, .. } = &s.constraints;
            let negligible = s.free_motion.smooth.mass.energy_at(R::of(options.tolerance));
            let least = R::of(10.0 * <R::Scalar as Scalar>::EPSILON.to_f64());
            (stepper_solve::max_residual_for_energy(problem, iterate, negligible) * R::of(TARGET_RATIO))
                .max(least)
                .min(R::of(options.tolerance))
        },
    );
    let (rows, mut workspace) = s.constraints.split();
    let repeated = solve_to(options, tolerance, lanes, &rows, &mut workspace, &mut s.evaluation.contacts);
    outcome.replace(&repeated, lanes);
    integrate_velocity(compiled, &s.free_motion.smooth.mass, &s.free_motion.v, &s.constraints, &mut s.next.v);
}

/// Stores the impulse of all constraints in joint coordinates, for bounded servos and the user.
pub(crate) fn keep_impulse<R: Real>(compiled: &LaneModel<R>, s: &mut Workspace<R>) {
    R::vectorize(
        #[inline(always)]
        || {
            s.state.impulse.copy_from_slice(&s.constraints.iterate.w);
            s.free_motion.smooth.mass.momentum(compiled, &mut s.state.impulse);
        },
    )
}

/// Copies the next state to the state in the lanes where it is finite, `h` seconds later, and returns these lanes.
///
/// The other lanes keep their state and lose their warm start.
#[inline(always)]
pub(crate) fn accept<R: Real>(compiled: &LaneModel<R>, s: &mut Workspace<R>, h: f64) -> R::Mask {
    let finite = R::vectorize(
        #[inline(always)]
        || {
            let mut finite = R::Mask::splat(true);
            for x in [&s.next.q, &s.next.v, &s.next.act] {
                finite = finite.and(all_finite(x));
            }
            // A NaN pose of a mocap body would hide its contacts, so that the step is rejected.
            for m in &compiled.mocap {
                finite =
                    finite.and(all_finite(&s.evaluation.kinematics.pos[m.frame])).and(all_finite(&s.evaluation.kinematics.mat[m.frame]));
            }
            finite
        },
    );
    if !finite.and(s.alive).all() {
        stay(s, finite);
    }
    let refused = s.alive.and_not(finite).bits();
    for (_, time) in s.state.time.iter_mut().enumerate().filter(|(l, _)| refused >> l & 1 == 0) {
        *time += h;
    }
    s.elapsed += h;
    // The previous state is the workspace of the next step.
    std::mem::swap(&mut s.state.q, &mut s.next.q);
    std::mem::swap(&mut s.state.v, &mut s.next.v);
    std::mem::swap(&mut s.state.act, &mut s.next.act);
    std::mem::swap(&mut s.state.contacts, &mut s.evaluation.contacts);
    finite
}

/// Lets the lanes whose next state is not finite, and those that are no environment, stay where they are; the former start cold.
#[cold]
fn stay<R: Real>(s: &mut Workspace<R>, finite: R::Mask) {
    R::vectorize(
        #[inline(always)]
        || {
            let moves = finite.and(s.alive);
            for (next, old) in [(&mut s.next.q, &s.state.q), (&mut s.next.v, &s.state.v), (&mut s.next.act, &s.state.act)] {
                for (next, &old) in next.iter_mut().zip(old) {
                    *next = R::select(moves, *next, old);
                }
            }
            let refused = s.alive.and_not(finite);
            if refused.none() {
                return;
            }
            for lambda in s.constraints.scalar_impulse.iter_mut().chain(&mut s.state.impulse) {
                *lambda = R::select(finite, *lambda, R::zero());
            }
            for l in each_of(refused.bits()) {
                s.evaluation.contacts.count[l] = 0;
            }
            for slot in &mut s.evaluation.contacts.data {
                slot.impulse = select(finite, slot.impulse, zero());
            }
            for torque in &mut s.evaluation.contacts.torque {
                *torque = select(finite, *torque, zero());
            }
        },
    )
}
