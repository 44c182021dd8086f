//! Rows of MuJoCo's contact law: Jacobians in joint coordinates, reference accelerations and regularisation (MuJoCo's documentation,
//! "Constraint model"; `engine_core_constraint.c`).
//!
//! Errors, Jacobians and laws are MuJoCo's, row by row, so that one step from the same state gives the same velocity. The range of a joint
//! includes the margin of its limit, and distances of contacts count from the margin of the pair.

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
