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
//! A servo at a bound of its force contributes the bound and no stiffness, and leaves the mass matrix. A guess, which neglects the coupling
//! of joints, places every servo before the matrix is factored. Later velocities may give another place:
//!
//! * A stiff servo adds more inertia than it moves. It moves to the place that the solution gives, and the step is solved again
//!   (`solve_velocities`).
//! * Another servo keeps its place, and stage 1 bounds its force at the predicted velocity.
//!
//! A motor on its torque-speed curve contributes the curve: its stall torque, and the drag of its back-EMF as a damper.

use stepper_real::{Mask, Real};

use crate::actuation::affine_force::{ActuatorDynamics, AffineForce, EffectiveInertia, Motion, outside, reaches, within};
use crate::actuation::force_limits::Region;
use crate::compile::{CompiledActuator, CompiledActuatorDynamics, CompiledForceRange, LaneModel, ModelStructure};
use crate::dynamics::implicit_weights::ImplicitWeights;
use crate::math::spatial::*;

/// Added inertia of a servo, relative to the inertia that it moves, from which on it is stiff.
///
/// A G1 with a third of its efforts takes 1.7 times as long with 0.3. With infinity, a stiff arm has up to 2.5 times the error
/// (docs/development/decisions/stiff_servos.md).
const STIFF_SERVO: f64 = 1.0;

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
    /// Time step, s.
    pub h: R,
    /// Whether all servos are implicit, or those of actuator dynamics alone.
    pub all: bool,
    /// Whether the explicit forces are those at the predicted mean velocity.
    pub predicted: bool,
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
    /// Lanes in which a servo was placed at a bound of the actuator's force.
    pub(crate) saturated: Vec<R::Mask>,
    /// Lanes in which a servo is not in the mass matrix: it was placed at the actuator's bound or at that of a sum.
    held: Vec<R::Mask>,
    /// Force of each servo in the lanes in which it is held.
    held_force: Vec<R>,
    /// Lanes in which a servo is stiff (see [`STIFF_SERVO`]).
    stiff: Vec<R::Mask>,
    /// Lanes in which the sum of actuator forces on a dof is at its bound, for every such dof.
    pub(crate) bounded: Vec<R::Mask>,
    /// Expected force of every actuator at the end of the step, in models with bounded servos and friction losses.
    pub(crate) expected_force: Vec<R>,
    /// Force and added inertia of every servo without bounds, if any is bounded.
    pub(crate) unbounded: Vec<[R; 2]>,
    /// Force of every actuator at the velocity by which servos are placed.
    candidate: Vec<R>,
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
    /// These regions at the velocity by which servos are placed.
    candidate_regions: Vec<Region<R>>,
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
            effective_inertias: vec![EffectiveInertia::default(); compiled.servos.len()],
            saturated: never(compiled.servos.len()),
            held: never(compiled.servos.len()),
            held_force: zeros(compiled.servos.len()),
            stiff: never(compiled.servos.len()),
            bounded: never(compiled.actuator_force_ranges.len()),
            expected_force: zeros(if compiled.servos_are_bounded && compiled.lossy { compiled.actuators.len() } else { 0 }),
            candidate: zeros(if compiled.servos_are_bounded { compiled.actuators.len() } else { 0 }),
            unbounded: vec![[R::zero(); 2]; if compiled.servos_are_bounded { compiled.servos.len() } else { 0 }],
            beyond: never(compiled.actuators.len()),
            cut: never(compiled.actuator_force_ranges.len()),
            arms: zeros(compiled.wrench_arms[0]),
            lengths: zeros(compiled.wrench_arms[1]),
            regions: vec![Region::default(); compiled.actuator_dynamics],
            candidate_regions: vec![Region::default(); compiled.actuator_dynamics],
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
            self.held.fill(R::Mask::splat(false));
            self.bounded.fill(R::Mask::splat(false));
        }
        self.fresh = true;
    }

    /// Computes the effective inertias of servos from the mass matrix's diagonal `inertia`, and the velocities that the last `impulse` of
    /// constraints gives to them.
    pub fn compute_effective_inertia(&mut self, compiled: &LaneModel<R>, inertia: &[R], impulse: &[R]) {
        R::vectorize(
            #[inline(always)]
            || {
                for k in 0..compiled.servos.len() {
                    self.effective_inertias[k] =
                        self.effective_inertia_of(compiled, &compiled.actuators[compiled.servos[k].actuator], [inertia, impulse]);
                }
            },
        )
    }

    /// Effective inertia of several dofs: a mean, weighted by their part in the mobility.
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
        if let Some(wrench) = &actuator.wrench {
            for (&(dof, _), &arm) in wrench.dofs.iter().zip(&self.arms[wrench.arms..]) {
                sum = sum.with(arm, [inertia[dof], impulse[dof]], compiled.params.dof(dof).damping);
            }
        }
        let EffectiveInertia { mobility, slowing, .. } = sum;
        let moves = mobility.gt(R::zero());
        let slowing = R::select(moves, slowing / R::select(moves, mobility, R::one()), R::zero());
        EffectiveInertia { slowing, ..sum }
    }

    /// Effective inertia that a servo moves.
    #[inline(always)]
    pub(crate) fn effective_inertia_at(&self, servo: usize) -> EffectiveInertia<R> {
        self.effective_inertias[servo]
    }

    /// Stores the force of a servo and its added inertia, in the lanes in which it is not held.
    #[inline(always)]
    pub(crate) fn set_servo(&mut self, actuator: usize, servo: usize, force: R, weight: R) {
        if let Some(unbounded) = self.unbounded.get_mut(servo) {
            *unbounded = [force, weight];
            self.stiff[servo] = (weight * self.effective_inertias[servo].mobility).ge(R::of(STIFF_SERVO));
        }
        let held = self.held[servo];
        self.force[actuator] = R::select(held, self.held_force[servo], force);
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
        let (effective_inertia, region) = (self.effective_inertias[servo], &mut self.regions[compiled.index]);
        region.take(law.implicit_force(motion, effective_inertia, weights), motion.before, effective_inertia);
        if self.fresh {
            region.guess(compiled, numbers);
        }
        let (force, weight) = region.force(numbers, weights);
        let most = region.most_weight(numbers, weights);
        self.set_servo(actuator, servo, force, weight);
        self.stiff[servo] = (most * effective_inertia.mobility).ge(R::of(STIFF_SERVO));
    }

    /// Bounds the force of a servo at the predicted velocity, in the lanes in which it is not stiff. `along` is the predicted change of its
    /// velocity in the step.
    ///
    /// In the mass matrix or not, the servo keeps its place.
    #[inline(always)]
    pub(crate) fn bound_servo(
        &mut self,
        compiled: &LaneModel<R>,
        actuator_dynamics: &[ActuatorDynamics<R>],
        implicit: ImplicitServos<R>,
        (servo, along): (usize, R),
    ) {
        let a = compiled.servos[servo].actuator;
        let ServoForce { force, moved, .. } = self.force_by(compiled, actuator_dynamics, implicit, (servo, along));
        let (bounded, cut) = match compiled.actuators[a].force_range {
            Some(bounds) => (within(force, Some(bounds)), outside(force, bounds)),
            None => (force, R::Mask::splat(false)),
        };
        self.candidate[a] = bounded;
        let changes = moved.or(cut).or(self.held[servo]).and_not(self.stiff[servo]);
        self.force[a] = R::select(changes, bounded + self.weight[servo] / implicit.h * along, self.force[a]);
    }

    /// Force of a servo if its velocity changes by `along` in the step.
    #[inline(always)]
    fn force_by(
        &self,
        compiled: &LaneModel<R>,
        actuator_dynamics: &[ActuatorDynamics<R>],
        ImplicitServos { weights, h, .. }: ImplicitServos<R>,
        (servo, along): (usize, R),
    ) -> ServoForce<R> {
        let (mut placed, mut moved, mut piece) = (None, R::Mask::splat(false), self.unbounded[servo]);
        if let Some(dynamics) = &compiled.actuators[compiled.servos[servo].actuator].dynamics {
            let (mut region, numbers) = (self.regions[dynamics.index], &actuator_dynamics[dynamics.index]);
            moved = region.place(dynamics, numbers, weights, along / h);
            piece = region.force(numbers, weights).into();
            placed = Some((dynamics.index, region));
        }
        ServoForce { region: placed, moved, piece, force: piece[0] - piece[1] / h * along }
    }

    /// Sums the actuators' forces on every dof, within the bounds of joints.
    #[inline(always)]
    pub(crate) fn gather(&mut self, compiled: &LaneModel<R>, implicit: Option<ImplicitServos<R>>) {
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
            let tau = self.tau[range.dof];
            let clamped = within(tau, Some(range.bounds));
            self.tau[range.dof] = match implicit {
                Some(ImplicitServos { all: true, predicted, .. }) if range.has_servos => {
                    self.cut[r] = self.bounded[r];
                    let placed = R::select(self.bounded[r], clamped, tau);
                    if predicted { self.bound_sum(compiled, range, [tau, placed]) } else { placed }
                }
                _ => {
                    self.cut[r] = outside(tau, range.bounds);
                    clamped
                }
            };
        }
    }

    /// Sum of actuator forces on a dof, bounded at the predicted velocity in the lanes in which none of its servos is stiff.
    #[inline(always)]
    fn bound_sum(&self, compiled: &LaneModel<R>, range: &CompiledForceRange<R::Scalar>, [sum, placed]: [R; 2]) -> R {
        let (mut stiff, mut expected) = (R::Mask::splat(false), R::zero());
        for &(a, arm) in &range.actuators {
            let servo = compiled.actuators[a].servo;
            stiff = servo.map_or(stiff, |k| stiff.or(self.stiff[k]));
            expected += R::splat(arm) * if servo.is_some() { self.candidate[a] } else { self.force[a] };
        }
        let bounded = R::select(outside(expected, range.bounds), within(expected, Some(range.bounds)) + (sum - expected), sum);
        R::select(stiff, placed, bounded)
    }

    /// Lanes in which the effort of an actuator, or a sum on its joint, was cut to its bounds.
    #[inline(always)]
    pub(crate) fn is_cut(&self, compiled: &LaneModel<R>, actuator: usize) -> R::Mask {
        let (of_it, mut cut) = (&compiled.actuators[actuator], self.beyond[actuator]);
        if let (Some(_), Some(dynamics)) = (of_it.servo, &of_it.dynamics) {
            cut = cut.or(self.candidate_regions[dynamics.index].is_cut());
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

    /// Whether bounded servos must be placed before the forces are summed.
    #[inline(always)]
    pub(crate) fn needs_guess(&self) -> bool {
        self.fresh && !self.unbounded.is_empty()
    }

    /// Places servos by a guess of the velocity after the step.
    ///
    /// The guess neglects the coupling of joints: each servo moves the inertia of its joints, and constraints push as in the last step.
    #[inline(always)]
    pub(crate) fn guess_servos(&mut self, compiled: &LaneModel<R>, actuator_dynamics: &[ActuatorDynamics<R>], implicit: ImplicitServos<R>) {
        self.place(
            compiled,
            actuator_dynamics,
            implicit,
            true,
            #[inline(always)]
            |forces, servo| {
                let ([force, weight], EffectiveInertia { mobility, pushed, .. }) =
                    (forces.unbounded[servo], forces.effective_inertias[servo]);
                (implicit.h * force * mobility + pushed) / (R::one() + weight * mobility)
            },
        );
    }

    /// Places servos by the change `dv` of the velocity in the step. Returns the lanes in which the place of a servo has changed.
    ///
    /// The forces of these lanes must be computed again. Servos that are not stiff do not count if the scheme bounds them at the predicted
    /// velocity. Without `may_move` places stay, and only the flags of forces outside of their bounds are updated.
    pub(crate) fn place_servos(
        &mut self,
        compiled: &LaneModel<R>,
        actuator_dynamics: &[ActuatorDynamics<R>],
        implicit: ImplicitServos<R>,
        dv: &[R],
        may_move: bool,
    ) -> R::Mask {
        R::vectorize(
            #[inline(always)]
            || {
                self.place(
                    compiled,
                    actuator_dynamics,
                    implicit,
                    may_move,
                    #[inline(always)]
                    |forces, servo| forces.along(&compiled.actuators[compiled.servos[servo].actuator], dv),
                )
            },
        )
    }

    /// Places each servo on the piece of its force on which it lies at the end of the step. `along` is the change of a servo's velocity.
    ///
    /// All lanes are placed at the first call in a step, later the lanes in which a place has changed.
    #[inline(always)]
    fn place(
        &mut self,
        compiled: &LaneModel<R>,
        actuator_dynamics: &[ActuatorDynamics<R>],
        implicit: ImplicitServos<R>,
        may_move: bool,
        along: impl Fn(&Self, usize) -> R,
    ) -> R::Mask {
        let mut moved = R::Mask::splat(self.fresh);
        let differ = |a: R::Mask, b: R::Mask| a.and_not(b).or(b.and_not(a));
        self.candidate.copy_from_slice(&self.force);
        for (k, servo) in compiled.servos.iter().enumerate() {
            let (actuator, along) = (&compiled.actuators[servo.actuator], along(self, k));
            let counts = if implicit.all { self.stiff[k] } else { R::Mask::splat(true) };
            let placed = self.force_by(compiled, actuator_dynamics, implicit, (k, along));
            let mut force = placed.force;
            if let Some((index, region)) = placed.region {
                self.candidate_regions[index] = region;
                self.unbounded[k] = placed.piece;
                moved = moved.or(placed.moved.and(counts).and_not(self.held[k]));
            }
            if let Some(bounds) = actuator.force_range {
                let (outside, before) = (outside(force, bounds), self.saturated[k]);
                force = within(force, Some(bounds));
                let turned = outside.and(before).and(force.eq(self.held_force[k]).not());
                moved = moved.or(differ(outside, before).or(turned).and(counts));
                if implicit.all || actuator.dynamics.is_some() {
                    self.beyond[servo.actuator] = outside;
                }
            }
            self.candidate[servo.actuator] = force;
        }
        for (r, range) in compiled.actuator_force_ranges.iter().enumerate().filter(|(_, range)| range.has_servos) {
            let (mut counts, mut sum, mut sum_before) = (R::Mask::splat(!implicit.all), R::zero(), R::zero());
            for &(a, arm) in &range.actuators {
                counts = compiled.actuators[a].servo.map_or(counts, |k| counts.or(self.stiff[k]));
                sum += R::splat(arm) * self.candidate[a];
                sum_before += R::splat(arm) * self.force[a];
            }
            self.cut[r] = outside(sum, range.bounds);
            let is_above = |sum: R| sum.gt(R::splat(range.bounds[1]));
            let turned = self.cut[r].and(self.bounded[r]).and(differ(is_above(sum), is_above(sum_before)));
            moved = moved.or(differ(self.cut[r], self.bounded[r]).or(turned).and(counts));
        }
        if !may_move {
            return moved;
        }
        let new = |now: R::Mask, before: R::Mask| now.and(moved).or(before.and_not(moved));
        for (bounded, &cut) in self.bounded.iter_mut().zip(&self.cut) {
            *bounded = new(cut, *bounded);
        }
        for (k, servo) in compiled.servos.iter().enumerate() {
            let (a, [force, weight]) = (servo.actuator, self.unbounded[k]);
            if let Some(dynamics) = &compiled.actuators[a].dynamics {
                self.regions[dynamics.index].replace(&self.candidate_regions[dynamics.index], moved);
            }
            if compiled.actuators[a].force_range.is_some() {
                self.saturated[k] = new(self.beyond[a], self.saturated[k]);
            }
            let held = self.saturated[k].or(lanes_of_sums(compiled, &self.bounded, a));
            self.held[k] = new(held, self.held[k]);
            self.held_force[k] = R::select(moved, self.candidate[a], self.held_force[k]);
            self.force[a] = R::select(moved, R::select(held, self.held_force[k], force), self.force[a]);
            self.weight[k] = R::select(moved, R::select(held, R::zero(), weight), self.weight[k]);
        }
        moved
    }

    /// Computes the expected force of every actuator at the end of the step.
    ///
    /// Servos change their velocity by the free acceleration `acc`, and by the impulses of constraints in the last step.
    pub(crate) fn expect_forces(
        &mut self,
        compiled: &LaneModel<R>,
        actuator_dynamics: &[ActuatorDynamics<R>],
        implicit: ImplicitServos<R>,
        acc: &[R],
    ) {
        R::vectorize(
            #[inline(always)]
            || {
                self.expected_force.copy_from_slice(&self.force);
                for (k, servo) in compiled.servos.iter().enumerate() {
                    let (actuator, EffectiveInertia { mobility, pushed, .. }) =
                        (&compiled.actuators[servo.actuator], self.effective_inertias[k]);
                    let by_constraints = pushed / (R::one() + self.weight[k] * mobility);
                    let change = implicit.h * self.along(actuator, acc) + by_constraints;
                    let force = self.force_by(compiled, actuator_dynamics, implicit, (k, change)).force;
                    self.expected_force[servo.actuator] = within(force, actuator.force_range);
                }
            },
        )
    }
}

/// Force of a servo at the end of a step.
#[derive(Clone, Copy, Debug)]
struct ServoForce<R: Real> {
    /// Index of its dynamics, and the region of their force.
    region: Option<(usize, Region<R>)>,
    /// Lanes in which the region has changed.
    moved: R::Mask,
    /// Explicit force and added inertia in this region.
    piece: [R; 2],
    /// Force without the bounds of the actuator.
    force: R,
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
