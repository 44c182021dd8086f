//! Force limits of an actuator's dynamics, and its active bound: none, a force limit, or the torque-speed curve of its motor.

use stepper_real::{Mask, Real};

use crate::actuation::affine_force::{ActuatorDynamics, EffectiveInertia};
use crate::compile::CompiledActuatorDynamics;
use crate::dynamics::implicit_weights::ImplicitWeights;

/// Force of an actuator with dynamics within a step: its affine force, clamped to the force limits and to the torque-speed curve of its
/// motor.
///
/// The force is `f = clamp(clamp(affine, limits), +-stall - back_emf v)`. It is piecewise affine in the motion. The active bound selects
/// the affine piece, which the step treats implicitly. The step finds the active bound by semismooth Newton iterations (Qi & Sun 1993).
/// Each iteration solves with an assumed active bound, and then assumes the active bound of the solution.
#[derive(Clone, Copy, Debug)]
pub(super) struct BoundedForce<R: Real> {
    /// Explicit part and added inertia of the affine force, before clamping.
    affine: (R, R),
    /// Velocity of the actuator before the step.
    before: R,
    /// Inertia that the actuator moves.
    effective_inertia: EffectiveInertia<R>,
    /// Lanes whose active bound is a force limit.
    at_limit: R::Mask,
    /// Lanes whose active bound is the torque-speed curve of the motor.
    on_curve: R::Mask,
    /// Lanes whose active bound is the upper limit or the upper side of the curve.
    at_upper: R::Mask,
}

impl<R: Real> Default for BoundedForce<R> {
    fn default() -> Self {
        let never = R::Mask::splat(false);
        let effective_inertia = EffectiveInertia::default();
        Self { affine: (R::zero(), R::zero()), before: R::zero(), effective_inertia, at_limit: never, on_curve: never, at_upper: never }
    }
}

impl<R: Real> BoundedForce<R> {
    /// Stores the affine force (explicit part and added inertia), the velocity before the step, and the effective inertia.
    #[inline(always)]
    pub(super) fn set_affine_force(&mut self, affine: (R, R), before: R, effective_inertia: EffectiveInertia<R>) {
        (self.affine, self.before, self.effective_inertia) = (affine, before, effective_inertia);
    }

    /// Sets the active bound with which the force enters the step's first guess of the velocity change.
    ///
    /// A force without added inertia gets the active bound at the velocity before the step; any other force gets none. With the resulting
    /// forces, [`ActuatorForces::guess_active_bounds`] guesses the velocity change in the step. It then sets the active bound at the
    /// guessed velocity.
    ///
    /// [`ActuatorForces::guess_active_bounds`]: crate::actuation::forces::ActuatorForces::guess_active_bounds
    #[inline(always)]
    pub(super) fn set_bound_for_guess(&mut self, dynamics: &CompiledActuatorDynamics<R::Scalar>, numbers: &ActuatorDynamics<R>) {
        let never = R::Mask::splat(false);
        (self.at_limit, self.on_curve, self.at_upper) = (never, never, never);
        let is_explicit = self.affine.1.eq(R::zero());
        let [at_limit, curve, upper] = active_bound(dynamics, numbers, self.affine.0, self.before);
        (self.at_limit, self.on_curve, self.at_upper) = (at_limit.and(is_explicit), curve.and(is_explicit), upper.and(is_explicit));
    }

    /// Updates the active bound (force limit or torque-speed curve) to that of a step with the mean acceleration `acceleration` of the
    /// actuator's length. Returns the lanes in which the active bound changed.
    #[inline(always)]
    pub(super) fn set_bound_at_acceleration(
        &mut self,
        dynamics: &CompiledActuatorDynamics<R::Scalar>,
        numbers: &ActuatorDynamics<R>,
        weights: ImplicitWeights<R>,
        acceleration: R,
    ) -> R::Mask {
        let [at_limit, curve, upper] =
            active_bound(dynamics, numbers, self.affine.0 - self.affine.1 * acceleration, self.before + weights.damping * acceleration);
        // Lanes in which two masks have the same bit.
        let same = |a: R::Mask, b: R::Mask| a.and(b).or(a.or(b).not());
        let changed = same(at_limit, self.at_limit).and(same(curve, self.on_curve)).and(same(upper, self.at_upper)).not();
        (self.at_limit, self.on_curve, self.at_upper) = (at_limit, curve, upper);
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
        numbers.back_emf * weights.damping * (R::one() + weights.extra_share(self.effective_inertia.rate(numbers.back_emf)))
    }

    /// Copies the active bounds of `other` in the lanes `lanes`.
    #[inline(always)]
    pub(super) fn copy_active_bounds(&mut self, other: &Self, lanes: R::Mask) {
        let new = |now: R::Mask, before: R::Mask| now.and(lanes).or(before.and_not(lanes));
        (self.at_limit, self.on_curve, self.at_upper) =
            (new(other.at_limit, self.at_limit), new(other.on_curve, self.on_curve), new(other.at_upper, self.at_upper));
    }

    /// Lanes in which a bound is active: a force limit or the torque-speed curve.
    #[inline(always)]
    pub(super) fn is_saturated(&self) -> R::Mask {
        self.at_limit.or(self.on_curve)
    }

    /// Explicit part of the force with the present active bound, N or N m, and its added inertia, kg or kg m^2.
    #[inline(always)]
    pub(super) fn force(&self, numbers: &ActuatorDynamics<R>, weights: ImplicitWeights<R>) -> (R, R) {
        let limit = R::select(self.at_upper, numbers.limits[1], numbers.limits[0]);
        let curve = R::select(self.at_upper, numbers.stall, -numbers.stall) - numbers.back_emf * self.before;
        let force = R::select(self.on_curve, curve, R::select(self.at_limit, limit, self.affine.0));
        let added_inertia = R::select(self.at_limit, R::zero(), self.affine.1);
        (force, R::select(self.on_curve, self.curve_added_inertia(numbers, weights), added_inertia))
    }
}

/// Finds the active bound of a force at a velocity: lanes at a force limit, lanes on the motor's torque-speed curve, and lanes at the upper
/// bound.
#[inline(always)]
fn active_bound<R: Real>(
    dynamics: &CompiledActuatorDynamics<R::Scalar>,
    numbers: &ActuatorDynamics<R>,
    force: R,
    velocity: R,
) -> [R::Mask; 3] {
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

/// Lanes in which a force limit or the torque-speed curve reduces the force at a velocity.
#[inline(always)]
pub(crate) fn exceeds_limits<R: Real>(
    dynamics: &CompiledActuatorDynamics<R::Scalar>,
    numbers: &ActuatorDynamics<R>,
    force: R,
    velocity: R,
) -> R::Mask {
    let [at_limit, curve, _] = active_bound(dynamics, numbers, force, velocity);
    at_limit.or(curve)
}

/// Force of an actuator, clamped to its limits and to the torque-speed curve of its motor.
#[inline(always)]
pub(crate) fn clamp_to_limits<R: Real>(
    dynamics: &CompiledActuatorDynamics<R::Scalar>,
    numbers: &ActuatorDynamics<R>,
    force: R,
    velocity: R,
) -> R {
    let [at_limit, curve, upper] = active_bound(dynamics, numbers, force, velocity);
    let limit = R::select(upper, numbers.limits[1], numbers.limits[0]);
    let edge = R::select(upper, numbers.stall, -numbers.stall) - numbers.back_emf * velocity;
    R::select(curve, edge, R::select(at_limit, limit, force))
}
