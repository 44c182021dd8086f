//! `stepper.Options` as the core's settings.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use stepper_core::{Integrator, Options, Precision, Stabilization};

/// The attributes of the Python dataclass, by name.
#[derive(FromPyObject)]
struct Given {
    timestep: Option<f64>,
    integrator: String,
    solver: String,
    iterations: u32,
    tolerance: Option<f64>,
    stabilization: String,
    baumgarte: f64,
    slop: f64,
    max_correction_speed: f64,
    restitution_threshold: f64,
    max_contacts: Option<u32>,
}

/// Settings for a model's own time step, from a `stepper.Options`.
pub(crate) fn settings(given: &Bound<'_, PyAny>, timestep: f64, precision: Precision) -> PyResult<Options> {
    let given: Given = given.extract()?;
    if !matches!(given.solver.as_str(), "auto" | "pgs") {
        return Err(unknown("solver", &given.solver, "auto, pgs"));
    }
    let integrator = match given.integrator.as_str() {
        "euler" => Integrator::Euler,
        "midpoint" => Integrator::Midpoint,
        "rk4" => Integrator::Rk4,
        other => return Err(unknown("integrator", other, "euler, midpoint, rk4")),
    };
    let stabilization = match given.stabilization.as_str() {
        "baumgarte" => Stabilization::Baumgarte,
        "split" => Stabilization::Split,
        "none" => Stabilization::None,
        other => return Err(unknown("stabilization", other, "baumgarte, split, none")),
    };
    // A residual near the rounding of the lanes cannot be reached.
    let tolerance = if precision == Precision::F32 { 1e-4 } else { Options::default().tolerance };
    let options = Options {
        timestep: given.timestep.unwrap_or(timestep),
        integrator,
        iterations: given.iterations,
        tolerance: given.tolerance.unwrap_or(tolerance),
        stabilization,
        baumgarte: given.baumgarte,
        slop: given.slop,
        max_correction_speed: given.max_correction_speed,
        restitution_threshold: given.restitution_threshold,
        max_contacts: given.max_contacts,
    };
    options.check().map_err(PyValueError::new_err)?;
    Ok(options)
}

/// An error that lists what there is.
pub(crate) fn unknown(what: &str, found: &str, known: &str) -> PyErr {
    PyValueError::new_err(format!("{what} is \"{found}\", must be one of: {known}"))
}
