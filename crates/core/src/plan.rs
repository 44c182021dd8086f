//! The compiled model: what the step reads, and no more than this scene needs.
//!
//! Bodies that cannot move against their parent are merged into one *link*. A *frame* is anything a geom can be fixed to: frame 0 is the world,
//! frames `1..=links` the links, the rest bodies that the user poses (mocap). Pairs that can never collide are not in the list.

mod collision;
mod merge;

use stepper_real::Scalar;

pub use crate::model::Kernel;
use crate::model::{Activation, JointKind, Model, SensorKind, Transmission};
pub use collision::{GeomPlan, PairPlan};

/// Everything of a model that a step reads, in the scalar type of its lanes.
#[derive(Clone, Debug)]
pub struct Plan<S: Scalar> {
    /// Number of configuration coordinates.
    pub nq: usize,
    /// Number of degrees of freedom.
    pub nv: usize,
    /// Number of actuator activations.
    pub na: usize,
    /// Number of kinematic trees.
    pub ntree: usize,
    /// Gravitational acceleration, m/s^2.
    pub gravity: [S; 3],
    /// Moving bodies, parents first; link l is frame l + 1.
    pub links: Vec<Link<S>>,
    /// Joints, by link.
    pub joints: Vec<JointPlan<S>>,
    /// Degrees of freedom.
    pub dofs: Vec<Dof<S>>,
    /// `chain[dof.chain..][..dof.depth]`: the dof and its ancestors, towards the root. Also the layout of the mass matrix's entries.
    pub chain: Vec<u32>,
    /// For every frame, the set of dofs that move it, as 64-bit words.
    pub movers: Vec<Vec<u64>>,
    /// Frames of mocap bodies and the bodies themselves.
    pub mocap: Vec<MocapPlan<S>>,
    /// Frame and pose in it of every body.
    pub bodies: Vec<BodyPlan<S>>,
    /// Geoms that take part in collision.
    pub geoms: Vec<GeomPlan<S>>,
    /// Pairs that can collide and for which there is a kernel, in a fixed order.
    pub pairs: Vec<PairPlan<S>>,
    /// Joint limits.
    pub limits: Vec<LimitPlan<S>>,
    /// Dry friction.
    pub frictions: Vec<FrictionPlan<S>>,
    /// Actuators.
    pub actuators: Vec<ActuatorPlan<S>>,
    /// Bounds of the sum of actuator forces: dof, low, high.
    pub actuator_force_ranges: Vec<(usize, S, S)>,
    /// Sensors: what each reads.
    pub sensors: Vec<SensorPlan>,
    /// Contacts that can exist at once.
    pub contact_points: usize,
}

/// A moving body with everything welded to it.
#[derive(Clone, Debug)]
pub struct Link<S> {
    /// The frame that it hangs from.
    pub parent: usize,
    /// Its kinematic tree.
    pub tree: usize,
    /// Whether it is the root of its tree.
    pub is_root: bool,
    /// Position in the parent frame before its joints, m.
    pub pos: [S; 3],
    /// Orientation in the parent frame before its joints; `None` when aligned.
    pub mat: Option<[S; 9]>,
    /// Mass, kg.
    pub mass: S,
    /// Centre of mass, m.
    pub com: [S; 3],
    /// Inertia about the centre of mass: xx, yy, zz, xy, xz, yz, kg m^2.
    pub inertia: [S; 6],
    /// Its joints.
    pub joints: std::ops::Range<usize>,
    /// Its degrees of freedom.
    pub dofs: std::ops::Range<usize>,
}

