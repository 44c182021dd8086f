//! Stage 1: actions and state become generalized forces.

use stepper_real::Real;

use crate::drive::{At, Drive, Theta, along, within};
use crate::kinematics::quat_at;
use crate::model::{Activation, JointKind};
use crate::plan::{ActuatorPlan, LanePlan};
use crate::spatial::*;

/// Forces of actuators and springs, N or N m, and what servos add to the mass matrix; joint damping and the stiffness of joints are added
/// in stage 2. Servos that are at a bound of their force stay there until [`Drive::release`].
pub fn actuate<R: Real>(plan: &LanePlan<R>, at: &At<'_, R>, theta: Option<Theta<R>>, drive: &mut Drive<R>) {
    R::vectorize(
        #[inline(always)]
        || {
            for (i, (actuator, &u)) in plan.actuators.iter().zip(at.ctrl).enumerate() {
                let input = match actuator.act {
                    Some(a) => at.act[a],
                    None => control(u, actuator.ctrl_range),
                };
                match (theta, actuator.servo) {
                    (Some(theta), Some(k)) => {
                        let (force, weight) = servo_force(actuator, plan.params.actuator(i), at, input, theta);
                        drive.set_servo(i, k, force, weight);
                    }
                    _ => drive.force[i] = within(affine_force(actuator, plan.params.actuator(i), at, input), actuator.force_range),
                }
            }
            gather(plan, at.q, theta.is_some(), drive);
        },
    )
}

/// The forces of `drive` on the joints, with those of springs: what [`actuate`] ends with, for when a servo's force changed.
pub fn regather<R: Real>(plan: &LanePlan<R>, q: &[R], drive: &mut Drive<R>) {
    R::vectorize(
        #[inline(always)]
        || gather(plan, q, true, drive),
    )
}

#[inline(always)]
fn gather<R: Real>(plan: &LanePlan<R>, q: &[R], implicit: bool, drive: &mut Drive<R>) {
    drive.gather(plan, implicit);
    add_springs(plan, q, &mut drive.tau);
}

/// A control within its range. One that is infinite is no control: it becomes NaN, and the environment is refused.
#[inline(always)]
fn control<R: Real>(u: R, range: Option<[R::Scalar; 2]>) -> R {
    R::select(u.is_finite(), within(u, range), R::of(f64::NAN))
}

/// force = gain . (1, length, velocity) input + bias . (1, length, velocity)
#[inline(always)]
fn affine_force<R: Real>(actuator: &ActuatorPlan<R::Scalar>, [gain, bias]: [V3<R>; 2], at: &At<'_, R>, input: R) -> R {
    if !actuator.needs_motion {
        return gain[0] * input + bias[0];
    }
    let (length, velocity) = (length(actuator, at.q), along(actuator, at.v_at));
    (gain[0] + gain[1] * length + gain[2] * velocity) * input + (bias[0] + bias[1] * length + bias[2] * velocity)
}

/// The same without what the mass matrix does, and what it does: stiffness and damping against the motion are implicit, the rest is not.
#[inline(always)]
fn servo_force<R: Real>(actuator: &ActuatorPlan<R::Scalar>, [gain, bias]: [V3<R>; 2], at: &At<'_, R>, input: R, theta: Theta<R>) -> (R, R) {
    let [level, slope, rate]: V3<R> = std::array::from_fn(|k| gain[k] * input + bias[k]);
    let (stiffness, damping) = ((-slope).max(R::zero()), (-rate).max(R::zero()));
    let (velocity, implicit) = (along(actuator, at.v_at), along(actuator, at.v));
    let force = level + slope * length(actuator, at.q) + (rate * velocity + damping * (velocity - implicit));
    (force, damping * theta.damping + stiffness * theta.stiffness)
}

#[inline(always)]
fn length<R: Real>(actuator: &ActuatorPlan<R::Scalar>, q: &[R]) -> R {
    let mut sum = R::zero();
    for &(at, _, arm) in &actuator.moment {
        sum += R::splat(arm) * q[at];
    }
    sum
}

#[inline(always)]
fn add_springs<R: Real>(plan: &LanePlan<R>, q: &[R], tau: &mut [R]) {
    for (j, joint) in plan.joints.iter().enumerate().filter(|(_, joint)| joint.sprung) {
        let k = plan.params.spring(j);
        let rest = |i: usize| R::splat(joint.rest[i]);
        let (mut at, mut dof, mut i) = (joint.q, joint.v, 0);
        if joint.kind != JointKind::Ball {
            let scalars = if joint.kind == JointKind::Free { 3 } else { 1 };
            for s in 0..scalars {
                tau[dof + s] -= k * (q[at + s] - rest(s));
            }
            (at, dof, i) = (at + scalars, dof + scalars, scalars);
        }
        if matches!(joint.kind, JointKind::Ball | JointKind::Free) {
            let back = [rest(i), -rest(i + 1), -rest(i + 2), -rest(i + 3)];
            let twist = quat_log(quat_mul(back, quat_at(q, at)));
            for s in 0..3 {
                tau[dof + s] -= k * twist[s];
            }
        }
    }
}

/// The activation after `h` seconds at the rates that belong to `rate_at`: `out = act + h rate(rate_at)`, clamped; exact lags use `act`.
pub fn advance_activation<R: Real>(plan: &LanePlan<R>, act: &[R], rate_at: &[R], ctrl: &[R], h: R, out: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
            for (actuator, &u) in plan.actuators.iter().zip(ctrl) {
                let Some(a) = actuator.act else { continue };
                let u = control(u, actuator.ctrl_range);
                let next = match actuator.activation {
                    Activation::None => act[a],
                    Activation::Integrator => act[a] + h * u,
                    Activation::Filter(tau) => act[a] + h * ((u - rate_at[a]) / R::of(tau)),
                    Activation::FilterExact(tau) => u + (act[a] - u) * (-(h / R::of(tau))).exp(),
                };
                out[a] = within(next, actuator.act_range);
            }
        },
    )
}

/// Rates of the activations at `act`, 1/s.
pub fn activation_rate<R: Real>(plan: &LanePlan<R>, act: &[R], ctrl: &[R], out: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
            for (actuator, &u) in plan.actuators.iter().zip(ctrl) {
                let Some(a) = actuator.act else { continue };
                let u = control(u, actuator.ctrl_range);
                out[a] = match actuator.activation {
                    Activation::None => R::zero(),
                    Activation::Integrator => u,
                    Activation::Filter(tau) | Activation::FilterExact(tau) => (u - act[a]) / R::of(tau),
                };
            }
        },
    )
}
