//! Buffers of steps that keep an error: states of all lanes at several times in a step ([`crate::integrators::substeps`]).

use stepper_real::{Mask, Real, kernel};

use crate::collision::contact_set::Contacts;
use crate::integrators::state::State;

/// Buffers of steps that keep an error.
#[derive(Clone, Debug)]
pub(crate) struct ErrorControl<R: Real> {
    /// State at the beginning of the interval of each lane.
    pub(super) start: Snapshot<R>,
    /// Configuration after a step over the interval.
    pub(super) whole: Vec<R>,
    /// Result of the first half of the interval.
    pub(super) middle: Snapshot<R>,
    /// Velocity, configuration and activations at the end of the step.
    pub(super) end: [Vec<R>; 3],
    /// Sums of the impulses of all accepted substeps, with the contacts of the last one.
    pub(super) total: Snapshot<R>,
    /// Contacts whose impulses are being summed.
    pub(super) summed: Contacts<R>,
    /// Velocity, configuration and activations at the beginning of the step.
    pub(super) before: [Vec<R>; 3],
}

/// State of all lanes, with what the next substep starts from.
#[derive(Clone, Debug)]
pub(super) struct Snapshot<R: Real> {
    pub(super) state: State<R>,
    /// Impulses of scalar rows.
    pub(super) scalar_impulse: Vec<R>,
    /// Length of the substep to which the impulses belong, s.
    pub(super) span: R,
}

impl<R: Real> Snapshot<R> {
    fn new(state: &State<R>, scalar_impulse: &[R]) -> Self {
        Self { state: state.clone(), scalar_impulse: scalar_impulse.to_vec(), span: R::one() }
    }

    /// Stores a state, and impulses of scalar rows, in the lanes `lanes`. The impulses belong to a substep of `span` seconds.
    pub(super) fn store(&mut self, (state, scalar_impulse): (&State<R>, &[R]), span: R, lanes: R::Mask) {
        copy(&mut self.state, state, lanes);
        select_into(&mut self.scalar_impulse, scalar_impulse, lanes);
        kernel!(R, || self.span = R::select(lanes, span, self.span));
    }

    /// Restores the lanes `lanes` of a state and of impulses of scalar rows, which belong to a substep of `span` seconds afterwards.
    pub(super) fn restore(&self, (state, scalar_impulse): (&mut State<R>, &mut [R]), span: &mut R, lanes: R::Mask) {
        copy(state, &self.state, lanes);
        select_into(scalar_impulse, &self.scalar_impulse, lanes);
        kernel!(R, || *span = R::select(lanes, self.span, *span));
    }

    /// Adds the impulses of an accepted substep with the result `state`, in the lanes `lanes`. Its contacts replace those of the earlier
    /// ones. `summed` is a buffer.
    pub(super) fn add(&mut self, summed: &mut Contacts<R>, state: &State<R>, scalar_impulse: &[R], lanes: R::Mask) {
        summed.copy_from(&state.contacts);
        summed.add_impulses(&self.state.contacts, lanes.bits());
        self.state.contacts.copy_lanes(summed, lanes.bits());
        kernel!(R, || {
            for (sums, impulses) in [(&mut self.state.impulse, &state.impulse[..]), (&mut self.scalar_impulse, scalar_impulse)] {
                for (sum, &impulse) in sums.iter_mut().zip(impulses) {
                    *sum = R::select(lanes, *sum + impulse, *sum);
                }
            }
        });
    }
}

/// Copies the lanes `lanes` of a state.
fn copy<R: Real>(to: &mut State<R>, from: &State<R>, lanes: R::Mask) {
    select_into(&mut to.q, &from.q, lanes);
    select_into(&mut to.v, &from.v, lanes);
    select_into(&mut to.act, &from.act, lanes);
    select_into(&mut to.impulse, &from.impulse, lanes);
    to.contacts.copy_lanes(&from.contacts, lanes.bits());
}

/// Copies the lanes `lanes` of a list.
pub(super) fn select_into<R: Real>(to: &mut [R], from: &[R], lanes: R::Mask) {
    kernel!(R, || {
        for (to, &from) in to.iter_mut().zip(from) {
            *to = R::select(lanes, from, *to);
        }
    });
}

impl<R: Real> ErrorControl<R> {
    /// Buffers for states like `state`, and impulses of scalar rows like `scalar_impulse`.
    pub(super) fn new(state: &State<R>, scalar_impulse: &[R]) -> Box<Self> {
        let new = || Snapshot::new(state, scalar_impulse);
        let (end, before) = ([&state.v, &state.q, &state.act].map(Clone::clone), [&state.v, &state.q, &state.act].map(Clone::clone));
        Box::new(Self { start: new(), whole: state.q.clone(), middle: new(), end, total: new(), summed: state.contacts.clone(), before })
    }
}