/// A joint.
#[derive(Clone, Debug)]
pub struct JointPlan<S> {
    /// How it moves.
    pub kind: JointKind,
    /// Address in q.
    pub q: usize,
    /// Address in v.
    pub v: usize,
    /// Anchor in the link's frame, m.
    pub anchor: [S; 3],
    /// Whether the anchor is the link's origin.
    pub centred: bool,
    /// Axis in the link's frame.
    pub axis: [S; 3],
    /// Which axis of the frame it is, if any, with its sign.
    pub principal: Option<(usize, bool)>,
    /// Position at which the joint changes nothing.
    pub reference: S,
    /// Spring stiffness.
    pub stiffness: S,
    /// Where the spring rests: one coordinate, or a quaternion, or position and quaternion.
    pub rest: [S; 7],
}

/// A degree of freedom.
#[derive(Clone, Debug)]
pub struct Dof<S> {
    /// The link that it moves.
    pub link: usize,
    /// Its kinematic tree.
    pub tree: usize,
    /// Start of its chain, and of its row in the mass matrix.
    pub chain: usize,
    /// Length of its chain.
    pub depth: usize,
    /// Viscous damping.
    pub damping: S,
    /// Added inertia.
    pub armature: S,
}

/// A body that the user poses.
#[derive(Clone, Debug)]
pub struct MocapPlan<S> {
    /// Its frame.
    pub frame: usize,
    /// Pose at reset.
    pub pos: [S; 3],
    /// Pose at reset.
    pub quat: [S; 4],
}

/// Where a body of the model is.
#[derive(Clone, Debug)]
pub struct BodyPlan<S> {
    /// The frame that it is fixed to.
    pub frame: usize,
    /// Its origin in that frame, m.
    pub pos: [S; 3],
    /// Its orientation in that frame.
    pub mat: [S; 9],
    /// Its own centre of mass in that frame, m.
    pub com: [S; 3],
}

/// Range of a hinge or slide.
#[derive(Clone, Debug)]
pub struct LimitPlan<S> {
    /// Address in q.
    pub q: usize,
    /// Degree of freedom.
    pub dof: usize,
    /// Lowest position.
    pub low: S,
    /// Highest position.
    pub high: S,
}

/// Dry friction of a degree of freedom.
#[derive(Clone, Debug)]
pub struct FrictionPlan<S> {
    /// Degree of freedom.
    pub dof: usize,
    /// N or N m.
    pub loss: S,
}

/// An actuator on a linear combination of scalar joints.
#[derive(Clone, Debug)]
pub struct ActuatorPlan<S> {
    /// Address in q, degree of freedom, moment arm (gear included).
    pub moment: Vec<(usize, usize, S)>,
    /// Bounds of the control.
    pub ctrl_range: Option<[S; 2]>,
    /// Bounds of the force.
    pub force_range: Option<[S; 2]>,
    /// Bounds of the activation.
    pub act_range: Option<[S; 2]>,
    /// Address of its activation.
    pub act: Option<usize>,
    /// Dynamics of the activation.
    pub activation: Activation,
    /// Affine gain.
    pub gain: [S; 3],
    /// Affine bias.
    pub bias: [S; 3],
    /// Whether gain or bias depend on length or velocity.
    pub needs_motion: bool,
}

/// What a sensor reads.
#[derive(Clone, Copy, Debug)]
pub enum SensorPlan {
    /// An entry of q.
    Position(usize),
    /// An entry of v.
    Velocity(usize),
}

impl<S: Scalar> Plan<S> {
    /// Compiles a finished model.
    pub fn new(model: &Model) -> Self {
        let merged = merge::Merged::new(model);
        let addresses = model.joint_addresses();
        let dofs = merge::dofs::<S>(model, &merged);
        let chain = merged.chain.clone();
        let limits = limits(model, &addresses);
        let (geoms, pairs) = collision::compile::<S>(model, &merged);
        let contact_points = pairs.iter().map(|p| p.kernel.points()).sum();
        Self {
            nq: model.nq(),
            nv: model.nv(),
            na: model.na(),
            ntree: merged.ntree,
            gravity: scalars(model.gravity),
            links: merge::links(model, &merged),
            joints: merge::joints(model, &addresses),
            dofs,
            chain,
            movers: merged.movers(model.nv()),
            mocap: merge::mocap(model, &merged),
            bodies: merge::bodies(model, &merged),
            geoms,
            pairs,
            limits,
            frictions: frictions(model, &addresses),
            actuators: actuators(model, &addresses),
            actuator_force_ranges: force_ranges(model, &addresses),
            sensors: sensors(model, &addresses),
            contact_points,
        }
    }

