//! Sensor quantities that depend on masses: momentum, energy, and the force of a parent body on a subtree.

use stepper_real::Real;

use crate::compile::sensing::{Part, SensorFrame, Subtree};
use crate::compile::{Inertial, LaneModel};
use crate::dynamics::kinematics::{Kinematics, quat_at};
use crate::math::spatial::*;
use crate::model::JointKind;
use crate::sensing::frames::{ground, motion_of, orientation, position};
use crate::sensing::{SensorInput, SensorWorkspace};

/// Centre of mass of a subtree in the world frame, m. If the subtree has no mass, the result is `empty`.
pub fn com<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, subtree: &Subtree, empty: V3<R>) -> V3<R> {
    R::vectorize(
        #[inline(always)]
        || {
            if subtree.parts.is_empty() {
                return empty;
            }
            let mut sum = zero();
            for part in &subtree.parts {
                let Inertial { mass, com, .. } = compiled.params.inertial(part.index);
                sum = add_scaled(sum, kinematics.point(part.frame, com), mass);
            }
            scale(sum, R::one() / compiled.params.total(subtree.index))
        },
    )
}

/// Inertia and spatial velocity of a subtree part, the bodies of a subtree that are fixed to one frame. Both refer to the reference point
/// of the kinematic tree, which is the third result.
#[inline(always)]
fn moving<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    workspace: &SensorWorkspace<R>,
    part: &Part,
) -> (Inertia<R>, V6<R>, V3<R>) {
    let (motion, origin) = motion_of(compiled, kinematics, &workspace.velocity, zero(), part.frame);
    let Inertial { mass, com, inertia } = compiled.params.inertial(part.index);
    let arm = sub(kinematics.point(part.frame, com), origin);
    (inertia_at(mass, inertia, &kinematics.mat[part.frame], arm), motion, origin)
}

/// Velocity of the centre of mass of a subtree, world axes, m/s.
pub fn com_velocity<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    workspace: &SensorWorkspace<R>,
    subtree: &Subtree,
) -> V3<R> {
    R::vectorize(
        #[inline(always)]
        || {
            if subtree.parts.is_empty() {
                return zero();
            }
            let mut sum = zero();
            for part in &subtree.parts {
                let (motion, origin) = motion_of(compiled, kinematics, &workspace.velocity, zero(), part.frame);
                let Inertial { mass, com, .. } = compiled.params.inertial(part.index);
                let arm = sub(kinematics.point(part.frame, com), origin);
                sum = add_scaled(sum, velocity_at(&motion, arm), mass);
            }
            scale(sum, R::one() / compiled.params.total(subtree.index))
        },
    )
}

/// Angular momentum of a subtree about its centre of mass, world axes, kg m^2/s.
pub fn angular_momentum<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    workspace: &SensorWorkspace<R>,
    subtree: &Subtree,
) -> V3<R> {
    R::vectorize(
        #[inline(always)]
        || {
            let centre = com(compiled, kinematics, subtree, zero());
            let mut sum = zero();
            for part in &subtree.parts {
                let (inertia, motion, origin) = moving(compiled, kinematics, workspace, part);
                let momentum = apply_inertia(&inertia, &motion);
                sum = add(sum, add(angular(&momentum), cross(sub(origin, centre), linear(&momentum))));
            }
            sum
        },
    )
}

/// Force, N, and torque, N m, that the parent body exerts on a subtree, at the origin of a sensor frame and in its axes.
///
/// Newton's and Euler's laws for the whole subtree give the sum of all forces. The result is this sum minus the forces of contacts and of
/// the user.
pub(super) fn parent_force<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    workspace: &SensorWorkspace<R>,
    input: &SensorInput<'_, R>,
    place: &SensorFrame<R::Scalar>,
    subtree: &Subtree,
) -> [V3<R>; 2] {
    R::vectorize(
        #[inline(always)]
        || {
            let point = position(compiled, kinematics, place);
            let (mut force, mut torque) = (zero(), zero());
            for part in &subtree.parts {
                let (inertia, motion, origin) = moving(compiled, kinematics, workspace, part);
                let (change, _) = motion_of(compiled, kinematics, &workspace.acceleration, ground(compiled), part.frame);
                let rate = add(apply_inertia(&inertia, &change), cross_force(&motion, &apply_inertia(&inertia, &motion)));
                force = add(force, linear(&rate));
                torque = add(torque, add(angular(&rate), cross(sub(origin, point), linear(&rate))));
            }
            if !input.xfrc.is_empty() {
                for (b, body) in compiled.bodies.iter().enumerate().filter(|(b, _)| subtree.bodies[*b]) {
                    let w = &input.xfrc[6 * b..6 * b + 6];
                    let (f, t) = ([w[0], w[1], w[2]], [w[3], w[4], w[5]]);
                    let arm = sub(kinematics.point(body.frame, compiled.params.body_com(b)), point);
                    force = sub(force, f);
                    torque = sub(torque, add(t, cross(arm, f)));
                }
            }
            let (f, t) = workspace.sensed_contacts.wrench_on(point, &subtree.bodies);
            let axes = orientation(kinematics, place);
            [rotate_back(&axes, sub(force, f)), rotate_back(&axes, sub(torque, t))]
        },
    )
}

/// Potential energy of gravity and of the springs of joints and tendons, J. `all` is the subtree of the world.
pub fn potential<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, q: &[R], all: &Subtree) -> R {
    R::vectorize(
        #[inline(always)]
        || {
            let mut sum = R::zero();
            for part in &all.parts {
                let Inertial { mass, com, .. } = compiled.params.inertial(part.index);
                sum -= mass * dot(compiled.params.gravity(), kinematics.point(part.frame, com));
            }
            let half = R::of(0.5);
            for (j, joint) in compiled.joints.iter().enumerate().filter(|(_, joint)| joint.sprung) {
                let k = compiled.params.spring(j) * half;
                let (mut at, mut i) = (joint.q, 0);
                if joint.kind != JointKind::Ball {
                    let scalars = if joint.kind == JointKind::Free { 3 } else { 1 };
                    for s in 0..scalars {
                        sum += k * (q[at + s] - R::splat(joint.rest[s])).square();
                    }
                    (at, i) = (at + scalars, scalars);
                }
                if matches!(joint.kind, JointKind::Ball | JointKind::Free) {
                    let rest = |k: usize| R::splat(joint.rest[i + k]);
                    let twist = quat_log(quat_mul([rest(0), -rest(1), -rest(2), -rest(3)], quat_at(q, at)));
                    sum += k * dot(twist, twist);
                }
            }
            for tendon in &compiled.tendons {
                let Some((spring, stretch)) = tendon.stretch(q) else { continue };
                sum += R::splat(spring.stiffness) * half * stretch.square();
            }
            sum
        },
    )
}

/// Kinetic energy, J. It includes armature and the inertia of tendons. `all` is the subtree of the world.
pub fn kinetic<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, workspace: &SensorWorkspace<R>, v: &[R], all: &Subtree) -> R {
    R::vectorize(
        #[inline(always)]
        || {
            let mut sum = R::zero();
            for part in &all.parts {
                let (inertia, motion, _) = moving(compiled, kinematics, workspace, part);
                sum += dot6(apply_inertia(&inertia, &motion), motion);
            }
            for (d, &v) in v.iter().enumerate() {
                sum += compiled.params.dof(d).armature * v * v;
            }
            for tendon in &compiled.tendons {
                let Some((spring, _)) = &tendon.spring else { continue };
                sum += R::splat(spring.inertia) * tendon.length.rate(v).square();
            }
            sum * R::of(0.5)
        },
    )
}
