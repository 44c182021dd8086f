//! Search for the pairs of geoms with deferred contacts that collide in the motion of a step.

use stepper_real::{Mask, Real, Scalar};

use crate::collision::contact_set::Contacts;
use crate::collision::detection::GeomPoses;
use crate::collision::swept_pair::{Gap, Path, SweptPair};
use crate::compile::LaneModel;
use crate::constraints::ConstraintProblem;
use crate::constraints::approaching::resting_speed;
use crate::dynamics::kinematics::Kinematics;
use crate::math::lanes::each_of;
use crate::options::StepSettings;
use crate::tuning::SIMULTANEOUS_FRACTION;

/// Candidate pairs of deferred contacts, and the lanes in which they collide.
#[derive(Clone, Debug)]
pub(crate) struct CollisionSearch<R: Real> {
    swept: SweptPair<R>,
    /// Normal velocity of each deferred contact in the motion, m/s, and the lanes in which its linearised gap closes.
    rates: Vec<(R, R::Mask)>,
    /// Candidate pairs: those whose linearised gap closes in some lane.
    pairs: Vec<CandidatePair<R>>,
    /// Velocity after the step by the predicted impulses, nv.
    pub(crate) v_predicted: Vec<R>,
}

/// Candidate pair: its linearised gap closes in some lanes.
#[derive(Clone, Copy, Debug)]
struct CandidatePair<R: Real> {
    /// Index of the pair in the compiled model.
    pair: usize,
    /// Lanes in which the linearised gap closes. The search reduces them to those in which the pair collides.
    lanes: R::Mask,
    /// Overlap below which the pair does not collide, m.
    tolerance: R,
    /// Time of the first touch after the start of the path, s.
    time: R,
    /// Lanes (bits) in which another pair of the same trees touches earlier.
    later_lanes: u32,
}

/// Contacts and settings of one search.
pub(crate) struct CollisionQuery<'a, R: Real> {
    pub(crate) compiled: &'a LaneModel<R>,
    pub(crate) kinematics: &'a Kinematics<R>,
    pub(crate) poses: &'a GeomPoses<R>,
    pub(crate) contacts: &'a Contacts<R>,
    pub(crate) options: &'a StepSettings,
    /// Lanes to search.
    pub(crate) lanes: R::Mask,
    /// Least overlap on the path that counts as a collision, as a fraction of the linearised overlap.
    ///
    /// It is 0 for a solved motion, and positive for a prediction, which has an error.
    pub(crate) margin: f64,
    /// Whether every colliding pair counts, also behind an earlier collision of the same trees.
    pub(crate) ignores_order: bool,
}

