//! `stepper.State`.

use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyTuple};

/// Everything of a `Stepper` that survives a step.
#[pyclass(module = "stepper._stepper", frozen)]
pub(crate) struct State {
    pub(crate) bytes: Vec<u8>,
    pub(crate) digest: [u8; 32],
}

#[pymethods]
impl State {
    #[new]
    fn new(bytes: Vec<u8>, digest: [u8; 32]) -> Self {
        Self { bytes, digest }
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let py = slf.py();
        let this = slf.get();
        let args = (PyBytes::new(py, &this.bytes), PyBytes::new(py, &this.digest)).into_pyobject(py)?;
        Ok((slf.get_type().into_any(), args))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.bytes == other.bytes && self.digest == other.digest
    }

    #[getter]
    fn bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.bytes)
    }

    #[getter]
    fn digest<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.digest)
    }

    #[getter]
    fn nbytes(&self) -> usize {
        self.bytes.len()
    }
}
