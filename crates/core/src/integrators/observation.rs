//! Sensor readings after a step, with the error models of sensors (part of stage 9).

use stepper_real::{Real, Scalar, kernel};

use crate::actuation::forces::{ActuatorForces, ForceState};
use crate::collision::adhesion::set_adhesive_arms;
use crate::constraints::VelocitySolution;
use crate::dynamics::kinematics::Kinematics;
use crate::dynamics::mocap;
use crate::integrators::devices::{Devices, SensorDevices};
use crate::integrators::step_input::StepInput;
use crate::integrators::workspace::Sensors;
use crate::options::StepSettings;
use crate::sensing::SensorInput;
use crate::sensing::errors::Errors;
use crate::sensing::memory::Memory;
use crate::stages::s01_actuate::actuate;
use crate::stages::s09_sense::sense;

/// Computes stage 9: the acceleration of the step, sensor readings if they are requested, and their error models.
///
/// The state of `input` is the state after the step, and `velocity.v` is the velocity before it.
pub(crate) fn observe<R: Real>(
    input: StepInput<'_, R>,
    velocity: &VelocitySolution<R>,
    kinematics: &mut Kinematics<R>,
    sensors: &mut Sensors<R>,
    devices: &mut Devices<'_, R::Scalar>,
) {
    let StepInput { options, state, alive, .. } = input;
    kernel!(R, || {
        let rate = R::one() / R::of(options.timestep);
        for ((a, &before), &after) in sensors.acceleration.iter_mut().zip(&velocity.v).zip(&state.v) {
            *a = (after - before) * rate;
        }
    });
    let Some(SensorDevices { errors, memory, read }) = &mut devices.sensors else { return };
    memory.step.iter_mut().for_each(|step| *step = step.wrapping_add(1));
    if *read || errors.is_some() {
        read_sensors(input, &velocity.scalar_impulse, kinematics, sensors);
    }
    if let Some(errors) = errors {
        apply_errors(errors, options, sensors, devices.group, memory, alive, false);
    }
}

/// Computes the forces of the actuators at the state of `input` into `forces`. The caller must set the poses of mocap frames in
/// `kinematics`.
pub(crate) fn read_actuator_forces<R: Real>(
    input: StepInput<'_, R>,
    scalar_impulse: &[R],
    kinematics: &mut Kinematics<R>,
    forces: &mut ActuatorForces<R>,
) {
    let StepInput { compiled, options, state, inputs, .. } = input;
    if compiled.variable_arms[1] > 0 {
        kinematics.update(compiled, &state.q);
        forces.transmit(compiled, (kinematics, &state.q), (&state.v, R::zero()));
        set_adhesive_arms(compiled, kinematics, &state.contacts, forces.adhesive_arms());
    }
    let dynamics = &inputs.actuator_dynamics;
    let numbers = [&state.q[..], &state.v, &state.act];
    actuate(compiled, &ForceState::state(numbers, R::of(options.timestep), &inputs.ctrl, dynamics), None, forces);
    if compiled.lossy {
        forces.compute_losses(compiled, dynamics, &state.v, None);
        forces.subtract_losses(compiled, dynamics, &state.v, scalar_impulse, R::of(options.timestep));
    }
}

/// Computes the true readings of all sensors at the state of `input` into `sensors.workspace.truth`.
pub(crate) fn read_sensors<R: Real>(
    input: StepInput<'_, R>,
    scalar_impulse: &[R],
    kinematics: &mut Kinematics<R>,
    sensors: &mut Sensors<R>,
) {
    let StepInput { compiled, options, state, inputs, .. } = input;
    let elapsed = R::of(state.elapsed);
    mocap::pose_bodies(compiled, &inputs.mocap_trajectories, |_| elapsed, kinematics);
    if compiled.sensing.needs.actuators {
        read_actuator_forces(input, scalar_impulse, kinematics, &mut sensors.actuator_forces);
    }
    if !sensors.workspace.orientation.is_empty() {
        for (m, trajectory) in compiled.mocap.iter().zip(&inputs.mocap_trajectories) {
            sensors.workspace.orientation[m.frame] = kernel!(R, || trajectory.quat_at(elapsed));
        }
    }
    let mut time = R::zero();
    state.time.iter().enumerate().for_each(|(l, &t)| time.set_lane(l, Scalar::from_f64(t)));
    let input = SensorInput {
        q: &state.q,
        v: &state.v,
        time,
        h: R::of(options.timestep),
        acceleration: &sensors.acceleration,
        actuator_forces: &sensors.actuator_forces,
        xfrc: if compiled.sensing.needs.wrenches { &inputs.xfrc } else { &[] },
        scalar_impulse,
        contacts: &state.contacts,
    };
    sense(compiled, kinematics, &mut sensors.workspace, &input);
}

/// Applies the error models of sensors to the true readings in the lanes `lanes`. `start` is true for the first reading of an episode.
pub(crate) fn apply_errors<R: Real>(
    errors: &Errors<R::Scalar>,
    options: &StepSettings,
    sensors: &mut Sensors<R>,
    group: usize,
    memory: &mut Memory<R::Scalar>,
    lanes: R::Mask,
    start: bool,
) {
    let work = sensors.error_work.get_or_insert_with(|| errors.work());
    errors.observe(group, &sensors.workspace.truth, lanes, start, options.timestep, work, memory);
}
