//! Conversion of `stepper.Options` to the settings of the core.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use stepper_core::{ContactLaw, Integrator, Options, Solver, Stabilization};

use crate::array::{described, whole};
use crate::error::value_error;

/// Reader of the attributes of a `stepper.Options` object.
struct Given<'a, 'py>(&'a Bound<'py, PyAny>);

impl<'py> Given<'_, 'py> {
    fn value(&self, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let found = self.0.getattr(name);
        found.map_err(|_| PyTypeError::new_err(format!("options is {}, must be a stepper.Options(timestep=...)", described(self.0))))
    }

    fn wrong(name: &str, value: &Bound<'_, PyAny>, must: &str) -> PyErr {
        PyTypeError::new_err(format!("option {name} is {}, must be {must}", described(value)))
    }

    fn number(&self, name: &str) -> PyResult<f64> {
        let value = self.value(name)?;
        value.extract().map_err(|_| Self::wrong(name, &value, "a number"))
    }

    fn choice<T: Copy>(&self, name: &str, known: &[(&str, T)]) -> PyResult<T> {
        let value = self.value(name)?;
        let word: String = value.extract().map_err(|_| Self::wrong(name, &value, "a string"))?;
        let found = known.iter().find(|(known, _)| *known == word).map(|(_, choice)| *choice);
        found.ok_or_else(|| unknown(name, &word, &known.iter().map(|(known, _)| *known).collect::<Vec<_>>().join(", ")))
    }

    fn count(&self, name: &str) -> PyResult<u32> {
        let number = whole(&self.value(name)?, &format!("option {name}"), 1)?;
        u32::try_from(number).map_err(|_| PyValueError::new_err(format!("option {name} is {number}, must be at most {}", u32::MAX)))
    }

    /// Value of the option `name`, converted by `read`, or None if the option is None.
    fn optional<T>(&self, name: &str, read: impl Fn(&Self, &str) -> PyResult<T>) -> PyResult<Option<T>> {
        if self.value(name)?.is_none() { Ok(None) } else { read(self, name).map(Some) }
    }
}

/// Settings of the step for the core, from a `stepper.Options` object.
pub(crate) fn settings(given: &Bound<'_, PyAny>) -> PyResult<Options> {
    let given = Given(given);
    let integrators = [Integrator::Euler, Integrator::Midpoint, Integrator::Implicit, Integrator::ImplicitFast, Integrator::Rk4];
    let integrators = integrators.map(|integrator| (integrator.name(), integrator));
    let stabilizations = [("baumgarte", Stabilization::Baumgarte), ("split", Stabilization::Split), ("none", Stabilization::None)];
    let options = Options {
        timestep: given.optional("timestep", Given::number)?,
        contact: given.choice("contact", &[("hard", ContactLaw::Hard), ("mujoco", ContactLaw::Mujoco)])?,
        integrator: given.optional("integrator", |given, name| given.choice(name, &integrators))?,
        error: given.optional("error", Given::number)?,
        solver: given.choice("solver", &[("auto", Solver::Auto), ("pgs", Solver::Pgs), ("newton", Solver::Newton)])?,
        iterations: given.count("iterations")?,
        tolerance: given.optional("tolerance", Given::number)?,
        rtol: given.number("rtol")?,
        stabilization: given.choice("stabilization", &stabilizations)?,
        baumgarte: given.number("baumgarte")?,
        slop: given.number("slop")?,
        max_correction_speed: given.number("max_correction_speed")?,
        restitution_threshold: given.number("restitution_threshold")?,
        max_contacts: given.optional("max_contacts", Given::count)?,
    };
    options.check().map_err(value_error)?;
    Ok(options)
}

/// Raises an error unless all settings of a `stepper.Options` object are valid.
///
/// Raises:
///     TypeError: A setting has a wrong type.
///     ValueError: A setting is out of its range, or the contact law does not have the integrator.
#[pyfunction]
pub(crate) fn check_options(options: &Bound<'_, PyAny>) -> PyResult<()> {
    settings(options).map(|_| ())
}

/// `ValueError` for the unknown value `found` of an argument `what`. The message contains the list `known` of valid values.
pub(crate) fn unknown(what: &str, found: &str, known: &str) -> PyErr {
    PyValueError::new_err(format!("{what} is \"{found}\", must be one of: {known}"))
}
