//! Rows of the constraint problem: contacts, joint limits, dry friction, equalities and tendons, with their Jacobians and target
//! velocities.

pub(crate) mod assembler;
pub mod constraint_problem;
pub mod contact;
pub mod equality;
pub(crate) mod evaluation_times;
pub mod islands;
pub mod jacobian;
pub mod joint;
pub mod position_solution;
pub(crate) mod row_builder;
pub mod rows;
pub mod soft;
pub(crate) mod solved_overlaps;
pub mod target_velocities;
pub mod velocity_solution;
pub mod worst_row;

pub use constraint_problem::{ConstraintProblem, ContactSlot};
pub use position_solution::PositionSolution;
pub use velocity_solution::VelocitySolution;
