//! Rows of MuJoCo's contact law: Jacobians in the coordinates of the joints, reference accelerations and regularisation (MuJoCo's
//! documentation, "Constraint model"; `engine_core_constraint.c`).
//!
//! Errors, Jacobians and laws are MuJoCo's, row by row, so that one step from the same state gives the same velocity. What a limit's margin
//! means is in the range of the joint, and distances of contacts are measured from the margin of the pair.

mod assembly;
mod contacts;
mod effective_mass;
mod equalities;
mod frames;
mod input;
mod rows;
mod slip;
mod system;
mod visit_order;

pub use effective_mass::EffectiveMass;
pub use input::SoftInput;
pub use system::SoftSystem;
