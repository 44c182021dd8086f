//! Where a drive train is on its curve: free, at a limit of its effort, or at the torque-speed curve of its motor.

use stepper_real::{Mask, Real};

use crate::actuation::forces::{Drive, Gauge, Theta, Train};
use crate::compile::{LanePlan, TrainPlan};
use crate::math::spatial::*;

/// A drive train within a step.
///
/// What it does is `f = clamp(clamp(law, limits), +-stall - drag v)`: piecewise affine in the motion, and where the law pulls back, decreasing.
/// The step takes one piece implicitly. Which one is found like the roots of such functions: solve with the present piece, go to the one where
/// that solution lies (semismooth Newton; Qi & Sun 1993).
#[derive(Clone, Copy, Debug)]
pub(super) struct Region<R: Real> {
    /// Force and weight of the law itself.
    law: (R, R),
    /// Velocity before the step.
    before: R,
    /// What it moves.
    gauge: Gauge<R>,
    /// Lanes at a limit of the effort.
    held: R::Mask,
    /// Lanes at the motor's curve.
    curve: R::Mask,
    /// Lanes in which that is the upper one.
    upper: R::Mask,
}

impl<R: Real> Default for Region<R> {
    fn default() -> Self {
        let never = R::Mask::splat(false);
        let gauge = Gauge { mobility: R::zero(), slowing: R::zero() };
        Self { law: (R::zero(), R::zero()), before: R::zero(), gauge, held: never, curve: never, upper: never }
    }
}

impl<R: Real> Region<R> {
    /// Takes up the law: its force and weight, the velocity before the step, and what it moves.
    #[inline(always)]
    pub(super) fn take(&mut self, law: (R, R), before: R, gauge: Gauge<R>) {
        (self.law, self.before, self.gauge) = (law, before, gauge);
    }

    /// Where a step begins: a law without stiffness is as it is at the velocity before the step, one with is free.
    #[inline(always)]
    pub(super) fn guess(&mut self, plan: &TrainPlan<R::Scalar>, numbers: &Train<R>) {
        let never = R::Mask::splat(false);
        (self.held, self.curve, self.upper) = (never, never, never);
        let plain = self.law.1.eq(R::zero());
        let [held, curve, upper] = whereabouts(plan, numbers, self.law.0, self.before);
        (self.held, self.curve, self.upper) = (held.and(plain), curve.and(plain), upper.and(plain));
    }

    /// Goes where the law, at a change of velocity `along` h, lies; `back` allows to leave a bound. Returns the lanes that moved.
    #[inline(always)]
    pub(super) fn place(&mut self, plan: &TrainPlan<R::Scalar>, numbers: &Train<R>, theta: Theta<R>, along: R, back: bool) -> R::Mask {
        let [mut held, mut curve, mut upper] =
            whereabouts(plan, numbers, self.law.0 - self.law.1 * along, self.before + theta.damping * along);
        if !back {
            let stays = self.held.or(self.curve).and_not(held.or(curve));
            held = held.or(self.held.and(stays));
            curve = curve.or(self.curve.and(stays));
            upper = upper.or(self.upper.and(stays));
        }
        let same = |a: R::Mask, b: R::Mask| a.and(b).or(a.or(b).not());
        let moved = same(held, self.held).and(same(curve, self.curve)).and(same(upper, self.upper)).not();
        (self.held, self.curve, self.upper) = (held, curve, upper);
        moved
    }

    /// Lanes at a bound.
    #[inline(always)]
    pub(super) fn is_cut(&self) -> R::Mask {
        self.held.or(self.curve)
    }

    /// The force here, without what the mass matrix does, and what it does.
    #[inline(always)]
    pub(super) fn force(&self, numbers: &Train<R>, theta: Theta<R>) -> (R, R) {
        let held = R::select(self.upper, numbers.limits[1], numbers.limits[0]);
        let curve = R::select(self.upper, numbers.stall, -numbers.stall) - numbers.drag * self.before;
        let force = R::select(self.curve, curve, R::select(self.held, held, self.law.0));
        let weight = R::select(self.held, R::zero(), self.law.1);
        let drag = numbers.drag * theta.damping * (R::one() + theta.share(self.gauge.rate(numbers.drag)));
        (force, R::select(self.curve, drag, weight))
    }
}

