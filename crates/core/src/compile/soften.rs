//! Softening of a compiled model: adds the constraint parameters of MuJoCo's contact law.

use stepper_real::Scalar;
use stepper_solve::soft::SlipEffort;

use crate::compile::collision::radii_of;
use crate::compile::compiled_model::{CompiledModel, ModelStructure};
use crate::compile::softness::{CompiledSoftness, LawMaker};
use crate::compile::tree::{CompiledFriction, CompiledLimit};
use crate::model::{Cone, Equality, EqualityKind, Filter, InverseWeights, MIN_VALUE, Model, SoftSettings};

impl<S: Scalar> CompiledModel<S> {
    /// Adds the constraint parameters of MuJoCo's contact law, for steps of `timestep` seconds.
    ///
    /// The function also removes the pair groups. They serve to remove redundant contacts, but MuJoCo's contact law determines the force of
    /// every contact.
    pub(crate) fn soften(&mut self, model: &Model, weights: &InverseWeights, timestep: f64) {
        let SoftSettings { cone, impratio, refsafe, noslip, .. } = model.soft;
        let effort = SlipEffort { sweeps: noslip.iterations, tolerance: S::from_f64(noslip.tolerance) };
        let least_time = if refsafe { 2.0 * timestep } else { 0.0 };
        let maker = LawMaker { least_time, timestep };
        let geom_weights: Vec<f64> = model.geoms.iter().map(|g| weights.bodies[g.body][0]).collect();
        let addresses = &self.structure.merged.addresses;
        let limit = |l: &CompiledLimit| maker.law(&model.joints[l.joint].limit_softness, weights.dofs[l.dof]);
        let friction = |f: &CompiledFriction| maker.friction(&model.joints[f.joint].friction_softness, weights.dofs[f.dof]);
        let tendons = self.structure.tendons.iter().map(|t| {
            let (tendon, weight) = (&model.tendons[t.index], weights.tendons[t.index]);
            [maker.law(&tendon.limit_softness, weight), maker.friction(&tendon.friction_softness, weight)]
        });
        let equalities = model.equalities.iter().map(|e| {
            let [translation, rotation] = equality_weights(e, weights, addresses);
            [maker.law(&e.softness, translation), maker.law(&e.softness, rotation)]
        });
        let filter = Filter::new(model);
        let pairs = self.structure.pairs.iter().map(|pair| {
            let geoms = pair.geoms.map(|g| self.structure.geoms[g].index);
            let [a, b] = geoms;
            let pair = filter.pair(geoms).expect("a compiled pair is one of the model");
            maker.contact(&pair, geom_weights[a] + geom_weights[b])
        });
        let softness = CompiledSoftness {
            cone: match cone {
                Cone::Pyramidal => stepper_solve::soft::Cone::Pyramidal,
                Cone::Elliptic => stepper_solve::soft::Cone::Elliptic,
            },
            impratio: S::from_f64(impratio.max(MIN_VALUE)),
            noslip: (noslip.iterations > 0).then_some(effort),
            pairs: pairs.collect(),
            limits: self.structure.limits.iter().map(limit).collect(),
            frictions: self.structure.frictions.iter().map(friction).collect(),
            ball_limits: self.structure.ball_limits.iter().map(limit).collect(),
            tendons: tendons.collect(),
            equalities: equalities.collect(),
            maker,
            geom_weights,
            geom_bodies: model.geoms.iter().map(|g| g.body as u32).collect(),
            order: order_by_size(model, &self.structure),
        };
        self.structure.pair_groups.clear();
        self.structure.softness = Some(softness);
    }
}

/// Order of the degrees of freedom in the solver's matrix: tree by tree, the largest tree first. The solver eliminates them from the last
/// to the first.
///
/// A large tree has contacts with many other trees. If it were eliminated early, all these trees would be coupled with each other. The
/// order depends only on the model, so that all environments share it.
fn order_by_size<S: Scalar>(model: &Model, structure: &ModelStructure<S>) -> Vec<u32> {
    let mut sizes = vec![0.0; structure.ntree];
    for geom in &structure.geoms {
        if let Some(tree) = structure.tree_of(geom.frame) {
            sizes[tree] += radii_of(model, geom.index).bounding_radius;
        }
    }
    let tree = |d: u32| structure.dofs[d as usize].tree;
    let mut order: Vec<u32> = (0..structure.nv as u32).collect();
    order.sort_by(|&a, &b| sizes[tree(b)].total_cmp(&sizes[tree(a)]).then(tree(a).cmp(&tree(b))));
    order
}

/// Approximate inverse inertias along the translational and the rotational rows of an equality, 1/kg or 1/(kg m^2) (`mj_diagApprox`).
fn equality_weights(equality: &Equality, weights: &InverseWeights, addresses: &[(usize, usize)]) -> [f64; 2] {
    use EqualityKind::{Connect, Joint, Tendon, Weld};
    let both = |a: f64, b: Option<f64>| [a + b.unwrap_or(0.0); 2];
    match equality.kind {
        Connect { bodies: [a, b], .. } | Weld { bodies: [a, b], .. } => {
            std::array::from_fn(|k| weights.bodies[a][k] + weights.bodies[b][k])
        }
        Joint { joint, other, .. } => {
            let weight = |j: usize| weights.dofs[addresses[j].1];
            both(weight(joint), other.map(weight))
        }
        Tendon { tendon, other, .. } => both(weights.tendons[tendon], other.map(|t| weights.tendons[t])),
    }
}
