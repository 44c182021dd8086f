//! Stages 1 to 3 at the evaluation point of a step: when forces, contacts and rows are evaluated, and what a motion without constraints is.

pub(crate) mod evaluation;
pub(crate) mod first_impact;
pub(crate) mod free_motion;
pub(crate) mod locate;
pub(crate) mod mechanism_motion;
pub(crate) mod recomputed;
pub mod scheme;
