//! Stages 7 and 8: positions after a step, and their correction.

pub(crate) mod overlap_progress;
pub(crate) mod positions;
