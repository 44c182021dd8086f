//! Affine forces of actuators, f = level + slope * length + rate * velocity. An implicit force is split into an explicit part and an added
//! inertia, which the mass matrix contains.

use stepper_real::{Mask, Real};

use crate::dynamics::implicit_weights::ImplicitWeights;
use crate::math::spatial::*;

/// Parameters of an actuator's dynamics, the part of the actuator model that acts within a step, per lane. Forces and lengths are those of
/// the actuator, as MuJoCo's `actuator_force` and `actuator_length`; the joint force is the actuator's force times `gear`.
#[derive(Clone, Copy, Debug, Default)]
pub struct ActuatorDynamics<R> {
    /// Factor of the length in the effort of a continuous servo. The effort is a force (N or N m), or a fraction of the motor's voltage.
    pub slope: R,
    /// Factor of the velocity in the effort of a continuous servo.
    pub rate: R,
    /// Lowest and highest force of the actuator, N or N m.
    pub limits: [R; 2],
    /// Stall torque of the motor after its gear, N or N m.
    pub stall: R,
    /// Torque after the gear that the motor loses to its back-EMF per unit of velocity, N s or N m s per unit of length.
    pub back_emf: R,
    /// Efficiency of the gear, from 0 to 1.
    pub efficiency: R,
    /// Dry friction of the gear, N or N m.
    pub friction: R,
    /// Additional dry friction of the gear at rest, N or N m.
    pub stribeck_friction: R,
    /// Speed at which the additional dry friction has decreased to 1/e, in units of the actuator's velocity.
    pub stribeck_velocity: R,
}

/// Force of an actuator as an affine function: level + slope * length + rate * velocity.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AffineForce<R> {
    pub(crate) level: R,
    pub(crate) slope: R,
    pub(crate) rate: R,
}

/// Motion of an actuator: its length, the velocity at which explicit terms are evaluated, and the velocity before the step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion<R> {
    pub(crate) length: R,
    pub(crate) velocity: R,
    pub(crate) before: R,
}

impl<R: Real> AffineForce<R> {
    /// Force at the length and velocity of `motion`.
    #[inline(always)]
    pub(crate) fn force(&self, motion: &Motion<R>) -> R {
        self.level + self.slope * motion.length + self.rate * motion.velocity
    }

    /// Splits the force into an explicit part, N or N m, and an added inertia b, kg or kg m^2, which supplies the implicit part.
    ///
    /// The whole force in the step is the explicit part minus b/h times the change of velocity. Stiffness and damping that oppose the
    /// motion are implicit, everything else is explicit (see [`crate::actuation::forces`]).
    #[inline(always)]
    pub(crate) fn explicit_part_and_added_inertia(
        &self,
        motion: &Motion<R>,
        effective_inertia: EffectiveInertia<R>,
        weights: ImplicitWeights<R>,
    ) -> (R, R) {
        let (stiffness, damping) = ((-self.slope).max(R::zero()), (-self.rate).max(R::zero()));
        let late = weights.late_fraction(effective_inertia.rate(damping));
        let spring_damping = weights.spring_damping(late, stiffness);
        // Damping that opposes the motion acts on the velocity before the step, because the added inertia supplies the damping of the
        // change. A negative damping (`rate` above zero) is explicit: it acts on `motion.velocity`.
        let viscous = self.rate * motion.velocity + damping * (motion.velocity - motion.before) - spring_damping * motion.before;
        let added_inertia =
            damping * weights.damping * (R::one() + late) + stiffness * weights.stiffness + spring_damping * weights.late_step;
        (self.level + self.slope * motion.length + viscous, added_inertia)
    }
}

/// Inertia that an actuator moves, stored as its inverse (mobility), with other properties of the joints that the actuator drives. The
/// mobilities of several degrees of freedom add up.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct EffectiveInertia<R> {
    /// Mobility: inverse of the inertia along the actuator's moment, 1/kg or 1/(kg m^2). Moment arms include the actuator's `gear`.
    pub(super) mobility: R,
    /// Rate at which joint damping slows the actuator down, 1/s: damping of the joint divided by its inertia.
    pub(super) damping_rate: R,
    /// Estimated change of the actuator's velocity by the constraint impulses of the last step. The estimate neglects the coupling of
    /// joints.
    pub(super) change_by_impulses: R,
}

impl<R: Real> EffectiveInertia<R> {
    /// Adds one degree of freedom: `arm` is its moment arm, `inertia` its inertia, `damping` its damping, and `impulse` the constraint
    /// impulse on it.
    ///
    /// In the result, `damping_rate` is a sum, weighted by mobilities. The caller divides it by the total mobility to get a mean.
    #[inline(always)]
    pub(super) fn with(self, arm: R, [inertia, impulse]: [R; 2], damping: R) -> Self {
        let inverse = inertia.recip();
        let part = arm.square() * inverse;
        Self {
            mobility: self.mobility + part,
            damping_rate: self.damping_rate + part * damping * inverse,
            change_by_impulses: self.change_by_impulses + arm * impulse * inverse,
        }
    }

    /// Rate at which damping slows the actuator down, 1/s. It includes the damping of the joints, and `damping`, the damping of the
    /// actuator.
    #[inline(always)]
    pub(crate) fn rate(self, damping: R) -> R {
        self.mobility * damping + self.damping_rate
    }
}

/// Number `x`, clamped to a range if there is one. A NaN stays NaN, so that the acceptance of the step rejects it
/// (`integrators/acceptance.rs`).
#[inline(always)]
pub(crate) fn within<R: Real>(x: R, range: Option<[R::Scalar; 2]>) -> R {
    match range {
        Some(range) => bounded(x, splat(range)),
        None => x,
    }
}

/// Number `x`, clamped to a range. A NaN stays NaN.
#[inline(always)]
pub(crate) fn bounded<R: Real>(x: R, [low, high]: [R; 2]) -> R {
    R::select(x.eq(x), x.clamp(low, high), x)
}

/// Lanes in which `x` is outside its range; no lanes if there is no range.
#[inline(always)]
pub(crate) fn exceeds_range<R: Real>(x: R, range: Option<[R::Scalar; 2]>) -> R::Mask {
    match range {
        Some(range) => outside(x, range),
        None => R::Mask::splat(false),
    }
}

/// Lanes in which `x` is below the lower or above the upper end of the range. A number at an end is not outside.
#[inline(always)]
pub(crate) fn outside<R: Real>(x: R, range: [R::Scalar; 2]) -> R::Mask {
    let [lo, hi] = splat(range);
    x.lt(lo).or(x.gt(hi))
}

/// Lanes in which `x` is at an end of the range, or outside of it.
#[inline(always)]
pub(crate) fn reaches<R: Real>(x: R, range: [R::Scalar; 2]) -> R::Mask {
    let [lo, hi] = splat(range);
    x.le(lo).or(x.ge(hi))
}
