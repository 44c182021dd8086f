//! Compiled actuators: their moments and bounds, and the entries of the mass matrix to which their implicit stiffness and damping
//! contribute.

use std::collections::BTreeSet;
use std::f64::consts::PI;

use stepper_real::Scalar;

use crate::actuation::ActuatorSpec;
use crate::compile::limits::is_scalar;
use crate::compile::merging::Merged;
use crate::compile::paths::{CompiledPath, Spot, path_of};
use crate::compile::tree::{CompiledFriction, scalars};
use crate::model::{
    Activation, Actuator, BiasType, Filter, ForceModel, GainType, JointKind, MUSCLE_PARAMETERS, Model, Muscle, Object, Transmission,
};

/// Compiled actuator: on a linear combination of scalar joints (a joint or a fixed tendon), or with moment arms that depend on the
/// configuration.
#[derive(Clone, Debug)]
pub struct CompiledActuator<S> {
    /// Terms of the actuator's moment, if it is constant: address in q, degree of freedom, and moment arm with the gear. Otherwise empty.
    pub moment: Vec<(usize, usize, S)>,
    /// Moment that depends on the configuration; `None` for an actuator on a joint or fixed tendon.
    pub variable_moment: Option<VariableMoment<S>>,
    /// Parameters of a muscle; `None` for other actuators.
    pub muscle: Option<CompiledMuscle<S>>,
    /// Lowest and highest control; `None` if the control has no bounds.
    pub ctrl_range: Option<[S; 2]>,
    /// Lowest and highest force; `None` if the force has no bounds.
    pub force_range: Option<[S; 2]>,
    /// Lowest and highest activation; `None` if the activation has no bounds.
    pub act_range: Option<[S; 2]>,
    /// Index of the actuator's activation in the vector of activations; `None` if the actuator has no activation.
    pub act: Option<usize>,
    /// Type of the activation's differential equation (MuJoCo's `dyntype`).
    pub activation: Activation,
    /// Whether the force uses the activation at the end of the step.
    pub early: bool,
    /// Whether the force depends on length or velocity, by gain, bias or actuator dynamics.
    pub needs_motion: bool,
    /// Index in the compiled model's list of servos; `None` for actuators without [`needs_motion`](Self::needs_motion).
    pub servo: Option<usize>,
    /// Actuator dynamics: the part of the actuator model that acts within a step; `None` if there is none.
    pub dynamics: Option<CompiledActuatorDynamics<S>>,
    /// Index of the joint's force range in the list of force ranges (`actuatorfrcrange`). `None` if the joint has no force range, and for
    /// actuators on tendons and sites.
    pub joint_force_range: Option<usize>,
}

/// Moment of an actuator on a site, on a spatial tendon, or of a slider-crank. It depends on the configuration.
#[derive(Clone, Debug)]
pub struct VariableMoment<S> {
    /// Element on which the actuator acts.
    pub kind: MomentKind<S>,
    /// Change of the actuator's length when the site makes a full rotation, if the length is an angle; otherwise `None`.
    pub turn: Option<S>,
    /// Degrees of freedom with a moment arm, each with a sign. The sign is 1 if only the site moves, and -1 if only the reference site
    /// moves. For a slider-crank, these two are the crank and the slider. For a tendon, for contacts and for joints the sign is 1.
    pub dofs: Vec<(usize, S)>,
    /// Index of the actuator's first moment arm in the list of variable moment arms.
    pub arms: usize,
    /// Index of this moment among all variable moments. The lengths of these actuators have the same order.
    pub index: usize,
}

/// Element that determines a variable moment.
#[derive(Clone, Copy, Debug)]
pub enum MomentKind<S> {
    /// Wrench (force and torque) on a site.
    Site {
        /// Pose of the site on which the wrench acts.
        site: Spot<S>,
        /// Pose of the reference site, which receives the opposite wrench. Its axes are those of the wrench. `None` if the actuator has no
        /// reference site.
        reference: Option<Spot<S>>,
        /// Force and torque on the site per unit of the actuator's force, including the gear. They are in the axes of the reference site,
        /// or of the site itself if there is no reference site.
        wrench: [S; 6],
    },
    /// Spatial tendon.
    Path {
        /// Index of the path.
        path: usize,
        /// Index of the path's first moment arm.
        first: usize,
        /// Gear of the actuator.
        gear: S,
    },
    /// Ball or free joint.
    Joint {
        /// Address in q of the joint's quaternion.
        q: usize,
        /// Whether the joint is free; otherwise it is a ball.
        free: bool,
        /// Whether torques are in the axes of the parent or the world.
        in_parent: bool,
        /// Force (free joints only) and torque per unit of the actuator's force.
        wrench: [[S; 3]; 2],
    },
    /// Contacts of a body, which an adhesion actuator pulls together.
    Contacts {
        /// Index of the body in the model.
        body: usize,
        /// A degree of freedom that moves the body; `None` for a body that no degree of freedom moves.
        dof: Option<usize>,
    },
    /// Slider-crank.
    SliderCrank {
        /// Pose of the crank's site.
        crank: Spot<S>,
        /// Pose of the slider's site.
        slider: Spot<S>,
        /// Length of the rod, m.
        rod: S,
        /// Gear of the actuator.
        gear: S,
    },
}

