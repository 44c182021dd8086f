//! Sensor quantities that depend on masses: momentum, energy, and the force of a parent body on a subtree.

use stepper_real::{Real, kernel};

use crate::compile::Inertial;
use crate::compile::sensing::{Part, SensorFrame, Subtree};
use crate::dynamics::kinematics::quat_at;
use crate::math::spatial::*;
use crate::model::JointKind;
use crate::sensing::SensorView;
use crate::sensing::frames::{ground, motion_of};

impl<R: Real> SensorView<'_, R> {
    /// Centre of mass of a subtree in the world frame, m. If the subtree has no mass, the result is `empty`.
    pub fn com(&self, subtree: &Subtree, empty: V3<R>) -> V3<R> {
        kernel!(R, || {
            if subtree.parts.is_empty() {
                return empty;
            }
            let mut sum = zero();
            for part in &subtree.parts {
                let Inertial { mass, com, .. } = self.compiled.params.inertial(part.index);
                sum = add_scaled(sum, self.kinematics.point(part.frame, com), mass);
            }
            scale(sum, R::one() / self.compiled.params.total(subtree.index))
        })
    }

    /// Inertia and spatial velocity of a subtree part, the bodies of a subtree that are fixed to one frame. The third result is the point
    /// to which both refer: the reference point of the kinematic tree.
    #[inline(always)]
    fn moving(&self, part: &Part) -> (Inertia<R>, V6<R>, V3<R>) {
        let (motion, origin) = motion_of(self.compiled, self.kinematics, self.velocities, zero(), part.frame);
        let Inertial { mass, com, inertia } = self.compiled.params.inertial(part.index);
        let arm = sub(self.kinematics.point(part.frame, com), origin);
        (inertia_at(mass, inertia, &self.kinematics.mat[part.frame], arm), motion, origin)
    }

    /// Velocity of the centre of mass of a subtree, world axes, m/s.
    pub fn com_velocity(&self, subtree: &Subtree) -> V3<R> {
        kernel!(R, || {
            if subtree.parts.is_empty() {
                return zero();
            }
            let mut sum = zero();
            for part in &subtree.parts {
                let (motion, origin) = motion_of(self.compiled, self.kinematics, self.velocities, zero(), part.frame);
                let Inertial { mass, com, .. } = self.compiled.params.inertial(part.index);
                let arm = sub(self.kinematics.point(part.frame, com), origin);
                sum = add_scaled(sum, velocity_at(&motion, arm), mass);
            }
            scale(sum, R::one() / self.compiled.params.total(subtree.index))
        })
    }

    /// Angular momentum of a subtree about its centre of mass, world axes, kg m^2/s.
    pub fn angular_momentum(&self, subtree: &Subtree) -> V3<R> {
        kernel!(R, || {
            let centre = self.com(subtree, zero());
            let mut sum = zero();
            for part in &subtree.parts {
                let (inertia, motion, origin) = self.moving(part);
                let momentum = apply_inertia(&inertia, &motion);
                sum = add(sum, add(angular(&momentum), cross(sub(origin, centre), linear(&momentum))));
            }
            sum
        })
    }

    /// Force, N, and torque, N m, that the parent body exerts on a subtree, at the origin of a sensor frame and in its axes.
    ///
    /// Newton's and Euler's laws for the whole subtree give the sum of all forces. The result is this sum minus the forces of contacts and
    /// of the user.
    pub(super) fn parent_force(&self, place: &SensorFrame<R::Scalar>, subtree: &Subtree) -> [V3<R>; 2] {
        kernel!(R, || {
            let point = self.position(place);
            let (mut force, mut torque) = (zero(), zero());
            for part in &subtree.parts {
                let (inertia, motion, origin) = self.moving(part);
                let (change, _) = motion_of(self.compiled, self.kinematics, self.accelerations, ground(self.compiled), part.frame);
                let rate = add(apply_inertia(&inertia, &change), cross_force(&motion, &apply_inertia(&inertia, &motion)));
                force = add(force, linear(&rate));
                torque = add(torque, add(angular(&rate), cross(sub(origin, point), linear(&rate))));
            }
            if !self.input.xfrc.is_empty() {
                for (b, body) in self.compiled.bodies.iter().enumerate().filter(|(b, _)| subtree.bodies[*b]) {
                    let w = &self.input.xfrc[6 * b..6 * b + 6];
                    let (f, t) = ([w[0], w[1], w[2]], [w[3], w[4], w[5]]);
                    let arm = sub(self.kinematics.point(body.frame, self.compiled.params.body_com(b)), point);
                    force = sub(force, f);
                    torque = sub(torque, add(t, cross(arm, f)));
                }
            }
            let (f, t) = self.sensed_contacts.wrench_on(point, &subtree.bodies);
            let axes = self.orientation(place);
            [rotate_back(&axes, sub(force, f)), rotate_back(&axes, sub(torque, t))]
        })
    }

    /// Potential energy of gravity and of the springs of joints and tendons, J. `all` is the subtree of the world.
    pub fn potential(&self, all: &Subtree) -> R {
        let q = self.input.q;
        kernel!(R, || {
            let mut sum = R::zero();
            for part in &all.parts {
                let Inertial { mass, com, .. } = self.compiled.params.inertial(part.index);
                sum -= mass * dot(self.compiled.params.gravity(), self.kinematics.point(part.frame, com));
            }
            let half = R::of(0.5);
            for (j, joint) in self.compiled.joints.iter().enumerate().filter(|(_, joint)| joint.sprung) {
                let k = self.compiled.params.spring(j) * half;
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
            for tendon in &self.compiled.tendons {
                let Some((spring, stretch)) = tendon.stretch(q, &self.kinematics.paths) else { continue };
                sum += R::splat(spring.stiffness) * half * stretch.square();
            }
            sum
        })
    }

    /// Kinetic energy, J. It includes armature and the inertia of tendons. `all` is the subtree of the world.
    pub fn kinetic(&self, all: &Subtree) -> R {
        let v = self.input.v;
        kernel!(R, || {
            let mut sum = R::zero();
            for part in &all.parts {
                let (inertia, motion, _) = self.moving(part);
                sum += dot6(apply_inertia(&inertia, &motion), motion);
            }
            for (d, &v) in v.iter().enumerate() {
                sum += self.compiled.params.dof(d).armature * v * v;
            }
            for tendon in &self.compiled.tendons {
                let Some((spring, _)) = &tendon.spring else { continue };
                sum += R::splat(spring.inertia) * tendon.length.rate(v, &self.kinematics.paths).square();
            }
            sum * R::of(0.5)
        })
    }
}
