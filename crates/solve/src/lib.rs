//! Contact and constraint impulses: cones, the problem, the solvers, and the residual that certifies their answer.
//!
//! This crate knows no bodies, no shapes and no Python. It is given rows `y_i` in a space where the metric is the identity
//! (`y = D^-1/2 L^-T J^T` for a mass matrix `M = L^T D L`), so that the Delassus matrix is `G = Y^T Y`, and it finds impulses `lambda`
//! such that
//!
//! ```text
//! w = sum_i y_i lambda_i             the change of the scaled velocity
//! v_i = y_i . w + R_i lambda_i + g_i the velocity in row i; g_i = J_i v_free + bias; R_i >= 0 is its compliance, 0 when it is hard
//! scalar rows:   lo <= lambda <= hi, complementary to v (equalities, limits, dry friction)
//! contacts:      K contains lambda, K* contains u, lambda . u = 0   with u = v + (mu |v_t|, 0, 0)
//! ```
//!
//! The last line is the exact Coulomb law with Signorini's condition in De Saxce and Feng's form (1998). The Delassus matrix is never formed: a
//! sweep costs time in proportion to the entries of the rows.
//!
//! Everything is written once over [`Real`](stepper_real::Real): one environment, or one per SIMD lane.

mod anderson;
mod aside;
pub mod cone;
mod contact;
mod damping;
mod entries;
pub mod newton;
mod orthogonal;
pub mod pgs;
mod problem;
mod residual;
mod tiers;
mod wide;

pub use contact::ContactBlock;
pub use damping::Reference;
pub use orthogonal::dependence;
pub use problem::{Capacity, Iterate, Problem, Saved, ScalarRow};
pub use residual::{residual, undecided};
pub use tiers::{Outcome, PASSES, Settings, solve};
pub use wide::WideBlock;
