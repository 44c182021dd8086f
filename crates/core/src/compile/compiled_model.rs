//! Compiled model: the numbers that the step reads, and only those that this scene needs.
//!
//! A *link* consists of a body with joints and all bodies that are fixed to that body. A *frame* is anything to which a geom can be fixed:
//! frame 0 is the world, frames `1..=links` are the links, and the other frames are mocap bodies. Pairs that can never collide are left
//! out.

use std::ops::Deref;

use stepper_real::{Real, Scalar};

use crate::compile::actuators::{
    CompiledActuator, CompiledActuatorDynamics, CompiledForceRange, CompiledServo, MomentKind, VariableMoment,
};
use crate::compile::adhesion::CompiledAdhesion;
use crate::compile::collision::{CompiledGeom, CompiledPair, DynamicPairs};
use crate::compile::equality::{CompiledTendon, EqualityBlock};
use crate::compile::merging::Merged;
use crate::compile::parameters::Params;
use crate::compile::passive::{CompiledFluid, CompiledSurface, GravityCompensation};
use crate::compile::paths::CompiledPath;
use crate::compile::sensing::CompiledSensing;
use crate::compile::softness::CompiledSoftness;
use crate::compile::static_pairs::StaticPairs;
use crate::compile::tree::{
    CompiledBody, CompiledFriction, CompiledJoint, CompiledLimit, CompiledMocap, CompiledSingleBody, Descendant, Dof, Link, Mechanisms,
};

/// Compiled model: everything that a step reads of a model, in the scalar type of its lanes. Parameters have the type `T`.
#[derive(Clone, Debug)]
pub struct CompiledModel<S: Scalar, T = S> {
    /// Structure that all environments share. A lane model has a copy and not a reference, so that reading it takes no additional memory
    /// access.
    pub structure: ModelStructure<S>,
    /// Parameters of the model: masses, sizes, friction and similar numbers. Environments may override them, see
    /// [`LaneModel`](crate::compile::LaneModel).
    pub params: Params<T>,
}

impl<S: Scalar> CompiledModel<S> {
    /// Copy of the model with the shared parameters in every lane.
    pub fn in_lanes<R: Real<Scalar = S>>(&self) -> CompiledModel<S, R> {
        CompiledModel { structure: self.structure.clone(), params: self.params.map(R::splat) }
    }
}

impl<S: Scalar, T> Deref for CompiledModel<S, T> {
    type Target = ModelStructure<S>;

    #[inline(always)]
    fn deref(&self) -> &ModelStructure<S> {
        &self.structure
    }
}

