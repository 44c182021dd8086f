//! Trajectories of mocap bodies during a call of `step`, which may make several steps. A trajectory leads from one pose to the next.
//!
//! A mocap body moves to its new pose along a straight line, with a constant angular velocity. Contacts therefore have a moving surface: it
//! pushes bodies before it overlaps them, and friction depends on its speed. In the first call after a reset there is no previous pose, and
//! the body is at its new pose at once.

use stepper_real::{Mask, Real, kernel};

use crate::compile::LaneModel;
use crate::dynamics::kinematics::{Kinematics, all_finite};
use crate::math::spatial::*;

/// Trajectory of one mocap body during a call.
#[derive(Clone, Copy, Debug)]
pub struct MocapTrajectory<R> {
    /// Position of the mocap body at the beginning of the call, m.
    pos: V3<R>,
    quat: [R; 4],
    /// Pose of the mocap body at the end of the call (position, quaternion). The next call starts from it.
    end: [R; 7],
    /// Velocity of the body in world axes: angular, rad/s, and linear, m/s.
    motion: V6<R>,
}

impl<R: Real> MocapTrajectory<R> {
    /// Trajectory of a mocap body at rest at the given pose.
    pub fn at(pos: V3<R>, quat: [R; 4]) -> Self {
        let quat = quat_normalize(quat);
        Self { pos, quat, end: [pos[0], pos[1], pos[2], quat[0], quat[1], quat[2], quat[3]], motion: zero() }
    }

    /// Trajectory from the pose `last` to a new pose in `seconds` seconds. If `last` is zero (unknown), the body is at the new pose at
    /// once.
    #[inline(always)]
    pub fn new(last: [R; 7], pos: V3<R>, quat: [R; 4], seconds: R) -> Self {
        let rest = Self::at(pos, quat);
        let (before, turn) = ([last[0], last[1], last[2]], [last[3], last[4], last[5], last[6]]);
        let known = all_finite(&last).and(turn[0].square().max(turn[1].square()).max(turn[2].square()).max(turn[3].square()).gt(R::zero()));
        let back = [turn[0], -turn[1], -turn[2], -turn[3]];
        let (turned, moved) = (quat_log(quat_mul(rest.quat, back)), sub(pos, before));
        let motion = scale(spatial(turned, moved), R::one() / seconds);
        Self { pos: select(known, before, pos), quat: select(known, turn, rest.quat), end: rest.end, motion: select(known, motion, zero()) }
    }

    /// Orientation `time` seconds after the beginning of the call, a unit quaternion (w, x, y, z).
    #[inline(always)]
    pub fn quat_at(&self, time: R) -> [R; 4] {
        let turn = quat_exp(scale(angular(&self.motion), time));
        quat_normalize(quat_mul(turn, self.quat))
    }

    /// Pose `time` seconds after the beginning of the call: position and quaternion.
    #[inline(always)]
    pub fn pose_at(&self, time: R) -> [R; 7] {
        let (pos, quat) = (add_scaled(self.pos, linear(&self.motion), time), self.quat_at(time));
        [pos[0], pos[1], pos[2], quat[0], quat[1], quat[2], quat[3]]
    }

    /// Pose at the end of the call: position and quaternion.
    #[inline(always)]
    pub fn end(&self) -> [R; 7] {
        self.end
    }
}

/// Sets the mocap frames of `kinematics` to their poses and velocities `time(k)` seconds after the beginning of the call, for mocap body k.
#[inline(always)]
pub fn pose_bodies<R: Real>(
    compiled: &LaneModel<R>,
    mocap_trajectories: &[MocapTrajectory<R>],
    time: impl Fn(usize) -> R,
    kinematics: &mut Kinematics<R>,
) {
    if mocap_trajectories.is_empty() {
        return;
    }
    kernel!(R, || {
        for (k, (mocap, trajectory)) in compiled.mocap.iter().zip(mocap_trajectories).enumerate() {
            let time = time(k);
            kinematics.pos[mocap.frame] = add_scaled(trajectory.pos, linear(&trajectory.motion), time);
            kinematics.mat[mocap.frame] = quat_to_mat(trajectory.quat_at(time));
            kinematics.mocap_velocities[k] = trajectory.motion;
        }
    })
}
