//! Impacts: jumps of the velocity within the step.
//!
//! The step evaluates a bouncing contact at the time of its impact. The contact's normal, its lever arms and the velocity in Newton's law
//! are evaluated at this time too (see [`crate::constraints::impact_time`]).

use stepper_real::{Mask, Real, kernel};
use stepper_solve::Iterate;

use crate::collision::contact_set::Contacts;
use crate::collision::surface_velocity;
use crate::compile::LaneModel;
use crate::constraints::evaluation_times::merge_connected;
use crate::constraints::impact_time::{Flight, ImpactPrediction};
use crate::constraints::restitution::ImpactStep;
use crate::constraints::{ConstraintProblem, PositionSolution, VelocitySolution};
use crate::dynamics::gyroscopic;
use crate::dynamics::kinematics::{Kinematics, advance};
use crate::integrators::evaluation::Evaluation;
use crate::integrators::free_motion::{FreeMotion, Scratch};
use crate::integrators::mechanism_motion::Jump;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::integrators::velocity_loop::VelocityLoop;
use crate::math::spatial::*;
use crate::tuning::{
    MAX_IMPACT_RESIDUAL, MAX_RESOLVED_MOTION, MAX_TRUSTED_RESIDUAL, MIN_IMPACT_RATIO, MIN_VELOCITY_ERROR, PLACEMENT_TOLERANCE,
};