impl<S> VariableMoment<S> {
    /// Whether the actuator's length depends on the configuration. Without a reference site, the length of an actuator on a site is 0. So
    /// are those of actuators on contacts and on free joints.
    #[inline(always)]
    pub fn has_length(&self) -> bool {
        match &self.kind {
            MomentKind::Site { reference, .. } => reference.is_some(),
            MomentKind::Joint { free, .. } => !*free,
            MomentKind::Contacts { .. } => false,
            MomentKind::Path { .. } | MomentKind::SliderCrank { .. } => true,
        }
    }
}

/// Muscle: active and passive force of [`Muscle`], with the quantities that a step needs.
#[derive(Clone, Copy, Debug)]
pub struct CompiledMuscle<S> {
    /// Curve of the active force; `None` if the gain is not that of a muscle.
    pub active: Option<MuscleCurve<S>>,
    /// Curve of the passive force; `None` if the bias is not that of a muscle.
    pub passive: Option<MuscleCurve<S>>,
}

/// Parameters of a muscle's force-length-velocity curve.
#[derive(Clone, Copy, Debug)]
pub struct MuscleCurve<S> {
    /// Peak force, N.
    pub force: S,
    /// Lowest operating length, relative to the optimal length.
    pub first: S,
    /// Length of the actuator at the lowest operating length, m or rad.
    pub start: S,
    /// Optimal length, m or rad.
    pub optimum: S,
    /// Speed at which the active force vanishes, m/s or rad/s.
    pub speed: S,
    /// Lowest and highest relative length with active force.
    pub range: [S; 2],
    /// Passive force at the highest length, relative to the peak force.
    pub passive: S,
    /// Active force at the highest lengthening speed, relative to the peak force.
    pub lengthening: S,
}

/// Smallest divisor in the curves of muscles, and shortest distance with a direction, as in MuJoCo (`mjMINVAL`).
pub(crate) const SMALLEST: f64 = 1e-15;

impl<S: Scalar> MuscleCurve<S> {
    fn new(muscle: &Muscle, parameters: &[f64; MUSCLE_PARAMETERS]) -> Self {
        let [lowest, highest, force, scale, lmin, lmax, vmax, fpmax, fvmax] = *parameters;
        let [short, long] = muscle.length_range;
        let optimum = (long - short) / (highest - lowest).max(SMALLEST);
        let force = if force < 0.0 { scale / muscle.acceleration.max(SMALLEST) } else { force };
        let of = S::from_f64;
        Self {
            force: of(force),
            first: of(lowest),
            start: of(short),
            optimum: of(optimum.max(SMALLEST)),
            speed: of((optimum * vmax).max(SMALLEST)),
            range: [of(lmin), of(lmax)],
            passive: of(fpmax),
            lengthening: of(fvmax),
        }
    }
}

impl<S: Scalar> CompiledMuscle<S> {
    fn new(actuator: &Actuator) -> Option<Self> {
        let (muscle, ForceModel { gain, bias, .. }) = (&actuator.muscle, actuator.force_model);
        actuator.is_muscle().then(|| Self {
            active: (gain == GainType::Muscle).then(|| MuscleCurve::new(muscle, &muscle.gain)),
            passive: (bias == BiasType::Muscle).then(|| MuscleCurve::new(muscle, &muscle.bias)),
        })
    }
}

/// Meaning of the input of a motor with a torque-speed curve. The input is the control or, with a servo, the servo's effort.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotorControl {
    /// Force before the torque-speed curve limits it, N or N m.
    Force,
    /// Fraction of the motor's full voltage, -1 to 1.
    Voltage,
}

