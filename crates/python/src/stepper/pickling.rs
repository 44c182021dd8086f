//! Pickles of a stepper: constructor arguments, state, parameters and applied inputs.

use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyTuple};
use stepper_core::{AppliedInput, SavedState};

use crate::array::{check_shape, float64_array};
use crate::error::value_error;
use crate::stepper::{Reading, Stepper, Writing};

impl Stepper {
    /// Content of a pickle except for constructor arguments: state, randomised parameters, and arrays of applied inputs.
    fn contents<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let state = PyDict::new(py);
        state.set_item("state", PyBytes::new(py, &self.simulation.save_state().to_bytes()))?;
        state.set_item("randomized", self.parameters(py)?)?;
        state.set_item("applied", self.applied.iter().map(|a| a.as_ref().map(|a| a.clone_ref(py))).collect::<Vec<_>>())?;
        Ok(state)
    }
}

#[pymethods]
impl Stepper {
    fn __getstate__<'py>(slf: Reading<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        slf.contents(py)
    }

    /// Restores the content of a pickle. All values are copied, because `copy.copy` passes the objects of the original.
    fn __setstate__(mut slf: Writing<'_>, py: Python<'_>, state: &Bound<'_, PyDict>) -> PyResult<()> {
        let wrong = |name: &str, what: &str| {
            PyValueError::new_err(format!("the pickle of a Stepper is damaged: {name} {what}; pickle the Stepper again"))
        };
        let item = |name: &str| state.get_item(name)?.ok_or_else(|| wrong(name, "is missing"));
        let (saved, randomized, applied) = (item("state")?, item("randomized")?, item("applied")?);
        let saved = saved.cast::<PyBytes>().map_err(|_| wrong("state", "is not bytes"))?;
        let saved = SavedState::from_bytes(saved.as_bytes()).map_err(value_error)?;
        let randomized = randomized.cast::<PyDict>().map_err(|_| wrong("randomized", "is not a dict"))?;
        let applied: Vec<Option<Bound<'_, PyAny>>> = applied.extract().map_err(|_| wrong("applied", "is not a list"))?;
        if applied.len() != AppliedInput::ALL.len() {
            return Err(wrong("applied", &format!("has {} arrays, must have {}", applied.len(), AppliedInput::ALL.len())));
        }
        slf.simulation.restore_state(&saved).map_err(value_error)?;
        if !randomized.is_empty() {
            let all = slf.selection(None)?;
            slf.randomize_from_dict(Some(randomized), &all)?;
        }
        for (input, given) in AppliedInput::ALL.into_iter().zip(&applied) {
            slf.applied[input as usize] = None;
            slf.simulation.apply(input, &[]).map_err(value_error)?;
            let Some(given) = given else { continue };
            check_shape(input.name(), float64_array(given, input.name())?.shape(), &[&slf.applied_shape(input)])?;
            slf.assign(py, input, given)?;
        }
        Ok(())
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let py = slf.py();
        let this = Reading::try_from(slf)?;
        let keywords = PyDict::new(py);
        keywords.set_item("options", this.options.clone_ref(py))?;
        keywords.set_item("precision", this.simulation.precision().name())?;
        keywords.set_item("threads", this.threads)?;
        keywords.set_item("seed", this.seed)?;
        keywords.set_item("sensors", this.sensors.as_ref().map(|sensors| sensors.clone_ref(py)))?;
        keywords.set_item("actuators", this.actuators.as_ref().map(|actuators| actuators.clone_ref(py)))?;
        let make = py.import("functools")?.getattr("partial")?.call((slf.get_type(),), Some(&keywords))?;
        let args = (this.model.clone_ref(py), this.batched.then(|| this.n())).into_pyobject(py)?;
        (make, args, this.contents(py)?).into_pyobject(py)
    }
}
