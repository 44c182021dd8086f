//! Largest velocities of mechanisms, by which the step judges whether it resolves their motion.

use stepper_real::{Mask, Real};

use crate::tuning::{MIN_IMPACT_RATIO, MIN_VELOCITY_ERROR};

/// Largest velocities of a mechanism.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct MechanismMotion<R> {
    /// Largest joint rotation in a step, rad.
    pub(crate) turn: R,
    /// Speed of the fastest degree of freedom, m/s or rad/s.
    pub(crate) speed: R,
    /// Largest change of a degree of freedom's velocity, m/s or rad/s.
    pub(crate) change: R,
}

/// Largest velocities of a mechanism and of those in contact with it, in the search for impacts, m/s or rad/s.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Jump<R> {
    /// Error of the predicted velocity.
    pub(crate) error: R,
    /// Speed of the fastest degree of freedom.
    pub(crate) fastest: R,
    /// Change of a velocity by impulses.
    pub(crate) pushed: R,
    /// Change of a velocity by other forces.
    pub(crate) smooth: R,
    /// 1 in lanes with a contact, otherwise 0.
    pub(crate) touches: R,
}

impl<R: Real> Jump<R> {
    /// Larger of each velocity of two jumps.
    #[inline(always)]
    pub(crate) fn max(&self, other: &Self) -> Self {
        Self {
            error: self.error.max(other.error),
            fastest: self.fastest.max(other.fastest),
            pushed: self.pushed.max(other.pushed),
            smooth: self.smooth.max(other.smooth),
            touches: self.touches.max(other.touches),
        }
    }

    /// Raises each velocity to that of `most` in the lanes `lanes`. Returns the lanes in which any changed.
    #[inline(always)]
    pub(crate) fn raise(&mut self, most: &Self, lanes: R::Mask) -> R::Mask {
        let Self { error, fastest, pushed, smooth, touches } = self;
        let mut changed = R::Mask::splat(false);
        for (here, most) in
            [error, fastest, pushed, smooth, touches].into_iter().zip([most.error, most.fastest, most.pushed, most.smooth, most.touches])
        {
            let raised = lanes.and(most.gt(*here));
            changed = changed.or(raised);
            *here = R::select(raised, most, *here);
        }
        changed
    }

    /// Error of inertial forces that were evaluated at the mean of two velocities, divided by an inertia, 1/s^2.
    #[inline(always)]
    pub(crate) fn velocity_error(&self) -> R {
        (self.error * self.fastest).max(self.pushed * self.pushed * R::of(0.25))
    }

    /// Lanes in which impulses changed the velocity far more than other forces did.
    #[inline(always)]
    pub(crate) fn is_sudden(&self) -> R::Mask {
        self.pushed.gt(self.smooth * R::of(MIN_IMPACT_RATIO))
    }

    /// Lanes in which the error of inertial forces changes the velocity noticeably in a step of `h` seconds.
    #[inline(always)]
    pub(crate) fn matters(&self, h: R) -> R::Mask {
        (h * self.velocity_error()).gt(R::of(MIN_VELOCITY_ERROR))
    }
}