/// Parts of an actuator's dynamics, which are the part of its actuator model that acts within a step. Their parameters are in
/// [`ActuatorDynamics`](crate::actuation::affine_force::ActuatorDynamics).
#[derive(Clone, Copy, Debug)]
pub struct CompiledActuatorDynamics<S> {
    /// Index in the list of actuator dynamics.
    pub index: usize,
    /// Whether the dynamics have a continuous servo, whose proportional and derivative terms act within the step.
    pub continuous_servo: bool,
    /// Meaning of the motor's input; `None` for actuators without a motor with a torque-speed curve.
    pub motor: Option<MotorControl>,
    /// Whether the actuator dynamics bound the force.
    pub limited: bool,
    /// Index of the dry friction row that contains the actuator's friction losses, and moment arm on its joint. `None` if the actuator has
    /// no friction losses.
    pub losses: Option<(usize, S)>,
}

/// Servo: actuator whose force depends on its length or velocity, with the entries of the mass matrix to which it adds inertia.
#[derive(Clone, Debug)]
pub struct CompiledServo<S> {
    /// Index of the actuator.
    pub actuator: usize,
    /// Entries of the mass matrix to which the servo adds inertia. Each pair has the index of an entry, and the factor of the added
    /// inertia. The two degrees of freedom of these entries are on one kinematic branch.
    pub entries: Vec<(usize, S)>,
    /// Entries of the mass matrix to which a servo with a variable moment adds inertia. Each element has the index of an entry, and the
    /// indices of two moment arms, whose product is the factor of the added inertia.
    pub products: Vec<(usize, [usize; 2])>,
    /// Diagonal matrix that is an upper bound of the added inertia, for an actuator on a tendon that joins several kinematic branches. A
    /// step with hard contact uses it instead of `entries`. Each pair has the index of a diagonal entry of the mass matrix, and a factor.
    /// Empty if all degrees of freedom are on one branch.
    pub diagonal_bound: Vec<(usize, S)>,
    /// Arms of a diagonal matrix that is an upper bound of the added inertia, for a variable moment that joins several kinematic
    /// branches. A step with hard contact uses it instead of `products`. Each pair has the index of a diagonal entry of the mass matrix,
    /// and the index of a moment arm. Empty if all degrees of freedom are on one branch.
    pub diagonal_bound_arms: Vec<(usize, usize)>,
}

/// Bounds of the sum of all actuator forces on one degree of freedom (`actuatorfrcrange`).
#[derive(Clone, Debug)]
pub struct CompiledForceRange<S> {
    /// Index of the degree of freedom.
    pub dof: usize,
    /// Lowest and highest sum of the actuator forces, N or N m.
    pub bounds: [S; 2],
    /// Actuators with constant moments that act on this degree of freedom: index of the actuator, and moment arm.
    pub actuators: Vec<(usize, S)>,
    /// Actuators with variable moments that act on this degree of freedom. Each has the index of the actuator, and the index of its moment
    /// arm in the list of variable moment arms.
    pub variable: Vec<(usize, usize)>,
    /// Whether any of these actuators is a servo, whose force depends on its length or velocity.
    pub has_servos: bool,
}

/// Inputs for the compiler of actuators: the model, and parts of the compiled model.
#[derive(Clone, Copy, Debug)]
pub(super) struct CompilerInput<'a, S> {
    pub(super) model: &'a Model,
    pub(super) merged: &'a Merged,
    pub(super) frictions: &'a [CompiledFriction],
    pub(super) paths: &'a [CompiledPath<S>],
}

/// Compiled actuators of a model, its servos, and its bounded sums of actuator forces.
pub(super) struct CompiledActuators<S> {
    pub(super) actuators: Vec<CompiledActuator<S>>,
    pub(super) servos: Vec<CompiledServo<S>>,
    pub(super) force_ranges: Vec<CompiledForceRange<S>>,
    /// Number of moment arms of all variable moments.
    pub(super) arms: usize,
    /// Number of variable moments.
    pub(super) variable_moments: usize,
    /// Number of actuators with dynamics.
    pub(super) num_actuator_dynamics: usize,
}

