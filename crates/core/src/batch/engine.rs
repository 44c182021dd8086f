//! Batch of a simulation, in the scalar type of its precision.

use crate::batch::environments::Batch;

/// Batch of environments in the scalar type of a precision.
#[derive(Clone)]
pub(super) enum Engine {
    /// Batch in 64 bits.
    F64(Batch<f64>),
    /// Batch in 32 bits.
    F32(Batch<f32>),
}

/// Evaluates an expression with the batch of an engine, in either precision.
macro_rules! with_batch {
    ($engine:expr, $batch:ident => $result:expr) => {
        match $engine {
            $crate::batch::engine::Engine::F64($batch) => $result,
            $crate::batch::engine::Engine::F32($batch) => $result,
        }
    };
}
pub(super) use with_batch;
