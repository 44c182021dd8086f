//! Corrections of positions that bring nothing, which are taken back.
//!
//! A correction follows from rows that are linearised at one pose. Where demands contradict one another, what it gains there need not be
//! gained at the corrected pose: the normals of deep overlaps turn or jump, and a joint is pushed to and fro for ever. So where a witness
//! proves that the demands cannot be met, the overlaps are measured again at the corrected pose (sufficient decrease, as in a line search;
//! Armijo 1966), and an island of bodies whose sum of penalties does not become less stays where its velocity leads it. The sum is bounded
//! below, so that a jam comes to rest; and it is that of two poses, so that nothing is remembered.
//!
//! The penalty of an overlap x is what the damped solve descends on, `x - x0 ln(1 + x / x0)`: quadratic up to x0, where compliance is
//! relative to mobility alone, and linear beyond, where it grows with the correction.

use stepper_real::{Mask, Real, Scalar};

use crate::collision::contact_set::Contacts;
use crate::compile::{LaneModel, ModelStructure};
use crate::constraints::islands::Islands;
use crate::constraints::{ARM, DAMPING};
use crate::dynamics::mocap;
use crate::integrators::scheme::Scheme;
use crate::integrators::workspace::Workspace;
use crate::math::lanes::each_of;
use crate::options::StepSettings;
use crate::probe::NoProbe;
use crate::stages::s03_detect::detect;

/// Relative decrease of the sum of penalties below which a correction brings nothing.
///
/// A slide between two walls that overlap it by a millimetre each way comes within 0.5 % of their middle in steps of 0.1 ms. A wheel of
/// Unitree's G1-D, a decimetre within its base, gains less than 1e-7 a step.
const MIN_DECREASE: f64 = 2e-7;

/// Least relative decrease in roundings of a lane: depths are differences of positions.
const MIN_DECREASE_ROUNDINGS: f64 = 1e3;

/// Takes the correction of `work.q_corrected` back, in the lanes `stuck`, from islands whose overlaps it does not lessen.
#[cold]
#[inline(never)]
pub(crate) fn revert_ineffective_corrections<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    scheme: &Scheme<R>,
    s: &mut Workspace<R>,
    stuck: R::Mask,
) {
    mocap::pose_bodies(compiled, &s.mocap_trajectories, R::of(s.elapsed) + scheme.time_before, &mut s.corrected_kinematics);
    s.corrected_kinematics.update(compiled, &s.work.q_corrected);
    // Nothing reads the contacts of the last step any more, nor the correction.
    let (contacts, rest) = (&mut s.state.contacts, &mut s.work.correction);
    rest.fill(R::zero());
    let still = [R::of(options.timestep), R::zero()];
    // Searches begin where those of this step have ended, and leave nothing to the next.
    s.poses.search.exchange();
    detect(compiled, &s.corrected_kinematics, [&*rest, &*rest], still, stuck, &mut s.poses, contacts, NoProbe);
    s.poses.search.exchange();
    let (rows, room) = s.constraints.split();
    let system = room.positions.system(rows.problem);
    let min_decrease = MIN_DECREASE.max(MIN_DECREASE_ROUNDINGS * <R::Scalar as Scalar>::EPSILON.to_f64());
    for lane in each_of(stuck.bits()) {
        let islands = &mut *room.islands;
        islands.find(compiled, system, lane);
        // Loops that have opened are to be closed, whatever overlaps.
        for row in rows.problem.scalars.iter().filter(|row| row.lo.lane(lane).to_f64() < 0.0) {
            let correction = (row.g.lane(lane).to_f64() - row.position_g.lane(lane).to_f64()).abs();
            if correction * options.timestep > options.slop {
                let (support, _) = rows.problem.scalars.entries(row);
                support.iter().for_each(|&d| islands.exempt(compiled.dofs[d as usize].tree));
            }
        }
        compiled.ball_limits.iter().for_each(|limit| islands.exempt(compiled.dofs[limit.dof].tree));
        for tendon in &compiled.tendons {
            tendon.support.iter().for_each(|&d| islands.exempt(compiled.dofs[d as usize].tree));
        }
        add_overlaps(compiled, options, &s.evaluation.contacts, lane, islands, 0);
        add_overlaps(compiled, options, contacts, lane, islands, 1);
        add_limits(compiled, options, &s.evaluation.q, lane, islands, 0);
        add_limits(compiled, options, &s.work.q_corrected, lane, islands, 1);
        for joint in &compiled.joints {
            let Some([before, after]) = islands.penalties(compiled.dofs[joint.v].tree) else { continue };
            // Also where it is NaN.
            if before > 0.0 && after.partial_cmp(&(before * (1.0 - min_decrease))) != Some(std::cmp::Ordering::Less) {
                for k in joint.q..joint.q + joint.kind.nq() {
                    s.work.q_corrected[k].set_lane(lane, s.next.q[k].lane(lane));
                }
            }
        }
    }
}

/// Penalty of an overlap, or of a joint's way beyond its range as a distance, of `x` m.
fn penalty(options: &StepSettings, x: f64) -> f64 {
    let knee = DAMPING * ARM / options.baumgarte.max(MIN_DECREASE);
    x - knee * (x / knee).ln_1p()
}

/// Adds the penalty of every pair's deepest overlap beyond the slop to its islands.
fn add_overlaps<R: Real>(
    compiled: &ModelStructure<R::Scalar>,
    options: &StepSettings,
    contacts: &Contacts<R>,
    lane: usize,
    islands: &mut Islands,
    pose: usize,
) {
    let (mut k, count) = (0, contacts.count[lane]);
    while k < count {
        let pair = contacts.ids[k][lane].pair();
        let mut depth = 0.0_f64;
        while k < count && contacts.ids[k][lane].pair() == pair {
            depth = depth.max(-contacts.data[k].point.distance.lane(lane).to_f64() - options.slop);
            k += 1;
        }
        if depth <= 0.0 {
            continue;
        }
        let geoms = compiled.pair_geoms(pair).expect("made from this compiled");
        let tree = |geom: usize| {
            let frame = compiled.geoms[geom].frame;
            (frame > 0 && frame <= compiled.links.len()).then(|| compiled.links[frame - 1].tree)
        };
        islands.add_penalty(geoms.map(tree), pose, penalty(options, depth));
    }
}

/// Adds the penalties of joints' ways beyond their ranges, of which a radian counts as the length ARM.
fn add_limits<R: Real>(compiled: &LaneModel<R>, options: &StepSettings, q: &[R], lane: usize, islands: &mut Islands, pose: usize) {
    for (i, limit) in compiled.limits.iter().enumerate() {
        let [lowest, highest] = compiled.params.limit(i);
        let violation = (lowest - q[limit.q]).max(q[limit.q] - highest).lane(lane).to_f64() - options.slop;
        if violation > 0.0 {
            islands.add_penalty([Some(compiled.dofs[limit.dof].tree), None], pose, penalty(options, ARM * violation));
        }
    }
}
