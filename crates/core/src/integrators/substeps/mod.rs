//! Division of a step into parts, in each lane for itself. There are two reasons to divide a step.
//!
//! **Impacts.** A flight ends at the first elastic impact of its lane (`locate.rs`). The impact is a separate part: the velocity jumps at
//! one configuration. The rest of the step is the next flight. Mechanisms that no impact touches keep their whole step (`untouched.rs`).
//!
//! **Steps that keep an error.** The step is divided into intervals, each with an estimated error of the positions. It is within a share of
//! the user's bound, unless the interval is the shortest. The estimate is that of step doubling (Hairer, Norsett and Wanner, Solving
//! Ordinary Differential Equations I, section II.4). An interval is stepped once as a whole and once in two halves, each with the impacts
//! in it. The distance between both results is the estimate, and the two halves are the result. If the distance is too large, the first
//! half becomes the next interval. The result of a step over it is known already. Lengths are the step divided by powers of two. After an
//! accepted interval, the next one is the longest that begins at a multiple of its length. Kinematic trees with a smooth motion in an
//! interval get the extrapolation of both results, whose order is higher by one (`step_doubling.rs`).
//!
//! Lanes differ in their parts, and what a lane computes does not depend on other lanes. A pass executes stages 1 to 8 and 10 in all lanes,
//! each with the part that it needs next. Lanes that have reached the end of the step wait.
//!
//! Controls, actuator pipelines and sensors act once in a step of the user. Impulses are summed over the parts.

pub mod buffers;
mod step_doubling;
mod untouched;

use stepper_real::{Mask, Real, Scalar, kernel};

use crate::compile::LaneModel;
use crate::dynamics::kinematics::{select_into, separate};
use crate::integrators::evaluate::evaluation::Substep;
use crate::integrators::evaluate::first_impact::shortest_flight;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::integrators::step_outcome::StepOutcome;
use crate::integrators::substeps::buffers::Buffers;
use crate::integrators::substeps::step_doubling::{add_vibrating_trees, extrapolate};
use crate::integrators::substeps::untouched::{note_impacts, spread, step_untouched};
use crate::integrators::workspace::Workspace;
use crate::math::lanes::{MAX_LANES, each_of};
use crate::options::StepSettings;
use crate::stages::s10_record::{Record, Status};
use crate::tuning::{IMPACT_DURATION, MAX_HALVINGS, MAX_IMPACTS, MIN_ERROR_SHARE};

/// Largest factor by which impulses grow as a start for a longer part.
const MAX_IMPULSE_RATIO: f64 = 100.0;

/// Number of the shortest intervals in a step.
const TICKS: u32 = 1 << MAX_HALVINGS;

/// Phase of step doubling.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// The whole interval.
    Whole,
    /// First half of the interval.
    First,
    /// Second half of the interval.
    Second,
    /// Nothing: the lane has reached the end of the step.
    Done,
}

/// Interval of a lane: the step, or a part of it with an error estimate.
#[derive(Clone, Copy, Debug)]
struct Interval {
    /// Beginning and length, in units of the shortest interval.
    begin: u32,
    length: u32,
    phase: Phase,
    /// Whether a result over the interval is not finite.
    broken: bool,
}

/// Progress of a lane in a phase of its interval: flights and impacts.
#[derive(Clone, Copy, Debug, Default)]
struct Progress {
    /// Time since the beginning of the phase, s.
    flown: f64,
    /// Number of impacts in the phase.
    impacts: u32,
    /// Whether the next part is an impact.
    is_impact: bool,
    /// Whether the last part was an impact.
    follows_impact: bool,
}