impl<R: Real> CollisionSearch<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>, max_contacts: usize) -> Self {
        let rolling = if compiled.has_rolling_friction { max_contacts } else { 0 };
        Self {
            swept: SweptPair::new(compiled),
            rates: Vec::with_capacity(max_contacts + rolling),
            pairs: Vec::with_capacity(max_contacts * R::LANES),
            v_predicted: vec![R::zero(); compiled.nv],
        }
    }

    /// Fills with NaN the buffers that a step computes before it reads them.
    pub(crate) fn poison(&mut self) {
        self.v_predicted.fill(R::of(f64::NAN));
    }

    /// Finds the candidate pairs that collide first. Returns the lanes with any.
    ///
    /// The motion has the velocity `v_predicted` after the step, or `v_solved`. [`CollisionSearch::list_candidates`] must run before.
    pub(crate) fn find(
        &mut self,
        query: &CollisionQuery<'_, R>,
        predicted: bool,
        v_solved: &[R],
        problem: &ConstraintProblem<R>,
    ) -> R::Mask {
        let Self { swept, v_predicted, .. } = self;
        R::vectorize(
            #[inline(always)]
            || swept.set_velocity(query.compiled, query.kinematics, if predicted { v_predicted } else { v_solved }),
        );
        R::vectorize(
            #[inline(always)]
            || self.test_paths(query, problem),
        );
        if !query.ignores_order {
            self.keep_earliest(query, problem);
        }
        self.pairs.iter().fold(R::Mask::splat(false), |lanes, candidate| lanes.or(candidate.lanes))
    }

    /// Lanes in which `pair` collides.
    #[inline(always)]
    pub(crate) fn lanes_of(&self, pair: usize) -> R::Mask {
        self.pairs.iter().find(|candidate| candidate.pair == pair).map_or(R::Mask::splat(false), |candidate| candidate.lanes)
    }

    /// Lists the pairs whose linearised gap closes. `w` is the scaled velocity change by the impulses. Returns whether there are any.
    pub(crate) fn list_candidates(&mut self, query: &CollisionQuery<'_, R>, problem: &ConstraintProblem<R>, w: &[R]) -> bool {
        self.rates.clear();
        self.pairs.clear();
        R::vectorize(
            #[inline(always)]
            || {
                for contact in &problem.deferred {
                    let touch = touch_tolerance(query, problem, contact.slot);
                    let velocity = problem.rows.normal_velocity(contact.contact, w);
                    let rate = velocity - contact.bias;
                    let end = query.contacts.data[contact.slot].point.distance + problem.closing_time * rate;
                    let closes = contact.bounces.and(velocity.lt(R::zero())).or(end.lt(-touch).and_not(contact.bounces));
                    self.rates.push((rate, contact.lanes.and(query.lanes).and(closes)));
                }
            },
        );
        for (contact, &(_, closes)) in problem.deferred.iter().zip(&self.rates) {
            for (pair, lanes) in query.contacts.pairs(contact.slot, closes.bits()) {
                let lanes = R::Mask::from_bits(lanes);
                match self.pairs.iter_mut().find(|candidate| candidate.pair == pair) {
                    Some(candidate) => candidate.lanes = candidate.lanes.or(lanes),
                    None => self.pairs.push(CandidatePair { pair, lanes, tolerance: R::zero(), time: R::zero(), later_lanes: 0 }),
                }
            }
        }
        !self.pairs.is_empty()
    }

    /// Reduces the lanes of each candidate to those in which its path collides. Finds the times of first touch in lanes with several.
    #[inline(always)]
    fn test_paths(&mut self, query: &CollisionQuery<'_, R>, problem: &ConstraintProblem<R>) {
        let CollisionQuery { compiled, kinematics, poses, .. } = *query;
        let Self { swept, rates, pairs, .. } = self;
        let time = problem.closing_time;
        let path = |index: usize, pair| Path { compiled, kinematics, start: &poses.placed, time, slack: poses.slack, index, pair };
        let (mut once, mut several) = (R::Mask::splat(false), R::Mask::splat(false));
        for candidate in pairs.iter_mut() {
            let pair = compiled.pair(candidate.pair);
            let (gap, touch) = farthest_closing_gap(query, problem, rates, candidate);
            let least = -(gap.distance + time * gap.rate) * R::of(query.margin);
            candidate.tolerance = resting_overlap(query, problem, candidate) + touch;
            let tolerance = candidate.tolerance.max(least);
            (candidate.lanes, candidate.time) = swept.find_touch(&path(candidate.pair, pair), candidate.lanes, gap, tolerance);
            several = several.or(once.and(candidate.lanes));
            once = once.or(candidate.lanes);
        }
        if query.ignores_order || several.none() {
            return;
        }
        for candidate in pairs.iter_mut().filter(|candidate| candidate.lanes.and(several).any()) {
            let (pair, lanes) = (compiled.pair(candidate.pair), candidate.lanes.and(several));
            candidate.time = swept.first_touch(&path(candidate.pair, pair), lanes, candidate.time, candidate.tolerance);
        }
    }

    /// Removes candidates from the lanes in which another pair of the same trees touches earlier.
    ///
    /// The earlier impact changes the motion of these trees.
    fn keep_earliest(&mut self, query: &CollisionQuery<'_, R>, problem: &ConstraintProblem<R>) {
        let lanes = self.pairs.iter().fold(0, |bits, candidate| bits | candidate.lanes.bits());
        let trees_of = |candidate: &CandidatePair<R>| trees_of_pair(query.compiled, candidate.pair);
        for lane in each_of(lanes) {
            let here = |candidate: &&CandidatePair<R>| candidate.lanes.bits() >> lane & 1 == 1;
            let time = |candidate: &CandidatePair<R>| candidate.time.lane(lane).to_f64();
            let window = SIMULTANEOUS_FRACTION * problem.closing_time.lane(lane).to_f64();
            for i in 0..self.pairs.len() {
                let candidate = self.pairs[i];
                let shares =
                    |other: &CandidatePair<R>| trees_of(other).iter().flatten().any(|tree| trees_of(&candidate).contains(&Some(*tree)));
                let is_later = self.pairs.iter().filter(here).any(|other| time(other) < time(&candidate) - window && shares(other));
                self.pairs[i].later_lanes |= u32::from(is_later) << lane;
            }
        }
        for candidate in &mut self.pairs {
            candidate.lanes = candidate.lanes.and_not(R::Mask::from_bits(candidate.later_lanes));
        }
    }
}

