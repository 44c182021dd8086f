//! Stage 1: actions and state become generalized forces.

use stepper_real::{Real, Scalar};

use crate::kinematics::quat_at;
use crate::model::{Activation, JointKind};
use crate::plan::{ActuatorPlan, Plan};
use crate::spatial::*;

/// Forces of actuators and joint springs at (q, v), N or N m. Joint damping is not here: stage 2 takes it implicitly.
pub fn actuate<R: Real>(plan: &Plan<R::Scalar>, q: &[R], v: &[R], act: &[R], ctrl: &[R], tau: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
            tau.fill(R::zero());
            for (actuator, &u) in plan.actuators.iter().zip(ctrl) {
                let input = match actuator.act {
                    Some(a) => act[a],
                    None => within(u, actuator.ctrl_range),
                };
                let force = within(affine_force(actuator, q, v, input), actuator.force_range);
                for &(_, dof, arm) in &actuator.moment {
                    tau[dof] += R::splat(arm) * force;
                }
            }
            for &(dof, lo, hi) in &plan.actuator_force_ranges {
                tau[dof] = tau[dof].clamp(R::splat(lo), R::splat(hi));
            }
            add_springs(plan, q, tau);
        },
    )
}

/// force = gain . (1, length, velocity) input + bias . (1, length, velocity)
#[inline(always)]
fn affine_force<R: Real>(actuator: &ActuatorPlan<R::Scalar>, q: &[R], v: &[R], input: R) -> R {
    let (gain, bias): (V3<R>, V3<R>) = (splat(actuator.gain), splat(actuator.bias));
    if !actuator.needs_motion {
        return gain[0] * input + bias[0];
    }
    let (mut length, mut velocity) = (R::zero(), R::zero());
    for &(at, dof, arm) in &actuator.moment {
        length += R::splat(arm) * q[at];
        velocity += R::splat(arm) * v[dof];
    }
    (gain[0] + gain[1] * length + gain[2] * velocity) * input + (bias[0] + bias[1] * length + bias[2] * velocity)
}

#[inline(always)]
fn within<R: Real>(x: R, range: Option<[R::Scalar; 2]>) -> R {
    match range {
        // A NaN must not turn into a bound: it stays, and the environment is refused in stage 6.
        Some([lo, hi]) => R::select(x.eq(x), x.clamp(R::splat(lo), R::splat(hi)), x),
        None => x,
    }
}

#[inline(always)]
fn add_springs<R: Real>(plan: &Plan<R::Scalar>, q: &[R], tau: &mut [R]) {
    for joint in &plan.joints {
        if joint.stiffness.to_f64() == 0.0 {
            continue;
        }
        let k = R::splat(joint.stiffness);
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
pub fn advance_activation<R: Real>(plan: &Plan<R::Scalar>, act: &[R], rate_at: &[R], ctrl: &[R], h: R, out: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
            for (actuator, &u) in plan.actuators.iter().zip(ctrl) {
                let Some(a) = actuator.act else { continue };
                let u = within(u, actuator.ctrl_range);
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
pub fn activation_rate<R: Real>(plan: &Plan<R::Scalar>, act: &[R], ctrl: &[R], out: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
            for (actuator, &u) in plan.actuators.iter().zip(ctrl) {
                let Some(a) = actuator.act else { continue };
                let u = within(u, actuator.ctrl_range);
                out[a] = match actuator.activation {
                    Activation::None => R::zero(),
                    Activation::Integrator => u,
                    Activation::Filter(tau) | Activation::FilterExact(tau) => (u - act[a]) / R::of(tau),
                };
            }
        },
    )
}
