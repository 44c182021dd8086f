//! Stage 1: computes generalized forces from controls and state. [`crate::actuation::forces`] explains explicit parts, added inertia and
//! active bounds.

use stepper_real::{Mask, Real, kernel};

use crate::actuation::affine_force::{AffineForce, Motion, exceeds_range, within};
use crate::actuation::force_limits::{ForceLimits, clamp_to_limits};
use crate::actuation::forces::{ActuatorForces, ForceState, ImplicitServos, ServoInput};
use crate::actuation::muscle::{activation_rate_of_muscle, muscle_force};
use crate::compile::{ActuatorParams, CompiledActuator, LaneModel, MotorControl};
use crate::dynamics::kinematics::quat_at;
use crate::math::spatial::*;
use crate::model::{Activation, JointKind};

/// Computes the forces of actuators and springs, N or N m, and the added inertia of servos.
///
/// Stage 2 adds joint damping. It also adds the implicit terms of servos, springs and damping to the mass matrix. If `implicit` is `None`,
/// all forces are explicit. Otherwise the first call after [`ActuatorForces::reset_active_bounds`] guesses the active bounds of servos
/// (none, a force limit, or the torque-speed curve); later calls keep them.
pub fn actuate<R: Real>(
    compiled: &LaneModel<R>,
    at: &ForceState<'_, R>,
    implicit: Option<ImplicitServos<R>>,
    actuator_forces: &mut ActuatorForces<R>,
) {
    let servo_input = implicit.map(|implicit| ServoInput { compiled, actuator_dynamics: at.actuator_dynamics, implicit });
    kernel!(R, || {
        for (i, actuator) in compiled.actuators.iter().enumerate() {
            let input = force_input(compiled, i, at);
            let Some(k) = actuator.servo else {
                let ActuatorParams { gain, bias } = compiled.params.actuator(i);
                let requested = gain[0] * input + bias[0];
                let force = within(requested, actuator.force_range);
                actuator_forces.found_saturated[i] = exceeds_range(requested, actuator.force_range);
                actuator_forces.force[i] = match &actuator.dynamics {
                    Some(dynamics) => {
                        let (numbers, saturated) = (&at.actuator_dynamics[dynamics.index], &mut actuator_forces.found_saturated[i]);
                        let limited = clamp_to_limits(ForceLimits { dynamics, numbers }, force, R::zero());
                        *saturated = saturated.or(limited.is_limited);
                        limited.force
                    }
                    None => force,
                };
                continue;
            };
            let motion = actuator_forces.motion(actuator, at.q, at.v_at, at.v);
            let parameters = compiled.params.actuator(i);
            let input = nearest_equivalent_angle(actuator, parameters, input, motion.length);
            let affine = affine_force(
                actuator,
                parameters,
                at,
                input,
                #[inline(always)]
                || motion,
            );
            actuator_forces.found_saturated[i] = R::Mask::splat(false);
            // With `implicit`, servos of actuator dynamics are always implicit, and other servos if the scheme makes `all` implicit.
            match (servo_input, &actuator.dynamics) {
                (Some(servo_input), Some(dynamics)) => {
                    actuator_forces.set_limited_servo(servo_input, [i, k], dynamics, &affine, &motion);
                }
                (Some(ServoInput { implicit: ImplicitServos { weights, all: true, .. }, .. }), None) => {
                    let (force, added_inertia) =
                        affine.explicit_part_and_added_inertia(&motion, actuator_forces.effective_inertias[k], weights);
                    actuator_forces.set_servo(i, k, force, added_inertia);
                }
                (None, Some(dynamics)) => {
                    let numbers = &at.actuator_dynamics[dynamics.index];
                    let limited = clamp_to_limits(ForceLimits { dynamics, numbers }, affine.force(&motion), motion.velocity);
                    (actuator_forces.force[i], actuator_forces.found_saturated[i]) = (limited.force, limited.is_limited);
                }
                (_, None) => {
                    let requested = affine.force(&motion);
                    actuator_forces.found_saturated[i] = exceeds_range(requested, actuator.force_range);
                    actuator_forces.set_servo(i, k, within(requested, actuator.force_range), R::zero());
                }
            }
            if let Some(servo_input) = servo_input.filter(|input| input.implicit.predicted && compiled.servos_are_bounded) {
                // `motion.velocity` is v + (weights.damping / h) (v+ - v), where weights.damping is h / 2 or h. `dv` is thus the
                // predicted change v+ - v.
                let ImplicitServos { h, weights, .. } = servo_input.implicit;
                let dv = (motion.velocity - motion.before) * (h / weights.damping);
                actuator_forces.clamp_at_predicted_velocity(servo_input, k, dv);
            }
        }
        if let Some(servo_input) = servo_input.filter(|_| actuator_forces.needs_guess()) {
            actuator_forces.guess_active_bounds(servo_input);
        }
        actuator_forces.sum_forces(compiled, implicit);
        // With explicit forces, derivatives and sensors read the generalized forces of the actuators without those of springs.
        if implicit.is_none() {
            actuator_forces.without_springs.copy_from_slice(&actuator_forces.tau);
        }
        add_springs(compiled, at.q, &mut actuator_forces.tau);
    })
}

