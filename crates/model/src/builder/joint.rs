//! Builder of a joint.

use nalgebra::Vector3;

use crate::{Body, Joint, JointKind};

/// Builder of a joint between a body and its parent.
#[derive(Clone, Debug)]
pub struct JointBuilder {
    pub(super) joint: Joint,
    rest: Option<f64>,
}

impl JointBuilder {
    fn new(name: &str, kind: JointKind, axis: [f64; 3]) -> Self {
        let joint = Joint { name: name.into(), kind, axis, ..Joint::default() };
        Self { joint, rest: None }
    }

    /// Coordinates of the joint at reset, and at the rest position of its spring.
    pub(super) fn reference(&self, body: &Body) -> (Vec<f64>, Vec<f64>) {
        match self.joint.kind {
            JointKind::Free => {
                let pose = [&body.pos[..], &body.quat[..]].concat();
                (pose.clone(), pose)
            }
            JointKind::Ball => (vec![1.0, 0.0, 0.0, 0.0], vec![1.0, 0.0, 0.0, 0.0]),
            JointKind::Slide | JointKind::Hinge => (vec![0.0], vec![self.rest.unwrap_or(0.0)]),
        }
    }
}

constructors! { JointBuilder
    /// Creates a builder of a free joint, with six degrees of freedom. It must be the only joint of a body that is a child of the world.
    free() { JointKind::Free, [0.0, 0.0, 1.0] }
    /// Creates a builder of a ball joint, with three rotational degrees of freedom.
    ball() { JointKind::Ball, [0.0, 0.0, 1.0] }
    /// Creates a builder of a slide joint along `axis` in the body's frame. The axis may have any length above 0.
    slide(axis: impl Into<[f64; 3]>) { JointKind::Slide, unit(axis.into()) }
    /// Creates a builder of a hinge joint about `axis` in the body's frame. The axis may have any length above 0.
    hinge(axis: impl Into<[f64; 3]>) { JointKind::Hinge, unit(axis.into()) }
}

setters! { JointBuilder
    /// Sets the anchor in the body's frame, m.
    pos(pos: impl Into<[f64; 3]>) { joint.pos = pos.into() }
    /// Sets the lowest and highest position, m or rad.
    range(low: f64, high: f64) { joint.range = Some([low, high]) }
    /// Sets a spring of the stiffness `stiffness`, N/m or N m/rad. The rest position is `rest` (m or rad) for a hinge or slide, and the
    /// initial pose for a ball or free joint.
    spring(stiffness: f64, rest: f64) { joint.stiffness = stiffness; rest = Some(rest) }
    /// Sets the viscous damping, N s/m or N m s/rad.
    damping(damping: f64) { joint.damping = damping }
    /// Sets the armature (rotor inertia), kg or kg m^2.
    armature(armature: f64) { joint.armature = armature }
    /// Sets the dry friction, N or N m.
    frictionloss(loss: f64) { joint.frictionloss = loss }
    /// Sets the range to which the sum of the actuator forces on the joint is clamped, N or N m.
    actuator_force_range(low: f64, high: f64) { joint.actuator_force_range = Some([low, high]) }
}

/// Unit vector along `axis`. A zero axis is returned unchanged, and [`Description::finish`](crate::Description::finish) returns the error.
fn unit(axis: [f64; 3]) -> [f64; 3] {
    Vector3::from(axis).try_normalize(0.0).map_or(axis, Into::into)
}