    /// Number of frames: the world, the links and the mocap bodies.
    pub fn nframe(&self) -> usize {
        1 + self.links.len() + self.mocap.len()
    }

    /// The dof and its ancestors, towards the root.
    #[inline(always)]
    pub fn chain_of(&self, dof: usize) -> &[u32] {
        let d = &self.dofs[dof];
        &self.chain[d.chain..d.chain + d.depth]
    }
}

/// The same numbers in the scalar type of the lanes.
pub(crate) fn scalars<S: Scalar, const N: usize>(x: [f64; N]) -> [S; N] {
    x.map(S::from_f64)
}

fn limits<S: Scalar>(model: &Model, addresses: &[(usize, usize)]) -> Vec<LimitPlan<S>> {
    let limited = model.joints.iter().zip(addresses).filter(|(j, _)| matches!(j.kind, JointKind::Hinge | JointKind::Slide));
    limited
        .filter_map(|(j, &(q, dof))| j.range.map(|[low, high]| LimitPlan { q, dof, low: S::from_f64(low), high: S::from_f64(high) }))
        .collect()
}

fn frictions<S: Scalar>(model: &Model, addresses: &[(usize, usize)]) -> Vec<FrictionPlan<S>> {
    let rough = model.joints.iter().zip(addresses).filter(|(j, _)| j.frictionloss > 0.0);
    rough.flat_map(|(j, &(_, v))| (v..v + j.kind.nv()).map(|dof| FrictionPlan { dof, loss: S::from_f64(j.frictionloss) })).collect()
}

fn actuators<S: Scalar>(model: &Model, addresses: &[(usize, usize)]) -> Vec<ActuatorPlan<S>> {
    let mut na = 0;
    let plan = |a: &crate::model::Actuator| {
        let arms: Vec<(usize, f64)> = match a.transmission {
            Transmission::Joint(j) => vec![(j, 1.0)],
            Transmission::Tendon(t) => model.tendons[t].joints.clone(),
        };
        let act = (a.activation != Activation::None).then_some(na);
        na += usize::from(act.is_some());
        ActuatorPlan {
            moment: arms.iter().map(|&(j, c)| (addresses[j].0, addresses[j].1, S::from_f64(c * a.gear))).collect(),
            ctrl_range: a.ctrl_range.map(scalars),
            force_range: a.force_range.map(scalars),
            act_range: a.act_range.map(scalars),
            act,
            activation: a.activation,
            gain: scalars(a.gain),
            bias: scalars(a.bias),
            needs_motion: [a.gain[1], a.gain[2], a.bias[1], a.bias[2]].iter().any(|&x| x != 0.0),
        }
    };
    model.actuators.iter().map(plan).collect()
}

fn force_ranges<S: Scalar>(model: &Model, addresses: &[(usize, usize)]) -> Vec<(usize, S, S)> {
    let bounded = model.joints.iter().zip(addresses).filter(|(j, _)| matches!(j.kind, JointKind::Hinge | JointKind::Slide));
    bounded.filter_map(|(j, &(_, v))| j.actuator_force_range.map(|[lo, hi]| (v, S::from_f64(lo), S::from_f64(hi)))).collect()
}

fn sensors(model: &Model, addresses: &[(usize, usize)]) -> Vec<SensorPlan> {
    let read = |s: &crate::model::Sensor| match s.kind {
        SensorKind::JointPos(j) => SensorPlan::Position(addresses[j].0),
        SensorKind::JointVel(j) => SensorPlan::Velocity(addresses[j].1),
    };
    model.sensors.iter().map(read).collect()
}
