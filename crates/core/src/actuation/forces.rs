//! Forces of actuators and springs with their added inertia, which stage 1 passes to stage 2.
//!
//! A coordinate x = a . q with moment a has a spring k and a damper d. A step of length h evaluates their force at the end of its effect on
//! x, to first order:
//!
//! ```text
//! midpoint:  f = -k (x_mid + h/4 a.dv - x0) - d (xdot + 1/2 a.dv)     (M + (h/2 d + h^2/4 k) a a^T) dv = h (...)
//! implicit:  f = -k (x + h xdot + h a.dv - x0) - d (xdot + a.dv)      (M + (h d + h^2 k) a a^T) dv = h (...)
//! ```
//!
//! with dv = v+ - v. The first is the implicit midpoint rule. It is A-stable and conserves the energy of linear springs (Hairer, Lubich &
//! Wanner 2006, theorem IV.2.1). The second is backward Euler's rule, which is L-stable. The matrix keeps the sparsity of the tree if the
//! dofs of a moment lie on one chain. Otherwise the diagonal matrix |a_i| sum_j |a_j| replaces a a^T. It is not smaller (Gershgorin), so
//! this added inertia gives the same stability.
//!
//! If a step does not resolve a spring or damper, the midpoint rule keeps its amplitude and reverses it in every step: its amplification
//! tends to -1. With damping the true motion dies out. The step therefore evaluates more of it at its end, by `s = z / (6 + z)`, `z = h d /
//! m`, where m is the inertia from the diagonal of M:
//!
//! ```text
//! f = -k (x_mid + h/4 a.dv - x0) - d (xdot + (1 + s)/2 a.dv) - 3/2 s h k (xdot + a.dv)
//! ```
//!
//! For a damper alone, that is the Pade approximation `(1 - z/3) / (1 + 2 z/3 + z^2/6)` of exp(-z), Radau IIA's of third order (Hairer &
//! Wanner, section IV.3): it tends to 0. For a stiff spring, the last term multiplies the area in the phase plane by 1 / (1 + 6 s) in a
//! step. That is 1 - z + O(z^2), as in the true motion, exp(-z) (Liouville), and 1/7 at most. The added terms are of the order h^2, and
//! zero without damping. The rule stays of second order, and keeps the energy of undamped springs.
//!
//! A servo at a bound of its force contributes the bound and no stiffness. The expected force at the end of the step decides whether it is
//! at the bound. The first pass uses the impulses of the last step, the second an estimate of this step's impulses. A motor on its
//! torque-speed curve contributes the curve: its stall torque, and the drag of its back-EMF as a damper.

use stepper_real::{Mask, Real};

use crate::actuation::affine_force::{ActuatorDynamics, AffineForce, EffectiveInertia, Motion, outside, reaches, within};
use crate::actuation::force_limits::Region;
use crate::compile::{CompiledActuator, CompiledActuatorDynamics, LaneModel, ModelStructure};
use crate::dynamics::implicit_weights::ImplicitWeights;
use crate::math::spatial::*;

/// Implicit terms of the mass matrix.
#[derive(Clone, Copy, Debug)]
pub struct Implicit<'a, R: Real> {
    /// Shares of damping and stiffness.
    pub weights: ImplicitWeights<R>,
    /// Inertia that each servo adds along its moment. Empty: servos are explicit.
    pub servos: &'a [R],
    /// Arms of actuators on sites.
    pub arms: &'a [R],
    /// Velocity before the step, at which the drag of the medium is linearised. `None`: drag is explicit.
    pub drag_at: Option<&'a [R]>,
}

impl<R: Real> Implicit<'_, R> {
    /// No implicit terms: the mass matrix itself.
    pub fn none() -> Self {
        let weights = ImplicitWeights { damping: R::zero(), stiffness: R::zero(), step: R::zero() };
        Self { weights, servos: &[], arms: &[], drag_at: None }
    }
}

/// Implicit treatment of servos in stage 1.
#[derive(Clone, Copy, Debug)]
pub struct ImplicitServos<R> {
    /// Shares of damping and stiffness.
    pub weights: ImplicitWeights<R>,
    /// Whether all servos are implicit, or those of actuator dynamics alone.
    pub all: bool,
}

