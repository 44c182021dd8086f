//! Search for the pairs of geoms with deferred contacts that collide in the motion of a step.

use stepper_real::{Mask, Real, Scalar};

use crate::collision::contact_set::Contacts;
use crate::collision::detection::GeomPoses;
use crate::collision::packed_pairs::{Item, gather_scalars};
use crate::collision::packed_sweep::{PackedSweep, is_packed};
use crate::collision::swept_pair::{Gap, Path, SweptPair, Touch};
use crate::compile::{CompiledPair, Kernel, LaneModel};
use crate::constraints::ConstraintProblem;
use crate::constraints::approaching::resting_speed;
use crate::dynamics::kinematics::Kinematics;
use crate::math::lanes::{MAX_LANES, each_of};
use crate::options::StepSettings;
use crate::tuning::SIMULTANEOUS_FRACTION;

/// Number of bisections for the time of first touch at most. Ten give 1e-3 of the path.
const BISECTIONS: usize = 10;

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
    /// Pairs that are tested side by side.
    packed: Vec<PackedPath<R::Scalar>>,
}

/// Path of a candidate in one lane, tested side by side with others.
#[derive(Clone, Copy, Debug)]
struct PackedPath<S> {
    /// Index of the candidate.
    candidate: usize,
    kernel: Kernel,
    item: Item<S>,
    gap: Gap<S>,
    /// Overlap on the path that counts, m.
    tolerance: S,
    /// Time until which the first touch is searched, s.
    until: S,
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
    /// Time at which the pair touches, and a time before its first touch, s: both are narrowed where the order of candidates matters.
    time: R,
    before: R,
    /// Lanes in which the overlap may be due to the error of the motion.
    doubtful: R::Mask,
    /// Lanes (bits) in which another pair of the same trees touches earlier.
    later_lanes: u32,
}

impl<R: Real> CandidatePair<R> {
    /// Takes over the first touch of the pair. An overlap of at most `error` beyond the tolerance is doubtful.
    #[inline(always)]
    fn take(&mut self, touch: &Touch<R>, error: R) {
        (self.lanes, self.time) = (touch.lanes, touch.time);
        self.doubtful = touch.lanes.and(touch.overlap.le(self.tolerance + error));
    }

    /// Takes over the first touch of the pair in `lane`, from the place `place` of a packed search.
    #[inline(always)]
    fn take_lane(&mut self, touch: &Touch<R>, place: usize, error: R, lane: usize) {
        let own = R::Mask::from_bits(1 << lane);
        self.lanes = self.lanes.or(own);
        self.time.set_lane(lane, touch.time.lane(place));
        if touch.overlap.lane(place) <= self.tolerance.lane(lane) + error.lane(lane) {
            self.doubtful = self.doubtful.or(own);
        }
    }
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
    /// Overlap that the error of the motion may cause, m.
    pub(crate) error: R,
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
            packed: vec![],
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

