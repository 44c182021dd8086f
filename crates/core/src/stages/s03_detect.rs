//! Stage 3: detects contacts from poses.
//!
//! Detection adds a contact if its gap may close before the evaluation point of the next step. The gap must be below the distance by which
//! the free velocity closes it in two steps, plus the distance that gravity covers in one. Geoms need not overlap.
//!
//! The next evaluation point is up to 1.5 steps later (`SlotTimes::closing`). The rest of the two steps is a margin for
//! impulses that make a body faster than its free velocity.
//!
//! A fast body can be beyond a thin wall in the middle of the step, where the midpoint rule detects contacts. [`detect`] therefore checks
//! pairs that have moved farther than their tunnelling distance since the beginning of the step. It returns lanes in which the geoms of
//! such a pair overlap or may have passed through each other. It also returns lanes in which one of the geoms hits a surface of triangles.
//! The step evaluates the mechanisms of these geoms again at its beginning. There the wall is still ahead of the body, and the contact with
//! the wall stops the body.
//!
//! Bodies can still pass through a geom if an impulse deflects them or makes them faster than the search assumed. They can also pass if
//! they rotate so far that the contact normal is no longer valid. [`may_have_passed`](crate::collision::tunnelling::may_have_passed) finds
//! such lanes after the solve.

use stepper_real::{Mask, Real, kernel};

use crate::collision::contact_set::Contacts;
use crate::collision::detection::{CollisionWorkspace, Scene, slack};
use crate::compile::LaneModel;
use crate::dynamics::kinematics::Kinematics;
use crate::probe::{Counter, Probe, span};

/// Finds the contacts of the lanes `alive`, at the poses `time_before` seconds after the beginning of the step. Returns the lanes whose
/// contacts are unreliable at these poses, because geoms have moved too far since the beginning of the step (see the head of the file).
///
/// `v` is the velocity before the step, and `v_free` the velocity after it without constraints. `h` is the time step, s.
#[expect(clippy::too_many_arguments, reason = "poses, contacts and probe are separate buffers")]
#[inline(always)]
pub fn detect<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    [v, v_free]: [&[R]; 2],
    [h, time_before]: [R; 2],
    alive: R::Mask,
    collision: &mut CollisionWorkspace<R>,
    contacts: &mut Contacts<R>,
    probe: impl Probe,
) -> R::Mask {
    contacts.clear();
    collision.narrow_phase.new_planes.clear();
    collision.unreliable.fill(R::Mask::splat(false));
    if compiled.geoms.is_empty() {
        return R::Mask::splat(false);
    }
    let checks_passing = compiled.can_tunnel && time_before.gt(R::zero()).any();
    span!(probe, BroadPhase, || find_pairs(compiled, kinematics, [v, v_free], [h, time_before], checks_passing, alive, collision));
    if collision.near_count == 0 && compiled.dynamic_pairs.is_none() {
        return R::Mask::splat(false);
    }
    probe.count(Counter::NearPairs, || (collision.near_count + collision.broad.pairs.len()) as f64);
    span!(probe, NarrowPhase, || {
        let unreliable = find_contacts(compiled, kinematics, v, [h, time_before], checks_passing, collision, contacts);
        collision.reduction.reduce(compiled, contacts);
        unreliable
    })
}

/// Broad phase: computes the poses of the geoms, and finds the pairs that can touch within two steps. `v` is the velocity before the step,
/// and `v_free` the velocity after it without constraints.
///
/// With `checks_passing`, it also finds the static pairs (a moving geom and one fixed to the world, both bounded and convex) whose geoms
/// may have passed through each other since the beginning of the step.
fn find_pairs<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    [v, v_free]: [&[R]; 2],
    [h, time_before]: [R; 2],
    checks_passing: bool,
    alive: R::Mask,
    collision: &mut CollisionWorkspace<R>,
) {
    let checks_static = checks_passing && !compiled.static_pairs.is_empty();
    kernel!(R, || {
        collision.slack = slack(compiled, h);
        collision.poses.update_poses(compiled, kinematics);
        collision.poses.update_search_displacement(compiled, kinematics, v_free, h + h);
        if checks_static {
            collision.poses.update_passing_displacement(compiled, kinematics, v, time_before);
        }
        collision.find_near(compiled, alive);
    });
    // Each static pair is also a listed or a dynamic pair. The found static pairs are merged with the other pairs of these two kinds.
    collision.find_static(compiled, alive, checks_static, |poses| &poses.search_displacement);
    collision.add_static(compiled);
    collision.find_dynamic(compiled, alive, |poses| &poses.search_displacement);
}

/// Narrow phase: finds the contacts of the pairs from [`find_pairs`].
///
/// With `checks_passing`, returns the lanes whose contacts are unreliable, because geoms have moved too far since the beginning of the
/// step. It also sets `collision.unreliable` to these lanes of each mechanism. Otherwise returns no lanes.
fn find_contacts<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    v: &[R],
    [h, time_before]: [R; 2],
    checks_passing: bool,
    collision: &mut CollisionWorkspace<R>,
    contacts: &mut Contacts<R>,
) -> R::Mask {
    let CollisionWorkspace { poses, slack, near, near_count, broad, narrow_phase, unreliable, .. } = collision;
    let (near, slack) = (&near[..*near_count], *slack);
    // A plane is infinite, so that nothing passes through it.
    let can_be_passed = |&(index, _): &(u32, u32)| !compiled.geoms[compiled.pairs[index as usize].geoms[0]].is_plane;
    let checks_passing = checks_passing && (compiled.dynamic_pairs.is_some() || near.iter().any(can_be_passed));
    // With static pairs, `find_pairs` has already computed these displacements.
    if checks_passing && compiled.static_pairs.is_empty() {
        kernel!(R, || poses.update_passing_displacement(compiled, kinematics, v, time_before));
    }
    kernel!(R, || {
        let scene = Scene { compiled, kinematics, poses, h, slack, passing_time: time_before, checks_passing };
        let mut any = R::Mask::splat(false);
        for &(index, lanes) in near {
            let pair = &compiled.pairs[index as usize];
            any = any.or(scene.collide(index as usize, pair, R::Mask::from_bits(lanes), narrow_phase, contacts, unreliable));
        }
        // The broad phase has tested dynamic pairs by slightly enlarged bounding balls or by boxes. `balls_touch` tests the balls
        // themselves.
        if let Some(dynamic_pairs) = &compiled.dynamic_pairs {
            for &(index, lanes) in &broad.pairs {
                let Some(pair) = dynamic_pairs.pair(index as usize) else { continue };
                let lanes = R::Mask::from_bits(lanes).and(scene.poses.balls_touch(&pair, slack));
                if lanes.any() {
                    any = any.or(scene.collide(index as usize, &pair, lanes, narrow_phase, contacts, unreliable));
                }
            }
        }
        any
    })
}
