//! Impacts: velocities that jump within the step.
//!
//! What bounces is taken at the time at which it strikes: normals and arms are those of the impact, and so is the velocity that Newton's
//! law is taken on (see [`crate::constraints::impact_time`] and stage 4).

use stepper_real::{Mask, Real};
use stepper_solve::Outcome;

use crate::collision::contact_set::Contacts;
use crate::collision::surface_velocity;
use crate::compile::LaneModel;
use crate::constraints::impact_time::{Flight, ImpactPrediction};
use crate::dynamics::gyroscopic;
use crate::dynamics::kinematics::{Kinematics, advance};
use crate::integrators::free_motion::{find_contacts, free_motion, place_bodies};
use crate::integrators::impact_set::Impacts;
use crate::integrators::scheme::Scheme;
use crate::integrators::workspace::{Evaluation, FreeMotion, State, Workspace};
use crate::math::spatial::*;
use crate::options::StepSettings;
use crate::probe::{Probe, Span};
use crate::stages::s04_assemble::assemble_demands;
use crate::stages::s05_solve::solve;
use crate::stages::s06_integrate_velocity::integrate_velocity;
use crate::tuning::{IMPACT_PASSES, MAX_PLACEMENTS, MAX_RESOLVED_ROTATION, MIN_IMPACT_RATIO, MIN_VELOCITY_ERROR, PLACEMENT_TOLERANCE};

/// Takes the lanes in which elastic contacts strike at the time of the first impact.
pub(crate) fn place_at_impacts<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    scheme: &mut Scheme<R>,
    s: &mut Workspace<R>,
    probe: impl Probe,
) {
    s.impacts.lanes = R::Mask::splat(false);
    for pass in 0..MAX_PLACEMENTS {
        let elastic = |k: usize| s.evaluation.contacts.elastic(k).any();
        if !(0..s.evaluation.contacts.slots()).any(elastic) {
            return;
        }
        let [strikes, wrong] = probe.span(Span::ImpactTimes, || first_impacts(compiled, options, scheme, s, pass == 0));
        s.impacts.lanes = s.impacts.lanes.or(strikes).or(wrong);
        if wrong.none() {
            return;
        }
        place_bodies(compiled, scheme, s, probe);
        free_motion(compiled, scheme, s, probe);
        find_contacts(compiled, scheme, s, probe);
    }
}

/// Moves `scheme` to the time of the first impact of each lane. Returns the lanes that have an impact, and those whose placement was off by
/// more than PLACEMENT_TOLERANCE of a step and must be evaluated again. On the first pass, a contact that overlaps beyond the slop while
/// its surfaces separate must have passed through its surface before: its lane is placed at the beginning of the step.
fn first_impacts<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    scheme: &mut Scheme<R>,
    s: &mut Workspace<R>,
    first: bool,
) -> [R::Mask; 2] {
    let Workspace {
        state: State { v, .. },
        evaluation,
        free_motion: FreeMotion { v: v_free, .. },
        impacts: Impacts { velocities, .. },
        alive,
        ..
    } = s;
    let Evaluation { contacts, kinematics, .. } = evaluation;
    R::vectorize(
        #[inline(always)]
        || {
            let [before, free] = velocities;
            kinematics.velocities(compiled, v, before);
            kinematics.velocities(compiled, v_free, free);
            let gravity = norm(compiled.params.gravity());
            let (mut strikes, mut time) = (R::Mask::splat(false), scheme.h);
            for k in 0..contacts.slots() {
                let elastic = contacts.elastic(k).and(*alive);
                if elastic.none() {
                    continue;
                }
                let slot = &contacts.data[k];
                let (gap, time_before, h) = (slot.point.distance, scheme.time_before, scheme.h);
                let [before, free] = normal_velocities(compiled, kinematics, contacts, k, elastic.bits(), [before, free]);
                let ImpactPrediction { strikes: here, time: at, .. } =
                    Flight { gap, before, free, time_before, h }.predict(options, gravity, slot.restitution, elastic);
                let passed = elastic.and(gap.lt(-R::of(options.slop))).and(before.gt(R::zero())).and(time_before.gt(R::zero()));
                let passed = if first { passed } else { R::Mask::splat(false) };
                time = R::select(here, time.min(at), time);
                time = R::select(passed, R::zero(), time);
                strikes = strikes.or(here).or(passed);
            }
            let wrong = strikes.and((time - scheme.time_before).abs().gt(scheme.h * R::of(PLACEMENT_TOLERANCE)));
            scheme.time_before = R::select(wrong, time, scheme.time_before);
            scheme.time_after = R::select(wrong, scheme.h - time, scheme.time_after);
            [strikes, wrong]
        },
    )
}