/// Computes the added inertia of every servo from its damping alone, into `forces.added_inertia`: the time step `h` times the damping
/// coefficient, which may be negative. Integrators that treat only the damping of servos implicitly use this function.
///
/// The added inertia is zero if the servo's force is at a bound. The caller must have called [`actuate`] with `implicit` = `None`.
pub(crate) fn set_added_inertia_by_damping<R: Real>(compiled: &LaneModel<R>, at: &ForceState<'_, R>, h: R, forces: &mut ActuatorForces<R>) {
    kernel!(R, || {
        for (k, servo) in compiled.servos.iter().enumerate() {
            let [_, rate] = slopes(compiled, at, servo.actuator, forces);
            forces.added_inertia[k] = -(h * rate);
        }
    })
}

/// Stiffness and damping of a servo: minus the derivatives of its force with respect to length and velocity. A negative coefficient, which
/// would amplify the motion, becomes 0. Both are 0 if the force is at a bound.
#[inline(always)]
pub(crate) fn servo_stiffness_and_damping<R: Real>(
    compiled: &LaneModel<R>,
    at: &ForceState<'_, R>,
    actuator: usize,
    forces: &ActuatorForces<R>,
) -> [R; 2] {
    slopes(compiled, at, actuator, forces).map(
        #[inline(always)]
        |x| (-x).max(R::zero()),
    )
}

/// Derivatives of an actuator's force with respect to its length and its velocity; zero where the force is at a bound.
#[inline(always)]
fn slopes<R: Real>(compiled: &LaneModel<R>, at: &ForceState<'_, R>, actuator: usize, forces: &ActuatorForces<R>) -> [R; 2] {
    let own = &compiled.actuators[actuator];
    let input = force_input(compiled, actuator, at);
    let AffineForce { level, slope, rate } = affine_force(
        own,
        compiled.params.actuator(actuator),
        at,
        input,
        #[inline(always)]
        || forces.motion(own, at.q, at.v, at.v),
    );
    let mut at_bound = forces.is_at_bound(compiled, actuator);
    if let Some(dynamics) = &own.dynamics {
        let limits = ForceLimits { dynamics, numbers: &at.actuator_dynamics[dynamics.index] };
        let velocity = forces.project(own, at.v);
        let requested = AffineForce { level, slope, rate }.force(&forces.motion(own, at.q, at.v, at.v));
        at_bound = at_bound.or(clamp_to_limits(limits, requested, velocity).is_limited);
    }
    [slope, rate].map(
        #[inline(always)]
        |x| R::select(at_bound, R::zero(), x),
    )
}

/// Input of the force of actuator `i`: its control, or its activation.
///
/// `at.act` is already the activation at the evaluation point (`advance_activations`). The control acts only through it. An early
/// activation is that at the end of the step.
#[inline(always)]
fn force_input<R: Real>(compiled: &LaneModel<R>, i: usize, at: &ForceState<'_, R>) -> R {
    let (actuator, u) = (&compiled.actuators[i], at.ctrl[i]);
    let Some(a) = actuator.act else { return control(u, actuator.ctrl_range) };
    let act = at.act[a];
    if actuator.early { next_activation(actuator, setpoint(compiled, i, actuator, u, act), [act; 2], at.time_left) } else { act }
}

/// Control `u`, clamped to its range. An infinite control becomes NaN, so that the step is rejected.
#[inline(always)]
fn control<R: Real>(u: R, range: Option<[R::Scalar; 2]>) -> R {
    R::select(u.is_finite(), within(u, range), R::of(f64::NAN))
}

/// Setpoint `input` of an angle, shifted by full rotations to the equivalent angle nearest to `angle`, as in MuJoCo. A servo then takes the
/// shorter way to its setpoint.
///
/// Only actuators whose length is an angle, and which have no actuator model, are concerned. Such an input is a setpoint if the
/// actuator's gain is constant and equals minus the bias coefficient of the length. Other inputs stay as they are.
#[inline(always)]
fn nearest_equivalent_angle<R: Real>(
    actuator: &CompiledActuator<R::Scalar>,
    ActuatorParams { gain, bias }: ActuatorParams<R>,
    input: R,
    angle: R,
) -> R {
    let Some(turn) = actuator.variable_moment.as_ref().and_then(|w| w.turn) else { return input };
    if actuator.dynamics.is_some() {
        return input;
    }
    let turn = R::splat(turn);
    let nearest = input - turn * ((input - angle) / turn).round_even();
    let gain_is_constant = gain[1].eq(R::zero()).and(gain[2].eq(R::zero()));
    R::select(gain_is_constant.and(gain[0].eq(-bias[1])), nearest, input)
}

/// Input of an activation's differential equation: the control `u`, clamped to its range. A filter of an angular servo gets the equivalent
/// angle nearest to the activation `at`.
#[inline(always)]
fn setpoint<R: Real>(compiled: &LaneModel<R>, i: usize, actuator: &CompiledActuator<R::Scalar>, u: R, at: R) -> R {
    let u = control(u, actuator.ctrl_range);
    match actuator.activation {
        Activation::Filter(_) | Activation::FilterExact(_) => nearest_equivalent_angle(actuator, compiled.params.actuator(i), u, at),
        Activation::None | Activation::Integrator | Activation::Muscle { .. } => u,
    }
}

