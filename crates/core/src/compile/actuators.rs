//! Actuators, and the entries of the mass matrix to which springs and dampers among them contribute.

use std::f64::consts::PI;

use stepper_real::Scalar;

use crate::actuation::ActuatorSpec;
use crate::compile::merging::{Merged, matrix, quaternion, vector};
use crate::compile::tree::{CompiledFriction, Dof, scalars};
use crate::model::{Activation, Actuator, JointKind, Model, Transmission};

/// Actuator on a linear combination of scalar joints, or on a site.
#[derive(Clone, Debug)]
pub struct CompiledActuator<S> {
    /// Terms of the moment: address in q, degree of freedom, moment arm (gear included). Empty for an actuator on a site.
    pub moment: Vec<(usize, usize, S)>,
    /// Wrench of the actuator on a site, if it acts on one.
    pub wrench: Option<CompiledWrench<S>>,
    /// Bounds of the control.
    pub ctrl_range: Option<[S; 2]>,
    /// Bounds of the force.
    pub force_range: Option<[S; 2]>,
    /// Bounds of the activation.
    pub act_range: Option<[S; 2]>,
    /// Address of the actuator's activation.
    pub act: Option<usize>,
    /// Dynamics of the activation.
    pub activation: Activation,
    /// Whether gain or bias depend on length or velocity.
    pub needs_motion: bool,
    /// Index among the servos.
    pub servo: Option<usize>,
    /// Part of the actuator's dynamics that acts within a step.
    pub dynamics: Option<CompiledActuatorDynamics<S>>,
    /// Index of the force range of the joint that it drives, if that joint has one. Actuators on tendons have none.
    pub joint_force_range: Option<usize>,
}

/// Place of a site.
#[derive(Clone, Copy, Debug)]
pub struct Spot<S> {
    /// Frame of the compiled model.
    pub frame: usize,
    /// Position in the frame, m.
    pub pos: [S; 3],
    /// Orientation in the frame.
    pub mat: [S; 9],
}

/// Wrench at a site: an actuator whose moment depends on the configuration.
#[derive(Clone, Debug)]
pub struct CompiledWrench<S> {
    /// Site on which the wrench acts.
    pub site: Spot<S>,
    /// Reference site, in whose frame the wrench is given and on which the reaction acts.
    pub reference: Option<Spot<S>>,
    /// Force and torque per unit of the actuator's force, gear included.
    pub wrench: [S; 6],
    /// Change of the length by a whole turn, if the length is an angle.
    pub turn: Option<S>,
    /// Dofs that move the site (1) or the reference (-1), but not both.
    pub dofs: Vec<(usize, S)>,
    /// Offset of its arms in the list of arms of all wrenches. Its length has the index of the wrench.
    pub arms: usize,
    /// Index among the wrenches.
    pub index: usize,
}

/// Part of an actuator's dynamics that acts within a step: bounds and force laws that differ between environments.
#[derive(Clone, Copy, Debug)]
pub struct CompiledActuatorDynamics<S> {
    /// Index among the actuator dynamics that act within a step.
    pub index: usize,
    /// Whether it is a continuous servo.
    pub servo: bool,
    /// Whether it is a motor with a torque-speed curve, and whether the control is its voltage.
    pub motor: Option<bool>,
    /// Whether the effort has limits.
    pub limited: bool,
    /// Row of dry friction with its losses, and the moment arm there.
    pub losses: Option<(usize, S)>,
}

/// Actuator whose force depends on its length or velocity.
#[derive(Clone, Debug)]
pub struct CompiledServo<S> {
    /// Index of the actuator.
    pub actuator: usize,
    /// Entries of the mass matrix for pairs of dofs on one branch, and the factors of the added inertia there.
    pub entries: Vec<(usize, S)>,
    /// Entries of an actuator on a site: entries and the two arms whose product is the factor.
    pub products: Vec<(usize, [usize; 2])>,
    /// Diagonal bound of a moment across branches, used instead of `entries`: entries and factors; empty for a moment on one branch.
    pub bound: Vec<(usize, S)>,
    /// Diagonal bound of an actuator on a site, used instead of `products`: entries and their arms.
    pub spread: Vec<(usize, usize)>,
}

