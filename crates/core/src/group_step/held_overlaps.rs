//! Overlaps of contacts and limits in the solved step. Evaluations at displaced states use these overlaps instead of the overlaps at the
//! displaced configuration.

use stepper_real::Real;

use crate::compile::LaneModel;
use crate::constraints::solved_overlaps::SolvedOverlaps;
use crate::integrators::workspace::Workspace;

/// Overlaps of contacts and limits in the solved step, for evaluations at displaced states. The value is `None` while the workspace has the
/// overlaps.
#[derive(Clone, Debug)]
pub(super) struct HeldOverlaps<R: Real>(Option<Box<SolvedOverlaps<R>>>);

impl<R: Real> HeldOverlaps<R> {
    /// Allocates the overlaps for a compiled model.
    pub(super) fn new(compiled: &LaneModel<R>, max_contacts: usize) -> Self {
        Self(Some(Box::new(SolvedOverlaps::new(compiled, max_contacts))))
    }

    /// Moves the overlaps of the solved step to the workspace. Until [`HeldOverlaps::release`], constraint rows use them instead of the
    /// overlaps at the present configuration.
    pub(super) fn hold(&mut self, compiled: &LaneModel<R>, s: &mut Workspace<R>) {
        if let Some(mut overlaps) = self.0.take() {
            // The step has moved its contacts to the state.
            overlaps.keep(compiled, &s.state.contacts, &s.evaluation.q);
            s.evaluation.solved_overlaps = Some(overlaps);
        }
    }

    /// Moves the overlaps of the solved step from the workspace back to `self`. Constraint rows then use the overlaps at the present
    /// configuration.
    pub(super) fn release(&mut self, s: &mut Workspace<R>) {
        self.0 = s.evaluation.solved_overlaps.take().or_else(|| self.0.take());
    }
}
