//! `Stepper.randomize`: arrays in and out.

use numpy::PyUntypedArrayMethods;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use stepper_core::Precision;

use crate::array::{array, check_shape, readonly};
use crate::stepper::{Stepper, value_error};

impl Stepper {
    /// Assigns fields, (num_envs, ...) each, to some environments; None is the model's own numbers, and so is every field when none is named.
    pub(crate) fn assign_parameters(&mut self, fields: Option<&Bound<'_, PyDict>>, envs: &[usize]) -> PyResult<()> {
        let mut given: Vec<(String, Option<Vec<f64>>)> = Vec::new();
        for (name, value) in fields.into_iter().flatten() {
            let name: String = name.extract()?;
            if value.is_none() {
                given.push((name, None));
                continue;
            }
            let value = readonly(&value, &name)?;
            if let Some((tail, _)) = self.simulation.model().field(&name) {
                check_shape(&name, value.shape(), &[&self.shape(&tail)])?;
            }
            given.push((name, Some(value.as_slice()?.to_vec())));
        }
        if given.is_empty() {
            given.extend(self.simulation.theta().fields().map(|(name, _)| (name.to_owned(), None)));
        }
        let assigned: Vec<(&str, Option<&[f64]>)> = given.iter().map(|(name, values)| (name.as_str(), values.as_deref())).collect();
        self.simulation.randomize(&assigned, envs).map_err(value_error)
    }

    /// The fields that environments have of their own, by name.
    pub(crate) fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for (name, values) in self.simulation.theta().fields() {
            let (tail, _) = self.simulation.model().field(name).expect("a field of the model");
            all.set_item(name, array(py, &self.shape(&tail), values.to_vec(), Precision::F64)?)?;
        }
        Ok(all)
    }
}
