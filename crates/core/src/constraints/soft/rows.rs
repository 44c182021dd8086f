//! Scalar rows with MuJoCo's contact law: limits of joints and tendons, and dry friction.

use stepper_real::{Mask, Real};

use crate::compile::{Combination, LaneModel, PathLengths, SoftLaw};
use crate::constraints::assembler::Assembler;
use crate::constraints::joint::limits::{ball_limit, nearer_end};
use crate::constraints::row_builder::RowBuilder;
use crate::constraints::soft::effective_mass::{SoftInput, in_metric, law_at};
use crate::constraints::soft::system::SoftSystem;
use crate::math::spatial::*;

impl<R: Real> RowBuilder<R> {
    /// Writes the Jacobian of a sum of combinations, each times a factor, to the first component of `column`. Sets
    /// `system.terms` to the degrees of freedom with entries, ascending.
    #[inline(always)]
    pub(super) fn combine(&mut self, paths: &PathLengths<R>, system: &mut SoftSystem<R>, parts: &[(&Combination<R::Scalar>, R)]) {
        system.terms.clear();
        for (combination, _) in parts {
            combination.for_each_arm(
                paths,
                #[inline(always)]
                |dof, _| system.terms.push(dof as u32),
            );
        }
        system.terms.sort_unstable();
        system.terms.dedup();
        for &d in &system.terms {
            self.column[d as usize] = zero();
        }
        for (combination, factor) in parts {
            combination.for_each_arm(
                paths,
                #[inline(always)]
                |dof, arm| self.column[dof][0] += arm * *factor,
            );
        }
    }
}

