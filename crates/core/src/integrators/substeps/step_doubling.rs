//! Step doubling: distance between the results of a step over a whole interval and over its two halves, and extrapolation from both.

use stepper_real::{Mask, Real, kernel};

use crate::actuation::affine_force::within;
use crate::compile::{DofParams, LaneModel};
use crate::dynamics::kinematics::{displace, quat_at, select_into};
use crate::math::spatial::*;
use crate::model::JointKind;
use crate::options::{Integrator, StepSettings};

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

/// Finds the kinematic trees with springs, dampers, servos or drag, in `trees`, which gets the lanes of each tree.
///
/// Extrapolations from the midpoint rule and from Euler's rule would make stiff vibrations grow. With the implicit rule they do not: the
/// extrapolation is L-stable (Hairer and Wanner, Solving Ordinary Differential Equations II, section IV.9).
pub(super) fn find_stiff_trees<R: Real>(compiled: &LaneModel<R>, options: &StepSettings, trees: &mut [R::Mask]) {
    let extrapolates = options.integrator == Integrator::Implicit;
    trees.fill(R::Mask::splat(!extrapolates && !compiled.fluid.is_empty()));
    if extrapolates {
        return;
    }
    kernel!(R, || {
        for (d, dof) in compiled.dofs.iter().enumerate() {
            let DofParams { damping, stiffness, .. } = compiled.params.dof(d);
            trees[dof.tree] = trees[dof.tree].or((damping + stiffness).gt(R::zero()));
        }
    });
    for servo in &compiled.servos {
        let actuator = &compiled.actuators[servo.actuator];
        let variable = actuator.variable_moment.iter().flat_map(|moment| &moment.dofs).map(|&(dof, _)| dof);
        for dof in actuator.moment.iter().map(|&(_, dof, _)| dof).chain(variable) {
            trees[compiled.dofs[dof].tree] = R::Mask::splat(true);
        }
    }
}

/// Extrapolates velocity, configuration and activations after two halves of an interval, in the lanes `lanes`. `rough` has the lanes of
/// each kinematic tree that keep the result of the halves. `whole` has the results of a step over the interval, and `separation` is that of
/// the configurations. The function overwrites `buffer`, nq.
///
/// For a rule of order p, the result y = y_2 + (y_2 - y_1) / (2^p - 1) has order p + 1 (Hairer, Norsett and Wanner, Solving Ordinary
/// Differential Equations I, equation II.4.11). `factor` is 1 / (2^p - 1).
pub(super) fn extrapolate<R: Real>(
    compiled: &LaneModel<R>,
    factor: f64,
    (lanes, rough): (R::Mask, &[R::Mask]),
    (whole, separation): (&[Vec<R>; 3], &[R]),
    [v, q, act]: [&mut [R]; 3],
    buffer: &mut [R],
) {
    let factor = R::of(factor);
    kernel!(R, || {
        for ((v, &whole), dof) in v.iter_mut().zip(&whole[0]).zip(&compiled.dofs) {
            *v = R::select(lanes.and_not(rough[dof.tree]), *v + (*v - whole) * factor, *v);
        }
        for actuator in &compiled.actuators {
            let Some((a, tree)) = actuator.act.and_then(|a| Some((a, compiled.tree_of_act[a]?))) else { continue };
            let extrapolated = within(act[a] + (act[a] - whole[2][a]) * factor, actuator.act_range);
            act[a] = R::select(lanes.and_not(rough[tree]), extrapolated, act[a]);
        }
    });
    displace(compiled, q, separation, factor, buffer);
    for joint in &compiled.joints {
        let smooth = lanes.and_not(rough[compiled.dofs[joint.v].tree]);
        let coordinates = joint.q..joint.q + joint.kind.nq();
        select_into(&mut q[coordinates.clone()], &buffer[coordinates], smooth);
    }
}
