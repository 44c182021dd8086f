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
    /// Time from the evaluation point to the point at which springs and servos are evaluated, s. The change of their force with the
    /// velocity is implicit, in the mass matrix.
    pub(crate) time_ahead: R,
    /// Weights of implicit damping and stiffness in the mass matrix.
    pub(crate) weights: ImplicitWeights<R>,
    /// Velocity at which velocity-dependent forces are evaluated, as a weight: 0 is the velocity before the step, 1 the velocity after it.
    pub(crate) velocity_weight: R,
    /// Whether the scheme evaluates forces and rows in the middle of the step, and impacts at their times.
    pub(crate) in_the_middle: bool,
    /// Whether springs and servos are evaluated at a later point than the other forces.
    pub(crate) looks_ahead: bool,
    /// Whether the mass matrix has implicit terms of joint springs, all servos and fluid drag. Otherwise it has only those of joint damping
    /// and of the servos of actuator dynamics.
    pub(crate) implicit_forces: bool,
}

impl<R: Real> Scheme<R> {
    /// Whether the step predicts the velocity after it, and evaluates velocity-dependent forces with this prediction.
    ///
    /// Exactly the schemes with `implicit_forces` do so.
    pub(crate) fn predicts(&self) -> bool {
        self.implicit_forces
    }

    /// Fraction of a contact gap that may close in a step.
    ///
    /// It is the time step divided by the time from the rows' evaluation to that of the next step. A body then meets the surface there and
    /// not before. The fraction is two thirds if the midpoint rule evaluates this step at its beginning and the next one in its middle. The
    /// lanes `impacts` are evaluated at the time of an impact instead.
    #[inline(always)]
    pub(crate) fn closing_fraction(&self, at_beginning: R::Mask, impacts: R::Mask) -> R {
        let whole = R::select(at_beginning, R::of(2.0 / 3.0), R::one());
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

    /// Selection of [`Scheme::implicit_servos`], after the velocity after the step was predicted. Explicit forces then use a velocity
    /// between that before and that after the step ([`Scheme::velocity_weight`]).
    pub(crate) fn implicit_servos_at_prediction(&self) -> ImplicitServos<R> {
        ImplicitServos { predicted: true, ..self.implicit_servos() }
    }

    /// Weights of implicit joint damping and stiffness. Without `implicit_forces`, damping is explicit in models that select it.
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
