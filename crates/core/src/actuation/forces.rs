//! Forces of actuators and springs with their added inertia, which stage 1 passes to stage 2.
//!
//! A coordinate x = a . q with moment a has a spring k and a damper d. Their force in a step of length h includes the effect of the
//! velocity change dv = v+ - v of the same step, to first order:
//!
//! ```text
//! midpoint:  f = -k (x_mid + h/4 a.dv - x0) - d (xdot + 1/2 a.dv)     (M + (h/2 d + h^2/4 k) a a^T) dv = h (...)
//! implicit:  f = -k (x + h xdot + h a.dv - x0) - d (xdot + a.dv)      (M + (h d + h^2 k) a a^T) dv = h (...)
//! ```
//!
//! The first is the implicit midpoint rule, with x_mid in the middle of the step. It is A-stable and conserves the energy of linear springs
//! (Hairer, Lubich & Wanner 2006, theorem IV.2.1). The second is backward Euler's rule, which is L-stable. The matrix keeps the sparsity of
//! the tree if the degrees of freedom of the moment lie on one chain of joints. Otherwise the diagonal matrix |a_i| sum_j |a_j| replaces a
//! a^T. It is an upper bound of a a^T (Gershgorin), so that the rule remains stable.
//!
//! The midpoint rule does not damp a motion that is too fast for the step: its amplification tends to -1, while the true motion dies out.
//! A fraction `s` of the damping is therefore evaluated at the end of the step instead of its middle: `s = z / (6 + z)`, `z = h d / m`.
//! Here m is the inertia from the diagonal of M:
//!
//! ```text
//! f = -k (x_mid + h/4 a.dv - x0) - d (xdot + (1 + s)/2 a.dv) - 3/2 s h k (xdot + a.dv)
//! ```
//!
//! For a damper alone, the rule is the Pade approximation `(1 - z/3) / (1 + 2 z/3 + z^2/6)` of exp(-z), Radau IIA of third order (Hairer &
//! Wanner, section IV.3), which tends to 0. A stiff spring with a damper has two modes. The true motion multiplies their amplitudes in a
//! step by numbers whose product is exp(-z). The last term of f makes this product 1 / (1 + 6 s) = 1 - z + O(z^2), which tends to 1/7 for
//! strong damping. The terms with s are of the order h^2, and zero without damping. The rule stays of second order, and keeps the energy
//! of undamped springs.
//!
//! In all these forms the whole force in the step is `f = e - (b/h) a.dv`. Here e is the explicit part, which stage 1 passes to stage
//! 2, and b is the added inertia, kg or kg m^2. The mass matrix with b a a^T supplies the second term.
//!
//! A servo is an actuator whose force depends on its length or velocity. Its active bound is none, the lower or upper bound of its force,
//! or the torque-speed curve of its motor. With none, the servo contributes e and b. At a bound of its force it contributes that bound,
//! without added inertia. On its curve a motor contributes its stall torque, and its back-EMF as a damper.
//!
//! A bounded sum is the sum of all actuator forces on a degree of freedom with MuJoCo's `actuatorfrcrange`. While it is at a bound, its
//! servos contribute constant forces without added inertia.
//!
//! The mass matrix depends on the active bounds, so that a step must assume them before it factors the matrix. It derives them from a guess
//! of dv, in which the mass matrix counts as diagonal. Later the step has a better dv: first the predicted one, then that of the solution.
//! A trial computes the forces and active bounds at such a dv. They may differ from the assumed ones:
//!
//! * A servo is stiff if its added inertia is at least the inertia that it moves. If the solution gives a stiff servo another active bound,
//!   the step assumes the new bound and solves again (`solve_velocities`).
//! * For any other servo the added inertia stays as assumed, and stage 1 corrects the force: it clamps the force at the predicted velocity.
//!
//! Euler's rule predicts no velocity. With it, any servo with actuator dynamics that has another active bound leads to a new solve.
//!
//! Lengths, velocities and moment arms are in `moments.rs`, limits of actuator models in `force_limits.rs`, losses in `losses.rs`.

use stepper_real::{Mask, Real, kernel};

