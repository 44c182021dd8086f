//! One call of `step` or `rollout`, as every group needs to know it.

use std::ops::Range;

use stepper_real::Scalar;

use crate::actuation::ActuatorPipelines;
use crate::batch::randomization::Own;
use crate::compile::CompiledModel;
use crate::options::StepSettings;
use crate::sensing::errors::Errors;

/// One call of `step` or `rollout` for all environments: what every group needs to know. Arrays are environment-major.
#[derive(Clone, Copy, Debug)]
pub struct Call<'a, S: Scalar> {
    /// The compiled model.
    pub compiled: &'a CompiledModel<S>,
    /// Settings.
    pub options: &'a StepSettings,
    /// Number of environments.
    pub num_envs: usize,
    /// Controls, one after the other; `step` has one.
    pub calls: usize,
    /// Steps to make with each control.
    pub nstep: usize,
    /// (calls, num_envs, nu), or (calls, nu) for all, or empty for zero.
    pub ctrl: &'a [f64],
    /// (num_envs, nv), or empty for none.
    pub qfrc: &'a [f64],
    /// (num_envs, nbody, 6), or empty for none.
    pub xfrc: &'a [f64],
    /// (num_envs, nmocap, 3) and (num_envs, nmocap, 4), or empty for the model's.
    pub mocap: [&'a [f64]; 2],
    /// The steps of the call that are made now.
    pub part: Part,
    /// What sensors that are not ideal make of the truth.
    pub errors: Option<&'a Errors<S>>,
    /// Parameters that environments have of their own.
    pub own: &'a Own<S>,
    /// Drive trains of the actuators.
    pub chains: Option<&'a ActuatorPipelines<S>>,
}

impl<S: Scalar> Call<'_, S> {
    /// Steps of all controls together.
    pub(super) fn steps(&self) -> usize {
        self.calls.saturating_mul(self.nstep)
    }
}

/// Some steps of a call, which follow one another. The parts of a call make the bits of the whole.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// The first of them, counted over all controls.
    pub from: usize,
    /// The first after them.
    pub to: usize,
    /// Time of the call before them, s.
    pub elapsed: f64,
    /// Whether no other part follows.
    pub ends: bool,
}

impl Part {
    /// All of so many steps.
    pub fn whole(steps: usize) -> Self {
        Self { from: 0, to: steps, elapsed: 0.0, ends: true }
    }

    /// The controls that have steps of it, all of them where a control has no step.
    pub(super) fn controls(&self, calls: usize, nstep: usize) -> Range<usize> {
        match nstep {
            0 => 0..calls,
            _ if self.from == self.to => 0..0,
            _ => self.from / nstep..self.to.div_ceil(nstep),
        }
    }

    /// The steps of it that a control has, as places among the control's own.
    pub(super) fn steps_of(&self, control: usize, nstep: usize) -> Range<usize> {
        let before = control * nstep;
        self.from.saturating_sub(before)..(self.to - before).min(nstep)
    }
}