/// Normal velocities of the contacts in slot `k`, for two sets of the links' velocities.
#[inline(always)]
fn normal_velocities<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    contacts: &Contacts<R>,
    k: usize,
    lanes: u32,
    velocities: [&[V6<R>]; 2],
) -> [R; 2] {
    let point = &contacts.data[k].point;
    let carried = dot(point.normal, linear(&surface_velocity::motion(compiled, kinematics, contacts, k, lanes)));
    let mut out = [carried; 2];
    for (pair, lanes) in contacts.pairs(k, lanes) {
        let there = R::Mask::from_bits(lanes);
        let [a, b] = compiled.pair_geoms(pair).expect("made from this compiled");
        for (geom, sign) in [(a, -R::one()), (b, R::one())] {
            let frame = compiled.geoms[geom].frame;
            if frame == 0 || frame > compiled.links.len() {
                continue;
            }
            let arm = sub(point.pos, kinematics.origin[compiled.links[frame - 1].tree]);
            for (out, velocity) in out.iter_mut().zip(velocities) {
                *out += R::select(there, dot(point.normal, velocity_at(&velocity[frame - 1], arm)) * sign, R::zero());
            }
        }
    }
    out
}

/// Prepares the position solve: copies its rows where any lane needs it. In lanes with impacts, leaves in `work.v_positions` the free
/// velocity for stage 8: positions went on from `time_before` with the velocity after the step, so it also holds what they lack,
/// (time_before - t) / h of each impulse's velocity change and (time_before / h - 1/2) of the smooth forces', because the step was not
/// taken in its middle. Returns these lanes.
#[inline(always)]
pub(crate) fn prepare_position_solve<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>) -> R::Mask {
    let lanes = s.impacts.lanes.or(s.constraints.bouncing()).and(s.alive);
    if s.constraints.needs_position_solve.or(lanes).any() {
        s.constraints.copy_positions();
    }
    if lanes.none() {
        return lanes;
    }
    s.constraints.remove_impacts(compiled, &s.free_motion.smooth.mass, [scheme.h, scheme.time_before], lanes, &mut s.work.carried);
    R::vectorize(
        #[inline(always)]
        || {
            let late = scheme.time_before / scheme.h - R::of(0.5);
            for i in 0..compiled.nv {
                let moved = s.work.carried[i] + (s.free_motion.v[i] - s.state.v[i]) * late;
                s.work.carried[i] = R::select(lanes, moved, R::zero());
                s.work.v_positions[i] = R::select(lanes, s.free_motion.v[i] + moved, s.free_motion.v[i]);
            }
        },
    );
    s.constraints.shift_positions(compiled, &s.free_motion.smooth.mass, &mut s.work.carried, lanes);
    lanes
}

/// Stages 2, 4, 5 and 6 again in the lanes in which constraints have stopped or turned a motion that stage 2 reckoned with.
///
/// The midpoint rule goes half of the step with the velocity before it and half with that after it, so inertial forces are the mean of
/// those at both. The first solution took them at the mean of the velocities, which at an impact is neither: an error of first order in
/// momentum and energy, at every impact.
pub(crate) fn solve_impacts<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    scheme: &Scheme<R>,
    s: &mut Workspace<R>,
    mut outcome: Outcome<R>,
) -> Outcome<R> {
    for pass in 0..IMPACT_PASSES {
        let lanes = lanes_with_impacts(scheme, s, pass == 0);
        if lanes.none() {
            break;
        }
        take_inertial_forces(compiled, scheme, s, lanes, pass == 0);
        let (rows, mut workspace) = s.constraints.split();
        let repeated = solve(options, &s.state.v, lanes, &rows, &mut workspace, &mut s.evaluation.contacts);
        outcome.replace(&repeated, lanes);
        integrate_velocity(compiled, &s.free_motion.smooth.mass, &s.free_motion.v, &s.constraints, &mut s.next.v);
    }
    outcome
}

