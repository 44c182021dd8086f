//! Mechanisms: sets of kinematic trees that the model couples.

use stepper_real::Scalar;

use crate::compile::actuators::{MomentKind, VariableMoment};
use crate::compile::compiled_model::ModelStructure;
use crate::compile::equality::EqualityRows;
use crate::compile::tree::{CompiledJoint, Dof, MechanismPart, Mechanisms};
use crate::math::disjoint_sets::DisjointSets;
use crate::model::JointKind;

/// Kinematic tree on which the actuator of each activation acts; `None` if it acts on no degree of freedom.
pub(super) fn tree_of_act<S: Scalar>(structure: &ModelStructure<S>) -> Vec<Option<usize>> {
    let mut trees = vec![None; structure.na];
    for actuator in &structure.actuators {
        let dof = match &actuator.variable_moment {
            Some(VariableMoment { kind: MomentKind::Contacts { dof, .. }, .. }) => *dof,
            Some(wrench) => wrench.dofs.first().map(|&(dof, _)| dof),
            None => actuator.moment.first().map(|&(_, dof, _)| dof),
        };
        if let Some(act) = actuator.act {
            trees[act] = dof.map(|dof| structure.dofs[dof].tree);
        }
    }
    trees
}

/// A kinematic tree on which each scalar constraint row acts, by the index of its impulse.
pub(super) fn tree_of_scalar_impulse<S: Scalar>(structure: &ModelStructure<S>) -> Vec<Option<usize>> {
    let ModelStructure { dofs, limits, frictions, ball_limits, equalities, tendons, .. } = structure;
    let mut trees = vec![None; structure.scalar_impulses];
    for (tree, friction) in trees[limits.len()..].iter_mut().zip(frictions) {
        *tree = Some(dofs[friction.dof].tree);
    }
    for limit in limits.iter().chain(ball_limits) {
        trees[limit.impulse_index] = Some(dofs[limit.dof].tree);
    }
    let first = |list: &[u32]| list.first().map(|&dof| dofs[dof as usize].tree);
    for equality in equalities.iter().flat_map(|block| &block.equalities) {
        trees[equality.impulses()].fill(first(&equality.dofs));
    }
    for tendon in tendons {
        trees[tendon.impulse_index..tendon.impulse_index + 3].fill(first(&tendon.dofs));
    }
    trees
}

impl Mechanisms {
    /// Finds the mechanisms of a model. Equalities that are not active count too.
    pub(super) fn new<S: Scalar>(structure: &ModelStructure<S>) -> Self {
        let &ModelStructure { ntree, ref joints, ref dofs, ref mocap, ref equalities, ref tendons, ref actuators, .. } = structure;
        let mut sets = DisjointSets::new(ntree + mocap.len());
        let tree = |dof: usize| dofs[dof].tree;
        for equality in equalities.iter().flat_map(|block| &block.equalities) {
            let attached = match &equality.rows {
                EqualityRows::Points { paths, .. } => [paths[0].mocap, paths[1].mocap],
                EqualityRows::Coupling { .. } => [None; 2],
            };
            let trees = equality.dofs.iter().map(|&d| tree(d as usize));
            sets.join_all(trees.chain(attached.into_iter().flatten().map(|mocap| ntree + mocap)));
        }
        for tendon in tendons {
            sets.join_all(tendon.dofs.iter().map(|&d| tree(d as usize)));
        }
        for actuator in actuators {
            // Adhesion couples bodies only through their contacts.
            let wrench = actuator.variable_moment.iter().filter(|wrench| !matches!(wrench.kind, MomentKind::Contacts { .. }));
            let wrench = wrench.flat_map(|wrench| &wrench.dofs);
            sets.join_all(actuator.moment.iter().map(|&(_, d, _)| tree(d)).chain(wrench.map(|&(d, _)| tree(d))));
        }
        let (mut count, mut of_set) = (0, vec![0; ntree + mocap.len()]);
        for member in 0..of_set.len() {
            let root = sets.root(member);
            if root == member {
                (of_set[member], count) = (count, count + 1);
            } else {
                of_set[member] = of_set[root];
            }
        }
        let of_mocap = of_set.split_off(ntree);
        let parts = parts(&of_set, joints, dofs);
        Self { count, of_tree: of_set, of_mocap, parts }
    }
}

/// Parts of the list of degrees of freedom that belong to one mechanism each. `of_tree` has the mechanism of each kinematic tree.
fn parts<S: Scalar>(of_tree: &[usize], joints: &[CompiledJoint<S>], dofs: &[Dof]) -> Vec<MechanismPart> {
    let mut parts: Vec<MechanismPart> = vec![];
    for joint in joints {
        let (mechanism, [start, end]) = (of_tree[dofs[joint.v].tree], [joint.v, joint.v + joint.kind.nv()]);
        if parts.last().is_none_or(|part| part.mechanism != mechanism) {
            parts.push(MechanismPart { mechanism, dofs: start..start, rotations: vec![] });
        }
        let part = parts.last_mut().expect("a part was just added");
        part.dofs.end = end;
        let first = match joint.kind {
            JointKind::Free => start + 3,
            JointKind::Slide => continue,
            JointKind::Ball | JointKind::Hinge => start,
        };
        match part.rotations.last_mut() {
            Some(rotations) if rotations.end == first => rotations.end = end,
            _ => part.rotations.push(first..end),
        }
    }
    parts
}
