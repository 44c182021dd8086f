//! Stages 1 and 9 at the ends of a step: controls pass through actuator pipelines, and the new state becomes readings and observations.

use stepper_real::{Real, Scalar};

use crate::actuation::forces::ForceState;
use crate::compile::LaneModel;
use crate::dynamics::mocap;
use crate::integrators::devices::{Devices, SensorDevices};
use crate::integrators::workspace::Workspace;
use crate::options::StepSettings;
use crate::sensing::SensorInput;
use crate::sensing::errors::{Errors, Slots};
use crate::sensing::memory::Memory;
use crate::stages::s01_actuate::actuate;
use crate::stages::s09_sense::sense;

/// Before the forces of stage 1: the user's controls pass through the actuators' pipelines, which read the state before the step.
pub(crate) fn pass_controls<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    devices: &mut Devices<'_, R::Scalar>,
) {
    if let Some(actuators) = &mut devices.actuators {
        let (state, outputs) = ([&s.state.q[..], &s.state.v[..]], (&mut s.inputs.ctrl[..], &mut s.inputs.actuator_dynamics[..]));
        let (group, h) = (devices.group, options.timestep);
        actuators.pipelines.advance(compiled, group, &s.user_controls, state, s.alive, h, actuators.memory, outputs);
    }
}

/// After the step: the pipelines' outputs as they are at its end, for whoever reads the new state.
fn hold_outputs<R: Real>(compiled: &LaneModel<R>, s: &mut Workspace<R>, devices: &mut Devices<'_, R::Scalar>) {
    if let Some(actuators) = &mut devices.actuators {
        let outputs = (&mut s.inputs.ctrl[..], &mut s.inputs.actuator_dynamics[..]);
        actuators.pipelines.hold_outputs(compiled, devices.group, actuators.memory, outputs);
    }
}

/// Stage 9: takes up the acceleration of the step, reads the sensors of the new state where somebody asks for them, and lets the error
/// models of sensors observe the readings.
pub(crate) fn observe<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    devices: &mut Devices<'_, R::Scalar>,
) {
    hold_outputs(compiled, s, devices);
    take_acceleration(options, s);
    let Some(SensorDevices { errors, memory, read }) = &mut devices.sensors else { return };
    memory.step.iter_mut().for_each(|step| *step = step.wrapping_add(1));
    if *read || errors.is_some() {
        read_sensors(compiled, options, s);
    }
    if let Some(errors) = errors {
        apply_errors(errors, options, s, devices.group, memory, s.alive, false);
    }
}

/// Acceleration (v+ - v) / h of the step.
fn take_acceleration<R: Real>(options: &StepSettings, s: &mut Workspace<R>) {
    R::vectorize(
        #[inline(always)]
        || {
            let rate = R::one() / R::of(options.timestep);
            // The buffer of the next state has the velocity before the step.
            for ((a, &before), &after) in s.sensors.acceleration.iter_mut().zip(&s.velocity.v).zip(&s.state.v) {
                *a = (after - before) * rate;
            }
        },
    )
}

/// Forces of the actuators at the state and the controls in `s`, left in `s.sensors.actuator_forces`; `h` is the length of a step, s. Mocap
/// frames are placed by whoever calls.
pub(crate) fn read_actuator_forces<R: Real>(compiled: &LaneModel<R>, h: R, s: &mut Workspace<R>) {
    let (kinematics, forces) = (&mut s.evaluation.kinematics, &mut s.sensors.actuator_forces);
    if compiled.wrench_arms[1] > 0 {
        kinematics.update(compiled, &s.state.q);
        forces.transmit(compiled, kinematics, &s.state.v, R::zero());
    }
    let (state, inputs) = (&s.state, &s.inputs);
    actuate(compiled, &ForceState::state(&state.q, &state.v, &state.act, &inputs.ctrl, &inputs.actuator_dynamics), None, forces);
    if compiled.lossy {
        let dynamics = &s.inputs.actuator_dynamics;
        forces.dissipate(compiled, dynamics, false);
        forces.subtract_losses(compiled, dynamics, &s.velocity.scalar_impulse, h);
    }
}

/// True readings of the state in `s`, left in `s.sensors.workspace.truth`.
pub(crate) fn read_sensors<R: Real>(compiled: &LaneModel<R>, options: &StepSettings, s: &mut Workspace<R>) {
    let h = R::of(options.timestep);
    let elapsed = R::of(s.state.elapsed);
    mocap::pose_bodies(compiled, &s.inputs.mocap_trajectories, elapsed, &mut s.evaluation.kinematics);
    if compiled.sensing.needs.actuators {
        read_actuator_forces(compiled, h, s);
    }
    let (kinematics, sensors) = (&mut s.evaluation.kinematics, &mut s.sensors);
    if !sensors.workspace.orientation.is_empty() {
        for (m, trajectory) in compiled.mocap.iter().zip(&s.inputs.mocap_trajectories) {
            sensors.workspace.orientation[m.frame] = R::vectorize(
                #[inline(always)]
                || trajectory.quat_at(elapsed),
            );
        }
    }
    let mut time = R::zero();
    s.state.time.iter().enumerate().for_each(|(l, &t)| time.set_lane(l, Scalar::from_f64(t)));
    let input = SensorInput {
        q: &s.state.q,
        v: &s.state.v,
        time,
        h,
        acceleration: &sensors.acceleration,
        actuator_forces: &sensors.actuator_forces,
        xfrc: if compiled.sensing.needs.wrenches { &s.inputs.xfrc } else { &[] },
        scalar_impulse: &s.velocity.scalar_impulse,
        contacts: &s.state.contacts,
    };
    sense(compiled, kinematics, &mut sensors.workspace, &input);
}

/// Lets the error models of sensors observe the true readings in the lanes `lanes`; at the `start` of an episode they begin there.
pub(crate) fn apply_errors<R: Real>(
    errors: &Errors<R::Scalar>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    group: usize,
    memory: &mut Memory<R::Scalar>,
    lanes: R::Mask,
    start: bool,
) {
    let keys = memory.keys();
    let mut slots = Slots {
        numbers: &mut memory.numbers,
        cursors: &mut memory.cursors,
        faults: &mut memory.faults,
        observation: &mut memory.observation,
    };
    let work = s.sensors.error_work.get_or_insert_with(|| errors.work());
    errors.observe(group, &s.sensors.workspace.truth, &keys, lanes, start, options.timestep, work, &mut slots);
}
