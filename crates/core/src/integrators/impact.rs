//! Impacts: jumps of the velocity within the step.
//!
//! The step evaluates a bouncing contact at the time of its impact. The contact's normal, its lever arms and the velocity in Newton's law
//! are evaluated at this time too (see [`crate::constraints::impact_time`]).

use stepper_real::{Mask, Real, kernel};
use stepper_solve::Iterate;

use crate::collision::contact_set::Contacts;
use crate::collision::surface_velocity;
use crate::compile::LaneModel;
use crate::constraints::impact_time::{Flight, ImpactPrediction};
use crate::constraints::restitution::ImpactStep;
use crate::constraints::{ConstraintProblem, PositionSolution, VelocitySolution};
use crate::dynamics::gyroscopic;
use crate::dynamics::kinematics::{Kinematics, advance};
use crate::integrators::evaluation::Evaluation;
use crate::integrators::free_motion::{FreeMotion, Scratch};
use crate::integrators::step_input::{StepContext, StepInput};
use crate::integrators::velocity_loop::VelocityLoop;
use crate::math::spatial::*;
use crate::tuning::{
    MAX_IMPACT_RESIDUAL, MAX_RESOLVED_MOTION, MAX_TRUSTED_RESIDUAL, MIN_IMPACT_RATIO, MIN_VELOCITY_ERROR, PLACEMENT_TOLERANCE,
};

