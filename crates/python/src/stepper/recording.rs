//! Notification of the recorder about each call of a stepper.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use stepper_core::Precision;

use crate::array::{array, described};
use crate::stepper::{Stepper, Writing};

/// Calls the method `what` of the recorder, if the stepper `this` has one, with the stepper and the keyword arguments `given`: pairs of
/// name and value. The function ends the borrow `this` first, so that other threads can use the stepper while the recorder runs.
pub(super) fn notify(slf: &Bound<'_, Stepper>, this: Writing<'_>, what: &str, given: &[(&str, Option<Bound<'_, PyAny>>)]) -> PyResult<()> {
    let Some(recorder) = this.recorder.as_ref().map(|recorder| recorder.clone_ref(slf.py())) else { return Ok(()) };
    drop(this);
    let arguments = PyDict::new(slf.py());
    for (name, value) in given {
        if let Some(value) = value {
            arguments.set_item(name, value)?;
        }
    }
    recorder.call_method(slf.py(), what, (slf,), Some(&arguments))?;
    Ok(())
}

/// Tells the recorder that the stepper made `nstep` steps with the current controls and applied inputs.
#[cold]
pub(super) fn notify_recorder_of_step(slf: &Bound<'_, Stepper>, this: Writing<'_>, nstep: usize) -> PyResult<()> {
    let py = slf.py();
    let ctrl = array(py, &[this.n(), this.simulation.model().nu()], this.simulation.ctrl().to_vec(), Precision::F64)?;
    let applied = this.applied.iter().map(|a| a.as_ref().map(|a| a.clone_ref(py))).collect::<Vec<_>>().into_pyobject(py)?;
    notify(slf, this, "step", &[("ctrl", Some(ctrl)), ("nstep", Some(nstep.into_pyobject(py)?.into_any())), ("applied", Some(applied))])
}

#[pymethods]
impl Stepper {
    /// Starts a recording of all further calls in a new folder, until the `Recorder` is closed.
    ///
    /// `stepper.recording.verify` repeats the recorded calls.
    ///
    /// Args:
    ///     path: New or empty folder.
    ///     **settings: Arguments of `stepper.Recorder`.
    #[pyo3(signature = (path, **settings))]
    fn record<'py>(slf: &Bound<'py, Self>, path: Bound<'py, PyAny>, settings: Option<&Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
        let recorder = slf.py().import("stepper")?.getattr("Recorder")?.call((slf, path), settings)?;
        Writing::try_from(slf)?.recorder = Some(recorder.clone().unbind());
        Ok(recorder)
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
