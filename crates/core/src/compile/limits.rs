//! Compiled joint limits and dry friction.

use crate::compile::merging::Merged;
use crate::compile::tree::{CompiledFriction, CompiledLimit};
use crate::model::actuator_spec::ActuatorSpec;
use crate::model::{Joint, JointKind, Model, Transmission};

/// Limits of the joints that have a range and that `is_of_kind` selects. `first` is the index of the first limit's impulse in the list of
/// impulses of scalar constraint rows.
pub(super) fn limits(model: &Model, merged: &Merged, first: usize, is_of_kind: impl Fn(&Joint) -> bool) -> Vec<CompiledLimit> {
    let joints = model.joints.iter().zip(&merged.addresses).enumerate();
    let limited = joints.filter(|(_, (j, _))| is_of_kind(j) && j.range.is_some());
    limited.zip(first..).map(|((joint, (_, &(q, dof))), impulse_index)| CompiledLimit { joint, q, dof, impulse_index }).collect()
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
