//! Simulation: a model, its options and a batch of environments. The Python bindings translate its interface.

mod calls;
mod checks;
#[cfg(feature = "internals")]
mod internals;
#[cfg(feature = "nalgebra")]
mod matrices;
mod models;
mod parameters;
mod quantities;
mod rays;
mod read;
mod saved;
mod visits;
mod write;

pub use crate::batch::environments::Outcome;
pub use crate::batch::simulation::parameters::ActuatorNumbers;
pub use crate::batch::simulation::read::{BodyPose, Contact};

use std::fmt;
use std::sync::{Arc, OnceLock};

use stepper_real::Level;

use crate::actuation::ActuatorModels;
use crate::batch::engine::{Engine, with_batch};
use crate::batch::environments::Batch;
use crate::batch::inputs::AppliedInputs;
use crate::batch::randomization::Randomization;
use crate::compile::{CompiledModel, LaneModel, RaySurfaces};
use crate::error::Error;
use crate::math::precision::Precision;
use crate::model::Model;
use crate::options::{ModelScales, Options};

/// Simulation of many environments of one model.
///
/// A clone has the same state, parameters and inputs in force, and gives the same bits. The clone starts separate threads at its first
/// step.
#[derive(Clone)]
pub struct Simulation {
    model: Arc<Model>,
    options: Options,
    engine: Engine,
    num_envs: usize,
    precision: Precision,
    /// Digest of the model, computed when it is first needed.
    digest: OnceLock<[u8; 32]>,
    /// Compiled model in f64, made when it is first needed.
    compiled: OnceLock<LaneModel<f64>>,
    randomization: Randomization,
    actuator_models: Option<ActuatorModels>,
    /// Controls of all environments, (num_envs, nu). They stay in force until they are replaced.
    ctrl: Vec<f64>,
    applied: AppliedInputs,
    truth: TrueReadings,
    /// Cache of the meshes and height fields that rays can hit, filled as ray calls need them.
    surfaces: RaySurfaces,
    /// Counter of changes to the inputs of derived quantities and true readings.
    revision: u64,
}

/// Cache of the true readings of all sensors.
#[derive(Clone, Default)]
struct TrueReadings {
    /// Revision number of the simulation at which the readings were computed; `None` without readings.
    revision: Option<u64>,
    readings: Vec<f64>,
}

impl fmt::Debug for Simulation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut lines = f.debug_struct("Simulation");
        lines.field("model", &self.model.name).field("num_envs", &self.num_envs).field("precision", &self.precision);
        lines.field("timestep", &self.timestep()).field("threads", &self.threads()).field("options", &self.options);
        lines.finish_non_exhaustive()
    }
}

impl Simulation {
    /// Creates a simulation of one environment in 64 bits at the model's reset state, with default options, on the calling thread.
    ///
    /// # Errors
    /// The errors of [`Simulation::new`].
    pub fn single(model: impl Into<Arc<Model>>) -> Result<Self, Error> {
        Self::new(model, Options::default(), None, Precision::F64, 1)
    }

    /// Creates a simulation of `num_envs` environments at the model's reset state; `None` creates one environment. `threads` is the number
    /// of threads; 0 selects all that this process may use.
    ///
    /// # Errors
    /// [`Error::Option`] for an option out of its range; [`Error::NoEnvironments`] for `Some(0)`; [`Error::Level`] when the machine lacks
    /// the CPU level in `STEPPER_CPU_LEVEL`. [`Error::Memory`] when the memory is too small for that many environments. [`Error::Model`]
    /// for a number that a simulation in 32 bits cannot hold. [`Error::Actuator`] for an actuator delay that is too long for the time step.
    pub fn new(
        model: impl Into<Arc<Model>>,
        options: Options,
        num_envs: Option<usize>,
        precision: Precision,
        threads: usize,
    ) -> Result<Self, Error> {
        let model = model.into();
        options.check()?;
        if num_envs == Some(0) {
            return Err(Error::NoEnvironments);
        }
        if precision == Precision::F32 {
            model.check_range(f64::from(f32::MAX))?;
        }
        let level = Level::best()?;
        let mut simulation = Self::make(model, options, num_envs, precision, threads, level)?;
        if simulation.model.actuators.iter().any(|a| a.delay > 0.0) {
            let specs = vec![None; simulation.model.nu()];
            simulation.set_actuator_models(&specs)?;
        }
        Ok(simulation)
    }

