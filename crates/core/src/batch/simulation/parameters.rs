//! Per-environment parameters of a simulation: setters, getters and checks.

use std::borrow::Cow;

use crate::actuation::{ActuatorModels, ActuatorSpec, ActuatorUpdate};
use crate::batch::engine::with_batch;
use crate::batch::randomization::{Assignment, Differences, Randomization};
use crate::batch::simulation::{Error, Simulation};
use crate::compile::LaneModel;
use crate::error::{check_count, check_length};
use crate::model::{Model, ModelError, Parameter, label};

/// Change to the parameters of actuator models in a call of [`Simulation::randomize_all`].
#[derive(Clone, Copy, Debug)]
pub enum ActuatorNumbers<'a> {
    /// No change: the present parameters of the actuator models stay.
    Kept,
    /// Reset to the parameters that [`Simulation::set_actuator_models`] set.
    Original,
    /// New parameters, one entry for every actuator; `None` does not change an actuator. Each list of numbers in a spec has one number
    /// for all environments of the call, or one for each.
    Given(&'a [Option<ActuatorSpec>]),
}

impl Simulation {
    /// Sets per-environment values of some fields in the environments `envs`, ascending. Other fields and the state do not change.
    ///
    /// Each array has one row for every environment of the simulation, in the shape of its [`Parameter`]. Rows of environments outside
    /// `envs` have no effect, but their numbers must fit the precision too. `None` restores the model's values.
    ///
    /// # Errors
    /// [`Error::Environment`] or [`Error::Order`] for `envs`; [`Error::Length`] for an array of the wrong length;
    /// [`Error::ParameterTooLarge`] for a number that a simulation in 32 bits cannot hold. [`Error::Model`] for numbers that make the
    /// model invalid or change its structure; the error names the environment. Nothing is changed then.
    pub fn randomize(&mut self, assigned: &[(Parameter, Option<&[f64]>)], envs: &[usize]) -> Result<(), Error> {
        self.randomize_all(assigned, ActuatorNumbers::Kept, envs)
    }

    /// Sets per-environment values of fields and of actuator models. The state does not change: delay lines, lags and integrals of the
    /// actuator models stay too.
    ///
    /// # Errors
    /// The errors of [`Simulation::randomize`]; [`Error::Count`] when there is not one entry for every actuator. [`Error::Actuator`] for a
    /// number out of its range or an unsupported setting; the error names the actuator. Nothing is changed then.
    pub fn randomize_all(
        &mut self,
        assigned: &[(Parameter, Option<&[f64]>)],
        actuators: ActuatorNumbers<'_>,
        envs: &[usize],
    ) -> Result<(), Error> {
        self.check_envs(envs)?;
        // Nothing may change if an argument is invalid: actuator models are checked here, and fields before they are stored.
        let update = self.actuator_update(actuators, envs)?;
        if !assigned.is_empty() {
            self.assign_parameters(assigned, envs)?;
        }
        if let (Some(actuator_models), Some(update)) = (&mut self.actuator_models, update) {
            with_batch!(&mut self.engine, batch => batch.assign_actuator_parameters(&update.specs, &update.envs));
            actuator_models.per_env = update.per_env;
            self.invalidate_caches();
        }
        Ok(())
    }

    /// Restores the model's parameters, and the actuator parameters of [`Simulation::set_actuator_models`], in the environments `envs`,
    /// ascending.
    ///
    /// # Errors
    /// [`Error::Environment`] or [`Error::Order`] for `envs`.
    pub fn reset_parameters(&mut self, envs: &[usize]) -> Result<(), Error> {
        let all: Vec<(Parameter, Option<&[f64]>)> = self.per_env_fields().map(|(parameter, _)| (parameter, None)).collect();
        self.randomize_all(&all, ActuatorNumbers::Original, envs)
    }

    fn assign_parameters(&mut self, assigned: &[(Parameter, Option<&[f64]>)], envs: &[usize]) -> Result<(), Error> {
        let assigned = assigned.iter().map(|&(parameter, values)| self.assignment(parameter, values)).collect::<Result<Vec<_>, _>>()?;
        if self.randomization.leaves_no_fields(&assigned, envs.len() == self.num_envs) {
            self.randomization = Randomization::default();
            with_batch!(self.engine_mut(), batch => batch.clear_overrides());
            return Ok(());
        }
        let differences = self.parameter_differences(&assigned, envs)?;
        self.randomization.store_fields(&self.model, self.num_envs, &assigned, envs);
        with_batch!(self.engine_mut(), batch => {
            batch.overrides.store_differences(&batch.compiled.params, batch.groups.len(), batch.lanes, envs, &differences);
        });
        Ok(())
    }

