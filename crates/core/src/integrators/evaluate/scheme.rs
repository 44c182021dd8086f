//! Integration scheme: the times in the step at which forces and constraint rows are evaluated.
//!
//! * Euler's rule, semi-implicit: forces and constraint rows at the configuration before the step, then q+ = q (+) h v+. First order. Some
//!   forces are implicit: damping of joints (unless the model makes it explicit), servos of actuator dynamics, and springs and dampers of
//!   tendons, soft equalities and soft surfaces. All other forces use the velocity before the step, as in MuJoCo's `Euler`.
//! * Moreau's midpoint rule: forces and constraint rows at q_mid = q (+) h/2 v, then q+ = q_mid (+) h/2 v+ (Moreau 1988). Second order in
//!   free flight and between impacts, which are evaluated at their times (`impact.rs`). Springs, dampers and servos follow the implicit
//!   midpoint rule, which is A-stable and keeps the energy of linear springs ([`crate::actuation::forces`]).
//! * Implicit rule: Euler's rule with springs, dampers and servos at the end of the step. Other velocity-dependent forces use the predicted
//!   velocity after the step. First order, and L-stable in springs and dampers (backward Euler): it dissipates the energy of motions that
//!   it cannot resolve.

use stepper_real::Real;

use crate::actuation::forces::ImplicitServos;
use crate::compile::LaneModel;
use crate::dynamics::implicit_weights::ImplicitWeights;
use crate::options::{Integrator, StepSettings};

/// Integration scheme for one time step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scheme<R> {
    /// Time step, s.
    pub(crate) h: R,
    /// Time from the configuration before the step to the evaluation point, s. Single mechanisms may have another evaluation point
    /// (`EvaluationTimes`).
    pub(crate) time_before: R,
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
    /// Whether the mass matrix has the implicit terms of joint damping, joint springs, all servos and fluid drag. Otherwise it has only
    /// those of joint damping and of the servos of actuator dynamics.
    ///
    /// A step with these terms predicts the velocity after it, and evaluates velocity-dependent forces with this prediction.
    pub(crate) implicit_forces: bool,
}

impl<R: Real> Scheme<R> {
    /// Integration scheme of the integrator that the options select, for hard contact and a step or substep of `h` seconds.
    ///
    /// `Rk4` counts as `Midpoint` here. Lanes without constraints get the result of the Runge-Kutta method later in the step.
    /// `ImplicitFast`, which the options allow only with MuJoCo's law, counts as `Implicit` here.
    #[inline(always)]
    pub(crate) fn new(options: &StepSettings, h: R) -> Self {
        let (none, half) = (R::zero(), h * R::of(0.5));
        let euler = Self {
            h,
            time_before: none,
            time_ahead: none,
            weights: ImplicitWeights { damping: h, stiffness: none, late_step: none },
            velocity_weight: none,
            in_the_middle: false,
            implicit_forces: false,
        };
        match options.integrator {
            Integrator::Euler => euler,
            Integrator::Midpoint | Integrator::Rk4 => Self {
                time_before: half,
                weights: ImplicitWeights { damping: half, stiffness: half * half, late_step: h },
                velocity_weight: R::of(0.5),
                in_the_middle: true,
                implicit_forces: true,
                ..euler
            },
            Integrator::Implicit | Integrator::ImplicitFast => Self {
                time_ahead: h,
                weights: ImplicitWeights { damping: h, stiffness: h * h, late_step: none },
                velocity_weight: R::one(),
                implicit_forces: true,
                ..euler
            },
        }
    }

    /// Factor 1 / (2^p - 1) of an extrapolation from a step and two steps of half its length, for the order p of the rule.
    pub(crate) fn extrapolation(&self) -> f64 {
        if self.in_the_middle { 1.0 / 3.0 } else { 1.0 }
    }

    /// Selection of the servos with implicit forces in stage 1: all servos if the field `implicit_forces` is true, otherwise only those of
    /// actuator dynamics. Explicit forces use the velocity before the step.
    pub(crate) fn implicit_servos(&self) -> ImplicitServos<R> {
        ImplicitServos { weights: self.weights, h: self.h, all: self.implicit_forces, predicted: false }
    }

    /// Selection of servos as in [`Scheme::implicit_servos`], for forces at the predicted velocity after the step. Explicit forces then use
    /// the force velocity ([`Scheme::velocity_weight`]).
    pub(crate) fn implicit_servos_at_prediction(&self) -> ImplicitServos<R> {
        ImplicitServos { predicted: true, ..self.implicit_servos() }
    }

    /// Weights of joint damping and stiffness in the mass matrix. Without `implicit_forces`, models can select explicit damping, whose
    /// weight is 0.
    pub(crate) fn joint_weights(&self, compiled: &LaneModel<R>) -> ImplicitWeights<R> {
        let explicit = compiled.explicit_damping && !self.implicit_forces;
        ImplicitWeights { damping: if explicit { R::zero() } else { self.weights.damping }, ..self.weights }
    }

    /// Whether springs and servos are evaluated at a later point than the other forces.
    pub(crate) fn looks_ahead(&self) -> bool {
        self.implicit_forces && !self.in_the_middle
    }
}
