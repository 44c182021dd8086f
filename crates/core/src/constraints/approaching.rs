//! Contacts whose surfaces approach each other: their rows wait until the solved motion closes the gap.
//!
//! A contact row keeps a gap open along one normal. It is right for surfaces that meet, and wrong for surfaces that pass each other: the
//! nearest points of two bodies that fly past approach, and never touch. So rows of approaching contacts are assembled and left out of the
//! problem. A solution without them says where the bodies go; the rows of the pairs that it lets meet are then activated, and the lanes are
//! solved again ([`crate::integrators::struck_contacts`]).
//!
//! Contacts that rest, slide or roll do not wait, nor do those of a half space, whose normal is the same everywhere.

use stepper_real::{Mask, Real, Scalar};

use crate::collision::contact_set::Contacts;
use crate::constraints::constraint_set::Constraints;
use crate::constraints::equality::RowInput;
use crate::math::lanes::each_of;
use crate::math::spatial::*;
use crate::options::StepSettings;

/// Approach speed below which a touching contact rests, in tolerances of the solver. The velocity of a contact at rest is within one.
const RESTING_SPEED_RATIO: f64 = 10.0;

/// Cosine of the angle between two normals of a pair from which on they are those of one flat contact: 0.8 degrees.
const SAME_NORMAL: f64 = 0.9999;

/// Normal speed below which a touching contact rests, m/s.
pub(crate) fn resting_speed(options: &StepSettings) -> f64 {
    RESTING_SPEED_RATIO * options.tolerance
}

impl<R: Real> Constraints<R> {
    /// Lanes in which slot `k`, which the lanes `lanes` have, waits: its surfaces approach each other and may pass. `before` is its normal
    /// velocity before the step, `free` are the velocities of its rows without constraints, m/s.
    #[inline(always)]
    pub(crate) fn approaching_lanes(
        &self,
        input: RowInput<'_, R>,
        contacts: &Contacts<R>,
        k: usize,
        lanes: R::Mask,
        before: R,
        free: V3<R>,
    ) -> R::Mask {
        let curved = lanes.and_not(R::Mask::from_bits(self.flat));
        if curved.none() {
            return curved;
        }
        let RowInput { options, assembly, .. } = input;
        let resting_speed = R::of(resting_speed(options));
        let gap = contacts.data[k].point.distance;
        let closes = gap.gt(R::of(options.slop)).and((assembly.gap(gap) + assembly.h * free[0]).lt(R::zero()));
        let waiting = curved.and(before.lt(-resting_speed).or(closes));
        if waiting.none() { waiting } else { self.without_certain_hits(input, contacts, k, waiting, free) }
    }

    /// Lanes of `lanes` but those in which round surfaces meet in the free motion for sure. Spheres and capsules hold the balls about the
    /// contact's centres of curvature, and those meet.
    #[inline(never)]
    fn without_certain_hits(&self, input: RowInput<'_, R>, contacts: &Contacts<R>, k: usize, lanes: R::Mask, free: V3<R>) -> R::Mask {
        R::vectorize(
            #[inline(always)]
            || {
                let (compiled, gap) = (input.compiled, contacts.data[k].point.distance);
                let mut out = lanes;
                for (pair, same) in contacts.pairs(k, lanes.bits()) {
                    let [a, b] = compiled.pair_geoms(pair).expect("made from this compiled");
                    if compiled.geoms[a].is_round && compiled.geoms[b].is_round {
                        let reach = compiled.params.geom_size(a)[0] + compiled.params.geom_size(b)[0];
                        let way = scale(free, self.closing_time);
                        let apart = norm([reach + gap + way[0], way[1], way[2]]);
                        let meets = apart.lt(reach).and((reach + gap + way[0]).gt(R::zero()));
                        out = out.and_not(meets.and(R::Mask::from_bits(same)));
                    }
                }
                out
            },
        )
    }

    /// Lanes of `lanes` in which the rows of any contact wait.
    #[inline(always)]
    pub(crate) fn deferred_lanes(&self, lanes: R::Mask) -> R::Mask {
        let mut waiting = R::Mask::splat(false);
        for contact in &self.deferred {
            waiting = waiting.or(contact.lanes);
        }
        waiting.and(lanes)
    }

    /// Deepest overlap in a lane of the contacts that do not wait and that share a moving frame with the frames `frames`, m.
    pub(crate) fn resting_overlap(
        &self,
        contacts: &Contacts<R>,
        frames_of: impl Fn(usize) -> [usize; 2],
        frames: [usize; 2],
        lane: usize,
    ) -> f64 {
        let mut deepest = 0.0_f64;
        for k in 0..contacts.count[lane] {
            let is_deferred = self.deferred.iter().any(|contact| contact.slot == k && contact.lanes.bits() >> lane & 1 == 1);
            let shares = |f: usize| f > 0 && frames.contains(&f);
            if !is_deferred && frames_of(contacts.ids[k][lane].pair()).into_iter().any(shares) {
                deepest = deepest.max(-contacts.data[k].point.distance.lane(lane).to_f64());
            }
        }
        deepest
    }