    /// Creates a simulation at the model's reset state on the CPU level `level`, after a check of the available memory.
    fn make(
        model: Arc<Model>,
        options: Options,
        num_envs: Option<usize>,
        precision: Precision,
        threads: usize,
        level: Level,
    ) -> Result<Self, Error> {
        let n = num_envs.unwrap_or(1);
        let settings = options.resolve(&ModelScales::of(&model), precision)?;
        let engine = match precision {
            Precision::F64 => Engine::F64(Batch::new(&model, settings, n, threads, level)?),
            Precision::F32 => Engine::F32(Batch::new(&model, settings, n, threads, level)?),
        };
        let ctrl = vec![0.0; n * model.nu()];
        let mut simulation = Self {
            model,
            options,
            engine,
            num_envs: n,
            precision,
            digest: OnceLock::new(),
            compiled: OnceLock::new(),
            randomization: Randomization::default(),
            actuator_models: None,
            ctrl,
            applied: AppliedInputs::default(),
            truth: TrueReadings::default(),
            surfaces: RaySurfaces::default(),
            revision: 0,
        };
        (0..n).for_each(|env| simulation.reset(env));
        Ok(simulation)
    }

    /// Model of the simulation.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// Options as the user set them.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Time step in force, s: the options' time step if it is set, otherwise the model's.
    pub fn timestep(&self) -> f64 {
        self.settings().timestep
    }

    /// Largest residual at which the solver stops, m/s, see [`Options::tolerance`].
    pub fn tolerance(&self) -> f64 {
        self.settings().tolerance
    }

    /// Scalar type of the lanes.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// Number of environments.
    pub fn num_envs(&self) -> usize {
        self.num_envs
    }

    /// Number of threads that make steps, at most the number of groups of environments.
    pub fn threads(&self) -> usize {
        with_batch!(&self.engine, batch => batch.workers.threads)
    }

    /// Memory of the states of all environments and of cached readings, bytes.
    pub fn bytes(&self) -> usize {
        with_batch!(&self.engine, batch => batch.bytes()) + size_of_val(&self.truth.readings[..])
    }

    /// Memory of the inputs for the next step, bytes: controls in force and applied inputs.
    pub fn input_bytes(&self) -> usize {
        size_of_val(&self.ctrl[..]) + self.applied.bytes()
    }

    /// Calls `look` while one additional worker exists, to measure the memory of its workspace. Each thread allocates such a workspace at
    /// its first step.
    pub fn with_worker(&self, mut look: impl FnMut()) {
        with_batch!(&self.engine, batch => {
            let worker = batch.workers.make_worker(&batch.worker_spec());
            look();
            drop(worker);
        });
    }

    /// Mutable batch of the simulation. The call invalidates cached readings.
    fn engine_mut(&mut self) -> &mut Engine {
        self.invalidate_caches();
        &mut self.engine
    }

    /// Invalidates cached readings and derived quantities.
    fn invalidate_caches(&mut self) {
        self.revision += 1;
    }

    /// Revision number, which increases with every change to an input of [`Simulation::derive`]: states, parameters, controls, and applied
    /// inputs.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Compiled model in f64, with the parameters that environments share.
    fn shared_model(&self) -> &LaneModel<f64> {
        self.compiled.get_or_init(|| match &self.actuator_models {
            Some(actuator_models) => CompiledModel::with_actuator_specs(&actuator_models.model, &actuator_models.specs),
            None => CompiledModel::new(&self.model),
        })
    }
}
