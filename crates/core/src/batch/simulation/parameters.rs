//! Parameters that environments have of their own.

use std::borrow::Cow;

use crate::actuation::{ActuatorModels, ActuatorSpec, ResampledActuators};
use crate::batch::randomization::{Assignment, Differences, Randomization};
use crate::batch::simulation::{Error, Simulation};
use crate::compile::LaneModel;
use crate::math::precision::Precision;
use crate::model::{Model, ModelError, Parameter};

impl Simulation {
    /// Gives the environments `envs`, ascending, numbers of their own in some fields. Other fields and the state stay what they are.
    ///
    /// Arrays have rows for all environments, in the shape that each [`Parameter`] says; rows of environments that are not in `envs` are not read.
    /// `None` gives the model's own numbers back.
    ///
    /// # Errors
    /// [`Error::Environment`] or [`Error::Order`] for `envs`; [`Error::Length`] for an array of the wrong length; [`Error::ParameterTooLarge`];
    /// [`Error::Model`] for numbers that make no model or one of another structure, with the environment. Nothing is changed then.
    pub fn randomize(&mut self, assigned: &[(Parameter, Option<&[f64]>)], envs: &[usize]) -> Result<(), Error> {
        self.check_envs(envs)?;
        let assigned = assigned.iter().map(|&(parameter, values)| self.assignment(parameter, values)).collect::<Result<Vec<_>, _>>()?;
        if self.randomization.ends_with(&assigned, envs.len() == self.num_envs) {
            self.randomization = Randomization::default();
            self.engine_mut().randomize(envs, None);
            return Ok(());
        }
        let differences = self.differences(&assigned, envs)?;
        self.randomization.assign(&self.model, self.num_envs, &assigned, envs);
        self.engine_mut().randomize(envs, Some(&differences));
        Ok(())
    }

    /// What comes of drawing the numbers of drive trains anew for the environments `envs`, ascending: an entry for every actuator, with lists
    /// of one number or one for each of these; `None` leaves a train as it is. `trains` of `None` gives back what [`Simulation::set_actuator_models`] gave.
    /// Nothing is changed until [`Simulation::resample_actuators`].
    ///
    /// # Errors
    /// [`Error::Environment`] or [`Error::Order`] for `envs`; [`Error::Count`] when there is not one entry for every actuator; [`Error::Actuator`]
    /// for a number out of its range, or what the trains were not made for, with the actuator's name.
    pub fn resampled(&self, specs: Option<&[Option<ActuatorSpec>]>, envs: &[usize]) -> Result<Option<ResampledActuators>, Error> {
        self.check_envs(envs)?;
        if let Some(found) = specs.map(<[_]>::len).filter(|found| *found != self.model.nu()) {
            return Err(Error::Count { name: "drives", found, must: self.model.nu(), element: "actuator" });
        }
        let h = self.settings.timestep;
        match (&self.actuator_models, specs) {
            (Some(actuator_models), _) => {
                actuator_models.resample_actuators(&self.model, specs, envs, self.num_envs, h).map(Some).map_err(Error::Actuator)
            }
            (None, None) => Ok(None),
            (None, Some(specs)) => {
                // Trains that none was made with, so that whoever is given one hears of it.
                let none = ActuatorModels::new(&self.model, &vec![None; specs.len()], self.num_envs, h).map_err(Error::Actuator)?;
                none.resample_actuators(&self.model, Some(specs), envs, self.num_envs, h).map(|_| None).map_err(Error::Actuator)
            }
        }
    }

    /// Draws the numbers of drive trains anew. What the trains remember, and the rest of the state, stays.
    pub fn resample_actuators(&mut self, resampled: Option<ResampledActuators>) {
        if let (Some(actuator_models), Some(resampled)) = (&mut self.actuator_models, resampled) {
            self.truth.known = false;
            self.engine.resample_actuators(&self.settings, &resampled.specs, &resampled.envs);
            actuator_models.take(resampled);
        }
    }

    /// Drive trains as environments have them of their own, with lists of one number or one for each environment.
    pub fn drawn(&self) -> Option<&[Option<ActuatorSpec>]> {
        self.actuator_models.as_ref()?.drawn()
    }

    fn differences(&self, assigned: &[Assignment<'_>], envs: &[usize]) -> Result<Vec<Differences>, ModelError> {
        let Some(ActuatorModels { specs, .. }) = &self.actuator_models else {
            return self.randomization.differences(&self.model, self.compiled(), None, assigned, envs);
        };
        let actuator_models = |variant: &Model| {
            let mut variant = variant.clone();
            // The trains have taken over the delays already.
            variant.trusted_mut().actuators.iter_mut().for_each(|a| a.delay = 0.0);
            let folded = ActuatorSpec::fold(&variant, specs, self.num_envs, self.settings.timestep);
            folded.expect("drive trains were checked with the model, and a variant has its structure").0
        };
        self.randomization.differences(&self.model, self.compiled(), Some(&actuator_models), assigned, envs)
    }

    fn assignment<'a>(&self, parameter: Parameter, values: Option<&'a [f64]>) -> Result<Assignment<'a>, Error> {
        let name = parameter.name();
        let must = self.num_envs * self.model.field(name).expect("a field of the model").1.len();
        let beyond = |x: &&f64| self.precision == Precision::F32 && x.is_finite() && !(**x as f32).is_finite();
        if let Some(&value) = values.and_then(|values| values.iter().find(beyond)) {
            return Err(Error::ParameterTooLarge { parameter, value });
        }
        match values.map_or(must, <[f64]>::len) {
            found if found == must => Ok((name, values)),
            found => Err(Error::Length { name, found, must, detail: String::new() }),
        }
    }

    /// Numbers that environments have of their own.
    pub fn randomization(&self) -> &Randomization {
        &self.randomization
    }

    /// Memory of parameters that environments have of their own, and of the numbers of drive trains, bytes.
    pub fn parameter_bytes(&self) -> usize {
        self.randomization.bytes() + self.engine.parameter_bytes() + self.actuator_models.as_ref().map_or(0, ActuatorModels::bytes)
    }

    /// The compiled model of one environment, in f64.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn plan_of(&self, env: usize) -> Cow<'_, LaneModel<f64>> {
        self.assert_env(env);
        let shared = self.compiled();
        if self.randomization.is_empty() {
            return Cow::Borrowed(shared);
        }
        let own = self.differences(&[], &[env]).expect("checked when it was assigned");
        let mut compiled = shared.clone();
        compiled.params.set(&own[0]);
        Cow::Owned(compiled)
    }
}