use crate::actuation::affine_force::{ActuatorDynamics, AffineForce, EffectiveInertia, Motion, exceeds_range, outside, reaches, within};
use crate::actuation::force_limits::{BoundedForce, ForceLimits};
use crate::compile::{CompiledActuator, CompiledActuatorDynamics, CompiledForceRange, LaneModel, ModelStructure};
use crate::dynamics::implicit_weights::ImplicitWeights;
use crate::math::spatial::*;

/// Ratio of a servo's added inertia to the inertia that it moves, at or above which the servo counts as stiff.
///
/// Evidence: with 0.3, a Unitree G1 whose force limits are a third of the real ones takes 1.7 times as much time per step as with 1.0.
/// With infinity, a stiff arm has up to 2.5 times the error (docs/development/decisions/stiff_servos.md).
const STIFF_SERVO: f64 = 1.0;

/// Implicit terms that a step adds to the mass matrix.
#[derive(Clone, Copy, Debug)]
pub struct Implicit<'a, R: Real> {
    /// Weights of joint damping and stiffness in the mass matrix.
    pub weights: ImplicitWeights<R>,
    /// Added inertia of each servo along its moment, kg m^2 or kg. Empty if servos are explicit.
    pub servos: &'a [R],
    /// Moment arms of the actuators on sites, which depend on the configuration.
    pub arms: &'a [R],
    /// Velocity before the step, at which the fluid drag is linearised. `None` if drag is explicit.
    pub drag_at: Option<&'a [R]>,
}

impl<R: Real> Implicit<'_, R> {
    /// No implicit terms, for a mass matrix that is no part of a step.
    pub fn none() -> Self {
        let weights = ImplicitWeights { damping: R::zero(), stiffness: R::zero(), late_step: R::zero() };
        Self { weights, servos: &[], arms: &[], drag_at: None }
    }
}

/// Selection of the servos whose forces stage 1 treats implicitly, and the weights of their damping and stiffness.
#[derive(Clone, Copy, Debug)]
pub struct ImplicitServos<R> {
    /// Weights of the damping and stiffness of servos in their added inertia.
    pub weights: ImplicitWeights<R>,
    /// Time step, s.
    pub h: R,
    /// Whether all servos are implicit; otherwise only those of actuator dynamics are.
    pub all: bool,
    /// Whether the velocity after the step is predicted. Stage 1 then clamps forces at this velocity.
    pub predicted: bool,
}

impl<R: Real> ImplicitServos<R> {
    /// Whether the force of the servo `actuator` is implicit.
    #[inline(always)]
    fn includes(&self, actuator: &CompiledActuator<R::Scalar>) -> bool {
        self.all || actuator.dynamics.is_some()
    }
}

/// Inputs of implicit servos in a step: model, parameters of actuator models, and weights.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ServoInput<'a, R: Real> {
    pub(crate) compiled: &'a LaneModel<R>,
    /// Parameters of the actuator models within a step, one entry for each actuator that has them.
    pub(crate) actuator_dynamics: &'a [ActuatorDynamics<R>],
    pub(crate) implicit: ImplicitServos<R>,
}

/// State at which the forces of actuators and springs are evaluated.
#[derive(Clone, Copy, Debug)]
pub struct ForceState<'a, R: Real> {
    /// Configuration at which springs and servos are evaluated.
    pub q: &'a [R],
    /// Velocity before the step.
    pub v: &'a [R],
    /// Velocity at which explicit velocity-dependent forces are evaluated.
    pub v_at: &'a [R],
    /// Activations.
    pub act: &'a [R],
    /// Time from the state to the end of the step, s. Early activations are advanced by it.
    pub time_left: R,
    /// Controls after the actuator pipelines (delay, lag ...), nu.
    pub ctrl: &'a [R],
    /// Parameters of the actuator models within a step (torque-speed curves, friction of gears ...), one entry for each actuator that has
    /// them.
    pub actuator_dynamics: &'a [ActuatorDynamics<R>],
}

