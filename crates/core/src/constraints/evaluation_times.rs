//! Evaluation time of each mechanism: the time in the step at which its forces, contacts and rows are evaluated.
//!
//! With the midpoint rule this is the middle of the step, with two exceptions. Mechanisms with very fast bodies, which could pass through a
//! thin geom before the middle, are evaluated at the beginning. Mechanisms with an elastic impact are evaluated at the time of the impact.
//! Mechanisms that contacts connect have the same time. The time of other mechanisms is never affected.

use stepper_real::{Mask, Real, kernel};

use crate::collision::contact_set::Contacts;
use crate::compile::{LaneModel, ModelStructure};
use crate::dynamics::kinematics::{displace, displace_joints};

/// Evaluation times of all mechanisms, in each lane.
#[derive(Clone, Debug)]
pub(crate) struct EvaluationTimes<R: Real> {
    /// Time step, s.
    h: R,
    /// Time from the beginning of the step to the evaluation point of the integration rule, s.
    rule: R,
    /// Time from the beginning of the step to the evaluation of each mechanism, s. Current only if `moved` is true.
    before: Vec<R>,
    /// Lanes in which each mechanism has very fast bodies, or contacts connect it with such a mechanism. It is evaluated at the beginning
    /// of the step, unless it has an impact.
    fast: Vec<R::Mask>,
    /// Lanes in which each mechanism is evaluated at the time of an elastic impact. The mechanism takes part in the impact, or contacts
    /// connect it with one that does.
    impact: Vec<R::Mask>,
    /// Whether any mechanism is `fast` or has an `impact`, in any lane.
    moved: bool,
    /// Times of the first impacts that the last search found, s; infinite for mechanisms without an impact.
    first_impact: Vec<R>,
}

/// Evaluation time of the contacts in one slot of the contact set, one contact per lane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SlotTimes<R: Real> {
    /// Time from the beginning of the step to the evaluation of the contact, s.
    pub(crate) before: R,
    /// Time from the evaluation of the contact to the end of the step, s.
    pub(crate) after: R,
    /// Time from the evaluation of the contact to its evaluation in the next step, s. A gap may close within this time.
    pub(crate) closing: R,
    /// Fraction of a gap that may close in the step, which is h / `closing`.
    pub(crate) closing_fraction: R,
    /// Lanes in which the contact is evaluated at the beginning of the step, because its bodies are very fast.
    pub(crate) at_start: R::Mask,
}

impl<R: Real> SlotTimes<R> {
    /// Part of the gap `phi` that may close in the step, m. An overlap (negative gap) is returned unchanged.
    #[inline(always)]
    pub(crate) fn closing_part(&self, phi: R) -> R {
        R::select(phi.gt(R::zero()), phi * self.closing_fraction, phi)
    }
}

