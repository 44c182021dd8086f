//! Overlaps of the solved step. Evaluations at displaced states use them instead of the overlaps of the displaced configuration.

use stepper_real::Real;

use crate::compile::LaneModel;
use crate::constraints::solved_overlaps::SolvedOverlaps;
use crate::integrators::workspace::Workspace;

/// Overlaps of the solved step, for evaluations at displaced states. The value is empty while the workspace owns the overlaps.
#[derive(Clone, Debug)]
pub(super) struct HeldOverlaps<R: Real>(Option<Box<SolvedOverlaps<R>>>);

impl<R: Real> HeldOverlaps<R> {
    /// Allocates the overlaps for a compiled model.
    pub(super) fn new(compiled: &LaneModel<R>, max_contacts: usize) -> Self {
        Self(Some(Box::new(SolvedOverlaps::new(compiled, max_contacts))))
    }

    /// Gives the overlaps of the last step to the workspace. Until [`HeldOverlaps::release`], constraint rows use them instead of the
    /// overlaps of the present configuration.
    pub(super) fn hold(&mut self, compiled: &LaneModel<R>, s: &mut Workspace<R>) {
        if let Some(mut overlaps) = self.0.take() {
            // The step has moved its contacts to the state.
            overlaps.keep(compiled, &s.state.contacts, &s.evaluation.q);
            s.evaluation.solved_overlaps = Some(overlaps);
        }
    }

    /// Takes the overlaps of the solved step back from the workspace. Constraint rows then use the overlaps of the present configuration.
    pub(super) fn release(&mut self, s: &mut Workspace<R>) {
        self.0 = s.evaluation.solved_overlaps.take().or_else(|| self.0.take());
    }
}
