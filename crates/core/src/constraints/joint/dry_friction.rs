//! Rows of dry friction (`frictionloss`) in joints.

use stepper_real::Real;

use crate::constraints::assembler::{Assembler, RowInput, RowState};
use crate::constraints::rows::RowLaw;

/// Lowest and highest impulse of dry friction number `i` in `h` seconds, N s or N m s. Friction losses of actuator dynamics add to the
/// friction force, and depend on the direction of motion.
#[inline(always)]
pub(crate) fn friction_bounds<R: Real>(state: &RowState<'_, R>, i: usize, h: R) -> [R; 2] {
    let most = state.compiled.params.friction(i) * h;
    if !state.compiled.frictions[i].driven {
        return [-most, most];
    }
    let [forwards, backwards] = state.losses[i];
    [-most - forwards * h, most + backwards * h]
}

impl<R: Real> Assembler<'_, R> {
    /// Adds the rows of dry friction, |lambda| <= h f for a friction force f.
    #[inline(always)]
    pub(crate) fn add_frictions(&mut self, input: &RowInput<'_, R>) {
        let RowInput { state: RowState { compiled, alive, .. }, h, .. } = *input;
        for (i, friction) in compiled.frictions.iter().enumerate() {
            let bounds = friction_bounds(input, i, h);
            let law = RowLaw { g: [input.v_free[friction.dof]; 2], compliance: None, exists: alive, bounds };
            self.add_dof_row(input, friction.dof, compiled.limits.len() + i, R::one(), law);
        }
    }
}
