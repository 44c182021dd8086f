//! Stage 8: positions are corrected where the velocity of the solution is not the one they should have moved with.
//!
//! A second solve of the same rows, without restitution, finds the velocity that closes every gap just so and removes a part of every
//! overlap. It is used once, for the positions, and thrown away: no kinetic energy comes of it. That is [`stabilise`], the split form. With
//! Baumgarte's method positions are corrected through the velocities; [`limit_baumgarte`], which runs after stage 6, replaces velocities
//! that its bias has made absurd, and there the bounded correction stays in the velocity.
//!
//! What positions demand may be impossible: overlaps that contradict one another, a weld out of reach, a contact whose normal passes a
//! hinge. So the demands are damped ([`stepper_solve::PositionRows::damp`]), what they move is bounded, island by island, and where a
//! witness proves that no motion within the bounds meets them, the lane is marked infeasible.

use stepper_real::{Mask, Real, Scalar};
use stepper_solve::{Damping, Iterate, Outcome, Problem, Settings, System};

use crate::collision::contact_set::Contacts;
use crate::compile::{LaneModel, ModelStructure};
use crate::constraints::{AssembledRows, SolverWorkspace};
use crate::dynamics::inertia::MassMatrix;
use crate::dynamics::kinematics::displace;
use crate::math::lanes::each_of;
use crate::math::spatial::*;
use crate::model::JointKind;
use crate::options::{Solver, Stabilization, StepSettings};
use crate::tuning::{
    BAUMGARTE_LIMIT, CORRECTION_ARM, CORRECTION_ITERATIONS, CORRECTION_NEWTON_STEPS, CORRECTION_NEWTON_THRESHOLD, CORRECTION_RATIO,
    CORRECTION_TOLERANCE, DAMPING, MAX_CORRECTION_ROTATION, MAX_SPEED_RATIO, MIN_UNMET_DEMAND, NEGLIGIBLE_CORRECTION,
};

/// Bounds of the motion of a correction.
#[derive(Clone, Copy, Debug)]
struct Bounds<R> {
    /// m/s
    shift: R,
    /// rad/s
    turn: R,
}

impl<R: Real> Bounds<R> {
    #[inline(always)]
    fn new(options: &StepSettings, h: R) -> Self {
        let shift = R::of((MAX_SPEED_RATIO * options.max_correction_speed).max(1e-9));
        Self { shift, turn: (shift * R::of(1.0 / CORRECTION_ARM)).min(R::of(MAX_CORRECTION_ROTATION) / h) }
    }

    /// Changes of velocities beyond which Baumgarte's bias is held for their cause, whatever the time step.
    #[inline(always)]
    fn absurd(options: &StepSettings) -> Self {
        let shift = R::of((BAUMGARTE_LIMIT * MAX_SPEED_RATIO * options.max_correction_speed).max(1e-9));
        Self { shift, turn: shift * R::of(1.0 / CORRECTION_ARM) }
    }

    /// Bound of each degree of freedom of a joint: shifts come first in a free joint.
    #[inline(always)]
    fn of(&self, kind: JointKind, dof: usize) -> R {
        if kind == JointKind::Slide || kind == JointKind::Free && dof < 3 { self.shift } else { self.turn }
    }
}

/// What joins the state before the step and that after it.
pub struct Solved<'a, R: Real> {
    /// Rows of the step.
    pub rows: AssembledRows<'a, R>,
    /// Factors of the mass matrix.
    pub mass: &'a MassMatrix<R>,
    /// Contacts of the step.
    pub contacts: &'a Contacts<R>,
    /// Velocity after the step without constraints.
    pub v_free: &'a [R],
    /// Time step, s.
    pub h: R,
}

/// Corrects `q_next`, which has moved with `v_next`, in the lanes that need it: leaves the result in `corrected`. Returns those of them in
/// which the demands cannot be met.
#[inline(always)]
pub fn stabilise<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    solved: &Solved<'_, R>,
    workspace: &mut SolverWorkspace<'_, R>,
    v_next: &[R],
    [work, corrected]: [&mut [R]; 2],
    q_next: &[R],
) -> R::Mask {
    let infeasible = correct(compiled, options, solved, workspace, solved.rows.needs_position_solve, v_next, work);
    displace(compiled, q_next, work, solved.h, corrected);
    infeasible
}

