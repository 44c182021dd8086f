//! Arguments of a call of `step` or `rollout`, as a worker reads them for a group of environments.

use std::ops::Range;

use stepper_real::Scalar;

use crate::actuation::ActuatorPipelines;
use crate::batch::inputs::StepInputs;
use crate::batch::parameter_overrides::ParameterOverrides;
use crate::compile::CompiledModel;
use crate::options::StepSettings;
use crate::sensing::errors::Errors;

/// Number of controls of a call, and number of steps with each control. A call of `step` has one control.
#[derive(Clone, Copy, Debug)]
pub struct Schedule {
    /// Number of controls, which are applied one after the other.
    pub controls: usize,
    /// Number of steps with each control.
    pub nstep: usize,
}

impl Schedule {
    /// Total number of steps of the call: controls times steps per control.
    pub fn steps(self) -> usize {
        self.controls.saturating_mul(self.nstep)
    }
}

/// Arguments of one call of `step` or `rollout` for all environments. Calls that only read, such as sensor readings, have zero steps.
#[derive(Clone, Copy, Debug)]
pub struct Call<'a, S: Scalar> {
    /// Compiled model.
    pub compiled: &'a CompiledModel<S>,
    /// Step settings, such as time step and solver options.
    pub settings: &'a StepSettings,
    /// Number of environments.
    pub num_envs: usize,
    /// Controls of the call, and number of steps with each.
    pub schedule: Schedule,
    /// Inputs of the user, environment-major. Controls are (controls, num_envs, nu), or (controls, nu) to share them among all
    /// environments. Inputs that the user left out are already filled in (`AppliedInputs::complete`). A slice that is still empty means
    /// zero controls, zero forces, the model's mocap poses and active equalities, or a mask of all environments.
    pub inputs: StepInputs<'a>,
    /// Range of the steps that this part of the call makes.
    pub part: Part,
    /// Error models of the sensors; `None` if all sensors are ideal.
    pub sensor_errors: Option<&'a Errors<S>>,
    /// Per-environment parameter overrides.
    pub overrides: &'a ParameterOverrides<S>,
    /// Actuator pipelines (delay, servo, lag) of all actuators; `None` if no actuator has an actuator model.
    pub pipelines: Option<&'a ActuatorPipelines<S>>,
}

/// Part of a call: a range of its steps. A call that is made in parts gives the same bits as the whole.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// Index of the first step of this part of the call. Step 0 is the first step of the whole call.
    pub from: usize,
    /// Index of the first step after this part of the call. Step 0 is the first step of the whole call.
    pub to: usize,
    /// Simulated time from the start of the call to the start of this part, s.
    pub elapsed: f64,
    /// Whether this is the last part of the call.
    pub ends: bool,
}

impl Part {
    /// Part that contains all `steps` steps of a call.
    pub fn whole(steps: usize) -> Self {
        Self { from: 0, to: steps, elapsed: 0.0, ends: true }
    }

    /// Range of the indices of the controls that are in force in the steps of this part. If the schedule has zero steps per control, the
    /// range contains all controls.
    pub(super) fn controls(&self, schedule: Schedule) -> Range<usize> {
        match schedule.nstep {
            0 => 0..schedule.controls,
            _ if self.from == self.to => 0..0,
            nstep => self.from / nstep..self.to.div_ceil(nstep),
        }
    }

    /// Range of those steps of this part that use the control with index `control`. Step 0 is the first step with this control.
    pub(super) fn steps_of(&self, control: usize, schedule: Schedule) -> Range<usize> {
        let before = control * schedule.nstep;
        self.from.saturating_sub(before)..(self.to - before).min(schedule.nstep)
    }
}