impl<R: Real> Assembler<'_, R> {
    /// Appends a scalar row to the problem, in the lanes `active`. Its Jacobian is in the first component of `column`, at the degrees of
    /// freedom `system.terms`.
    ///
    /// `law` has the reference acceleration of the row and its weight D = 1 / R, and `bounds` its lowest and highest force.
    #[inline(always)]
    pub(super) fn push_soft_row(
        &mut self,
        input: SoftInput<'_, R>,
        system: &mut SoftSystem<R>,
        [reference, mut weight]: [R; 2],
        bounds: [R; 2],
        active: R::Mask,
        impulse_index: usize,
    ) {
        for &d in &system.terms {
            let entry = R::select(active, self.builder.column[d as usize][0], R::zero());
            self.builder.column[d as usize][0] = entry;
        }
        let column = &self.builder.column;
        if let Some(effective) = input.effective {
            let mobility = effective.mobility(
                &system.terms,
                #[inline(always)]
                |d| column[d][0],
            );
            weight = in_metric(weight, mobility);
        }
        system.problem.push_row(
            &system.terms,
            #[inline(always)]
            |d| column[d][0],
            reference,
            weight,
            bounds,
        );
        self.problem.impulse_indices.push(impulse_index);
        self.problem.constrained = self.problem.constrained.or(active);
    }

    /// Adds the rows of dry friction of joints and tendons.
    #[inline(always)]
    pub(super) fn add_soft_frictions(&mut self, input: SoftInput<'_, R>, system: &mut SoftSystem<R>) {
        let (compiled, row_input) = (input.row.compiled, input.row);
        for (i, (friction, law)) in compiled.frictions.iter().zip(&input.softness.frictions).enumerate() {
            let most = compiled.params.friction(i);
            let mut bounds = [-most, most];
            if friction.driven {
                let [forwards, backwards] = row_input.losses[i];
                bounds = [bounds[0] - forwards, bounds[1] + backwards];
            }
            let law = row_law(law, input, [R::zero(), row_input.v_free[friction.dof]], row_input.alive);
            self.builder.column[friction.dof] = [R::one(), R::zero(), R::zero()];
            system.terms.clear();
            system.terms.push(friction.dof as u32);
            self.push_soft_row(input, system, law, bounds, row_input.alive, compiled.limits.len() + i);
        }
        for (tendon, [_, law]) in compiled.tendons.iter().zip(&input.softness.tendons) {
            if tendon.friction > <R::Scalar as Default>::default() {
                let most = R::splat(tendon.friction);
                let law =
                    row_law(law, input, [R::zero(), tendon.length.rate(row_input.v_free, &row_input.kinematics.paths)], row_input.alive);
                self.builder.combine(&row_input.kinematics.paths, system, &[(&tendon.length, R::one())]);
                self.push_soft_row(input, system, law, [-most, most], row_input.alive, tendon.impulse_index + 1);
            }
        }
    }

    /// Adds the rows of violated limits of joints, ball joints and tendons.
    #[inline(always)]
    pub(super) fn add_soft_limits(&mut self, input: SoftInput<'_, R>, system: &mut SoftSystem<R>) {
        let (compiled, row_input) = (input.row.compiled, input.row);
        for (i, (limit, law)) in compiled.limits.iter().zip(&input.softness.limits).enumerate() {
            let (sign, error) = nearer_end(row_input.q[limit.q], compiled.params.limit(i));
            let distance = input.row.solved_overlaps.map_or(error, |solved| solved.limits[i]);
            let active = row_input.alive.and(distance.lt(R::zero()));
            if active.any() {
                self.builder.column[limit.dof] = [sign, R::zero(), R::zero()];
                system.terms.clear();
                system.terms.push(limit.dof as u32);
                self.push_soft_limit(input, system, law, [error, sign * row_input.v_free[limit.dof]], active, i);
            }
        }
        self.add_soft_ball_limits(compiled, input, system);
        for (tendon, [law, _]) in compiled.tendons.iter().zip(&input.softness.tendons) {
            let Some([lowest, highest]) = tendon.range else { continue };
            let (sign, error) =
                nearer_end(tendon.length.value(row_input.q, &row_input.kinematics.paths), [R::splat(lowest), R::splat(highest)]);
            let active = row_input.alive.and(error.lt(R::zero()));
            if active.any() {
                self.builder.combine(&row_input.kinematics.paths, system, &[(&tendon.length, sign)]);
                let rate = sign * tendon.length.rate(row_input.v_free, &row_input.kinematics.paths);
                self.push_soft_limit(input, system, law, [error, rate], active, tendon.impulse_index);
            }
        }
    }

    #[inline(always)]
    fn add_soft_ball_limits(&mut self, compiled: &LaneModel<R>, input: SoftInput<'_, R>, system: &mut SoftSystem<R>) {
        let row_input = input.row;
        for (i, (limit, law)) in compiled.ball_limits.iter().zip(&input.softness.ball_limits).enumerate() {
            let (axis, error) = ball_limit(compiled, i, row_input.q);
            let active = row_input.alive.and(error.lt(R::zero()));
            if active.any() {
                let v = [0, 1, 2].map(|k| row_input.v_free[limit.dof + k]);
                system.terms.clear();
                for k in 0..3 {
                    system.terms.push((limit.dof + k) as u32);
                    self.builder.column[limit.dof + k] = [axis[k], R::zero(), R::zero()];
                }
                self.push_soft_limit(input, system, law, [error, dot(axis, v)], active, limit.impulse_index);
            }
        }
    }

    /// Adds the row of a limit, whose force only pushes. `error` is the limit's position error, and `rate` the time derivative of this
    /// error.
    #[inline(always)]
    fn push_soft_limit(
        &mut self,
        input: SoftInput<'_, R>,
        system: &mut SoftSystem<R>,
        law: &SoftLaw<R::Scalar>,
        [error, rate]: [R; 2],
        active: R::Mask,
        impulse_index: usize,
    ) {
        let bounds = [R::zero(), R::of(f64::INFINITY)];
        let law = row_law(law, input, [error, rate], active);
        self.push_soft_row(input, system, law, bounds, active, impulse_index);
    }
}

/// Reference acceleration and weight D of a scalar row, for its position error and the error's time derivative.
#[inline(always)]
pub(super) fn row_law<R: Real>(law: &SoftLaw<R::Scalar>, input: SoftInput<'_, R>, [error, rate]: [R; 2], active: R::Mask) -> [R; 2] {
    law_at(law, input.effective, law.impedance(error), [error, rate, R::zero()], active)
}