/// Limits Baumgarte's method in lanes with a bias where constraints change a velocity by more than four times what a correction may, or
/// where a row that nothing can move demands more than 1 cm/s. There the velocity `v_next` becomes that of the rows without their bias,
/// with the bounded correction that the split form would give positions. Returns the lanes in which demands cannot be met.
#[inline(always)]
pub fn limit_baumgarte<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    solved: &Solved<'_, R>,
    workspace: &mut SolverWorkspace<'_, R>,
    outcome: &mut Outcome<R>,
    work: &mut [R],
    v_next: &mut [R],
) -> R::Mask {
    let never = R::Mask::splat(false);
    let AssembledRows { problem, biased, .. } = solved.rows;
    if biased.none() {
        return never;
    }
    let bounds = Bounds::absurd(options);
    let lanes = R::vectorize(
        #[inline(always)]
        || {
            for (work, (&v, &free)) in work.iter_mut().zip(v_next.iter().zip(solved.v_free)) {
                *work = v - free;
            }
            let unmet = System::from(problem).immovable_demand().gt(R::of(MIN_UNMET_DEMAND));
            biased.and(excess(compiled, work, bounds).gt(R::one()).or(unmet))
        },
    );
    if lanes.none() {
        return never;
    }
    let [sweeps, newton] = options.effort();
    let tolerance = R::of(options.tolerance);
    let settings = Settings { sweeps, newton_steps: newton, tolerance, newton_threshold: tolerance };
    R::vectorize(
        #[inline(always)]
        || {
            workspace.positions.copy(problem);
            workspace.positions.exchange_demands();
        },
    );
    let system = workspace.positions.system(problem);
    let repeated = stepper_solve::solve(system, workspace.iterate, settings, lanes, workspace.newton);
    let unsolved = lanes.and_not(repeated.residual.le(tolerance));
    workspace.worst.renew(&solved.rows, system, workspace.iterate, solved.contacts, [lanes, unsolved]);
    outcome.replace(&repeated, lanes);
    R::vectorize(
        #[inline(always)]
        || {
            work.copy_from_slice(&workspace.iterate.w);
            solved.mass.unscale(compiled, work);
            for i in 0..compiled.nv {
                v_next[i] = R::select(lanes, solved.v_free[i] + work[i], v_next[i]);
            }
        },
    );
    workspace.shared.save(workspace.iterate, lanes);
    let infeasible = correct(compiled, options, solved, workspace, lanes, v_next, work);
    R::vectorize(
        #[inline(always)]
        || {
            for (v, &more) in v_next.iter_mut().zip(work.iter()) {
                *v += R::select(lanes, more, R::zero());
            }
            // The impulses that make this velocity, for those who read them.
            for (change, (&v, &free)) in work.iter_mut().zip(v_next.iter().zip(solved.v_free)) {
                *change = v - free;
            }
            solved.mass.scale(compiled, work);
            for (w, &change) in workspace.iterate.w.iter_mut().zip(work.iter()) {
                *w = R::select(lanes, change, *w);
            }
        },
    );
    infeasible
}

