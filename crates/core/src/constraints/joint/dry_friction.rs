//! Rows of dry friction (`frictionloss`) in joints.

use stepper_real::Real;

use crate::constraints::assembler::{Assembler, RowInput, RowState};
use crate::constraints::rows::RowLaw;

impl<R: Real> Assembler<'_, R> {
    /// Adds the rows of dry friction, |lambda| <= h f for a friction force f. Friction losses of actuator dynamics add to f, and depend on
    /// the direction of motion.
    #[inline(always)]
    pub(crate) fn add_frictions(&mut self, input: &RowInput<'_, R>) {
        let RowInput { state: RowState { compiled, alive, .. }, h, .. } = *input;
        for (i, friction) in compiled.frictions.iter().enumerate() {
            let most = compiled.params.friction(i) * h;
            let mut bounds = [-most, most];
            if friction.driven {
                let [forwards, backwards] = input.losses[i];
                bounds = [bounds[0] - forwards * h, bounds[1] + backwards * h];
            }
            let law = RowLaw { g: [input.v_free[friction.dof]; 2], compliance: None, exists: alive, bounds };
            self.add_dof_row(input, friction.dof, compiled.limits.len() + i, R::one(), law);
        }
    }
}
