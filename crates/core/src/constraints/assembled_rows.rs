//! The rows of a step as the stages after the fourth read them.

use stepper_real::Real;
use stepper_solve::Problem;

use crate::math::spatial::*;

/// Rows of a step, which no solve changes.
#[derive(Clone, Copy, Debug)]
pub struct AssembledRows<'a, R: Real> {
    /// The constraint problem.
    pub problem: &'a Problem<R>,
    /// See [`Constraints::owners`](crate::constraints::Constraints::owners).
    pub owners: &'a [usize],
    /// See [`Constraints::slots`](crate::constraints::Constraints::slots).
    pub slots: &'a [(usize, R::Mask)],
    /// See [`Constraints::rolling_slots`](crate::constraints::Constraints::rolling_slots).
    pub rolling_slots: &'a [(usize, R::Mask, V3<R>)],
    /// See [`Constraints::needs_position_solve`](crate::constraints::Constraints::needs_position_solve).
    pub needs_position_solve: R::Mask,
    /// See [`Constraints::biased`](crate::constraints::Constraints::biased).
    pub biased: R::Mask,
    /// See [`Constraints::rebounding`](crate::constraints::Constraints::rebounding).
    pub rebounding: R::Mask,
}
