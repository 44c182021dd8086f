//! Randomization: parameters that differ between environments.
//!
//! Two types store them. [`Randomization`] has the fields of the model that the user set, for example `geom_friction`.
//! [`ParameterOverrides`] has the parameters of the compiled model that differ as a result, for example the friction of a pair.
//! [`Randomization::differences`] computes these parameters: it makes a variant of the model with the fields of each environment. Steps use
//! the overrides, and do not read the fields. Parameters of actuator models are stored elsewhere (`ActuatorModels`, `ActuatorPipelines`).
//!
//! [`ParameterOverrides`]: crate::batch::parameter_overrides::ParameterOverrides

use std::collections::BTreeMap;

use crate::compile::{LaneModel, Params};
use crate::model::{Model, ModelError, Variants};

/// Parameters of one environment that differ from the compiled model's: index in [`Params`] and value.
pub type Differences = Vec<(u32, f64)>;

/// Per-environment fields of the model that the user set, by name. Each array has one row per environment, with all values of the field.
#[derive(Clone, Debug, Default)]
pub struct Randomization {
    fields: BTreeMap<&'static str, Vec<f64>>,
}

/// Assignment of one field in some environments: name, and rows of values. There is one row per environment of the batch. Rows of
/// environments that the assignment leaves out are not read. `None` restores the model's values.
pub type Assignment<'a> = (&'static str, Option<&'a [f64]>);

impl Randomization {
    /// Names and values of the per-environment fields. Each array has one row per environment, with all values of the field.
    pub fn fields(&self) -> impl Iterator<Item = (&'static str, &[f64])> {
        self.fields.iter().map(|(&name, values)| (name, &values[..]))
    }

    /// Whether no field has per-environment values.
    pub fn is_empty(&self) -> bool {
        self.fields.is_empty()
    }

    /// Memory of the fields, bytes.
    pub fn bytes(&self) -> usize {
        self.fields.values().map(|values| size_of_val(&values[..])).sum()
    }

    /// Whether no field will have per-environment values after the assignments `assigned`. `all` is true if the assignments are for all
    /// environments.
    pub fn leaves_no_fields(&self, assigned: &[Assignment<'_>], all: bool) -> bool {
        let is_removed = |name: &&str| all && assigned.iter().any(|(assigned, _)| assigned == name);
        assigned.iter().all(|(_, values)| values.is_none()) && self.fields.keys().all(is_removed)
    }

    /// Parameters that will differ from the compiled model's after the assignments `assigned`, for each of the environments `envs`.
    ///
    /// `with_actuator_models` applies the actuator models to a variant of the model; `None` if there are none.
    ///
    /// # Errors
    /// [`ModelError`] of the first environment whose model is invalid or has another structure.
    pub fn differences(
        &self,
        model: &Model,
        compiled: &LaneModel<f64>,
        with_actuator_models: Option<&dyn Fn(&Model) -> Model>,
        assigned: &[Assignment<'_>],
        envs: &[usize],
    ) -> Result<Vec<Differences>, ModelError> {
        let mut fields: BTreeMap<&str, Option<&[f64]>> = self.fields().map(|(name, values)| (name, Some(values))).collect();
        fields.extend(assigned.iter().copied());
        let mut variants = Variants::new(model, fields.keys().copied())?;
        let shared: Vec<Vec<f64>> = fields.keys().map(|name| numbers(model, name)).collect();
        let of_env = |&env: &usize| {
            let values = fields.values().zip(&shared).map(|(given, model_values)| given.map(|all| row(all, env, model_values.len())));
            let values: Vec<Option<&[f64]>> = values.collect();
            let variant = variants.with(&values, &shared).map_err(|e| e.of(&format!("environment {env}")))?;
            let numbers = with_actuator_models.map_or_else(|| compiled.params_of(variant), |apply| compiled.params_of(&apply(variant)));
            Ok(differ(&numbers, &compiled.params))
        };
        envs.iter().map(of_env).collect()
    }

    /// Stores the fields `assigned` for the environments `envs`. A field whose values are restored in all environments is removed.
    pub fn store_fields(&mut self, model: &Model, num_envs: usize, assigned: &[Assignment<'_>], envs: &[usize]) {
        for &(name, values) in assigned {
            if values.is_none() && envs.len() == num_envs {
                self.fields.remove(name);
                continue;
            }
            let shared = numbers(model, name);
            let width = shared.len();
            let stored = self.fields.entry(name).or_insert_with(|| shared.repeat(num_envs));
            for &env in envs {
                let from = values.map_or(&shared[..], |all| row(all, env, width));
                stored[env * width..(env + 1) * width].copy_from_slice(from);
            }
        }
    }
}

/// All values of a field of the model.
fn numbers(model: &Model, name: &str) -> Vec<f64> {
    model.field(name).expect("a field of the model").1
}

fn row(all: &[f64], env: usize, width: usize) -> &[f64] {
    &all[env * width..(env + 1) * width]
}

/// Parameters in `changed` whose bits differ from those in `shared`: index, and value in `changed`.
fn differ(changed: &Params<f64>, shared: &Params<f64>) -> Differences {
    let both = (0..).zip(changed.numbers().iter().zip(shared.numbers()));
    both.filter(|(_, (changed, shared))| changed.to_bits() != shared.to_bits()).map(|(index, (&changed, _))| (index, changed)).collect()
}
