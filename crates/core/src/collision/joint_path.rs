//! Path of a geom while all joints of its body move at constant velocities, and the rotation on this path that moves the geom's surface.
//!
//! The joints are displaced one after the other, from the geom towards the root of the kinematic tree (product of exponentials, Brockett
//! 1984). The path is therefore the motion of the step itself, at any rotation angle.
//!
//! A body of revolution that rotates about its axis stays where it is. Only other rotations, which this module calls *sweeping*, can bring
//! its surface to another body.

use stepper_real::{Real, kernel};

use crate::compile::{CompiledJoint, LaneModel, Symmetry};
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;
use crate::model::JointKind;

/// Rotation of a body above which straight lines approximate the paths of its points too badly, rad. At 0.1 rad a path leaves its tangent
/// by half a hundredth of its radius.
pub(crate) const MAX_STRAIGHT_ROTATION: f64 = 0.1;

/// Distance per radian by which a rotation may displace a surface without counting as sweeping, relative to the geom's bounding radius.
/// Rounding in single precision displaces an axis by 1e-5 of a radius of a centimetre that is a metre from the origin.
const NEGLIGIBLE_SWEEP: f64 = 1e-4;

/// Joints of a model at one configuration, with constant velocities.
#[derive(Clone, Copy)]
pub(crate) struct JointPath<'a, R: Real> {
    pub(crate) compiled: &'a LaneModel<R>,
    /// Poses and joint axes at the start of the path.
    pub(crate) kinematics: &'a Kinematics<R>,
    /// Generalized velocity.
    pub(crate) v: &'a [R],
}

/// Pose of a geom and velocity of its body, in world axes.
#[derive(Clone, Copy)]
pub(crate) struct MovedGeom<R> {
    pub(crate) pos: V3<R>,
    pub(crate) mat: M3<R>,
    /// Spatial velocity of the body at the reference point of its kinematic tree at the start of the path, rad/s and m/s.
    pub(crate) velocity: V6<R>,
}

/// Motion of one joint at a constant velocity: rotation about an axis through a point that moves along a straight line.
struct JointMotion<R> {
    /// Angular velocity, rad/s.
    rotation: V3<R>,
    /// Point on the axis at the start of the path, relative to the reference point of the kinematic tree, m.
    centre: V3<R>,
    /// Velocity of the axis, m/s.
    translation: V3<R>,
}