/// Affine force of an actuator: gain . (1, length, velocity) * input + bias . (1, length, velocity). The force of a muscle is linearised at
/// `motion`, which other actuators do not need.
///
/// With actuator dynamics that contain a continuous servo, slope and rate are those of the servo. A motor with voltage control multiplies
/// the force by its stall torque and subtracts its back-EMF.
#[inline(always)]
fn affine_force<R: Real>(
    actuator: &CompiledActuator<R::Scalar>,
    ActuatorParams { gain, bias }: ActuatorParams<R>,
    at: &ForceState<'_, R>,
    input: R,
    motion: impl FnOnce() -> Motion<R>,
) -> AffineForce<R> {
    let [mut level, mut slope, mut rate]: V3<R> = std::array::from_fn(|k| gain[k] * input + bias[k]);
    if let Some(muscle) = &actuator.muscle {
        let force = muscle_force(muscle, input, &motion());
        (level, slope, rate) = (level + force.level, slope + force.slope, rate + force.rate);
    }
    let Some(dynamics) = &actuator.dynamics else { return AffineForce { level, slope, rate } };
    let numbers = &at.actuator_dynamics[dynamics.index];
    if dynamics.continuous_servo {
        (slope, rate) = (numbers.slope, numbers.rate);
    }
    match dynamics.motor {
        Some(MotorControl::Voltage) => {
            AffineForce { level: level * numbers.stall, slope: slope * numbers.stall, rate: rate * numbers.stall - numbers.back_emf }
        }
        _ => AffineForce { level, slope, rate },
    }
}

/// Adds the generalized forces of joint springs at the configuration `q` to `tau`.
#[inline(always)]
fn add_springs<R: Real>(compiled: &LaneModel<R>, q: &[R], tau: &mut [R]) {
    for (j, joint) in compiled.joints.iter().enumerate().filter(|(_, joint)| joint.sprung) {
        let k = compiled.params.spring(j);
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

/// Advances the activations `act` by `time` seconds into `out`, clamped to their ranges.
///
/// `rate_at` are the activations at which the function evaluates the rate: for a whole step those at the evaluation point, for a part of a
/// step `act`. MuJoCo's `filterexact` needs no rate: its solution from `act`, with decay exp(-time/tau), is exact for a constant setpoint.
pub fn advance_activation<R: Real>(compiled: &LaneModel<R>, act: &[R], rate_at: &[R], ctrl: &[R], time: R, out: &mut [R]) {
    if out.is_empty() {
        return;
    }
    kernel!(R, || {
        for (i, (actuator, &u)) in compiled.actuators.iter().zip(ctrl).enumerate() {
            let Some(a) = actuator.act else { continue };
            out[a] = next_activation(actuator, setpoint(compiled, i, actuator, u, rate_at[a]), [act[a], rate_at[a]], time);
        }
    })
}

/// Activation `act` of an actuator with the input `u`, advanced by `time` seconds and clamped to its range. `rate_at` is the activation at
/// which the rate is evaluated.
#[inline(always)]
fn next_activation<R: Real>(actuator: &CompiledActuator<R::Scalar>, u: R, [act, rate_at]: [R; 2], time: R) -> R {
    let next = match actuator.activation {
        Activation::None => act,
        Activation::Integrator => act + time * u,
        Activation::Filter(tau) => act + time * ((u - rate_at) / R::of(tau)),
        Activation::Muscle { rise, fall, smoothing } => act + time * activation_rate_of_muscle(u, rate_at, [rise, fall, smoothing]),
        Activation::FilterExact(tau) => u + (act - u) * (-(time / R::of(tau))).exp(),
    };
    within(next, actuator.act_range)
}

/// Clamps the activations `act` to their ranges.
#[inline(always)]
pub fn clamp_activation<R: Real>(compiled: &LaneModel<R>, act: &mut [R]) {
    for actuator in &compiled.actuators {
        if let Some(a) = actuator.act {
            act[a] = within(act[a], actuator.act_range);
        }
    }
}

/// Computes the time derivatives of the activations at `act`, 1/s, into `out`.
pub fn activation_rate<R: Real>(compiled: &LaneModel<R>, act: &[R], ctrl: &[R], out: &mut [R]) {
    kernel!(R, || {
        for (i, (actuator, &u)) in compiled.actuators.iter().zip(ctrl).enumerate() {
            let Some(a) = actuator.act else { continue };
            let u = setpoint(compiled, i, actuator, u, act[a]);
            out[a] = match actuator.activation {
                Activation::None => R::zero(),
                Activation::Integrator => u,
                Activation::Filter(tau) | Activation::FilterExact(tau) => (u - act[a]) / R::of(tau),
                Activation::Muscle { rise, fall, smoothing } => activation_rate_of_muscle(u, act[a], [rise, fall, smoothing]),
            };
        }
    })
}