/// Moves the evaluation point of each lane to the time of its first impact. Returns the lanes that moved and must be evaluated again.
///
/// An evaluation point within `PLACEMENT_TOLERANCE` of the impact does not move. `v_free` is the velocity after the step without
/// constraints. `first` is true in the first call of a step. A contact that overlaps beyond the slop (the overlap that position correction
/// leaves) while its surfaces separate must have touched earlier. In the first call, its lane moves to the beginning of the step.
pub(crate) fn move_to_first_impacts<R: Real>(
    input: StepInput<'_, R>,
    evaluation: &mut Evaluation<R>,
    v_free: &[R],
    first: bool,
) -> R::Mask {
    let StepInput { compiled, options, state, alive, .. } = input;
    let Evaluation { scheme, kinematics, contacts, impact_lanes: lanes, link_velocities, .. } = evaluation;
    kernel!(R, || {
        let [before, free] = link_velocities;
        kinematics.velocities(compiled, &state.v, before);
        kinematics.velocities(compiled, v_free, free);
        let gravity = norm(compiled.params.gravity());
        let (mut collides, mut time) = (R::Mask::splat(false), scheme.h);
        for k in 0..contacts.slots() {
            let elastic = contacts.elastic(k).and(alive);
            if elastic.none() {
                continue;
            }
            let slot = &contacts.data[k];
            let (gap, time_before, h) = (slot.point.distance, scheme.time_before, scheme.h);
            let [before, free] = normal_velocities(compiled, kinematics, contacts, k, elastic.bits(), [before, free]);
            let ImpactPrediction { collides: here, time: at, .. } =
                Flight { gap, before, free, time_before, h }.predict(options, gravity, slot.restitution, elastic);
            let passed = elastic.and(gap.lt(-R::of(options.slop))).and(before.gt(R::zero())).and(time_before.gt(R::zero()));
            let passed = if first { passed } else { R::Mask::splat(false) };
            time = R::select(here, time.min(at), time);
            time = R::select(passed, R::zero(), time);
            collides = collides.or(here).or(passed);
        }
        let moved = collides.and((time - scheme.time_before).abs().gt(scheme.h * R::of(PLACEMENT_TOLERANCE)));
        scheme.move_to(time, moved);
        *lanes = lanes.or(collides);
        moved
    })
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

/// Prepares the rows and the free velocity of the position solve, if any lane needs it. Returns the lanes with impacts, which need it.
///
/// An impact at time t changes the velocity by dv, and the positions at the end of the step by (h - t) dv. Stage 7 advances positions from
/// `time_before`, so that they change by (h - time_before) dv. To correct this, the function removes the impulses of impacts from
/// `impulses`, those of the velocity solution. It adds two terms to the free velocity of the position solve:
///
/// * (1 + (time_before - t) / h) dv for each impact: dv, and the missing displacement (time_before - t) dv divided by h.
/// * (time_before / h - 1/2) times the velocity change by smooth forces, because the step was not evaluated in its middle.
#[inline(always)]
pub(crate) fn prepare_position_solve<R: Real>(
    context: StepContext<'_, R>,
    free: &FreeMotion<R>,
    problem: &ConstraintProblem<R>,
    impulses: &mut Iterate<R>,
    position: &mut PositionSolution<R>,
) -> R::Mask {
    let StepContext {
        input: StepInput { compiled, options, state, alive, .. },
        evaluation: Evaluation { scheme, contacts, impact_lanes, .. },
    } = context;
    let lanes = impact_lanes.or(problem.midpoint_impact_lanes()).and(alive);
    if problem.needs_position_solve.or(lanes).none() {
        return lanes;
    }
    position.copy_rows(problem);
    position.v_free.copy_from_slice(&free.v);
    if lanes.none() {
        return lanes;
    }
    let step = ImpactStep {
        problem,
        mass: &free.smooth.mass,
        contacts,
        free: &free.v,
        slop: options.slop,
        h: scheme.h,
        time_before: scheme.time_before,
        time_after: scheme.time_after,
        lanes,
    };
    position.remove_impacts(compiled, impulses, &step);
    kernel!(R, || {
        let late = scheme.time_before / scheme.h - R::of(0.5);
        for i in 0..compiled.nv {
            let moved = position.impact_displacement[i] + (free.v[i] - state.v[i]) * late;
            position.impact_displacement[i] = R::select(lanes, moved, R::zero());
            position.v_free[i] = R::select(lanes, free.v[i] + moved, free.v[i]);
        }
    });
    position.shift(compiled, &free.smooth.mass, problem, lanes);
    step.leave_out_impacts(compiled, &mut position.rows);
    lanes
}

impl<R: Real> VelocityLoop<'_, R> {
    /// Makes those impacts inelastic for which Newton's law of restitution has no plausible solution. For example, friction would add more
    /// energy than the free motion has. Returns the lanes with such an impact, which must be solved again.
    ///
    /// See [`ConstraintProblem::drop_restitution`]. `residual` is the residual of the last solve. In the lanes `inelastic`, an earlier call
    /// already made some impacts inelastic. There all impacts become inelastic if one is still implausible or the residual exceeds the
    /// tolerance. The contact impulses of the returned lanes become zero, because enormous impulses are a bad start for the next solve.
    #[inline(always)]
    pub(crate) fn drop_restitution(&mut self, residual: R, inelastic: R::Mask) -> R::Mask {
        if self.problem.impacts.is_empty() {
            return R::Mask::splat(false);
        }
        let StepInput { compiled, options, .. } = self.context.input;
        let tolerance = R::of(options.tolerance);
        let failed = R::select(inelastic, tolerance, tolerance * R::of(MAX_IMPACT_RESIDUAL));
        let unsolved = self.ambiguous(residual).or(residual.gt(failed));
        let Self { free, problem, velocity: VelocitySolution { impulses, .. }, .. } = self;
        let FreeMotion { v, smooth, scratch: Scratch { free_change: scratch, .. }, .. } = &mut **free;
        let energy = smooth.mass.kinetic_energy(compiled, v, scratch);
        let lanes = problem.drop_restitution(impulses, [energy, R::of(MAX_TRUSTED_RESIDUAL)], [unsolved, inelastic]);
        if lanes.any() {
            impulses.clear_contacts(&problem.rows, lanes, scratch);
        }
        lanes
    }

    /// Recomputes the free velocity in lanes in which contacts made the velocity jump, by elastic or inelastic impacts. Returns these
    /// lanes, which must be solved again.
    ///
    /// The midpoint rule moves bodies for half of the step at the velocity before the step, and for half at the velocity after it. Inertial
    /// forces should therefore be the mean of the inertial forces at the two velocities. The first solution evaluates them at the mean
    /// velocity instead. If the velocity jumps, this is an error of first order in momentum and energy. The function checks the lanes
    /// `checked`. For those in `first`, it is the first check in this step.
    #[inline(always)]
    pub(crate) fn correct_impact_forces(&mut self, checked: R::Mask, first: R::Mask) -> R::Mask {
        let lanes = if checked.any() { self.lanes_with_impacts(first).and(checked) } else { checked };
        if lanes.any() {
            self.compute_inertial_forces();
            self.update_free_velocity(lanes, first);
        }
        lanes
    }

    /// Lanes with an impact whose inertial forces must be recomputed, because they were computed with another velocity than the solved one.
    ///
    /// In the lanes `first`, the inertial forces were evaluated at the mean of the velocities before and after the step. They should be the
    /// mean of the forces at these two velocities. If the two results differ enough, such a lane counts too.
    fn lanes_with_impacts(&self, first: R::Mask) -> R::Mask {
        let StepContext { input: StepInput { state, alive, .. }, evaluation: Evaluation { scheme, .. } } = self.context;
        let Self { free, problem, velocity, .. } = self;
        kernel!(R, || {
            let (mut jump, mut fastest, mut pushed, mut smooth) = (R::zero(), R::zero(), R::zero(), R::zero());
            for (((&v, &free), &next), &expected) in state.v.iter().zip(&free.v).zip(&velocity.v).zip(&free.v_expected) {
                pushed = pushed.max((next - free).abs());
                smooth = smooth.max((free - v).abs());
                jump = jump.max((next - expected).abs());
                fastest = fastest.max(v.abs()).max(next.abs());
            }
            let apart = R::select(first, pushed * pushed * R::of(0.25), R::zero());
            let change = jump.max(pushed);
            let impact = change.gt(smooth * R::of(MIN_IMPACT_RATIO)).and((scheme.h * change).lt(R::of(MAX_RESOLVED_MOTION)));
            let matters = impact.and((scheme.h * (jump * fastest).max(apart)).gt(R::of(MIN_VELOCITY_ERROR)));
            // Equalities near singular configurations change the velocity just as suddenly, but without an impact.
            let mut touching = R::Mask::splat(false);
            for (_, lanes) in problem.slots() {
                touching = touching.or(lanes);
            }
            touching.and(alive).and_not(free.unresolved).and(matters)
        })
    }

    /// Computes the free velocity with inertial forces at the velocity before the step and at the velocity after it, into
    /// `v_free_corrected`.
    ///
    /// In lanes with an impact, the forces at the first velocity act until the impact, and those at the second velocity after it. In the
    /// other lanes, each acts for half of the step. Only inertial forces are recomputed. The forces of stage 1 do not change.
    fn compute_inertial_forces(&mut self) {
        let StepContext { input: StepInput { compiled, state, .. }, evaluation } = self.context;
        let Evaluation { scheme, kinematics, impact_lanes, .. } = evaluation;
        let Self { free, problem, velocity, .. } = self;
        let times = kernel!(R, || {
            let half = scheme.h * R::of(0.5);
            [R::select(*impact_lanes, scheme.time_before, half), R::select(*impact_lanes, scheme.time_after, half)]
        });
        free.accelerate(compiled, kinematics, &state.v, &state.v);
        advance(&state.v, &free.smooth.acc, times[0], &mut free.scratch.v_half);
        if problem.resolves_impacts {
            advance(&state.v, &free.smooth.acc, scheme.h, &mut free.scratch.v_free_early);
        }
        free.accelerate(compiled, kinematics, &state.v, &velocity.v);
        let FreeMotion { smooth, scratch, .. } = &mut **free;
        advance(&scratch.v_half, &smooth.acc, times[1], &mut scratch.v_free_corrected);
        if !compiled.spinners.is_empty() {
            gyroscopic::correct_spin(
                compiled,
                kinematics,
                &smooth.mass,
                [[scheme.time_before, scheme.time_after], times],
                [&state.v, &velocity.v],
                &mut scratch.v_free_corrected,
            );
        }
    }

    /// Replaces the free velocity in the lanes `lanes` by the recomputed one, and shifts the offsets of the rows by the change.
    ///
    /// The rows of impacts depend on the velocity before the impact. In the lanes `first`, this velocity is recomputed, with inertial
    /// forces at the velocity before the step. In later corrections it stays: `early_extra_change` cancels `free_change`.
    fn update_free_velocity(&mut self, lanes: R::Mask, first: R::Mask) {
        let compiled = self.context.input.compiled;
        let Self { free, problem, velocity, .. } = self;
        let FreeMotion { v, v_expected, smooth, scratch, .. } = &mut **free;
        let Scratch { v_free_corrected, free_change, v_free_early, early_extra_change, .. } = scratch;
        kernel!(R, || {
            for i in 0..compiled.nv {
                let new = R::select(lanes, v_free_corrected[i], v[i]);
                free_change[i] = new - v[i];
                v[i] = new;
                v_expected[i] = R::select(lanes, velocity.v[i], v_expected[i]);
                if problem.resolves_impacts {
                    early_extra_change[i] = R::select(first, v_free_early[i] - new, -free_change[i]);
                }
            }
        });
        let early_extra_change = problem.resolves_impacts.then_some(&mut early_extra_change[..]);
        problem.shift(compiled, &smooth.mass, free_change, early_extra_change, lanes);
    }
}