/// Makes stages 1 to 8 and 10 of a step of `options.timestep` seconds in parts.
///
/// With `options.error`, m or rad, each interval may have a share of this error in proportion to its length, but at least
/// [`MIN_ERROR_SHARE`]. Lanes in which the sum of the estimates exceeds the error have the flag [`Status::INACCURATE`].
///
/// `make` executes the part of `s.evaluation.substep`, without advancing the time of the state, and returns its record with the lanes
/// (bits) that keep their whole state. If stages 1 to 8 of the first part are made already, `solved` is their outcome.
///
/// Afterwards the workspace has the next state. The buffers of velocities and positions have the state before the step, as after one whole
/// step.
#[cold]
#[inline(never)]
pub(crate) fn step_in_parts<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    mut solved: Option<StepOutcome<R>>,
    make: impl Fn(&mut Workspace<R>, Option<StepOutcome<R>>) -> (Record<R>, u32),
) -> Record<R> {
    let mut buffers = s.substep_buffers.take().unwrap_or_else(|| s.new_buffers(compiled));
    let (all, h) = (s.alive, options.timestep);
    // Time during which the impulses of the state acted, s.
    let mut impulse_time = R::of(h);
    buffers.begin(s, impulse_time);
    let mut intervals = [Interval { begin: 0, length: TICKS, phase: Phase::Whole, broken: false }; MAX_LANES];
    let mut progress = [Progress::default(); MAX_LANES];
    // Lanes (bits) that have not reached the end, and lanes that keep the state before the step.
    let (mut active, mut kept) = (all.bits(), 0);
    // Records of the accepted phases, of the first half of each interval, and of the parts of each phase.
    let [mut total, mut first, mut parts] = [Record::none(); 3];
    let mut is_first_pass = true;
    while active != 0 {
        if solved.is_none() {
            begin_pass(s, &mut buffers, options, (&intervals, &progress), active, &mut impulse_time);
        }
        let (made, keeping) = make(s, solved.take());
        parts.add(&made, R::Mask::from_bits(active));
        buffers.note_worst(&s.velocity.worst, made.residual, R::Mask::from_bits(active));
        buffers.note_saturated(compiled, s, R::Mask::from_bits(active));
        if options.error.is_some() {
            buffers.note_not_extrapolated(compiled, options, s, R::Mask::from_bits(active));
        }
        let lanes = [active, keeping];
        let completed = end_parts(compiled, s, &mut buffers, options, (&intervals, &mut progress), lanes, &mut impulse_time);
        if std::mem::take(&mut is_first_pass) {
            buffers.keep_first_pass(s, completed);
        }
        let in_phase =
            |phase| R::Mask::from_bits(each_of(completed).filter(|&l| intervals[l].phase == phase).fold(0, |bits, l| bits | 1 << l));
        let [wholes, firsts, seconds] = [Phase::Whole, Phase::First, Phase::Second].map(in_phase);
        let broken = parts.lanes(Status::NON_FINITE);
        let Buffers { start, whole, separation, not_extrapolated, middle, end, total: sums, summed, configuration, .. } = &mut *buffers;
        // Lanes whose interval is accepted, and lanes whose step is complete.
        let (mut accepted, mut done) = (0, 0);
        let distance = match options.error {
            None => {
                accepted = wholes.bits();
                done = accepted;
                R::zero()
            }
            Some(error) => {
                for (whole, now) in whole.iter_mut().zip([&s.state.v, &s.state.q, &s.state.act]) {
                    select_into(whole, now, wholes);
                }
                start.restore((&mut s.state, &mut s.velocity.scalar_impulse), &mut impulse_time, wholes);
                middle.store((&s.state, &s.velocity.scalar_impulse), impulse_time, firsts);
                first.replace(&parts, firsts);
                let distance = kernel!(R, || separate(compiled, [&whole[1], &s.state.q], separation));
                let mut extrapolated = kernel!(R, || distance.le(R::of(error))).bits();
                for lane in each_of(completed) {
                    let interval = &mut intervals[lane];
                    interval.broken |= broken >> lane & 1 == 1;
                    extrapolated &= !(u32::from(interval.broken) << lane);
                    if interval.advance(distance.lane(lane).to_f64(), error) {
                        accepted |= 1 << lane;
                        done |= u32::from(interval.phase == Phase::Done) << lane;
                    }
                }
                let extrapolated = R::Mask::from_bits(extrapolated & accepted);
                if extrapolated.any() {
                    let state = [&mut s.state.v, &mut s.state.q, &mut s.state.act].map(|list| &mut list[..]);
                    extrapolate(
                        compiled,
                        s.evaluation.scheme.extrapolation(),
                        (extrapolated, not_extrapolated),
                        (whole, separation),
                        state,
                        configuration,
                    );
                }
                let taken = R::Mask::from_bits(accepted);
                not_extrapolated.iter_mut().for_each(|not_extrapolated| *not_extrapolated = not_extrapolated.and_not(taken));
                distance
            }
        };
        let taken = R::Mask::from_bits(accepted);
        let rejected = seconds.and_not(taken);
        if taken.any() {
            if options.error.is_some() {
                sums.add(summed, &middle.state, &middle.scalar_impulse, taken);
                total.add(&first, taken);
                total.add_error(distance, taken);
                start.store((&s.state, &s.velocity.scalar_impulse), impulse_time, taken);
                sums.add(summed, &s.state, &s.velocity.scalar_impulse, taken);
            } else {
                // The only phase: it is copied, and not added to 0, which would change -0.
                sums.store((&s.state, &s.velocity.scalar_impulse), impulse_time, taken);
            }
            total.add(&parts, taken);
            for (end, now) in end.iter_mut().zip([&s.state.v, &s.state.q, &s.state.act]) {
                select_into(end, now, R::Mask::from_bits(done));
            }
        }
        if rejected.any() {
            // The first half of a rejected interval is the next one. The step over it has been made.
            for (whole, middle) in whole.iter_mut().zip([&middle.state.v, &middle.state.q, &middle.state.act]) {
                select_into(whole, middle, rejected);
            }
            start.restore((&mut s.state, &mut s.velocity.scalar_impulse), &mut impulse_time, rejected);
        }
        parts.replace(&Record::none(), R::Mask::from_bits(completed));
        // A lane without any finite motion keeps the state before the step.
        kept |= accepted & keeping;
        active &= !(done | kept);
    }
    match options.error {
        Some(error) => total.flag_inaccurate(error, all),
        None => {
            total.substeps = kernel!(R, || R::select(s.evaluation.divided, total.substeps, R::zero()));
            step_untouched(compiled, options, s, &mut buffers, (kept, &mut total), make);
        }
    }
    end(&buffers, s, options, all, kept);
    total.add_flag(Status::CONTACTS_FULL, s.state.contacts.full & all.bits());
    s.substep_buffers = Some(buffers);
    total
}

