//! One call of `step` or `rollout`, as every group needs to know it.

use std::ops::Range;

use stepper_real::Scalar;

use crate::actuation::ActuatorPipelines;
use crate::batch::inputs::StepInputs;
use crate::batch::randomization::ParameterOverrides;
use crate::compile::CompiledModel;
use crate::options::StepSettings;
use crate::sensing::errors::Errors;

/// Controls of a call, one after the other, and the steps that each is held; `step` has one control.
#[derive(Clone, Copy, Debug)]
pub struct Schedule {
    /// Number of controls.
    pub controls: usize,
    /// Steps to make with each.
    pub nstep: usize,
}

impl Schedule {
    /// Steps of all controls together.
    pub fn steps(self) -> usize {
        self.controls.saturating_mul(self.nstep)
    }
}

/// One call of `step` or `rollout` for all environments: what every group needs to know.
#[derive(Clone, Copy, Debug)]
pub struct Call<'a, S: Scalar> {
    /// The compiled model.
    pub compiled: &'a CompiledModel<S>,
    /// Settings.
    pub settings: &'a StepSettings,
    /// Number of environments.
    pub num_envs: usize,
    /// Controls and steps.
    pub schedule: Schedule,
    /// What the user says, environment-major. Controls are (controls, num_envs, nu), or (controls, nu) for all; an empty slice is no
    /// control, no force, or the model's poses.
    pub inputs: StepInputs<'a>,
    /// The steps of the call that are made now.
    pub part: Part,
    /// What sensors that are not ideal make of the truth.
    pub sensor_errors: Option<&'a Errors<S>>,
    /// Parameters that environments have of their own.
    pub overrides: &'a ParameterOverrides<S>,
    /// Actuator dynamics between controls and forces.
    pub pipelines: Option<&'a ActuatorPipelines<S>>,
}

/// Which readings are asked for.
#[derive(Debug)]
pub struct Query<'a> {
    /// Those of ideal sensors.
    pub truth: bool,
    /// Where they go: a row for every environment of the group.
    pub out: &'a mut [f64],
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
    pub(super) fn controls(&self, schedule: Schedule) -> Range<usize> {
        match schedule.nstep {
            0 => 0..schedule.controls,
            _ if self.from == self.to => 0..0,
            nstep => self.from / nstep..self.to.div_ceil(nstep),
        }
    }

    /// The steps of it that a control has, as places among the control's own.
    pub(super) fn steps_of(&self, control: usize, schedule: Schedule) -> Range<usize> {
        let before = control * schedule.nstep;
        self.from.saturating_sub(before)..(self.to - before).min(schedule.nstep)
    }
}