impl<'a, R: Real> ForceState<'a, R> {
    /// Force state in which all quantities are those of one state, for explicit servos. `time_left` is the time step, s.
    pub fn state([q, v, act]: [&'a [R]; 3], time_left: R, ctrl: &'a [R], actuator_dynamics: &'a [ActuatorDynamics<R>]) -> Self {
        Self { q, v, v_at: v, act, time_left, ctrl, actuator_dynamics }
    }
}

/// Forces of actuators and springs in one group of lanes.
#[derive(Clone, Debug)]
pub struct ActuatorForces<R: Real> {
    /// Generalized forces of actuators and springs, N or N m. They exclude implicit parts, and joint damping, which stage 2 adds.
    pub tau: Vec<R>,
    /// Generalized forces of the actuators alone (no springs), clamped to the force ranges of joints, N or N m. Computed only with explicit
    /// servos.
    pub without_springs: Vec<R>,
    /// Force of every actuator, N or N m. Of an implicit force it is the explicit part e.
    pub force: Vec<R>,
    /// Added inertia of each servo, kg m^2 or kg. It is zero for an explicit force, for a force at its lower or upper bound, and for a
    /// servo in a bounded sum that is at a bound.
    pub added_inertia: Vec<R>,
    /// Inertia that each servo moves. It is computed only for the midpoint rule and for models with bounded servos. Otherwise its inverse,
    /// the field `mobility`, is zero.
    pub(crate) effective_inertias: Vec<EffectiveInertia<R>>,
    /// Lanes in which the step assumes that a servo is at a bound of its `force_range`.
    assumed_saturated: Vec<R::Mask>,
    /// Lanes in which the step assumes that a servo has a constant force and no added inertia. There the servo, or a bounded sum that
    /// contains its force, is at a bound.
    fixed: Vec<R::Mask>,
    /// Force of each servo in the lanes `fixed`, N or N m.
    fixed_force: Vec<R>,
    /// Lanes in which each servo is stiff: its added inertia is at least [`STIFF_SERVO`] times the inertia that the servo moves.
    stiff: Vec<R::Mask>,
    /// Lanes in which the step assumes that a bounded sum is at a bound. There is one mask per bounded sum.
    assumed_sum_saturated: Vec<R::Mask>,
    /// Explicit part and added inertia of every servo before clamping to its `force_range`, but after the limits of actuator models.
    /// Empty in models without bounded servos.
    pub(crate) unclamped: Vec<[R; 2]>,
    /// Force of every actuator in the last trial, clamped to its `force_range`, N or N m.
    trial_force: Vec<R>,
    /// Lanes in which the force of an actuator is outside its bounds before clamping. Stage 1 sets them for explicit forces, and a trial
    /// for implicit forces.
    pub(crate) found_saturated: Vec<R::Mask>,
    /// Lanes in which each bounded sum is outside its bounds before clamping. If all servos are implicit, stage 1 sets the lanes that it
    /// assumes, for sums with a servo. A later trial sets those that it finds.
    found_sum_saturated: Vec<R::Mask>,
    /// Moment arms of all actuators on sites.
    pub arms: Vec<R>,
    /// Lengths of all actuators on sites.
    pub(crate) lengths: Vec<R>,
    /// Number of contacts that each actuator on contacts pulls.
    pub(crate) pulled: Vec<R>,
    /// Force of each actuator with actuator dynamics, with the active bound that the step assumes.
    pub(super) bounded_forces: Vec<BoundedForce<R>>,
    /// Force of each actuator with actuator dynamics, with the active bound in the last trial.
    trial_bounded_forces: Vec<BoundedForce<R>>,
    /// Whether the active bounds of this step have not been guessed yet.
    pub(crate) active_bounds_unknown: bool,
    /// Friction losses of actuators with dynamics for every row of dry friction, N or N m: against forward motion, and against backward
    /// motion. Empty without losses.
    pub losses: Vec<[R; 2]>,
}

impl<R: Real> ActuatorForces<R> {
    /// Workspace for a compiled model.
    pub fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        let never = |n: usize| vec![R::Mask::splat(false); n];
        Self {
            tau: zeros(compiled.nv),
            without_springs: zeros(compiled.nv),
            force: zeros(compiled.actuators.len()),
            added_inertia: zeros(compiled.servos.len()),
            effective_inertias: vec![EffectiveInertia::default(); compiled.servos.len()],
            assumed_saturated: never(compiled.servos.len()),
            fixed: never(compiled.servos.len()),
            fixed_force: zeros(compiled.servos.len()),
            stiff: never(compiled.servos.len()),
            assumed_sum_saturated: never(compiled.actuator_force_ranges.len()),
            trial_force: zeros(if compiled.servos_are_bounded { compiled.actuators.len() } else { 0 }),
            unclamped: vec![[R::zero(); 2]; if compiled.servos_are_bounded { compiled.servos.len() } else { 0 }],
            found_saturated: never(compiled.actuators.len()),
            found_sum_saturated: never(compiled.actuator_force_ranges.len()),
            arms: zeros(compiled.variable_arms[0]),
            lengths: zeros(compiled.variable_arms[1]),
            pulled: zeros(compiled.adhesive_actuators().count()),
            bounded_forces: vec![BoundedForce::default(); compiled.num_actuator_dynamics],
            trial_bounded_forces: vec![BoundedForce::default(); compiled.num_actuator_dynamics],
            active_bounds_unknown: true,
            losses: vec![zero(); if compiled.lossy { compiled.frictions.len() } else { 0 }],
        }
    }