/// Evaluation point of the forces.
#[derive(Clone, Copy, Debug)]
pub struct ForceState<'a, R: Real> {
    /// Configuration of springs and servos.
    pub q: &'a [R],
    /// Velocity before the step.
    pub v: &'a [R],
    /// Velocity of the explicit forces.
    pub v_at: &'a [R],
    /// Activations.
    pub act: &'a [R],
    /// Controls after the actuator pipelines.
    pub ctrl: &'a [R],
    /// Actuator dynamics that act within a step.
    pub actuator_dynamics: &'a [ActuatorDynamics<R>],
}

impl<'a, R: Real> ForceState<'a, R> {
    /// Evaluation point with all quantities at one state, and explicit servos.
    pub fn state(q: &'a [R], v: &'a [R], act: &'a [R], ctrl: &'a [R], actuator_dynamics: &'a [ActuatorDynamics<R>]) -> Self {
        Self { q, v, v_at: v, act, ctrl, actuator_dynamics }
    }
}

/// Forces of one group of lanes.
#[derive(Clone, Debug)]
pub struct ActuatorForces<R: Real> {
    /// Generalized forces of actuators and springs, N or N m. Joint damping is not included: stage 2 evaluates it implicitly.
    pub tau: Vec<R>,
    /// Explicit forces of actuators alone, within the bounds of joints.
    pub joint: Vec<R>,
    /// Force of every actuator with explicit servos.
    pub force: Vec<R>,
    /// Inertia that each servo adds to the mass matrix by its implicit terms, kg m^2 or kg.
    pub weight: Vec<R>,
    /// Mobility of the joints of each servo, for servos that are implicit in part.
    pub(crate) effective_inertias: Vec<EffectiveInertia<R>>,
    /// Lanes in which a servo is at a bound of its force.
    pub(crate) saturated: Vec<R::Mask>,
    /// Lanes in which the sum of actuator forces on a dof is at its bound, for every such dof.
    pub(crate) bounded: Vec<R::Mask>,
    /// Force of every actuator with implicit servos, in models with bounded servos.
    pub(crate) implicit_force: Vec<R>,
    /// Force and added inertia of every servo without bounds, if any is bounded.
    pub(crate) unbounded: Vec<[R; 2]>,
    /// Lanes in which an explicit actuator force is outside its bounds.
    pub(crate) beyond: Vec<R::Mask>,
    /// Lanes in which the sum of actuator forces on a dof is cut to its bounds, for every such dof.
    pub(crate) cut: Vec<R::Mask>,
    /// Arms of all actuators on sites.
    pub arms: Vec<R>,
    /// Lengths of actuators on sites.
    pub(crate) lengths: Vec<R>,
    /// Region of the torque-speed curve of each actuator dynamics.
    pub(super) regions: Vec<Region<R>>,
    /// Whether the regions of this step are unknown.
    pub(crate) fresh: bool,
    /// Friction losses of actuator dynamics, see [`crate::constraints::assembler::AssemblyInput::losses`].
    pub losses: Vec<[R; 2]>,
}

