//! Conversion of `stepper.SensorModel` and `stepper.ActuatorModel` to types of the core.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use serde::de::DeserializeOwned;
use stepper_core::{ActuatorSpec, Transfer};

use crate::array::described;
use crate::model::Model;

/// Error models (transfers) from a `stepper.SensorModel` for all sensors of a model.
pub(crate) fn transfers(sensors: &Bound<'_, PyAny>, model: &Py<Model>, num_envs: usize) -> PyResult<Vec<Option<Transfer>>> {
    let class = "SensorModel({'*': stepper.Transfer(noise_std=...)})";
    resolved(sensors, (model.clone_ref(sensors.py()), num_envs), ["sensors", "transfers", class])
}

/// Drives (models of single actuators) from a `stepper.ActuatorModel` for all actuators of a model; `None` for ideal actuators. The drives
/// have values for all environments, or for the environments `envs` only.
pub(crate) fn drives(
    actuators: &Bound<'_, PyAny>,
    model: &Py<Model>,
    num_envs: usize,
    envs: Option<&[usize]>,
) -> PyResult<Vec<Option<ActuatorSpec>>> {
    let envs = envs.map(|envs| numpy::PyArray1::from_iter(actuators.py(), envs.iter().map(|&env| env as i64)));
    let class = "ActuatorModel({'*': stepper.Drive(delay=...)})";
    resolved(actuators, (model.clone_ref(actuators.py()), num_envs, envs), ["actuators", "drives", class])
}

/// Calls the method `method` of `given`, a sensor or actuator model, and returns what the method returns for all sensors or actuators.
///
/// If `given` does not have the method, the result is a `TypeError`. Its message contains the name `argument` of the Python argument and
/// its required class.
fn resolved<'py, T: DeserializeOwned>(
    given: &Bound<'py, PyAny>,
    arguments: impl pyo3::call::PyCallArgs<'py>,
    [argument, method, class]: [&str; 3],
) -> PyResult<T> {
    let wrong = |_| PyTypeError::new_err(format!("{argument} is {}, must be a stepper.{class}", described(given)));
    let resolve = given.getattr(method).map_err(wrong)?;
    pythonize::depythonize(&resolve.call1(arguments)?).map_err(|e| PyValueError::new_err(format!("{argument}: {e}")))
}
