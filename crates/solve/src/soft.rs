//! Soft constraints: the regularised convex problem of MuJoCo's documentation (computation chapter, "Constraint model"; Todorov 2014,
//! "Convex and analytically-invertible dynamics with contacts and constraints").
//!
//! The unknown is the acceleration a that minimises
//!
//! ```text
//! 1/2 (a - a0)^T M (a - a0) + s(J a - r)
//! ```
//!
//! Here a0 is the acceleration without constraints, and r the reference acceleration of each row. The convex function s is quadratic where
//! a row pushes. Its slope is minus the constraint force. The sum is strictly convex, so that there is one solution, which determines all
//! forces.
//!
//! All code is generic over [`Real`](stepper_real::Real), like the rest of this crate. The coordinates are those of the joints, in which M
//! has the sparsity of the trees, and a row of a joint limit has a single entry.

mod cone;
mod contact;
mod hessian;
mod lane_solver;
mod newton;
mod noslip;
mod problem;

pub use cone::Cone;
pub use contact::SoftContact;
pub use lane_solver::LaneSolver;
pub use newton::{Effort, SoftOutcome, SoftSolver};
pub use noslip::{ContactVisit, SlipCapacity, SlipEffort};
pub use problem::{Metric, SoftContacts, SoftProblem, SoftRow};
