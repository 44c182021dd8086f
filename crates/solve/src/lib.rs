//! Contact and constraint impulses: friction cones, the constraint problem, its solvers, and the residual, which gives the error of a
//! solution.
//!
//! This crate has no bodies, no shapes and no Python. Its input is rows `y_i` in a space whose metric is the identity (`y = D^-1/2 L^-T
//! J^T` for a mass matrix `M = L^T D L`). The Delassus matrix is then `G = Y^T Y`. The solvers find impulses `lambda` such that
//!
//! ```text
//! w = sum_i y_i lambda_i             the change of the scaled velocity
//! v_i = y_i . w + R_i lambda_i + g_i the velocity in row i; g_i = J_i v_free + bias; R_i >= 0 is its compliance, 0 for a hard row
//!
//! scalar rows:   lo <= lambda <= hi, complementary to v (equalities, limits, dry friction)
//! contacts:      K contains lambda, K* contains u, lambda . u = 0   with u = v + (mu |v_t|, 0, 0)
//! ```
//!
//! K is the friction cone and K* its dual cone. The condition for contacts is the exact Coulomb law with Signorini's condition in De Saxce
//! and Feng's form (1998). A sweep is one Gauss-Seidel iteration over all rows. The Delassus matrix is never formed: a sweep costs time in
//! proportion to the entries of the rows.
//!
//! No solve changes the [`Problem`]. Each row has a target for the velocity solve and one for the position solve.
//! A solve reads a [`System`], that of the problem or that of [`PositionRows`].
//!
//! The interface is generic over [`Real`](stepper_real::Real): one environment, or one per SIMD lane. Newton's method computes one lane at
//! a time, in f64. The files `scalar.rs` and `friction.rs` in `constraints/` have the two kinds of constraints: scalar rows, and
//! contacts with any number of rows. They have the operations of the kind in a sweep, in the residual, in Newton's method and in the
//! position solve.

mod admissible_set;
mod capacity;
pub mod cone;
mod constraints;
mod entries;
mod file;
pub mod gauss_seidel;
mod iterate;
pub mod newton;
mod outcome;
mod position_rows;
mod problem;
mod reference;
mod residual;
pub mod soft;
mod solver;
mod vectors;

pub use admissible_set::AdmissibleSet;
pub use capacity::Capacity;
pub use constraints::constraint_set::{ConstraintBase, Damping};
pub use constraints::friction::{FrictionContact, FrictionContacts, MAX_CONTACT_ROWS, RowCount};
pub use constraints::local_solver::LocalSolver;
pub use constraints::orthogonalisation::{EntryScales, ROUNDING_RATIO, RowScales, dependence_threshold, velocity_rounding};
pub use constraints::scalar::{ScalarRow, ScalarRows};
pub use file::{FORMAT_VERSION, FileError, LoadedProblem};
pub use iterate::{Iterate, Snapshot};
pub use outcome::Outcome;
pub use position_rows::PositionRows;
pub use problem::{Problem, System};
pub use reference::Reference;
pub use residual::{energy_is_ambiguous, for_each_load, max_residual_for_energy, residual, worst_constraint};
pub use solver::{PASSES, Settings, solve};
