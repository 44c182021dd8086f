//! Poses, velocities and accelerations of sensor frames.

use stepper_real::{Real, kernel};

use crate::compile::LaneModel;
use crate::compile::sensing::SensorFrame;
use crate::dynamics::kinematics::{Kinematics, quat_at};
use crate::math::spatial::*;
use crate::model::{FrameReading, JointKind};
use crate::sensing::{SensorInput, SensorView};

/// Computes the orientation of every link as a quaternion from the configuration `q`. The quaternion is a product along the kinematic tree,
/// so that its sign follows the signs of the quaternions in `q`.
pub fn orientations<R: Real>(compiled: &LaneModel<R>, q: &[R], out: &mut [[R; 4]]) {
    kernel!(R, || {
        for (l, link) in compiled.links.iter().enumerate() {
            let mut quat = quat_mul(out[link.parent], splat(link.quat));
            for joint in &compiled.joints[link.joints.clone()] {
                match joint.kind {
                    JointKind::Free => quat = quat_at(q, joint.q + 3),
                    JointKind::Ball => quat = quat_mul(quat, quat_at(q, joint.q)),
                    JointKind::Slide => {}
                    JointKind::Hinge => {
                        let (sin, cos) = ((q[joint.q] - R::splat(joint.reference)) * R::of(0.5)).sin_cos();
                        let [x, y, z] = scale(splat(joint.axis), sin);
                        quat = quat_mul(quat, [cos, x, y, z]);
                    }
                }
            }
            out[l + 1] = quat_normalize(quat);
        }
    })
}

/// Computes the velocities and accelerations of all links: forward pass of the recursive Newton-Euler algorithm (Featherstone 2008, section
/// 5.3).
pub(super) fn accelerations<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    input: &SensorInput<'_, R>,
    velocity: &mut [V6<R>],
    acceleration: &mut [V6<R>],
) {
    kernel!(R, || {
        let ground = ground(compiled);
        for (l, link) in compiled.links.iter().enumerate() {
            let (mut motion, mut change) =
                if link.is_root { (zero(), ground) } else { (velocity[link.parent - 1], acceleration[link.parent - 1]) };
            for joint in &compiled.joints[link.joints.clone()] {
                let mut rotations = joint.v..joint.v + joint.kind.nv();
                if joint.kind == JointKind::Free {
                    // The translation axes of a free joint are world axes, which do not rotate with the body.
                    for d in joint.v..joint.v + 3 {
                        motion = add_scaled(motion, kinematics.axes[d], input.v[d]);
                        change = add_scaled(change, kinematics.axes[d], input.acceleration[d]);
                    }
                    rotations.start += 3;
                }
                let mut own = zero();
                for d in rotations {
                    own = add_scaled(own, kinematics.axes[d], input.v[d]);
                    change = add_scaled(change, kinematics.axes[d], input.acceleration[d]);
                }
                change = add(change, cross_motion(&motion, &own));
                motion = add(motion, own);
            }
            velocity[l] = motion;
            acceleration[l] = change;
        }
    })
}

/// Spatial acceleration of the world in the Newton-Euler recursion: minus the gravitational acceleration. The recursion then needs no
/// separate gravity forces.
#[inline(always)]
pub(super) fn ground<R: Real>(compiled: &LaneModel<R>) -> V6<R> {
    spatial(zero(), scale(compiled.params.gravity(), -R::one()))
}

/// Spatial velocity or acceleration of a frame, and the point to which it refers. `motions` has the values of the links, and `still` is the
/// value for the world and mocap bodies.
#[inline(always)]
pub fn motion_of<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    motions: &[V6<R>],
    still: V6<R>,
    frame: usize,
) -> (V6<R>, V3<R>) {
    match frame.checked_sub(1).and_then(|l| compiled.links.get(l).map(|link| (l, link))) {
        Some((l, link)) => (motions[l], kinematics.origin[link.tree]),
        None => (still, zero()),
    }
}

