//! Rows of the constraint problem: contacts, joint limits, dry friction, equalities and tendons, with their Jacobians and target
//! velocities.

pub(crate) mod active_equalities;
pub(crate) mod approaching;
pub(crate) mod assembler;
pub mod constraint_problem;
pub mod contact;
pub mod contact_spring;
pub mod curvature;
pub(crate) mod curvature_terms;
pub mod dry_friction;
pub mod elimination;
pub mod equality;
pub mod equality_violation;
pub(crate) mod evaluation_times;
pub mod impact_time;
pub mod islands;
pub mod jacobian;
pub mod limits;
pub mod position_solution;
pub mod redundant_supports;
pub mod restitution;
pub(crate) mod row_builder;
pub mod rows;
pub mod soft;
pub(crate) mod solved_overlaps;
pub mod target_velocities;
pub mod tendon;
pub mod torsional_rolling;
pub mod velocity_solution;
pub mod worst_row;

pub use constraint_problem::ConstraintProblem;
pub use position_solution::PositionSolution;
pub use velocity_solution::VelocitySolution;
