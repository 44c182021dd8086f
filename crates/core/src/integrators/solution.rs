//! Solution of a step: velocities, positions and the record.

use stepper_real::{Mask, Real, Scalar};
use stepper_solve::{Outcome, System};

use crate::collision::tunnelling::{TakenStep, may_have_passed};
use crate::compile::LaneModel;
use crate::constraints::equality_violation::max_equality_violation;
use crate::dynamics::kinematics::{blend, displace};
use crate::integrators::acceptance::{ambiguous, keep_impulse, resolve_ambiguous};
use crate::integrators::impact;
use crate::integrators::overlap_progress::revert_ineffective_corrections;
use crate::integrators::scheme::Scheme;
use crate::integrators::step_resolution::{diverging, limit_joint_rates};
use crate::integrators::struck_contacts::solve_strikes;
use crate::integrators::workspace::{Evaluation, FreeMotion, Workspace};
use crate::options::StepSettings;
use crate::probe::{Counter, Probe, Span};
use crate::stages::s01_actuate::advance_activation;
use crate::stages::s05_solve::{keep_row_impulses, solve};
use crate::stages::s06_integrate_velocity::integrate_velocity;
use crate::stages::s07_integrate_position::integrate_position;
use crate::stages::s08_stabilise::{Solved, limit_baumgarte, stabilise};
use crate::stages::s10_record::{DEEP, EQUALITY_VIOLATED, OVER_LIMIT, Record, depth, limit_overshoot};

/// Solver outcome and lane sets of a step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Solution<R: Real> {
    /// Residual and effort of the solver.
    pub(crate) outcome: Outcome<R>,
    /// Whether constraint impulses changed any velocity.
    pub(crate) impulses_act: bool,
    /// Lanes whose impulses do not determine the kinetic energy.
    pub(crate) ambiguous: R::Mask,
    /// Lanes whose speed and energy are limited: the ambiguous ones, and those whose motion is too fast for the step.
    pub(crate) limited: R::Mask,
    /// Lanes whose constraints no motion satisfies.
    pub(crate) infeasible: R::Mask,
}

/// Stages 5 and 6. Repeats stages 2, 4, 5 and 6 where impacts change the velocity within the step.
#[inline(always)]
pub(crate) fn solve_velocities<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    scheme: &Scheme<R>,
    s: &mut Workspace<R>,
    probe: impl Probe,
) -> Solution<R> {
    let constrained = s.constraints.constrained;
    let (rows, mut workspace) = s.constraints.split();
    let mut outcome =
        probe.span(Span::Solve, || solve(options, &s.state.v, constrained, &rows, &mut workspace, &mut s.evaluation.contacts));
    probe.span(Span::IntegrateVelocity, || {
        integrate_velocity(compiled, &s.free_motion.smooth.mass, &s.free_motion.v, &s.constraints, &mut s.next.v);
    });
    outcome = probe.span(Span::Solve, || solve_strikes(compiled, options, s, outcome));
    if scheme.in_the_middle {
        outcome = probe.span(Span::SolveImpacts, || impact::solve_impacts(compiled, options, scheme, s, outcome));
        outcome = probe.span(Span::Solve, || solve_strikes(compiled, options, s, outcome));
    }
    s.constraints.activate_satisfied();
    probe.span(Span::Solve, || resolve_ambiguous(compiled, options, s, &mut outcome));
    let impulses_act = s.constraints.iterate.changes_velocity();
    count_effort(&outcome, probe);
    let (rows, mut workspace) = s.constraints.split();
    let Evaluation { contacts, .. } = &s.evaluation;
    let FreeMotion { smooth, v: v_free, .. } = &s.free_motion;
    let solved = Solved { rows, mass: &smooth.mass, contacts, v_free, h: scheme.h };
    let infeasible = probe.span(Span::Stabilise, || {
        limit_baumgarte(compiled, options, &solved, &mut workspace, &mut outcome, &mut s.work.correction, &mut s.next.v)
    });
    if s.constraints.biased.any() {
        let (rows, mut workspace) = s.constraints.split();
        keep_row_impulses(&rows, &mut workspace, &mut s.evaluation.contacts);
    }
    probe.span(Span::IntegrateVelocity, || keep_impulse(compiled, s));
    let [ambiguous, limited] = probe.span(Span::GuardEnergy, || guard_speed(compiled, options, scheme, s, outcome.residual));
    Solution { outcome, impulses_act, ambiguous, limited, infeasible }
}