/// Structure of a compiled model: everything except the parameters that can differ between environments.
#[derive(Clone, Debug)]
pub struct ModelStructure<S: Scalar> {
    /// Number of configuration coordinates.
    pub nq: usize,
    /// Number of degrees of freedom.
    pub nv: usize,
    /// Number of actuator activations.
    pub na: usize,
    /// Number of kinematic trees.
    pub ntree: usize,
    /// Mechanisms: sets of kinematic trees that the model couples.
    pub mechanisms: Mechanisms,
    /// Kinematic tree on which the actuator of each activation acts; `None` if it acts on no degree of freedom.
    pub tree_of_act: Vec<Option<usize>>,
    /// A kinematic tree on which each scalar constraint row acts; `None` if it acts on no degree of freedom. The indices are those of the
    /// list of impulses of scalar constraint rows.
    pub tree_of_scalar_impulse: Vec<Option<usize>>,
    /// Velocity of the surrounding fluid in world axes, m/s.
    pub wind: [S; 3],
    /// Bodies and geoms on which the surrounding fluid exerts forces.
    pub fluid: Vec<CompiledFluid<S>>,
    /// Single bodies: links on a free or ball joint that are alone in their kinematic tree. Their gyroscopic torque is integrated
    /// separately.
    pub single_bodies: Vec<CompiledSingleBody<S>>,
    /// Gravity compensation forces (`gravcomp`).
    pub compensation: Vec<GravityCompensation>,
    /// Conveyor surfaces, and surfaces of mocap bodies: they move without a degree of freedom.
    pub surfaces: Vec<CompiledSurface<S>>,
    /// Links: moving bodies, parents first; link l is frame l + 1.
    pub links: Vec<Link<S>>,
    /// Joints, in the order of their links.
    pub joints: Vec<CompiledJoint<S>>,
    /// Degrees of freedom.
    pub dofs: Vec<Dof>,
    /// Descendants of all degrees of freedom (dofs) in one list. The range `dof.descendants` has all dofs below this dof in its kinematic
    /// tree, from the last to the first.
    pub descendants: Vec<Descendant>,
    /// For each frame, the set of degrees of freedom that move it, as bits of 64-bit words.
    pub moved_dofs: Vec<Vec<u64>>,
    /// Mocap bodies and their frames.
    pub mocap: Vec<CompiledMocap<S>>,
    /// Bodies of the model, with the frame to which each is fixed and the pose in that frame.
    pub bodies: Vec<CompiledBody<S>>,
    /// Geoms that can collide.
    pub geoms: Vec<CompiledGeom<S>>,
    /// Indices in `geoms` of the geoms that are not fixed to the world.
    pub moving_geoms: Vec<usize>,
    /// Listed pairs: pairs of geoms that can collide, that have a collision function, and that are not in `dynamic_pairs`. Their order is
    /// fixed.
    pub pairs: Vec<CompiledPair<S>>,
    /// Number of the pair group of each pair in `pairs`; `NO_PAIR_GROUP` for a pair without a group. The list
    /// is empty if no pair has a group. `pair_groups` in `compile/collision.rs` defines the groups.
    pub pair_groups: Vec<u32>,
    /// Whether any pair has contact springs.
    pub has_contact_springs: bool,
    /// Dynamic pairs: pairs of geoms that are too numerous to list. `None` if all pairs are listed.
    pub dynamic_pairs: Option<DynamicPairs<S>>,
    /// Static pairs: pairs of a moving geom and a geom that is fixed to the world, both bounded and convex.
    pub static_pairs: StaticPairs,
    /// For each link, whether it is alone on a free joint, without other links in its tree. The list is empty if no link is alone on a free
    /// joint.
    pub floating: Vec<bool>,
    /// Whether any pair can have torsional or rolling friction.
    pub has_rolling_friction: bool,
    /// Limits of hinge and slide joints.
    pub limits: Vec<CompiledLimit>,
    /// Dry friction (`frictionloss`) of degrees of freedom.
    pub frictions: Vec<CompiledFriction>,
    /// Equalities of the model, grouped in blocks whose rows are assembled together.
    pub equalities: Vec<EqualityBlock<S>>,
    /// Limits of ball joints.
    pub ball_limits: Vec<CompiledLimit>,
    /// Tendons with limits, dry friction, springs, dampers or inertia.
    pub tendons: Vec<CompiledTendon<S>>,
    /// Paths of all spatial tendons.
    pub paths: Vec<CompiledPath<S>>,
    /// Length of the list of impulses of scalar constraint rows. The list begins with joint limits, followed by dry friction. Ball limits,
    /// equalities and tendons come last, each from its `impulse_index` on.
    pub scalar_impulses: usize,
    /// Actuators.
    pub actuators: Vec<CompiledActuator<S>>,
    /// Servos: actuators whose force depends on the length or velocity of the actuator.
    pub servos: Vec<CompiledServo<S>>,
    /// Bounds of the sum of actuator forces on one dof (`actuatorfrcrange`).
    pub actuator_force_ranges: Vec<CompiledForceRange<S>>,
    /// Gaps up to which actuators pull on contacts of a body; `None` without such actuators.
    pub adhesion: Option<CompiledAdhesion<S>>,
    /// Whether Euler's rule treats joint damping explicitly.
    pub explicit_damping: bool,
    /// Whether any servo's force is bounded, directly or by the sum of forces on its joint.
    pub servos_are_bounded: bool,
    /// Number of variable moment arms, then number of actuators with a variable moment. Each such actuator has one moment arm for each
    /// degree of freedom on which it acts.
    pub variable_arms: [usize; 2],
    /// Number of actuators with actuator dynamics that act within a step: a continuous servo, motor, force limits or friction losses.
    pub num_actuator_dynamics: usize,
    /// Whether any actuator dynamics have friction losses.
    pub lossy: bool,
    /// Sensors of the model.
    pub sensing: CompiledSensing<S>,
    /// Whether the scene has pairs of geoms neither of which is a plane. Such geoms may pass through each other within a step.
    pub can_tunnel: bool,
    /// Upper bound of the number of contacts of an environment.
    pub contact_points: usize,
    /// Constraint parameters of MuJoCo's contact law; `None` with hard contact.
    pub softness: Option<CompiledSoftness<S>>,
    pub(crate) merged: Merged,
}

