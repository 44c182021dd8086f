//! Collision search: finds the pairs of geoms with deferred contacts that collide in the motion of a step. The solver leaves out deferred
//! contacts.

use stepper_real::{Mask, Real, kernel};

use crate::collision::swept_pair::{Gap, Path, SweptPair, Touch, Turning};
use crate::compile::LaneModel;
use crate::constraints::ConstraintProblem;
use crate::constraints::contact::approaching::resting_speed;
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::step_input::StepInput;
use crate::math::lanes::each_of;
use crate::tuning::SIMULTANEOUS_FRACTION;

/// Number of secant steps that approximate the time of first touch. Bisections follow, because secants can stall where the path is curved.
const SECANTS: usize = 4;

/// Largest number of evaluations of a pair's distance in the search for the time of first touch. Secants need two or three, and ten
/// bisections give 1e-3 of the path.
const MAX_EVALUATIONS: usize = SECANTS + 10;

/// Collision search: pairs with deferred contacts, and the lanes in which they collide in the motion of the step.
#[derive(Clone, Debug)]
pub(crate) struct CollisionSearch<R: Real> {
    /// Workspace for the distance of a pair along its path.
    swept: SweptPair<R>,
    /// For each deferred contact: normal velocity in the searched motion, m/s, and lanes in which the contact may collide. There its
    /// linearised gap closes (the gap at a constant normal velocity). A contact that bounces may collide where its normal velocity is below
    /// the target velocity.
    rates: Vec<(R, R::Mask)>,
    /// Candidate pairs: pairs with a deferred contact that may collide in some lane.
    pairs: Vec<CandidatePair<R>>,
    /// Generalized velocity after the step with the predicted impulses, nv.
    pub(crate) v_by_predicted_impulses: Vec<R>,
}

/// Candidate pair: a pair of geoms with a deferred contact that may collide, see [`CollisionSearch::rates`].
#[derive(Clone, Copy, Debug)]
struct CandidatePair<R: Real> {
    /// Index of the pair in the compiled model.
    pair: usize,
    /// Lanes in which a deferred contact of the pair may collide. The search reduces them to those in which the pair collides. Outside
    /// `finds_all`, it also removes lanes in which another pair of the same trees collides earlier.
    lanes: R::Mask,
    /// Overlap up to which the pair counts as not colliding, m: that of the bodies' other contacts plus the touch tolerance. In the
    /// predicted motion, the overlap must also exceed the fraction [`CollisionQuery::overlap_fraction`] of the linearised overlap.
    tolerance: R,
    /// Rotation of the two bodies on the path.
    turning: Turning<R>,
    /// Time at which the pair overlaps, s. `before` is an earlier time at which the pair does not touch yet. There is a first touch between
    /// these two times. The search narrows this bracket where the order of collisions matters.
    time: R,
    before: R,
    /// Distance plus tolerance at the time `time`, m, which is negative. `distance_before` is the same quantity at the time `before`.
    distance_at_time: R,
    distance_before: R,
    /// Lanes in which it is uncertain whether this pair or another one of the same trees touches first.
    uncertain: R::Mask,
    /// Lanes in which the collision is doubtful: it may be an error of the predicted motion.
    doubtful: R::Mask,
    /// Lanes in which another pair of the same kinematic trees touches earlier.
    later: R::Mask,
}

impl<R: Real> CandidatePair<R> {
    /// Stores the touch of the pair that the search found on its path. If its overlap exceeds the tolerance by at most `error`, m, the
    /// collision counts as doubtful.
    #[inline(always)]
    fn store_touch(&mut self, touch: &Touch<R>, error: R) {
        (self.lanes, self.time, self.distance_at_time) = (touch.lanes, touch.time, self.tolerance - touch.overlap);
        self.doubtful = touch.lanes.and(touch.overlap.le(self.tolerance + error));
    }

