//! Steps that keep an error: a step is divided into substeps. The estimated error of the positions in each is within a share of the user's
//! bound.
//!
//! The estimate is that of step doubling (Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, section II.4). An interval
//! is stepped once as a whole and once in two halves. The distance between both results is the estimate, and the two halves are the result.
//! If the distance is too large, the first half becomes the next interval. The result of a step over it is known already.
//!
//! Lanes differ in their intervals, and what a lane computes does not depend on other lanes. A pass executes stages 1 to 8 and 10 in all
//! lanes, each with the substep that it needs next. Lanes that have reached the end of the step wait. Lengths are the step divided by
//! powers of two. After an accepted interval, the next one is the longest that begins at a multiple of its length.
//!
//! Controls, actuator pipelines and sensors act once in a step of the user. Impulses are summed over the substeps.

use stepper_real::{Mask, Real, Scalar, kernel};

use crate::compile::LaneModel;
use crate::dynamics::kinematics::quat_at;
use crate::integrators::evaluation::Substep;
use crate::integrators::substep_buffers::{ErrorControl, select_into};
use crate::integrators::workspace::Workspace;
use crate::math::lanes::{MAX_LANES, each_of};
use crate::math::spatial::*;
use crate::model::JointKind;
use crate::options::StepSettings;
use crate::stages::s10_record::{Record, Status};
use crate::tuning::{MAX_HALVINGS, MIN_ERROR_SHARE};

/// Number of the shortest substeps in a step.
const TICKS: u32 = 1 << MAX_HALVINGS;

/// Substep that a lane makes next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// The whole interval.
    Whole,
    /// First half of the interval.
    First,
    /// Second half of the interval.
    Second,
    /// None: the lane has reached the end of the step.
    Done,
}

/// Interval of a lane.
#[derive(Clone, Copy, Debug)]
struct Interval {
    /// Beginning and length, in units of the shortest substep.
    begin: u32,
    length: u32,
    phase: Phase,
    /// Whether a result over the interval is not finite.
    broken: bool,
}

/// Makes stages 1 to 8 and 10 of a step of `options.timestep` seconds in substeps. Each may have a share of the error `error`, m or rad, in
/// proportion to its length, but at least [`MIN_ERROR_SHARE`].
///
/// `make_substep` executes the substep of `s.evaluation.substep`, without advancing the time of the state, and returns its record.
///
/// Afterwards the workspace has the next state. The buffers of velocities and positions have the state before the step, as after one whole
/// substep. Lanes in which the sum of the estimates exceeds the error have the flag [`Status::INACCURATE`].
#[cold]
#[inline(never)]
pub(crate) fn step_within_error<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    error: f64,
    s: &mut Workspace<R>,
    make_substep: impl Fn(&mut Workspace<R>) -> Record<R>,
) -> Record<R> {
    let mut control = s.error_control.take().expect("buffers of a step that keeps an error");
    let (all, h) = (s.alive, options.timestep);
    let mut span = R::of(h);
    begin(&mut control, s, span);
    let mut intervals = [Interval { begin: 0, length: TICKS, phase: Phase::Whole, broken: false }; MAX_LANES];
    let mut active = all.bits();
    // Records of the accepted substeps, and of the first half of each interval.
    let (mut total, mut first) = (Record::none(), Record::none());
    while active != 0 {
        begin_pass(s, &intervals, active, h, &mut span);
        let made = make_substep(s);
        let in_phase =
            |phase| R::Mask::from_bits(each_of(active).filter(|&l| intervals[l].phase == phase).fold(0, |bits, l| bits | 1 << l));
        let [wholes, firsts, seconds] = [Phase::Whole, Phase::First, Phase::Second].map(in_phase);
        let ErrorControl { start, whole, middle, end, total: sums, summed, .. } = &mut *control;
        select_into(whole, &s.state.q, wholes);
        start.restore((&mut s.state, &mut s.velocity.scalar_impulse), &mut span, wholes);
        middle.store((&s.state, &s.velocity.scalar_impulse), span, firsts);
        first.replace(&made, firsts);
        let distance = kernel!(R, || distance(compiled, &s.state.q, whole));
        let broken = made.lanes(Status::NON_FINITE);
        let (mut accepted, mut done) = (0, 0);
        for lane in each_of(active) {
            let interval = &mut intervals[lane];
            interval.broken |= broken >> lane & 1 == 1;
            if interval.advance(distance.lane(lane).to_f64(), error) {
                accepted |= 1 << lane;
                done |= u32::from(interval.phase == Phase::Done) << lane;
            }
        }
        let taken = R::Mask::from_bits(accepted);
        let rejected = seconds.and_not(taken);
        if taken.any() {
            sums.add(summed, &middle.state, &middle.scalar_impulse, taken);
            sums.add(summed, &s.state, &s.velocity.scalar_impulse, taken);
            total.add(&first, taken);
            total.add(&made, taken);
            total.add_error(distance, taken);
            start.store((&s.state, &s.velocity.scalar_impulse), span, taken);
            for (end, now) in end.iter_mut().zip([&s.state.v, &s.state.q, &s.state.act]) {
                select_into(end, now, R::Mask::from_bits(done));
            }
        }
        // The first half of a rejected interval is the next one. The step over it has been made.
        select_into(whole, &middle.state.q, rejected);
        start.restore((&mut s.state, &mut s.velocity.scalar_impulse), &mut span, rejected);
        active &= !done;
    }
    total.flag_inaccurate(error, all);
    end(&control, s, options, all, total.lanes(Status::NON_FINITE));
    s.error_control = Some(control);
    total
}

