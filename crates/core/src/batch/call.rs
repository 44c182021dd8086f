//! Call of `step` or `rollout`: its arguments for each group of environments.

use std::ops::Range;

use stepper_real::Scalar;

use crate::actuation::ActuatorPipelines;
use crate::batch::inputs::StepInputs;
use crate::batch::randomization::ParameterOverrides;
use crate::compile::CompiledModel;
use crate::options::StepSettings;
use crate::sensing::errors::Errors;

/// Controls of a call, one after the other, and the number of steps with each; `step` has one control.
#[derive(Clone, Copy, Debug)]
pub struct Schedule {
    /// Number of controls.
    pub controls: usize,
    /// Number of steps with each control.
    pub nstep: usize,
}

impl Schedule {
    /// Number of steps of all controls together.
    pub fn steps(self) -> usize {
        self.controls.saturating_mul(self.nstep)
    }
}

/// Arguments of one call of `step` or `rollout` for all environments.
#[derive(Clone, Copy, Debug)]
pub struct Call<'a, S: Scalar> {
    /// Compiled model.
    pub compiled: &'a CompiledModel<S>,
    /// Settings of a step.
    pub settings: &'a StepSettings,
    /// Number of environments.
    pub num_envs: usize,
    /// Controls and steps.
    pub schedule: Schedule,
    /// Inputs of the user, environment-major. Controls are (controls, num_envs, nu), or (controls, nu) for all environments. An empty slice
    /// means zero controls, zero forces, or the mocap poses of the model.
    pub inputs: StepInputs<'a>,
    /// Steps of the call that this part makes.
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

/// Consecutive steps of a call. The parts of a call give the same bits as the whole.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// First step, counted over all controls.
    pub from: usize,
    /// End of the range: the first step after it.
    pub to: usize,
    /// Time of the call before these steps, s.
    pub elapsed: f64,
    /// Whether this is the last part.
    pub ends: bool,
}

impl Part {
    /// Range of all steps of a call with `steps` steps.
    pub fn whole(steps: usize) -> Self {
        Self { from: 0, to: steps, elapsed: 0.0, ends: true }
    }

    /// Range of controls with steps in this part; all controls if a control has no steps.
    pub(super) fn controls(&self, schedule: Schedule) -> Range<usize> {
        match schedule.nstep {
            0 => 0..schedule.controls,
            _ if self.from == self.to => 0..0,
            nstep => self.from / nstep..self.to.div_ceil(nstep),
        }
    }

    /// Range of the steps of a control in this part, counted from the control's first step.
    pub(super) fn steps_of(&self, control: usize, schedule: Schedule) -> Range<usize> {
        let before = control * schedule.nstep;
        self.from.saturating_sub(before)..(self.to - before).min(schedule.nstep)
    }
}