    /// Time of the evaluation with number `evaluation` in the search for the first touch, s. A secant approximates the touch, because the
    /// distance decreases almost linearly. After [`SECANTS`] evaluations, the bracket is bisected.
    ///
    /// Secant evaluations alternate between a quarter of `window` (s) before and after the approximation, so that two of them bracket the
    /// touch.
    #[inline(always)]
    fn next_time(&self, evaluation: usize, window: R) -> R {
        let half = R::of(0.5);
        let drop = self.distance_before - self.distance_at_time;
        let is_usable = drop.lt(R::of(f64::INFINITY)).and(drop.gt(R::zero()));
        let fraction = if evaluation < SECANTS { R::select(is_usable, self.distance_before / drop, half) } else { half };
        let span = self.time - self.before;
        let offset = if evaluation >= SECANTS {
            R::zero()
        } else if evaluation.is_multiple_of(2) {
            -(window * R::of(0.25))
        } else {
            window * R::of(0.25)
        };
        let time = self.before + span * fraction.max(R::zero()) + R::select(is_usable, offset, R::zero());
        // A bracket that is narrower than this offset is bisected.
        R::select(time.gt(self.before).and(time.lt(self.time)), time, self.before + span * half)
    }

    /// Lanes in which the brackets decide whether this pair touches more than `window` (s) before the pair `other`.
    #[inline(always)]
    fn order_is_decided(&self, other: &Self, window: R) -> R::Mask {
        self.time.lt(other.before - window).or(self.before.ge(other.time - window))
    }

    /// Narrows the bracket of the first touch in the lanes `lanes`, with the `distance` (m) of the pair at `time` (s).
    #[inline(always)]
    fn narrow(&mut self, lanes: R::Mask, time: R, distance: R) {
        let distance = distance + self.tolerance;
        let touches = distance.lt(R::zero());
        let (deep, clear) = (lanes.and(touches), lanes.and_not(touches));
        self.time = R::select(deep, time, self.time);
        self.distance_at_time = R::select(deep, distance, self.distance_at_time);
        self.before = R::select(clear, time, self.before);
        self.distance_before = R::select(clear, distance, self.distance_before);
    }
}

/// Inputs of one collision search, in the lanes `input.alive`.
pub(crate) struct CollisionQuery<'a, R: Real> {
    /// Constraint problem with the deferred contacts.
    pub(crate) problem: &'a ConstraintProblem<R>,
    pub(crate) input: StepInput<'a, R>,
    pub(crate) evaluation: &'a Evaluation<R>,
    /// Smallest overlap on the path that counts as a collision, as a fraction of the linearised overlap. The linearised overlap is the
    /// overlap at the end of the path if the gap closed at its initial rate.
    ///
    /// The fraction is 0 for the solved motion, and positive for the predicted motion, because that motion has an error.
    pub(crate) overlap_fraction: f64,
    /// Speed that the error of the predicted motion may have, m/s.
    pub(crate) error: R,
    /// Lanes in which all colliding pairs count. In the others, only the earliest collision of each kinematic tree counts, and those that
    /// follow it within [`SIMULTANEOUS_FRACTION`] of the path.
    pub(crate) finds_all: R::Mask,
}

impl<'a, R: Real> CollisionQuery<'a, R> {
    /// Time within which the pair with index `index` may close its gap, s.
    #[inline(always)]
    fn closing_time(&self, index: usize) -> R {
        let geoms = self.input.compiled.pair_geoms(index).expect("a pair index of this compiled model");
        self.evaluation.times.of_pair(self.input.compiled, geoms).closing
    }

    /// Time within which the contacts in slot `slot` may close their gaps, s.
    #[inline(always)]
    fn closing_time_of_slot(&self, slot: usize) -> R {
        let Evaluation { times, contacts, .. } = self.evaluation;
        times.of_slot(self.input.compiled, contacts, slot, contacts.lanes_of(slot)).closing
    }

