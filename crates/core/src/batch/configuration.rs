//! Configuration of a batch without its state: settings, sensor and actuator models, and per-environment parameters.

use crate::actuation::{ActuatorPipelines, ActuatorSpec, memory};
use crate::batch::capacity::{bytes_per_env, check_memory};
use crate::batch::environments::{Batch, compile, make_groups};
use crate::batch::parameter_overrides::ParameterOverrides;
use crate::batch::worker::LaneScalar;
use crate::error::Error;
use crate::model::Model;
use crate::sensing::errors::{Errors, Transfer};

impl<S: LaneScalar> Batch<S> {
    /// Sets the transfer functions of the sensors, one entry for every sensor. `None` makes a sensor ideal (without errors).
    ///
    /// # Errors
    /// [`Error::Sensor`] for a number out of its range, [`Error::Memory`].
    pub(super) fn set_sensor_models(&mut self, model: &Model, transfers: &[Option<Transfer>]) -> Result<(), Error> {
        let errors = Errors::new(model, transfers, self.num_envs, self.lanes, self.settings.timestep)?;
        let readings = if errors.is_empty() { 0 } else { self.compiled.sensing.width };
        check_memory(self.num_envs, (errors.memory + readings) * size_of::<S>() + 3 * errors.lines * size_of::<usize>())?;
        // The workspace of an idle worker fits the previous sensor models only.
        self.workers.idle_workers().clear();
        for group in &mut self.groups {
            group.sensing.with_errors(errors.memory, errors.lines, readings);
            group.sensing.waiting = group.alive;
        }
        self.sensor_errors = (!errors.is_empty()).then_some(errors);
        Ok(())
    }

    /// Sets the actuator models, one entry for every actuator. `None` is an actuator without a model. The new groups are at the
    /// model's reset state; the caller resets the environments completely.
    ///
    /// The caller gets both arguments from [`ActuatorSpec::combine`], which adds delays and force limits of the model's actuators to the
    /// specs.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub(super) fn set_actuator_models(&mut self, model: &Model, specs: &[Option<ActuatorSpec>]) -> Result<(), Error> {
        let (compiled, h) = (compile(model, specs, &self.settings), self.settings.timestep);
        // The pipelines of a single group give the memory per environment. It is checked before anything is allocated for all environments.
        let of_group = ActuatorPipelines::<S>::new(specs, self.lanes.min(self.num_envs), self.lanes, h);
        let stored = (of_group.memory + model.nu()) * size_of::<S>() + of_group.lines * size_of::<usize>();
        check_memory(self.num_envs, bytes_per_env(&compiled, self.max_contacts) + stored + of_group.bytes().div_ceil(self.lanes))?;
        self.compiled = compiled;
        self.workers.idle_workers().clear();
        self.groups = make_groups(model, &self.compiled, self.num_envs, self.lanes, self.max_contacts);
        let pipelines = ActuatorPipelines::new(specs, self.num_envs, self.lanes, h);
        if !pipelines.is_empty() {
            for group in &mut self.groups {
                group.actuation = memory::Memory::with_capacity(self.lanes, group.alive, pipelines.memory, pipelines.lines, model.nu());
            }
            self.pipelines = Some(pipelines);
        }
        Ok(())
    }

    /// Sets new parameters of actuator models in the environments `envs`. `None` does not change an actuator.
    ///
    /// Each list of a spec has one number for all of `envs`, or one number for each of them.
    pub(super) fn assign_actuator_parameters(&mut self, specs: &[Option<ActuatorSpec>], envs: &[usize]) {
        if let Some(pipelines) = &mut self.pipelines {
            pipelines.set_parameters(specs, envs, self.settings.timestep);
        }
    }

    /// Restores the model's parameters in all environments.
    pub(super) fn clear_overrides(&mut self) {
        self.overrides = ParameterOverrides::default();
        // The lane models of idle workers still have the overridden parameters, so that these workers are discarded.
        self.workers.idle_workers().clear();
    }

    /// Memory of per-environment parameters, including those of actuator models, bytes.
    pub(super) fn parameter_bytes(&self) -> usize {
        self.overrides.bytes() + self.pipelines.as_ref().map_or(0, ActuatorPipelines::bytes)
    }
}
