//! Compiled model: the numbers that the step reads, and no more than this scene needs.
//!
//! Bodies that cannot move relative to their parent are merged into one *link*. A *frame* is anything to which a geom can be fixed: frame 0
//! is the world, frames `1..=links` the links, the rest mocap bodies. Pairs that can never collide are not in the list.

use std::ops::Deref;

use stepper_real::Scalar;

use crate::compile::actuators::{CompiledActuator, CompiledActuatorDynamics, CompiledForceRange, CompiledServo};
use crate::compile::collision::{CompiledGeom, CompiledPair, DynamicPairs};
use crate::compile::equality::{CompiledTendon, EqualityBlock};
use crate::compile::merging::Merged;
use crate::compile::parameters::Params;
use crate::compile::passive::{CompiledFluid, CompiledSurface, GravityCompensation};
use crate::compile::sensing::CompiledSensing;
use crate::compile::softness::CompiledSoftness;
use crate::compile::static_pairs::StaticPairs;
use crate::compile::tree::{
    CompiledBallLimit, CompiledBody, CompiledFriction, CompiledJoint, CompiledLimit, CompiledMocap, CompiledSpinner, Descendant, Dof, Link,
};

/// Compiled model: everything that a step reads of a model, in the scalar type of its lanes.
#[derive(Clone, Debug)]
pub struct CompiledModel<S: Scalar> {
    /// Part that all environments share.
    pub structure: ModelStructure<S>,
    /// Parameters of the model. Environments may override them, see [`LaneModel`](crate::compile::LaneModel).
    pub params: Params<S>,
}

impl<S: Scalar> Deref for CompiledModel<S> {
    type Target = ModelStructure<S>;

    #[inline(always)]
    fn deref(&self) -> &ModelStructure<S> {
        &self.structure
    }
}

/// Compiled model without its parameters: its structure, and the numbers that are the same in all environments.
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
    /// Velocity of the medium, m/s.
    pub wind: [S; 3],
    /// Bodies on which the medium acts.
    pub fluid: Vec<CompiledFluid<S>>,
    /// Single bodies that can tumble.
    pub spinners: Vec<CompiledSpinner<S>>,
    /// Forces against gravity.
    pub compensation: Vec<GravityCompensation>,
    /// Surfaces that no degree of freedom moves.
    pub surfaces: Vec<CompiledSurface<S>>,
    /// Moving bodies, parents first; link l is frame l + 1.
    pub links: Vec<Link<S>>,
    /// Joints, by link.
    pub joints: Vec<CompiledJoint<S>>,
    /// Degrees of freedom.
    pub dofs: Vec<Dof>,
    /// Chains: `chain[dof.chain..][..dof.depth]` is the dof and its ancestors, towards the root. It is also the layout of the mass matrix's
    /// entries.
    pub chain: Vec<u32>,
    /// Descendants of the dofs: the range `dof.descendants` has those with the dof in their chain, without the dof itself, the last first.
    pub descendants: Vec<Descendant>,
    /// For every frame, the set of dofs that move it, as 64-bit words.
    pub moved_dofs: Vec<Vec<u64>>,
    /// Frames of mocap bodies and the bodies themselves.
    pub mocap: Vec<CompiledMocap<S>>,
    /// Frame of every body, and its pose in the frame.
    pub bodies: Vec<CompiledBody<S>>,
    /// Geoms that take part in collision.
    pub geoms: Vec<CompiledGeom<S>>,
    /// Indices of the geoms that are not fixed to the world.
    pub moving_geoms: Vec<usize>,
    /// Listed pairs: those that can collide, have a kernel and are not dynamic, in a fixed order.
    pub pairs: Vec<CompiledPair<S>>,
    /// Contact group of every listed pair: pairs with the same number join the same two frames. Empty if no pair has a group.
    pub contact_groups: Vec<u32>,
    /// Whether the contacts of any pair are springs.
    pub has_contact_springs: bool,
    /// Dynamic pairs: pairs of geoms that are too many to list.
    pub dynamic_pairs: Option<DynamicPairs<S>>,
    /// Static pairs: a moving geom and one that is fixed to the world.
    pub static_pairs: StaticPairs,
    /// Whether each link floats freely; empty if none does.
    pub floating: Vec<bool>,
    /// Whether any pair can have torsional or rolling friction.
    pub has_rolling_friction: bool,
    /// Joint limits.
    pub limits: Vec<CompiledLimit>,
    /// Dry friction.
    pub frictions: Vec<CompiledFriction>,
    /// Equalities of the model, in blocks.
    pub equalities: Vec<EqualityBlock<S>>,
    /// Limits of ball joints.
    pub ball_limits: Vec<CompiledBallLimit>,
    /// Fixed tendons with limits, dry friction, springs, dampers or inertia.
    pub tendons: Vec<CompiledTendon<S>>,
    /// Number of impulses that survive a step, one for every possible scalar row: limits, dry friction, then the rows with an `owner`.
    pub scalar_impulses: usize,
    /// Actuators.
    pub actuators: Vec<CompiledActuator<S>>,
    /// Actuators whose force depends on their length or velocity.
    pub servos: Vec<CompiledServo<S>>,
    /// Bounds of the sum of actuator forces on a dof.
    pub actuator_force_ranges: Vec<CompiledForceRange<S>>,
    /// Whether joint damping is explicit with Euler's rule.
    pub explicit_damping: bool,
    /// Whether any servo has a bound, of its force or of the sum of forces on a joint.
    pub servos_are_bounded: bool,
    /// Number of arms of all wrenches at sites, and number of wrenches.
    pub wrench_arms: [usize; 2],
    /// Number of actuator dynamics that act within a step.
    pub actuator_dynamics: usize,
    /// Whether actuator dynamics lose effort to friction.
    pub lossy: bool,
    /// Sensors, with their readings.
    pub sensing: CompiledSensing<S>,
    /// Whether there are pairs that can pass through each other: anything but half spaces and height fields.
    pub can_tunnel: bool,
    /// Largest number of contacts at once.
    pub contact_points: usize,
    /// Softness of constraints, with MuJoCo's contact law.
    pub softness: Option<CompiledSoftness<S>>,
    pub(crate) merged: Merged,
}