/// Bounds of the sum of actuator forces on a dof.
#[derive(Clone, Debug)]
pub struct CompiledForceRange<S> {
    /// Degree of freedom.
    pub dof: usize,
    /// Lowest and highest sum.
    pub bounds: [S; 2],
    /// Actuators that act on it, and their moment arms.
    pub actuators: Vec<(usize, S)>,
    /// Whether any of these actuators is a servo.
    pub has_servos: bool,
}

/// Parts of the scene that actuators refer to.
#[derive(Clone, Copy)]
pub(super) struct Scene<'a> {
    pub(super) model: &'a Model,
    pub(super) merged: &'a Merged,
    pub(super) addresses: &'a [(usize, usize)],
    pub(super) moved_dofs: &'a [Vec<u64>],
    pub(super) dofs: &'a [Dof],
    pub(super) chain: &'a [u32],
    pub(super) frictions: &'a [CompiledFriction],
}

pub(super) struct Drives<S> {
    pub(super) actuators: Vec<CompiledActuator<S>>,
    pub(super) servos: Vec<CompiledServo<S>>,
    pub(super) force_ranges: Vec<CompiledForceRange<S>>,
    /// Number of arms of all wrenches, and number of wrenches.
    pub(super) arms: usize,
    pub(super) wrenches: usize,
    /// Number of actuator dynamics that act within a step.
    pub(super) actuator_dynamics: usize,
}

impl<S: Scalar> Drives<S> {
    /// Compiler of actuators. `specs` has an entry for every actuator of the model, or none at all.
    pub(super) fn new(scene: Scene<'_>, specs: &[Option<ActuatorSpec>]) -> Self {
        let model = scene.model;
        let mut drives = Self { actuators: vec![], servos: vec![], force_ranges: vec![], arms: 0, wrenches: 0, actuator_dynamics: 0 };
        let mut na = 0;
        for (i, actuator) in model.actuators.iter().enumerate() {
            let spec = specs.get(i).and_then(Option::as_ref);
            drives.push(scene, actuator, spec, &mut na);
        }
        let bounded = model.joints.iter().zip(scene.addresses).filter(|(j, _)| matches!(j.kind, JointKind::Hinge | JointKind::Slide));
        let ranges = bounded.filter_map(|(j, &(_, dof))| j.actuator_force_range.map(|range| (dof, range)));
        drives.force_ranges = ranges.map(|(dof, range)| drives.force_range(dof, range)).collect();
        for (compiled, actuator) in drives.actuators.iter_mut().zip(&model.actuators) {
            let Transmission::Joint(j) = actuator.transmission else { continue };
            compiled.joint_force_range = drives.force_ranges.iter().position(|range| range.dof == scene.addresses[j].1);
        }
        drives
    }

