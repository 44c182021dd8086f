//! Python bindings, which only convert arguments and results. `python/stepper/_stepper.pyi` has the same documentation.

mod arguments;
mod array;
mod configurations;
mod contacts;
mod derived_arrays;
mod device_models;
mod elements;
mod error;
mod getters;
mod model;
mod options;
mod phrases;
mod selection;
mod state;
mod stepper;

use pyo3::prelude::*;

#[pymodule]
fn _stepper(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<model::Model>()?;
    model::add_fields(&m.py().get_type::<model::Model>())?;
    elements::add_classes(m)?;
    m.add_class::<stepper::Stepper>()?;
    m.add_class::<state::State>()?;
    m.add("ModelError", m.py().get_type::<error::ModelError>())?;
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add_function(wrap_pyfunction!(cpu_levels, m)?)?;
    m.add_function(wrap_pyfunction!(selected, m)?)?;
    m.add_function(wrap_pyfunction!(model::fields, m)?)?;
    m.add_function(wrap_pyfunction!(options::check_options, m)?)?;
    Ok(())
}

/// Indices of the environments that the argument `envs` of a method selects, in the order of the argument; see `Stepper.reset`.
///
/// Args:
///     envs: Boolean mask (num_envs,), or integer indices (k,). None selects all environments.
///     num_envs: Number of environments.
///
/// Raises:
///     TypeError: An index is no integer; the message has the first one.
///     ValueError: A mask has another length, or an index appears twice.
///     IndexError: An index is out of range.
#[pyfunction]
#[pyo3(signature = (envs, num_envs))]
fn selected(envs: Option<Bound<'_, PyAny>>, num_envs: usize) -> PyResult<Vec<usize>> {
    Ok(selection::Selection::of(envs.as_ref(), num_envs)?.envs)
}

/// CPU levels (instruction sets of the compiled kernels) that this machine supports, slowest first, such as "avx2".
#[pyfunction]
fn cpu_levels() -> Vec<String> {
    stepper_core::Level::available().iter().map(ToString::to_string).collect()
}