/// Swaps the two right-hand sides of the position rows, damps them, solves, and leaves in `out` the bounded velocity to add to `v_next` so
/// that positions move as they demand. Returns the lanes that are proven infeasible.
fn correct<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    solved: &Solved<'_, R>,
    workspace: &mut SolverWorkspace<'_, R>,
    lanes: R::Mask,
    v_next: &[R],
    out: &mut [R],
) -> R::Mask {
    let problem = solved.rows.problem;
    damp_rows(compiled, options, solved, workspace);
    let [sweeps, newton] = options.effort();
    let tight = CORRECTION_RATIO * options.tolerance;
    let (tolerance, sweeps, newton, rough) = match options.is_tight() {
        true => (tight, sweeps, newton, tight),
        false => (
            options.tolerance.max(CORRECTION_TOLERANCE),
            sweeps.min(CORRECTION_ITERATIONS),
            newton.min(CORRECTION_NEWTON_STEPS),
            CORRECTION_NEWTON_THRESHOLD,
        ),
    };
    let newton = if options.solver == Solver::Newton { options.iterations } else { newton };
    let threshold = if options.solver == Solver::Newton { tolerance } else { tolerance.max(rough) };
    let settings = Settings { sweeps, newton_steps: newton, tolerance: R::of(tolerance), newton_threshold: R::of(threshold) };
    let system = workspace.positions.system(problem);
    let system = if options.is_tight() { system } else { system.uncertified() };
    stepper_solve::solve(system, workspace.iterate, settings, lanes, workspace.newton);
    let bounds = Bounds::new(options, solved.h);
    let (fast, lacking) = R::vectorize(
        #[inline(always)]
        || {
            find_motion(compiled, solved, workspace.iterate, v_next, out);
            let short = system.shortfall(workspace.iterate, workspace.reference);
            let held = system.immovable_demand();
            let fast = lanes.and_not(solved.rows.rebounding).and(excess(compiled, out, bounds).gt(R::one()));
            (fast, lanes.and(short.max(held).gt(R::of(MIN_UNMET_DEMAND))))
        },
    );
    let infeasible = if lacking.any() { prove_infeasible(compiled, solved, workspace, lacking, bounds) } else { lacking };
    if fast.any() {
        bound_islands(compiled, options, problem, workspace, fast, bounds, out);
    }
    infeasible
}

/// Makes the rows of the position solve of copies of those of the velocity solve: damped, counted from the present impulses, with the
/// demands of positions.
#[inline(always)]
pub(crate) fn damp_rows<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    solved: &Solved<'_, R>,
    workspace: &mut SolverWorkspace<'_, R>,
) {
    let negligible = R::of(if options.is_tight() { NEGLIGIBLE_CORRECTION } else { 0.0 });
    let damping = Damping { ratio: R::of(DAMPING), bending: solved.h * R::of(1.0 / CORRECTION_ARM), negligible };
    R::vectorize(
        #[inline(always)]
        || {
            workspace.positions.exchange_demands();
            find_floors(compiled, solved, workspace.floors);
            workspace.positions.damp(solved.rows.problem, workspace.iterate, damping, workspace.floors, workspace.reference);
        },
    );
}

/// The velocity to add to `v_next` so that positions move as the impulses of the position solve say, left in `out`. Returns the largest
/// part that it is of its bounds, above 1 where [`stabilise`] slows it down.
pub(crate) fn find_correction<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    solved: &Solved<'_, R>,
    iterate: &Iterate<R>,
    v_next: &[R],
    out: &mut [R],
) -> R {
    let bounds = Bounds::new(options, solved.h);
    R::vectorize(
        #[inline(always)]
        || {
            find_motion(compiled, solved, iterate, v_next, out);
            excess(compiled, out, bounds)
        },
    )
}

/// The velocity to add to `v_next` by the impulses of the position solve, without bounds.
#[inline(always)]
fn find_motion<R: Real>(compiled: &LaneModel<R>, solved: &Solved<'_, R>, iterate: &Iterate<R>, v_next: &[R], out: &mut [R]) {
    out.copy_from_slice(&iterate.w);
    solved.mass.unscale(compiled, out);
    for i in 0..compiled.nv {
        out[i] = (solved.v_free[i] + out[i]) - v_next[i];
    }
}

/// The largest part that a motion is of its bounds.
#[inline(always)]
fn excess<R: Real>(compiled: &ModelStructure<R::Scalar>, v: &[R], bounds: Bounds<R>) -> R {
    let mut most = R::zero();
    for joint in &compiled.joints {
        most = most.max(excess_of(joint.kind, &v[joint.v..joint.v + joint.kind.nv()], bounds));
    }
    most
}

