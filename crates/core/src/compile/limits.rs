//! Compiled joint limits and dry friction.

use crate::compile::merging::Merged;
use crate::compile::tree::{CompiledBallLimit, CompiledFriction, CompiledLimit};
use crate::model::actuator_spec::ActuatorSpec;
use crate::model::{Joint, JointKind, Model, Transmission};

pub(super) fn limits(model: &Model, merged: &Merged) -> Vec<CompiledLimit> {
    let limited = model.joints.iter().zip(&merged.addresses).filter(|(j, _)| is_scalar(j) && j.range.is_some());
    limited.map(|(_, &(q, dof))| CompiledLimit { q, dof }).collect()
}

pub(super) fn ball_limits(model: &Model, merged: &Merged, impulse_index: &mut usize) -> Vec<CompiledBallLimit> {
    let limited = model.joints.iter().zip(&merged.addresses).filter(|(j, _)| j.kind == JointKind::Ball && j.range.is_some());
    let compiled = |(_, &(q, dof)): (&crate::model::Joint, &(usize, usize))| {
        *impulse_index += 1;
        CompiledBallLimit { q, dof, impulse_index: *impulse_index - 1 }
    };
    limited.map(compiled).collect()
}

pub(super) fn frictions(model: &Model, specs: &[Option<ActuatorSpec>], merged: &Merged) -> Vec<CompiledFriction> {
    let mut driven = vec![false; model.joints.len()];
    for (actuator, spec) in model.actuators.iter().zip(specs) {
        if let (Transmission::Joint(j), Some(spec)) = (actuator.transmission, spec) {
            driven[j] |= spec.loses();
        }
    }
    let joints = model.joints.iter().zip(&merged.addresses).zip(driven).enumerate();
    let rough = joints.filter(|(_, ((j, _), driven))| j.frictionloss > 0.0 || *driven);
    rough.flat_map(|(joint, ((j, &(_, v)), driven))| (v..v + j.kind.nv()).map(move |dof| CompiledFriction { dof, joint, driven })).collect()
}

pub(super) fn is_scalar(joint: &Joint) -> bool {
    matches!(joint.kind, JointKind::Hinge | JointKind::Slide)
}
