//! Parameters that environments have of their own.

use std::borrow::Cow;

use super::{Error, Simulation};
use crate::actuation::DriveTrain;
use crate::model::{Model, ModelError, randomizable};
use crate::plan::LanePlan;
use crate::theta::{Assignment, Differences, Theta};

impl Simulation {
    /// Gives the environments `envs`, ascending, numbers of their own in some fields. Other fields and the state stay what they are.
    ///
    /// # Errors
    /// [`Error::Model`] for a field that is not in [`RANDOMIZABLE`](crate::model::RANDOMIZABLE), or numbers that make no model or one of
    /// another structure, with the environment; [`Error::Value`] for an array of the wrong length. Nothing is changed then.
    pub fn randomize(&mut self, assigned: &[(&str, Option<&[f64]>)], envs: &[usize]) -> Result<(), Error> {
        let assigned = assigned.iter().map(|&(name, values)| self.assignment(name, values)).collect::<Result<Vec<_>, _>>()?;
        if self.theta.ends_with(&assigned, envs.len() == self.num_envs) {
            self.theta = Theta::default();
            self.engine.randomize(envs, None);
            return Ok(());
        }
        let differences = self.differences(&assigned, envs)?;
        self.theta.assign(&self.model, self.num_envs, &assigned, envs);
        self.engine.randomize(envs, Some(&differences));
        Ok(())
    }

    fn differences(&self, assigned: &[Assignment<'_>], envs: &[usize]) -> Result<Vec<Differences>, ModelError> {
        let Some((_, trains)) = &self.driven else {
            return self.theta.differences(&self.model, self.plan(), None, assigned, envs);
        };
        let driven = |variant: &Model| {
            let mut variant = variant.clone();
            // The trains have taken over the delays already.
            variant.actuators.iter_mut().for_each(|a| a.delay = 0.0);
            let folded = DriveTrain::fold(&variant, trains, self.num_envs, self.options.timestep);
            folded.expect("drive trains were checked with the model, and a variant has its structure").0
        };
        self.theta.differences(&self.model, self.plan(), Some(&driven), assigned, envs)
    }

    fn assignment<'a>(&self, name: &str, values: Option<&'a [f64]>) -> Result<Assignment<'a>, Error> {
        let field = randomizable(name)?;
        let must = self.num_envs * self.model.field(name).expect("a field of the model").1.len();
        match values.map_or(must, <[f64]>::len) {
            found if found == must => Ok((field.name, values)),
            found => Err(Error::Value(format!("{name} has {found} numbers, must have {must}"))),
        }
    }

    /// Numbers that environments have of their own.
    pub fn theta(&self) -> &Theta {
        &self.theta
    }

    /// Memory of parameters that environments have of their own, bytes.
    pub fn parameter_bytes(&self) -> usize {
        self.theta.bytes() + self.engine.parameter_bytes()
    }

    /// The plan of one environment, in f64.
    pub fn plan_of(&self, env: usize) -> Cow<'_, LanePlan<f64>> {
        let shared = self.plan();
        if self.theta.is_empty() {
            return Cow::Borrowed(shared);
        }
        let own = self.differences(&[], &[env]).expect("checked when it was assigned");
        let mut plan = shared.clone();
        plan.params.set(&own[0]);
        Cow::Owned(plan)
    }
}