    /// Moment arms of all actuators, and number of contacts that each actuator on contacts pulls, for `set_adhesive_arms`.
    #[inline(always)]
    pub(crate) fn adhesive_arms(&mut self) -> [&mut [R]; 2] {
        [&mut self.arms, &mut self.pulled]
    }

    /// Resets the active bounds of servos. The next call of stage 1 then guesses them.
    #[inline(always)]
    pub fn reset_active_bounds(&mut self) {
        if !self.assumed_saturated.is_empty() {
            self.assumed_saturated.fill(R::Mask::splat(false));
            self.fixed.fill(R::Mask::splat(false));
            self.assumed_sum_saturated.fill(R::Mask::splat(false));
        }
        self.active_bounds_unknown = true;
    }

    /// Computes the inertia that each servo moves, and the change of the servo's velocity by `impulse`, the constraint impulses of the last
    /// step. `inertia` is the diagonal of the mass matrix.
    pub fn compute_effective_inertia(&mut self, compiled: &LaneModel<R>, inertia: &[R], impulse: &[R]) {
        kernel!(R, || {
            for k in 0..compiled.servos.len() {
                self.effective_inertias[k] =
                    self.effective_inertia_of(compiled, &compiled.actuators[compiled.servos[k].actuator], [inertia, impulse]);
            }
        })
    }

    /// Inertia that an actuator moves. For several degrees of freedom, the damping rate is a mean, weighted by their inverse inertias.
    #[inline(always)]
    fn effective_inertia_of(
        &self,
        compiled: &LaneModel<R>,
        actuator: &CompiledActuator<R::Scalar>,
        [inertia, impulse]: [&[R]; 2],
    ) -> EffectiveInertia<R> {
        let mut sum = EffectiveInertia::default();
        for &(_, dof, arm) in &actuator.moment {
            sum = sum.with(R::splat(arm), [inertia[dof], impulse[dof]], compiled.params.dof(dof).damping);
        }
        if let Some(wrench) = &actuator.variable_moment {
            for (&(dof, _), &arm) in wrench.dofs.iter().zip(&self.arms[wrench.arms..]) {
                sum = sum.with(arm, [inertia[dof], impulse[dof]], compiled.params.dof(dof).damping);
            }
        }
        let EffectiveInertia { mobility, damping_rate, .. } = sum;
        let moves = mobility.gt(R::zero());
        let damping_rate = R::select(moves, damping_rate / R::select(moves, mobility, R::one()), R::zero());
        EffectiveInertia { damping_rate, ..sum }
    }

    /// Stores the explicit part `force` and the added inertia of a servo. In the lanes `fixed` it stores the assumed constant force
    /// instead, without added inertia.
    #[inline(always)]
    pub(crate) fn set_servo(&mut self, actuator: usize, servo: usize, force: R, added_inertia: R) {
        if let Some(unclamped) = self.unclamped.get_mut(servo) {
            *unclamped = [force, added_inertia];
            self.stiff[servo] = (added_inertia * self.effective_inertias[servo].mobility).ge(R::of(STIFF_SERVO));
        }
        let fixed = self.fixed[servo];
        self.force[actuator] = R::select(fixed, self.fixed_force[servo], force);
        self.added_inertia[servo] = R::select(fixed, R::zero(), added_inertia);
    }