/// Ends a step: the workspace gets the state at the end, sums of impulses, and the state before the step, as after one whole step. The
/// lanes `kept` (bits) keep the state before the step and their time.
fn end<R: Real>(buffers: &Buffers<R>, s: &mut Workspace<R>, options: &StepSettings, alive: R::Mask, kept: u32) {
    let Buffers { end, before, total, worst: (worst, _), .. } = buffers;
    s.velocity.worst.copy_lanes(worst, R::Mask::splat(true));
    let keeps = R::Mask::from_bits(kept);
    for (now, (end, before)) in [&mut s.state.v, &mut s.state.q, &mut s.state.act].into_iter().zip(end.iter().zip(before)) {
        now.copy_from_slice(end);
        select_into(now, before, keeps);
    }
    s.state.contacts.copy_from(&total.state.contacts);
    s.state.impulse.copy_from_slice(&total.state.impulse);
    s.velocity.scalar_impulse.copy_from_slice(&total.scalar_impulse);
    kernel!(R, || {
        for impulse in s.state.impulse.iter_mut().chain(&mut s.velocity.scalar_impulse) {
            *impulse = R::select(keeps, R::zero(), *impulse);
        }
    });
    each_of(kept).for_each(|lane| s.state.contacts.count[lane] = 0);
    for lane in each_of(!kept & u32::MAX >> (u32::BITS as usize - R::LANES)) {
        s.state.time[lane] += options.timestep;
    }
    s.state.elapsed += options.timestep;
    let [v, q, act] = before;
    s.velocity.v.copy_from_slice(v);
    s.position.q.copy_from_slice(q);
    s.position.act.copy_from_slice(act);
    s.alive = alive;
    s.evaluation.substep = Substep::whole(options);
    buffers.restore_first_pass(s);
}