    fn push(&mut self, scene: Scene<'_>, a: &Actuator, spec: Option<&ActuatorSpec>, na: &mut usize) {
        let addresses = scene.addresses;
        let arms: Vec<(usize, f64)> = match a.transmission {
            Transmission::Joint(j) => vec![(j, 1.0)],
            Transmission::Tendon(t) => scene.model.tendons[t].joints.clone(),
            Transmission::Site { .. } => vec![],
        };
        let wrench = self.wrench(scene, a);
        let act = (a.activation != Activation::None).then_some(*na);
        *na += usize::from(act.is_some());
        let dynamics = self.dynamics(scene, a, spec);
        let moves = dynamics.as_ref().is_some_and(|t| t.servo || t.motor.is_some());
        let needs_motion = moves || a.force_depends_on_motion();
        let servo = needs_motion.then_some(self.servos.len());
        if needs_motion {
            let moment: Vec<_> = arms.iter().map(|&(j, c)| (addresses[j].1, c * a.gear)).collect();
            let [entries, bound] = entries(&moment, scene).map(|list| list.into_iter().map(|(entry, c)| (entry, S::from_f64(c))).collect());
            let (products, spread) = wrench.as_ref().map_or_else(Default::default, |w| products(w, scene));
            self.servos.push(CompiledServo { actuator: self.actuators.len(), entries, products, bound, spread });
        }
        self.actuators.push(CompiledActuator {
            moment: arms.iter().map(|&(j, c)| (addresses[j].0, addresses[j].1, S::from_f64(c * a.gear))).collect(),
            wrench,
            ctrl_range: a.ctrl_range.map(scalars),
            force_range: a.force_range.map(scalars),
            act_range: a.act_range.map(scalars),
            act,
            activation: a.activation,
            needs_motion,
            servo,
            dynamics,
            joint_force_range: None,
        });
    }

    fn wrench(&mut self, scene: Scene<'_>, a: &Actuator) -> Option<CompiledWrench<S>> {
        let Transmission::Site { site, reference, wrench } = a.transmission else { return None };
        let at = |s: usize| spot::<S>(scene, s);
        let (site, reference) = (at(site), reference.map(at));
        let moves = |frame: usize, dof: usize| scene.moved_dofs[frame][dof / 64] >> (dof % 64) & 1 == 1;
        let side = |dof: usize| match (moves(site.frame, dof), reference.is_some_and(|r| moves(r.frame, dof))) {
            (true, false) => Some((dof, S::ONE)),
            (false, true) => Some((dof, S::from_f64(-1.0))),
            _ => None,
        };
        let dofs: Vec<_> = (0..scene.dofs.len()).filter_map(side).collect();
        let wrench = wrench.map(|x| x * a.gear);
        let is_angle = reference.is_some() && wrench[..3] == [0.0; 3] && wrench[3..] != [0.0; 3];
        let turn = is_angle.then(|| S::from_f64(2.0 * PI * wrench[3..].iter().map(|x| x * x).sum::<f64>().sqrt()));
        let compiled = CompiledWrench { site, reference, wrench: scalars(wrench), arms: self.arms, index: self.wrenches, turn, dofs };
        self.arms += compiled.dofs.len();
        self.wrenches += 1;
        Some(compiled)
    }

    /// Part of a spec that acts within a step. Delay, lag and sampled servos act between steps.
    fn dynamics(&mut self, scene: Scene<'_>, a: &Actuator, spec: Option<&ActuatorSpec>) -> Option<CompiledActuatorDynamics<S>> {
        let spec = spec?;
        let row = |j: usize| scene.frictions.iter().position(|f| f.dof == scene.addresses[j].1);
        let losses = match a.transmission {
            Transmission::Joint(j) if spec.loses() => row(j).map(|row| (row, S::from_f64(a.gear))),
            _ => None,
        };
        let (servo, motor, limited) = (spec.is_continuous_servo(), spec.curve(), spec.is_limited());
        let acts = servo || motor.is_some() || limited || losses.is_some();
        self.actuator_dynamics += usize::from(acts);
        acts.then(|| CompiledActuatorDynamics { index: self.actuator_dynamics - 1, servo, motor, limited, losses })
    }

    fn force_range(&self, dof: usize, range: [f64; 2]) -> CompiledForceRange<S> {
        let acting = |(i, a): (usize, &CompiledActuator<S>)| {
            a.moment.iter().filter(|&&(_, d, _)| d == dof).map(|&(_, _, arm)| (i, arm)).collect::<Vec<_>>()
        };
        let actuators: Vec<_> = self.actuators.iter().enumerate().flat_map(acting).collect();
        let has_servos = actuators.iter().any(|&(i, _)| self.actuators[i].servo.is_some());
        CompiledForceRange { dof, bounds: scalars(range), actuators, has_servos }
    }