impl<R: Real> JointPath<'_, R> {
    /// Motion of a joint in world axes.
    #[inline(always)]
    fn motion(&self, joint: &CompiledJoint<R::Scalar>) -> JointMotion<R> {
        let axes = &self.kinematics.axes[joint.v..joint.v + joint.kind.nv()];
        let mut sum = zero();
        for (axis, &v) in axes.iter().zip(&self.v[joint.v..]) {
            sum = add_scaled(sum, *axis, v);
        }
        let mut arms = zero();
        for axis in axes {
            arms = add(arms, cross(angular(axis), linear(axis)));
        }
        let still = zero();
        match joint.kind {
            JointKind::Free => JointMotion { rotation: angular(&sum), centre: still, translation: linear(&sum) },
            JointKind::Slide => JointMotion { rotation: still, centre: still, translation: linear(&sum) },
            JointKind::Hinge => JointMotion { rotation: angular(&sum), centre: arms, translation: still },
            // Each point on the axes has two of the three cross products.
            JointKind::Ball => JointMotion { rotation: angular(&sum), centre: scale(arms, R::of(0.5)), translation: still },
        }
    }

    /// Calls `visit` with the motion of each joint that moves a link, from the link towards the root of its kinematic tree.
    #[inline(always)]
    fn for_each_joint(&self, link: usize, mut visit: impl FnMut(JointMotion<R>)) {
        let mut link = &self.compiled.links[link];
        loop {
            for joint in self.compiled.joints[link.joints.clone()].iter().rev() {
                visit(self.motion(joint));
            }
            if link.is_root {
                return;
            }
            link = &self.compiled.links[link.parent - 1];
        }
    }

    /// Pose of a geom of the link `link` and velocity of the link, `time` seconds along the path. `pos` and `mat` are the pose of the geom
    /// at the start of the path.
    #[cold]
    #[inline(never)]
    pub(crate) fn displace(&self, link: usize, (pos, mat): (V3<R>, &M3<R>), time: R) -> MovedGeom<R> {
        kernel!(R, || {
            let origin = self.kinematics.origin[self.compiled.links[link].tree];
            let (mut arm, mut mat, mut velocity) = (sub(pos, origin), *mat, zero());
            self.for_each_joint(
                link,
                #[inline(always)]
                |JointMotion { rotation, centre, translation }| {
                    let turn = quat_to_mat(quat_exp(scale(rotation, time)));
                    let shift = scale(translation, time);
                    arm = add(add(centre, rotate(&turn, sub(arm, centre))), shift);
                    mat = mat_mul(&turn, &mat);
                    // The velocity field of the joints before moves with this joint. The field of this joint itself is added to it.
                    let spin = rotate(&turn, angular(&velocity));
                    let back = sub(sub(rotate(&turn, centre), centre), shift);
                    let carried = add(rotate(&turn, linear(&velocity)), cross(spin, back));
                    let own = sub(translation, cross(rotation, add(centre, shift)));
                    velocity = spatial(add(spin, rotation), add(carried, own));
                },
            );
            MovedGeom { pos: add(origin, arm), mat, velocity }
        })
    }

    /// Sweeping rotation of a geom of the link `link` during `time` seconds, rad: rotation of its joints that moves its surface. `pos` and
    /// `mat` are the pose of the geom at the start of the path.
    #[cold]
    #[inline(never)]
    pub(crate) fn sweeping_rotation(&self, geom: usize, link: usize, pos: V3<R>, mat: &M3<R>, time: R) -> R {
        kernel!(R, || {
            let (compiled, zero) = (self.compiled, R::zero());
            let origin = self.kinematics.origin[compiled.links[link].tree];
            let bound = compiled.params.geom(geom).bounding_radius;
            let mut angle = zero;
            self.for_each_joint(
                link,
                #[inline(always)]
                |JointMotion { rotation, centre, .. }| {
                    let speed = norm(rotation);
                    let offset = norm(cross(rotation, sub(sub(pos, origin), centre)));
                    let sweep = offset + across_symmetry(compiled, geom, mat, rotation) * bound;
                    let sweeps = sweep.gt(speed * bound * R::of(NEGLIGIBLE_SWEEP));
                    angle += R::select(sweeps, speed * time, zero);
                },
            );
            angle
        })
    }

    /// Whether the body of a link rotates about the origin of its frame, which moves along a straight line.
    pub(crate) fn is_single(compiled: &LaneModel<R>, link: usize) -> bool {
        let link = &compiled.links[link];
        let joints = &compiled.joints[link.joints.clone()];
        link.is_root && joints.len() == 1 && (joints[0].centred || matches!(joints[0].kind, JointKind::Free | JointKind::Slide))
    }
}

/// Length of the component of an angular velocity across the nearest axis of revolution of a geom with the orientation `mat`, rad/s. 0 for
/// a ball, and the whole length for shapes that are not bodies of revolution.
#[inline(always)]
pub(crate) fn across_symmetry<R: Real>(compiled: &LaneModel<R>, geom: usize, mat: &M3<R>, rotation: V3<R>) -> R {
    match compiled.geoms[geom].symmetry {
        Symmetry::Ball => R::zero(),
        Symmetry::Axis => norm(cross(column(mat, 2), rotation)),
        Symmetry::Ellipsoid => {
            let radii = compiled.params.geom(geom).size;
            let mut least = norm(rotation);
            for k in 0..3 {
                let is_round = radii[(k + 1) % 3].eq(radii[(k + 2) % 3]);
                least = R::select(is_round, least.min(norm(cross(column(mat, k), rotation))), least);
            }
            least
        }
        Symmetry::None => norm(rotation),
    }
}