impl<R: Real> EvaluationTimes<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        let (count, none) = (compiled.mechanisms.count, R::Mask::splat(false));
        Self {
            h: R::zero(),
            rule: R::zero(),
            before: vec![R::zero(); count],
            fast: vec![none; count],
            impact: vec![none; count],
            moved: false,
            first_impact: vec![R::zero(); count],
        }
    }

    /// Sets the time of all mechanisms to `rule`, the evaluation point of the integration rule, s. The time step is `h`, s.
    #[inline(always)]
    pub(crate) fn reset(&mut self, h: R, rule: R) {
        (self.h, self.rule) = (h, rule);
        if self.moved {
            let none = R::Mask::splat(false);
            self.fast.fill(none);
            self.impact.fill(none);
            self.moved = false;
        }
    }

    /// Time step, s.
    #[inline(always)]
    pub(crate) fn h(&self) -> R {
        self.h
    }

    /// Whether any mechanism is evaluated at another time than that of the integration rule, in any lane.
    #[inline(always)]
    pub(crate) fn any_moved(&self) -> bool {
        self.moved
    }

    /// Time from the beginning of the step to the evaluation of the mechanism, s.
    #[inline(always)]
    pub(crate) fn before(&self, mechanism: usize) -> R {
        if self.moved { self.before[mechanism] } else { self.rule }
    }

    /// Time from the evaluation of the mechanism to the end of the step, s.
    #[inline(always)]
    pub(crate) fn after(&self, mechanism: usize) -> R {
        self.h - self.before(mechanism)
    }

    /// Times from the beginning of the step to the evaluation of the mechanism, and from there to the end, s.
    #[inline(always)]
    pub(crate) fn around(&self, mechanism: usize) -> [R; 2] {
        [self.before(mechanism), self.after(mechanism)]
    }

    /// Computes the configuration at the evaluation points into `out`, from the configuration `q` before the step and the velocity `v`.
    #[inline(always)]
    pub(crate) fn displace_before(&self, compiled: &LaneModel<R>, q: &[R], v: &[R], out: &mut [R]) {
        if self.moved {
            displace_joints(compiled, q, v, |dof| self.before[compiled.mechanism_of(dof)], out);
        } else {
            displace(compiled, q, v, self.rule, out);
        }
    }

    /// Computes the configuration at the end of the step into `out`, from the configuration `q` at the evaluation points and the velocity
    /// `v`.
    #[inline(always)]
    pub(crate) fn displace_after(&self, compiled: &LaneModel<R>, q: &[R], v: &[R], out: &mut [R]) {
        if self.moved {
            displace_joints(compiled, q, v, |dof| self.h - self.before[compiled.mechanism_of(dof)], out);
        } else {
            displace(compiled, q, v, self.h - self.rule, out);
        }
    }

    /// Lanes in which the mechanism is evaluated at another time than that of the integration rule.
    #[inline(always)]
    pub(crate) fn moved_lanes(&self, mechanism: usize) -> R::Mask {
        if self.moved { self.fast[mechanism].or(self.impact[mechanism]) } else { R::Mask::splat(false) }
    }

    /// Lanes in which the mechanism takes part in an elastic impact.
    #[inline(always)]
    pub(crate) fn impact_lanes_of(&self, mechanism: usize) -> R::Mask {
        if self.moved { self.impact[mechanism] } else { R::Mask::splat(false) }
    }

    /// Lanes in which any mechanism takes part in an elastic impact, and the latest time of their impacts, s.
    #[inline(always)]
    pub(crate) fn latest_impact(&self) -> (R::Mask, R) {
        let (mut lanes, mut latest) = (R::Mask::splat(false), R::zero());
        if self.moved {
            for (&impact, &before) in self.impact.iter().zip(&self.before) {
                lanes = lanes.or(impact);
                latest = R::select(impact, latest.max(before), latest);
            }
        }
        (lanes, latest)
    }

    /// Longest time within which a gap may close, s.
    #[inline(always)]
    pub(crate) fn longest_closing(&self) -> R {
        let mut longest = self.h;
        if self.moved {
            for &before in &self.before {
                longest = longest.max(self.h - before + self.h * R::of(0.5));
            }
        }
        longest
    }

    /// Times of a pair of geoms.
    #[inline(always)]
    pub(crate) fn of_pair(&self, compiled: &ModelStructure<R::Scalar>, geoms: [usize; 2]) -> SlotTimes<R> {
        if !self.moved {
            return self.times_of_rule();
        }
        let none = R::Mask::splat(false);
        let (mut before, mut fast, mut impact) = (self.rule, none, none);
        // Both geoms have the same times, unless one of them is fixed to the world.
        if let Some(m) = geoms.into_iter().filter_map(|geom| compiled.mechanism_of_geom(geom)).next() {
            (before, fast, impact) = (self.before[m], self.fast[m], self.impact[m]);
        }
        self.slot_times(before, [fast, impact])
    }

    /// Times of the contacts in slot `k`, in the lanes `lanes` (bits).
    #[inline(always)]
    pub(crate) fn of_slot(&self, compiled: &ModelStructure<R::Scalar>, contacts: &Contacts<R>, k: usize, lanes: u32) -> SlotTimes<R> {
        if self.moved { self.moved_slot(compiled, contacts, k, lanes) } else { self.times_of_rule() }
    }

    /// Times of contacts that are evaluated at the time of the integration rule.
    #[inline(always)]
    fn times_of_rule(&self) -> SlotTimes<R> {
        let (before, closing) = (self.rule, self.h);
        SlotTimes { before, after: closing - before, closing, closing_fraction: R::one(), at_start: R::Mask::splat(false) }
    }

    #[cold]
    #[inline(never)]
    fn moved_slot(&self, compiled: &ModelStructure<R::Scalar>, contacts: &Contacts<R>, k: usize, lanes: u32) -> SlotTimes<R> {
        kernel!(R, || {
            let (mut before, [mut fast, mut impact]) = (self.rule, [R::Mask::splat(false); 2]);
            for (pair, lanes) in contacts.pairs(k, lanes) {
                let geoms = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
                if let Some(m) = geoms.into_iter().filter_map(|geom| compiled.mechanism_of_geom(geom)).next() {
                    let lanes = R::Mask::from_bits(lanes);
                    before = R::select(lanes, self.before[m], before);
                    (fast, impact) = (fast.or(self.fast[m].and(lanes)), impact.or(self.impact[m].and(lanes)));
                }
            }
            self.slot_times(before, [fast, impact])
        })
    }

    /// Times of contacts that are evaluated `before` s after the beginning of the step.
    ///
    /// The next evaluation is normally h later. After an evaluation at the beginning of the step it is 1.5 h later, in the middle of the
    /// next step. After an impact it is the rest of this step plus h / 2 later.
    #[inline(always)]
    fn slot_times(&self, before: R, [fast, impact]: [R::Mask; 2]) -> SlotTimes<R> {
        let (h, after, at_start) = (self.h, self.h - before, fast.and_not(impact));
        let mut closing_fraction = R::select(at_start, R::of(2.0 / 3.0), R::one());
        if impact.any() {
            closing_fraction = R::select(impact, h / (after + h * R::of(0.5)), closing_fraction);
        }
        SlotTimes { before, after, closing: h / closing_fraction, closing_fraction, at_start }
    }

    /// Moves mechanisms with very fast bodies to the beginning of the step, and all mechanisms that `contacts` connect with them.
    /// `fast` has the lanes of each mechanism. Returns whether any time changed.
    #[cold]
    #[inline(never)]
    pub(crate) fn move_to_start(&mut self, compiled: &ModelStructure<R::Scalar>, contacts: &Contacts<R>, fast: &[R::Mask]) -> bool {
        let mut moved = false;
        for (here, &fast) in self.fast.iter_mut().zip(fast) {
            moved |= fast.and_not(*here).any();
            *here = here.or(fast);
        }
        if !moved && self.fast.iter().all(|lanes| lanes.none()) {
            return false;
        }
        moved |= merge_connected(compiled, contacts, |[a, b], lanes| {
            let both = self.fast[a].or(self.fast[b]).and(lanes);
            let changed = both.and_not(self.fast[a].and(self.fast[b]));
            (self.fast[a], self.fast[b]) = (self.fast[a].or(both), self.fast[b].or(both));
            changed
        });
        if moved {
            self.update();
        }
        moved
    }

    /// Clears the impacts of the last search.
    #[inline(always)]
    pub(crate) fn begin_impact_search(&mut self) {
        self.first_impact.fill(R::of(f64::INFINITY));
    }

    /// Notes impacts of a pair of geoms at `time` s after the beginning of the step, in the lanes `lanes`.
    #[inline(always)]
    pub(crate) fn note_impact(&mut self, compiled: &ModelStructure<R::Scalar>, geoms: [usize; 2], lanes: R::Mask, time: R) {
        for m in geoms.into_iter().filter_map(|geom| compiled.mechanism_of_geom(geom)) {
            self.first_impact[m] = R::select(lanes, self.first_impact[m].min(time), self.first_impact[m]);
        }
    }

    /// Moves mechanisms, with all that `contacts` connect with them, to the times of their first noted impacts. Differences up to
    /// `tolerance`, s, do not count. Returns whether any time changed.
    #[inline(never)]
    pub(crate) fn move_to_impacts(&mut self, compiled: &ModelStructure<R::Scalar>, contacts: &Contacts<R>, tolerance: R) -> bool {
        let noted = |time: R| time.lt(R::of(f64::INFINITY));
        if self.first_impact.iter().all(|&time| noted(time).none()) {
            return false;
        }
        merge_connected(compiled, contacts, |connected, lanes| {
            let later = take_earliest(&mut self.first_impact, connected, lanes);
            later[0].or(later[1])
        });
        if !self.moved {
            self.update();
        }
        let mut any = false;
        for m in 0..self.before.len() {
            let (time, lanes) = (self.first_impact[m], noted(self.first_impact[m]));
            let moved = lanes.and((time - self.before[m]).abs().gt(tolerance));
            self.impact[m] = self.impact[m].or(lanes);
            self.before[m] = R::select(moved, time, self.before[m]);
            any |= moved.any();
        }
        any
    }

    /// Gives mechanisms that `contacts` connect the same time, the earliest. Returns whether any time changed.
    ///
    /// Contacts may connect a moved mechanism with others only at its new time.
    #[cold]
    #[inline(never)]
    pub(crate) fn connect(&mut self, compiled: &ModelStructure<R::Scalar>, contacts: &Contacts<R>) -> bool {
        merge_connected(compiled, contacts, |connected, lanes| {
            let later = take_earliest(&mut self.before, connected, lanes);
            for (m, later) in connected.into_iter().zip(later) {
                self.impact[m] = self.impact[m].or(later);
            }
            later[0].or(later[1])
        })
    }

    /// Recomputes the times of mechanisms without an impact.
    fn update(&mut self) {
        self.moved = true;
        for m in 0..self.before.len() {
            let time = R::select(self.fast[m], R::zero(), self.rule);
            self.before[m] = R::select(self.impact[m], self.before[m], time);
        }
    }
}

