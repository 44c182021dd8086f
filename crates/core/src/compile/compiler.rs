//! Compiler: converts a finished model to a compiled model.

use stepper_real::Scalar;

use crate::compile::adhesion::CompiledAdhesion;
use crate::compile::collision::DynamicPairs;
use crate::compile::compiled_model::{CompiledModel, ModelStructure};
use crate::compile::limits::{frictions, is_scalar, limits};
use crate::compile::mechanisms::{tree_of_act, tree_of_scalar_impulse};
use crate::compile::merging::Merged;
use crate::compile::sensing::CompiledSensing;
use crate::compile::static_pairs::StaticPairs;
use crate::compile::tree::{CompiledJoint, CompiledSingleBody, Link, Mechanisms, scalars};
use crate::compile::{actuators, collision, equality, merging, passive, paths};
use crate::model::actuator_spec::ActuatorSpec;
use crate::model::{Joint, JointKind, Model};

impl<S: Scalar> CompiledModel<S> {
    /// Compiles a finished model.
    pub fn new(model: &Model) -> Self {
        Self::with_actuator_specs(model, &[])
    }

    /// Compiles a model with actuator dynamics, one spec for every actuator. The model must be the result of [`ActuatorSpec::combine`].
    pub fn with_actuator_specs(model: &Model, specs: &[Option<ActuatorSpec>]) -> Self {
        let merged = Merged::new(model);
        let (dofs, descendants) = merging::dofs(model, &merged);
        let frictions = frictions(model, specs, &merged);
        let limits_of = |first: usize, is_of_kind: fn(&Joint) -> bool| limits(model, &merged, first, is_of_kind);
        let limits = limits_of(0, is_scalar);
        let ball_limits = limits_of(limits.len() + frictions.len(), |joint| joint.kind == JointKind::Ball);
        let mut scalar_impulses = limits.len() + frictions.len() + ball_limits.len();
        let compiler = equality::Compiler { model, merged: &merged };
        let paths = paths::paths(model, &merged);
        let lengths = compiler.lengths(&paths);
        let (equalities, tendons) = (compiler.equalities(&paths, &mut scalar_impulses), compiler.tendons(&paths, &mut scalar_impulses));
        let (geoms, pairs, dynamic_pairs) = collision::compile::<S>(model, &merged);
        let adhesion = CompiledAdhesion::new(model, &geoms, &pairs, dynamic_pairs.as_ref());
        let can_tunnel = dynamic_pairs.is_some() || pairs.iter().any(|p| !p.geoms.iter().any(|&g| geoms[g].is_plane));
        let listed: usize = pairs.iter().map(|p| p.kernel.points()).sum();
        let contact_points = listed + dynamic_pairs.as_ref().map_or(0, DynamicPairs::contact_points);
        let (links, joints) = (merging::links(model, &merged), merging::joints(model, &merged));
        let single_bodies = Self::single_bodies(&links, &joints);
        let moved_dofs = merged.moved_dofs(model.nv());
        let input = actuators::CompilerInput { model, merged: &merged, frictions: &frictions, paths: &paths };
        let actuators = actuators::CompiledActuators::new(input, specs);
        let lossy = frictions.iter().any(|f| f.driven);
        let structure = ModelStructure {
            nq: model.nq(),
            nv: model.nv(),
            na: model.na(),
            ntree: merged.ntree,
            mechanisms: Mechanisms::default(),
            tree_of_act: vec![],
            tree_of_scalar_impulse: vec![],
            wind: scalars(model.medium.wind),
            fluid: passive::fluid(model, &merged),
            compensation: passive::compensation(model, &merged),
            surfaces: passive::surfaces(model, &geoms, merged.leaders.len()),
            floating: Self::floating(&single_bodies, links.len()),
            single_bodies,
            links,
            joints,
            dofs,
            descendants,
            moved_dofs,
            mocap: merging::mocap(model, &merged),
            bodies: merging::bodies(model, &merged),
            pair_groups: collision::pair_groups(&geoms, &pairs),
            moving_geoms: (0..geoms.len()).filter(|&g| geoms[g].frame != 0).collect(),
            geoms,
            has_rolling_friction: dynamic_pairs.as_ref().is_some_and(|pairs| pairs.has_rolling_friction)
                || pairs.iter().any(|p| p.condim > 3),
            has_contact_springs: pairs.iter().any(|p| p.spring.is_some())
                || dynamic_pairs.is_some() && model.geoms.iter().any(|g| !g.spring.is_rigid()),
            pairs,
            dynamic_pairs,
            static_pairs: StaticPairs::default(),
            frictions,
            ball_limits,
            equalities,
            scalar_impulses,
            adhesion,
            explicit_damping: model.explicit_damping,
            servos_are_bounded: actuators.servos_are_bounded(),
            variable_arms: [actuators.arms, actuators.variable_moments],
            num_actuator_dynamics: actuators.num_actuator_dynamics,
            lossy,
            actuators: actuators.actuators,
            servos: actuators.servos,
            actuator_force_ranges: actuators.force_ranges,
            sensing: CompiledSensing::new(&compiler, &limits, (&tendons, &lengths), lossy),
            limits,
            tendons,
            paths,
            can_tunnel,
            contact_points,
            softness: None,
            merged,
        };
        let params = structure.params_of(model).map(S::from_f64);
        let ModelStructure { geoms, pairs, dynamic_pairs, ntree, .. } = &structure;
        let group = |frame: usize| structure.tree_of(frame).unwrap_or(frame + ntree);
        let static_pairs = StaticPairs::new(geoms, (pairs, dynamic_pairs.as_ref()), |geom| params.geom(geom).pos.map(S::to_f64), group);
        let (tree_of_act, tree_of_scalar_impulse) = (tree_of_act(&structure), tree_of_scalar_impulse(&structure));
        let mechanisms = Mechanisms::new(&structure);
        Self { structure: ModelStructure { static_pairs, mechanisms, tree_of_act, tree_of_scalar_impulse, ..structure }, params }
    }

    /// Finds the single bodies: links on a free or ball joint that are alone in their kinematic tree.
    fn single_bodies(links: &[Link<S>], joints: &[CompiledJoint<S>]) -> Vec<CompiledSingleBody<S>> {
        let mut has_child = vec![false; links.len()];
        links.iter().filter(|link| !link.is_root).for_each(|link| has_child[link.parent - 1] = true);
        let alone = |l: usize| links[l].is_root && !has_child[l];
        let single = |l: usize| {
            let link = &links[l];
            let [joint] = &joints[link.joints.clone()] else { return None };
            if !matches!(joint.kind, JointKind::Free | JointKind::Ball) || !alone(l) {
                return None;
            }
            let anchor = if joint.kind == JointKind::Ball { joint.anchor } else { [S::default(); 3] };
            Some(CompiledSingleBody { link: l, dof: joint.v, kind: joint.kind, anchor })
        };
        (0..links.len()).filter_map(single).collect()
    }

    /// For each link, whether it is alone on a free joint, without other links in its tree. `links` is the number of links. The list is
    /// empty if no link is alone on a free joint.
    fn floating(single_bodies: &[CompiledSingleBody<S>], links: usize) -> Vec<bool> {
        let mut floating = vec![];
        for single in single_bodies.iter().filter(|s| s.kind == JointKind::Free) {
            floating.resize(links, false);
            floating[single.link] = true;
        }
        floating
    }
}