/// The same of one joint, whose direction of shift or axis of turn does not matter.
#[inline(always)]
fn excess_of<R: Real>(kind: JointKind, v: &[R], bounds: Bounds<R>) -> R {
    match kind {
        JointKind::Free => (norm([v[0], v[1], v[2]]) / bounds.shift).max(norm([v[3], v[4], v[5]]) / bounds.turn),
        JointKind::Ball => norm([v[0], v[1], v[2]]) / bounds.turn,
        JointKind::Slide | JointKind::Hinge => v[0].abs() / bounds.of(kind, 0),
    }
}

/// Slows the motion `v` down, in the lanes `lanes`, where an island of bodies that rows join exceeds its bounds: all of the island alike,
/// so that loops stay closed. With Baumgarte's method the impulses, which people read, are slowed down with it, from those of the snapshot.
#[cold]
fn bound_islands<R: Real>(
    compiled: &ModelStructure<R::Scalar>,
    options: &StepSettings,
    problem: &Problem<R>,
    workspace: &mut SolverWorkspace<'_, R>,
    lanes: R::Mask,
    bounds: Bounds<R>,
    v: &mut [R],
) {
    let SolverWorkspace { iterate, positions, islands, shared, .. } = workspace;
    let system = positions.system(problem);
    for lane in each_of(lanes.bits()) {
        islands.find(compiled, system, lane);
        for joint in &compiled.joints {
            let excess = excess_of(joint.kind, &v[joint.v..joint.v + joint.kind.nv()], bounds);
            islands.note(compiled.dofs[joint.v].tree, excess.lane(lane).to_f64());
        }
        let mut part = |dof: usize| {
            let most = islands.most(compiled.dofs[dof].tree);
            if most > 1.0 { 1.0 / most } else { 1.0 }
        };
        if options.stabilization == Stabilization::Baumgarte {
            shared.blend(system, iterate, lane, &mut |dof| part(dof as usize));
        }
        for joint in &compiled.joints {
            let factor = R::of(part(joint.v));
            for v in &mut v[joint.v..joint.v + joint.kind.nv()] {
                v.set_lane(lane, (*v * factor).lane(lane));
            }
        }
    }
}

/// Those of the lanes `lanes` in which the impulses of the correction prove that no motion within the bounds meets what positions demand.
#[cold]
fn prove_infeasible<R: Real>(
    compiled: &LaneModel<R>,
    solved: &Solved<'_, R>,
    workspace: &mut SolverWorkspace<'_, R>,
    lanes: R::Mask,
    bounds: Bounds<R>,
) -> R::Mask {
    R::vectorize(
        #[inline(always)]
        || {
            let system = workspace.positions.system(solved.rows.problem);
            let lack = system.witness(workspace.iterate, workspace.reference);
            let momentum = workspace.reference.momentum();
            solved.mass.momentum(compiled, momentum);
            let mut most = R::zero();
            for joint in &compiled.joints {
                for k in 0..joint.kind.nv() {
                    most += momentum[joint.v + k].abs() * bounds.of(joint.kind, k);
                }
            }
            // A contact that nothing can move along its normal is a witness by itself.
            let held = system.immovable_demand().gt(R::of(MIN_UNMET_DEMAND));
            lanes.and(held.or(lack.gt(most)))
        },
    )
}

/// Mobility of the bodies of every contact if nothing held them, 1/kg: what damping is at least relative to. 0 for scalar rows.
#[inline(always)]
fn find_floors<R: Real>(compiled: &LaneModel<R>, solved: &Solved<'_, R>, floors: &mut Vec<R>) {
    let AssembledRows { problem, slots, rolling_slots, .. } = solved.rows;
    floors.clear();
    floors.resize(problem.scalars.len(), R::zero());
    let all = slots.iter().map(|slot| (slot.0, slot.1)).chain(rolling_slots.iter().map(|slot| (slot.0, slot.1)));
    for (k, lanes) in all {
        let mut floor = R::zero();
        for (pair, lanes) in solved.contacts.pairs(k, lanes.bits()) {
            let geoms = compiled.pair_geoms(pair).expect("made from this compiled");
            let free = compiled.mobility(compiled.geoms[geoms[0]].frame) + compiled.mobility(compiled.geoms[geoms[1]].frame);
            floor = R::select(R::Mask::from_bits(lanes), free, floor);
        }
        floors.push(floor);
    }
}
