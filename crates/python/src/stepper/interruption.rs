//! Interruption of long calls by signals, such as Ctrl-C.

use pyo3::PyTypeInfo;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use stepper_core::Error;

/// Record of a call that a signal has interrupted.
#[derive(Debug)]
pub(super) struct Interrupted {
    /// Number of steps that each environment made before the interruption.
    pub(super) steps: usize,
    /// Exception that the signal handler raised.
    error: PyErr,
}

impl Interrupted {
    /// Exception for Python about an interrupted call of the method `call`, such as "step".
    ///
    /// The attribute `steps` of the exception is the number of steps made. A KeyboardInterrupt without a message gets one, with this
    /// number, the number of requested steps (`of`), and the text `also`. Any other exception of the signal handler keeps its message, and
    /// gets the same text as a note.
    pub(super) fn raise(self, py: Python<'_>, call: &str, of: usize, also: &str) -> PyErr {
        let Self { steps, error } = self;
        let message = format!("{call} was interrupted after {steps} of {of} steps, in every stepped environment{also}");
        let plain = error.get_type(py).is(PyKeyboardInterrupt::type_object(py))
            && error.value(py).str().is_ok_and(|text| text.is_empty().unwrap_or(false));
        let error = if plain { PyKeyboardInterrupt::new_err(message.clone()) } else { error };
        let value = error.value(py);
        if !plain {
            let _ = value.call_method1("add_note", (&message,));
        }
        // Some exception classes do not allow new attributes.
        let _ = value.setattr("steps", steps);
        error
    }
}

/// Makes a call of the core, `call`, that signals can interrupt.
///
/// `call` gets a function that it must call periodically on this thread. If this function returns false, a signal has interrupted the call:
/// `call` must stop and return the number of steps made. The result of `watched` is None if no signal interrupted the call.
pub(super) fn watched(call: impl FnOnce(&mut dyn FnMut() -> bool) -> Result<usize, Error>) -> Result<Option<Interrupted>, Error> {
    let mut error = None;
    let steps = call(&mut || match Python::attach(|py| py.check_signals()) {
        Ok(()) => true,
        Err(raised) => {
            error = Some(raised);
            false
        }
    })?;
    Ok(error.map(|error| Interrupted { steps, error }))
}
