//! Relative pose of two frames, computed only from the links between them.

use stepper_real::Real;

use crate::compile::{FramePath, LaneModel};
use crate::dynamics::kinematics::{quat_at, turn};
use crate::dynamics::mocap::MocapTrajectory;
use crate::math::spatial::*;
use crate::model::JointKind;

/// Pose of the frame at the end of a path, relative to the frame at its start.
///
/// For a path from the world or a mocap body, the result equals the pose from
/// [`Kinematics::update`](crate::dynamics::kinematics::Kinematics::update). `mocap` has the trajectories of mocap bodies, `elapsed` is the
/// time since the beginning of the call of `step`, s.
#[inline(always)]
pub fn follow_path<R: Real>(
    compiled: &LaneModel<R>,
    path: &FramePath,
    q: &[R],
    mocap: &[MocapTrajectory<R>],
    elapsed: R,
) -> (V3<R>, M3<R>) {
    let (nil, one) = (R::zero(), R::one());
    let (mut pos, mut mat) = (zero(), [one, nil, nil, nil, one, nil, nil, nil, one]);
    if let Some(k) = path.mocap {
        let [x, y, z, quat @ ..] = mocap[k].pose_at(elapsed);
        (pos, mat) = ([x, y, z], quat_to_mat(quat));
    }
    for &link in &path.links {
        let link = &compiled.links[link as usize];
        pos = add(pos, rotate(&mat, splat(link.pos)));
        if let Some(m) = link.mat {
            mat = mat_mul(&mat, &splat(m));
        }
        for joint in &compiled.joints[link.joints.clone()] {
            let arm = splat(joint.anchor);
            match joint.kind {
                JointKind::Free => {
                    pos = [q[joint.q], q[joint.q + 1], q[joint.q + 2]];
                    mat = quat_to_mat(quat_at(q, joint.q + 3));
                }
                JointKind::Ball => {
                    let turned = mat_mul(&mat, &quat_to_mat(quat_at(q, joint.q)));
                    pos = sub(add(pos, rotate(&mat, arm)), rotate(&turned, arm));
                    mat = turned;
                }
                JointKind::Slide => pos = add_scaled(pos, rotate(&mat, splat(joint.axis)), q[joint.q] - R::splat(joint.reference)),
                JointKind::Hinge => {
                    let (sin, cos) = (q[joint.q] - R::splat(joint.reference)).sin_cos();
                    let (_, turned) = turn(&mat, joint, sin, cos);
                    pos = sub(add(pos, rotate(&mat, arm)), rotate(&turned, arm));
                    mat = turned;
                }
            }
        }
    }
    (pos, mat)
}
