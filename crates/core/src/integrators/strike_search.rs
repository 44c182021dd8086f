//! Search for the pairs of geoms that the motion of a step lets meet.

use stepper_real::{Mask, Real, Scalar};

use crate::collision::contact_set::Contacts;
use crate::collision::detection::GeomPoses;
use crate::collision::swept_pair::{Gap, Path, SweptPair};
use crate::compile::LaneModel;
use crate::constraints::approaching::resting_speed;
use crate::constraints::constraint_set::Constraints;
use crate::dynamics::kinematics::Kinematics;
use crate::math::lanes::each_of;
use crate::options::StepSettings;

/// Rounding of the distance of bodies that are some metres from the origin, m, in 64 bits and in 32.
const POSITION_ROUNDING: [f64; 2] = [1e-12, 2e-6];

/// Time between the first touches of two pairs, relative to the path, below which both count as the first.
const SIMULTANEOUS_FRACTION: f64 = 2e-3;

/// Pairs whose waiting contacts the motion may close, and which of them it does.
#[derive(Clone, Debug)]
pub(crate) struct StrikeSearch<R: Real> {
    swept: SweptPair<R>,
    /// For each contact that waits, its normal velocity in the motion, m/s, and the lanes in which its linearised gap closes.
    rates: Vec<(R, R::Mask)>,
    pairs: Vec<PairStrike<R>>,
}

/// A pair whose linearised gap closes in some lanes.
#[derive(Clone, Copy, Debug)]
struct PairStrike<R: Real> {
    /// Number of the pair in the compiled model.
    pair: usize,
    /// Lanes in which its linearised gap closes; in the end, those in which its contacts are to be activated.
    lanes: R::Mask,
    /// Time of the first touch, s.
    time: R,
    /// Lanes (bits) in which another pair of the same trees meets before.
    later: u32,
}

/// Motion and contacts in which a search takes place.
pub(crate) struct StrikeQuery<'a, R: Real> {
    pub(crate) compiled: &'a LaneModel<R>,
    pub(crate) kinematics: &'a Kinematics<R>,
    pub(crate) poses: &'a GeomPoses<R>,
    pub(crate) contacts: &'a Contacts<R>,
    pub(crate) options: &'a StepSettings,
    /// Lanes that are searched.
    pub(crate) lanes: R::Mask,
    /// Part of the linearised overlap that the true overlap must exceed to count: the motion is an estimate that errs by less.
    pub(crate) margin: f64,
    /// Whether all pairs that meet count, also those that others may keep from meeting.
    pub(crate) ignores_order: bool,
}

impl<R: Real> StrikeSearch<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>, max_contacts: usize) -> Self {
        let rolling = if compiled.has_rolling_friction { max_contacts } else { 0 };
        Self {
            swept: SweptPair::new(compiled),
            rates: Vec::with_capacity(max_contacts + rolling),
            pairs: Vec::with_capacity(max_contacts * R::LANES),
        }
    }

    /// Finds the pairs that meet first in the motion with the velocity `v` after the step, among those that [`StrikeSearch::list_candidates`]
    /// has listed. Returns the lanes in which there are any.
    pub(crate) fn find(&mut self, query: &StrikeQuery<'_, R>, v: &[R], constraints: &Constraints<R>) -> R::Mask {
        R::vectorize(
            #[inline(always)]
            || self.test_paths(query, v, constraints),
        );
        if !query.ignores_order {
            self.keep_earliest(query, constraints);
        }
        self.pairs.iter().fold(R::Mask::splat(false), |lanes, strike| lanes.or(strike.lanes))
    }

    /// Lanes in which the search has found the contact of `pair`.
    #[inline(always)]
    pub(crate) fn lanes_of(&self, pair: usize) -> R::Mask {
        self.pairs.iter().find(|strike| strike.pair == pair).map_or(R::Mask::splat(false), |strike| strike.lanes)
    }

    /// Lists the pairs whose linearised gaps close. Returns whether there are any.
    pub(crate) fn list_candidates(&mut self, query: &StrikeQuery<'_, R>, constraints: &Constraints<R>) -> bool {
        self.rates.clear();
        self.pairs.clear();
        let touch = touch_tolerance(query, constraints);
        R::vectorize(
            #[inline(always)]
            || {
                for contact in &constraints.deferred {
                    let demand = constraints.problem.normal_velocity(contact.contact, &constraints.iterate.w);
                    let rate = demand - contact.bias;
                    let end = query.contacts.data[contact.slot].point.distance + constraints.closing_time * rate;
                    let closes = contact.bounces.and(demand.lt(R::zero())).or(end.lt(-touch).and_not(contact.bounces));
                    self.rates.push((rate, contact.lanes.and(query.lanes).and(closes)));
                }
            },
        );
        for (contact, &(_, closes)) in constraints.deferred.iter().zip(&self.rates) {
            for (pair, lanes) in query.contacts.pairs(contact.slot, closes.bits()) {
                let lanes = R::Mask::from_bits(lanes);
                match self.pairs.iter_mut().find(|strike| strike.pair == pair) {
                    Some(strike) => strike.lanes = strike.lanes.or(lanes),
                    None => self.pairs.push(PairStrike { pair, lanes, time: R::zero(), later: 0 }),
                }
            }
        }
        !self.pairs.is_empty()
    }

    /// Keeps the lanes in which the paths of the pairs let them meet, with the times of their first touches where there are several.
    #[inline(always)]
    fn test_paths(&mut self, query: &StrikeQuery<'_, R>, v: &[R], constraints: &Constraints<R>) {
        let StrikeQuery { compiled, kinematics, poses, .. } = *query;
        let Self { swept, rates, pairs, .. } = self;
        let time = constraints.closing_time;
        swept.set_velocity(compiled, kinematics, v);
        let path = |index: usize, pair| Path { compiled, kinematics, start: &poses.placed, time, slack: poses.slack, index, pair };
        let (mut once, mut several) = (R::Mask::splat(false), R::Mask::splat(false));
        for strike in pairs.iter_mut() {
            let pair = compiled.pair(strike.pair);
            let gap = farthest_closing_gap(query, constraints, rates, strike);
            let least = -(gap.distance + time * gap.rate) * R::of(query.margin);
            let tolerance = pair_tolerance(query, constraints, strike).max(least);
            (strike.lanes, strike.time) = swept.find_touch(&path(strike.pair, pair), strike.lanes, gap, tolerance);
            several = several.or(once.and(strike.lanes));
            once = once.or(strike.lanes);
        }
        if query.ignores_order || several.none() {
            return;
        }
        for strike in pairs.iter_mut().filter(|strike| strike.lanes.and(several).any()) {
            let (pair, lanes) = (compiled.pair(strike.pair), strike.lanes.and(several));
            let tolerance = pair_tolerance(query, constraints, strike);
            strike.time = swept.first_touch(&path(strike.pair, pair), lanes, strike.time, tolerance);
        }
    }

    /// Keeps the pairs that meet before any other pair of the same trees does: an impact changes where those go.
    fn keep_earliest(&mut self, query: &StrikeQuery<'_, R>, constraints: &Constraints<R>) {
        let lanes = self.pairs.iter().fold(0, |bits, strike| bits | strike.lanes.bits());
        let trees_of = |strike: &PairStrike<R>| trees_of_pair(query.compiled, strike.pair);
        for lane in each_of(lanes) {
            let here = |strike: &&PairStrike<R>| strike.lanes.bits() >> lane & 1 == 1;
            let time = |strike: &PairStrike<R>| strike.time.lane(lane).to_f64();
            let window = SIMULTANEOUS_FRACTION * constraints.closing_time.lane(lane).to_f64();
            for i in 0..self.pairs.len() {
                let strike = self.pairs[i];
                let shares = |other: &PairStrike<R>| trees_of(other).iter().flatten().any(|tree| trees_of(&strike).contains(&Some(*tree)));
                let is_later = self.pairs.iter().filter(here).any(|other| time(other) < time(&strike) - window && shares(other));
                self.pairs[i].later |= u32::from(is_later) << lane;
            }
        }
        for strike in &mut self.pairs {
            strike.lanes = strike.lanes.and_not(R::Mask::from_bits(strike.later));
        }
    }
}

