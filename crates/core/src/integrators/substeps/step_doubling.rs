//! Step doubling: distance between the results of a step over a whole interval and over its two halves, and extrapolation from both.

use stepper_real::{Mask, Real, kernel};

use crate::compile::LaneModel;
use crate::dynamics::kinematics::{displace, quat_at, select_into};
use crate::math::spatial::*;
use crate::model::JointKind;

/// Computes the separation of the configuration `to` from the configuration `from`, in the coordinates of velocities, nv, m or rad.
/// Returns its size: the largest change of a coordinate, or angle of a ball or free joint.
#[inline(always)]
pub(super) fn separate<R: Real>(compiled: &LaneModel<R>, [from, to]: [&[R]; 2], separation: &mut [R]) -> R {
    let mut farthest = R::zero();
    for joint in &compiled.joints {
        let (straight, turns) = match joint.kind {
            JointKind::Free => (3, true),
            JointKind::Ball => (0, true),
            JointKind::Slide | JointKind::Hinge => (1, false),
        };
        for k in 0..straight {
            separation[joint.v + k] = to[joint.q + k] - from[joint.q + k];
            farthest = farthest.max(separation[joint.v + k].abs());
        }
        if turns {
            let turn = quat_log(quat_between(quat_at(from, joint.q + straight), quat_at(to, joint.q + straight)));
            separation[joint.v + straight..joint.v + straight + 3].copy_from_slice(&turn);
            farthest = farthest.max(norm(turn));
        }
    }
    farthest
}

/// Extrapolates velocity, configuration and activations after two halves of an interval, in the lanes `lanes` of kinematic trees on which
/// no constraint acts. `constrained` has the lanes of each tree on which one acts. `whole` has the results of a step over the interval, and
/// `separation` is that of the configurations. The function overwrites `buffer`, nq.
///
/// For a rule of order p, the result y = y_2 + (y_2 - y_1) / (2^p - 1) has order p + 1 (Hairer, Norsett and Wanner, Solving Ordinary
/// Differential Equations I, equation II.4.11). `factor` is 1 / (2^p - 1).
pub(super) fn extrapolate<R: Real>(
    compiled: &LaneModel<R>,
    factor: f64,
    (lanes, constrained): (R::Mask, &[R::Mask]),
    (whole, separation): (&[Vec<R>; 3], &[R]),
    [v, q, act]: [&mut [R]; 3],
    buffer: &mut [R],
) {
    let factor = R::of(factor);
    kernel!(R, || {
        for ((v, &whole), dof) in v.iter_mut().zip(&whole[0]).zip(&compiled.dofs) {
            *v = R::select(lanes.and_not(constrained[dof.tree]), *v + (*v - whole) * factor, *v);
        }
        for ((act, &whole), tree) in act.iter_mut().zip(&whole[2]).zip(&compiled.tree_of_act) {
            let smooth = tree.map_or(R::Mask::splat(false), |tree| lanes.and_not(constrained[tree]));
            *act = R::select(smooth, *act + (*act - whole) * factor, *act);
        }
    });
    displace(compiled, q, separation, factor, buffer);
    for joint in &compiled.joints {
        let smooth = lanes.and_not(constrained[compiled.dofs[joint.v].tree]);
        let coordinates = joint.q..joint.q + joint.kind.nq();
        select_into(&mut q[coordinates.clone()], &buffer[coordinates], smooth);
    }
}