impl<S: Scalar> ModelStructure<S> {
    /// Number of frames: the world, the links and the mocap bodies.
    pub fn nframe(&self) -> usize {
        1 + self.links.len() + self.mocap.len()
    }

    /// Tree of the degrees of freedom that move a frame, if any.
    #[inline(always)]
    pub fn tree_of(&self, frame: usize) -> Option<usize> {
        let (w, word) = self.moved_dofs[frame].iter().enumerate().find(|(_, word)| **word != 0)?;
        Some(self.dofs[64 * w + word.trailing_zeros() as usize].tree)
    }

    /// Pair by its number.
    ///
    /// # Panics
    /// When there is none.
    #[inline(always)]
    pub fn pair(&self, number: usize) -> CompiledPair<S> {
        match self.pairs.get(number) {
            Some(pair) => *pair,
            None => self.dynamic_pairs.as_ref().and_then(|c| c.pair(number)).expect("a contact belongs to a pair"),
        }
    }

    /// Geoms of a pair, the simpler shape first; `None` if there is no pair of this number.
    #[inline(always)]
    pub fn pair_geoms(&self, number: usize) -> Option<[usize; 2]> {
        match self.pairs.get(number) {
            Some(pair) => Some(pair.geoms),
            None => self.dynamic_pairs.as_ref()?.geoms(number),
        }
    }

    /// Whether any actuator's effort has bounds.
    pub fn efforts_are_bounded(&self) -> bool {
        let bounded = |t: &CompiledActuatorDynamics<S>| t.limited || t.motor.is_some();
        let own = self.actuators.iter().any(|a| a.force_range.is_some() || a.dynamics.as_ref().is_some_and(bounded));
        own || !self.actuator_force_ranges.is_empty()
    }

    /// Chain of a dof: the dof and its ancestors, towards the root.
    #[inline(always)]
    pub fn chain_of(&self, dof: usize) -> &[u32] {
        let d = &self.dofs[dof];
        &self.chain[d.chain..d.chain + d.depth]
    }

    /// Descendants of a dof, the last first.
    #[inline(always)]
    pub fn descendants(&self, dof: usize) -> &[Descendant] {
        &self.descendants[self.dofs[dof].descendants.clone()]
    }
}
