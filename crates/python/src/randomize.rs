//! `Stepper.randomize`: arrays in and out.

use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use stepper_core::{Parameter, Precision};

use crate::array::{array, check_shape, read_only_of_environments, readonly};
use crate::error::value_error;
use crate::model::to_py;
use crate::stepper::{Stepper, drives};

/// The field that is no field of the model.
const ACTUATORS: &str = "actuators";

impl Stepper {
    /// Assigns fields, (num_envs, ...) each, and `actuators` to some environments; None is the model's own numbers, and what drives were made
    /// with, and so is every field when none is named.
    pub(crate) fn assign_parameters(&mut self, fields: Option<&Bound<'_, PyDict>>, envs: &[usize]) -> PyResult<()> {
        let mut given: Vec<(String, Option<Vec<f64>>)> = Vec::new();
        let mut resampled = None;
        for (name, value) in fields.into_iter().flatten() {
            let name: String = name.extract()?;
            if name == ACTUATORS {
                let specs = if value.is_none() { None } else { Some(drives(&value, &self.model, self.simulation.num_envs(), Some(envs))?) };
                resampled = Some(self.simulation.resampled(specs.as_deref(), envs).map_err(value_error)?);
                continue;
            }
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
        if given.is_empty() && resampled.is_none() {
            resampled = Some(self.simulation.resampled(None, envs).map_err(value_error)?);
            given.extend(self.simulation.randomization().fields().map(|(name, _)| (name.to_owned(), None)));
        }
        let assigned = given.iter().map(|(name, values)| Ok((name.parse()?, values.as_deref())));
        let assigned: Vec<(Parameter, Option<&[f64]>)> = assigned.collect::<Result<_, _>>().map_err(to_py)?;
        if !assigned.is_empty() {
            self.simulation.randomize(&assigned, envs).map_err(value_error)?;
        }
        self.simulation.resample_actuators(resampled.flatten());
        Ok(())
    }

    /// The fields that environments have of their own, by name; drives as a `stepper.ActuatorModel`.
    pub(crate) fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for (name, values) in self.simulation.randomization().fields() {
            let (tail, _) = self.simulation.model().field(name).expect("a field of the model");
            let values = array(py, &self.shape(&tail), values.to_vec(), Precision::F64)?;
            all.set_item(name, read_only_of_environments(values, name)?)?;
        }
        if let Some(drawn) = self.simulation.drawn() {
            let rows = pythonize::pythonize(py, drawn).map_err(|e| PyValueError::new_err(e.to_string()))?;
            let class = py.import("stepper")?.getattr("ActuatorModel")?;
            all.set_item(ACTUATORS, class.call_method1("_from_rows", (self.model.clone_ref(py), rows))?)?;
        }
        Ok(all)
    }
}
