//! The rows of the constraint problem: contacts, joint limits, dry friction, equalities and tendons, with their Jacobians and demands.

pub(crate) mod active_equalities;
pub(crate) mod approaching;
pub mod assembled_rows;
pub mod constraint_set;
pub mod contact;
pub mod contact_spring;
pub mod curvature;
pub mod demands;
pub mod dry_friction;
pub mod elimination;
pub mod equality;
pub mod equality_violation;
pub mod hyperstatic;
pub mod impact_time;
pub mod islands;
pub mod jacobian;
pub mod limits;
pub mod restitution;
pub mod rows;
pub mod soft;
pub(crate) mod solved_overlaps;
pub mod tendon;
pub mod torsional_rolling;
pub mod worst_row;

pub use assembled_rows::AssembledRows;
pub use constraint_set::*;
