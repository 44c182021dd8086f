//! Step of a group of environments, lent to crates that evaluate it again near its solution, as derivatives do.
//!
//! [`Simulation::visit_groups`](crate::Simulation::visit_groups) calls a [`GroupVisitor`] on the worker threads, once for every group of
//! environments that share the lanes of a SIMD type. The visitor uses the group's [`GroupStep`] in this order:
//!
//! 1. [`GroupStep::solve`] makes the step. The state before it is the nominal state from then on.
//! 2. [`GroupStep::evaluate_nominal`] runs stages 1 to 8 again at the nominal state, and shows every problem with its solution to an
//!    [`ImpulseRule`].
//! 3. [`GroupStep::displace`] changes one coordinate of the state. [`GroupStep::evaluate`] runs stages 1 to 8 there, with impulses that the
//!    rule sets in place of the solver. [`GroupStep::change`] computes the difference from the outcome of the solved step.
//! 4. [`GroupStep::finish`] ends the evaluations.
//!
//! Only `solve` repeats parts of the step until they are consistent. In an evaluation, exactly the contacts of the solved step are active.
//! A contact or limit that overlaps in the solved step is treated as an overlap in every evaluation, and a gap as a gap. Its target
//! velocity is therefore a smooth function of the displacement.
//!
//! The crate `stepper-derivative` differentiates steps with this module.

mod group;
mod hard;
mod nominal;
mod rule;

pub(crate) use group::GroupFunctions;
pub use group::{GroupStep, GroupVisitor};
pub use rule::{ConstraintNames, Gap, ImpulseProblem, ImpulseRule, NominalEvaluation, Prediction, Solve, SolvedStep, StatePart};

pub use crate::error::check_length;
pub use crate::integrators::evaluate::recomputed::Recomputed;
pub use crate::options::StepSettings;
