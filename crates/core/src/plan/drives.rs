//! Actuators, and which entries of the mass matrix those that act as springs and dampers touch.

use stepper_real::Scalar;

use super::{Dof, scalars};
use crate::model::{Activation, Actuator, JointKind, Model, Transmission};

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
    /// Whether gain or bias depend on length or velocity.
    pub needs_motion: bool,
    /// Its place among the servos.
    pub servo: Option<usize>,
}

/// An actuator whose force depends on its own motion.
#[derive(Clone, Debug)]
pub struct ServoPlan<S> {
    /// The actuator.
    pub actuator: usize,
    /// Entries of the mass matrix and what its weight is multiplied by there.
    pub entries: Vec<(usize, S)>,
}

/// Bounds of the sum of actuator forces on a dof.
#[derive(Clone, Debug)]
pub struct ForceRangePlan<S> {
    /// Degree of freedom.
    pub dof: usize,
    /// Lowest and highest sum.
    pub bounds: [S; 2],
    /// Actuators that act on it, and their moment arms.
    pub actuators: Vec<(usize, S)>,
    /// Whether any of them is a servo.
    pub has_servos: bool,
}

pub(super) struct Drives<S> {
    pub(super) actuators: Vec<ActuatorPlan<S>>,
    pub(super) servos: Vec<ServoPlan<S>>,
    pub(super) force_ranges: Vec<ForceRangePlan<S>>,
}

impl<S: Scalar> Drives<S> {
    pub(super) fn new(model: &Model, addresses: &[(usize, usize)], dofs: &[Dof], chain: &[u32]) -> Self {
        let mut drives = Self { actuators: Vec::new(), servos: Vec::new(), force_ranges: Vec::new() };
        let mut na = 0;
        for actuator in &model.actuators {
            drives.push(model, actuator, addresses, &mut na, |moment| entries(moment, dofs, chain));
        }
        let bounded = model.joints.iter().zip(addresses).filter(|(j, _)| matches!(j.kind, JointKind::Hinge | JointKind::Slide));
        let ranges = bounded.filter_map(|(j, &(_, dof))| j.actuator_force_range.map(|range| (dof, range)));
        drives.force_ranges = ranges.map(|(dof, range)| drives.force_range(dof, range)).collect();
        drives
    }

    fn push(
        &mut self,
        model: &Model,
        a: &Actuator,
        addresses: &[(usize, usize)],
        na: &mut usize,
        entries: impl Fn(&[(usize, f64)]) -> Vec<(usize, f64)>,
    ) {
        let arms: Vec<(usize, f64)> = match a.transmission {
            Transmission::Joint(j) => vec![(j, 1.0)],
            Transmission::Tendon(t) => model.tendons[t].joints.clone(),
        };
        let act = (a.activation != Activation::None).then_some(*na);
        *na += usize::from(act.is_some());
        let needs_motion = [a.gain[1], a.gain[2], a.bias[1], a.bias[2]].iter().any(|&x| x != 0.0);
        let servo = needs_motion.then_some(self.servos.len());
        if needs_motion {
            let moment: Vec<_> = arms.iter().map(|&(j, c)| (addresses[j].1, c * a.gear)).collect();
            let entries = entries(&moment).into_iter().map(|(entry, c)| (entry, S::from_f64(c))).collect();
            self.servos.push(ServoPlan { actuator: self.actuators.len(), entries });
        }
        self.actuators.push(ActuatorPlan {
            moment: arms.iter().map(|&(j, c)| (addresses[j].0, addresses[j].1, S::from_f64(c * a.gear))).collect(),
            ctrl_range: a.ctrl_range.map(scalars),
            force_range: a.force_range.map(scalars),
            act_range: a.act_range.map(scalars),
            act,
            activation: a.activation,
            needs_motion,
            servo,
        });
    }

    fn force_range(&self, dof: usize, range: [f64; 2]) -> ForceRangePlan<S> {
        let acting = |(i, a): (usize, &ActuatorPlan<S>)| {
            a.moment.iter().filter(|&&(_, d, _)| d == dof).map(|&(_, _, arm)| (i, arm)).collect::<Vec<_>>()
        };
        let actuators: Vec<_> = self.actuators.iter().enumerate().flat_map(acting).collect();
        let has_servos = actuators.iter().any(|&(i, _)| self.actuators[i].servo.is_some());
        ForceRangePlan { dof, bounds: scalars(range), actuators, has_servos }
    }

    pub(super) fn servos_are_bounded(&self) -> bool {
        self.servos.iter().any(|s| self.actuators[s.actuator].force_range.is_some()) || self.force_ranges.iter().any(|r| r.has_servos)
    }
}

/// Entries of a a^T in the layout of the mass matrix, for a moment (dof, arm); see [`crate::drive`] for moments across branches.
fn entries(moment: &[(usize, f64)], dofs: &[Dof], chain: &[u32]) -> Vec<(usize, f64)> {
    let mut arms: Vec<(usize, f64)> = Vec::new();
    for &(dof, arm) in moment {
        match arms.iter_mut().find(|(d, _)| *d == dof) {
            Some((_, sum)) => *sum += arm,
            None => arms.push((dof, arm)),
        }
    }
    // The deepest first: its chain holds all the others, or the moment goes across branches.
    arms.sort_by_key(|&(dof, _)| std::cmp::Reverse(dofs[dof].depth));
    let place = |below: usize, above: usize| {
        let dof = &dofs[below];
        chain[dof.chain..dof.chain + dof.depth].iter().position(|&d| d as usize == above).map(|k| dof.chain + k)
    };
    let pairs = arms.iter().enumerate().flat_map(|(k, &below)| arms[k..].iter().map(move |&above| (below, above)));
    let product = |((i, a), (j, b)): ((usize, f64), (usize, f64))| place(i, j).map(|entry| (entry, a * b));
    pairs.map(product).collect::<Option<Vec<_>>>().unwrap_or_else(|| {
        let total: f64 = arms.iter().map(|(_, arm)| arm.abs()).sum();
        arms.iter().map(|&(dof, arm)| (dofs[dof].chain, arm.abs() * total)).collect()
    })
}
