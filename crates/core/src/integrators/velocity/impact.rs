//! Impacts in the velocity loop. Those for which Newton's law of restitution has no solution become inelastic. Flights in which an
//! inelastic impact makes the velocity jump get other inertial forces.

use stepper_real::{Mask, Real, kernel};

use crate::constraints::evaluation_times::merge_connected;
use crate::constraints::{ContactSlot, VelocitySolution};
use crate::dynamics::gyroscopic;
use crate::dynamics::kinematics::advance;
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::evaluate::free_motion::{FreeMotion, Scratch};
use crate::integrators::evaluate::mechanism_motion::Jump;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::integrators::velocity::velocity_loop::VelocityLoop;
use crate::tuning::{MAX_IMPACT_RESIDUAL, MAX_RESOLVED_MOTION, MAX_TRUSTED_RESIDUAL};

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
            impulses.clear_contacts(&problem.rows, lanes);
        }
        lanes
    }

    /// Recomputes the free velocity of mechanisms in which inelastic contacts made the velocity jump within a flight. Returns the lanes
    /// with such a mechanism, which must be solved again.
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
            // Mechanisms in contact are compared by the largest of their changes below: one of them must have a sudden change.
            let mut sudden = R::Mask::splat(false);
            for jump in &*jumps {
                sudden = sudden.or(jump.is_sudden());
            }
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
            let checked = checked.and(all.matters(scheme.h));
            if checked.none() {
                return checked;
            }
            for &ContactSlot { slot: k, lanes } in &problem.contact_slots {
                for (pair, lanes) in contacts.pairs(k, lanes.and(checked).bits()) {
                    let geoms = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
                    for m in compiled.mechanisms_of(geoms) {
                        jumps[m].touches = R::select(R::Mask::from_bits(lanes), R::one(), jumps[m].touches);
                    }
                }
            }
            merge_connected(
                compiled,
                contacts,
                |k| contacts.lanes_of(k) & checked.bits(),
                #[inline(always)]
                |[a, b], lanes| {
                    let both = jumps[a].max(&jumps[b]);
                    jumps[a].raise(&both, lanes).or(jumps[b].raise(&both, lanes))
                },
            );
            let mut any = R::Mask::splat(false);
            for ((impact, jump), &unresolved) in impacts.iter_mut().zip(&*jumps).zip(&*unresolved) {
                let is_impact = jump.is_sudden().and((scheme.h * jump.pushed).lt(R::of(MAX_RESOLVED_MOTION)));
                // Equalities near singular configurations change the velocity just as suddenly, but without an impact.
                let touches = jump.touches.gt(R::zero());
                *impact = checked.and_not(unresolved).and(is_impact).and(jump.matters(scheme.h)).and(touches);
                any = any.or(*impact);
            }
            any
        })
    }

    /// Computes the free velocity into `v_free_corrected`. Inertial forces at the velocity before the step act for half of it, and those at
    /// the velocity after it for the other half. The forces of stage 1 do not change.
    fn compute_inertial_forces(&mut self) {
        let StepContext { input: StepInput { compiled, state, .. }, evaluation } = self.context;
        let Evaluation { scheme, times, kinematics, .. } = evaluation;
        let Self { free, velocity, .. } = self;
        let half = scheme.h * R::of(0.5);
        free.accelerate(compiled, kinematics, &state.v, &state.v);
        advance(&state.v, &free.smooth.acc, half, &mut free.scratch.v_half);
        free.accelerate(compiled, kinematics, &state.v, &velocity.v);
        let FreeMotion { smooth, scratch, .. } = &mut **free;
        advance(&scratch.v_half, &smooth.acc, half, &mut scratch.v_free_corrected);
        if !compiled.single_bodies.is_empty() {
            gyroscopic::correct_spin(
                compiled,
                kinematics,
                &smooth.mass,
                |dof| [times.around(compiled.mechanism_of(dof)), [half; 2]],
                [&state.v, &velocity.v],
                &mut scratch.v_free_corrected,
            );
        }
    }

    /// Replaces the free velocity of mechanisms with an impact by the recomputed one, and shifts the offsets of the rows by the change.
    fn update_free_velocity(&mut self) {
        let compiled = self.context.input.compiled;
        let Self { free, problem, velocity, .. } = self;
        let FreeMotion { v, v_expected, smooth, scratch, .. } = &mut **free;
        let Scratch { v_free_corrected, free_change, impacts, .. } = scratch;
        kernel!(R, || {
            for i in 0..compiled.nv {
                let lanes = impacts[compiled.mechanism_of(i)];
                let new = R::select(lanes, v_free_corrected[i], v[i]);
                free_change[i] = new - v[i];
                v[i] = new;
                v_expected[i] = R::select(lanes, velocity.v[i], v_expected[i]);
            }
        });
        problem.shift(compiled, &smooth.mass, free_change);
    }
}
