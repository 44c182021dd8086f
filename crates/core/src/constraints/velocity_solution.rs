//! Solution of the velocity problem: results of stages 5 (constraint solve) and 6 (integration of the velocity).

use stepper_real::Real;
use stepper_solve::newton::Newton;
use stepper_solve::{Iterate, Snapshot};

use crate::compile::ModelStructure;
use crate::constraints::constraint_problem::capacity_of;
use crate::constraints::contact::redundant_supports::ContactGroups;
use crate::constraints::islands::Islands;
use crate::constraints::worst_row::WorstRows;

/// Impulses of all constraints in a step, and the velocity after the step.
#[derive(Clone, Debug)]
pub struct VelocitySolution<R: Real> {
    /// Impulses in the order of the rows. Stage 8 starts from them and overwrites them.
    pub impulses: Iterate<R>,
    /// Velocity after the step, nv.
    pub v: Vec<R>,
    /// Impulses of all scalar constraints: limits, dry friction, ball joint limits, equalities and tendons. The next step's solve starts
    /// from them.
    pub scalar_impulse: Vec<R>,
    /// Contact groups, which are redundant supports. Stage 5 distributes the load evenly over the contacts of a group.
    pub(crate) contact_groups: ContactGroups<R>,
    /// Saved copy of the impulses, to restore them: from before a prediction, or before load sharing.
    pub(crate) saved_impulses: Snapshot<R>,
    /// Newton's method and its workspace, which stage 8 also uses.
    pub newton: Newton,
    /// Workspace for the islands of one lane: sets of kinematic trees that constraint rows connect.
    pub(crate) islands: Islands,
    /// For each unsolved lane, the row with the largest residual.
    pub worst: WorstRows<R>,
    /// Request to save the constraint problem of a lane, and the saved problem.
    pub(crate) capture: Capture,
}

/// Request to save the constraint problem of a lane at the next solve of stage 5, and the saved problem.
#[derive(Clone, Debug, Default)]
pub(crate) struct Capture {
    /// Lane whose problem will be saved; `None` after it is saved.
    pub(crate) lane: Option<usize>,
    /// Saved problem as bytes; see [`stepper_solve::Problem::from_bytes`].
    pub(crate) bytes: Vec<u8>,
}

impl<R: Real> VelocitySolution<R> {
    /// Workspace for a compiled model with at most `max_contacts` contacts per environment.
    pub fn new(compiled: &ModelStructure<R::Scalar>, max_contacts: usize) -> Self {
        let capacity = capacity_of(compiled, max_contacts, R::LANES);
        Self {
            impulses: Iterate::new(&capacity),
            v: vec![R::zero(); compiled.nv],
            scalar_impulse: vec![R::zero(); compiled.scalar_impulses],
            contact_groups: ContactGroups::new(capacity.dimension, max_contacts),
            saved_impulses: Snapshot::new(&capacity),
            newton: Newton::default(),
            islands: Islands::new(compiled.ntree),
            worst: WorstRows::new(),
            capture: Capture::default(),
        }
    }

    /// Fills the impulses with NaN after stage 8 has overwritten them, for tests.
    pub(crate) fn poison_impulses(&mut self) {
        let nan = R::of(f64::NAN);
        let Iterate { w, scalars, contacts, .. } = &mut self.impulses;
        w.iter_mut().chain(scalars).chain(contacts).for_each(|x| *x = nan);
    }
}
