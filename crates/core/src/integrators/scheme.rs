//! A scheme of integration as numbers: where in the step everything is taken. Each scheme has a file beside this one.

use stepper_real::{Mask, Real};

use crate::actuation::forces::ImplicitServos;
use crate::compile::LaneModel;
use crate::dynamics::implicit_weights::ImplicitWeights;

/// A scheme of integration, for one time step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scheme<R> {
    /// Time step, s.
    pub(crate) h: R,
    /// From the configuration before the step to that at which everything is taken, s.
    pub(crate) time_before: R,
    /// From there to the configuration after the step, s.
    pub(crate) time_after: R,
    /// From there to where springs and servos are taken, s; what lies beyond is in the mass matrix.
    pub(crate) time_ahead: R,
    /// Shares of damping and stiffness in the mass matrix.
    pub(crate) weights: ImplicitWeights<R>,
    /// Where velocity-dependent forces are taken, from 0 at the velocity before the step to 1 at that after it.
    pub(crate) velocity_weight: R,
    /// Whether everything is taken in the middle of the step, with impacts at their own time.
    pub(crate) in_the_middle: bool,
    /// Whether springs and servos are taken ahead of the rest.
    pub(crate) looks_ahead: bool,
    /// Whether springs and servos are implicit, and velocity-dependent forces are taken again at the velocity to be expected.
    pub(crate) corrects: bool,
}

impl<R: Real> Scheme<R> {
    /// The part of a gap that may close in a step: the next step is to meet the surface exactly in its middle, instead of beyond it. That
    /// is two thirds where the midpoint rule is taken at the beginning of a step; `impacts` are taken anywhere.
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

    /// How stage 1 takes servos. A scheme that does not correct takes those of actuator dynamics alone implicitly, as it does the joints'
    /// damping.
    pub(crate) fn servos(&self) -> Option<ImplicitServos<R>> {
        Some(ImplicitServos { weights: self.weights, all: self.corrects })
    }

    /// Shares of the joints' own damping and stiffness: a scheme that does not correct takes damping explicitly where the model asks for
    /// it.
    pub(crate) fn joints(&self, compiled: &LaneModel<R>) -> ImplicitWeights<R> {
        let explicit = compiled.explicit_damping && !self.corrects;
        ImplicitWeights { damping: if explicit { R::zero() } else { self.weights.damping }, ..self.weights }
    }

    /// The configuration at which springs and servos are taken.
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