impl<S: Scalar> CompiledActuators<S> {
    /// Compiles the actuators of the model. `specs` has the actuator model of every actuator, or is empty.
    pub(super) fn new(input: CompilerInput<'_, S>, specs: &[Option<ActuatorSpec>]) -> Self {
        let model = input.model;
        let mut all =
            Self { actuators: vec![], servos: vec![], force_ranges: vec![], arms: 0, variable_moments: 0, num_actuator_dynamics: 0 };
        let mut na = 0;
        for (i, actuator) in model.actuators.iter().enumerate() {
            let spec = specs.get(i).and_then(Option::as_ref);
            all.push(input, actuator, spec, &mut na);
        }
        let bounded = model.joints.iter().zip(&input.merged.addresses).filter(|(j, _)| is_scalar(j));
        let ranges = bounded.filter_map(|(j, &(_, dof))| j.actuator_force_range.map(|range| (dof, range)));
        all.force_ranges = ranges.map(|(dof, range)| all.force_range(dof, range)).collect();
        for (compiled, actuator) in all.actuators.iter_mut().zip(&model.actuators) {
            let Transmission::Joint(j) = actuator.transmission else { continue };
            compiled.joint_force_range = all.force_ranges.iter().position(|range| range.dof == input.merged.addresses[j].1);
        }
        all
    }

    /// Compiles the actuator `a`, and adds it. `na` is the number of activations of the actuators before it; the function increases `na` if
    /// this actuator has an activation.
    fn push(&mut self, input: CompilerInput<'_, S>, a: &Actuator, spec: Option<&ActuatorSpec>, na: &mut usize) {
        let addresses = &input.merged.addresses;
        let arms: Vec<(usize, f64)> = match a.transmission {
            Transmission::Joint(j) => vec![(j, 1.0)],
            Transmission::Tendon(t) => input.model.tendons[t].joints.clone(),
            _ => vec![],
        };
        let moment_arms = self.variable_moment(input, a);
        let act = (a.activation != Activation::None).then_some(*na);
        *na += usize::from(act.is_some());
        let dynamics = self.dynamics(input, a, spec);
        let moves = dynamics.as_ref().is_some_and(|t| t.continuous_servo || t.motor.is_some());
        let needs_motion = moves || a.force_depends_on_motion();
        let servo = needs_motion.then_some(self.servos.len());
        if needs_motion {
            let moment: Vec<_> = arms.iter().map(|&(j, c)| (addresses[j].1, c * a.gear)).collect();
            let [entries, diagonal_bound] =
                entries(&moment, input.merged).map(|list| list.into_iter().map(|(entry, c)| (entry, S::from_f64(c))).collect());
            let (products, diagonal_bound_arms) = moment_arms.as_ref().map_or_else(Default::default, |m| products(m, input.merged));
            self.servos.push(CompiledServo { actuator: self.actuators.len(), entries, products, diagonal_bound, diagonal_bound_arms });
        }
        self.actuators.push(CompiledActuator {
            moment: arms.iter().map(|&(j, c)| (addresses[j].0, addresses[j].1, S::from_f64(c * a.gear))).collect(),
            variable_moment: moment_arms,
            muscle: CompiledMuscle::new(a),
            ctrl_range: a.ctrl_range.map(scalars),
            force_range: a.force_range.map(scalars),
            act_range: a.act_range.map(scalars),
            act,
            activation: a.activation,
            early: a.early,
            needs_motion,
            servo,
            dynamics,
            joint_force_range: None,
        });
    }