    pub(super) fn servos_are_bounded(&self) -> bool {
        let bounded = |a: &CompiledActuator<S>| a.force_range.is_some() || a.dynamics.is_some();
        self.servos.iter().any(|s| bounded(&self.actuators[s.actuator])) || self.force_ranges.iter().any(|r| r.has_servos)
    }
}

fn spot<S: Scalar>(scene: Scene<'_>, site: usize) -> Spot<S> {
    let (site, merged) = (&scene.model.sites[site], scene.merged);
    let quat = merged.quat[site.body];
    Spot {
        frame: merged.frame[site.body],
        pos: scalars((merged.pos[site.body] + quat * vector(site.pos)).into()),
        mat: matrix(&(quat * quaternion(site.quat))),
    }
}

/// Entry of the mass matrix for a dof and one above it; `None` if they lie on different branches.
fn entry(scene: Scene<'_>, below: usize, above: usize) -> Option<usize> {
    let dof = &scene.dofs[below];
    scene.chain[dof.chain..dof.chain + dof.depth].iter().position(|&d| d as usize == above).map(|k| dof.chain + k)
}

/// Entries of a a^T in the layout of the mass matrix, for a moment of (dof, arm) and its pairs on one branch.
///
/// If some pair is on two branches, it also returns the entries of a diagonal matrix that is not smaller (see
/// [`crate::actuation::forces`]).
fn entries(moment: &[(usize, f64)], scene: Scene<'_>) -> [Vec<(usize, f64)>; 2] {
    let mut arms: Vec<(usize, f64)> = Vec::new();
    for &(dof, arm) in moment {
        match arms.iter_mut().find(|(d, _)| *d == dof) {
            Some((_, sum)) => *sum += arm,
            None => arms.push((dof, arm)),
        }
    }
    // The deepest dof first: its chain contains all the others, or the moment goes across branches.
    arms.sort_by_key(|&(dof, _)| std::cmp::Reverse(scene.dofs[dof].depth));
    let pairs: Vec<_> = arms.iter().enumerate().flat_map(|(k, &below)| arms[k..].iter().map(move |&above| (below, above))).collect();
    let product = |&((i, a), (j, b)): &((usize, f64), (usize, f64))| entry(scene, i, j).map(|entry| (entry, a * b));
    let within: Vec<_> = pairs.iter().filter_map(product).collect();
    if within.len() == pairs.len() {
        return [within, vec![]];
    }
    let total: f64 = arms.iter().map(|(_, arm)| arm.abs()).sum();
    let bound = arms.iter().map(|&(dof, arm)| (scene.dofs[dof].chain, arm.abs() * total)).collect();
    [within, bound]
}

type Products = (Vec<(usize, [usize; 2])>, Vec<(usize, usize)>);

/// Entries of a wrench, whose arms change: entries with the two arms of each product, and diagonal entries if it goes across branches.
fn products<S: Scalar>(wrench: &CompiledWrench<S>, scene: Scene<'_>) -> Products {
    let mut dofs: Vec<(usize, usize)> = wrench.dofs.iter().enumerate().map(|(k, &(dof, _))| (dof, wrench.arms + k)).collect();
    dofs.sort_by_key(|&(dof, _)| std::cmp::Reverse(scene.dofs[dof].depth));
    let pairs: Vec<_> = dofs.iter().enumerate().flat_map(|(k, &below)| dofs[k..].iter().map(move |&above| (below, above))).collect();
    let product = |&((i, a), (j, b)): &((usize, usize), (usize, usize))| entry(scene, i, j).map(|entry| (entry, [a, b]));
    let within: Vec<_> = pairs.iter().filter_map(product).collect();
    let spread = if within.len() == pairs.len() { vec![] } else { dofs.iter().map(|&(dof, arm)| (scene.dofs[dof].chain, arm)).collect() };
    (within, spread)
}
