//! Rows of dry friction in joints.

use stepper_real::Real;

use crate::compile::LaneModel;
use crate::constraints::constraint_set::{AssemblyInput, Constraints};
use crate::dynamics::inertia::MassMatrix;

impl<R: Real> Constraints<R> {
    /// Dry friction: |lambda| <= h f, and what drive trains lose, which depends on the direction.
    #[inline(always)]
    pub(crate) fn add_frictions(&mut self, compiled: &LaneModel<R>, mass: &MassMatrix<R>, moment: &AssemblyInput<'_, R>) {
        for (i, friction) in compiled.frictions.iter().enumerate() {
            let most = compiled.params.friction(i) * moment.h;
            let mut bounds = [-most, most];
            if friction.driven {
                let [forwards, backwards] = moment.losses[i];
                bounds = [bounds[0] - forwards * moment.h, bounds[1] + backwards * moment.h];
            }
            let g = moment.v_free[friction.dof];
            self.add_scalar(compiled, mass, friction.dof, compiled.limits.len() + i, R::one(), moment.alive, [g, g], bounds);
        }
    }
}