/// Linearised gap of a pair's waiting contact that closes farthest.
#[inline(always)]
fn farthest_closing_gap<R: Real>(
    query: &StrikeQuery<'_, R>,
    constraints: &Constraints<R>,
    rates: &[(R, R::Mask)],
    strike: &PairStrike<R>,
) -> Gap<R> {
    let mut gap = Gap { distance: R::zero(), rate: R::zero() };
    let mut farthest = R::of(f64::INFINITY);
    for (contact, &(rate, closes)) in constraints.deferred.iter().zip(rates) {
        for (pair, lanes) in query.contacts.pairs(contact.slot, closes.and(strike.lanes).bits()) {
            if pair == strike.pair {
                let distance = query.contacts.data[contact.slot].point.distance;
                let end = distance + constraints.closing_time * rate;
                let here = R::Mask::from_bits(lanes).and(end.lt(farthest));
                farthest = R::select(here, end, farthest);
                gap = Gap { distance: R::select(here, distance, gap.distance), rate: R::select(here, rate, gap.rate) };
            }
        }
    }
    gap
}

/// Overlap up to which a pair does not count as meeting, m: that of resting contacts, up to the slop, goes on where supports join flush.
#[inline(always)]
fn pair_tolerance<R: Real>(query: &StrikeQuery<'_, R>, constraints: &Constraints<R>, strike: &PairStrike<R>) -> R {
    let compiled = query.compiled;
    let frames_of = |pair: usize| compiled.pair_geoms(pair).expect("made from this compiled").map(|g| compiled.geoms[g].frame);
    let mut overlap = R::zero();
    for lane in each_of(strike.lanes.bits()) {
        let deepest = constraints.resting_overlap(query.contacts, frames_of, frames_of(strike.pair), lane);
        overlap.set_lane(lane, R::of(deepest).lane(lane));
    }
    overlap.min(R::of(query.options.slop)) + touch_tolerance(query, constraints)
}

/// Overlap after the path that counts as a touch, m: what a contact at rest may move, or the rounding of positions.
#[inline(always)]
fn touch_tolerance<R: Real>(query: &StrikeQuery<'_, R>, constraints: &Constraints<R>) -> R {
    let rounding = POSITION_ROUNDING[usize::from(size_of::<R::Scalar>() < size_of::<f64>())];
    (constraints.closing_time * R::of(resting_speed(query.options))).max(R::of(rounding))
}

/// Trees of a pair's bodies, `None` for what does not belong to any.
fn trees_of_pair<R: Real>(compiled: &LaneModel<R>, pair: usize) -> [Option<usize>; 2] {
    let geoms = compiled.pair_geoms(pair).expect("made from this compiled");
    geoms.map(|g| compiled.geoms[g].frame.checked_sub(1).and_then(|link| compiled.links.get(link)).map(|link| link.tree))
}
