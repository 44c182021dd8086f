//! Storage of a solution's overlaps. Evaluations at displaced states use them instead of the present overlaps.

use stepper_real::Real;

use crate::compile::LaneModel;
use crate::constraints::solved_overlaps::SolvedOverlaps;
use crate::integrators::workspace::Workspace;

/// Overlaps of a solution, for displaced states; empty while the workspace uses them.
#[derive(Clone, Debug)]
pub(super) struct HeldOverlaps<R: Real>(Option<Box<SolvedOverlaps<R>>>);

impl<R: Real> HeldOverlaps<R> {
    /// Workspace for a compiled model.
    pub(super) fn new(compiled: &LaneModel<R>, max_contacts: usize) -> Self {
        Self(Some(Box::new(SolvedOverlaps::new(compiled, max_contacts))))
    }

    /// Stores the overlaps of the last step in the workspace. Constraint rows use these overlaps until [`HeldOverlaps::release`].
    pub(super) fn hold(&mut self, compiled: &LaneModel<R>, s: &mut Workspace<R>) {
        if let Some(mut overlaps) = self.0.take() {
            // The step has moved its contacts to the state.
            overlaps.keep(compiled, &s.state.contacts, &s.evaluation.q);
            s.evaluation.solved_overlaps = Some(overlaps);
        }
    }

    /// Takes the stored overlaps out of the workspace, so that constraint rows follow the present overlaps again.
    pub(super) fn release(&mut self, s: &mut Workspace<R>) {
        self.0 = s.evaluation.solved_overlaps.take().or_else(|| self.0.take());
    }
}