    /// Path of the pair with index `index` in the searched motion.
    #[inline(always)]
    fn path(&self, index: usize) -> Path<'a, R> {
        let (compiled, Evaluation { kinematics, collision, .. }) = (self.input.compiled, self.evaluation);
        let pair = compiled.pair(index);
        Path { compiled, kinematics, start: &collision.poses, time: self.closing_time(index), slack: collision.slack, index, pair }
    }
}

impl<R: Real> CollisionSearch<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>, max_contacts: usize) -> Self {
        let rotating = if compiled.has_rolling_friction { 2 * max_contacts } else { 0 };
        Self {
            swept: SweptPair::new(compiled),
            rates: Vec::with_capacity(max_contacts + rotating),
            pairs: Vec::with_capacity(max_contacts * R::LANES),
            v_by_predicted_impulses: vec![R::zero(); compiled.nv],
        }
    }

    /// Fills with NaN, for tests, the buffers that a step must compute before it reads them.
    pub(crate) fn poison(&mut self) {
        self.v_by_predicted_impulses.fill(R::of(f64::NAN));
    }

    /// Tests the candidate pairs in the motion of the step, and reduces the lanes of each to those in which it collides. Returns the lanes
    /// in which any pair collides.
    ///
    /// The velocity after the step is `v_by_predicted_impulses` if `predicted` is true, otherwise `v_solved`.
    /// [`CollisionSearch::list_candidates`] must be called first.
    pub(crate) fn find(&mut self, query: &CollisionQuery<'_, R>, predicted: bool, v_solved: &[R]) -> R::Mask {
        kernel!(R, || {
            let v: &[R] = if predicted { &self.v_by_predicted_impulses } else { v_solved };
            self.swept.set_velocity(query.input.compiled, &query.evaluation.kinematics, v);
            self.test_paths(query);
        });
        self.pairs.iter().fold(R::Mask::splat(false), |lanes, candidate| lanes.or(candidate.lanes))
    }

    /// Lanes in which the pair with index `pair` collides, and those of them in which the error of the predicted motion may cause the
    /// overlap.
    #[inline(always)]
    pub(crate) fn lanes_of(&self, pair: usize) -> [R::Mask; 2] {
        let candidate = self.pairs.iter().find(|candidate| candidate.pair == pair);
        candidate.map_or([R::Mask::splat(false); 2], |candidate| [candidate.lanes, candidate.doubtful])
    }

    /// Lists the candidate pairs, whose deferred contacts may collide. `w` is the scaled velocity change by the impulses. Returns whether
    /// there are any.
    pub(crate) fn list_candidates(&mut self, query: &CollisionQuery<'_, R>, w: &[R]) -> bool {
        let (problem, zero, none) = (query.problem, R::zero(), R::Mask::splat(false));
        self.rates.clear();
        self.pairs.clear();
        kernel!(R, || {
            for contact in &problem.deferred {
                let tolerance = touch_tolerance(query, contact.slot);
                let velocity = problem.rows.contacts.normal_velocity_above_target(contact.contact, w);
                let rate = velocity - contact.bias;
                let end = query.evaluation.contacts.data[contact.slot].point.distance + query.closing_time_of_slot(contact.slot) * rate;
                let closes = contact.bounces.and(velocity.lt(R::zero())).or(end.lt(-tolerance).and_not(contact.bounces));
                self.rates.push((rate, contact.lanes.and(query.input.alive).and(closes)));
            }
        });
        for (contact, &(_, closes)) in problem.deferred.iter().zip(&self.rates) {
            for (pair, lanes) in query.evaluation.contacts.pairs(contact.slot, closes.bits()) {
                let lanes = R::Mask::from_bits(lanes);
                match self.pairs.iter_mut().find(|candidate| candidate.pair == pair) {
                    Some(candidate) => candidate.lanes = candidate.lanes.or(lanes),
                    None => self.pairs.push(CandidatePair {
                        pair,
                        lanes,
                        tolerance: zero,
                        turning: Turning::none(),
                        time: zero,
                        before: zero,
                        distance_at_time: zero,
                        distance_before: zero,
                        uncertain: none,
                        doubtful: none,
                        later: none,
                    }),
                }
            }
        }
        !self.pairs.is_empty()
    }

    /// Tests the path of each candidate pair, and reduces the lanes of the candidate to those in which it collides. Outside
    /// `finds_all`, it also removes lanes in which another pair of the same trees collides earlier.
    #[inline(always)]
    fn test_paths(&mut self, query: &CollisionQuery<'_, R>) {
        let Self { swept, rates, pairs, .. } = self;
        for candidate in pairs.iter_mut() {
            let path = query.path(candidate.pair);
            let (gap, tolerance_of_contact) = farthest_closing_gap(query, rates, candidate);
            let least = -(gap.distance + path.time * gap.rate) * R::of(query.overlap_fraction);
            candidate.tolerance = resting_overlap(query, candidate) + tolerance_of_contact;
            candidate.distance_before = gap.distance + candidate.tolerance;
            let tolerance = candidate.tolerance.max(least);
            candidate.turning = swept.turning(&path, candidate.lanes);
            let touch = swept.find_touch(&path, &candidate.turning, candidate.lanes, gap, tolerance);
            candidate.store_touch(&touch, query.error * path.time);
        }
        let (mut once, mut several) = (R::Mask::splat(false), R::Mask::splat(false));
        for candidate in pairs.iter() {
            several = several.or(once.and(candidate.lanes));
            once = once.or(candidate.lanes);
        }
        let earliest_only = several.and_not(query.finds_all);
        if earliest_only.any() {
            let window = query.evaluation.times.h * R::of(SIMULTANEOUS_FRACTION);
            self.narrow_times(query, earliest_only, window);
            self.keep_earliest(query.input.compiled, earliest_only, window);
        }
    }

    /// Narrows the times of first touch in the lanes `several` until the order of the collisions is certain, or after [`MAX_EVALUATIONS`]
    /// evaluations of a pair's distance. Times that differ by less than `window` (s) count as equal.
    #[inline(always)]
    fn narrow_times(&mut self, query: &CollisionQuery<'_, R>, several: R::Mask, window: R) {
        for evaluation in 0..MAX_EVALUATIONS {
            self.find_uncertain(query.input.compiled, several, window);
            let Self { swept, pairs, .. } = self;
            let mut is_certain = true;
            for candidate in pairs.iter_mut().filter(|candidate| candidate.uncertain.any()) {
                is_certain = false;
                let (lanes, time) = (candidate.uncertain, candidate.next_time(evaluation, window));
                let gap = swept.gap_at(&query.path(candidate.pair), candidate.turning.lanes, time, lanes);
                candidate.narrow(lanes, time, gap.distance);
            }
            if is_certain {
                return;
            }
        }
    }

    /// Finds, in the lanes `several`, the candidates for which it is uncertain whether another candidate of the same trees touches first.
    /// Times that differ by less than `window` (s) count as equal.
    #[inline(always)]
    fn find_uncertain(&mut self, compiled: &LaneModel<R>, several: R::Mask, window: R) {
        for candidate in &mut self.pairs {
            candidate.uncertain = R::Mask::splat(false);
        }
        for i in 1..self.pairs.len() {
            let (others, rest) = self.pairs.split_at_mut(i);
            let candidate = &mut rest[0];
            for other in others {
                let open = several.and(candidate.lanes).and(other.lanes);
                let open = open.and_not(candidate.order_is_decided(other, window).and(other.order_is_decided(candidate, window)));
                if open.any() && share_trees(compiled, candidate.pair, other.pair) {
                    (candidate.uncertain, other.uncertain) = (candidate.uncertain.or(open), other.uncertain.or(open));
                }
            }
        }
    }

    /// Removes from each candidate those of the lanes `lanes` in which another pair of the same kinematic trees touches earlier, by more
    /// than `window` (s).
    ///
    /// That earlier impact changes the motion of these trees, so that the later collision may not occur.
    #[inline(always)]
    fn keep_earliest(&mut self, compiled: &LaneModel<R>, lanes: R::Mask, window: R) {
        for i in 0..self.pairs.len() {
            let candidate = self.pairs[i];
            let mut later = R::Mask::splat(false);
            for other in &self.pairs {
                let earlier = lanes.and(candidate.lanes).and(other.lanes).and(other.time.lt(candidate.time - window));
                if earlier.any() && share_trees(compiled, other.pair, candidate.pair) {
                    later = later.or(earlier);
                }
            }
            self.pairs[i].later = later;
        }
        for candidate in &mut self.pairs {
            candidate.lanes = candidate.lanes.and_not(candidate.later);
        }
    }
}