    /// Stores the force of a servo with actuator dynamics (limits, motor, losses): its explicit part and added inertia, with the active
    /// bound that the step assumes.
    ///
    /// `affine` is the force without limits, as a function of the length and velocity in `motion`. `dynamics` describes the limits and the
    /// motor.
    #[inline(always)]
    pub(crate) fn set_limited_servo(
        &mut self,
        input: ServoInput<'_, R>,
        [actuator, servo]: [usize; 2],
        dynamics: &CompiledActuatorDynamics<R::Scalar>,
        affine: &AffineForce<R>,
        motion: &Motion<R>,
    ) {
        let (numbers, weights) = (&input.actuator_dynamics[dynamics.index], input.implicit.weights);
        let (effective_inertia, bounded_force) = (self.effective_inertias[servo], &mut self.bounded_forces[dynamics.index]);
        bounded_force.set_affine_force(
            affine.explicit_part_and_added_inertia(motion, effective_inertia, weights),
            motion.before,
            effective_inertia,
        );
        if self.active_bounds_unknown {
            bounded_force.set_bound_for_guess(ForceLimits { dynamics, numbers });
        }
        let (force, added_inertia) = bounded_force.force(numbers, weights);
        let max_added_inertia = bounded_force.max_added_inertia(numbers, weights);
        self.set_servo(actuator, servo, force, added_inertia);
        // `set_servo` compares the added inertia of the assumed bound only. The servo is stiff if that of any bound is large.
        self.stiff[servo] = (max_added_inertia * effective_inertia.mobility).ge(R::of(STIFF_SERVO));
    }

    /// Clamps the force of a servo at the predicted velocity, in the lanes in which the servo is not stiff. `dv` is the predicted change of
    /// the actuator's velocity in the step.
    ///
    /// The added inertia does not change, because the mass matrix is already factored.
    #[inline(always)]
    pub(crate) fn clamp_at_predicted_velocity(&mut self, input: ServoInput<'_, R>, servo: usize, dv: R) {
        let a = input.compiled.servos[servo].actuator;
        let ServoForce { force, changed, .. } = self.trial_servo_force(input, servo, dv);
        let range = input.compiled.actuators[a].force_range;
        let (clamped, is_outside) = (within(force, range), exceeds_range(force, range));
        self.trial_force[a] = clamped;
        let changes = changed.or(is_outside).or(self.fixed[servo]).and_not(self.stiff[servo]);
        // The mass matrix subtracts b/h dv. The explicit part is therefore the clamped force plus b/h dv.
        self.force[a] = R::select(changes, clamped + self.added_inertia[servo] / input.implicit.h * dv, self.force[a]);
    }

    /// Trial of one servo: its whole force if the actuator's velocity changes by `dv` in the step, with the active bound at the resulting
    /// velocity.
    #[inline(always)]
    fn trial_servo_force(&self, input: ServoInput<'_, R>, servo: usize, dv: R) -> ServoForce<R> {
        let ServoInput { compiled, actuator_dynamics, implicit: ImplicitServos { weights, h, .. } } = input;
        let (mut updated, mut changed, mut split) = (None, R::Mask::splat(false), self.unclamped[servo]);
        if let Some(dynamics) = &compiled.actuators[compiled.servos[servo].actuator].dynamics {
            let (mut bounded_force, numbers) = (self.bounded_forces[dynamics.index], &actuator_dynamics[dynamics.index]);
            changed = bounded_force.set_bound_at_acceleration(ForceLimits { dynamics, numbers }, weights, dv / h);
            split = bounded_force.force(numbers, weights).into();
            updated = Some((dynamics.index, bounded_force));
        }
        let [explicit_part, added_inertia] = split;
        // The velocity changes by dv, so that the implicit part of the force is -b/h dv.
        ServoForce { bounded_force: updated, changed, split, force: explicit_part - added_inertia / h * dv }
    }