    /// Computes new parameters of the actuator models for the environments `envs`, and checks them. The simulation does not change.
    /// The result is `None` if no actuator has a model, or if `actuators` is `Kept`.
    fn actuator_update(&self, actuators: ActuatorNumbers<'_>, envs: &[usize]) -> Result<Option<ActuatorUpdate>, Error> {
        let specs = match actuators {
            ActuatorNumbers::Kept => return Ok(None),
            ActuatorNumbers::Original => None,
            ActuatorNumbers::Given(specs) => Some(specs),
        };
        specs.map_or(Ok(()), |specs| check_count("drives", specs.len(), self.model.nu(), "actuator"))?;
        let h = self.timestep();
        match (&self.actuator_models, specs) {
            (Some(actuator_models), _) => Ok(Some(actuator_models.prepare_update(&self.model, specs, envs, self.num_envs, h)?)),
            (None, None) => Ok(None),
            (None, Some(specs)) => {
                // No actuator has a model, so that the call below returns an error if any entry of `specs` is not an ideal actuator.
                let none = ActuatorModels::new(&self.model, &vec![None; specs.len()], self.num_envs, h)?;
                none.prepare_update(&self.model, Some(specs), envs, self.num_envs, h)?;
                Ok(None)
            }
        }
    }

    /// Actuator models of all environments, one entry for every actuator. Each parameter is a list of one number for all
    /// environments, or of one number for each environment. `None` without actuator models, until their
    /// parameters change, and after a call that restores all environments.
    pub fn per_env_actuators(&self) -> Option<&[Option<ActuatorSpec>]> {
        self.actuator_models.as_ref()?.per_env.as_deref()
    }

    /// Names of the actuators whose controls act on later steps too (delay, lag, sampled servo, integral), in any environment.
    pub fn actuators_with_memory(&self) -> Vec<String> {
        let Some(models) = &self.actuator_models else { return vec![] };
        let has_memory = |spec: Option<&Option<ActuatorSpec>>| spec.and_then(Option::as_ref).is_some_and(ActuatorSpec::has_memory);
        let per_env = models.per_env.as_deref().unwrap_or_default();
        let actuators = self.model.actuators.iter().enumerate();
        let with_memory = actuators.filter(|&(i, _)| has_memory(models.specs.get(i)) || has_memory(per_env.get(i)));
        with_memory.map(|(i, actuator)| label(&actuator.name, i)).collect()
    }

    /// Parameters that differ from the compiled model's, for each of the environments `envs`, with the actuator models and after the
    /// assignments `assigned` ([`Randomization::differences`]).
    fn parameter_differences(&self, assigned: &[Assignment<'_>], envs: &[usize]) -> Result<Vec<Differences>, ModelError> {
        let Some(ActuatorModels { specs, .. }) = &self.actuator_models else {
            return self.randomization.differences(&self.model, self.shared_model(), None, assigned, envs);
        };
        let with_actuator_models = |variant: &Model| {
            // `specs` already include the actuator delays of the model, so that the variant must not add them again.
            let combined = ActuatorSpec::combine(&variant.without_actuator_delays(), specs, self.num_envs, self.timestep());
            combined.expect("actuator models that were checked with the model, whose structure the variant has").0
        };
        self.randomization.differences(&self.model, self.shared_model(), Some(&with_actuator_models), assigned, envs)
    }

    /// Assignment of a field: its name and `values`, after checks of their number and size.
    fn assignment<'a>(&self, parameter: Parameter, values: Option<&'a [f64]>) -> Result<Assignment<'a>, Error> {
        let name = parameter.name();
        let must = self.num_envs * self.model.field(name).expect("a field of the model").1.len();
        if let Some(&value) = values.and_then(|values| values.iter().find(|&&x| x.is_finite() && self.is_too_large(x))) {
            return Err(Error::ParameterTooLarge { parameter, value });
        }
        check_length(name, values.map_or(must, <[f64]>::len), must)?;
        Ok((name, values))
    }

    /// Per-environment fields of the model, with their values. Each array has one row per environment, with all values of the field.
    pub fn per_env_fields(&self) -> impl Iterator<Item = (Parameter, &[f64])> {
        self.randomization.fields().map(|(name, values)| (name.parse().expect("the name of a parameter"), values))
    }

    /// Memory of per-environment parameters, including those of actuator models, bytes.
    pub fn parameter_bytes(&self) -> usize {
        self.randomization.bytes()
            + with_batch!(&self.engine, batch => batch.parameter_bytes())
            + self.actuator_models.as_ref().map_or(0, ActuatorModels::bytes)
    }

    /// Compiled model of environment `env` with its parameters, in f64.
    pub(super) fn lane_model_of(&self, env: usize) -> Cow<'_, LaneModel<f64>> {
        let shared = self.shared_model();
        if self.randomization.is_empty() {
            return Cow::Borrowed(shared);
        }
        let differences = self.parameter_differences(&[], &[env]).expect("fields that were checked when they were assigned");
        let mut compiled = shared.clone();
        compiled.params.set(&differences[0]);
        Cow::Owned(compiled)
    }
}
