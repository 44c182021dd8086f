//! Simple bodies, for which MuJoCo stores only the diagonal of the mass matrix.

use crate::{JointKind, Model, weld_groups};

/// Largest difference of the positions, m, or quaternions of two frames that count as equal: `kFrameEps` of MuJoCo's compiler.
const FRAME_EPSILON: f64 = 1e-6;

/// Largest component of an axis that counts as zero: `mjEPS` of MuJoCo's compiler.
const AXIS_EPSILON: f64 = 1e-14;

/// Whether each body is simple, by the rule of MuJoCo's compiler (`body_simple`).
///
/// A simple body has no child body, and its parent is the world or a body fixed to the world. The inertial frame of a simple body is its
/// body frame. Its joints are at the origin of this frame, along the axes of the frame. A joint that rotates the body must be the last
/// joint of the body.
pub fn simple_bodies(model: &Model) -> Vec<bool> {
    let (_, moves) = weld_groups(model);
    let mut simple: Vec<bool> =
        (0..model.bodies.len()).map(|b| b > 0 && has_principal_frame(model, b) && has_fixed_parent(model, &moves, b)).collect();
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

/// Whether all components are zero within [`FRAME_EPSILON`].
fn is_zero(x: [f64; 3]) -> bool {
    x.iter().all(|x| x.abs() < FRAME_EPSILON)
}

/// Whether the inertial frame of a body equals its body frame.
fn has_principal_frame(model: &Model, body: usize) -> bool {
    let body = &model.bodies[body];
    let [w, x, y, z] = body.iquat;
    is_zero(body.ipos) && is_zero([x, y, z]) && (w.abs() - 1.0).abs() < FRAME_EPSILON
}

/// Whether the parent of a body is the world, or a body without joints that is a child of the world. `moves` is whether each body has
/// joints.
fn has_fixed_parent(model: &Model, moves: &[bool], body: usize) -> bool {
    let parent = model.bodies[body].parent;
    parent == 0 || model.bodies[parent].parent == 0 && !moves[parent]
}