    /// Sums the forces of all actuators on every degree of freedom into `tau`, and clamps the sums to the force ranges of joints.
    #[inline(always)]
    pub(crate) fn sum_forces(&mut self, compiled: &LaneModel<R>, implicit: Option<ImplicitServos<R>>) {
        // `actuate` has guessed the active bounds before it calls this function.
        self.active_bounds_unknown = false;
        self.tau.fill(R::zero());
        for (actuator, &force) in compiled.actuators.iter().zip(&self.force) {
            for &(_, dof, arm) in &actuator.moment {
                self.tau[dof] += R::splat(arm) * force;
            }
            if let Some(wrench) = &actuator.variable_moment {
                for (&(dof, _), &arm) in wrench.dofs.iter().zip(&self.arms[wrench.arms..]) {
                    self.tau[dof] += arm * force;
                }
            }
        }
        for (r, range) in compiled.actuator_force_ranges.iter().enumerate() {
            let tau = self.tau[range.dof];
            let clamped = within(tau, Some(range.bounds));
            self.tau[range.dof] = match implicit {
                Some(ImplicitServos { all: true, predicted, .. }) if range.has_servos => {
                    self.found_sum_saturated[r] = self.assumed_sum_saturated[r];
                    let assumed = R::select(self.assumed_sum_saturated[r], clamped, tau);
                    if predicted { self.clamp_sum_at_predicted_velocity(compiled, range, [tau, assumed]) } else { assumed }
                }
                _ => {
                    self.found_sum_saturated[r] = outside(tau, range.bounds);
                    clamped
                }
            };
        }
    }

    /// Actuators whose forces a bounded sum contains: index, and moment arm.
    #[inline(always)]
    fn arms_of_sum<'a>(&'a self, range: &'a CompiledForceRange<R::Scalar>) -> impl Iterator<Item = (usize, R)> + 'a {
        let constant = range.actuators.iter().map(
            #[inline(always)]
            |&(a, arm)| (a, R::splat(arm)),
        );
        let on_sites = range.variable.iter().map(
            #[inline(always)]
            |&(a, k)| (a, self.arms[k]),
        );
        constant.chain(on_sites)
    }

    /// Explicit part of a bounded sum of actuator forces, N or N m. `sum` is the sum of the explicit parts of the forces.
    ///
    /// In lanes in which no servo of the sum is stiff, the whole sum is clamped at the predicted velocity. In the other lanes the result is
    /// `assumed`, the sum with the assumed active bound.
    #[inline(always)]
    fn clamp_sum_at_predicted_velocity(&self, compiled: &LaneModel<R>, range: &CompiledForceRange<R::Scalar>, [sum, assumed]: [R; 2]) -> R {
        let (mut stiff, mut expected) = (R::Mask::splat(false), R::zero());
        for (a, arm) in self.arms_of_sum(range) {
            let servo = compiled.actuators[a].servo;
            stiff = servo.map_or(stiff, |k| stiff.or(self.stiff[k]));
            expected += arm * if servo.is_some() { self.trial_force[a] } else { self.force[a] };
        }
        // `expected` is the sum of the whole forces. `sum - expected` is the b/h dv of the servos, which the mass matrix subtracts.
        let clamped = R::select(outside(expected, range.bounds), within(expected, Some(range.bounds)) + (sum - expected), sum);
        R::select(stiff, assumed, clamped)
    }

    /// Lanes in which the force of an actuator, or a bounded sum that contains it, was outside its bounds when it was last computed.
    #[inline(always)]
    pub(crate) fn is_saturated(&self, compiled: &LaneModel<R>, actuator: usize) -> R::Mask {
        let (compiled_actuator, mut saturated) = (&compiled.actuators[actuator], self.found_saturated[actuator]);
        if let (Some(_), Some(dynamics)) = (compiled_actuator.servo, &compiled_actuator.dynamics) {
            saturated = saturated.or(self.trial_bounded_forces[dynamics.index].is_saturated());
        }
        saturated.or(lanes_of_sums(compiled, &self.found_sum_saturated, actuator))
    }

    /// Lanes in which the force of an actuator, or the bounded sum of its joint, is at a bound or outside of its bounds. Bounded sums do
    /// not count for actuators on tendons and sites.
    ///
    /// As in MuJoCo, the derivative of such a force is zero. The caller must have computed the explicit forces.
    #[inline(always)]
    pub(crate) fn is_at_bound(&self, compiled: &LaneModel<R>, actuator: usize) -> R::Mask {
        let compiled_actuator = &compiled.actuators[actuator];
        let mut at = self.found_saturated[actuator];
        if let Some(range) = compiled_actuator.force_range {
            at = at.or(reaches(self.force[actuator], range));
        }
        if let Some(range) = compiled_actuator.joint_force_range.map(|r| &compiled.actuator_force_ranges[r]) {
            at = at.or(reaches(self.without_springs[range.dof], range.bounds));
        }
        at
    }

