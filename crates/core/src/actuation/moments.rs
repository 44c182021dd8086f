//! Lengths, velocities and moment arms of actuators. A variable moment has arms that depend on the configuration: that of an actuator on a
//! site or spatial tendon, or of a slider-crank.

use stepper_real::{Real, kernel};

use crate::actuation::affine_force::Motion;
use crate::actuation::forces::ActuatorForces;
use crate::compile::{CompiledActuator, LaneModel, MomentKind, Spot, VariableMoment};
use crate::dynamics::kinematics::{Kinematics, quat_at};
use crate::math::spatial::*;

impl<R: Real> ActuatorForces<R> {
    /// Computes arms and lengths of variable moments at the configuration `q`, with the poses `kinematics`.
    ///
    /// Arms of actuators on contacts are 0 until `set_adhesive_arms` (`collision/adhesion.rs`) sets them. Lengths are extrapolated with the
    /// velocity `v` by `time` seconds.
    pub fn transmit(&mut self, compiled: &LaneModel<R>, (kinematics, q): (&Kinematics<R>, &[R]), (v, time): (&[R], R)) {
        if self.lengths.is_empty() {
            return;
        }
        kernel!(R, || {
            for actuator in &compiled.actuators {
                let Some(moment) = &actuator.variable_moment else { continue };
                let arms = &mut self.arms[moment.arms..];
                self.lengths[moment.index] = match &moment.kind {
                    MomentKind::Site { site, reference, wrench } => {
                        compute_site_arms(compiled, kinematics, (site, reference.as_ref()), splat(*wrench), moment, arms)
                    }
                    MomentKind::Path { path, first, gear } => {
                        let gear = R::splat(*gear);
                        for (arm, &of_path) in arms[..moment.dofs.len()].iter_mut().zip(&kinematics.paths.arms[*first..]) {
                            *arm = gear * of_path;
                        }
                        gear * kinematics.paths.lengths[*path]
                    }
                    MomentKind::Joint { q: at, free, in_parent, wrench: [force, torque] } => {
                        let (rotation, mut torque) = (quat_at(q, *at), splat(*torque));
                        let length = if *free { R::zero() } else { dot(quat_log(rotation), torque) };
                        if *in_parent {
                            torque = rotate_back(&quat_to_mat(rotation), torque);
                        }
                        let arms = &mut arms[..moment.dofs.len()];
                        if *free {
                            arms[..3].copy_from_slice(&splat(*force));
                        }
                        let first = arms.len() - 3;
                        arms[first..].copy_from_slice(&torque);
                        length
                    }
                    MomentKind::Contacts { .. } => {
                        arms[..moment.dofs.len()].fill(R::zero());
                        R::zero()
                    }
                    MomentKind::SliderCrank { crank, slider, rod, gear } => {
                        compute_crank_arms(compiled, kinematics, [crank, slider], [R::splat(*rod), R::splat(*gear)], moment, arms)
                    }
                };
                if moment.has_length() {
                    let ahead = self.project(actuator, v) * time;
                    self.lengths[moment.index] += ahead;
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
        if let Some(moment) = &actuator.variable_moment {
            for (&(dof, _), &arm) in moment.dofs.iter().zip(&self.arms[moment.arms..]) {
                sum += arm * x[dof];
            }
        }
        sum
    }

    /// Length of an actuator at the configuration `q`, multiplied by its gear. With a variable moment, it is the length from the last call
    /// of [`ActuatorForces::transmit`].
    #[inline(always)]
    pub(crate) fn length_of(&self, actuator: &CompiledActuator<R::Scalar>, q: &[R]) -> R {
        if let Some(moment) = &actuator.variable_moment {
            return self.lengths[moment.index];
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

/// Computes the moment arms of an actuator on a site into `arms`, and returns the actuator's length. `sites` are the site and the reference
/// site, and `w` is the force and torque per unit of the actuator's force.
///
/// The length is the scalar product of the wrench with the site's position and rotation vector in the reference site's frame; 0 without a
/// reference site.
#[inline(always)]
fn compute_site_arms<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    (site, reference): (&Spot<R::Scalar>, Option<&Spot<R::Scalar>>),
    w: [R; 6],
    moment: &VariableMoment<R::Scalar>,
    arms: &mut [R],
) -> R {
    let (pos, mat) = pose(kinematics, site);
    let (force, torque) = ([w[0], w[1], w[2]], [w[3], w[4], w[5]]);
    let (mut frame, mut length, mut other) = (mat, R::zero(), pos);
    if let Some(reference) = reference {
        let (from, axes) = pose(kinematics, reference);
        let line = rotate_back(&axes, sub(pos, from));
        let turn = rotate_back(&axes, quat_log(mat_to_quat(&mat_mul_transposed(&mat, &axes))));
        length = dot(force, line) + dot(torque, turn);
        (frame, other) = (axes, from);
    }
    let (force, torque) = (rotate(&frame, force), rotate(&frame, torque));
    for (&(dof, side), arm) in moment.dofs.iter().zip(arms) {
        let axis = &kinematics.axes[dof];
        let at = if side > <R::Scalar>::default() { pos } else { other };
        let moved = velocity_at(axis, sub(at, kinematics.origin[compiled.dofs[dof].tree]));
        *arm = R::splat(side) * (dot(force, moved) + dot(torque, angular(axis)));
    }
    length
}

/// Computes the moment arms of a slider-crank into `arms`, and returns its length, as in MuJoCo.
///
/// With the vector s from the slider's site to the crank's, the axis a of the slider, and the rod r, the length is
/// `a.s - sqrt((a.s)^2 + r^2 - s.s)`. If the rod is too short to reach the axis, the length is `a.s`.
#[inline(always)]
fn compute_crank_arms<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    [crank, slider]: [&Spot<R::Scalar>; 2],
    [rod, gear]: [R; 2],
    moment: &VariableMoment<R::Scalar>,
    arms: &mut [R],
) -> R {
    let ((end, _), (base, mat)) = (pose(kinematics, crank), pose(kinematics, slider));
    let (axis, apart) = (column(&mat, 2), sub(end, base));
    let along = dot(apart, axis);
    let squared = along * along + rod * rod - dot(apart, apart);
    let reaches = squared.gt(R::zero());
    let root = R::select(reaches, squared, R::one()).sqrt();
    let share = R::one() - along / root;
    let by_apart = select(reaches, add_scaled(scale(axis, share), apart, R::one() / root), axis);
    let by_axis = select(reaches, scale(apart, share), apart);
    for (&(dof, side), arm) in moment.dofs.iter().zip(arms) {
        let motion = &kinematics.axes[dof];
        let moved = |at: V3<R>| dot(by_apart, velocity_at(motion, sub(at, kinematics.origin[compiled.dofs[dof].tree])));
        let change = if side > <R::Scalar>::default() { moved(end) } else { dot(by_axis, cross(angular(motion), axis)) - moved(base) };
        *arm = gear * change;
    }
    gear * R::select(reaches, along - root, along)
}
