//! Force limits of an actuator's dynamics, and its active bound: none, a force limit, or the torque-speed curve of its motor.

use stepper_real::{Mask, Real};

use crate::actuation::affine_force::{ActuatorDynamics, EffectiveInertia};
use crate::compile::CompiledActuatorDynamics;
use crate::dynamics::implicit_weights::ImplicitWeights;

/// Limits of an actuator with dynamics: which there are, and their parameters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ForceLimits<'a, R: Real> {
    pub(crate) dynamics: &'a CompiledActuatorDynamics<R::Scalar>,
    pub(crate) numbers: &'a ActuatorDynamics<R>,
}

/// Force of an actuator with dynamics within a step: its affine force, clamped to the force limits and to the torque-speed curve of its
/// motor.
///
/// The force is `f = clamp(clamp(affine, limits), +-stall - back_emf v)`. It is piecewise affine in the motion. The active bound selects
/// the affine piece, which the step treats implicitly. For stiff servos, the step finds the active bound by semismooth Newton iterations
/// (Qi & Sun 1993). Each iteration solves with an assumed active bound, and then assumes the active bound of the solution
/// ([`crate::actuation::forces`]).
#[derive(Clone, Copy, Debug)]
pub(super) struct BoundedForce<R: Real> {
    /// Explicit part and added inertia of the affine force, before clamping.
    affine: (R, R),
    /// Velocity of the actuator before the step.
    before: R,
    /// Inertia that the actuator moves.
    effective_inertia: EffectiveInertia<R>,
    /// Active bound, see [`active_bound`].
    active: [R::Mask; 3],
}

impl<R: Real> Default for BoundedForce<R> {
    fn default() -> Self {
        let (affine, effective_inertia) = ((R::zero(), R::zero()), EffectiveInertia::default());
        Self { affine, before: R::zero(), effective_inertia, active: [R::Mask::splat(false); 3] }
    }
}

impl<R: Real> BoundedForce<R> {
    /// Stores the affine force (explicit part and added inertia), the velocity before the step, and the effective inertia.
    #[inline(always)]
    pub(super) fn set_affine_force(&mut self, affine: (R, R), before: R, effective_inertia: EffectiveInertia<R>) {
        (self.affine, self.before, self.effective_inertia) = (affine, before, effective_inertia);
    }

    /// Sets the active bound for the first guess of the velocity change in the step.
    ///
    /// A force without added inertia gets the active bound at the velocity before the step; any other force gets none. With these forces,
    /// [`ActuatorForces::guess_active_bounds`] guesses the velocity change. It then sets the active bound at the guessed velocity.
    ///
    /// [`ActuatorForces::guess_active_bounds`]: crate::actuation::forces::ActuatorForces::guess_active_bounds
    #[inline(always)]
    pub(super) fn set_bound_for_guess(&mut self, limits: ForceLimits<'_, R>) {
        let is_explicit = self.affine.1.eq(R::zero());
        let found = active_bound(limits, self.affine.0, self.before);
        for (active, found) in self.active.iter_mut().zip(found) {
            *active = found.and(is_explicit);
        }
    }

    /// Updates the active bound (none, a force limit, or the torque-speed curve) to that of a step with the mean acceleration
    /// `acceleration` of the actuator's length. Returns the lanes in which the active bound changed.
    #[inline(always)]
    pub(super) fn set_bound_at_acceleration(
        &mut self,
        limits: ForceLimits<'_, R>,
        weights: ImplicitWeights<R>,
        acceleration: R,
    ) -> R::Mask {
        let force = self.affine.0 - self.affine.1 * acceleration;
        let found = active_bound(limits, force, self.before + weights.damping * acceleration);
        let mut changed = R::Mask::splat(false);
        for (active, found) in self.active.iter_mut().zip(found) {
            changed = changed.or(found.and_not(*active)).or(active.and_not(found));
            *active = found;
        }
        changed
    }

    /// Largest added inertia of all possible active bounds, kg or kg m^2.
    #[inline(always)]
    pub(super) fn max_added_inertia(&self, numbers: &ActuatorDynamics<R>, weights: ImplicitWeights<R>) -> R {
        self.affine.1.max(self.curve_added_inertia(numbers, weights))
    }

