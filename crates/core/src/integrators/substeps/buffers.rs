//! Buffers of steps that are divided into parts: states of all lanes at several times in a step ([`crate::integrators::substeps`]).
//!
//! A step has intervals: one, or several with an error estimate. An interval has one phase, or three with an error estimate: the whole
//! interval, its first half and its second half. A phase has parts: flights and impacts.

use stepper_real::{Mask, Real, kernel};

use crate::collision::contact_set::Contacts;
use crate::collision::separation_cache::SeparationCache;
use crate::compile::ModelStructure;
use crate::constraints::worst_row::WorstRows;
use crate::dynamics::kinematics::select_into;
use crate::integrators::state::State;
use crate::math::lanes::each_of;

/// Buffers of steps that are divided into parts.
#[derive(Clone, Debug)]
pub(crate) struct Buffers<R: Real> {
    /// State before the impact of each lane.
    pub(crate) before_impact: Snapshot<R>,
    /// Sums of the impulses of the parts of a phase, with every contact that had one.
    pub(crate) parts: Snapshot<R>,
    /// State at the beginning of the interval of each lane.
    pub(crate) start: Snapshot<R>,
    /// Velocity, configuration and activations after a step over the interval.
    pub(crate) whole: [Vec<R>; 3],
    /// Separation of the configuration after two halves of the interval from that after a step over it, nv.
    pub(crate) separation: Vec<R>,
    /// Lanes in which the interval of each kinematic tree is not extrapolated.
    pub(crate) not_extrapolated: Vec<R::Mask>,
    /// Buffer for a configuration.
    pub(crate) configuration: Vec<R>,
    /// Result of the first half of the interval.
    pub(crate) middle: Snapshot<R>,
    /// Velocity, configuration and activations at the end of the step.
    pub(crate) end: [Vec<R>; 3],
    /// Sums of the impulses of all accepted phases, with every contact that had one.
    pub(crate) total: Snapshot<R>,
    /// Contacts whose impulses are being summed.
    pub(crate) summed: Contacts<R>,
    /// Velocity, configuration and activations at the beginning of the step.
    pub(crate) before: [Vec<R>; 3],
    /// Lanes in which a part clamped the force of each actuator.
    pub(crate) saturated: Vec<R::Mask>,
    /// Cause of the largest residual of a part, in the lanes with one, and that residual, m/s. A rejected part has an infinite residual.
    pub(crate) worst: (WorstRows<R>, R),
    /// Whether the last step of the workspace was divided into parts, so that `saturated` is that of the step.
    pub(crate) was_used: bool,
    /// Lanes in which impacts touch each mechanism.
    pub(crate) touched: Vec<R::Mask>,
    /// Evaluated configuration and predicted velocity of the first pass.
    pub(crate) evaluated: [Vec<R>; 2],
    /// Separating planes of the lanes that reach the end of the step in the first pass.
    pub(crate) planes: SeparationCache,
}

/// State of all lanes, with the impulses that start the next part.
#[derive(Clone, Debug)]
pub(crate) struct Snapshot<R: Real> {
    pub(crate) state: State<R>,
    /// Impulses of scalar rows.
    pub(crate) scalar_impulse: Vec<R>,
    /// Length of the substep to which the impulses belong, s.
    pub(crate) impulse_time: R,
}

impl<R: Real> Snapshot<R> {
    /// Stores a state, and impulses of scalar rows, in the lanes `lanes`. The impulses belong to a substep of `impulse_time` seconds.
    pub(crate) fn store(&mut self, (state, scalar_impulse): (&State<R>, &[R]), impulse_time: R, lanes: R::Mask) {
        copy(&mut self.state, state, lanes);
        select_into(&mut self.scalar_impulse, scalar_impulse, lanes);
        kernel!(R, || self.impulse_time = R::select(lanes, impulse_time, self.impulse_time));
    }

