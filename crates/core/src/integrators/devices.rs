//! Device models around a step, with their memory: actuator pipelines before its forces, error models of sensors after its state.

use stepper_real::Scalar;

use crate::actuation::{self, ActuatorPipelines};
use crate::sensing::errors::Errors;
use crate::sensing::memory::Memory;

/// Device models of one group of environments.
#[derive(Debug)]
pub struct Devices<'a, S> {
    /// Index of the group in the batch.
    pub(crate) group: usize,
    /// Actuator pipelines between controls and forces; none without an actuator model.
    pub(crate) actuators: Option<ActuatorDevices<'a, S>>,
    /// Sensors; none in a trial step, whose result is discarded.
    pub(crate) sensors: Option<SensorDevices<'a, S>>,
}

/// Actuator pipelines and their memory.
#[derive(Debug)]
pub(crate) struct ActuatorDevices<'a, S> {
    pub(crate) pipelines: &'a ActuatorPipelines<S>,
    pub(crate) memory: &'a mut actuation::memory::Memory<S>,
}

/// Error models of the sensors and their memory.
#[derive(Debug)]
pub(crate) struct SensorDevices<'a, S> {
    /// Error models of the sensors; none where all sensors are ideal.
    pub(crate) errors: Option<&'a Errors<S>>,
    pub(crate) memory: &'a mut Memory<S>,
    /// Whether ideal sensors are read too: error models read every step.
    pub(crate) read: bool,
}

impl<S: Scalar> Devices<'_, S> {
    /// No devices, for a trial step whose result is discarded.
    pub(crate) fn none() -> Self {
        Self { group: 0, actuators: None, sensors: None }
    }
}
