//! The constraint problem of a step with its room to work: what stage 4 makes, stage 5 solves and stage 8 solves again.

use stepper_real::{Mask, Real};
use stepper_solve::{Iterate, Problem};

use crate::plan::Plan;
use crate::spatial::*;

/// The constraint problem of a step, and which of the model's elements its rows belong to.
#[derive(Clone, Debug)]
pub struct Constraints<R: Real> {
    /// The rows.
    pub problem: Problem<R>,
    /// The impulses.
    pub iterate: Iterate<R>,
    /// Lanes that have any row.
    pub constrained: R::Mask,
    /// Lanes in which the velocities of the solution are not those that the positions should move with.
    pub needs_position_solve: R::Mask,
    /// What each row demands of the positions alone: velocity g of stage 8, scalar rows first.
    pub position_bias: Vec<R>,
    /// Impulses of limits, then of dry friction, by their index in the plan: the warm start.
    pub scalar_impulse: Vec<R>,
    /// Index in `scalar_impulse` of every scalar row.
    pub owners: Vec<usize>,
    pub(crate) column: Vec<V3<R>>,
    pub(crate) support: Vec<u32>,
    pub(crate) plus: Vec<u32>,
    pub(crate) minus: Vec<u32>,
    pub(crate) words: Vec<u64>,
}

/// What the rows are made from.
#[derive(Clone, Copy, Debug)]
pub struct Moment<'a, R: Real> {
    /// Configuration at which the rows are taken.
    pub q: &'a [R],
    /// Velocity before the step.
    pub v: &'a [R],
    /// Velocity after the step without constraints.
    pub v_free: &'a [R],
    /// Time step, s.
    pub h: R,
    /// Environments that step.
    pub alive: R::Mask,
}

impl<R: Real> Constraints<R> {
    /// Room for a plan.
    pub fn new(plan: &Plan<R::Scalar>, max_contacts: usize) -> Self {
        let scalars = plan.limits.len() + plan.frictions.len();
        Self {
            problem: Problem::with_capacity(plan.nv, scalars, max_contacts),
            iterate: Iterate::with_capacity(plan.nv, scalars, max_contacts),
            constrained: R::Mask::splat(false),
            needs_position_solve: R::Mask::splat(false),
            position_bias: Vec::with_capacity(scalars + max_contacts),
            scalar_impulse: vec![R::zero(); scalars],
            owners: Vec::with_capacity(scalars),
            column: vec![zero(); plan.nv],
            support: Vec::with_capacity(plan.nv),
            plus: vec![0; plan.nv],
            minus: vec![0; plan.nv],
            words: vec![0; plan.nv.div_ceil(64)],
        }
    }
}