    /// Lanes in which `pair` collides, and those of them in which the error of the motion may cause the overlap.
    #[inline(always)]
    pub(crate) fn lanes_of(&self, pair: usize) -> [R::Mask; 2] {
        let candidate = self.pairs.iter().find(|candidate| candidate.pair == pair);
        candidate.map_or([R::Mask::splat(false); 2], |candidate| [candidate.lanes, candidate.doubtful])
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
                    None => self.pairs.push(CandidatePair {
                        pair,
                        lanes,
                        tolerance: R::zero(),
                        time: R::zero(),
                        before: R::zero(),
                        doubtful: R::Mask::splat(false),
                        later_lanes: 0,
                    }),
                }
            }
        }
        !self.pairs.is_empty()
    }

    /// Reduces the lanes of each candidate to those in which its path collides. Finds the times of first touch in lanes with several.
    #[inline(always)]
    fn test_paths(&mut self, query: &CollisionQuery<'_, R>, problem: &ConstraintProblem<R>) {
        let CollisionQuery { compiled, kinematics, poses, .. } = *query;
        let Self { swept, rates, pairs, packed, .. } = self;
        let time = problem.closing_time;
        let path = |index: usize, pair| Path { compiled, kinematics, start: &poses.placed, time, slack: poses.slack, index, pair };
        packed.clear();
        for (k, candidate) in pairs.iter_mut().enumerate() {
            let pair = compiled.pair(candidate.pair);
            let (gap, touch) = farthest_closing_gap(query, problem, rates, candidate);
            let least = -(gap.distance + time * gap.rate) * R::of(query.margin);
            candidate.tolerance = resting_overlap(query, problem, candidate) + touch;
            let tolerance = candidate.tolerance.max(least);
            if is_packed(compiled, &pair, candidate.lanes.bits()) {
                add_packed(packed, k, (candidate.pair, &pair), candidate.lanes, gap, [tolerance, R::zero()]);
                candidate.lanes = R::Mask::splat(false);
            } else {
                let touch = swept.find_touch(&path(candidate.pair, pair), candidate.lanes, gap, tolerance);
                candidate.take(&touch, query.error);
            }
        }
        for_each_packed::<R>(
            packed,
            #[inline(always)]
            |kernel, batch, items| {
                let sweep = PackedSweep::new(swept, &path(batch[0].item.index, compiled.pair(batch[0].item.index)), kernel, items);
                let gap = Gap {
                    distance: gather_scalars(
                        batch,
                        #[inline(always)]
                        |b| b.gap.distance,
                    ),
                    rate: gather_scalars(
                        batch,
                        #[inline(always)]
                        |b| b.gap.rate,
                    ),
                };
                let (used, tolerance) = (
                    R::Mask::from_bits((1u64 << batch.len()).wrapping_sub(1) as u32),
                    gather_scalars(
                        batch,
                        #[inline(always)]
                        |b| b.tolerance,
                    ),
                );
                let touch = sweep.find_touch(gap, used, tolerance);
                for place in each_of(touch.lanes.bits()) {
                    let (candidate, lane) = (&mut pairs[batch[place].candidate], batch[place].item.lane);
                    candidate.take_lane(&touch, place, query.error, lane);
                }
            },
        );
        let (mut once, mut several) = (R::Mask::splat(false), R::Mask::splat(false));
        for candidate in pairs.iter() {
            several = several.or(once.and(candidate.lanes));
            once = once.or(candidate.lanes);
        }
        if !query.ignores_order {
            self.narrow_times(query, several, time);
        }
    }

    /// Narrows the times of first touch in the lanes `several` by at most [`BISECTIONS`]. Those of paths that are not packed are narrowed
    /// until the order of the candidates is certain. `closing_time` is the duration of the paths, s.
    #[inline(always)]
    fn narrow_times(&mut self, query: &CollisionQuery<'_, R>, several: R::Mask, closing_time: R) {
        let CollisionQuery { compiled, kinematics, poses, .. } = *query;
        let path =
            |index: usize, pair| Path { compiled, kinematics, start: &poses.placed, time: closing_time, slack: poses.slack, index, pair };
        let Self { swept, pairs, packed, .. } = self;
        packed.clear();
        for (k, candidate) in pairs.iter().enumerate().filter(|(_, candidate)| candidate.lanes.and(several).any()) {
            let (pair, lanes) = (compiled.pair(candidate.pair), candidate.lanes.and(several));
            if is_packed(compiled, &pair, candidate.lanes.bits()) {
                let gap = Gap { distance: R::zero(), rate: R::zero() };
                add_packed(packed, k, (candidate.pair, &pair), lanes, gap, [candidate.tolerance, candidate.time]);
            }
        }
        for_each_packed::<R>(
            packed,
            #[inline(always)]
            |kernel, batch, items| {
                let sweep = PackedSweep::new(swept, &path(batch[0].item.index, compiled.pair(batch[0].item.index)), kernel, items);
                let until = gather_scalars(
                    batch,
                    #[inline(always)]
                    |b| b.until,
                );
                let tolerance: R = gather_scalars(
                    batch,
                    #[inline(always)]
                    |b| b.tolerance,
                );
                let mut times = [R::zero(), until];
                for _ in 0..BISECTIONS {
                    let middle = (times[0] + times[1]) * R::of(0.5);
                    let deep = sweep.gap_at(middle, R::Mask::splat(true)).distance.lt(-tolerance);
                    times = [R::select(deep, times[0], middle), R::select(deep, middle, times[1])];
                }
                for (place, path) in batch.iter().enumerate() {
                    let candidate = &mut pairs[path.candidate];
                    candidate.before.set_lane(path.item.lane, times[0].lane(place));
                    candidate.time.set_lane(path.item.lane, times[1].lane(place));
                }
            },
        );
        for _ in 0..BISECTIONS {
            let open = R::Mask::from_bits(self.lanes_without_order(compiled, several.bits(), closing_time));
            if open.none() {
                return;
            }
            let Self { swept, pairs, .. } = self;
            for candidate in pairs.iter_mut().filter(|candidate| candidate.lanes.and(open).any()) {
                let (pair, lanes) = (compiled.pair(candidate.pair), candidate.lanes.and(open));
                if !is_packed(compiled, &pair, candidate.lanes.bits()) {
                    let middle = (candidate.before + candidate.time) * R::of(0.5);
                    let deep = swept.gap_at(&path(candidate.pair, pair), middle, lanes).distance.lt(-candidate.tolerance);
                    candidate.time = R::select(lanes.and(deep), middle, candidate.time);
                    candidate.before = R::select(lanes.and_not(deep), middle, candidate.before);
                }
            }
        }
    }

    /// Lanes (bits) of `several` in which the times of first touch do not yet determine the order of candidates of the same trees.
    fn lanes_without_order(&self, compiled: &LaneModel<R>, several: u32, closing_time: R) -> u32 {
        let mut open = 0;
        for lane in each_of(several) {
            let window = SIMULTANEOUS_FRACTION * closing_time.lane(lane).to_f64();
            let here = || self.pairs.iter().filter(|candidate| candidate.lanes.bits() >> lane & 1 == 1);
            let of = |x: R| x.lane(lane).to_f64();
            let is_certain = |first: &CandidatePair<R>, second: &CandidatePair<R>| {
                of(first.time) < of(second.before) - window || of(first.before) >= of(second.time) - window
            };
            let mut pairs = here().flat_map(|first| here().map(move |second| (first, second)));
            let is_open = pairs.any(|(first, second)| {
                first.pair != second.pair && !is_certain(first, second) && share_trees(compiled, first.pair, second.pair)
            });
            open |= u32::from(is_open) << lane;
        }
        open
    }

    /// Removes candidates from the lanes in which another pair of the same trees touches earlier.
    ///
    /// The earlier impact changes the motion of these trees.
    fn keep_earliest(&mut self, query: &CollisionQuery<'_, R>, problem: &ConstraintProblem<R>) {
        let lanes = self.pairs.iter().fold(0, |bits, candidate| bits | candidate.lanes.bits());
        for lane in each_of(lanes) {
            let here = |candidate: &&CandidatePair<R>| candidate.lanes.bits() >> lane & 1 == 1;
            let time = |candidate: &CandidatePair<R>| candidate.time.lane(lane).to_f64();
            let window = SIMULTANEOUS_FRACTION * problem.closing_time.lane(lane).to_f64();
            for i in 0..self.pairs.len() {
                let candidate = self.pairs[i];
                let shares = |other: &CandidatePair<R>| share_trees(query.compiled, other.pair, candidate.pair);
                let is_later = self.pairs.iter().filter(here).any(|other| time(other) < time(&candidate) - window && shares(other));
                self.pairs[i].later_lanes |= u32::from(is_later) << lane;
            }
        }
        for candidate in &mut self.pairs {
            candidate.lanes = candidate.lanes.and_not(R::Mask::from_bits(candidate.later_lanes));
        }
    }
}

