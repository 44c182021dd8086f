//! Setters of the sensor and actuator models of a simulation.

use std::sync::OnceLock;

use crate::actuation::{ActuatorModels, ActuatorSpec};
use crate::batch::engine::with_batch;
use crate::batch::simulation::{Error, Simulation};
use crate::error::check_count;
use crate::sensing::errors::Transfer;

impl Simulation {
    /// Sets the transfer functions of the sensors, one entry for every sensor. `None` makes a sensor ideal (without errors).
    ///
    /// # Errors
    /// [`Error::Count`] when `transfers` does not have one entry for every sensor, [`Error::Sensor`] for a number out of its
    /// range, with the sensor's name. [`Error::Memory`] when there is not enough memory for the sensors of all environments.
    pub fn set_sensor_models(&mut self, transfers: &[Option<Transfer>]) -> Result<(), Error> {
        check_count("transfers", transfers.len(), self.model.sensors.len(), "sensor")?;
        self.invalidate_caches();
        with_batch!(&mut self.engine, batch => batch.set_sensor_models(&self.model, transfers))
    }

    /// Sets the actuator models, one entry for every actuator. `None` is an actuator without a model. All environments are reset.
    ///
    /// # Errors
    /// [`Error::Count`] when `specs` does not have one entry for every actuator; [`Error::DrivesAfterParameters`] when there are
    /// per-environment parameters. [`Error::Actuator`] for a number out of its range or an unsupported setting, with the
    /// actuator's name. [`Error::Memory`] when there is not enough memory for the actuators of all environments.
    pub fn set_actuator_models(&mut self, specs: &[Option<ActuatorSpec>]) -> Result<(), Error> {
        check_count("drives", specs.len(), self.model.nu(), "actuator")?;
        if !self.randomization.is_empty() {
            return Err(Error::DrivesAfterParameters);
        }
        let actuator_models = ActuatorModels::new(&self.model, specs, self.num_envs, self.timestep())?;
        with_batch!(&mut self.engine, batch => batch.set_actuator_models(&actuator_models.model, &actuator_models.specs))?;
        (self.compiled, self.actuator_models) = (OnceLock::new(), Some(actuator_models));
        (0..self.num_envs).for_each(|env| self.reset(env));
        Ok(())
    }
}