/// Linearised gap of a candidate pair, and the [`touch_tolerance`] of a contact, m. Of the pair's deferred contacts, the one with the
/// largest overlap at the end of the path determines both.
#[inline(always)]
fn farthest_closing_gap<R: Real>(query: &CollisionQuery<'_, R>, rates: &[(R, R::Mask)], candidate: &CandidatePair<R>) -> (Gap<R>, R) {
    let problem = query.problem;
    let mut tolerance = R::zero();
    let mut gap = Gap { distance: R::zero(), rate: R::zero() };
    let mut farthest = R::of(f64::INFINITY);
    for (contact, &(rate, closes)) in problem.deferred.iter().zip(rates) {
        for (pair, lanes) in query.evaluation.contacts.pairs(contact.slot, closes.and(candidate.lanes).bits()) {
            if pair == candidate.pair {
                let distance = query.evaluation.contacts.data[contact.slot].point.distance;
                let end = distance + query.closing_time(pair) * rate;
                let here = R::Mask::from_bits(lanes).and(end.lt(farthest));
                farthest = R::select(here, end, farthest);
                gap = Gap { distance: R::select(here, distance, gap.distance), rate: R::select(here, rate, gap.rate) };
                tolerance = R::select(here, touch_tolerance(query, contact.slot), tolerance);
            }
        }
    }
    (gap, tolerance)
}

