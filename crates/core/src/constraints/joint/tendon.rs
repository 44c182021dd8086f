//! Rows of tendons: limits, dry friction, and springs with dampers and inertia.

use stepper_real::{Mask, Real, kernel};

use crate::compile::CompiledTendon;
use crate::constraints::assembler::{Assembler, RowInput};
use crate::constraints::equality::{SpringRow, spring_law};
use crate::constraints::joint::limits::nearer_end;
use crate::constraints::rows::RowLaw;
use crate::math::spatial::*;

impl<R: Real> Assembler<'_, R> {
    /// Computes the half-solved row of a tendon's length, times `sign`, into the first component of `column`.
    #[inline(always)]
    fn tendon_columns(&mut self, input: &RowInput<'_, R>, tendon: &CompiledTendon<R::Scalar>, sign: R) {
        let builder = &mut *self.builder;
        builder.use_dofs(&tendon.dofs);
        builder.couple(input);
        for &d in &builder.dofs {
            builder.column[d as usize] = zero();
        }
        builder.add_terms(input, &tendon.length, sign);
        builder.half_solve::<1>(input.compiled, input.mass);
    }

    /// Adds the rows of all tendons: limits, dry friction, and springs.
    pub(crate) fn add_tendons(&mut self, input: &RowInput<'_, R>) {
        kernel!(R, || {
            let paths = &input.kinematics.paths;
            for tendon in &input.compiled.tendons {
                let (length, free) = (tendon.length.value(input.q, paths), tendon.length.rate(input.v_free, paths));
                if let Some((spring, rest)) = &tendon.spring {
                    let stretch = length - length.max(R::splat(rest[0])).min(R::splat(rest[1]));
                    // Between its two rest lengths the spring is slack, but damper and inertia act.
                    let taut = stretch.abs().gt(R::zero()).or(R::splat(rest[0]).ge(R::splat(rest[1])));
                    let before = tendon.length.rate(input.v, paths);
                    self.tendon_columns(input, tendon, R::one());
                    let gram = self.builder.gram(input.mass, 0);
                    let law = spring_law(input, spring, SpringRow { error: stretch, before, free, gram, acts: taut });
                    self.add_row(input.mass, tendon.impulse_index + 2, R::one(), law);
                }
                if tendon.friction > <R::Scalar as Default>::default() {
                    let most = R::splat(tendon.friction) * input.h;
                    self.tendon_columns(input, tendon, R::one());
                    let law = RowLaw { g: [free; 2], compliance: None, exists: input.alive, bounds: [-most, most] };
                    self.add_row(input.mass, tendon.impulse_index + 1, R::one(), law);
                }
                if let Some([low, high]) = tendon.range {
                    let (sign, phi) = nearer_end(length, [R::splat(low), R::splat(high)]);
                    if let Some(law) = self.limit_law(input, tendon.impulse_index, phi, free * sign, None) {
                        self.tendon_columns(input, tendon, sign);
                        self.add_row(input.mass, tendon.impulse_index, R::one(), law);
                    }
                }
            }
        })
    }
}
