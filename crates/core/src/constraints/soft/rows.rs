//! Scalar rows with MuJoCo's contact law: limits of joints and tendons, and dry friction.

use stepper_real::{Mask, Real};

use crate::compile::{Combination, SoftLaw};
use crate::constraints::joint::dry_friction::friction_bounds;
use crate::constraints::joint::limits::{ball_limit, nearer_end};
use crate::constraints::row_builder::RowBuilder;
use crate::constraints::soft::assembly::{SoftAssembler, SoftInput};
use crate::math::spatial::*;

impl<R: Real> SoftAssembler<'_, R> {
    /// Writes the Jacobian of a combination, times `factor`, to the first component of `column`. Sets `dofs` to the degrees of freedom
    /// with entries, ascending.
    #[inline(always)]
    fn combine(&mut self, combination: &Combination<R::Scalar>, factor: R) {
        let (paths, RowBuilder { dofs, column, .. }) = (&self.input.state.kinematics.paths, &mut *self.builder);
        dofs.clear();
        combination.for_each_arm(
            paths,
            #[inline(always)]
            |dof, _| dofs.push(dof as u32),
        );
        dofs.sort_unstable();
        dofs.dedup();
        for &d in &*dofs {
            column[d as usize] = zero();
        }
        combination.for_each_arm(
            paths,
            #[inline(always)]
            |dof, arm| column[dof][0] += arm * factor,
        );
    }

    /// Appends a scalar row to the problem, in the lanes `active`. Its Jacobian is in the first component of `column`, at the degrees of
    /// freedom `dofs` of the builder.
    ///
    /// `law` has the reference acceleration of the row and its weight D = 1 / R, and `bounds` its lowest and highest force.
    #[inline(always)]
    pub(super) fn push_row(&mut self, [reference, weight]: [R; 2], bounds: [R; 2], active: R::Mask, impulse_index: usize) {
        let (RowBuilder { dofs, column, .. }, system) = (&mut *self.builder, &mut *self.system);
        for &d in &*dofs {
            let entry = R::select(active, column[d as usize][0], R::zero());
            column[d as usize][0] = entry;
        }
        system.problem.push_row(
            dofs,
            #[inline(always)]
            |d| column[d][0],
            reference,
            weight,
            bounds,
        );
        system.impulse_indices.push(impulse_index);
        system.constrained = system.constrained.or(active);
    }

    /// Adds the rows of dry friction of joints and tendons.
    #[inline(always)]
    pub(super) fn add_frictions(&mut self) {
        let SoftInput { state, softness, .. } = self.input;
        for (i, (friction, law)) in state.compiled.frictions.iter().zip(&softness.frictions).enumerate() {
            let bounds = friction_bounds(&state, i, R::one());
            let law = law.row(R::zero(), state.v_free[friction.dof], state.alive);
            self.builder.column[friction.dof] = [R::one(), R::zero(), R::zero()];
            self.builder.use_dofs(&[friction.dof as u32]);
            self.push_row(law, bounds, state.alive, state.compiled.limits.len() + i);
        }
        for (tendon, [_, law]) in state.compiled.tendons.iter().zip(&softness.tendons) {
            if tendon.friction > <R::Scalar as Default>::default() {
                let most = R::splat(tendon.friction);
                let law = law.row(R::zero(), tendon.length.rate(state.v_free, &state.kinematics.paths), state.alive);
                self.combine(&tendon.length, R::one());
                self.push_row(law, [-most, most], state.alive, tendon.impulse_index + 1);
            }
        }
    }

    /// Adds the rows of violated limits of joints, ball joints and tendons.
    #[inline(always)]
    pub(super) fn add_limits(&mut self) {
        let SoftInput { state, softness, .. } = self.input;
        for (i, (limit, law)) in state.compiled.limits.iter().zip(&softness.limits).enumerate() {
            let (sign, error) = nearer_end(state.q[limit.q], state.compiled.params.limit(i));
            let distance = state.solved_overlaps.map_or(error, |solved| solved.limits[i]);
            let active = state.alive.and(distance.lt(R::zero()));
            if active.any() {
                self.builder.column[limit.dof] = [sign, R::zero(), R::zero()];
                self.builder.use_dofs(&[limit.dof as u32]);
                self.push_limit(law, [error, sign * state.v_free[limit.dof]], active, i);
            }
        }
        for (i, (limit, law)) in state.compiled.ball_limits.iter().zip(&softness.ball_limits).enumerate() {
            let (axis, error) = ball_limit(state.compiled, i, state.q);
            let active = state.alive.and(error.lt(R::zero()));
            if active.any() {
                let dofs = [0, 1, 2].map(|k| limit.dof + k);
                self.builder.use_dofs(&dofs.map(|d| d as u32));
                for (k, &d) in dofs.iter().enumerate() {
                    self.builder.column[d] = [axis[k], R::zero(), R::zero()];
                }
                self.push_limit(law, [error, dot(axis, dofs.map(|d| state.v_free[d]))], active, limit.impulse_index);
            }
        }
        for (tendon, [law, _]) in state.compiled.tendons.iter().zip(&softness.tendons) {
            let (Some([lowest, highest]), paths) = (tendon.range, &state.kinematics.paths) else { continue };
            let (sign, error) = nearer_end(tendon.length.value(state.q, paths), [R::splat(lowest), R::splat(highest)]);
            let active = state.alive.and(error.lt(R::zero()));
            if active.any() {
                self.combine(&tendon.length, sign);
                self.push_limit(law, [error, sign * tendon.length.rate(state.v_free, paths)], active, tendon.impulse_index);
            }
        }
    }

    /// Adds the row of a limit, whose force only pushes. `error` is the limit's position error, and `rate` the time derivative of this
    /// error.
    #[inline(always)]
    fn push_limit(&mut self, law: &SoftLaw<R::Scalar>, [error, rate]: [R; 2], active: R::Mask, impulse_index: usize) {
        self.push_row(law.row(error, rate, active), [R::zero(), R::of(f64::INFINITY)], active, impulse_index);
    }
}
