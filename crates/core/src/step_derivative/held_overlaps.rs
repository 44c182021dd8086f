//! Overlaps of a solution, which displaced states keep while its step is differentiated.

use stepper_real::Real;
use stepper_solve::newton::{Followed, Switch};

use crate::compile::LaneModel;
use crate::constraints::solved_overlaps::{Crossing, SolvedOverlaps};
use crate::integrators::workspace::Workspace;

/// Overlaps of a solution; empty while rows follow them.
#[derive(Clone, Debug)]
pub(crate) struct HeldOverlaps<R: Real>(Option<Box<SolvedOverlaps<R>>>);

impl<R: Real> HeldOverlaps<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>, max_contacts: usize) -> Self {
        Self(Some(Box::new(SolvedOverlaps::new(compiled, max_contacts))))
    }

    /// Makes rows follow the overlaps of the step that was just made, until they are released.
    pub(crate) fn hold(&mut self, compiled: &LaneModel<R>, s: &mut Workspace<R>) {
        if let Some(mut overlaps) = self.0.take() {
            // The step has moved its contacts to the state.
            overlaps.keep(compiled, &s.state.contacts, &s.evaluation.q);
            s.evaluation.solved_overlaps = Some(overlaps);
        }
    }

    /// Makes rows follow the present overlaps again.
    pub(crate) fn release(&mut self, s: &mut Workspace<R>) {
        self.0 = s.evaluation.solved_overlaps.take().or_else(|| self.0.take());
    }
}

/// Calls `near` with the gaps that have crossed zero at the displaced state in `s`, in the lanes `lanes` (bits). Returns the lanes with all
/// overlaps of the solution.
pub(crate) fn compare_overlaps<R: Real>(compiled: &LaneModel<R>, s: &Workspace<R>, lanes: u32, near: &mut dyn FnMut(Followed)) -> u32 {
    let Some(overlaps) = &s.evaluation.solved_overlaps else { return lanes };
    let contacts = &s.evaluation.contacts;
    overlaps.find_crossings(compiled, contacts, &s.evaluation.q, lanes, &mut |Crossing { lane, is_limit, distance }| {
        near(Followed { lane, switch: if is_limit { Switch::Limit } else { Switch::Contact }, distance });
    });
    overlaps.found(contacts, lanes)
}