    /// Whether the step must guess the active bounds of servos before it sums the forces.
    #[inline(always)]
    pub(crate) fn needs_guess(&self) -> bool {
        self.active_bounds_unknown && !self.unclamped.is_empty()
    }

    /// Sets the active bounds of servos from a guess of the velocity change in the step.
    ///
    /// In this guess each servo moves only its effective inertia, and constraints have the impulses of the last step.
    #[inline(always)]
    pub(crate) fn guess_active_bounds(&mut self, input: ServoInput<'_, R>) {
        self.set_bounds_by_trial(
            input,
            true,
            #[inline(always)]
            |forces, servo| {
                let ([force, added_inertia], EffectiveInertia { mobility, change_by_impulses, .. }) =
                    (forces.unclamped[servo], forces.effective_inertias[servo]);
                (input.implicit.h * force * mobility + change_by_impulses) / (R::one() + added_inertia * mobility)
            },
        );
    }

    /// Finds the active bounds of servos at the generalized velocity change `dv` in the step, and the saturated actuators. Returns the
    /// lanes in which an active bound differs from the assumed one. There the forces must be recomputed.
    ///
    /// If `may_change` is true, the found bounds replace the assumed ones. If all servos are implicit, only bounds of stiff servos count:
    /// stage 1 has clamped the others at the predicted velocity.
    pub(crate) fn set_bounds_at_velocity_change(&mut self, input: ServoInput<'_, R>, dv: &[R], may_change: bool) -> R::Mask {
        let compiled = input.compiled;
        kernel!(R, || {
            self.set_bounds_by_trial(
                input,
                may_change,
                #[inline(always)]
                |forces, servo| forces.project(&compiled.actuators[compiled.servos[servo].actuator], dv),
            )
        })
    }

    /// Makes a trial of all servos, and sets the assumed active bounds to those of the trial, in lanes in which one changed. Returns these
    /// lanes; the first call in a step returns all lanes. `dv_of` returns the change of an actuator's velocity in the step.
    ///
    /// If `may_change` is false, the assumed active bounds stay. The result then has the lanes in which one would change.
    #[inline(always)]
    fn set_bounds_by_trial(&mut self, input: ServoInput<'_, R>, may_change: bool, dv_of: impl Fn(&Self, usize) -> R) -> R::Mask {
        let ServoInput { compiled, implicit, .. } = input;
        let mut changed = R::Mask::splat(self.active_bounds_unknown);
        let differ = |a: R::Mask, b: R::Mask| a.and_not(b).or(b.and_not(a));
        // The loop replaces the forces of servos by their trial forces. Other actuators keep the force of stage 1.
        self.trial_force.copy_from_slice(&self.force);
        for (k, servo) in compiled.servos.iter().enumerate() {
            let (actuator, dv) = (&compiled.actuators[servo.actuator], dv_of(self, k));
            // Lanes in which a change of this servo's active bound requires a new solve.
            let needs_solve = if implicit.all { self.stiff[k] } else { R::Mask::splat(true) };
            let trial = self.trial_servo_force(input, k, dv);
            let mut force = trial.force;
            if let Some((index, bounded_force)) = trial.bounded_force {
                self.trial_bounded_forces[index] = bounded_force;
                self.unclamped[k] = trial.split;
                changed = changed.or(trial.changed.and(needs_solve).and_not(self.fixed[k]));
            }
            // An explicit force is already clamped by stage 1, and adds no inertia at any velocity.
            if let Some(bounds) = actuator.force_range.filter(|_| implicit.includes(actuator)) {
                let (found, assumed) = (outside(force, bounds), self.assumed_saturated[k]);
                force = within(force, Some(bounds));
                let at_other_bound = found.and(assumed).and(force.eq(self.fixed_force[k]).not());
                changed = changed.or(differ(found, assumed).or(at_other_bound).and(needs_solve));
                self.found_saturated[servo.actuator] = found;
            }
            self.trial_force[servo.actuator] = force;
        }
        for (r, range) in compiled.actuator_force_ranges.iter().enumerate().filter(|(_, range)| range.has_servos) {
            let (mut needs_solve, mut sum, mut assumed_sum) = (R::Mask::splat(!implicit.all), R::zero(), R::zero());
            for (a, arm) in self.arms_of_sum(range) {
                needs_solve = compiled.actuators[a].servo.map_or(needs_solve, |k| needs_solve.or(self.stiff[k]));
                sum += arm * self.trial_force[a];
                assumed_sum += arm * self.force[a];
            }
            let (found, assumed) = (outside(sum, range.bounds), self.assumed_sum_saturated[r]);
            let is_above = |sum: R| sum.gt(R::splat(range.bounds[1]));
            let at_other_bound = found.and(assumed).and(differ(is_above(sum), is_above(assumed_sum)));
            self.found_sum_saturated[r] = found;
            changed = changed.or(differ(found, assumed).or(at_other_bound).and(needs_solve));
        }
        if !may_change {
            return changed;
        }
        // Lanes without a change are solved again only because of other lanes. They keep all assumptions, and thereby their bits.
        let update = |assumed: R::Mask, found: R::Mask| found.and(changed).or(assumed.and_not(changed));
        for (assumed, &found) in self.assumed_sum_saturated.iter_mut().zip(&self.found_sum_saturated) {
            *assumed = update(*assumed, found);
        }
        for (k, servo) in compiled.servos.iter().enumerate() {
            let (a, [force, added_inertia]) = (servo.actuator, self.unclamped[k]);
            if let Some(dynamics) = &compiled.actuators[a].dynamics {
                self.bounded_forces[dynamics.index].copy_active_bounds(&self.trial_bounded_forces[dynamics.index], changed);
            }
            if compiled.actuators[a].force_range.is_some() && implicit.includes(&compiled.actuators[a]) {
                self.assumed_saturated[k] = update(self.assumed_saturated[k], self.found_saturated[a]);
            }
            let fixed = self.assumed_saturated[k].or(lanes_of_sums(compiled, &self.assumed_sum_saturated, a));
            self.fixed[k] = fixed;
            self.fixed_force[k] = R::select(changed, self.trial_force[a], self.fixed_force[k]);
            self.force[a] = R::select(changed, R::select(fixed, self.fixed_force[k], force), self.force[a]);
            self.added_inertia[k] = R::select(changed, R::select(fixed, R::zero(), added_inertia), self.added_inertia[k]);
        }
        changed
    }

