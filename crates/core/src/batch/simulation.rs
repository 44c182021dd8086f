//! A simulation: a model, its settings and a batch of environments. What the bindings translate.

mod calls;
mod checks;
mod derivatives;
#[cfg(feature = "internals")]
mod internals;
mod kinks;
#[cfg(feature = "nalgebra")]
mod matrices;
mod models;
mod parameters;
mod quantities;
mod rays;
mod read;
mod saved;
mod write;

pub use crate::batch::simulation::kinks::{Kinks, PerturbedCopies};
pub use crate::batch::simulation::parameters::ActuatorNumbers;
pub use crate::batch::simulation::read::{BodyPose, Certificate, Contact};

use std::fmt;
use std::sync::{Arc, OnceLock};

use stepper_real::Level;

use crate::actuation::ActuatorModels;
use crate::batch::engine::Engine;
use crate::batch::environments::Batch;
use crate::batch::inputs::AppliedInputs;
use crate::batch::randomization::Randomization;
use crate::batch::worker::LaneScalar;
use crate::compile::{CompiledModel, LaneModel, RaySurfaces};
use crate::error::Error;
use crate::math::precision::Precision;
use crate::model::Model;
use crate::options::{ContactLaw, Integrator, Options, StepSettings};

/// Environments of one model.
///
/// A clone has the same state, parameters and inputs in force, and moves with the same bits; its threads start at its first step.
#[derive(Clone)]
pub struct Simulation {
    model: Arc<Model>,
    options: Options,
    engine: Box<dyn Engine>,
    num_envs: usize,
    precision: Precision,
    digest: OnceLock<[u8; 32]>,
    compiled: OnceLock<LaneModel<f64>>,
    randomization: Randomization,
    actuator_models: Option<ActuatorModels>,
    /// Controls in force, (num_envs, nu): those of the last step until others are given.
    ctrl: Vec<f64>,
    applied: AppliedInputs,
    truth: TrueReadings,
    /// Surfaces of the geoms that rays have met so far.
    surfaces: RaySurfaces,
    /// Changes so far of what derived quantities depend on.
    revision: u64,
}

/// True readings of all sensors, as long as nothing changes that they depend on.
#[derive(Clone, Default)]
struct TrueReadings {
    known: bool,
    readings: Vec<f64>,
    /// Inputs that the user applied at that time, in the order of [`AppliedInput::ALL`](crate::batch::inputs::AppliedInput::ALL).
    applied: [Vec<f64>; 5],
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
    /// One environment in 64 bits at the model's reset state, with default options, on the thread that calls.
    ///
    /// # Errors
    /// Those of [`Simulation::new`].
    pub fn single(model: impl Into<Arc<Model>>) -> Result<Self, Error> {
        Self::new(model, Options::default(), None, Precision::F64, 1)
    }

    /// `num_envs` environments at the model's reset state; `None` is a single one. `threads` 0 means all that this process may use.
    ///
    /// # Errors
    /// [`Error::Option`] for an option out of its range; [`Error::NoEnvironments`] for `Some(0)`; [`Error::Level`] when the CPU level asked
    /// for by `STEPPER_CPU_LEVEL` is not there; [`Error::Memory`] when the memory is too small for that many environments; [`Error::Model`]
    /// for a number that 32 bits cannot hold, in that precision; [`Error::Actuator`] for a delay of an actuator that is too long for the
    /// time step.
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
        let mut simulation = Self::make(model, options, num_envs, precision, threads, level, true)?;
        if simulation.model.actuators.iter().any(|a| a.delay > 0.0) {
            let specs = vec![None; simulation.model.nu()];
            simulation.set_actuator_models(&specs)?;
        }
        Ok(simulation)
    }

    fn make(
        model: Arc<Model>,
        options: Options,
        num_envs: Option<usize>,
        precision: Precision,
        threads: usize,
        level: Level,
        check: bool,
    ) -> Result<Self, Error> {
        /// Environments in one scalar type.
        fn engine<S: LaneScalar>(
            model: &Model,
            settings: StepSettings,
            num_envs: usize,
            threads: usize,
            level: Level,
            check: bool,
        ) -> Result<Box<dyn Engine>, Error> {
            Ok(Box::new(Batch::<S>::new(model, settings, num_envs, threads, level, check)?))
        }
        if options.contact == ContactLaw::Mujoco
            && let Some(tendon) = model.tendons.iter().find(|t| t.armature > 0.0)
        {
            let must = "hard where a tendon has an armature, which MuJoCo's law does not have here; or give it none";
            return Err(Error::Option { name: "contact", found: format!("mujoco, and tendon {:?} has an armature", tendon.name), must });
        }
        let n = num_envs.unwrap_or(1);
        let gravity = model.gravity.iter().map(|g| g * g).sum::<f64>().sqrt();
        let asked = model.requested.as_ref().and_then(|asked| Integrator::of_source(&asked.integrator));
        let settings = options.resolve(model.timestep, gravity, asked, precision)?;
        let engine = match precision {
            Precision::F64 => engine::<f64>(&model, settings, n, threads, level, check)?,
            Precision::F32 => engine::<f32>(&model, settings, n, threads, level, check)?,
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

    /// The model.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// The settings as they were given.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Time step in force, s: that of the options, or the model's.
    pub fn timestep(&self) -> f64 {
        self.engine.settings().timestep
    }

    /// Residual at which the solver stops, in force, m/s: that of the options, or [`Precision::tolerance`],
    /// with MuJoCo's law no more than 0.6 % of what gravity changes of a velocity in a step.
    pub fn tolerance(&self) -> f64 {
        self.engine.settings().tolerance
    }

    /// Scalar type of the lanes.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// Number of environments.
    pub fn num_envs(&self) -> usize {
        self.num_envs
    }

    /// Threads that step: never more than there are groups of lanes to step.
    pub fn threads(&self) -> usize {
        self.engine.threads()
    }

    /// Memory of the state of all environments and of readings that are kept, bytes.
    pub fn bytes(&self) -> usize {
        let TrueReadings { readings, applied, .. } = &self.truth;
        let kept = readings.len() + applied.iter().map(Vec::len).sum::<usize>();
        self.engine.bytes() + kept * size_of::<f64>()
    }

    /// Memory of what waits for the next step, bytes: controls in force and what the user applies.
    pub fn input_bytes(&self) -> usize {
        size_of_val(&self.ctrl[..]) + self.applied.bytes()
    }

    /// Calls `look` while the workspace of one more thread is there, as the first step makes it for every thread: so that it can be
    /// measured.
    pub fn with_worker(&self, mut look: impl FnMut()) {
        self.engine.with_worker(&mut look);
    }

    /// The engine, to be changed: what sensors read may be something else then.
    fn engine_mut(&mut self) -> &mut dyn Engine {
        self.note_change();
        &mut *self.engine
    }

    /// Takes note that readings and derived quantities may be others from now on.
    fn note_change(&mut self) {
        self.truth.known = false;
        self.revision += 1;
    }

    /// Number that is another after every change of what [`Simulation::derive`] reads: states, parameters, controls in force, and what is
    /// applied.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The model as the step reads it, in f64.
    fn lane_model(&self) -> &LaneModel<f64> {
        self.compiled.get_or_init(|| {
            LaneModel::new(&match &self.actuator_models {
                Some(actuator_models) => CompiledModel::with_actuator_specs(&actuator_models.model, &actuator_models.specs),
                None => CompiledModel::new(&self.model),
            })
        })
    }
}