impl<S: Scalar> ModelStructure<S> {
    /// Number of frames: the world, the links and the mocap bodies.
    pub fn nframe(&self) -> usize {
        1 + self.links.len() + self.mocap.len()
    }

    /// Kinematic tree of the frame `frame`; `None` if no degree of freedom moves the frame.
    #[inline(always)]
    pub fn tree_of(&self, frame: usize) -> Option<usize> {
        Some(self.links.get(frame.checked_sub(1)?)?.tree)
    }

    /// Mechanism of the degree of freedom `dof`.
    #[inline(always)]
    pub fn mechanism_of(&self, dof: usize) -> usize {
        self.mechanisms.of_tree[self.dofs[dof].tree]
    }

    /// Degrees of freedom that are rotations.
    #[inline(always)]
    pub fn rotations(&self) -> impl Iterator<Item = usize> {
        self.mechanisms.parts.iter().flat_map(|part| part.rotations.iter().cloned().flatten())
    }

    /// Mechanisms of two geoms: at most two, without geoms that are fixed to the world.
    #[inline(always)]
    pub fn mechanisms_of(&self, geoms: [usize; 2]) -> impl Iterator<Item = usize> {
        geoms.map(|geom| self.mechanism_of_geom(geom)).into_iter().flatten()
    }

    /// Mechanism of the geom `geom`; `None` if the geom is fixed to the world.
    #[inline(always)]
    pub fn mechanism_of_geom(&self, geom: usize) -> Option<usize> {
        let link = self.geoms[geom].frame.checked_sub(1)?;
        Some(match link.checked_sub(self.links.len()) {
            Some(mocap) => self.mechanisms.of_mocap[mocap],
            None => self.mechanisms.of_tree[self.links[link].tree],
        })
    }

    /// Kinematic tree of each configuration coordinate.
    pub fn tree_of_q(&self) -> Vec<usize> {
        let mut trees = vec![0; self.nq];
        for joint in &self.joints {
            trees[joint.q..joint.q + joint.kind.nq()].fill(self.dofs[joint.v].tree);
        }
        trees
    }

    /// Pair `index`: a pair in `pairs`, or one of the dynamic pairs.
    ///
    /// # Panics
    /// When the model has no such pair.
    #[inline(always)]
    pub fn pair(&self, index: usize) -> CompiledPair<S> {
        match self.pairs.get(index) {
            Some(pair) => *pair,
            None => self.dynamic_pairs.as_ref().and_then(|c| c.pair(index)).expect("a contact belongs to a pair"),
        }
    }

    /// Geoms of the pair `index`, as indices in the compiled model; `None` if there is no such pair. The simpler shape is
    /// first.
    #[inline(always)]
    pub fn pair_geoms(&self, index: usize) -> Option<[usize; 2]> {
        match self.pairs.get(index) {
            Some(pair) => Some(pair.geoms),
            None => self.dynamic_pairs.as_ref()?.geoms(index),
        }
    }

    /// Actuators that pull on the contacts of a body: index of the body, and moment.
    pub(crate) fn adhesive_actuators(&self) -> impl Iterator<Item = (usize, &VariableMoment<S>)> {
        let moments = self.actuators.iter().filter_map(|actuator| actuator.variable_moment.as_ref());
        moments.filter_map(|moment| if let MomentKind::Contacts { body, .. } = moment.kind { Some((body, moment)) } else { None })
    }

    /// Whether any actuator force, or any sum of actuator forces on a degree of freedom, has bounds.
    pub fn actuator_forces_are_bounded(&self) -> bool {
        let bounded = |t: &CompiledActuatorDynamics<S>| t.limited || t.motor.is_some();
        let own = self.actuators.iter().any(|a| a.force_range.is_some() || a.dynamics.as_ref().is_some_and(bounded));
        own || !self.actuator_force_ranges.is_empty()
    }

    /// Chain of a degree of freedom: the dof itself and its ancestors, towards the root.
    #[inline(always)]
    pub fn chain_of(&self, dof: usize) -> &[u32] {
        let d = &self.dofs[dof];
        &self.merged.chain[d.chain..d.chain + d.depth]
    }

    /// Descendants of a degree of freedom: all dofs below it in its kinematic tree, from the last to the first.
    #[inline(always)]
    pub fn descendants(&self, dof: usize) -> &[Descendant] {
        &self.descendants[self.dofs[dof].descendants.clone()]
    }
}
