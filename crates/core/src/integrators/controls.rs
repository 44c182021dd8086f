//! Actuator pipelines (delay, lag ...), which convert the user's controls before a step (part of stage 1).

use stepper_real::Real;

use crate::compile::LaneModel;
use crate::integrators::devices::Devices;
use crate::integrators::inputs::Inputs;
use crate::integrators::state::State;
use crate::options::StepSettings;

/// Runs the actuator pipelines (delay, lag ...), the first part of stage 1. From the user's controls and the state before the step they
/// compute the controls of the step, `inputs.ctrl`.
pub(crate) fn run_actuator_pipelines<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    state: &State<R>,
    user_controls: &[R],
    inputs: &mut Inputs<R>,
    alive: R::Mask,
    devices: &mut Devices<'_, R::Scalar>,
) {
    if let Some(actuators) = &mut devices.actuators {
        let (state, outputs) = ([&state.q[..], &state.v[..]], (&mut inputs.ctrl[..], &mut inputs.actuator_dynamics[..]));
        let (group, h) = (devices.group, options.timestep);
        actuators.pipelines.advance(compiled, group, user_controls, state, alive, h, actuators.memory, outputs);
    }
}

/// Sets `inputs` to the outputs of the actuator pipelines at the end of the step. Sensors and derived quantities of the new state read
/// them.
pub(crate) fn write_outputs_after_step<R: Real>(compiled: &LaneModel<R>, inputs: &mut Inputs<R>, devices: &mut Devices<'_, R::Scalar>) {
    if let Some(actuators) = &mut devices.actuators {
        let outputs = (&mut inputs.ctrl[..], &mut inputs.actuator_dynamics[..]);
        actuators.pipelines.write_outputs_after_step(compiled, devices.group, actuators.memory, outputs);
    }
}
