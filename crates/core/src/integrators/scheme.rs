//! Integration scheme: the times in the step at which forces and constraint rows are evaluated. Each scheme has a file in this folder.

use stepper_real::{Mask, Real};

use crate::actuation::forces::ImplicitServos;
use crate::compile::LaneModel;
use crate::dynamics::implicit_weights::ImplicitWeights;

/// Integration scheme for one time step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scheme<R> {
    /// Time step, s.
    pub(crate) h: R,
    /// Time from the configuration before the step to the evaluation point, s.
    pub(crate) time_before: R,
    /// Time from the evaluation point to the configuration after the step, s.
    pub(crate) time_after: R,
    /// Time from the evaluation point to the time at which springs and servos are evaluated, s. The part of their force that depends on the
    /// velocity change is implicit, in the mass matrix.
    pub(crate) time_ahead: R,
    /// Weights of implicit damping and stiffness in the mass matrix.
    pub(crate) weights: ImplicitWeights<R>,
    /// Weight of the velocity after the step in the force velocity, at which velocity-dependent forces are evaluated. With 0 this is the
    /// velocity before the step, with 1 the velocity after it.
    pub(crate) velocity_weight: R,
    /// Whether the scheme evaluates forces and rows in the middle of the step, and impacts at their times.
    pub(crate) in_the_middle: bool,
    /// Whether springs and servos are evaluated at a later point than the other forces.
    pub(crate) looks_ahead: bool,
    /// Whether the mass matrix has implicit terms of joint springs, all servos and fluid drag. Otherwise it has only the implicit terms of
    /// joint damping and of the servos of actuator dynamics.
    pub(crate) implicit_forces: bool,
}

impl<R: Real> Scheme<R> {
    /// Whether the step predicts the velocity after it, and evaluates velocity-dependent forces with this prediction.
    ///
    /// The schemes with `implicit_forces` do so, and no others.
    pub(crate) fn predicts(&self) -> bool {
        self.implicit_forces
    }

    /// Fraction of a contact gap that may close in a step.
    ///
    /// The fraction is h / T, where T is the time from the evaluation point of this step to the evaluation point of the next step. A body
    /// that closes this fraction of its gap per time step h touches the surface exactly at the next evaluation point. T is normally h, so
    /// that the fraction is 1. In the lanes `at_start` T is 1.5 h, from the beginning of this step to the middle of the next. In the
    /// lanes `impacts` T is the rest of this step plus h / 2.
    #[inline(always)]
    pub(crate) fn closing_fraction(&self, at_start: R::Mask, impacts: R::Mask) -> R {
        let whole = R::select(at_start, R::of(2.0 / 3.0), R::one());
        if impacts.none() {
            return whole;
        }
        R::vectorize(
            #[inline(always)]
            || R::select(impacts, self.h / (self.time_after + self.h * R::of(0.5)), whole),
        )
    }

    /// Selection of the servos with implicit forces in stage 1: all servos with `implicit_forces`, otherwise only those of actuator
    /// dynamics. Explicit forces use the velocity before the step.
    pub(crate) fn implicit_servos(&self) -> ImplicitServos<R> {
        ImplicitServos { weights: self.weights, h: self.h, all: self.implicit_forces, predicted: false }
    }

    /// Same selection of servos as [`Scheme::implicit_servos`], for forces at the predicted velocity after the step. Explicit forces then
    /// use a velocity between the velocities before and after the step ([`Scheme::velocity_weight`]).
    pub(crate) fn implicit_servos_at_prediction(&self) -> ImplicitServos<R> {
        ImplicitServos { predicted: true, ..self.implicit_servos() }
    }

    /// Weights of joint damping and stiffness in the mass matrix. Without `implicit_forces`, models can select explicit damping, whose
    /// weight is 0.
    pub(crate) fn joint_weights(&self, compiled: &LaneModel<R>) -> ImplicitWeights<R> {
        let explicit = compiled.explicit_damping && !self.implicit_forces;
        ImplicitWeights { damping: if explicit { R::zero() } else { self.weights.damping }, ..self.weights }
    }

    /// Configuration at which springs and servos are evaluated. It is `ahead` if the scheme evaluates them later than the other forces,
    /// otherwise `here`.
    pub(crate) fn springs_at<'a>(&self, here: &'a [R], ahead: &'a [R]) -> &'a [R] {
        if self.looks_ahead { ahead } else { here }
    }

    /// Moves the evaluation point of the lanes `lanes` to `time` seconds after the beginning of the step.
    #[inline(always)]
    pub(crate) fn move_to(&mut self, time: R, lanes: R::Mask) {
        self.time_before = R::select(lanes, time, self.time_before);
        self.time_after = R::select(lanes, self.h - time, self.time_after);
    }
}
