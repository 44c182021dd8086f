//! Rows of joints and tendons: limits, dry friction and tendon equalities.

pub mod dry_friction;
pub mod limits;
pub mod tendon;