/// Limits joint speeds in lanes whose motion is too fast for the step or whose energy is ambiguous. [`guard_energy`] limits their energy
/// later.
///
/// Returns the ambiguous lanes and all limited lanes.
#[inline(always)]
fn guard_speed<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    scheme: &Scheme<R>,
    s: &mut Workspace<R>,
    residual: R,
) -> [R::Mask; 2] {
    let ambiguous = ambiguous(options, s, residual);
    if scheme.corrects && s.constraints.constrained.any() {
        s.free_motion.unresolved =
            s.free_motion.unresolved.or(s.alive.and(diverging(compiled, [&s.state.v, &s.free_motion.v], &s.next.v, scheme.h)));
    }
    let limited = s.free_motion.unresolved.or(ambiguous);
    if limited.any() {
        limit_joint_rates(compiled, limited, scheme.h, &mut s.next.v);
    }
    [ambiguous, limited]
}

/// Finds the lanes in which the error of the midpoint rule adds energy, before positions are corrected.
///
/// Lanes that the Runge-Kutta scheme replaces are excluded.
#[inline(always)]
fn find_gain<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>) {
    s.free_motion.gains = R::Mask::splat(false);
    if !scheme.corrects || !scheme.in_the_middle {
        return;
    }
    let mut lanes = s.free_motion.may_gain.and_not(s.free_motion.unresolved);
    if s.rk4.is_some() {
        lanes = lanes.and(s.constraints.constrained);
    }
    // A step that is evaluated off its middle has an energy error of first order in its rotation.
    lanes = lanes.and(scheme.time_before.eq(scheme.time_after));
    if lanes.any() {
        displace(compiled, &s.evaluation.q, &s.next.v, scheme.time_after, &mut s.work.q_corrected);
        blend(&s.state.v, &s.free_motion.v_expected, scheme.velocity_weight, &mut s.work.v_mean);
        let states = [[&s.state.q[..], &s.state.v[..]], [&s.work.q_corrected[..], &s.next.v[..]]];
        let made = s.step_resolution.gains_energy(compiled, &s.evaluation.kinematics, states, [&s.free_motion.v, &s.work.v_mean], scheme.h);
        s.free_motion.gains = lanes.and(made);
    }
}

/// Counts the effort of the solver.
#[inline(always)]
fn count_effort<R: Real>(outcome: &Outcome<R>, probe: impl Probe) {
    let lanes = |x: R| (0..R::LANES).map(move |l| x.lane(l).to_f64());
    probe.count(Counter::Sweeps, || lanes(outcome.sweeps).sum());
    probe.count(Counter::SlowestSweeps, || lanes(outcome.sweeps).fold(0.0, f64::max));
    probe.count(Counter::NewtonSteps, || lanes(outcome.newton_steps).sum());
}

/// Stage 7, with actuator activations. Returns the lanes in which a geom may have passed through a thin one.
#[inline(always)]
pub(crate) fn integrate_positions<R: Real>(
    compiled: &LaneModel<R>,
    scheme: &Scheme<R>,
    s: &mut Workspace<R>,
    solution: &Solution<R>,
    probe: impl Probe,
) -> R::Mask {
    let free = !solution.impulses_act && !scheme.corrects;
    probe.span(Span::GuardEnergy, || find_gain(compiled, scheme, s));
    let step = TakenStep { velocity: &s.next.v, is_free: free, h: scheme.h, contacts_at_end: false };
    let tunnelled = probe.span(Span::Tunnelling, || may_have_passed(compiled, &s.evaluation.kinematics, step, s.alive, &mut s.poses));
    probe.span(Span::IntegratePosition, || {
        integrate_position(compiled, &s.evaluation.q, &s.next.v, scheme.time_after, &mut s.next.q);
        advance_activation(compiled, &s.state.act, &s.evaluation.act, &s.inputs.ctrl, scheme.h, &mut s.next.act);
    });
    tunnelled
}

/// Stage 8. With the Runge-Kutta scheme, resolved lanes without constraint rows then take its result instead of that of the midpoint step.
#[inline(always)]
pub(crate) fn correct_positions<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    scheme: &Scheme<R>,
    s: &mut Workspace<R>,
    solution: &mut Solution<R>,
    probe: impl Probe,
) {
    let infeasible = probe.span(Span::Stabilise, || stabilise_positions(compiled, options, scheme, s));
    solution.infeasible = solution.infeasible.or(infeasible);
    if let Some(rk4) = &mut s.rk4 {
        probe.span(Span::Rk4, || {
            rk4.step(compiled, &s.evaluation.kinematics, &s.inputs, [&s.state.q, &s.state.v, &s.state.act], scheme.h);
            let smooth = s.alive.and_not(s.constraints.constrained.or(s.free_motion.unresolved));
            rk4.take(smooth, [&mut s.next.q, &mut s.next.v, &mut s.next.act]);
        });
    }
}

