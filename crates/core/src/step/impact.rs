//! Impacts: velocities that jump within the step.

use stepper_real::{Mask, Real};
use stepper_solve::Outcome;

use super::{Rule, Scratch};
use crate::kinematics::advance;
use crate::options::Options;
use crate::plan::LanePlan;
use crate::spin;
use crate::stages::s05_solve::solve;
use crate::stages::s06_integrate_velocity::integrate_velocity;

/// Change of a link's velocity by the jump in inertial forces from which on it is worth a second solution, rad/s or m/s.
const MATTERS: f64 = 1e-5;

/// So many times what smooth forces change in a step makes a change an impact: below that, the error of the rule is that of the smooth motion.
const IMPACT: f64 = 10.0;
/// Turn within a step beyond which the velocity after the step says nothing of the forces in it, rad: then another solution is no better.
const RESOLVED: f64 = 0.02;
/// Solutions at the most: each takes the inertial forces at the velocity of the one before, which errs by the time step times as much.
const PASSES: usize = 3;

/// Stages 2, 5 and 6 again in the lanes in which constraints have stopped or turned a motion that stage 2 reckoned with.
///
/// The midpoint rule goes half of the step with the velocity before it and half with that after it, so inertial forces are the mean of those at
/// both. The first solution took them at a velocity that knew of last step's impulses alone, which after an impact is wrong by the jump: an
/// error of first order in momentum and energy, at every impact.
pub(super) fn solve_impacts<R: Real>(
    plan: &LanePlan<R>,
    options: &Options,
    rule: &Rule<R>,
    s: &mut Scratch<R>,
    mut outcome: Outcome<R>,
) -> Outcome<R> {
    for pass in 0..PASSES {
        let lanes = jumping(rule, s, pass == 0);
        if lanes.none() {
            break;
        }
        take_inertial_forces(plan, rule, s, lanes);
        let again = solve(options, &s.v, lanes, &mut s.constraints, &mut s.new_contacts);
        outcome.residual = R::select(lanes, again.residual, outcome.residual);
        outcome.sweeps += again.sweeps;
        outcome.newton += again.newton;
        integrate_velocity(plan, &s.smooth.mass, &s.v_free, &s.constraints, &mut s.v_next);
    }
    outcome
}

/// Lanes whose velocity after the step, `v_next`, is far from that which inertial forces were taken with; of the first solution, which
/// took them at the mean of the velocities and not half at each, also those in which constraints made the velocity jump.
fn jumping<R: Real>(rule: &Rule<R>, s: &Scratch<R>, first: bool) -> R::Mask {
    R::vectorize(
        #[inline(always)]
        || {
            let (mut jump, mut fastest, mut pushed, mut smooth) = (R::zero(), R::zero(), R::zero(), R::zero());
            for (((&v, &free), &next), &expected) in s.v.iter().zip(&s.v_free).zip(&s.v_next).zip(&s.expected) {
                pushed = pushed.max((next - free).abs());
                smooth = smooth.max((free - v).abs());
                jump = jump.max((next - expected).abs());
                fastest = fastest.max(v.abs()).max(next.abs());
            }
            let apart = if first { pushed * pushed * R::of(0.25) } else { R::zero() };
            let change = jump.max(pushed);
            let impact = change.gt(smooth * R::of(IMPACT)).and((rule.h * change).lt(R::of(RESOLVED)));
            let matters = impact.and((rule.h * (jump * fastest).max(apart)).gt(R::of(MATTERS)));
            // Equalities near singular positions change as suddenly, but nothing strikes there.
            let slots = s.constraints.slots.iter().map(|slot| slot.1).chain(s.constraints.wide_slots.iter().map(|slot| slot.1));
            let touching = slots.fold(R::Mask::splat(false), |all, lanes| all.or(lanes));
            touching.and(s.alive).and_not(s.unresolved).and(matters)
        },
    )
}

/// The free velocity of the lanes `lanes` with inertial forces at the velocity before the step and at `v_next`, half each.
fn take_inertial_forces<R: Real>(plan: &LanePlan<R>, rule: &Rule<R>, s: &mut Scratch<R>, lanes: R::Mask) {
    // With the forces of stage 1 as they are: what depends on the velocity in them is implicit.
    let (forces, half) = ([&s.drive.tau[..], &s.applied], rule.h * R::of(0.5));
    s.smooth.acceleration(plan, &s.kinematics, forces, &s.v, &s.v);
    advance(&s.v, &s.smooth.acc, half, &mut s.v_mean);
    s.smooth.acceleration(plan, &s.kinematics, forces, &s.v, &s.v_next);
    advance(&s.v_mean, &s.smooth.acc, half, &mut s.change);
    if !plan.spinners.is_empty() {
        spin::settle(plan, &s.kinematics, &s.smooth.mass, rule.h, [&s.v, &s.v_next], &mut s.change);
    }
    R::vectorize(
        #[inline(always)]
        || {
            for i in 0..plan.nv {
                let new = R::select(lanes, s.change[i], s.v_free[i]);
                s.change[i] = new - s.v_free[i];
                s.v_free[i] = new;
                s.expected[i] = R::select(lanes, s.v_next[i], s.expected[i]);
            }
        },
    );
    s.constraints.shift(plan, &s.smooth.mass, &mut s.change, lanes);
}
