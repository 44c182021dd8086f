//! Interface for benchmarks and tests of this workspace, with the feature `internals`.

use std::sync::Arc;

use stepper_real::Level;

use crate::batch::engine::{Engine, with_batch};
use crate::batch::simulation::Simulation;
use crate::batch::worker::MakeWorker;
use crate::compile::LaneModel;
use crate::math::precision::Precision;
use crate::model::Model;
use crate::options::Options;

impl Simulation {
    /// Creates a simulation on the CPU level `level`, independent of the environment variable. The ranges of the options are not checked.
    ///
    /// # Panics
    /// When `num_envs` is 0.
    #[doc(hidden)]
    pub fn at_level(
        model: Arc<Model>,
        options: Options,
        num_envs: Option<usize>,
        precision: Precision,
        threads: usize,
        level: Level,
    ) -> Self {
        assert_ne!(num_envs, Some(0), "num_envs must be 1 or more, or None for a single environment");
        Self::make(model, options, num_envs, precision, threads, level).expect("valid options, and memory for the environments")
    }

    /// Sets the functions that create workers, for example workers with a probe in their steps.
    #[doc(hidden)]
    pub fn set_workers(&mut self, f64: MakeWorker<f64>, f32: MakeWorker<f32>) {
        match self.engine_mut() {
            Engine::F64(batch) => batch.workers.set_maker(f64),
            Engine::F32(batch) => batch.workers.set_maker(f32),
        }
    }

    /// Fills the work buffers of each step with NaN. An environment then diverges if a step reads a number before it is computed.
    #[doc(hidden)]
    pub fn poison(&mut self) {
        with_batch!(self.engine_mut(), batch => batch.settings.poison = true);
    }

    /// Compiled model in f64.
    #[doc(hidden)]
    pub fn compiled(&self) -> &LaneModel<f64> {
        self.shared_model()
    }
}
