//! Rows of MuJoCo's contact law: Jacobians, reference accelerations and regularisation (MuJoCo's documentation, "Constraint model";
//! `engine_core_constraint.c`).
//!
//! Errors, Jacobians and laws equal MuJoCo's, row by row, so that one step from the same state gives the same velocity. The position error
//! of a joint limit includes the margin of the limit, and distances of contacts are measured from the margin of the pair.

mod assembly;
mod contacts;
mod equalities;
mod frames;
mod rows;
mod slip;
mod system;

pub(crate) use assembly::{SoftAssembler, SoftInput};
pub use system::SoftSystem;
