//! Arguments as Python gives them: whole numbers and environments.

use pyo3::exceptions::{PyOverflowError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::array::whole;

/// Error of the first keyword that a call does not take, with its present name or similar ones.
///
/// # Errors
/// `TypeError` if there is such a keyword.
pub(crate) fn no_others(call: &str, others: Option<&Bound<'_, PyDict>>, known: &[&str]) -> PyResult<()> {
    let Some((name, _)) = others.and_then(|others| others.iter().next()) else { return Ok(()) };
    let hints = name.py().import("stepper._hints")?;
    let text: String = hints.call_method1("unknown_keyword", (call, &name, known.to_vec()))?.extract()?;
    Err(PyTypeError::new_err(text))
}

/// A whole number as it was given; the common case costs no import.
#[derive(FromPyObject)]
pub(crate) enum Whole<'py> {
    Number(u64),
    Other(Bound<'py, PyAny>),
}

impl Whole<'_> {
    /// The number, if it is at least `least`; the error has the argument's name.
    pub(crate) fn from(&self, least: u64, name: &str) -> PyResult<u64> {
        match self {
            Self::Number(number) => Ok(*number),
            Self::Other(given) => whole(given, name, least),
        }
    }
}

/// An environment as it was given: negative from the end, and never too large to say so.
#[derive(Clone, Copy)]
pub(crate) struct Env(pub(crate) isize);

impl<'a, 'py> FromPyObject<'a, 'py> for Env {
    type Error = PyErr;

    fn extract(given: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        match given.extract::<isize>() {
            Err(error) if error.is_instance_of::<PyOverflowError>(given.py()) => Ok(Self(isize::MAX)),
            found => found.map(Self),
        }
    }
}
