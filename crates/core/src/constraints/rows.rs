//! Assembly of scalar rows: entries, target velocities and initial impulses.

use stepper_real::{Mask, Real};

use crate::constraints::assembler::{Assembler, RowInput};
use crate::constraints::equality::elimination::mobility_ratio;
use crate::dynamics::inertia::MassMatrix;
use crate::math::spatial::*;

/// Law of a scalar row: offset, compliance, lanes, and bounds of its impulse.
#[derive(Clone, Copy)]
pub(crate) struct RowLaw<R: Real> {
    /// Offset g of the row in the velocity solve and in the position solve, m/s: its velocity without impulses, plus its bias.
    pub(crate) g: [R; 2],
    /// Compliance of the row, 1/kg; `None` for a rigid row.
    pub(crate) compliance: Option<R>,
    /// Lanes in which the row exists.
    pub(crate) exists: R::Mask,
    /// Lowest and highest impulse, N s.
    pub(crate) bounds: [R; 2],
}

/// Bounds of an impulse or force that is unbounded: minus and plus infinity.
#[inline(always)]
pub(crate) fn unbounded<R: Real>() -> [R; 2] {
    [R::of(f64::NEG_INFINITY), R::of(f64::INFINITY)]
}

impl<R: Real> Assembler<'_, R> {
    /// Adds the row whose velocity is that of the degree of freedom `dof`, times `sign` (1 or -1), to the problem. `impulse_index` is the
    /// place of its impulse in the list of impulses of scalar rows.
    #[inline(always)]
    pub(crate) fn add_dof_row(&mut self, input: &RowInput<'_, R>, dof: usize, impulse_index: usize, sign: R, law: RowLaw<R>) {
        self.builder.unit_column(input.compiled, input.mass, dof);
        self.builder.couple(input);
        self.add_row(input.mass, impulse_index, sign, law);
    }

    /// Adds the row in the first component of `column`, times `sign` (1 or -1), to the problem, after hard equalities are eliminated from
    /// it.
    #[inline(always)]
    pub(crate) fn add_row(&mut self, mass: &MassMatrix<R>, impulse_index: usize, sign: R, mut law: RowLaw<R>) {
        let mut g = [scale(law.g, sign)];
        let lengths = self.builder.eliminate(&self.problem.rows, mass, &mut g);
        let lengths = lengths.map(|[before, after]| [before[0], after[0]]);
        if lengths.is_some() {
            law.g = scale(g[0], sign);
        }
        self.push_row(mass, [0, impulse_index], sign, &law, lengths);
        self.problem.rows.scalars.set_position_offset(law.g[1]);
    }

    /// Appends the row in component `k` of `column`, times `sign`, to the problem as a scalar row, with its initial impulse. In lanes in
    /// which the row does not exist, the stored impulse is cleared.
    ///
    /// `lengths` are the squared lengths of the row before and after the elimination of equalities; `None` without elimination. Their ratio
    /// scales the row's residual.
    #[inline(always)]
    pub(crate) fn push_row(
        &mut self,
        mass: &MassMatrix<R>,
        [k, impulse_index]: [usize; 2],
        sign: R,
        law: &RowLaw<R>,
        lengths: Option<[R; 2]>,
    ) {
        let (column, rows) = (&self.builder.column, &mut self.problem.rows.scalars);
        rows.push(
            &self.builder.dofs,
            #[inline(always)]
            |d| column[d][k] * mass.sqrt_inv_d[d],
            sign,
            law.exists,
            law.g[0],
            law.bounds,
        );
        if let Some(compliance) = law.compliance {
            rows.set_compliance(compliance);
        }
        if let Some([before, after]) = lengths {
            let compliance = law.compliance.unwrap_or(R::zero());
            rows.set_mobility_ratio(mobility_ratio(&[before, compliance], &[after, compliance]));
        }
        let impulse = &mut self.velocity.scalar_impulse[impulse_index];
        *impulse = R::select(law.exists, *impulse, R::zero());
        self.velocity.impulses.scalars.push(*impulse);
        self.problem.impulse_indices.push(impulse_index);
        self.problem.constrained = self.problem.constrained.or(law.exists);
    }
}
