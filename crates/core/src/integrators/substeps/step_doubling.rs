//! Step doubling: distance between the results of a step over a whole interval and over its two halves, and extrapolation from both.

use stepper_real::{Mask, Real, kernel};

use crate::actuation::affine_force::within;
use crate::compile::{DofParams, LaneModel};
use crate::dynamics::kinematics::{displace, quat_at, select_into};
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::evaluate::free_motion::FreeMotion;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::math::spatial::*;
use crate::model::JointKind;
use crate::options::Integrator;
use crate::stages::s01_actuate::servo_stiffness_and_damping;

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

/// Largest squared product of the time step and the frequency of a spring or servo that is extrapolated. See [`add_vibrating_trees`].
const MAX_VIBRATION: f64 = 0.25;

/// Smallest ratio of the squared damping to the stiffness of a spring or servo that is extrapolated, both made dimensionless by inertia and
/// time step. The damping is a twentieth of the critical one.
const MIN_DAMPING: f64 = 0.01;

/// Adds to `trees` the kinematic trees whose vibrations an extrapolation of the last part could excite, in the lanes `lanes`. These are
/// trees with drag, and with springs or servos that are stiff for the part or hardly damped.
///
/// With the implicit rule there are none: its extrapolation is L-stable (Hairer and Wanner, Solving Ordinary Differential Equations II,
/// section IV.9). The extrapolated midpoint rule multiplies the amplitude of an undamped spring of frequency w by at most
/// 1 + (h w)^6 / 1000 in a step of length h. The factor is below 1 for a damping of at least a hundredth of the critical one and h w of at
/// most 2. The limits of this function are stricter, because joints can move less inertia together than alone. Euler's rule extrapolates no
/// springs and dampers.
pub(super) fn add_vibrating_trees<R: Real>(context: StepContext<'_, R>, free: &FreeMotion<R>, lanes: R::Mask, trees: &mut [R::Mask]) {
    let StepContext { input: StepInput { compiled, options, state, .. }, evaluation: Evaluation { scheme, .. } } = context;
    if options.integrator == Integrator::Implicit {
        return;
    }
    kernel!(R, || {
        let FreeMotion { smooth, actuator_forces, .. } = free;
        let (h, is_midpoint) = (scheme.h, R::Mask::splat(scheme.in_the_middle));
        let vibrates = |stiffness: R, damping: R| {
            let (stiffness, damping) = (stiffness * h.square(), damping * h);
            let is_small = stiffness.le(R::of(MAX_VIBRATION)).and(damping.square().ge(stiffness * R::of(MIN_DAMPING)));
            lanes.and((stiffness + damping).gt(R::zero())).and_not(is_small.and(is_midpoint))
        };
        for (d, dof) in compiled.dofs.iter().enumerate() {
            let (DofParams { damping, stiffness, .. }, mobility) = (compiled.params.dof(d), smooth.mass.inv_d[d]);
            let drag = if compiled.fluid.is_empty() { R::Mask::splat(false) } else { lanes };
            trees[dof.tree] = trees[dof.tree].or(vibrates(stiffness * mobility, damping * mobility)).or(drag);
        }
        for (servo, inertia) in compiled.servos.iter().zip(&actuator_forces.effective_inertias) {
            let actuator = &compiled.actuators[servo.actuator];
            let [stiffness, damping] = servo_stiffness_and_damping(compiled, &context.forces_at(&state.v), servo.actuator, actuator_forces);
            let grows = vibrates(stiffness * inertia.mobility, inertia.rate(damping));
            let variable = actuator.variable_moment.iter().flat_map(|moment| &moment.dofs).map(|&(dof, _)| dof);
            for dof in actuator.moment.iter().map(|&(_, dof, _)| dof).chain(variable) {
                let tree = compiled.dofs[dof].tree;
                trees[tree] = trees[tree].or(grows);
            }
        }
    });
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
