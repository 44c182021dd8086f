//! Arrays that the user writes and every step reads: forces, and poses of mocap bodies.
//!
//! Their memory is Python's, which other threads of Python may write to while the core runs: the core has copies, made before each call.

use numpy::{PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use stepper_core::AppliedInput;

use crate::array::shape_text;
use crate::error::value_error;
use crate::stepper::Stepper;

impl Stepper {
    /// Shape of a writable array: (num_envs, ...), or without the leading axis for a single environment.
    pub(super) fn applied_shape(&self, input: AppliedInput) -> Vec<usize> {
        self.shape(&input.shape(self.simulation.model()))
    }

    /// Puts the rows of some environments in the writable arrays back to what they are at reset.
    pub(super) fn reset_applied(&mut self, py: Python<'_>, envs: &[usize]) -> PyResult<()> {
        for input in AppliedInput::ALL {
            let Some(array) = self.made(py, input)? else { continue };
            let row = input.at_reset(self.simulation.model());
            let mut array = array.try_readwrite().map_err(|e| PyValueError::new_err(format!("{}: {e}", input.name())))?;
            let numbers = array.as_slice_mut()?;
            envs.iter().for_each(|&env| numbers[env * row.len()..][..row.len()].copy_from_slice(&row));
        }
        Ok(())
    }

    /// The writable array, if it was made; an error if the user has made something else of it.
    fn made<'py>(&self, py: Python<'py>, input: AppliedInput) -> PyResult<Option<Bound<'py, PyArrayDyn<f64>>>> {
        let Some(array) = &self.applied[input as usize] else { return Ok(None) };
        let (array, shape) = (array.bind(py), self.applied_shape(input));
        // It was of this type, but NumPy lets whoever has an array give it another.
        match array.as_any().cast::<PyArrayDyn<f64>>() {
            Ok(array) if array.shape() == shape && array.is_c_contiguous() => Ok(Some(array.clone())),
            _ => {
                let (name, shape) = (input.name(), shape_text(&shape));
                Err(PyValueError::new_err(format!("{name} is no longer a plain float64 array {shape}: assign to its elements instead")))
            }
        }
    }

    /// The writable array, made at its first use.
    pub(super) fn applied_array<'py>(&mut self, py: Python<'py>, input: AppliedInput) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        if self.applied[input as usize].is_none() {
            let all = input.at_reset(self.simulation.model()).repeat(self.n());
            let made = numpy::PyArray1::from_vec(py, all).reshape(self.applied_shape(input))?;
            self.applied[input as usize] = Some(made.unbind());
        }
        Ok(self.applied[input as usize].as_ref().expect("made above").bind(py).clone())
    }

    /// Replaces the contents of a writable array.
    fn assign(&mut self, py: Python<'_>, input: AppliedInput, value: &Bound<'_, PyAny>) -> PyResult<()> {
        self.applied_array(py, input)?;
        self.made(py, input)?.expect("made above").set_item(py.Ellipsis(), value)
    }

    /// Hands the writable arrays that were made to the core, which copies them.
    pub(super) fn apply(&mut self, py: Python<'_>) -> PyResult<()> {
        if self.applied.iter().all(Option::is_none) { Ok(()) } else { self.apply_arrays(py) }
    }

    #[cold]
    fn apply_arrays(&mut self, py: Python<'_>) -> PyResult<()> {
        for input in AppliedInput::ALL {
            let Some(array) = self.made(py, input)? else { continue };
            let array = array.try_readonly().map_err(|e| PyValueError::new_err(format!("{}: {e}", input.name())))?;
            self.simulation.apply(input, array.as_slice()?).map_err(value_error)?;
        }
        Ok(())
    }
}

#[pymethods]
impl Stepper {
    /// Writable, read by every step until changed or reset: forces on the joints in N or N m, (num_envs, nv).
    #[getter]
    fn qfrc_applied<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.applied_array(py, AppliedInput::QfrcApplied)
    }

    #[setter]
    fn set_qfrc_applied(&mut self, py: Python<'_>, value: Bound<'_, PyAny>) -> PyResult<()> {
        self.assign(py, AppliedInput::QfrcApplied, &value)
    }

    /// Writable, read by every step until changed or reset: force (N) and torque (N m) at every body's centre of mass, world axes,
    /// (num_envs, nbody, 6).
    #[getter]
    fn xfrc_applied<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.applied_array(py, AppliedInput::XfrcApplied)
    }

    #[setter]
    fn set_xfrc_applied(&mut self, py: Python<'_>, value: Bound<'_, PyAny>) -> PyResult<()> {
        self.assign(py, AppliedInput::XfrcApplied, &value)
    }

    /// Writable, read by every step until changed or reset: positions of the mocap bodies in m, (num_envs, nmocap, 3).
    #[getter]
    fn mocap_pos<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.applied_array(py, AppliedInput::MocapPos)
    }

    #[setter]
    fn set_mocap_pos(&mut self, py: Python<'_>, value: Bound<'_, PyAny>) -> PyResult<()> {
        self.assign(py, AppliedInput::MocapPos, &value)
    }

    /// Writable, read by every step until changed or reset: orientations of the mocap bodies, (num_envs, nmocap, 4).
    #[getter]
    fn mocap_quat<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.applied_array(py, AppliedInput::MocapQuat)
    }

    #[setter]
    fn set_mocap_quat(&mut self, py: Python<'_>, value: Bound<'_, PyAny>) -> PyResult<()> {
        self.assign(py, AppliedInput::MocapQuat, &value)
    }
}
