//! Sensor readings of a stepper.

use numpy::{PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

use crate::array::{array, check_shape, described, read_only};
use crate::error::value_error;
use crate::getters::getters;
use crate::stepper::{Stepper, Writing};

impl Stepper {
    /// Readings of all sensors in all environments, (num_envs, nsensordata). `truth` selects the readings of ideal sensors.
    fn sense(&mut self, py: Python<'_>, truth: bool) -> PyResult<Vec<f64>> {
        self.apply(py)?;
        let mut out = vec![0.0; self.n() * self.simulation.model().nsensordata()];
        let simulation = &mut self.simulation;
        py.detach(|| simulation.sense(truth, &mut out)).map_err(value_error)?;
        Ok(out)
    }

    fn readings<'py>(&mut self, py: Python<'py>, truth: bool) -> PyResult<Bound<'py, PyAny>> {
        let data = self.sense(py, truth)?;
        array(py, &self.shape(&[self.simulation.model().nsensordata()]), data, self.simulation.precision())
    }
}

#[pymethods]
impl Stepper {
    /// Writable copy of `sensordata`, (num_envs, nsensordata). If an array `out` is given, the result is that array.
    #[pyo3(signature = (out=None))]
    fn observe<'py>(mut slf: Writing<'_>, py: Python<'py>, out: Option<Bound<'py, PyAny>>) -> PyResult<Bound<'py, PyAny>> {
        let Some(out) = out else { return slf.readings(py, false) };
        let must = slf.shape(&[slf.simulation.model().nsensordata()]);
        let Ok(given) = out.cast::<numpy::PyUntypedArray>() else {
            return Err(PyTypeError::new_err(format!("out is {}, must be a NumPy array", described(&out))));
        };
        let dtype = given.dtype();
        if dtype.kind() != b'f' {
            return Err(PyTypeError::new_err(format!("out has dtype {dtype}, must be one of real numbers")));
        }
        check_shape("out", given.shape(), &[&must])?;
        match out.cast::<PyArrayDyn<f64>>() {
            Ok(exact) if exact.is_c_contiguous() => {
                let readings = slf.sense(py, false)?;
                let mut out = exact.try_readwrite().map_err(|e| PyValueError::new_err(format!("out: {e}")))?;
                out.as_slice_mut()?.copy_from_slice(&readings);
            }
            _ => out.set_item(py.Ellipsis(), slf.readings(py, false)?)?,
        }
        Ok(out)
    }
}

getters! { Stepper, |mut slf, py| (Writing<'_>) -> PyResult<Bound<'py, PyAny>>;
    /// Sensor readings of the last step, (num_envs, nsensordata). Repeated reads give the same values. `observe()` returns a
    /// writable copy.
    sensordata: read_only(slf.readings(py, false)?),
    /// Readings of ideal sensors, (num_envs, nsensordata).
    ///
    /// Positions and velocities are those after the last step. Accelerations are the change of velocity in that step divided by the time
    /// step, including impulses of contacts and limits. Forces are impulses divided by the time step. Before the first step after a reset
    /// or `set_state`, accelerations and forces are those of a step from the current state.
    sensordata_ideal: read_only(slf.readings(py, true)?),
}