    /// Activates the waiting contacts of the pairs that meet in the lanes `lanes`; `lanes_of` gives those of a pair.
    pub(crate) fn activate(&mut self, contacts: &Contacts<R>, lanes: R::Mask, lanes_of: impl Fn(usize) -> R::Mask) {
        R::vectorize(
            #[inline(always)]
            || {
                for i in 0..self.deferred.len() {
                    let waiting = &self.deferred[i];
                    let mut struck = R::Mask::splat(false);
                    for (pair, same) in contacts.pairs(waiting.slot, waiting.lanes.and(lanes).bits()) {
                        struck = struck.or(lanes_of(pair).and(R::Mask::from_bits(same)));
                    }
                    self.activate_contact(i, struck, self.deferred[i].impulse);
                }
            },
        );
        let new = self.patches.new_lanes(contacts, &self.slots, &self.problem, &self.iterate);
        self.problem.hyperstatic = self.problem.hyperstatic.and_not(lanes).or(new.and(lanes));
    }

    /// Activates the waiting contacts that the solution does not violate: they push nothing. Those that it violates and does not strike go
    /// on waiting: their surfaces pass each other.
    #[inline(always)]
    pub(crate) fn activate_satisfied(&mut self) {
        R::vectorize(
            #[inline(always)]
            || {
                for i in 0..self.deferred.len() {
                    let waiting = &self.deferred[i];
                    let open = self.problem.normal_velocity(waiting.contact, &self.iterate.w).ge(R::zero());
                    self.activate_contact(i, waiting.lanes.and(open), [R::zero(); 6]);
                }
            },
        )
    }

    /// Activates the waiting contacts that are among the contacts `known` of a step.
    pub(crate) fn activate_matching(&mut self, contacts: &Contacts<R>, known: &Contacts<R>) {
        for i in 0..self.deferred.len() {
            let waiting = self.deferred[i];
            let mut there = 0;
            for lane in each_of(waiting.lanes.bits()) {
                let id = contacts.ids[waiting.slot][lane];
                there |= u32::from(known.ids[..known.count[lane]].iter().any(|ids| ids[lane] == id)) << lane;
            }
            self.activate_contact(i, R::Mask::from_bits(there), waiting.impulse);
        }
    }

    /// Activates the waiting contacts of pairs that have another contact with the same normal which does not wait: the two surfaces lie on
    /// each other, and share their load among all of these contacts.
    #[inline(never)]
    pub(crate) fn activate_coplanar(&mut self, contacts: &Contacts<R>) {
        for i in 0..self.deferred.len() {
            let waiting = self.deferred[i];
            let mut facing = 0;
            for lane in each_of(waiting.lanes.bits()) {
                let normal = of_lane(&contacts.data[waiting.slot].point.normal, lane);
                let pair = contacts.ids[waiting.slot][lane].pair();
                let rests = (0..contacts.count[lane]).any(|k| {
                    contacts.ids[k][lane].pair() == pair
                        && dot(of_lane(&contacts.data[k].point.normal, lane), normal) > SAME_NORMAL
                        && !self.deferred.iter().any(|other| other.slot == k && other.lanes.bits() >> lane & 1 == 1)
                });
                facing |= u32::from(rests) << lane;
            }
            self.activate_contact(i, R::Mask::from_bits(facing), waiting.impulse);
        }
    }

    /// Activates waiting contact `i` in the lanes `lanes`, from the impulse `impulse`. The impulses that a prediction may be taken back to
    /// get it, too: a load that is shared among several contacts stays shared.
    #[inline(always)]
    fn activate_contact(&mut self, i: usize, lanes: R::Mask, impulse: [R; 6]) {
        if lanes.any() {
            let Self { deferred, problem, iterate, shared, .. } = self;
            let waiting = &mut deferred[i];
            let lanes = problem.activate_contact(waiting.contact, lanes);
            iterate.start_contact(problem, waiting.contact, lanes, impulse);
            shared.start_contact(problem, waiting.contact, lanes, impulse);
            waiting.lanes = waiting.lanes.and_not(lanes);
            self.constrained = self.constrained.or(lanes);
        }
    }

    /// Takes the contacts that still wait out of `contacts`: their surfaces have passed each other.
    #[inline(always)]
    pub(crate) fn remove_missed(&mut self, contacts: &mut Contacts<R>) {
        let lanes = self.deferred_lanes(R::Mask::splat(true));
        for lane in each_of(lanes.bits()) {
            let Self { deferred, kept, .. } = self;
            kept.clear();
            kept.resize(contacts.count[lane], true);
            for waiting in deferred.iter().filter(|waiting| waiting.lanes.bits() >> lane & 1 == 1) {
                // A lane whose step was not taken has no contacts left.
                if let Some(kept) = kept.get_mut(waiting.slot) {
                    *kept = false;
                }
            }
            contacts.retain(lane, kept);
        }
    }
}