impl<R: Real> Buffers<R> {
    /// Begins a step from the state of the workspace. The impulses of the state belong to `h` s.
    pub(super) fn begin(&mut self, s: &Workspace<R>, h: R) {
        for list in [&mut self.before, &mut self.end] {
            for (list, now) in list.iter_mut().zip([&s.state.v, &s.state.q, &s.state.act]) {
                list.copy_from_slice(now);
            }
        }
        let all = R::Mask::splat(true);
        self.start.store((&s.state, &s.velocity.scalar_impulse), h, all);
        self.total.clear(all);
        self.touched.fill(R::Mask::splat(false));
        self.not_extrapolated.fill(R::Mask::splat(false));
        self.saturated.fill(R::Mask::splat(false));
        (self.worst.0.lanes, self.worst.1) = (R::Mask::splat(false), R::zero());
        self.was_used = true;
        self.parts.clear(all);
    }

    /// Notes the kinematic trees whose last part cannot be extrapolated, in the lanes `lanes`. Constraints acted on them, their motion was
    /// too fast, they were evaluated at the beginning, or their vibrations could grow. An impact concerns all trees of its lane.
    fn note_not_extrapolated(&mut self, compiled: &LaneModel<R>, options: &StepSettings, s: &Workspace<R>, lanes: R::Mask) {
        s.problem.add_constrained_trees(compiled, lanes, &mut self.not_extrapolated);
        let Workspace { state, inputs, evaluation, free_motion, alive, .. } = s;
        let Substep { is_impact, .. } = evaluation.substep;
        let context = StepContext { input: StepInput { compiled, options, state, inputs, alive: *alive }, evaluation };
        add_vibrating_trees(context, free_motion, lanes.and_not(is_impact), &mut self.not_extrapolated, &mut self.separation);
        for (not_extrapolated, &mechanism) in self.not_extrapolated.iter_mut().zip(&compiled.mechanisms.of_tree) {
            let other = s.free_motion.unresolved[mechanism].or(s.evaluation.times.moved_lanes(mechanism)).or(is_impact);
            *not_extrapolated = not_extrapolated.or(other.and(lanes));
        }
    }

    /// Notes the actuators whose force the last part clamped in the lanes `lanes`.
    pub(super) fn note_saturated(&mut self, compiled: &LaneModel<R>, s: &Workspace<R>, lanes: R::Mask) {
        kernel!(R, || {
            let flights = lanes.and_not(s.evaluation.substep.is_impact);
            for (actuator, saturated) in self.saturated.iter_mut().enumerate() {
                *saturated = saturated.or(flights.and(s.free_motion.actuator_forces.is_saturated(compiled, actuator)));
            }
        });
    }

    /// Keeps results of the first pass in the lanes `lanes` (bits), which it completes: separating planes, the evaluated configuration and
    /// the predicted velocity. Later steps and derivatives read them.
    pub(super) fn keep_first_pass(&mut self, s: &Workspace<R>, lanes: u32) {
        self.evaluated[0].copy_from_slice(&s.evaluation.q);
        self.evaluated[1].copy_from_slice(&s.free_motion.v_expected);
        if !self.planes.is_unused() {
            self.planes.copy_from(&s.evaluation.collision.narrow_phase.new_planes);
            (0..R::LANES).filter(|lane| lanes >> lane & 1 == 0).for_each(|lane| self.planes.forget(lane));
        }
    }

