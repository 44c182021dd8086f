//! Reversal of position corrections that do not reduce the overlap.
//!
//! Stage 8 linearises its rows at one pose. With contradictory constraints the predicted reduction may not occur at the corrected pose,
//! because the normals of deep overlaps turn or jump. Without a reversal a jammed joint would oscillate for ever. In lanes with a proof of
//! infeasibility the step therefore measures the overlaps again at the corrected pose.
//!
//! The correction of an island is kept only if the sum of its penalties decreases sufficiently (as in a line search; Armijo 1966).
//! Otherwise the island keeps its uncorrected positions. The sum is bounded below, so that a jam comes to rest. It depends on two poses of
//! the step and on no memory.
//!
//! The penalty of an overlap x is the merit function of the damped solve: `x - x0 ln(1 + x / x0)`, with a constant length x0. Below x0 the
//! penalty is quadratic, because the relative compliance is constant. Above x0 it is linear, because the compliance grows with the
//! correction.

use stepper_real::{Mask, Real, Scalar};

use crate::collision::contact_set::Contacts;
use crate::compile::{LaneModel, ModelStructure};
use crate::constraints::islands::{Island, Islands};
use crate::constraints::{ConstraintProblem, PositionSolution};
use crate::dynamics::mocap;
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::step_input::StepInput;
use crate::math::lanes::each_of;
use crate::options::StepSettings;
use crate::probe::NoProbe;
use crate::stages::s03_detect::detect;
use crate::tuning::{CORRECTION_ARM, DAMPING, MIN_BAUMGARTE, MIN_DECREASE, MIN_DECREASE_ROUNDINGS};

/// Reverts each island's position correction that does not reduce the island's overlap. `infeasible` has the lanes to check, and
/// `position.q_corrected` the corrected configuration.
#[cold]
#[inline(never)]
pub(crate) fn revert_ineffective_corrections<R: Real>(
    input: StepInput<'_, R>,
    evaluation: &mut Evaluation<R>,
    problem: &ConstraintProblem<R>,
    islands: &mut Islands,
    position: &mut PositionSolution<R>,
    infeasible: R::Mask,
) {
    let StepInput { compiled, options, state, inputs, .. } = input;
    let PositionSolution { q, q_corrected, kinematics, contacts, rows, correction, .. } = position;
    let time = R::of(state.elapsed) + evaluation.substep.offset + evaluation.scheme.time_before;
    mocap::pose_bodies(compiled, &inputs.mocap_trajectories, |_| time, kinematics);
    kinematics.update(compiled, q_corrected);
    // The buffer of the correction velocity is no longer needed.
    correction.fill(R::zero());
    let times = [evaluation.scheme.h, R::zero()];
    // This detection starts from the separating planes of stage 3, and discards those that it finds.
    evaluation.collision.narrow_phase.begin_step();
    detect(compiled, kinematics, [&*correction; 2], times, infeasible, &mut evaluation.collision, contacts, NoProbe);
    evaluation.collision.narrow_phase.begin_step();
    let system = rows.system(&problem.rows);
    let min_decrease = MIN_DECREASE.max(MIN_DECREASE_ROUNDINGS * <R::Scalar as Scalar>::EPSILON.to_f64());
    for lane in each_of(infeasible.bits()) {
        islands.find(compiled, system, lane);
        // An island with an open loop always keeps its correction, because closing the loop has priority over overlaps.
        for row in problem.rows.scalars.iter().filter(|row| row.lo.lane(lane).to_f64() < 0.0) {
            let correction = (row.g.lane(lane).to_f64() - row.position_g.lane(lane).to_f64()).abs();
            if correction * evaluation.scheme.h.lane(lane).to_f64() > options.slop {
                let (dofs, _) = problem.rows.scalars.entries(row);
                dofs.iter().for_each(|&d| islands.of_tree(compiled.dofs[d as usize].tree).exempt = true);
            }
        }
        // The sums do not include ball joint limits and tendons. Islands with these always keep the correction.
        compiled.ball_limits.iter().for_each(|limit| islands.of_tree(compiled.dofs[limit.dof].tree).exempt = true);
        for tendon in &compiled.tendons {
            tendon.dofs.iter().for_each(|&d| islands.of_tree(compiled.dofs[d as usize].tree).exempt = true);
        }
        add_overlaps(compiled, options, &evaluation.contacts, lane, islands, 0);
        add_overlaps(compiled, options, contacts, lane, islands, 1);
        add_limits(compiled, options, &evaluation.q, lane, islands, 0);
        add_limits(compiled, options, q_corrected, lane, islands, 1);
        for joint in &compiled.joints {
            let Island { penalties: [before, after], exempt, .. } = *islands.of_tree(compiled.dofs[joint.v].tree);
            // With NaN, the penalties do not count as decreased.
            if !exempt && before > 0.0 && after.partial_cmp(&(before * (1.0 - min_decrease))) != Some(std::cmp::Ordering::Less) {
                for k in joint.q..joint.q + joint.kind.nq() {
                    q_corrected[k].set_lane(lane, q[k].lane(lane));
                }
            }
        }
    }
}

/// Penalty of an overlap of `x` m beyond the slop (the overlap that correction leaves), or of a joint limit violation that is converted
/// to the length `x`.
fn penalty(options: &StepSettings, x: f64) -> f64 {
    let x0 = DAMPING * CORRECTION_ARM / options.baumgarte.max(MIN_BAUMGARTE);
    x - x0 * (x / x0).ln_1p()
}

/// Adds the penalty of the deepest overlap of every pair of geoms to the islands of its bodies. The penalty is computed from the overlap
/// beyond the slop (the overlap that position correction leaves). `pose` selects the sum: 0 before the correction, 1 after it.
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
        let geoms = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
        islands.add_penalty(geoms.map(|g| compiled.tree_of(compiled.geoms[g].frame)), pose, penalty(options, depth));
    }
}

/// Adds the penalties of joint limit violations at the configuration `q` to the islands. One radian counts as the length
/// [`CORRECTION_ARM`]. `pose` selects the sum: 0 before the correction, 1 after it.
fn add_limits<R: Real>(compiled: &LaneModel<R>, options: &StepSettings, q: &[R], lane: usize, islands: &mut Islands, pose: usize) {
    for (i, limit) in compiled.limits.iter().enumerate() {
        let [lowest, highest] = compiled.params.limit(i);
        let violation = (lowest - q[limit.q]).max(q[limit.q] - highest).lane(lane).to_f64() - options.slop;
        if violation > 0.0 {
            islands.add_penalty([Some(compiled.dofs[limit.dof].tree), None], pose, penalty(options, CORRECTION_ARM * violation));
        }
    }
}
