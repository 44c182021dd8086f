//! Conversion of `stepper.SensorModel` and `stepper.ActuatorModel` to types of the core.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use stepper_core::{ActuatorSpec, Transfer};

use crate::array::described;
use crate::model::Model;

/// Error models (transfers) from a `stepper.SensorModel` for all sensors of a model.
pub(crate) fn transfers(sensors: &Bound<'_, PyAny>, model: &Py<Model>, num_envs: usize) -> PyResult<Vec<Option<Transfer>>> {
    let all = resolved(
        sensors,
        (model.clone_ref(sensors.py()), num_envs),
        ["sensors", "transfers", "SensorModel({'*': stepper.Transfer(noise_std=...)})"],
    )?;
    pythonize::depythonize(&all).map_err(|e| PyValueError::new_err(format!("sensors: {e}")))
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
    let all = resolved(
        actuators,
        (model.clone_ref(actuators.py()), num_envs, envs),
        ["actuators", "drives", "ActuatorModel({'*': stepper.Drive(delay=...)})"],
    )?;
    pythonize::depythonize(&all).map_err(|e| PyValueError::new_err(format!("actuators: {e}")))
}

/// Calls the method `method` of `given`, a sensor or actuator model, and returns what the method returns for all sensors or actuators.
///
/// If `given` does not have the method, the result is a `TypeError`. Its message contains the name `argument` of the Python argument and
/// its required class.
fn resolved<'py>(
    given: &Bound<'py, PyAny>,
    arguments: impl pyo3::call::PyCallArgs<'py>,
    [argument, method, class]: [&str; 3],
) -> PyResult<Bound<'py, PyAny>> {
    let resolve = given
        .getattr(method)
        .map_err(|_| PyTypeError::new_err(format!("{argument} is {}, must be a stepper.{class}", described(given))))?;
    resolve.call1(arguments)
}