impl<R: Real> ActuatorForces<R> {
    /// Workspace for a compiled model.
    pub fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        let never = |n: usize| vec![R::Mask::splat(false); n];
        Self {
            tau: zeros(compiled.nv),
            joint: zeros(compiled.nv),
            force: zeros(compiled.actuators.len()),
            weight: zeros(compiled.servos.len()),
            effective_inertias: vec![EffectiveInertia { mobility: R::zero(), slowing: R::zero() }; compiled.servos.len()],
            saturated: never(compiled.servos.len()),
            bounded: never(compiled.actuator_force_ranges.len()),
            implicit_force: zeros(if compiled.servos_are_bounded { compiled.actuators.len() } else { 0 }),
            unbounded: vec![[R::zero(); 2]; if compiled.servos_are_bounded { compiled.servos.len() } else { 0 }],
            beyond: never(compiled.actuators.len()),
            cut: never(compiled.actuator_force_ranges.len()),
            arms: zeros(compiled.wrench_arms[0]),
            lengths: zeros(compiled.wrench_arms[1]),
            regions: vec![Region::default(); compiled.actuator_dynamics],
            fresh: true,
            losses: vec![zero(); if compiled.lossy { compiled.frictions.len() } else { 0 }],
        }
    }

    /// Resets the servos at their bounds.
    #[inline(always)]
    pub fn release(&mut self) {
        // Without servos none is at a bound.
        if !self.saturated.is_empty() {
            self.saturated.fill(R::Mask::splat(false));
            self.bounded.fill(R::Mask::splat(false));
        }
        self.fresh = true;
    }

    /// Computes the effective inertias of servos from the mass matrix's diagonal `inertia`.
    pub fn compute_effective_inertia(&mut self, compiled: &LaneModel<R>, inertia: &[R]) {
        R::vectorize(
            #[inline(always)]
            || {
                for k in 0..compiled.servos.len() {
                    self.effective_inertias[k] =
                        self.effective_inertia_of(compiled, &compiled.actuators[compiled.servos[k].actuator], inertia);
                }
            },
        )
    }

    /// Effective inertia of several dofs: a mean, weighted by their part in the mobility.
    #[inline(always)]
    fn effective_inertia_of(&self, compiled: &LaneModel<R>, actuator: &CompiledActuator<R::Scalar>, inertia: &[R]) -> EffectiveInertia<R> {
        let mut sum = EffectiveInertia { mobility: R::zero(), slowing: R::zero() };
        for &(_, dof, arm) in &actuator.moment {
            sum = sum.with(R::splat(arm), inertia[dof], compiled.params.dof(dof).damping);
        }
        if let Some(wrench) = &actuator.wrench {
            for (&(dof, _), &arm) in wrench.dofs.iter().zip(&self.arms[wrench.arms..]) {
                sum = sum.with(arm, inertia[dof], compiled.params.dof(dof).damping);
            }
        }
        let EffectiveInertia { mobility, slowing } = sum;
        let moves = mobility.gt(R::zero());
        let slowing = R::select(moves, slowing / R::select(moves, mobility, R::one()), R::zero());
        EffectiveInertia { mobility, slowing }
    }

    /// Effective inertia that a servo moves.
    #[inline(always)]
    pub(crate) fn effective_inertia_at(&self, servo: usize) -> EffectiveInertia<R> {
        self.effective_inertias[servo]
    }

    /// Stores the implicit force of a servo, in the lanes in which it is not at a bound.
    #[inline(always)]
    pub(crate) fn set_servo(&mut self, actuator: usize, servo: usize, force: R, weight: R) {
        let held = self.saturated[servo];
        self.force[actuator] = R::select(held, self.force[actuator], force);
        self.weight[servo] = R::select(held, R::zero(), weight);
    }

    /// Stores the law of an actuator's dynamics, and finds its region.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "one actuator, every part of it named at the call")]
    pub(crate) fn set_actuator_dynamics(
        &mut self,
        actuator: usize,
        servo: usize,
        law: &AffineForce<R>,
        motion: &Motion<R>,
        compiled: &CompiledActuatorDynamics<R::Scalar>,
        numbers: &ActuatorDynamics<R>,
        weights: ImplicitWeights<R>,
    ) {
        let effective_inertia = self.effective_inertias[servo];
        self.regions[compiled.index].take(law.implicit_force(motion, effective_inertia, weights), motion.before, effective_inertia);
        if self.fresh {
            self.regions[compiled.index].guess(compiled, numbers);
        }
        self.follow(servo, actuator, compiled, numbers, weights);
    }

    /// Updates the force of an actuator's dynamics from its region.
    #[inline(always)]
    fn follow(
        &mut self,
        servo: usize,
        actuator: usize,
        compiled: &CompiledActuatorDynamics<R::Scalar>,
        numbers: &ActuatorDynamics<R>,
        weights: ImplicitWeights<R>,
    ) {
        let (force, weight) = self.regions[compiled.index].force(numbers, weights);
        self.set_servo(actuator, servo, force, weight);
    }

    /// Sums the actuators' forces on every dof, within the bounds of joints.
    #[inline(always)]
    pub(crate) fn gather(&mut self, compiled: &LaneModel<R>, implicit: bool) {
        self.fresh = false;
        self.tau.fill(R::zero());
        for (actuator, &force) in compiled.actuators.iter().zip(&self.force) {
            for &(_, dof, arm) in &actuator.moment {
                self.tau[dof] += R::splat(arm) * force;
            }
            if let Some(wrench) = &actuator.wrench {
                for (&(dof, _), &arm) in wrench.dofs.iter().zip(&self.arms[wrench.arms..]) {
                    self.tau[dof] += arm * force;
                }
            }
        }
        for (r, range) in compiled.actuator_force_ranges.iter().enumerate() {
            let tau = &mut self.tau[range.dof];
            let clamped = within(*tau, Some(range.bounds));
            let implicit = implicit && range.has_servos;
            self.cut[r] = if implicit { self.bounded[r] } else { outside(*tau, range.bounds) };
            *tau = if implicit { R::select(self.bounded[r], clamped, *tau) } else { clamped };
        }
    }

    /// Lanes in which the effort of an actuator, or a sum on its joint, was cut to its bounds.
    #[inline(always)]
    pub(crate) fn is_cut(&self, compiled: &LaneModel<R>, actuator: usize) -> R::Mask {
        let (of_it, mut cut) = (&compiled.actuators[actuator], self.beyond[actuator]);
        if let Some(k) = of_it.servo {
            cut = cut.or(self.saturated[k]);
            if let Some(dynamics) = &of_it.dynamics {
                cut = cut.or(self.regions[dynamics.index].is_cut());
            }
        }
        cut.or(lanes_of_sums(compiled, &self.cut, actuator))
    }

    /// Lanes in which the force of an actuator, or of the joint that it drives, is at a bound or beyond.
    ///
    /// MuJoCo has no derivative of such a force. Explicit forces must have been computed before.
    #[inline(always)]
    pub(crate) fn is_at_bound(&self, compiled: &LaneModel<R>, actuator: usize) -> R::Mask {
        let of_it = &compiled.actuators[actuator];
        let mut at = self.beyond[actuator];
        if let Some(range) = of_it.force_range {
            at = at.or(reaches(self.force[actuator], range));
        }
        if let Some(range) = of_it.joint_force_range.map(|r| &compiled.actuator_force_ranges[r]) {
            at = at.or(reaches(self.joint[range.dof], range.bounds));
        }
        at
    }

    /// Finds servos whose force at the end of the step would exceed its bounds, if the velocity changed by `dv`. Returns the lanes with a
    /// new one.
    ///
    /// These servos keep to the bound and lose their stiffness. `gather` must follow. Actuator dynamics move to the piece of their curve in
    /// each `pass`. From the third pass on none returns from a bound, so that the search ends.
    pub fn saturate(
        &mut self,
        compiled: &LaneModel<R>,
        actuator_dynamics: &[ActuatorDynamics<R>],
        weights: ImplicitWeights<R>,
        dv: &[R],
        h: R,
        pass: usize,
    ) -> R::Mask {
        R::vectorize(
            #[inline(always)]
            || {
                let mut new = R::Mask::splat(false);
                if pass == 0 {
                    for (k, servo) in compiled.servos.iter().enumerate() {
                        self.unbounded[k] = [self.force[servo.actuator], self.weight[k]];
                    }
                }
                self.implicit_force.copy_from_slice(&self.force);
                for (k, servo) in compiled.servos.iter().enumerate() {
                    let actuator = &compiled.actuators[servo.actuator];
                    let along = self.along(actuator, dv);
                    if let Some(dynamics) = actuator.dynamics {
                        let moved =
                            self.regions[dynamics.index].place(&dynamics, &actuator_dynamics[dynamics.index], weights, along / h, pass < 2);
                        let moved = moved.and_not(self.saturated[k]);
                        self.follow(k, servo.actuator, &dynamics, &actuator_dynamics[dynamics.index], weights);
                        new = new.or(moved);
                    }
                    self.implicit_force[servo.actuator] = self.force[servo.actuator] - self.weight[k] / h * along;
                }
                for (k, servo) in compiled.servos.iter().enumerate() {
                    let Some(bounds) = compiled.actuators[servo.actuator].force_range else { continue };
                    let beyond = outside(self.implicit_force[servo.actuator], bounds).and_not(self.saturated[k]);
                    new = new.or(beyond);
                    self.stop(compiled, k, beyond);
                }
                for (r, range) in compiled.actuator_force_ranges.iter().enumerate() {
                    if !range.has_servos {
                        continue;
                    }
                    let mut sum = R::zero();
                    for &(actuator, arm) in &range.actuators {
                        sum += R::splat(arm) * self.implicit_force[actuator];
                    }
                    let beyond = outside(sum, range.bounds).and_not(self.bounded[r]);
                    new = new.or(beyond);
                    self.bounded[r] = self.bounded[r].or(beyond);
                    for &(actuator, _) in &range.actuators {
                        if let Some(k) = compiled.actuators[actuator].servo {
                            self.stop(compiled, k, beyond.and_not(self.saturated[k]));
                        }
                    }
                }
                new
            },
        )
    }

    /// Lanes in which the change of velocity `dv` puts a servo on another side of its bounds than [`ActuatorForces::saturate`] assumed.
    pub fn misjudged(
        &mut self,
        compiled: &LaneModel<R>,
        actuator_dynamics: &[ActuatorDynamics<R>],
        weights: ImplicitWeights<R>,
        dv: &[R],
        h: R,
    ) -> R::Mask {
        R::vectorize(
            #[inline(always)]
            || {
                let mut wrong = R::Mask::splat(false);
                let differ = |a: R::Mask, b: R::Mask| a.and_not(b).or(b.and_not(a));
                self.implicit_force.copy_from_slice(&self.force);
                for (k, servo) in compiled.servos.iter().enumerate() {
                    let actuator = &compiled.actuators[servo.actuator];
                    let along = self.along(actuator, dv);
                    let [force, weight] = match actuator.dynamics {
                        Some(dynamics) => {
                            let mut region = self.regions[dynamics.index];
                            let moved = region.place(&dynamics, &actuator_dynamics[dynamics.index], weights, along / h, true);
                            wrong = wrong.or(moved.and_not(self.saturated[k]));
                            let (force, weight) = region.force(&actuator_dynamics[dynamics.index], weights);
                            [force, weight]
                        }
                        None => self.unbounded[k],
                    };
                    self.implicit_force[servo.actuator] = force - weight / h * along;
                }
                for r in 0..compiled.actuator_force_ranges.len() {
                    let range = &compiled.actuator_force_ranges[r];
                    if !range.has_servos {
                        continue;
                    }
                    let mut sum = R::zero();
                    for &(actuator, arm) in &range.actuators {
                        sum += R::splat(arm) * within(self.implicit_force[actuator], compiled.actuators[actuator].force_range);
                    }
                    wrong = wrong.or(differ(outside(sum, range.bounds), self.bounded[r]));
                }
                for (k, servo) in compiled.servos.iter().enumerate() {
                    let Some(bounds) = compiled.actuators[servo.actuator].force_range else { continue };
                    let beyond = outside(self.implicit_force[servo.actuator], bounds);
                    // A servo that the bound of a sum limits is not at its individual bound.
                    let held = lanes_of_sums(compiled, &self.bounded, servo.actuator);
                    wrong = wrong.or(differ(beyond, self.saturated[k]).and_not(held));
                }
                wrong
            },
        )
    }

    /// Fixes the force of servo `k` at its implicit force, within its bounds, in `lanes`.
    #[inline(always)]
    fn stop(&mut self, compiled: &LaneModel<R>, k: usize, lanes: R::Mask) {
        let actuator = compiled.servos[k].actuator;
        let held = within(self.implicit_force[actuator], compiled.actuators[actuator].force_range);
        self.force[actuator] = R::select(lanes, held, self.force[actuator]);
        self.implicit_force[actuator] = R::select(lanes, held, self.implicit_force[actuator]);
        self.weight[k] = R::select(lanes, R::zero(), self.weight[k]);
        self.saturated[k] = self.saturated[k].or(lanes);
    }
}

/// Lanes in which a mask is set of any sum that has an actuator. `masks` has a mask per sum.
#[inline(always)]
fn lanes_of_sums<R: Real>(compiled: &LaneModel<R>, masks: &[R::Mask], actuator: usize) -> R::Mask {
    let mut lanes = R::Mask::splat(false);
    for (range, &mask) in compiled.actuator_force_ranges.iter().zip(masks) {
        if mask.any() && range.actuators.iter().any(|&(a, _)| a == actuator) {
            lanes = lanes.or(mask);
        }
    }
    lanes
}
