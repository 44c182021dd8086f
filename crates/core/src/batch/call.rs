//! Call of `step` or `rollout`: its arguments for each group of environments.

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

/// Arguments of one call of `step` or `rollout` for all environments.
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
    /// Inputs of the user, environment-major. Controls are (controls, num_envs, nu), or (controls, nu) for all environments. An empty slice
    /// means zero controls, zero forces, or the mocap poses of the model.
    pub inputs: StepInputs<'a>,
    /// The steps of the call that are made now.
    pub part: Part,
    /// Error models of the sensors; none where all sensors are ideal.
    pub sensor_errors: Option<&'a Errors<S>>,
    /// Per-environment parameter overrides.
    pub overrides: &'a ParameterOverrides<S>,
    /// Actuator dynamics between controls and forces.
    pub pipelines: Option<&'a ActuatorPipelines<S>>,
}

/// Query for readings of some environments.
#[derive(Debug)]
pub struct Query<'a> {
    /// True readings of ideal sensors.
    pub truth: bool,
    /// Output array: a row for every environment of the group.
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
    /// Range of all steps of a call with `steps` steps.
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
