//! Mode of an actuator's dynamics: free, at a limit of its effort, or on the torque-speed curve of its motor.

use stepper_real::{Mask, Real};

use crate::actuation::affine_force::{ActuatorDynamics, EffectiveInertia};
use crate::compile::CompiledActuatorDynamics;
use crate::dynamics::implicit_weights::ImplicitWeights;

/// Force limits of an actuator within a step: the affine force of its control, clamped to its effort and to the curve of its motor.
///
/// The force is `f = clamp(clamp(affine, limits), +-stall - drag v)`. It is piecewise affine in the motion, and decreasing where the
/// affine force opposes the motion. The step treats one piece implicitly. Semismooth Newton finds it: solve with the present piece, then
/// go to the piece in which the solution lies (Qi & Sun 1993).
#[derive(Clone, Copy, Debug)]
pub(super) struct Region<R: Real> {
    /// Affine force without bounds, and its added inertia.
    affine: (R, R),
    /// Velocity before the step.
    before: R,
    /// Effective inertia that the actuator moves.
    effective_inertia: EffectiveInertia<R>,
    /// Lanes at a limit of the effort.
    held: R::Mask,
    /// Lanes on the curve of the motor.
    curve: R::Mask,
    /// Lanes at an upper bound.
    upper: R::Mask,
}

impl<R: Real> Default for Region<R> {
    fn default() -> Self {
        let never = R::Mask::splat(false);
        let effective_inertia = EffectiveInertia::default();
        Self { affine: (R::zero(), R::zero()), before: R::zero(), effective_inertia, held: never, curve: never, upper: never }
    }
}

impl<R: Real> Region<R> {
    /// Stores the affine force with its added inertia, the velocity before the step, and the effective inertia.
    #[inline(always)]
    pub(super) fn take(&mut self, affine: (R, R), before: R, effective_inertia: EffectiveInertia<R>) {
        (self.affine, self.before, self.effective_inertia) = (affine, before, effective_inertia);
    }

    /// Initial modes of a step. A force without stiffness has the mode at the velocity before the step; one with stiffness is free.
    #[inline(always)]
    pub(super) fn guess(&mut self, compiled: &CompiledActuatorDynamics<R::Scalar>, numbers: &ActuatorDynamics<R>) {
        let never = R::Mask::splat(false);
        (self.held, self.curve, self.upper) = (never, never, never);
        let plain = self.affine.1.eq(R::zero());
        let [held, curve, upper] = modes(compiled, numbers, self.affine.0, self.before);
        (self.held, self.curve, self.upper) = (held.and(plain), curve.and(plain), upper.and(plain));
    }

    /// Moves each lane to the piece in which the affine force lies at a change of velocity `along` h. Returns the lanes that moved.
    #[inline(always)]
    pub(super) fn place(
        &mut self,
        compiled: &CompiledActuatorDynamics<R::Scalar>,
        numbers: &ActuatorDynamics<R>,
        weights: ImplicitWeights<R>,
        along: R,
    ) -> R::Mask {
        let [held, curve, upper] = modes(compiled, numbers, self.affine.0 - self.affine.1 * along, self.before + weights.damping * along);
        let same = |a: R::Mask, b: R::Mask| a.and(b).or(a.or(b).not());
        let moved = same(held, self.held).and(same(curve, self.curve)).and(same(upper, self.upper)).not();
        (self.held, self.curve, self.upper) = (held, curve, upper);
        moved
    }

    /// Largest inertia that a piece adds to the mass matrix.
    #[inline(always)]
    pub(super) fn most_weight(&self, numbers: &ActuatorDynamics<R>, weights: ImplicitWeights<R>) -> R {
        self.affine.1.max(self.curve_weight(numbers, weights))
    }

    /// Inertia that the torque-speed curve adds to the mass matrix.
    #[inline(always)]
    fn curve_weight(&self, numbers: &ActuatorDynamics<R>, weights: ImplicitWeights<R>) -> R {
        numbers.drag * weights.damping * (R::one() + weights.share(self.effective_inertia.rate(numbers.drag)))
    }

    /// Takes the modes of another region in the lanes `lanes`.
    #[inline(always)]
    pub(super) fn replace(&mut self, other: &Self, lanes: R::Mask) {
        let new = |now: R::Mask, before: R::Mask| now.and(lanes).or(before.and_not(lanes));
        (self.held, self.curve, self.upper) = (new(other.held, self.held), new(other.curve, self.curve), new(other.upper, self.upper));
    }

    /// Lanes at a bound.
    #[inline(always)]
    pub(super) fn is_cut(&self) -> R::Mask {
        self.held.or(self.curve)
    }

    /// Explicit force on the present piece, and the inertia that its implicit part adds to the mass matrix.
    #[inline(always)]
    pub(super) fn force(&self, numbers: &ActuatorDynamics<R>, weights: ImplicitWeights<R>) -> (R, R) {
        let held = R::select(self.upper, numbers.limits[1], numbers.limits[0]);
        let curve = R::select(self.upper, numbers.stall, -numbers.stall) - numbers.drag * self.before;
        let force = R::select(self.curve, curve, R::select(self.held, held, self.affine.0));
        let weight = R::select(self.held, R::zero(), self.affine.1);
        (force, R::select(self.curve, self.curve_weight(numbers, weights), weight))
    }
}

/// Modes of an unbounded force at a velocity: lanes at a limit, lanes on the curve of the motor, and lanes at the upper bound.
#[inline(always)]
fn modes<R: Real>(compiled: &CompiledActuatorDynamics<R::Scalar>, numbers: &ActuatorDynamics<R>, force: R, velocity: R) -> [R::Mask; 3] {
    let never = R::Mask::splat(false);
    let ([low, high], mut asked) = (numbers.limits, force);
    let (mut held, mut upper) = (never, never);
    if compiled.limited {
        upper = force.gt(high);
        held = force.lt(low).or(upper);
        asked = R::select(held, force.clamp(low, high), force);
    }
    let mut curve = never;
    if compiled.motor.is_some() {
        let loss = numbers.drag * velocity;
        let (above, below) = (asked.gt(numbers.stall - loss), asked.lt(-numbers.stall - loss));
        curve = above.or(below);
        upper = upper.and_not(curve).or(above);
        held = held.and_not(curve);
    }
    [held, curve, upper]
}

/// Lanes in which a limit reduces the force at a velocity.
#[inline(always)]
pub(crate) fn exceeds<R: Real>(
    compiled: &CompiledActuatorDynamics<R::Scalar>,
    numbers: &ActuatorDynamics<R>,
    force: R,
    velocity: R,
) -> R::Mask {
    let [held, curve, _] = modes(compiled, numbers, force, velocity);
    held.or(curve)
}

/// Force of an actuator clamped to its limits and to the torque-speed curve of its motor.
#[inline(always)]
pub(crate) fn bounded<R: Real>(compiled: &CompiledActuatorDynamics<R::Scalar>, numbers: &ActuatorDynamics<R>, force: R, velocity: R) -> R {
    let [held, curve, upper] = modes(compiled, numbers, force, velocity);
    let limit = R::select(upper, numbers.limits[1], numbers.limits[0]);
    let edge = R::select(upper, numbers.stall, -numbers.stall) - numbers.drag * velocity;
    R::select(curve, edge, R::select(held, limit, force))
}
