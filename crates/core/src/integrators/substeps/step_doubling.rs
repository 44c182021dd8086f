//! Step doubling: distance between the results of a step over a whole interval and over its two halves, and extrapolation from both.

use stepper_real::{Mask, Real, kernel};

use crate::actuation::affine_force::within;
use crate::actuation::forces::ActuatorForces;
use crate::compile::{DofParams, LaneModel};
use crate::dynamics::kinematics::{displace, select_into};
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::evaluate::free_motion::FreeMotion;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::options::Integrator;
use crate::stages::s01_actuate::servo_stiffness_and_damping;

/// Largest sum of the squared products of time step and frequency of the vibrations of a tree that is extrapolated.
const MAX_VIBRATION: f64 = 0.25;

/// Largest sum of the products of time step and decay rate in a tree that is extrapolated. Mass includes the implicit terms of dampers.
const MAX_DECAY: f64 = 1.5;

/// Smallest ratio of squared decay rate and squared frequency of a spring or servo that is extrapolated. The ratio is 4 times the square of
/// the damping ratio, which is then 0.05.
const MIN_DAMPING: f64 = 0.01;

/// Adds to `trees` the kinematic trees whose vibrations an extrapolation of the last part could excite, in the lanes `lanes`. These are
/// trees in a fluid, and trees with springs, dampers or servos that are fast for the part, or vibrate with little damping. `arm` is a
/// workspace, nv.
///
/// With the implicit rule there are none: its extrapolation is L-stable (Hairer and Wanner, Solving Ordinary Differential Equations II,
/// section IV.9). The extrapolated midpoint rule multiplies the amplitude of an undamped spring of frequency w by at most
/// 1 + (h w)^6 / 1000 in a step of length h. A damping ratio of 0.01 makes the factor less than 1 up to h w = 2. A damper multiplies the
/// velocity by 1 - r, where r is the product of h and the decay rate with implicit terms. The extrapolation is stable up to r = 1.75. The
/// sums over a tree are the traces of h^2 K / M and h D / M, which bound their eigenvalues. Euler's rule extrapolates no springs, dampers
/// and servos.
pub(super) fn add_vibrating_trees<R: Real>(
    context: StepContext<'_, R>,
    free: &FreeMotion<R>,
    lanes: R::Mask,
    trees: &mut [R::Mask],
    arm: &mut [R],
) {
    let StepContext { input: StepInput { compiled, options, state, .. }, evaluation: Evaluation { scheme, .. } } = context;
    if options.integrator == Integrator::Implicit {
        return;
    }
    let FreeMotion { smooth, actuator_forces, .. } = free;
    kernel!(R, || {
        for tree in 0..compiled.ntree {
            let mut may_grow = R::Mask::splat(!compiled.fluid.is_empty());
            let (mut vibration, mut decay) = (R::zero(), R::zero());
            // Joints, then servos: coordinates with a stiffness, a damping and a moment.
            for i in 0..compiled.nv + compiled.servos.len() {
                arm.fill(R::zero());
                let servo = i.checked_sub(compiled.nv).map(|servo| compiled.servos[servo].actuator);
                let moves_tree = match servo {
                    None => {
                        arm[i] = R::one();
                        compiled.dofs[i].tree == tree
                    }
                    Some(actuator) => set_arms(compiled, actuator_forces, actuator, tree, arm),
                };
                if !moves_tree {
                    continue;
                }
                let [stiffness, damping] = match servo {
                    None => {
                        let DofParams { damping, stiffness, .. } = compiled.params.dof(i);
                        [stiffness, damping]
                    }
                    // At a bound of its force, a servo is neither stiff nor damped.
                    Some(actuator) => servo_stiffness_and_damping(compiled, &context.forces_at(&state.v), actuator, actuator_forces),
                };
                if (stiffness + damping).gt(R::zero()).none() {
                    continue;
                }
                smooth.mass.solve_lower_transposed(compiled, arm);
                let mut mobility = R::zero();
                for (&y, &inverse) in arm.iter().zip(&smooth.mass.inv_d) {
                    mobility += y * y * inverse;
                }
                let (square, rate) = (stiffness * mobility * scheme.h.square(), damping * mobility * scheme.h);
                (vibration, decay) = (vibration + square, decay + rate);
                may_grow = may_grow.or(rate.square().lt(square * R::of(MIN_DAMPING)));
            }
            let is_slow = vibration.le(R::of(MAX_VIBRATION)).and(decay.le(R::of(MAX_DECAY)));
            let is_rigid = (vibration + decay).le(R::zero());
            let extrapolates = is_rigid.or(is_slow.and(R::Mask::splat(scheme.in_the_middle))).and_not(may_grow);
            trees[tree] = trees[tree].or(lanes.and_not(extrapolates));
        }
    });
}

/// Sets `arm`, nv, which is zero, to the moment of an actuator. Returns whether the actuator moves the kinematic tree `tree`.
#[inline(always)]
fn set_arms<R: Real>(compiled: &LaneModel<R>, forces: &ActuatorForces<R>, actuator: usize, tree: usize, arm: &mut [R]) -> bool {
    let actuator = &compiled.actuators[actuator];
    let mut moves_tree = false;
    for &(_, dof, own) in &actuator.moment {
        arm[dof] = R::splat(own);
        moves_tree |= compiled.dofs[dof].tree == tree;
    }
    if let Some(moment) = &actuator.variable_moment {
        for (&(dof, _), &own) in moment.dofs.iter().zip(&forces.arms[moment.arms..]) {
            arm[dof] = own;
            moves_tree |= compiled.dofs[dof].tree == tree;
        }
    }
    moves_tree
}

/// Extrapolates velocity, configuration and activations after two halves of an interval, in the lanes `lanes`. `not_extrapolated` has the
/// lanes of each kinematic tree that keep the result of the halves. `whole` has the results of a step over the interval, and `separation`
/// is that of the configurations. The function overwrites `buffer`, nq.
///
/// For a rule of order p, the result y = y_2 + (y_2 - y_1) / (2^p - 1) has order p + 1 (Hairer, Norsett and Wanner, Solving Ordinary
/// Differential Equations I, equation II.4.11). `factor` is 1 / (2^p - 1).
pub(super) fn extrapolate<R: Real>(
    compiled: &LaneModel<R>,
    factor: f64,
    (lanes, not_extrapolated): (R::Mask, &[R::Mask]),
    (whole, separation): (&[Vec<R>; 3], &[R]),
    [v, q, act]: [&mut [R]; 3],
    buffer: &mut [R],
) {
    let factor = R::of(factor);
    kernel!(R, || {
        for ((v, &whole), dof) in v.iter_mut().zip(&whole[0]).zip(&compiled.dofs) {
            *v = R::select(lanes.and_not(not_extrapolated[dof.tree]), *v + (*v - whole) * factor, *v);
        }
        for actuator in &compiled.actuators {
            let Some((a, tree)) = actuator.act.and_then(|a| Some((a, compiled.tree_of_act[a]?))) else { continue };
            let extrapolated = within(act[a] + (act[a] - whole[2][a]) * factor, actuator.act_range);
            act[a] = R::select(lanes.and_not(not_extrapolated[tree]), extrapolated, act[a]);
        }
    });
    displace(compiled, q, separation, factor, buffer);
    for joint in &compiled.joints {
        let smooth = lanes.and_not(not_extrapolated[compiled.dofs[joint.v].tree]);
        let coordinates = joint.q..joint.q + joint.kind.nq();
        select_into(&mut q[coordinates.clone()], &buffer[coordinates], smooth);
    }
}