    /// Restores the lanes `lanes` of a state and of impulses of scalar rows, which then belong to a substep of `impulse_time` seconds.
    pub(crate) fn restore(&self, (state, scalar_impulse): (&mut State<R>, &mut [R]), impulse_time: &mut R, lanes: R::Mask) {
        copy(state, &self.state, lanes);
        select_into(scalar_impulse, &self.scalar_impulse, lanes);
        kernel!(R, || *impulse_time = R::select(lanes, self.impulse_time, *impulse_time));
    }

    /// Removes all impulses and contacts of the lanes `lanes`.
    pub(crate) fn clear(&mut self, lanes: R::Mask) {
        each_of(lanes.bits() & u32::MAX >> (u32::BITS as usize - R::LANES)).for_each(|lane| self.state.contacts.count[lane] = 0);
        self.state.contacts.full &= !lanes.bits();
        kernel!(R, || {
            for impulse in self.state.impulse.iter_mut().chain(&mut self.scalar_impulse) {
                *impulse = R::select(lanes, R::zero(), *impulse);
            }
        });
    }

    /// Restores contacts and impulses of the lanes `lanes`.
    pub(crate) fn restore_impulses(&self, (state, scalar_impulse): (&mut State<R>, &mut [R]), lanes: R::Mask) {
        select_into(scalar_impulse, &self.scalar_impulse, lanes);
        select_into(&mut state.impulse, &self.state.impulse, lanes);
        state.contacts.copy_lanes(&self.state.contacts, lanes.bits());
    }

    /// Adds the impulses of a part with the result `state`, in the lanes `lanes`. Contacts that bore an impulse in an earlier part, and are
    /// gone in this one, stay. `summed` is a buffer.
    pub(crate) fn add(&mut self, summed: &mut Contacts<R>, state: &State<R>, scalar_impulse: &[R], lanes: R::Mask) {
        summed.copy_from(&state.contacts);
        summed.add_impulses(&self.state.contacts, lanes.bits());
        let earlier = &self.state.contacts;
        summed.add_missing(earlier, lanes.bits(), |k, l| earlier.bearing(k) >> l & 1 == 1);
        summed.full |= earlier.full & lanes.bits();
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

impl<R: Real> Buffers<R> {
    /// Keeps the causes `worst` of a part with the residual `residual`, m/s, in the lanes of `lanes` in which it is the largest so far.
    pub(crate) fn note_worst(&mut self, worst: &WorstRows<R>, residual: R, lanes: R::Mask) {
        let (kept, largest) = &mut self.worst;
        kernel!(R, || {
            let larger = lanes.and(worst.lanes).and_not(residual.lt(*largest));
            kept.copy_lanes(worst, larger);
            *largest = R::select(larger, residual, *largest);
        });
    }

    /// Buffers for states like `state`, with impulses of scalar rows like `scalar_impulse` and separating planes like `planes`.
    pub(crate) fn new(compiled: &ModelStructure<R::Scalar>, state: &State<R>, scalar_impulse: &[R], planes: &SeparationCache) -> Box<Self> {
        let new = || Snapshot { state: state.clone(), scalar_impulse: scalar_impulse.to_vec(), impulse_time: R::one() };
        let motion = || [&state.v, &state.q, &state.act].map(Clone::clone);
        let lanes = |count| vec![R::Mask::splat(false); count];
        Box::new(Self {
            before_impact: new(),
            parts: new(),
            start: new(),
            whole: motion(),
            separation: state.v.clone(),
            not_extrapolated: lanes(compiled.ntree),
            configuration: state.q.clone(),
            middle: new(),
            end: motion(),
            total: new(),
            summed: state.contacts.clone(),
            before: motion(),
            saturated: lanes(compiled.actuators.len()),
            worst: (WorstRows::new(), R::zero()),
            was_used: false,
            touched: lanes(compiled.mechanisms.count),
            evaluated: [state.q.clone(), state.v.clone()],
            planes: planes.clone(),
        })
    }
}
