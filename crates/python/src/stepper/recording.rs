//! The recorder, who is told what is done.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use stepper_core::Precision;

use crate::array::{array, described};
use crate::stepper::{Reading, Stepper, Writing, borrow};

/// Whom to tell what is done, taken while the stepper is borrowed: another thread may have it next.
pub(super) fn recorder_of(py: Python<'_>, this: PyRefMut<'_, Stepper>) -> Option<Py<PyAny>> {
    this.recorder.as_ref().map(|r| r.clone_ref(py))
}

/// Tells the recorder, if there is one, what was done, with the arguments that were given.
pub(super) fn notify(
    slf: &Bound<'_, Stepper>,
    recorder: Option<Py<PyAny>>,
    what: &str,
    given: &[(&str, Option<Bound<'_, PyAny>>)],
) -> PyResult<()> {
    let Some(recorder) = recorder else { return Ok(()) };
    let arguments = PyDict::new(slf.py());
    for (name, value) in given {
        if let Some(value) = value {
            arguments.set_item(name, value)?;
        }
    }
    recorder.call_method(slf.py(), what, (slf,), Some(&arguments))?;
    Ok(())
}

/// Tells the recorder of a step: all that it was made with.
#[cold]
pub(super) fn tell_of_step(slf: &Bound<'_, Stepper>, this: PyRefMut<'_, Stepper>, nstep: usize) -> PyResult<()> {
    let py = slf.py();
    let ctrl = array(py, &[this.n(), this.simulation.model().nu()], this.simulation.ctrl().to_vec(), Precision::F64)?;
    let applied = this.applied.iter().map(|a| a.as_ref().map(|a| a.clone_ref(py))).collect::<Vec<_>>().into_pyobject(py)?;
    let recorder = recorder_of(py, this);
    notify(slf, recorder, "step", &[("ctrl", Some(ctrl)), ("nstep", Some(nstep.into_pyobject(py)?.into_any())), ("applied", Some(applied))])
}

#[pymethods]
impl Stepper {
    /// Writes everything that happens from now on into a new folder, until the `Recorder` is closed; `stepper.replay` repeats it.
    ///
    /// Args:
    ///     path: A folder that does not exist yet, or is empty.
    ///     **settings: See `stepper.Recorder`.
    #[pyo3(signature = (path, **settings))]
    fn record<'py>(slf: &Bound<'py, Self>, path: Bound<'py, PyAny>, settings: Option<&Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
        let recorder = slf.py().import("stepper")?.getattr("Recorder")?.call((slf, path), settings)?;
        borrow(slf)?.recorder = Some(recorder.clone().unbind());
        Ok(recorder)
    }

    /// Whom `step`, `reset` and `set_state` tell what they did (see `stepper.Recorder`); None is nobody.
    #[getter]
    fn recorder(slf: Reading<'_>, py: Python<'_>) -> Option<Py<PyAny>> {
        slf.recorder.as_ref().map(|r| r.clone_ref(py))
    }

    #[setter]
    fn set_recorder(mut slf: Writing<'_>, recorder: Option<Bound<'_, PyAny>>) -> PyResult<()> {
        let told = ["step", "reset", "set_state", "randomize"];
        if let Some(other) = recorder.as_ref().filter(|r| !told.iter().all(|name| r.hasattr(*name).unwrap_or(false))) {
            let message = format!("recorder is {}, must be None or have the methods {}", described(other), told.join(", "));
            return Err(PyTypeError::new_err(message));
        }
        slf.recorder = recorder.map(Bound::unbind);
        Ok(())
    }
}
