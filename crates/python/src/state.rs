//! `stepper.State`.

use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyTuple};
use stepper_core::SavedState;

use crate::array::hint;
use crate::error::value_error;

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
        let saved = SavedState::from_bytes(bytes).map_err(value_error)?;
        Ok(Self { saved })
    }

    fn __getattr__(slf: &Bound<'_, Self>, name: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
        Err(hint(slf, "no_attribute", name)?)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let args = (slf.get().bytes(slf.py()),).into_pyobject(slf.py())?;
        Ok((slf.get_type().into_any(), args))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.saved == other.saved
    }

    /// Bytes for `State(bytes)`: the state with a checksum and the digest of its model.
    #[getter]
    fn bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.saved.to_bytes())
    }

    /// SHA-256 digest of the model to which the state belongs.
    #[getter]
    fn digest<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.saved.model())
    }

    /// Length of `bytes`.
    #[getter]
    fn nbytes(&self) -> usize {
        self.saved.nbytes()
    }
}
