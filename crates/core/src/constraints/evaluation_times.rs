//! Evaluation time of each mechanism: the time in the step at which its forces, contacts and rows are evaluated.
//!
//! With the midpoint rule this is the middle of the step, with one exception. Mechanisms with very fast bodies, which could pass through a
//! thin geom before the middle, are evaluated at the beginning. Mechanisms that contacts connect have the same time. The time of other
//! mechanisms is never affected.
//!
//! In a step that is divided into substeps, "step" means the substep here.

use stepper_real::{Mask, Real, kernel};

use crate::collision::contact_set::Contacts;
use crate::compile::{LaneModel, ModelStructure};
use crate::dynamics::kinematics::{displace, displace_joints};

/// Evaluation times of all mechanisms, in each lane.
#[derive(Clone, Debug)]
pub(crate) struct EvaluationTimes<R: Real> {
    /// Time step, s.
    pub(crate) h: R,
    /// Time from the beginning of the step to the evaluation point of the integration rule, s.
    rule: R,
    /// Time from the end of the step to the evaluation point of the next one, s.
    next: R,
    /// Time from the evaluation point of the integration rule to that of the next step, s.
    pub(crate) closing: R,
    /// Fraction of a gap that may close in the step: h / `closing`.
    closing_fraction: R,
    /// Time from the beginning of the step to the evaluation of each mechanism, s. Current only if `moved` is true.
    before: Vec<R>,
    /// Lanes in which each mechanism has very fast bodies, or contacts connect it with such a mechanism. It is evaluated at the beginning
    /// of the step.
    fast: Vec<R::Mask>,
    /// Whether any mechanism is `fast`, in any lane.
    pub(crate) moved: bool,
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
        let count = compiled.mechanisms.count;
        Self {
            h: R::zero(),
            rule: R::zero(),
            next: R::zero(),
            closing: R::zero(),
            closing_fraction: R::one(),
            before: vec![R::zero(); count],
            fast: vec![R::Mask::splat(false); count],
            moved: false,
        }
    }

    /// Sets the time of all mechanisms to `rule`, the evaluation point of the integration rule, s. The time step is `h`, s. `next` is the
    /// time from the end of the step to the evaluation point of the next one, s.
    #[inline(always)]
    pub(crate) fn reset(&mut self, h: R, rule: R, next: R) {
        let closing = h - rule + next;
        (self.h, self.rule, self.next) = (h, rule, next);
        (self.closing, self.closing_fraction) = (closing, h / closing);
        if self.moved {
            self.fast.fill(R::Mask::splat(false));
            self.moved = false;
        }
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

    /// Lanes in which any mechanism is evaluated at the beginning of the step, and not at the time of the integration rule.
    #[inline(always)]
    pub(crate) fn lanes_at_start(&self) -> R::Mask {
        let none = R::Mask::splat(false);
        if self.moved { self.fast.iter().fold(none, |lanes, &fast| lanes.or(fast)) } else { none }
    }

    /// Lanes in which the mechanism is evaluated at another time than that of the integration rule.
    #[inline(always)]
    pub(crate) fn moved_lanes(&self, mechanism: usize) -> R::Mask {
        if self.moved { self.fast[mechanism] } else { R::Mask::splat(false) }
    }

    /// Longest time within which a gap may close, s.
    #[inline(always)]
    pub(crate) fn longest_closing(&self) -> R {
        let mut longest = self.closing;
        if self.moved {
            for &before in &self.before {
                longest = longest.max(self.h - before + self.next);
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
        // Both geoms have the same times, unless one of them is fixed to the world.
        match compiled.mechanisms_of(geoms).next() {
            Some(m) => self.slot_times(self.before[m], self.fast[m]),
            None => self.times_of_rule(),
        }
    }

    /// Times of the contacts in slot `k`, in the lanes `lanes` (bits).
    #[inline(always)]
    pub(crate) fn of_slot(&self, compiled: &ModelStructure<R::Scalar>, contacts: &Contacts<R>, k: usize, lanes: u32) -> SlotTimes<R> {
        if self.moved { self.moved_slot(compiled, contacts, k, lanes) } else { self.times_of_rule() }
    }

    /// Times of contacts that are evaluated at the time of the integration rule.
    #[inline(always)]
    fn times_of_rule(&self) -> SlotTimes<R> {
        let Self { rule: before, closing, closing_fraction, .. } = *self;
        SlotTimes { before, after: self.h - before, closing, closing_fraction, at_start: R::Mask::splat(false) }
    }

    #[cold]
    #[inline(never)]
    fn moved_slot(&self, compiled: &ModelStructure<R::Scalar>, contacts: &Contacts<R>, k: usize, lanes: u32) -> SlotTimes<R> {
        kernel!(R, || {
            let (mut before, mut fast) = (self.rule, R::Mask::splat(false));
            for (pair, lanes) in contacts.pairs(k, lanes) {
                let geoms = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
                if let Some(m) = compiled.mechanisms_of(geoms).next() {
                    let lanes = R::Mask::from_bits(lanes);
                    before = R::select(lanes, self.before[m], before);
                    fast = fast.or(self.fast[m].and(lanes));
                }
            }
            self.slot_times(before, fast)
        })
    }

    /// Times of contacts that are evaluated `before` s after the beginning of the step. In the lanes `at_start` they are evaluated at the
    /// beginning of the step, because their bodies are very fast.
    #[inline(always)]
    fn slot_times(&self, before: R, at_start: R::Mask) -> SlotTimes<R> {
        let after = self.h - before;
        let closing = after + self.next;
        SlotTimes { before, after, closing, closing_fraction: self.h / closing, at_start }
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
        moved |= kernel!(R, || merge_connected(
            compiled,
            contacts,
            |k| contacts.lanes_of(k),
            #[inline(always)]
            |both, lanes| union(&mut self.fast, both, lanes)
        ));
        if moved {
            self.moved = true;
            for (before, &fast) in self.before.iter_mut().zip(&self.fast) {
                *before = R::select(fast, R::zero(), self.rule);
            }
        }
        moved
    }
}

/// Gives two mechanisms the lanes of either in `of_each`, which has the lanes of each mechanism, as far as they are in `lanes`. Returns the
/// lanes in which one changed. It is a function for [`merge_connected`].
#[inline(always)]
pub(crate) fn union<M: Mask>(of_each: &mut [M], [a, b]: [usize; 2], lanes: M) -> M {
    let both = of_each[a].or(of_each[b]).and(lanes);
    let changed = both.and_not(of_each[a].and(of_each[b]));
    (of_each[a], of_each[b]) = (of_each[a].or(both), of_each[b].or(both));
    changed
}

/// Calls `merge` for each contact between two mechanisms, with the mechanisms and the lanes of the contact, until nothing changes any more.
/// `merge` returns the lanes in which a value changed. Returns whether any value changed. `counts` returns the lanes (bits) in which the
/// contact of a slot counts.
#[inline(always)]
pub(crate) fn merge_connected<R: Real>(
    compiled: &ModelStructure<R::Scalar>,
    contacts: &Contacts<R>,
    counts: impl Fn(usize) -> u32,
    mut merge: impl FnMut([usize; 2], R::Mask) -> R::Mask,
) -> bool {
    let mut any = false;
    if compiled.mechanisms.count < 2 {
        return any;
    }
    loop {
        let mut changed = R::Mask::splat(false);
        for k in 0..contacts.slots() {
            for (pair, lanes) in contacts.pairs(k, counts(k)) {
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
