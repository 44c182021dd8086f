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
        found.map_err(|_| PyTypeError::new_err(format!("options is {}, must be a stepper.Options", described(self.0))))
    }

    fn wrong(name: &str, value: &Bound<'_, PyAny>, must: &str) -> PyErr {
        PyTypeError::new_err(format!("option {name} is {}, must be {must}", described(value)))
    }

    fn number(&self, name: &str) -> PyResult<f64> {
        let value = self.value(name)?;
        value.extract().map_err(|_| Self::wrong(name, &value, "a number"))
    }

    fn word(&self, name: &str) -> PyResult<String> {
        let value = self.value(name)?;
        value.extract().map_err(|_| Self::wrong(name, &value, "a string"))
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
    let solver = match given.word("solver")?.as_str() {
        "auto" => Solver::Auto,
        "pgs" => Solver::Pgs,
        "newton" => Solver::Newton,
        other => return Err(unknown("solver", other, "auto, pgs, newton")),
    };
    let contact = match given.word("contact")?.as_str() {
        "hard" => ContactLaw::Hard,
        "mujoco" => ContactLaw::Mujoco,
        other => return Err(unknown("contact", other, "hard, mujoco")),
    };
    let integrator = match given.optional("integrator", Given::word)?.as_deref() {
        None => None,
        Some("euler") => Some(Integrator::Euler),
        Some("midpoint") => Some(Integrator::Midpoint),
        Some("implicit") => Some(Integrator::Implicit),
        Some("implicitfast") => Some(Integrator::ImplicitFast),
        Some("discrete") => Some(Integrator::Discrete),
        Some("rk4") => Some(Integrator::Rk4),
        Some(other) => return Err(unknown("integrator", other, "euler, midpoint, implicit, implicitfast, discrete, rk4")),
    };
    let stabilization = match given.word("stabilization")?.as_str() {
        "baumgarte" => Stabilization::Baumgarte,
        "split" => Stabilization::Split,
        "none" => Stabilization::None,
        other => return Err(unknown("stabilization", other, "baumgarte, split, none")),
    };
    let options = Options {
        timestep: given.optional("timestep", Given::number)?,
        contact,
        integrator,
        solver,
        iterations: given.count("iterations")?,
        tolerance: given.optional("tolerance", Given::number)?,
        stabilization,
        baumgarte: given.number("baumgarte")?,
        slop: given.number("slop")?,
        max_correction_speed: given.number("max_correction_speed")?,
        restitution_threshold: given.number("restitution_threshold")?,
        max_contacts: given.optional("max_contacts", Given::count)?,
    };
    options.check().map_err(value_error)?;
    Ok(options)
}

/// `ValueError` for the unknown value `found` of an argument `what`. The message contains the list `known` of valid values.
pub(crate) fn unknown(what: &str, found: &str, known: &str) -> PyErr {
    PyValueError::new_err(format!("{what} is \"{found}\", must be one of: {known}"))
}
