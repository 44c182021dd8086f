//! Solution of the position problem: results of stages 7 (integration of positions) and 8 (position correction).

use stepper_real::{Real, kernel};
use stepper_solve::{PositionRows, Reference};

use crate::collision::contact_set::Contacts;
use crate::compile::LaneModel;
use crate::constraints::constraint_problem::{ConstraintProblem, capacity_of};
use crate::dynamics::kinematics::Kinematics;

/// Positions after the step, and the workspace of their correction in stage 8.
#[derive(Clone, Debug)]
pub struct PositionSolution<R: Real> {
    /// Configuration after the step, nq.
    pub q: Vec<R>,
    /// Activations after the step, na.
    pub act: Vec<R>,
    /// Constraint rows of the position solve in stage 8.
    pub(crate) rows: PositionRows<R>,
    /// One number per constraint, scalar rows first. For a contact it is the sum of the inverse masses of its two bodies, 1/kg, which adds
    /// to the mobility that scales damping. For a scalar row (equality, limit, dry friction) it is 0.
    pub(crate) unconstrained_mobility: Vec<R>,
    /// Impulses of the velocity solution. The compliance that damps the position rows acts on the difference between the impulses of the
    /// position solve and these.
    pub(crate) reference: Reference<R>,
    /// Free velocity (velocity without impulses) of the position solve, nv.
    pub(crate) v_free: Vec<R>,
    /// Velocity of the position correction, nv.
    pub(crate) correction: Vec<R>,
    /// Scratch buffer, nv.
    pub(crate) scratch: Vec<R>,
    /// Configuration after the correction, nq.
    pub(crate) q_corrected: Vec<R>,
    /// Poses at the configuration after the correction.
    pub(crate) kinematics: Kinematics<R>,
    /// Contacts at the configuration after the correction.
    pub(crate) contacts: Contacts<R>,
}

impl<R: Real> PositionSolution<R> {
    /// Workspace for a compiled model with at most `max_contacts` contacts per environment.
    pub fn new(compiled: &LaneModel<R>, max_contacts: usize) -> Self {
        let capacity = capacity_of(compiled, max_contacts, R::LANES);
        let [q, v, act] = [compiled.nq, compiled.nv, compiled.na].map(|n| move || vec![R::zero(); n]);
        Self {
            q: q(),
            act: act(),
            rows: PositionRows::new(&capacity),
            unconstrained_mobility: Vec::with_capacity(capacity.scalars + capacity.all_contacts()),
            reference: Reference::new(&capacity),
            v_free: v(),
            correction: v(),
            scratch: v(),
            q_corrected: q(),
            kinematics: Kinematics::new(compiled),
            contacts: Contacts::new(max_contacts).with_torques(compiled.has_rolling_friction),
        }
    }

    /// Fills with NaN, for tests, the vectors that a step must compute before it reads them.
    pub(crate) fn poison(&mut self) {
        let Self { q, act, v_free, correction, scratch, q_corrected, .. } = self;
        [q, act, v_free, correction, scratch, q_corrected].into_iter().for_each(|buffer| buffer.fill(R::of(f64::NAN)));
    }

    /// Copies the rows of the constraint problem as rows of the position solve.
    pub fn copy_rows(&mut self, problem: &ConstraintProblem<R>) {
        kernel!(R, || self.rows.copy(&problem.rows))
    }
}
