//! Device models around a step, with their memory: actuator pipelines compute the actuators' controls before it, and error models of
//! sensors process readings after it.

use crate::actuation::{self, ActuatorPipelines};
use crate::sensing::errors::Errors;
use crate::sensing::memory::Memory;

/// Device models of one group of environments: actuator pipelines and sensors. The default has none, for a trial step whose result is
/// discarded.
#[derive(Debug, Default)]
pub struct Devices<'a, S> {
    /// Index of the group in the batch.
    pub(crate) group: usize,
    /// Actuator pipelines (delay, servo, lag). `None` if no actuator has an actuator model, and in a trial step, whose result is discarded.
    pub(crate) actuators: Option<ActuatorDevices<'a, S>>,
    /// Sensors; `None` in a trial step, whose result is discarded.
    pub(crate) sensors: Option<SensorDevices<'a, S>>,
}

/// Actuator pipelines, and the group's memory of them.
#[derive(Debug)]
pub(crate) struct ActuatorDevices<'a, S> {
    pub(crate) pipelines: &'a ActuatorPipelines<S>,
    pub(crate) memory: &'a mut actuation::memory::Memory<S>,
}

/// Error models of the sensors, and the group's memory of them.
#[derive(Debug)]
pub(crate) struct SensorDevices<'a, S> {
    /// Error models of the sensors; `None` if all sensors are ideal.
    pub(crate) errors: Option<&'a Errors<S>>,
    pub(crate) memory: &'a mut Memory<S>,
    /// Whether this step reads the ideal sensors too. Sensors with error models are read in every step.
    pub(crate) read: bool,
}
