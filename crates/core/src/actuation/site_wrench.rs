//! Lengths, velocities and moment arms of actuators. The moment arms of actuators on sites depend on the configuration.

use stepper_real::{Real, kernel};

use crate::actuation::affine_force::Motion;
use crate::actuation::forces::ActuatorForces;
use crate::compile::{CompiledActuator, CompiledWrench, LaneModel, Spot};
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;

impl<R: Real> ActuatorForces<R> {
    /// Computes moment arms and lengths of the actuators on sites at the configuration of `kinematics`.
    ///
    /// Lengths relative to a reference site are extrapolated with the velocity `v` by `time` seconds.
    pub fn transmit(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R], time: R) {
        if self.lengths.is_empty() {
            return;
        }
        kernel!(R, || {
            for actuator in &compiled.actuators {
                let Some(wrench) = &actuator.site_wrench else { continue };
                self.lengths[wrench.index] = compute_arms(compiled, kinematics, wrench, &mut self.arms[wrench.arms..]);
                if wrench.reference.is_some() {
                    let ahead = self.project(actuator, v) * time;
                    self.lengths[wrench.index] += ahead;
                }
            }
        })
    }

    /// Projection a . x of a generalized vector `x` onto an actuator's moment a.
    #[inline(always)]
    pub(crate) fn project(&self, actuator: &CompiledActuator<R::Scalar>, x: &[R]) -> R {
        let mut sum = R::zero();
        for &(_, dof, arm) in &actuator.moment {
            sum += R::splat(arm) * x[dof];
        }
        if let Some(wrench) = &actuator.site_wrench {
            for (&(dof, _), &arm) in wrench.dofs.iter().zip(&self.arms[wrench.arms..]) {
                sum += arm * x[dof];
            }
        }
        sum
    }

    /// Length of an actuator at the configuration `q`, multiplied by its gear. For an actuator on a site, it is the length from the last
    /// call of [`ActuatorForces::transmit`].
    #[inline(always)]
    pub(crate) fn length_of(&self, actuator: &CompiledActuator<R::Scalar>, q: &[R]) -> R {
        if let Some(wrench) = &actuator.site_wrench {
            return self.lengths[wrench.index];
        }
        let mut sum = R::zero();
        for &(at, _, arm) in &actuator.moment {
            sum += R::splat(arm) * q[at];
        }
        sum
    }

    /// Motion of an actuator: its length ([`ActuatorForces::length_of`]), its velocity for explicit forces, and its velocity before the
    /// step.
    ///
    /// The first velocity follows from the generalized velocity `v_at`, and the second from `v`.
    #[inline(always)]
    pub(crate) fn motion(&self, actuator: &CompiledActuator<R::Scalar>, q: &[R], v_at: &[R], v: &[R]) -> Motion<R> {
        Motion { length: self.length_of(actuator, q), velocity: self.project(actuator, v_at), before: self.project(actuator, v) }
    }

    /// Length of the actuator with index `actuator`, multiplied by its gear. It is computed as in [`ActuatorForces::length_of`].
    pub fn length(&self, compiled: &LaneModel<R>, actuator: usize, q: &[R]) -> R {
        kernel!(R, || self.length_of(&compiled.actuators[actuator], q))
    }

    /// Time derivative of the length of the actuator with index `actuator` at the velocity `v`.
    pub fn rate(&self, compiled: &LaneModel<R>, actuator: usize, v: &[R]) -> R {
        kernel!(R, || self.project(&compiled.actuators[actuator], v))
    }
}

/// Position (m) and rotation matrix of a site in the world frame.
#[inline(always)]
fn pose<R: Real>(kinematics: &Kinematics<R>, place: &Spot<R::Scalar>) -> (V3<R>, M3<R>) {
    (kinematics.point(place.frame, splat(place.pos)), mat_mul(&kinematics.mat[place.frame], &splat(place.mat)))
}

/// Computes the moment arms of an actuator on a site into `arms`, and returns the actuator's length. `wrench` has the site, the reference
/// site, and the force and torque per unit of the actuator's force.
///
/// The length is the scalar product of the wrench with the site's position and rotation vector in the reference site's frame; 0 without a
/// reference site.
#[inline(always)]
fn compute_arms<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, wrench: &CompiledWrench<R::Scalar>, arms: &mut [R]) -> R {
    let (pos, mat) = pose(kinematics, &wrench.site);
    let w: [R; 6] = splat(wrench.wrench);
    let (force, torque) = ([w[0], w[1], w[2]], [w[3], w[4], w[5]]);
    let (mut frame, mut length, mut other) = (mat, R::zero(), pos);
    if let Some(reference) = &wrench.reference {
        let (from, axes) = pose(kinematics, reference);
        let line = rotate_back(&axes, sub(pos, from));
        let turn = rotate_back(&axes, quat_log(mat_to_quat(&mat_mul_transposed(&mat, &axes))));
        length = dot(force, line) + dot(torque, turn);
        (frame, other) = (axes, from);
    }
    let (force, torque) = (rotate(&frame, force), rotate(&frame, torque));
    for (&(dof, side), arm) in wrench.dofs.iter().zip(arms) {
        let axis = &kinematics.axes[dof];
        let at = if side > <R::Scalar>::default() { pos } else { other };
        let moved = velocity_at(axis, sub(at, kinematics.origin[compiled.dofs[dof].tree]));
        *arm = R::splat(side) * (dot(force, moved) + dot(torque, angular(axis)));
    }
    length
}
