//! Errors of the core as exceptions.

use pyo3::PyErr;
use pyo3::exceptions::{PyMemoryError, PyOSError, PyRuntimeError, PyValueError};
use stepper_core::Error;

use crate::model::to_py;

pub(crate) fn value_error(error: Error) -> PyErr {
    match error {
        Error::Model(e) => to_py(e),
        Error::Memory { .. } => PyMemoryError::new_err(error.to_string()),
        Error::File { .. } => PyOSError::new_err(error.to_string()),
        Error::Threads { .. } => PyRuntimeError::new_err(error.to_string()),
        _ => PyValueError::new_err(error.to_string()),
    }
}
