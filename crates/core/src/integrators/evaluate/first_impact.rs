//! Search for the first elastic impact of a flight, which ends it.

use stepper_real::{Mask, Real, Scalar, kernel};

use crate::collision::contact_set::Contacts;
use crate::collision::surface_velocity;
use crate::compile::LaneModel;
use crate::constraints::contact::impact_time::{Flight, ImpactPrediction};
use crate::dynamics::kinematics::Kinematics;
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::step_input::StepInput;
use crate::math::spatial::*;
use crate::tuning::{MAX_FLIGHT_CHANGES, PLACEMENT_TOLERANCE, SHORTEST_FLIGHT};

/// Makes one step of the search for the first elastic impact of each lane, which ends its flight. Returns whether any flight changed, so
/// that the step must be evaluated again.
///
/// `v_free` is the velocity after the flight without constraints. `changes` is the number of earlier changes in this step. A predicted
/// impact is evaluated at its time, from which Newton's method continues. After the search, the flight is evaluated where the integration
/// rule has it.
///
/// A contact that overlaps beyond the slop (the overlap that position correction leaves) while its surfaces separate must have touched
/// earlier. In the first call, its lane is evaluated at the beginning of the flight.
#[inline(never)]
pub(crate) fn end_at_first_impacts<R: Real>(input: StepInput<'_, R>, evaluation: &mut Evaluation<R>, v_free: &[R], changes: usize) -> bool {
    let StepInput { compiled, options, state, alive, .. } = input;
    kernel!(R, || {
        let Evaluation { scheme, times, kinematics, contacts, link_velocities, substep, .. } = &mut *evaluation;
        let flights = alive.and_not(substep.is_impact.or(substep.bounces_at_end).or(substep.ignores_impacts).or(substep.search_ended));
        if flights.none() {
            return false;
        }
        let [before, free] = link_velocities;
        kinematics.velocities(compiled, &state.v, before);
        kinematics.velocities(compiled, v_free, free);
        let gravity = norm(compiled.params.gravity());
        let [mut collide, mut may_have_bounced] = [R::Mask::splat(false); 2];
        let mut time = substep.longest;
        for k in 0..contacts.slots() {
            let elastic = contacts.elastic(k).and(flights);
            if elastic.none() {
                continue;
            }
            let slot = &contacts.data[k];
            let time_before = times.of_slot(compiled, contacts, k, elastic.bits()).before;
            let [before, free] = normal_velocities(compiled, kinematics, contacts, k, elastic.bits(), [before, free]);
            let (gap, h, longest) = (slot.point.distance, scheme.h, substep.longest);
            let flight = Flight { gap, before, free, time_before, h, longest, in_the_middle: scheme.in_the_middle };
            let ImpactPrediction { collides, time: impact_time, .. } = flight.predict(options, gravity, slot.restitution, elastic);
            time = R::select(collides, time.min(impact_time), time);
            collide = collide.or(collides);
            let overlaps = gap.lt(-R::of(options.slop)).and(time_before.gt(R::zero()));
            may_have_bounced = may_have_bounced.or(elastic.and(overlaps).and(before.gt(R::zero())));
        }
        let may_have_bounced = if changes == 0 { may_have_bounced } else { R::Mask::splat(false) };
        let shortest = R::of(shortest_flight::<R>() * options.timestep);
        // An impact at the very end of the flight belongs to the next step.
        let ends = collide.and_not(may_have_bounced).and(time.lt(substep.longest - shortest));
        let time = R::select(ends, time.max(shortest), substep.longest);
        // The search ends where nothing collides, where the impact is evaluated at its time, and after some changes.
        let was_searched = substep.is_searched;
        let is_near = (time - substep.search_time).abs().le(R::of(PLACEMENT_TOLERANCE * options.timestep));
        let continues = ends.and_not(was_searched.and(is_near)).or(may_have_bounced);
        let is_last = !scheme.in_the_middle || changes == MAX_FLIGHT_CHANGES;
        let searched = if is_last { R::Mask::splat(false) } else { flights.and(continues) };
        let changed = flights.and(was_searched.or(ends).or(searched));
        substep.ends_at_impact = flights.and(ends).or(substep.ends_at_impact.and_not(flights));
        (substep.is_searched, substep.search_time) = (searched, R::select(may_have_bounced, R::zero(), time));
        substep.search_ended = substep.search_ended.or(flights.and_not(searched));
        if changed.none() {
            return false;
        }
        let length = R::select(changed, time, scheme.h);
        evaluation.place(options, length);
        true
    })
}

/// Shortest flight before an impact, as a fraction of the step.
pub(crate) fn shortest_flight<R: Real>() -> f64 {
    SHORTEST_FLIGHT.max(16.0 * <R::Scalar as Scalar>::EPSILON.to_f64())
}

/// Normal velocities of the contacts in slot `k` (one per lane) for two sets of link velocities, m/s.
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
    let surface_velocity = dot(point.normal, linear(&surface_velocity::motion(compiled, kinematics, contacts, k, lanes)));
    let mut out = [surface_velocity; 2];
    for (pair, lanes) in contacts.pairs(k, lanes) {
        let pair_lanes = R::Mask::from_bits(lanes);
        let [a, b] = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
        for (geom, sign) in [(a, -R::one()), (b, R::one())] {
            let frame = compiled.geoms[geom].frame;
            if frame == 0 || frame > compiled.links.len() {
                continue;
            }
            let arm = sub(point.pos, kinematics.origin[compiled.links[frame - 1].tree]);
            for (out, velocity) in out.iter_mut().zip(velocities) {
                *out += R::select(pair_lanes, dot(point.normal, velocity_at(&velocity[frame - 1], arm)) * sign, R::zero());
            }
        }
    }
    out
}