    /// Expected whole force of a servo in the step, N or N m.
    ///
    /// The velocity is expected to change by the free acceleration `acc` and by the constraint impulses of the last step.
    #[inline(always)]
    pub(super) fn expected_servo_force(&self, input: ServoInput<'_, R>, servo: usize, acc: &[R]) -> R {
        let actuator = &input.compiled.actuators[input.compiled.servos[servo].actuator];
        let EffectiveInertia { mobility, change_by_impulses, .. } = self.effective_inertias[servo];
        let by_constraints = change_by_impulses / (R::one() + self.added_inertia[servo] * mobility);
        let dv = input.implicit.h * self.project(actuator, acc) + by_constraints;
        within(self.trial_servo_force(input, servo, dv).force, actuator.force_range)
    }
}

/// Result of a servo's trial: its whole force at a candidate velocity change, with the active bound there.
#[derive(Clone, Copy, Debug)]
struct ServoForce<R: Real> {
    /// Index of the actuator dynamics of the servo, and the force with the updated active bound; `None` without dynamics.
    bounded_force: Option<(usize, BoundedForce<R>)>,
    /// Lanes in which the active bound of the actuator dynamics changed.
    changed: R::Mask,
    /// Explicit part and added inertia of the force with the updated active bound.
    split: [R; 2],
    /// Whole force before clamping to the actuator's `force_range`, N or N m.
    force: R,
}

/// Lanes in which any bounded sum that contains the actuator's force has its bit set in `masks`. There is one mask per bounded sum.
#[inline(always)]
fn lanes_of_sums<R: Real>(compiled: &LaneModel<R>, masks: &[R::Mask], actuator: usize) -> R::Mask {
    let mut lanes = R::Mask::splat(false);
    for (range, &mask) in compiled.actuator_force_ranges.iter().zip(masks) {
        let mut acting = range.actuators.iter().map(|a| a.0).chain(range.variable.iter().map(|a| a.0));
        if mask.any() && acting.any(|a| a == actuator) {
            lanes = lanes.or(mask);
        }
    }
    lanes
}
