//! Conversion of the core's errors to exceptions.

use pyo3::PyErr;
use pyo3::exceptions::{PyMemoryError, PyOSError, PyRuntimeError, PyValueError};
use stepper_core::Error;

use crate::phrases::in_python;

pyo3::create_exception!(
    stepper._stepper,
    ModelError,
    PyValueError,
    "Error of a model that cannot be simulated. The message says what is wrong, where, and what to do."
);

pub(crate) fn to_py(error: stepper_core::ModelError) -> PyErr {
    ModelError::new_err(in_python(error.to_string()))
}

pub(crate) fn value_error(error: Error) -> PyErr {
    let text = in_python(error.to_string());
    match error {
        Error::Model(e) => to_py(e),
        Error::Memory { .. } => PyMemoryError::new_err(text),
        Error::File { .. } => PyOSError::new_err(text),
        Error::Threads { .. } => PyRuntimeError::new_err(text),
        _ => PyValueError::new_err(text),
    }
}
