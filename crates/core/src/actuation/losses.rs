//! Friction losses of actuator dynamics: dry friction, and losses of the gear in proportion to the force.

use stepper_real::{Mask, Real, kernel};

use crate::actuation::affine_force::ActuatorDynamics;
use crate::actuation::forces::{ActuatorForces, ImplicitServos, ServoInput};
use crate::compile::LaneModel;
use crate::math::spatial::*;

impl<R: Real> ActuatorForces<R> {
    /// Computes the friction losses of actuator dynamics at the forces `self.force` and the velocity `v` into `losses`.
    ///
    /// `expected` has the implicit servos and the free acceleration. With it, a model with bounded servos uses the whole forces that servos
    /// are expected to have in the step, instead of `self.force`.
    ///
    /// A gear with efficiency e delivers e f to the load, and needs f / e if the load drives it. The friction is (1 - e) |f| in motion
    /// along f, and (1/e - 1) |f| in motion against f. At rest it is anything in between.
    ///
    /// Dry friction follows Stribeck's curve (Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30, 1994). A step takes it at the
    /// velocity before the step: with an expected velocity, a joint at rest would break away below its friction at rest.
    pub(crate) fn compute_losses(
        &mut self,
        compiled: &LaneModel<R>,
        actuator_dynamics: &[ActuatorDynamics<R>],
        v: &[R],
        expected: Option<(ImplicitServos<R>, &[R])>,
    ) {
        kernel!(R, || {
            self.losses.fill(zero());
            for (a, actuator) in compiled.actuators.iter().enumerate() {
                let Some(dynamics) = &actuator.dynamics else { continue };
                let Some((row, arm)) = dynamics.losses else { continue };
                let force = match (expected, actuator.servo) {
                    (Some((implicit, acc)), Some(servo)) if compiled.servos_are_bounded => {
                        self.expected_servo_force(ServoInput { compiled, actuator_dynamics, implicit }, servo, acc)
                    }
                    _ => self.force[a],
                };
                let loss = losses(&actuator_dynamics[dynamics.index], R::splat(arm), force, v[compiled.frictions[row].dof]);
                self.losses[row] = add(self.losses[row], loss);
            }
        })
    }

    /// Subtracts the friction losses of actuator dynamics in a step from the actuator forces.
    ///
    /// The losses follow from the impulses of the dry friction rows, which `scalar_impulse` has after those of the limits. `v` is the
    /// velocity at which the losses were computed, and `h` the time step, s.
    pub fn subtract_losses(
        &mut self,
        compiled: &LaneModel<R>,
        actuator_dynamics: &[ActuatorDynamics<R>],
        v: &[R],
        scalar_impulse: &[R],
        h: R,
    ) {
        kernel!(R, || {
            for (a, actuator) in compiled.actuators.iter().enumerate() {
                let Some(dynamics) = &actuator.dynamics else { continue };
                let Some((row, arm)) = dynamics.losses else { continue };
                let arm = R::splat(arm);
                let friction = scalar_impulse[compiled.limits.len() + row] / h;
                // Several losses may share a row. Each gets its fraction of the row's force.
                let backwards = friction.gt(R::zero());
                let v = v[compiled.frictions[row].dof];
                let [own, all] = [losses(&actuator_dynamics[dynamics.index], arm, self.force[a], v), self.losses[row]].map(
                    #[inline(always)]
                    |x: [R; 2]| R::select(backwards, x[1], x[0]),
                );
                let whole = all + compiled.params.friction(row);
                let there = whole.gt(R::zero());
                let share = R::select(there, own / R::select(there, whole, R::one()), R::zero());
                let lost = friction * share;
                self.force[a] += lost / arm;
                self.without_springs[compiled.frictions[row].dof] += lost;
            }
        })
    }
}

/// Friction losses of an actuator, as forces on its joint, N or N m: against forward motion, and against backward motion. `v` is the
/// velocity of the joint.
#[inline(always)]
fn losses<R: Real>(numbers: &ActuatorDynamics<R>, arm: R, force: R, v: R) -> [R; 2] {
    let torque = arm * force;
    let (driving, driven) = (R::one() - numbers.efficiency, R::one() / numbers.efficiency - R::one());
    let (along, against) = (torque.abs() * driving, torque.abs() * driven);
    let forwards = torque.gt(R::zero());
    let falls = numbers.stribeck_friction.gt(R::zero());
    let mut at_speed = R::zero();
    if falls.any() {
        let ratio = arm * v / numbers.stribeck_velocity;
        at_speed = R::select(falls, numbers.stribeck_friction * (-(ratio * ratio)).exp(), at_speed);
    }
    let own = arm.abs() * (numbers.friction + at_speed);
    [own + R::select(forwards, along, against), own + R::select(forwards, against, along)]
}