    /// Compiles the moment of an actuator whose moment arms depend on the configuration; `None` for other actuators.
    fn variable_moment(&mut self, input: CompilerInput<'_, S>, a: &Actuator) -> Option<VariableMoment<S>> {
        let gear = S::from_f64(a.gear);
        let spot = |site: usize| Spot::new(&input.merged.pose(input.model, Object::Site(site)));
        let moved_by_one = |first: Spot<S>, second: Option<Spot<S>>| {
            let sign = |dof: usize| {
                let moves = |spot: Spot<S>| input.merged.moves(dof, spot.frame);
                match (moves(first), second.is_some_and(moves)) {
                    (true, false) => Some((dof, S::ONE)),
                    (false, true) => Some((dof, S::from_f64(-1.0))),
                    _ => None,
                }
            };
            (0..input.model.nv()).filter_map(sign).collect()
        };
        let (kind, turn, dofs): (_, _, Vec<(usize, S)>) = match a.transmission {
            Transmission::Joint(_) => return None,
            Transmission::Tendon(t) => {
                let path = path_of(input.model, t)?;
                let dofs = input.paths[path].dofs.iter().map(|&dof| (dof as usize, S::ONE));
                (MomentKind::Path { path, first: input.paths[path].arms, gear }, None, dofs.collect())
            }
            Transmission::JointWrench { joint, in_parent, wrench } => {
                let wrench = wrench.map(|x| x * a.gear);
                let free = input.model.joints[joint].kind == JointKind::Free;
                let [first, second] = [[wrench[0], wrench[1], wrench[2]], [wrench[3], wrench[4], wrench[5]]];
                let wrench = if free { [first, second] } else { [[0.0; 3], first] };
                let turn = (!free).then(|| S::from_f64(2.0 * PI * wrench[1].iter().map(|x| x * x).sum::<f64>().sqrt()));
                let ((q, v), [translations, dofs]) = (input.merged.addresses[joint], if free { [3, 6] } else { [0, 3] });
                let kind = MomentKind::Joint { q: q + translations, free, in_parent, wrench: wrench.map(scalars) };
                (kind, turn.filter(|&turn| turn > S::default()), (v..v + dofs).map(|dof| (dof, S::ONE)).collect())
            }
            Transmission::Body(body) => {
                let frames = touching_frames(input, body);
                let moves = |&dof: &usize| frames.iter().any(|&frame| input.merged.moves(dof, frame));
                let dofs = (0..input.model.nv()).filter(moves).map(|dof| (dof, S::ONE));
                (MomentKind::Contacts { body, dof: input.merged.last_dof[input.merged.frame[body]] }, None, dofs.collect())
            }
            Transmission::SliderCrank { crank, slider, rod } => {
                let [crank, slider] = [crank, slider].map(spot);
                (MomentKind::SliderCrank { crank, slider, rod: S::from_f64(rod), gear }, None, moved_by_one(crank, Some(slider)))
            }
            Transmission::Site { site, reference, wrench } => {
                let wrench = wrench.map(|x| x * a.gear);
                let is_angle = reference.is_some() && wrench[..3] == [0.0; 3] && wrench[3..] != [0.0; 3];
                let turn = is_angle.then(|| S::from_f64(2.0 * PI * wrench[3..].iter().map(|x| x * x).sum::<f64>().sqrt()));
                let (site, reference) = (spot(site), reference.map(spot));
                (MomentKind::Site { site, reference, wrench: scalars(wrench) }, turn, moved_by_one(site, reference))
            }
        };
        let compiled = VariableMoment { kind, turn, arms: self.arms, index: self.variable_moments, dofs };
        self.arms += compiled.dofs.len();
        self.variable_moments += 1;
        Some(compiled)
    }

    /// Compiles the part of an actuator model that acts within a step; `None` if there is none. Delay, lag and sampled servos act
    /// between steps.
    fn dynamics(&mut self, input: CompilerInput<'_, S>, a: &Actuator, spec: Option<&ActuatorSpec>) -> Option<CompiledActuatorDynamics<S>> {
        let spec = spec?;
        let row = |j: usize| input.frictions.iter().position(|f| f.dof == input.merged.addresses[j].1);
        let losses = match a.transmission {
            Transmission::Joint(j) if spec.loses() => row(j).map(|row| (row, S::from_f64(a.gear))),
            _ => None,
        };
        let (continuous_servo, limited) = (spec.is_continuous_servo(), spec.is_limited());
        let motor = spec.curve().map(|is_voltage| if is_voltage { MotorControl::Voltage } else { MotorControl::Force });
        let acts = continuous_servo || motor.is_some() || limited || losses.is_some();
        self.num_actuator_dynamics += usize::from(acts);
        acts.then(|| CompiledActuatorDynamics { index: self.num_actuator_dynamics - 1, continuous_servo, motor, limited, losses })
    }

    /// Compiles the bounds `range` of the sum of all actuator forces on the degree of freedom `dof`.
    fn force_range(&self, dof: usize, range: [f64; 2]) -> CompiledForceRange<S> {
        let acting = |(i, a): (usize, &CompiledActuator<S>)| {
            a.moment.iter().filter(|&&(_, d, _)| d == dof).map(|&(_, _, arm)| (i, arm)).collect::<Vec<_>>()
        };
        let actuators: Vec<_> = self.actuators.iter().enumerate().flat_map(acting).collect();
        let moments = self.actuators.iter().enumerate().filter_map(|(i, a)| Some((i, a.variable_moment.as_ref()?)));
        let arm = |m: &VariableMoment<S>| Some(m.arms + m.dofs.iter().position(|&(d, _)| d == dof)?);
        let variable: Vec<_> = moments.filter_map(|(i, moment)| Some((i, arm(moment)?))).collect();
        let mut acting = actuators.iter().map(|a| a.0).chain(variable.iter().map(|a| a.0));
        let has_servos = acting.any(|i| self.actuators[i].servo.is_some());
        CompiledForceRange { dof, bounds: scalars(range), actuators, variable, has_servos }
    }