/// Lanes whose velocity after the step, `next.v`, is far from that which inertial forces were taken with; of the first solution, which
/// took them at the mean of the velocities and not half at each, also those in which constraints made the velocity jump.
fn lanes_with_impacts<R: Real>(scheme: &Scheme<R>, s: &Workspace<R>, first: bool) -> R::Mask {
    R::vectorize(
        #[inline(always)]
        || {
            let (mut jump, mut fastest, mut pushed, mut smooth) = (R::zero(), R::zero(), R::zero(), R::zero());
            for (((&v, &free), &next), &expected) in s.state.v.iter().zip(&s.free_motion.v).zip(&s.next.v).zip(&s.free_motion.v_expected) {
                pushed = pushed.max((next - free).abs());
                smooth = smooth.max((free - v).abs());
                jump = jump.max((next - expected).abs());
                fastest = fastest.max(v.abs()).max(next.abs());
            }
            let apart = if first { pushed * pushed * R::of(0.25) } else { R::zero() };
            let change = jump.max(pushed);
            let impact = change.gt(smooth * R::of(MIN_IMPACT_RATIO)).and((scheme.h * change).lt(R::of(MAX_RESOLVED_ROTATION)));
            let matters = impact.and((scheme.h * (jump * fastest).max(apart)).gt(R::of(MIN_VELOCITY_ERROR)));
            // Equalities near singular positions change as suddenly, but nothing strikes there.
            let slots = s.constraints.slots.iter().map(|slot| slot.1).chain(s.constraints.rolling_slots.iter().map(|slot| slot.1));
            let touching = slots.fold(R::Mask::splat(false), |all, lanes| all.or(lanes));
            touching.and(s.alive).and_not(s.free_motion.unresolved).and(matters)
        },
    )
}

/// The free velocity of the lanes `lanes` with inertial forces at the velocity before the step and at `next.v`: half each, or until the
/// impact and after it. At the `first` time, the velocity before the impact is made that of the former alone.
fn take_inertial_forces<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>, lanes: R::Mask, first: bool) {
    // With the forces of stage 1 as they are: what depends on the velocity in them is implicit.
    let half = scheme.h * R::of(0.5);
    let times = [scheme.time_before, scheme.time_after].map(|time| R::select(s.impacts.lanes, time, half));
    s.free_motion.accelerate(compiled, &s.evaluation.kinematics, &s.state.v, &s.state.v);
    advance(&s.state.v, &s.free_motion.smooth.acc, times[0], &mut s.work.v_half);
    let strikes = s.constraints.has_impacts;
    if strikes {
        advance(&s.state.v, &s.free_motion.smooth.acc, scheme.h, &mut s.work.before_impact);
    }
    s.free_motion.accelerate(compiled, &s.evaluation.kinematics, &s.state.v, &s.next.v);
    advance(&s.work.v_half, &s.free_motion.smooth.acc, times[1], &mut s.work.v_free_corrected);
    if !compiled.spinners.is_empty() {
        gyroscopic::correct_spin(
            compiled,
            &s.evaluation.kinematics,
            &s.free_motion.smooth.mass,
            [[scheme.time_before, scheme.time_after], times],
            [&s.state.v, &s.next.v],
            &mut s.work.v_free_corrected,
        );
    }
    take_over_change(compiled, s, lanes);
    if strikes {
        R::vectorize(
            #[inline(always)]
            || {
                // The rows of impacts take it as a change until the impact.
                for i in 0..compiled.nv {
                    s.work.before_impact[i] = if first { s.work.before_impact[i] - s.free_motion.v[i] } else { -s.work.free_change[i] };
                }
            },
        );
    }
    let (work, mass) = (&mut s.work, &s.free_motion.smooth.mass);
    let before_impacts = strikes.then_some(&mut work.before_impact[..]);
    assemble_demands(compiled, mass, &mut s.constraints, &mut work.free_change, before_impacts, lanes);
}

/// Takes over `work.v_free_corrected` as the free velocity of the lanes `lanes`, and `next.v` as the expected one; leaves by how much the
/// former changed in `work.free_change`.
fn take_over_change<R: Real>(compiled: &LaneModel<R>, s: &mut Workspace<R>, lanes: R::Mask) {
    R::vectorize(
        #[inline(always)]
        || {
            for i in 0..compiled.nv {
                let new = R::select(lanes, s.work.v_free_corrected[i], s.free_motion.v[i]);
                s.work.free_change[i] = new - s.free_motion.v[i];
                s.free_motion.v[i] = new;
                s.free_motion.v_expected[i] = R::select(lanes, s.next.v[i], s.free_motion.v_expected[i]);
            }
        },
    );
}
