//! Affine forces of actuators, f = level + slope length + rate velocity, and their split into an explicit part and added inertia.

use stepper_real::{Mask, Real};

use crate::dynamics::implicit_weights::ImplicitWeights;
use crate::math::spatial::*;

/// Numbers of the part of an actuator's dynamics that acts within a step, per lane, on the actuator's side of its gear.
#[derive(Clone, Copy, Debug, Default)]
pub struct ActuatorDynamics<R> {
    /// Force of a continuous servo per unit of length, N or N m per unit.
    pub slope: R,
    /// Force of a continuous servo per unit of velocity.
    pub rate: R,
    /// Bounds of the effort, N or N m.
    pub limits: [R; 2],
    /// Stall torque of the motor, N or N m.
    pub stall: R,
    /// Torque that the motor loses to its back-EMF per unit of velocity.
    pub drag: R,
    /// Efficiency of the gear.
    pub efficiency: R,
    /// Dry friction, N or N m.
    pub friction: R,
}

/// Force as an affine function of length and velocity.
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
    /// Force at the motion.
    #[inline(always)]
    pub(crate) fn force(&self, motion: &Motion<R>) -> R {
        self.level + self.slope * motion.length + self.rate * motion.velocity
    }

    /// Explicit part of the force, N or N m, and the added inertia w that supplies the implicit part, kg or kg m^2.
    ///
    /// The whole force in the step is the explicit part minus w/h times the change of velocity. Stiffness and damping that oppose the
    /// motion are implicit, all else is explicit (see [`crate::actuation::forces`]).
    #[inline(always)]
    pub(crate) fn explicit_part_and_added_inertia(
        &self,
        motion: &Motion<R>,
        effective_inertia: EffectiveInertia<R>,
        weights: ImplicitWeights<R>,
    ) -> (R, R) {
        let (stiffness, damping) = ((-self.slope).max(R::zero()), (-self.rate).max(R::zero()));
        let share = weights.extra_share(effective_inertia.rate(damping));
        let spring_damping = weights.spring_damping(share, stiffness);
        let velocity = self.rate * motion.velocity + damping * (motion.velocity - motion.before) - spring_damping * motion.before;
        let added_inertia = damping * weights.damping * (R::one() + share) + stiffness * weights.stiffness + spring_damping * weights.step;
        (self.level + self.slope * motion.length + velocity, added_inertia)
    }
}

/// Effective inertia of an actuator: the inertia that it moves.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct EffectiveInertia<R> {
    /// Inverse of the inertia along the actuator's moment, 1/kg or 1/(kg m^2) over the square of its gear.
    pub(super) mobility: R,
    /// Rate at which joint damping slows the actuator down, 1/s.
    pub(super) slowing: R,
    /// Velocity that the impulses of constraints in the last step give to the actuator, without coupling of its joints.
    pub(super) pushed: R,
}

impl<R: Real> EffectiveInertia<R> {
    /// Sum with another dof. `slowing` is weighted by the mobilities.
    #[inline(always)]
    pub(super) fn with(self, arm: R, [inertia, impulse]: [R; 2], damping: R) -> Self {
        let inverse = inertia.recip();
        let part = arm.square() * inverse;
        Self {
            mobility: self.mobility + part,
            slowing: self.slowing + part * damping * inverse,
            pushed: self.pushed + arm * impulse * inverse,
        }
    }

    /// Rate of damping with that of the actuator.
    #[inline(always)]
    pub(crate) fn rate(self, damping: R) -> R {
        self.mobility * damping + self.slowing
    }
}

/// Number `x` clamped to a range. A NaN stays NaN, so that the acceptance of the step rejects it (`integrators/acceptance.rs`).
#[inline(always)]
pub(crate) fn within<R: Real>(x: R, range: Option<[R::Scalar; 2]>) -> R {
    match range {
        Some(range) => {
            let [lo, hi] = splat(range);
            R::select(x.eq(x), x.clamp(lo, hi), x)
        }
        None => x,
    }
}

/// Lanes in which `x` is outside its range, if it has one.
#[inline(always)]
pub(crate) fn exceeds_range<R: Real>(x: R, range: Option<[R::Scalar; 2]>) -> R::Mask {
    range.map_or(R::Mask::splat(false), |range| outside(x, range))
}

/// Lanes in which `x` is outside a range.
#[inline(always)]
pub(crate) fn outside<R: Real>(x: R, range: [R::Scalar; 2]) -> R::Mask {
    let [lo, hi] = splat(range);
    x.lt(lo).or(x.gt(hi))
}

/// Lanes in which `x` is at an end of a range or outside.
#[inline(always)]
pub(crate) fn reaches<R: Real>(x: R, range: [R::Scalar; 2]) -> R::Mask {
    let [lo, hi] = splat(range);
    x.le(lo).or(x.ge(hi))
}