/// Largest overlap of the contacts of either body of a candidate pair that are not deferred, m, but at most the slop (the overlap that
/// position correction leaves). A body that slides to a support of the same height has this overlap there too.
#[inline(always)]
fn resting_overlap<R: Real>(query: &CollisionQuery<'_, R>, candidate: &CandidatePair<R>) -> R {
    let compiled = query.input.compiled;
    let frames_of = |pair: usize| compiled.pair_geoms(pair).expect("a pair index of this compiled model").map(|g| compiled.geoms[g].frame);
    let mut overlap = R::zero();
    for lane in each_of(candidate.lanes.bits()) {
        let deepest = query.problem.resting_overlap(&query.evaluation.contacts, frames_of, frames_of(candidate.pair), lane);
        overlap.set_lane(lane, R::of(deepest).lane(lane));
    }
    overlap.min(R::of(query.input.options.slop))
}

/// Smallest overlap at the end of the path that counts as a touch, m. It is the displacement during the path at the largest speed of a
/// resting contact, or the rounding error of positions if that is larger.
#[inline(always)]
fn touch_tolerance<R: Real>(query: &CollisionQuery<'_, R>, slot: usize) -> R {
    (query.closing_time_of_slot(slot) * R::of(resting_speed(query.input.options)))
        .max(query.evaluation.contacts.data[slot].point.rounding())
}

/// Whether the pairs of geoms with the indices `first` and `second` both have a body of the same kinematic tree.
fn share_trees<R: Real>(compiled: &LaneModel<R>, first: usize, second: usize) -> bool {
    let [first, second] = [first, second].map(|pair| {
        let geoms = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
        geoms.map(|g| compiled.tree_of(compiled.geoms[g].frame))
    });
    first.iter().flatten().any(|tree| second.contains(&Some(*tree)))
}
