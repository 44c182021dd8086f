//! Outcome of a step, from which stage 10 computes its record.

use stepper_real::{Mask, Real, Scalar, kernel};
use stepper_solve::{Outcome, System};

use crate::compile::LaneModel;
use crate::constraints::equality::equality_violation::max_equality_violation;
use crate::constraints::worst_row::CodedConstraint;
use crate::constraints::{ConstraintProblem, VelocitySolution};
use crate::dynamics::kinematics::Kinematics;
use crate::dynamics::mocap;
use crate::integrators::acceptance::Accepted;
use crate::integrators::evaluate::free_motion::FreeMotion;
use crate::integrators::step_input::StepInput;
use crate::math::lanes::each_of;
use crate::stages::s08_stabilise::Infeasible;
use crate::stages::s10_record::{DEEP, EQUALITY_VIOLATED, OVER_LIMIT, Record, Status, depth, limit_overshoot};
use crate::tuning::BALANCE_ROTATION;

/// Outcome of the solver in a step, and the lanes whose result may be wrong.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StepOutcome<R: Real> {
    /// Residual and number of iterations of the solver.
    pub(crate) solver: Outcome<R>,
    /// Lanes in which the residual may change the kinetic energy noticeably.
    pub(crate) ambiguous: R::Mask,
    /// Lanes in which the impulses prove that no position correction within its bounds reaches all position targets.
    pub(crate) infeasible: Infeasible<R>,
    /// Lanes in which one geom may have passed through another.
    pub(crate) tunnelled: R::Mask,
    /// Lanes with an unreliable kinetic energy after the step.
    ///
    /// There are three causes. The integration error adds energy because the time step is too large. The step made impacts inelastic,
    /// because friction would add energy with Newton's law. Or active bounds of servos differ from the assumed ones after the last solve.
    pub(crate) energy_unresolved: R::Mask,
}

/// Computes stage 10: status and record of the step. `input` has the state after the step, `elapsed` s after the beginning of the call. The
/// function stores the cause of a residual of immovable rows in `velocity.worst`. For spatial tendons it updates `kinematics` to the state.
#[inline(always)]
pub(crate) fn record<R: Real>(
    input: StepInput<'_, R>,
    (elapsed, kinematics): (R, &mut Kinematics<R>),
    free: &FreeMotion<R>,
    problem: &ConstraintProblem<R>,
    velocity: &mut VelocitySolution<R>,
    outcome: &StepOutcome<R>,
    Accepted { finite, beyond, .. }: Accepted<R>,
) -> Record<R> {
    let StepInput { compiled, options, state, inputs, alive } = input;
    if !compiled.paths.is_empty() {
        mocap::pose_bodies(compiled, &inputs.mocap_trajectories, |_| elapsed, kinematics);
        kinematics.update(compiled, &state.q);
    }
    let paths = &kinematics.paths;
    let (depth, overshoot) = (depth(&state.contacts, finite), limit_overshoot(compiled, &state.q, paths));
    let violation = max_equality_violation(compiled, &inputs.active_equalities, (&state.q, paths), &inputs.mocap_trajectories, elapsed);
    let violation = R::select(finite, violation, R::zero());
    let mut residual = outcome.solver.residual;
    if problem.may_have_immovable_rows {
        // The solver's residual does not include immovable rows: equality rows that depend linearly on others, and rows whose velocity no
        // degree of freedom changes.
        let unmet = kernel!(R, || System::from(&problem.rows).unmet_velocity());
        let larger = unmet.gt(residual);
        residual = R::select(larger, unmet, residual);
        let causes = larger.and(residual.gt(R::of(options.tolerance))).and(alive).and(finite).and_not(outcome.infeasible.lanes);
        if causes.any() {
            velocity.worst.find(problem, &state.contacts, causes, |lane| System::from(&problem.rows).worst_unmet_velocity(lane));
        }
    }
    let unsolved = outcome.ambiguous.or(alive.and_not(residual.le(R::of(options.tolerance))));
    let too_fast = free.unresolved_lanes().or(outcome.energy_unresolved).or(beyond);
    let unnamed = too_fast.and(finite).and_not(unsolved.or(outcome.infeasible.lanes));
    for lane in each_of(unnamed.bits()) {
        velocity.worst.store(lane, fastest_dof(compiled, free, (&state.v, options.timestep), lane).map(CodedConstraint::TooFast));
    }
    // A rejected step has no error that could be measured.
    residual = R::select(finite, residual.max(outcome.infeasible.unmet), R::select(alive, R::of(f64::INFINITY), R::zero()));
    Record {
        residual,
        sweeps: outcome.solver.sweeps,
        newton_steps: outcome.solver.newton_steps,
        depth,
        overshoot,
        equality_violation: violation,
        error: R::zero(),
        substeps: R::zero(),
        flags: [
            (Status::NOT_CONVERGED, unsolved.and(finite).bits()),
            (Status::NON_FINITE, alive.and_not(finite).bits()),
            (Status::CONTACTS_FULL, state.contacts.full),
            (Status::UNRESOLVED, too_fast.bits()),
            (Status::TUNNELLED, outcome.tunnelled.bits()),
            (Status::INFEASIBLE, alive.and(finite).and(outcome.infeasible.lanes).bits()),
            (Status::DEEP, alive.and(depth.gt(R::of(DEEP))).bits()),
            (Status::OVER_LIMIT, alive.and(overshoot.gt(R::of(OVER_LIMIT))).bits()),
            (Status::EQUALITY_VIOLATED, alive.and(violation.gt(R::of(EQUALITY_VIOLATED))).bits()),
            (Status::INACCURATE, 0),
        ],
    }
}

/// Fastest degree of freedom in lane `lane` at the velocity `v` and a time step of `h` s; `None` if nothing moves. Mechanisms whose motion
/// is too fast for the time step come first, if there are any. Fast rotations, rad/s, come before translations, m/s.
#[cold]
fn fastest_dof<R: Real>(compiled: &LaneModel<R>, free: &FreeMotion<R>, (v, h): (&[R], f64), lane: usize) -> Option<usize> {
    let is_unresolved = |dof: &usize| free.unresolved[compiled.mechanism_of(*dof)].bits() >> lane & 1 == 1;
    let speed = |dof: usize| v[dof].lane(lane).to_f64().abs();
    let any = (0..compiled.nv).any(|dof| is_unresolved(&dof));
    let fastest = |dofs: &mut dyn Iterator<Item = usize>| {
        dofs.filter(|dof| !any || is_unresolved(dof)).max_by(|&a, &b| speed(a).total_cmp(&speed(b))).filter(|&dof| speed(dof) > 0.0)
    };
    let rotation = fastest(&mut compiled.rotations()).filter(|&dof| speed(dof) * h > BALANCE_ROTATION);
    rotation.or_else(|| fastest(&mut (0..compiled.nv)))
}