/// Adds the path of a candidate in the lanes `lanes`.
#[inline(always)]
fn add_packed<R: Real>(
    packed: &mut Vec<PackedPath<R::Scalar>>,
    candidate: usize,
    (index, pair): (usize, &CompiledPair<R::Scalar>),
    lanes: R::Mask,
    gap: Gap<R>,
    [tolerance, until]: [R; 2],
) {
    for lane in each_of(lanes.bits()) {
        packed.push(PackedPath {
            candidate,
            kernel: pair.kernel,
            item: Item { index, geoms: pair.geoms, margin: pair.margin, lane },
            gap: Gap { distance: gap.distance.lane(lane), rate: gap.rate.lane(lane) },
            tolerance: tolerance.lane(lane),
            until: until.lane(lane),
        });
    }
}

/// Calls `test` with as many paths of one kernel as a register has lanes, and their items.
#[inline(always)]
fn for_each_packed<R: Real>(packed: &[PackedPath<R::Scalar>], mut test: impl FnMut(Kernel, &[PackedPath<R::Scalar>], &[Item<R::Scalar>])) {
    for kernel in [Kernel::SphereBox, Kernel::CapsuleBox] {
        let mut paths = packed.iter().filter(|path| path.kernel == kernel).peekable();
        while let Some(&&first) = paths.peek() {
            let (mut batch, mut items, mut count) = ([first; MAX_LANES], [first.item; MAX_LANES], 0);
            for path in paths.by_ref().take(R::LANES) {
                (batch[count], items[count]) = (*path, path.item);
                count += 1;
            }
            test(kernel, &batch[..count], &items[..count]);
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

/// Whether two pairs have bodies of one kinematic tree.
fn share_trees<R: Real>(compiled: &LaneModel<R>, first: usize, second: usize) -> bool {
    let (first, second) = (trees_of_pair(compiled, first), trees_of_pair(compiled, second));
    first.iter().flatten().any(|tree| second.contains(&Some(*tree)))
}

/// Kinematic trees of the bodies of a pair. `None` for the world and mocap bodies.
fn trees_of_pair<R: Real>(compiled: &LaneModel<R>, pair: usize) -> [Option<usize>; 2] {
    let geoms = compiled.pair_geoms(pair).expect("made from this compiled");
    geoms.map(|g| compiled.geoms[g].frame.checked_sub(1).and_then(|link| compiled.links.get(link)).map(|link| link.tree))
}
