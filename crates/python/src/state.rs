//! `stepper.State`.

use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyTuple};
use stepper_core::SavedState;

use crate::array::hint;
use crate::error::value_error;
use crate::getters::getters;

/// Complete state of one or all environments of a `Stepper`; see `Stepper.get_state`.
///
/// States compare bit for bit and can be pickled.
///
/// Args:
///     bytes: Bytes from `State.bytes`.
///
/// Raises:
///     ValueError: The bytes are not a state, are truncated or damaged, or have another version.
#[pyclass(module = "stepper._stepper", frozen)]
pub(crate) struct State {
    pub(crate) saved: SavedState,
}

#[pymethods]
impl State {
    #[new]
    fn new(bytes: &[u8]) -> PyResult<Self> {
        SavedState::from_bytes(bytes).map(|saved| Self { saved }).map_err(value_error)
    }

    fn __getattr__(slf: &Bound<'_, Self>, name: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
        Err(hint(slf, "no_attribute", name)?)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let args = (PyBytes::new(slf.py(), &slf.get().saved.to_bytes()),).into_pyobject(slf.py())?;
        Ok((slf.get_type().into_any(), args))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.saved == other.saved
    }
}

getters! { State, |slf, py| (PyRef<'py, Self>);
    /// Bytes for `State(bytes)`: the state with a checksum and the digest of its model.
    bytes -> Bound<'py, PyBytes> { PyBytes::new(py, &slf.saved.to_bytes()) }
    /// SHA-256 digest of the model to which the state belongs.
    digest -> Bound<'py, PyBytes> { PyBytes::new(py, &slf.saved.model()) }
}

getters! { State, |slf, _py| (PyRef<'py, Self>);
    /// Length of `bytes`.
    nbytes -> usize { slf.saved.nbytes() }
}