/// Begins a step from the state of the workspace.
fn begin<R: Real>(control: &mut ErrorControl<R>, s: &Workspace<R>, h: R) {
    let ErrorControl { start, end, total, before, .. } = control;
    for list in [before, end] {
        for (list, now) in list.iter_mut().zip([&s.state.v, &s.state.q, &s.state.act]) {
            list.copy_from_slice(now);
        }
    }
    start.store((&s.state, &s.velocity.scalar_impulse), h, R::Mask::splat(true));
    total.state.contacts.clear();
    [&mut total.state.impulse, &mut total.scalar_impulse].into_iter().for_each(|impulses| impulses.fill(R::zero()));
}

/// Ends a step: the workspace gets the state at the end, sums of impulses, and the state before the step, as after one whole substep.
fn end<R: Real>(control: &ErrorControl<R>, s: &mut Workspace<R>, options: &StepSettings, alive: R::Mask, rejected: u32) {
    let [v, q, act] = &control.end;
    s.state.v.copy_from_slice(v);
    s.state.q.copy_from_slice(q);
    s.state.act.copy_from_slice(act);
    s.state.contacts.copy_from(&control.total.state.contacts);
    s.state.impulse.copy_from_slice(&control.total.state.impulse);
    s.velocity.scalar_impulse.copy_from_slice(&control.total.scalar_impulse);
    for lane in each_of(!rejected & u32::MAX >> (u32::BITS as usize - R::LANES)) {
        s.state.time[lane] += options.timestep;
    }
    s.state.elapsed += options.timestep;
    let [v, q, act] = &control.before;
    s.velocity.v.copy_from_slice(v);
    s.position.q.copy_from_slice(q);
    s.position.act.copy_from_slice(act);
    s.alive = alive;
    s.evaluation.substep = Substep::whole(options.timestep);
    // What a lane finds in its next step must not depend on the passes of others.
    s.evaluation.collision.forget_planes();
}

impl Interval {
    /// Takes up the result of the substep. Returns whether the two halves of the interval are accepted: they are within their share of the
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

    /// Beginning and length of the next substep, in units of the shortest one.
    fn substep(&self) -> [u32; 2] {
        let Self { begin, length, phase, .. } = *self;
        match phase {
            Phase::Whole => [begin, length],
            Phase::First => [begin, length / 2],
            Phase::Second | Phase::Done => [begin + length / 2, length / 2],
        }
    }
}

/// Prepares a pass of the lanes `active` (bits): their substeps, and impulses from which the solver starts. The impulses of the state
/// belong to substeps of `span` seconds, which becomes the length of the new ones.
fn begin_pass<R: Real>(s: &mut Workspace<R>, intervals: &[Interval; MAX_LANES], active: u32, h: f64, span: &mut R) {
    let tick = h / f64::from(TICKS);
    let mut substep = Substep::<R>::whole(h);
    for lane in each_of(active) {
        let [begin, length] = intervals[lane].substep().map(|ticks| R::Scalar::from_f64(f64::from(ticks) * tick));
        substep.offset.set_lane(lane, begin);
        substep.length.set_lane(lane, length);
    }
    s.alive = R::Mask::from_bits(active);
    s.evaluation.substep = substep;
    s.evaluation.collision.forget_planes();
    kernel!(R, || {
        let factor = substep.length / *span;
        s.state.contacts.scale_impulses(factor);
        for impulse in s.state.impulse.iter_mut().chain(&mut s.velocity.scalar_impulse) {
            *impulse *= factor;
        }
        *span = substep.length;
    });
}

/// Largest distance between two configurations in each lane: of a coordinate, or of the rotation of a ball or free joint, m or rad.
#[inline(always)]
fn distance<R: Real>(compiled: &LaneModel<R>, a: &[R], b: &[R]) -> R {
    let mut farthest = R::zero();
    for joint in &compiled.joints {
        let (straight, turns) = match joint.kind {
            JointKind::Free => (3, true),
            JointKind::Ball => (0, true),
            JointKind::Slide | JointKind::Hinge => (1, false),
        };
        for k in joint.q..joint.q + straight {
            farthest = farthest.max((a[k] - b[k]).abs());
        }
        if turns {
            farthest = farthest.max(norm(quat_log(quat_between(quat_at(a, joint.q + straight), quat_at(b, joint.q + straight)))));
        }
    }
    farthest
}