    /// Added inertia of a force on the torque-speed curve, kg or kg m^2.
    #[inline(always)]
    fn curve_added_inertia(&self, numbers: &ActuatorDynamics<R>, weights: ImplicitWeights<R>) -> R {
        numbers.back_emf * weights.damping * (R::one() + weights.late_fraction(self.effective_inertia.rate(numbers.back_emf)))
    }

    /// Copies the active bounds of `other` in the lanes `lanes`.
    #[inline(always)]
    pub(super) fn copy_active_bounds(&mut self, other: &Self, lanes: R::Mask) {
        for (active, other) in self.active.iter_mut().zip(other.active) {
            *active = other.and(lanes).or(active.and_not(lanes));
        }
    }

    /// Lanes in which a bound is active: a force limit or the torque-speed curve.
    #[inline(always)]
    pub(super) fn is_saturated(&self) -> R::Mask {
        let [at_limit, on_curve, _] = self.active;
        at_limit.or(on_curve)
    }

    /// Explicit part of the force with the current active bound, N or N m, and its added inertia, kg or kg m^2.
    #[inline(always)]
    pub(super) fn force(&self, numbers: &ActuatorDynamics<R>, weights: ImplicitWeights<R>) -> (R, R) {
        let [at_limit, on_curve, _] = self.active;
        let added_inertia = R::select(at_limit, R::zero(), self.affine.1);
        let force = bounded(self.active, numbers, self.affine.0, self.before);
        (force, R::select(on_curve, self.curve_added_inertia(numbers, weights), added_inertia))
    }
}

/// Active bound of a force at a velocity, as three masks: lanes at a force limit, lanes on the motor's torque-speed curve, and lanes at an
/// upper bound. In the lanes of the first two masks that are not in the third, the bound is a lower one.
#[inline(always)]
fn active_bound<R: Real>(ForceLimits { dynamics, numbers }: ForceLimits<'_, R>, force: R, velocity: R) -> [R::Mask; 3] {
    let never = R::Mask::splat(false);
    let ([low, high], mut requested) = (numbers.limits, force);
    let (mut at_limit, mut upper) = (never, never);
    if dynamics.limited {
        upper = force.gt(high);
        at_limit = force.lt(low).or(upper);
        requested = R::select(at_limit, force.clamp(low, high), force);
    }
    let mut curve = never;
    if dynamics.motor.is_some() {
        let loss = numbers.back_emf * velocity;
        let (above, below) = (requested.gt(numbers.stall - loss), requested.lt(-numbers.stall - loss));
        curve = above.or(below);
        upper = upper.and_not(curve).or(above);
        at_limit = at_limit.and_not(curve);
    }
    [at_limit, curve, upper]
}

/// Force with the active bound `active`, at the velocity `velocity`.
#[inline(always)]
fn bounded<R: Real>([at_limit, on_curve, at_upper]: [R::Mask; 3], numbers: &ActuatorDynamics<R>, force: R, velocity: R) -> R {
    let limit = R::select(at_upper, numbers.limits[1], numbers.limits[0]);
    let edge = R::select(at_upper, numbers.stall, -numbers.stall) - numbers.back_emf * velocity;
    R::select(on_curve, edge, R::select(at_limit, limit, force))
}

/// Force of an actuator after its limits and the torque-speed curve of its motor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LimitedForce<R: Real> {
    /// Force, N or N m.
    pub(crate) force: R,
    /// Lanes in which a limit or the curve determines the force, so that it differs from the given one.
    pub(crate) is_limited: R::Mask,
}

/// Clamps the force of an actuator, N or N m, to its limits and to the torque-speed curve of its motor at the velocity `velocity`.
#[inline(always)]
pub(crate) fn clamp_to_limits<R: Real>(limits: ForceLimits<'_, R>, force: R, velocity: R) -> LimitedForce<R> {
    let active @ [at_limit, on_curve, _] = active_bound(limits, force, velocity);
    LimitedForce { force: bounded(active, limits.numbers, force, velocity), is_limited: at_limit.or(on_curve) }
}