/// Moves the evaluation point of each mechanism with an impact to the time of its first impact. Returns whether any point moved, so that
/// the step must be evaluated again.
///
/// An evaluation point within `PLACEMENT_TOLERANCE` of the impact does not move. `v_free` is the velocity after the step without
/// constraints. `first` is true in the first call of a step. A contact that overlaps beyond the slop (the overlap that position correction
/// leaves) while its surfaces separate must have touched earlier. In the first call, its mechanisms move to the beginning of the step.
pub(crate) fn move_to_first_impacts<R: Real>(input: StepInput<'_, R>, evaluation: &mut Evaluation<R>, v_free: &[R], first: bool) -> bool {
    let StepInput { compiled, options, state, alive, .. } = input;
    let Evaluation { scheme, times, kinematics, contacts, link_velocities, .. } = evaluation;
    kernel!(R, || {
        let [before, free] = link_velocities;
        kinematics.velocities(compiled, &state.v, before);
        kinematics.velocities(compiled, v_free, free);
        let gravity = norm(compiled.params.gravity());
        times.begin_impact_search();
        for k in 0..contacts.slots() {
            let elastic = contacts.elastic(k).and(alive);
            if elastic.none() {
                continue;
            }
            let slot = &contacts.data[k];
            let (gap, h) = (slot.point.distance, scheme.h);
            let time_before = times.of_slot(compiled, contacts, k, elastic.bits()).before;
            let [before, free] = normal_velocities(compiled, kinematics, contacts, k, elastic.bits(), [before, free]);
            let ImpactPrediction { collides, time, .. } =
                Flight { gap, before, free, time_before, h }.predict(options, gravity, slot.restitution, elastic);
            let passed = elastic.and(gap.lt(-R::of(options.slop))).and(before.gt(R::zero())).and(time_before.gt(R::zero()));
            let passed = if first { passed } else { R::Mask::splat(false) };
            let (lanes, time) = (collides.or(passed), R::select(passed, R::zero(), time));
            for (pair, pair_lanes) in contacts.pairs(k, lanes.bits()) {
                let geoms = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
                times.note_impact(compiled, geoms, R::Mask::from_bits(pair_lanes), time);
            }
        }
        times.move_to_impacts(compiled, contacts, scheme.h * R::of(PLACEMENT_TOLERANCE))
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
/// * (time_before / h - 1/2) times the velocity change by smooth forces, because the mechanism was not evaluated in its middle.
#[inline(always)]
pub(crate) fn prepare_position_solve<R: Real>(
    context: StepContext<'_, R>,
    free: &FreeMotion<R>,
    problem: &ConstraintProblem<R>,
    impulses: &mut Iterate<R>,
    position: &mut PositionSolution<R>,
) -> R::Mask {
    let StepContext { input: StepInput { compiled, options, state, alive, .. }, evaluation: Evaluation { scheme, times, contacts, .. } } =
        context;
    let lanes = times.latest_impact().0.or(problem.midpoint_impact_lanes()).and(alive);
    if problem.needs_position_solve.or(lanes).none() {
        return lanes;
    }
    position.copy_rows(problem);
    position.v_free.copy_from_slice(&free.v);
    if lanes.none() {
        return lanes;
    }
    let step = ImpactStep { problem, mass: &free.smooth.mass, contacts, free: &free.v, slop: options.slop, h: scheme.h, times, lanes };
    position.remove_impacts(compiled, impulses, &step);
    kernel!(R, || {
        for i in 0..compiled.nv {
            let late = times.before(compiled.mechanism_of(i)) / scheme.h - R::of(0.5);
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

    /// Recomputes the free velocity of mechanisms in which contacts made the velocity jump, by elastic or inelastic impacts. Returns the
    /// lanes with such a mechanism, which must be solved again.
    ///
    /// The midpoint rule moves bodies for half of the step at the velocity before the step, and for half at the velocity after it. Inertial
    /// forces should therefore be the mean of the inertial forces at the two velocities. The first solution evaluates them at the mean
    /// velocity instead. If the velocity jumps, this is an error of first order in momentum and energy. The function checks the lanes
    /// `checked`.
    #[inline(always)]
    pub(crate) fn correct_impact_forces(&mut self, checked: R::Mask) -> R::Mask {
        let lanes = if checked.any() { self.find_impacts(checked) } else { checked };
        if lanes.any() {
            self.compute_inertial_forces();
            self.update_free_velocity();
        }
        lanes
    }

    /// Finds the lanes of `checked` in which the inertial forces of each mechanism must be recomputed. They were computed with another
    /// velocity than the solved one, or those of a mechanism in contact were. Returns the lanes with such a mechanism.
    ///
    /// The inertial forces were evaluated at the mean of the velocities before and after the step. They should be the mean of the forces at
    /// these two velocities. If the two results differ enough, such a mechanism counts too. Only velocity changes by impulses are impacts:
    /// the error of a rough prediction is none.
    fn find_impacts(&mut self, checked: R::Mask) -> R::Mask {
        let StepContext { input: StepInput { compiled, state, alive, .. }, evaluation } = self.context;
        let Evaluation { scheme, contacts, .. } = evaluation;
        let Self { free, problem, velocity, .. } = self;
        let FreeMotion { v: v_free, v_expected, unresolved, scratch: Scratch { jumps, impacts, .. }, .. } = &mut **free;
        kernel!(R, || {
            jumps.fill(Jump::default());
            let mut all = Jump::default();
            for part in &compiled.mechanisms.parts {
                let jump = &mut jumps[part.mechanism];
                let (mut pushed, mut smooth) = (jump.pushed, jump.smooth);
                for i in part.dofs.clone() {
                    pushed = pushed.max((velocity.v[i] - v_free[i]).abs());
                    smooth = smooth.max((v_free[i] - state.v[i]).abs());
                }
                (jump.pushed, jump.smooth) = (pushed, smooth);
            }
            let is_sudden = |jump: &Jump<R>| jump.pushed.gt(jump.smooth * R::of(MIN_IMPACT_RATIO));
            // Mechanisms in contact are compared by the largest of their changes below: one of them must have a sudden change.
            let sudden = jumps.iter().fold(R::Mask::splat(false), |lanes, jump| lanes.or(is_sudden(jump)));
            let checked = checked.and(alive).and(sudden);
            if checked.none() {
                return checked;
            }
            for part in &compiled.mechanisms.parts {
                let jump = &mut jumps[part.mechanism];
                for i in part.dofs.clone() {
                    jump.error = jump.error.max((velocity.v[i] - v_expected[i]).abs());
                    jump.fastest = jump.fastest.max(state.v[i].abs()).max(velocity.v[i].abs());
                }
                all = all.max(jump);
            }
            let matters = |jump: &Jump<R>| (scheme.h * jump.velocity_error()).gt(R::of(MIN_VELOCITY_ERROR));
            let checked = checked.and(matters(&all));
            if checked.none() {
                return checked;
            }
            for (k, lanes) in problem.slots() {
                for (pair, lanes) in contacts.pairs(k, lanes.bits()) {
                    let geoms = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
                    for m in geoms.into_iter().filter_map(|geom| compiled.mechanism_of_geom(geom)) {
                        jumps[m].touches = R::select(R::Mask::from_bits(lanes), R::one(), jumps[m].touches);
                    }
                }
            }
            merge_connected(compiled, contacts, |[a, b], lanes| {
                let both = jumps[a].max(&jumps[b]);
                jumps[a].raise(&both, lanes).or(jumps[b].raise(&both, lanes))
            });
            let mut any = R::Mask::splat(false);
            for ((impact, jump), &unresolved) in impacts.iter_mut().zip(&*jumps).zip(&*unresolved) {
                let is_impact = is_sudden(jump).and((scheme.h * jump.pushed).lt(R::of(MAX_RESOLVED_MOTION)));
                // Equalities near singular configurations change the velocity just as suddenly, but without an impact.
                let touches = jump.touches.gt(R::zero());
                *impact = checked.and_not(unresolved).and(is_impact).and(matters(jump)).and(touches);
                any = any.or(*impact);
            }
            any
        })
    }

    /// Computes the free velocity with inertial forces at the velocity before the step and at the velocity after it, into
    /// `v_free_corrected`.
    ///
    /// In mechanisms with an elastic impact, the forces at the first velocity act until the impact, and those at the second velocity after
    /// it. In the others, each acts for half of the step. Only inertial forces are recomputed. The forces of stage 1 do not change.
    fn compute_inertial_forces(&mut self) {
        let StepContext { input: StepInput { compiled, state, .. }, evaluation } = self.context;
        let Evaluation { scheme, times, kinematics, .. } = evaluation;
        let Self { free, problem, velocity, .. } = self;
        // Times from the beginning of the step to the impact, and from there to the end.
        let times_of = |dof: usize| {
            let mechanism = compiled.mechanism_of(dof);
            let (lanes, [before, after], half) = (times.impact_lanes_of(mechanism), times.around(mechanism), scheme.h * R::of(0.5));
            [R::select(lanes, before, half), R::select(lanes, after, half)]
        };
        free.accelerate(compiled, kinematics, &state.v, &state.v);
        let FreeMotion { smooth, scratch, .. } = &mut **free;
        kernel!(R, || {
            for dof in 0..compiled.nv {
                scratch.v_half[dof] = state.v[dof] + smooth.acc[dof] * times_of(dof)[0];
            }
        });
        if problem.resolves_impacts {
            advance(&state.v, &smooth.acc, scheme.h, &mut scratch.v_free_early);
        }
        free.accelerate(compiled, kinematics, &state.v, &velocity.v);
        let FreeMotion { smooth, scratch, .. } = &mut **free;
        kernel!(R, || {
            for dof in 0..compiled.nv {
                scratch.v_free_corrected[dof] = scratch.v_half[dof] + smooth.acc[dof] * times_of(dof)[1];
            }
        });
        if !compiled.single_bodies.is_empty() {
            gyroscopic::correct_spin(
                compiled,
                kinematics,
                &smooth.mass,
                |dof| [times.around(compiled.mechanism_of(dof)), times_of(dof)],
                [&state.v, &velocity.v],
                &mut scratch.v_free_corrected,
            );
        }
    }

    /// Replaces the free velocity of mechanisms with an impact by the recomputed one, and shifts the offsets of the rows by the change.
    ///
    /// The rows of impacts depend on the velocity before the impact. It is recomputed with inertial forces at the velocity before the step.
    fn update_free_velocity(&mut self) {
        let compiled = self.context.input.compiled;
        let Self { free, problem, velocity, .. } = self;
        let FreeMotion { v, v_expected, smooth, scratch, .. } = &mut **free;
        let Scratch { v_free_corrected, free_change, v_free_early, early_extra_change, impacts, .. } = scratch;
        kernel!(R, || {
            for i in 0..compiled.nv {
                let lanes = impacts[compiled.mechanism_of(i)];
                let new = R::select(lanes, v_free_corrected[i], v[i]);
                free_change[i] = new - v[i];
                v[i] = new;
                v_expected[i] = R::select(lanes, velocity.v[i], v_expected[i]);
                if problem.resolves_impacts {
                    early_extra_change[i] = R::select(lanes, v_free_early[i] - new, R::zero());
                }
            }
        });
        let early_extra_change = problem.resolves_impacts.then_some(&mut early_extra_change[..]);
        problem.shift(compiled, &smooth.mass, free_change, early_extra_change, R::Mask::splat(true));
    }
}