/// Lanes in which a force that the law asks for at a velocity is held at a limit, or on the motor's curve, and at the upper one of these.
#[inline(always)]
fn whereabouts<R: Real>(plan: &TrainPlan<R::Scalar>, numbers: &Train<R>, force: R, velocity: R) -> [R::Mask; 3] {
    let never = R::Mask::splat(false);
    let ([low, high], mut asked) = (numbers.limits, force);
    let (mut held, mut upper) = (never, never);
    if plan.limited {
        upper = force.gt(high);
        held = force.lt(low).or(upper);
        asked = R::select(held, force.clamp(low, high), force);
    }
    let mut curve = never;
    if plan.motor.is_some() {
        let loss = numbers.drag * velocity;
        let (above, below) = (asked.gt(numbers.stall - loss), asked.lt(-numbers.stall - loss));
        curve = above.or(below);
        upper = upper.and_not(curve).or(above);
        held = held.and_not(curve);
    }
    [held, curve, upper]
}

/// Lanes in which a force that the law asks for at a velocity is cut.
#[inline(always)]
pub(crate) fn exceeds<R: Real>(plan: &TrainPlan<R::Scalar>, numbers: &Train<R>, force: R, velocity: R) -> R::Mask {
    let [held, curve, _] = whereabouts(plan, numbers, force, velocity);
    held.or(curve)
}

/// A force within the limits and under the curve of its drive train.
#[inline(always)]
pub(crate) fn bounded<R: Real>(plan: &TrainPlan<R::Scalar>, numbers: &Train<R>, force: R, velocity: R) -> R {
    let [held, curve, upper] = whereabouts(plan, numbers, force, velocity);
    let limit = R::select(upper, numbers.limits[1], numbers.limits[0]);
    let edge = R::select(upper, numbers.stall, -numbers.stall) - numbers.drag * velocity;
    R::select(curve, edge, R::select(held, limit, force))
}

impl<R: Real> Drive<R> {
    /// What drive trains lose at their forces, or at those that are to be expected at the end of the step, left in `losses`.
    ///
    /// A gear that passes on the share e of its power gives e f to what it drives, and asks f / e of what drives it: against a motion along f it
    /// loses (1 - e) |f|, against one the other way (1/e - 1) |f|. At rest its friction is anything in between.
    pub fn lose(&mut self, plan: &LanePlan<R>, trains: &[Train<R>], expected: bool) {
        R::vectorize(
            #[inline(always)]
            || {
                self.losses.fill(zero());
                for (a, actuator) in plan.actuators.iter().enumerate() {
                    let Some(train) = &actuator.train else { continue };
                    let Some((row, arm)) = train.losses else { continue };
                    let force = if expected && plan.servos_are_bounded { self.implied[a] } else { self.force[a] };
                    let loss = losses(&trains[train.index], R::splat(arm), force);
                    self.losses[row] = add(self.losses[row], loss);
                }
            },
        )
    }

    /// Adds to the forces what drive trains lost in a step, by the impulses of their rows of dry friction.
    pub fn subtract_losses(&mut self, plan: &LanePlan<R>, trains: &[Train<R>], scalar_impulse: &[R], h: R) {
        R::vectorize(
            #[inline(always)]
            || {
                for (a, actuator) in plan.actuators.iter().enumerate() {
                    let Some(train) = &actuator.train else { continue };
                    let Some((row, arm)) = train.losses else { continue };
                    let arm = R::splat(arm);
                    let friction = scalar_impulse[plan.limits.len() + row] / h;
                    // Of a row that is shared, as much as it may take of the whole.
                    let backwards = friction.gt(R::zero());
                    let [own, all] = [losses(&trains[train.index], arm, self.force[a]), self.losses[row]].map(
                        #[inline(always)]
                        |x: [R; 2]| R::select(backwards, x[1], x[0]),
                    );
                    let whole = all + plan.params.friction(row);
                    let there = whole.gt(R::zero());
                    let share = R::select(there, own / R::select(there, whole, R::one()), R::zero());
                    let lost = friction * share;
                    self.force[a] += lost / arm;
                    self.joint[plan.frictions[row].dof] += lost;
                }
            },
        )
    }
}

/// Losses (against motion forwards, against motion backwards) on the joint.
#[inline(always)]
fn losses<R: Real>(numbers: &Train<R>, arm: R, force: R) -> [R; 2] {
    let torque = arm * force;
    let (driving, driven) = (R::one() - numbers.efficiency, R::one() / numbers.efficiency - R::one());
    let (along, against) = (torque.abs() * driving, torque.abs() * driven);
    let forwards = torque.gt(R::zero());
    let own = arm.abs() * numbers.friction;
    [own + R::select(forwards, along, against), own + R::select(forwards, against, along)]
}
