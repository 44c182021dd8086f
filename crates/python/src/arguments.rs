//! Conversion of arguments from Python: integers, flags, indices of environments and elements, unknown keywords.

use pyo3::exceptions::{PyIndexError, PyKeyError, PyOverflowError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use stepper_core::model::{ElementKind, Model};

use crate::array::{described, whole};

/// Checks that the Python call `call` has no unknown keywords. `others` has the keywords that are no parameter of the method, and `known`
/// the names of its parameters.
///
/// # Errors
/// `TypeError` for the first unknown keyword. The message has the present name of a renamed keyword, or similar names.
pub(crate) fn no_others(call: &str, others: Option<&Bound<'_, PyDict>>, known: &[&str]) -> PyResult<()> {
    let Some((name, _)) = others.and_then(|others| others.iter().next()) else { return Ok(()) };
    let hints = name.py().import("stepper._hints")?;
    let text: String = hints.call_method1("unknown_keyword", (call, &name, known.to_vec()))?.extract()?;
    Err(PyTypeError::new_err(text))
}

/// Value of a required argument of the Python call `call`, after [`no_others`]. `TypeError` if it is missing.
pub(crate) fn required<'py>(call: &str, name: &str, given: Option<Bound<'py, PyAny>>) -> PyResult<Bound<'py, PyAny>> {
    given.ok_or_else(|| PyTypeError::new_err(format!("{call}() lacks the argument {name}")))
}

/// Integer argument of a Python call. `Number` is a valid u64; `Other` is any other object, which [`Whole::from`] converts or rejects.
#[derive(FromPyObject)]
pub(crate) enum Whole<'py> {
    Number(u64),
    Other(Bound<'py, PyAny>),
}

impl Whole<'_> {
    /// Value of the argument. An `Other` object must be an integer of at least `least`; errors contain the argument's `name`.
    pub(crate) fn from(&self, least: u64, name: &str) -> PyResult<u64> {
        match self {
            Self::Number(number) => Ok(*number),
            Self::Other(given) => whole(given, name, least),
        }
    }
}

/// Argument of a Python call that is True or False. `Other` is any other object, which [`Flag::from`] rejects.
#[derive(FromPyObject)]
pub(crate) enum Flag<'py> {
    Value(bool),
    Other(Bound<'py, PyAny>),
}

impl Flag<'_> {
    /// Value of the argument. Errors contain the argument's `name`.
    pub(crate) fn from(&self, name: &str) -> PyResult<bool> {
        match self {
            Self::Value(value) => Ok(*value),
            Self::Other(given) => Err(PyTypeError::new_err(format!("{name} is {}, must be True or False", given.repr()?))),
        }
    }
}

/// Argument with the index of an environment. An index outside the range of isize becomes `isize::MAX`, so that the later range check
/// rejects the index.
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

/// Index of the element of the kind `kind` that a name or an index selects. Negative indices count from the end.
pub(crate) fn index_of(model: &Model, kind: ElementKind, given: &Bound<'_, PyAny>) -> PyResult<usize> {
    let (word, names) = (kind.name(), kind.names(model));
    if let Ok(name) = given.extract::<String>() {
        if let Some(index) = names.iter().position(|known| *known == name && !name.is_empty()) {
            return Ok(index);
        }
        let mut text: String = given.py().import("stepper._hints")?.call_method1("unknown", (word, &name, names))?.extract()?;
        // The name of another kind of element, such as a site for a body.
        if let Some(other) = ElementKind::ALL.iter().find(|kind| !name.is_empty() && kind.names(model).contains(&name.as_str())) {
            text = format!("{name:?} is no {word}, but a {}: {text}", other.name());
        }
        return Err(PyKeyError::new_err(text));
    }
    let wrong = |_| PyTypeError::new_err(format!("{word}, if it is no name, is {}, must be a whole number", described(given)));
    let index = given.py().import("operator")?.call_method1("index", (given,)).map_err(wrong)?;
    let n = names.len() as isize;
    let at = index.extract::<isize>().ok().map(|i| if i < 0 { i.saturating_add(n) } else { i });
    match at {
        Some(at) if (0..n).contains(&at) => Ok(at as usize),
        _ if n == 0 => Err(PyIndexError::new_err(format!("{word} is {index}, and the model has no {word}"))),
        _ => Err(PyIndexError::new_err(format!("{word} is {index}, must be below {n}"))),
    }
}
