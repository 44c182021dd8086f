//! Assembly of scalar rows: entries, target velocities and initial impulses.

use stepper_real::{Mask, Real};

use crate::compile::LaneModel;
use crate::constraints::assembler::Assembler;
use crate::constraints::elimination::SquaredLengths;
use crate::dynamics::inertia::MassMatrix;
use crate::math::spatial::*;

impl<R: Real> Assembler<'_, R> {
    /// Adds the initial impulse of a scalar row to the solution, in the lanes `active`. In the other lanes the function clears the stored
    /// impulse.
    #[inline(always)]
    pub(crate) fn warm_start(&mut self, impulse_index: usize, active: R::Mask) {
        let kept = R::select(active, self.velocity.scalar_impulse[impulse_index], R::zero());
        self.velocity.scalar_impulse[impulse_index] = kept;
        self.velocity.impulses.scalars.push(kept);
    }

    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "one row, every part of it named at the call")]
    pub(crate) fn add_scalar(
        &mut self,
        compiled: &LaneModel<R>,
        mass: &MassMatrix<R>,
        dof: usize,
        impulse_index: usize,
        sign: R,
        active: R::Mask,
        mut g: [R; 2],
        bounds: [R; 2],
    ) {
        self.builder.unit_column(compiled, mass, dof);
        self.builder.couple(self.problem, compiled);
        let mut trace_ratio = None;
        if !self.builder.coupled.is_empty() {
            let mut own = [scale(g, sign)];
            trace_ratio = self.builder.eliminate(&self.problem.rows, mass, &mut own).map(SquaredLengths::trace_ratio);
            g = scale(own[0], sign);
        }
        let column = &self.builder.column;
        self.problem.rows.scalars.push(
            &self.builder.dofs,
            #[inline(always)]
            |d| column[d][0] * mass.sqrt_inv_d[d],
            sign,
            active,
            g[0],
            bounds,
        );
        if let Some(ratio) = trace_ratio {
            self.problem.rows.scalars.set_trace_ratio(ratio);
        }
        self.problem.rows.scalars.set_position_offset(g[1]);
        self.warm_start(impulse_index, active);
        self.problem.impulse_indices.push(impulse_index);
        self.problem.constrained = self.problem.constrained.or(active);
    }
}