    /// Whether any servo's force may have bounds.
    pub(super) fn servos_are_bounded(&self) -> bool {
        let bounded = |a: &CompiledActuator<S>| a.force_range.is_some() || a.dynamics.is_some();
        self.servos.iter().any(|s| bounded(&self.actuators[s.actuator])) || self.force_ranges.iter().any(|r| r.has_servos)
    }
}

/// Frames of a body and of all geoms that can touch the body.
fn touching_frames<S: Scalar>(input: CompilerInput<'_, S>, body: usize) -> BTreeSet<usize> {
    let (geoms, filter) = (&input.model.geoms, Filter::new(input.model));
    let own = || (0..geoms.len()).filter(|&g| geoms[g].body == body);
    let touches = |&g: &usize| own().any(|other| other != g && filter.pair(filter.ordered([g, other])).is_some());
    let others = (0..geoms.len()).filter(touches).map(|g| input.merged.frame[geoms[g].body]);
    others.chain([input.merged.frame[body]]).collect()
}

/// Lists the pairs of an actuator's degrees of freedom that are on one kinematic branch. An element of the list has the index of the mass
/// matrix entry, and the result of `product` for the pair's two items. The second result is true if no pair is on different branches.
///
/// `items` has the actuator's degrees of freedom, each with an item such as its moment arm. The function sorts it by depth in the tree.
fn pairs_on_branch<T: Copy, P>(items: &mut [(usize, T)], merged: &Merged, product: impl Fn(T, T) -> P) -> (Vec<(usize, P)>, bool) {
    // Deepest degree of freedom first. Its chain contains all other ones of the moment, unless the moment goes across branches.
    items.sort_by_key(|&(dof, _)| std::cmp::Reverse(merged.chain_of(dof).len()));
    let mut on_branch = vec![];
    for (k, &(below, a)) in items.iter().enumerate() {
        on_branch.extend(items[k..].iter().filter_map(|&(above, b)| Some((merged.entry(below, above)?, product(a, b)))));
    }
    let are_all = on_branch.len() == items.len() * (items.len() + 1) / 2;
    (on_branch, are_all)
}

/// Lists the entries of the matrix a a^T for an actuator's moment a, as pairs (index of the mass matrix entry, value). `moment` lists
/// (degree of freedom, moment arm).
///
/// The first list has the entries whose two degrees of freedom are on one kinematic branch. If other entries exist, the second list is a
/// diagonal matrix that is an upper bound of a a^T (see [`crate::actuation::forces`]). Otherwise it is empty.
fn entries(moment: &[(usize, f64)], merged: &Merged) -> [Vec<(usize, f64)>; 2] {
    let mut arms: Vec<(usize, f64)> = Vec::new();
    for &(dof, arm) in moment {
        match arms.iter_mut().find(|(d, _)| *d == dof) {
            Some((_, sum)) => *sum += arm,
            None => arms.push((dof, arm)),
        }
    }
    let (on_branch, are_all) = pairs_on_branch(&mut arms, merged, |a, b| a * b);
    let total: f64 = arms.iter().map(|(_, arm)| arm.abs()).sum();
    let bound = arms.iter().filter_map(|&(dof, arm)| Some((merged.entry(dof, dof)?, arm.abs() * total)));
    [on_branch, if are_all { vec![] } else { bound.collect() }]
}

/// Result of [`products`]: the lists [`CompiledServo::products`] and [`CompiledServo::diagonal_bound_arms`].
type Products = (Vec<(usize, [usize; 2])>, Vec<(usize, usize)>);

/// Lists the entries of the mass matrix to which a servo with a variable moment adds inertia, with the indices of two moment arms. The
/// added inertia is proportional to the product of these arms, which depend on the configuration.
///
/// The first of the returned lists has these entries. If the moment acts on several kinematic branches, the second list has the diagonal
/// entries, each with the index of its moment arm. Otherwise it is empty.
fn products<S: Scalar>(moment: &VariableMoment<S>, merged: &Merged) -> Products {
    let mut arms: Vec<(usize, usize)> = moment.dofs.iter().enumerate().map(|(k, &(dof, _))| (dof, moment.arms + k)).collect();
    let (on_branch, are_all) = pairs_on_branch(&mut arms, merged, |a, b| [a, b]);
    let diagonal = arms.iter().filter_map(|&(dof, arm)| Some((merged.entry(dof, dof)?, arm)));
    (on_branch, if are_all { vec![] } else { diagonal.collect() })
}