/// Gives two mechanisms the earlier of their `times` in the lanes `lanes`. Returns the lanes in which each time changed.
fn take_earliest<R: Real>(times: &mut [R], connected: [usize; 2], lanes: R::Mask) -> [R::Mask; 2] {
    let earliest = times[connected[0]].min(times[connected[1]]);
    connected.map(|m| {
        let later = lanes.and(times[m].gt(earliest));
        times[m] = R::select(later, earliest, times[m]);
        later
    })
}

/// Calls `merge` for each contact between two mechanisms, with the mechanisms and the lanes of the contact, until nothing changes any more.
/// `merge` returns the lanes in which a value changed. Returns whether any value changed.
pub(crate) fn merge_connected<R: Real>(
    compiled: &ModelStructure<R::Scalar>,
    contacts: &Contacts<R>,
    mut merge: impl FnMut([usize; 2], R::Mask) -> R::Mask,
) -> bool {
    let mut any = false;
    if compiled.mechanisms.count < 2 {
        return any;
    }
    loop {
        let mut changed = R::Mask::splat(false);
        for k in 0..contacts.slots() {
            for (pair, lanes) in contacts.pairs(k, contacts.lanes_of(k)) {
                let geoms = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
                match geoms.map(|geom| compiled.mechanism_of_geom(geom)) {
                    [Some(a), Some(b)] if a != b => changed = changed.or(merge([a, b], R::Mask::from_bits(lanes))),
                    _ => {}
                }
            }
        }
        if changed.none() {
            return any;
        }
        any = true;
    }
}
