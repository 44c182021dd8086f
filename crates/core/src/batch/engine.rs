//! Engine: interface through which a simulation calls a batch of environments, independent of the batch's precision.

use crate::batch::configuration::Configuration;
use crate::batch::environments::{Batch, Environments};
use crate::batch::ray_calls::RayCalls;
use crate::batch::saving::Saving;
use crate::batch::stepping::BatchCalls;
use crate::batch::worker::LaneScalar;

/// Batch of environments in any precision: steps, rays, configuration, access to the state of one environment, and saved states.
pub trait Engine: BatchCalls + Configuration + Environments + RayCalls + Saving + Send + Sync {
    /// Copy of the batch, with separate workers and threads.
    fn boxed_clone(&self) -> Box<dyn Engine>;
}

impl<S: LaneScalar> Engine for Batch<S> {
    fn boxed_clone(&self) -> Box<dyn Engine> {
        Box::new(self.clone())
    }
}

impl Clone for Box<dyn Engine> {
    fn clone(&self) -> Self {
        (**self).boxed_clone()
    }
}