impl<R: Real> SensorView<'_, R> {
    /// Position of a sensor frame's origin in the world frame, m.
    #[inline(always)]
    pub(super) fn position(&self, place: &SensorFrame<R::Scalar>) -> V3<R> {
        self.kinematics.point(place.frame, self.compiled.params.place(place.index))
    }

    /// Rotation matrix from a sensor frame to the world frame.
    #[inline(always)]
    pub(super) fn orientation(&self, place: &SensorFrame<R::Scalar>) -> M3<R> {
        mat_mul(&self.kinematics.mat[place.frame], &splat(place.mat))
    }

    /// Velocity of a sensor frame in world axes: angular, rad/s, and linear at its origin, m/s.
    #[inline(always)]
    fn velocity(&self, place: &SensorFrame<R::Scalar>) -> [V3<R>; 2] {
        let (motion, origin) = motion_of(self.compiled, self.kinematics, self.velocities, zero(), place.frame);
        [angular(&motion), velocity_at(&motion, sub(self.position(place), origin))]
    }

    /// Acceleration of a sensor frame minus gravity, in world axes: angular, rad/s^2, and linear at its origin, m/s^2. The linear part is
    /// the spatial acceleration plus omega x v.
    #[inline(always)]
    fn acceleration(&self, place: &SensorFrame<R::Scalar>) -> [V3<R>; 2] {
        let (change, origin) = motion_of(self.compiled, self.kinematics, self.accelerations, ground(self.compiled), place.frame);
        let [omega, v] = self.velocity(place);
        let there = velocity_at(&change, sub(self.position(place), origin));
        [angular(&change), add(there, cross(omega, v))]
    }

    /// Angular and linear velocity of a site in the site's axes. If `accelerations` is true, the results are the angular acceleration, and
    /// the linear acceleration minus gravity.
    pub fn site_motion(&self, place: &SensorFrame<R::Scalar>, accelerations: bool) -> [V3<R>; 2] {
        kernel!(R, || {
            let [turning, moving] = if accelerations { self.acceleration(place) } else { self.velocity(place) };
            let axes = self.orientation(place);
            [rotate_back(&axes, turning), rotate_back(&axes, moving)]
        })
    }

    /// Writes the reading of a frame sensor to `out`: three values, or the four of a quaternion.
    pub fn frame(&self, what: FrameReading, object: &SensorFrame<R::Scalar>, reference: Option<&SensorFrame<R::Scalar>>, out: &mut [R]) {
        kernel!(R, || {
            use FrameReading as F;
            if what == F::Quat {
                let mut seen = quat_mul(self.orientations[object.frame], splat(object.quat));
                if let Some(r) = reference {
                    seen = quat_between(quat_mul(self.orientations[r.frame], splat(r.quat)), seen);
                }
                out.copy_from_slice(&seen);
                return;
            }
            let arm = |r: &SensorFrame<R::Scalar>| sub(self.position(object), self.position(r));
            let x = match what {
                F::Pos => reference.map_or_else(|| self.position(object), arm),
                F::XAxis => column(&self.orientation(object), 0),
                F::YAxis => column(&self.orientation(object), 1),
                F::ZAxis => column(&self.orientation(object), 2),
                F::AngVel => {
                    let [w, _] = self.velocity(object);
                    reference.map_or(w, |r| sub(w, self.velocity(r)[0]))
                }
                F::LinVel => {
                    let [_, v] = self.velocity(object);
                    reference.map_or(v, |r| {
                        // Velocity as seen in the rotating frame of the reference.
                        let [w, u] = self.velocity(r);
                        sub(sub(v, u), cross(w, arm(r)))
                    })
                }
                F::AngAcc => self.acceleration(object)[0],
                F::LinAcc => self.acceleration(object)[1],
                F::Quat => unreachable!("returned above"),
            };
            let x = reference.map_or(x, |r| rotate_back(&self.orientation(r), x));
            out.copy_from_slice(&x);
        })
    }
}
