//! Rows of fixed tendons (limits, dry friction, springs with dampers and inertia) and limits of ball joints.

use stepper_real::{Mask, Real};

use crate::compile::CompiledTendon;
use crate::constraints::assembler::Assembler;
use crate::constraints::constraint_problem::ConstraintProblem;
use crate::constraints::equality::{RowLaw, SpringRow, limit_law, spring_law};
use crate::constraints::row_builder::RowBuilder;
use crate::constraints::row_input::RowInput;
use crate::dynamics::kinematics::quat_at;
use crate::math::spatial::*;
use crate::tuning::LIMIT_LOOK_AHEAD;

impl<R: Real> RowBuilder<R> {
    /// Computes the half-solved row of a tendon's length, times `sign`, into the first component of `column`.
    #[inline(always)]
    fn tendon_columns(&mut self, problem: &ConstraintProblem<R>, input: RowInput<'_, R>, tendon: &CompiledTendon<R::Scalar>, sign: R) {
        self.dofs.clear();
        self.dofs.extend_from_slice(&tendon.dofs);
        self.couple(problem, input.compiled);
        for &d in &self.dofs {
            self.column[d as usize] = zero();
        }
        self.add_terms(input, &tendon.length, sign);
        self.half_solve::<1>(input.compiled, input.mass);
    }
}

impl<R: Real> Assembler<'_, R> {
    /// Adds the rows of all tendons: limits, dry friction, and springs.
    pub(crate) fn add_tendons(&mut self, input: RowInput<'_, R>) {
        R::vectorize(
            #[inline(always)]
            || {
                let assembly = input.assembly;
                for tendon in &input.compiled.tendons {
                    let (length, free) = (tendon.length.value(assembly.q), tendon.length.rate(assembly.v_free));
                    if let Some((spring, rest)) = &tendon.spring {
                        let stretch = length - length.max(R::splat(rest[0])).min(R::splat(rest[1]));
                        // Between its two rest lengths the spring is slack, but damper and inertia act.
                        let taut = stretch.abs().gt(R::zero()).or(R::splat(rest[0]).ge(R::splat(rest[1])));
                        let before = tendon.length.rate(assembly.v);
                        self.builder.tendon_columns(self.problem, input, tendon, R::one());
                        let gram = self.builder.gram(input.mass, 0);
                        let row = SpringRow { error: stretch, before, free, gram, taut };
                        let law = spring_law(assembly, spring, row);
                        self.add_row(input.mass, tendon.impulse_index + 2, law);
                    }
                    if tendon.friction > <R::Scalar as Default>::default() {
                        let most = R::splat(tendon.friction) * assembly.h;
                        let law = RowLaw { g: [free; 2], compliance: R::zero(), active: assembly.alive, bounds: [-most, most] };
                        self.builder.tendon_columns(self.problem, input, tendon, R::one());
                        self.add_row(input.mass, tendon.impulse_index + 1, law);
                    }
                    if let Some([low, high]) = tendon.range {
                        self.limit_tendon(input, tendon, [length - R::splat(low), R::splat(high) - length], free);
                    }
                }
            },
        )
    }

    /// Adds the row of a tendon's limit at the nearer end of its range, if the tendon can reach it within the step.
    #[inline(always)]
    fn limit_tendon(&mut self, input: RowInput<'_, R>, tendon: &CompiledTendon<R::Scalar>, [below, above]: [R; 2], rate: R) {
        let low = below.le(above);
        let sign = R::select(low, R::one(), -R::one());
        let phi = R::select(low, below, above);
        let free = rate * sign;
        let Some((active, velocity, position)) = self.reach(input, phi, free) else {
            self.velocity.scalar_impulse[tendon.impulse_index] = R::zero();
            return;
        };
        self.builder.tendon_columns(self.problem, input, tendon, sign);
        self.add_row(input.mass, tendon.impulse_index, limit_law(free, [velocity, position], active));
    }

    /// Lanes in which a limit can be reached within the step; `None` if there are none. `phi` is the distance to the limit, m or rad, and
    /// `free` its time derivative without constraints.
    ///
    /// The other results are the limit's biases in the velocity solve and in the position solve.
    #[inline(always)]
    fn reach(&mut self, input: RowInput<'_, R>, phi: R, free: R) -> Option<(R::Mask, R, R)> {
        let h = input.assembly.h;
        let closing = (-free).max(R::zero()) * (h + h);
        let active = input.assembly.alive.and(phi.le(closing + R::of(LIMIT_LOOK_AHEAD)));
        if active.none() {
            return None;
        }
        let (velocity, position) = self.limit_biases(input.options, phi, None, h, active);
        Some((active, velocity, position))
    }

    /// Adds the rows of ball joint limits: the length of the rotation vector must stay below the range (MuJoCo's `mj_instantiateLimit`).
    pub(crate) fn add_ball_limits(&mut self, input: RowInput<'_, R>) {
        R::vectorize(
            #[inline(always)]
            || {
                for (i, limit) in input.compiled.ball_limits.iter().enumerate() {
                    let turn = quat_log(quat_at(input.assembly.q, limit.q));
                    let angle = norm(turn);
                    // At the reference orientation the limit has no direction.
                    let turned = angle.gt(R::zero());
                    let axis = scale(turn, -(R::one() / R::select(turned, angle, R::one())));
                    let phi = input.compiled.params.ball_limit(i) - angle;
                    let v = input.assembly.v_free;
                    let free = dot(axis, [v[limit.dof], v[limit.dof + 1], v[limit.dof + 2]]);
                    let Some((active, velocity, position)) = self.reach(input, phi, free) else {
                        self.velocity.scalar_impulse[limit.impulse_index] = R::zero();
                        continue;
                    };
                    self.builder.dofs.clear();
                    self.builder.dofs.extend(input.compiled.chain_of(limit.dof + 2).iter().rev());
                    self.builder.couple(self.problem, input.compiled);
                    for &d in &self.builder.dofs {
                        self.builder.column[d as usize] = zero();
                    }
                    for k in 0..3 {
                        self.builder.column[limit.dof + k][0] = axis[k];
                    }
                    self.builder.half_solve::<1>(input.compiled, input.mass);
                    self.add_row(input.mass, limit.impulse_index, limit_law(free, [velocity, position], active));
                }
            },
        )
    }
}