    /// Restores the results that [`Self::keep_first_pass`] has kept. They must not depend on the passes of other lanes.
    pub(super) fn restore_first_pass(&self, s: &mut Workspace<R>) {
        s.evaluation.q.copy_from_slice(&self.evaluated[0]);
        s.free_motion.v_expected.copy_from_slice(&self.evaluated[1]);
        s.evaluation.collision.forget_planes();
        if !self.planes.is_unused() {
            s.evaluation.collision.narrow_phase.new_planes.copy_from(&self.planes);
        }
    }
}

impl Interval {
    /// Processes the result of a phase. Returns whether the two halves of the interval are accepted: they are within their share of the
    /// error, or the shortest ones. The interval then becomes the next one.
    ///
    /// `distance` is the distance between the results of the whole interval and of its halves, m or rad. `error` is the error of the step.
    fn advance(&mut self, distance: f64, error: f64) -> bool {
        match self.phase {
            Phase::Whole => self.phase = Phase::First,
            Phase::First => self.phase = Phase::Second,
            Phase::Second => {
                let share = (f64::from(self.length) / f64::from(TICKS)).max(MIN_ERROR_SHARE);
                let good = distance <= share * error && !self.broken;
                if good || self.length == 2 {
                    let begin = self.begin + self.length;
                    let phase = if begin == TICKS { Phase::Done } else { Phase::Whole };
                    // The longest interval that begins at a multiple of its length.
                    *self = Self { begin, length: 1 << begin.trailing_zeros(), phase, broken: false };
                    return true;
                }
                *self = Self { length: self.length / 2, phase: Phase::First, ..*self };
            }
            Phase::Done => unreachable!("lanes that are done make no substep"),
        }
        false
    }

    /// Beginning and length of the phase, s, in a step of `h` s.
    fn times(&self, h: f64) -> [f64; 2] {
        let Self { begin, length, phase, .. } = *self;
        let ticks = match phase {
            Phase::Whole => [begin, length],
            Phase::First => [begin, length / 2],
            Phase::Second | Phase::Done => [begin + length / 2, length / 2],
        };
        ticks.map(|ticks| f64::from(ticks) * (h / f64::from(TICKS)))
    }
}

/// Prepares a pass of the lanes `active` (bits): their parts, and impulses from which the solver starts. The impulses of the state belong
/// to a time of `impulse_time` s, which becomes that of the new parts.
fn begin_pass<R: Real>(
    s: &mut Workspace<R>,
    buffers: &mut Buffers<R>,
    options: &StepSettings,
    (intervals, progress): (&[Interval; MAX_LANES], &[Progress; MAX_LANES]),
    active: u32,
    impulse_time: &mut R,
) {
    let h = options.timestep;
    let mut substep = Substep::<R>::whole(options);
    let [mut impacts, mut after_impacts, mut without_end] = [0; 3];
    for lane in each_of(active) {
        let (progress, [begin, length]) = (&progress[lane], intervals[lane].times(h));
        let longest = if progress.is_impact { h } else { length - progress.flown };
        substep.offset.set_lane(lane, R::Scalar::from_f64(begin + progress.flown));
        substep.longest.set_lane(lane, R::Scalar::from_f64(longest));
        if options.error.is_some() {
            substep.next.set_lane(lane, R::Scalar::from_f64(length));
        }
        impacts |= u32::from(progress.is_impact) << lane;
        after_impacts |= u32::from(progress.follows_impact) << lane;
        without_end |= u32::from(progress.impacts >= MAX_IMPACTS) << lane;
    }
    [substep.is_impact, substep.follows_impact] = [impacts, after_impacts].map(R::Mask::from_bits);
    substep.bounces_at_end = substep.bounces_at_end.or(R::Mask::from_bits(without_end));
    s.alive = R::Mask::from_bits(active);
    s.evaluation.substep = substep;
    s.evaluation.collision.forget_planes();
    if impacts != 0 {
        buffers.before_impact.store((&s.state, &s.velocity.scalar_impulse), *impulse_time, substep.is_impact);
    }
    kernel!(R, || {
        let duration = R::select(substep.is_impact, substep.longest * R::of(IMPACT_DURATION), substep.longest);
        // Impulses of a very short flight are no start for a long one.
        let factor = (duration / *impulse_time).min(R::of(MAX_IMPULSE_RATIO));
        s.state.contacts.scale_impulses(factor);
        for impulse in s.state.impulse.iter_mut().chain(&mut s.velocity.scalar_impulse) {
            *impulse *= factor;
        }
        *impulse_time = duration;
    });
}