/// Corrects the positions after the step. Returns the lanes whose constraints cannot be satisfied.
#[inline(always)]
fn stabilise_positions<R: Real>(compiled: &LaneModel<R>, options: &StepSettings, scheme: &Scheme<R>, s: &mut Workspace<R>) -> R::Mask {
    let impacts = impact::prepare_position_solve(compiled, scheme, s);
    if s.constraints.needs_position_solve.none() {
        return s.constraints.needs_position_solve;
    }
    let v_free = if impacts.any() { &s.work.v_positions } else { &s.free_motion.v };
    let work = [&mut s.work.correction[..], &mut s.work.q_corrected[..]];
    let (rows, mut workspace) = s.constraints.split();
    let solved = Solved { rows, mass: &s.free_motion.smooth.mass, contacts: &s.evaluation.contacts, v_free, h: scheme.h };
    let (lanes, rebounding) = (rows.needs_position_solve, rows.rebounding);
    let infeasible = stabilise(compiled, options, &solved, &mut workspace, &s.next.v, work, &s.next.q);
    // Bouncing contacts keep their correction: it leads to the position after the rebound.
    let jammed = infeasible.and_not(impacts).and_not(rebounding);
    if jammed.any() {
        revert_ineffective_corrections(compiled, options, scheme, s, jammed);
    }
    R::vectorize(
        #[inline(always)]
        || {
            for (q, &corrected) in s.next.q.iter_mut().zip(&s.work.q_corrected) {
                *q = R::select(lanes, corrected, *q);
            }
        },
    );
    infeasible
}

/// Limits the kinetic energy of limited lanes.
#[inline(always)]
pub(crate) fn guard_energy<R: Real>(compiled: &LaneModel<R>, s: &mut Workspace<R>, solution: &Solution<R>) {
    if solution.limited.any() {
        let (before, after) = ([&s.state.q[..], &s.state.v[..]], [&s.next.q[..], &s.next.v[..]]);
        s.step_resolution.limit_energy(
            compiled,
            &s.evaluation.kinematics,
            solution.limited,
            before,
            after,
            &s.free_motion.v,
            &mut s.work.v_limited,
        );
        std::mem::swap(&mut s.next.v, &mut s.work.v_limited);
    }
}

/// Residual, or the largest unmet target velocity of a row that cannot move, whichever is larger.
///
/// Rows without mobility and dependent rows are not part of the solve.
#[inline(always)]
fn with_blocked_rows<R: Real>(s: &Workspace<R>, residual: R) -> R {
    if !s.constraints.may_be_held {
        return residual;
    }
    R::vectorize(
        #[inline(always)]
        || {
            let unmet = System::from(&s.constraints.problem).unmet_velocity();
            R::select(unmet.gt(residual), unmet, residual)
        },
    )
}

/// Stage 10: status and record of the step. `finite` marks the lanes whose next state is accepted.
#[inline(always)]
pub(crate) fn record<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &Workspace<R>,
    solution: &Solution<R>,
    [finite, tunnelled]: [R::Mask; 2],
) -> Record<R> {
    let (depth, overshoot) = (depth(&s.constraints, &s.state.contacts, finite), limit_overshoot(compiled, &s.state.q));
    let active = &s.constraints.active_equalities;
    let violation = max_equality_violation(compiled, active, &s.state.q, &s.mocap_trajectories, s.elapsed);
    let violation = R::select(finite, violation, R::zero());
    // A rejected step has no residual: its value would depend on which numbers are NaN.
    let residual = R::select(finite, with_blocked_rows(s, solution.outcome.residual), R::zero());
    let unsolved = solution.ambiguous.or(s.alive.and_not(residual.le(R::of(options.tolerance))));
    Record {
        residual,
        sweeps: solution.outcome.sweeps,
        newton_steps: solution.outcome.newton_steps,
        depth,
        overshoot,
        equality_violation: violation,
        deep: s.alive.and(depth.gt(R::of(DEEP))),
        over_limit: s.alive.and(overshoot.gt(R::of(OVER_LIMIT))),
        equality_violated: s.alive.and(violation.gt(R::of(EQUALITY_VIOLATED))),
        not_converged: unsolved.and(finite),
        infeasible: s.alive.and(finite).and(solution.infeasible),
        non_finite: s.alive.and_not(finite),
        contacts_full: s.state.contacts.full,
        unresolved: s.free_motion.unresolved.or(s.free_motion.gains),
        tunnelled,
    }
}
