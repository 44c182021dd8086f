//! Simple bodies, of which MuJoCo keeps the diagonal of the mass matrix alone.

use crate::model::{JointKind, Model};

/// Distance below which two frames are the same, m, and difference of quaternions: that of MuJoCo's compiler (`kFrameEps`).
const FRAME_EPSILON: f64 = 1e-6;

/// Component of an axis that counts as zero (`mjEPS`).
const AXIS_EPSILON: f64 = 1e-14;

/// Whether every body is simple, as MuJoCo's compiler decides (`body_simple`): no body below it, nothing that moves above it, the frame of
/// its inertia is its own, its joints are at its origin along its axes, and a rotation comes last.
pub(crate) fn simple_bodies(model: &Model) -> Vec<bool> {
    let mut simple: Vec<bool> =
        (0..model.bodies.len()).map(|b| b > 0 && has_principal_frame(model, b) && is_child_of_world(model, b)).collect();
    for body in &model.bodies {
        simple[body.parent] = false;
    }
    let mut rotates = vec![false; model.bodies.len()];
    for joint in &model.joints {
        let scalar = matches!(joint.kind, JointKind::Slide | JointKind::Hinge);
        let aligned = joint.axis.iter().filter(|x| x.abs() > AXIS_EPSILON).count() == 1;
        if rotates[joint.body] || !is_zero(joint.pos) || scalar && !aligned {
            simple[joint.body] = false;
        }
        rotates[joint.body] |= matches!(joint.kind, JointKind::Ball | JointKind::Hinge);
    }
    simple
}

fn is_zero(x: [f64; 3]) -> bool {
    x.iter().all(|x| x.abs() < FRAME_EPSILON)
}

/// Whether the principal axes of a body are those of its frame.
fn has_principal_frame(model: &Model, body: usize) -> bool {
    let body = &model.bodies[body];
    let [w, x, y, z] = body.iquat;
    is_zero(body.ipos) && is_zero([x, y, z]) && (w.abs() - 1.0).abs() < FRAME_EPSILON
}

/// Whether the parent of a body is the world, or a child of the world without joints.
fn is_child_of_world(model: &Model, body: usize) -> bool {
    let parent = model.bodies[body].parent;
    parent == 0 || model.bodies[parent].parent == 0 && model.joints.iter().all(|joint| joint.body != parent)
}