/// Processes the parts of a pass of the lanes `active` (bits). Returns the lanes that have completed their phase. The state then has the
/// sums of its impulses, which belong to `impulse_time` s. The lanes `keeping` (bits) have kept their state, and end their phase at once.
fn end_parts<R: Real>(
    compiled: &LaneModel<R>,
    s: &mut Workspace<R>,
    buffers: &mut Buffers<R>,
    options: &StepSettings,
    (intervals, progress): (&[Interval; MAX_LANES], &mut [Progress; MAX_LANES]),
    [active, keeping]: [u32; 2],
    impulse_time: &mut R,
) -> u32 {
    let Buffers { before_impact, parts, summed, touched, .. } = buffers;
    let (substep, length) = (s.evaluation.substep, s.evaluation.scheme.h);
    let (impacts, mut completed) = (substep.is_impact.bits() & active, keeping & active);
    let mut divided = 0;
    kernel!(R, || *impulse_time = length);
    for lane in each_of(active & !keeping) {
        let own = &mut progress[lane];
        divided |= u32::from(own.flown > 0.0 || own.is_impact) << lane;
        let [_, of_phase] = intervals[lane].times(options.timestep);
        let shortest = shortest_flight::<R>() * options.timestep;
        let ended = if own.is_impact {
            (own.impacts, own.is_impact, own.follows_impact) = (own.impacts + 1, false, true);
            of_phase - own.flown <= shortest
        } else {
            own.flown += length.lane(lane).to_f64();
            own.is_impact = substep.ends_at_impact.bits() >> lane & 1 == 1;
            !own.is_impact
        };
        completed |= u32::from(ended) << lane;
    }
    let masks = [impacts, active & !completed | completed & divided, completed & divided, completed].map(R::Mask::from_bits);
    let [impacts, lanes_to_sum, divided, completed_lanes] = masks;
    if lanes_to_sum.any() {
        parts.add(summed, &s.state, &s.velocity.scalar_impulse, lanes_to_sum);
    }
    if !s.problem.impacts.is_empty() {
        note_impacts(compiled, &s.problem, &s.state.contacts, R::Mask::from_bits(active), touched);
        spread(compiled, &s.state.contacts, touched);
    }
    if impacts.any() {
        // The velocity jumps, and the rest of the state stays.
        before_impact.state.v.copy_from_slice(&s.state.v);
        before_impact.restore((&mut s.state, &mut s.velocity.scalar_impulse), impulse_time, impacts);
    }
    if divided.any() {
        parts.restore_impulses((&mut s.state, &mut s.velocity.scalar_impulse), divided);
        for lane in each_of(divided.bits()) {
            impulse_time.set_lane(lane, R::Scalar::from_f64(intervals[lane].times(options.timestep)[1]));
        }
        s.evaluation.divided = s.evaluation.divided.or(divided);
    }
    if completed_lanes.any() {
        parts.clear(completed_lanes);
        each_of(completed).for_each(|lane| progress[lane] = Progress::default());
    }
    completed
}