/// Linearised gap of a pair and its [`touch_tolerance`], m, of the deferred contact that overlaps most at the end of the path.
#[inline(always)]
fn farthest_closing_gap<R: Real>(
    query: &CollisionQuery<'_, R>,
    problem: &ConstraintProblem<R>,
    rates: &[(R, R::Mask)],
    candidate: &CandidatePair<R>,
) -> (Gap<R>, R) {
    let mut touch = R::zero();
    let mut gap = Gap { distance: R::zero(), rate: R::zero() };
    let mut farthest = R::of(f64::INFINITY);
    for (contact, &(rate, closes)) in problem.deferred.iter().zip(rates) {
        for (pair, lanes) in query.contacts.pairs(contact.slot, closes.and(candidate.lanes).bits()) {
            if pair == candidate.pair {
                let distance = query.contacts.data[contact.slot].point.distance;
                let end = distance + problem.closing_time * rate;
                let here = R::Mask::from_bits(lanes).and(end.lt(farthest));
                farthest = R::select(here, end, farthest);
                gap = Gap { distance: R::select(here, distance, gap.distance), rate: R::select(here, rate, gap.rate) };
                touch = R::select(here, touch_tolerance(query, problem, contact.slot), touch);
            }
        }
    }
    (gap, touch)
}

/// Overlap of resting contacts nearby, at most the slop, m. A body that slides over flush supports keeps it from one support to the next.
#[inline(always)]
fn resting_overlap<R: Real>(query: &CollisionQuery<'_, R>, problem: &ConstraintProblem<R>, candidate: &CandidatePair<R>) -> R {
    let compiled = query.compiled;
    let frames_of = |pair: usize| compiled.pair_geoms(pair).expect("made from this compiled").map(|g| compiled.geoms[g].frame);
    let mut overlap = R::zero();
    for lane in each_of(candidate.lanes.bits()) {
        let deepest = problem.resting_overlap(query.contacts, frames_of, frames_of(candidate.pair), lane);
        overlap.set_lane(lane, R::of(deepest).lane(lane));
    }
    overlap.min(R::of(query.options.slop))
}

/// Overlap at the end of the path that counts as touch, m: the motion of a resting contact, or the rounding of positions if larger.
#[inline(always)]
fn touch_tolerance<R: Real>(query: &CollisionQuery<'_, R>, problem: &ConstraintProblem<R>, slot: usize) -> R {
    (problem.closing_time * R::of(resting_speed(query.options))).max(query.contacts.data[slot].point.rounding())
}

/// Kinematic trees of the bodies of a pair. `None` for the world and mocap bodies.
fn trees_of_pair<R: Real>(compiled: &LaneModel<R>, pair: usize) -> [Option<usize>; 2] {
    let geoms = compiled.pair_geoms(pair).expect("made from this compiled");
    geoms.map(|g| compiled.geoms[g].frame.checked_sub(1).and_then(|link| compiled.links.get(link)).map(|link| link.tree))
}
