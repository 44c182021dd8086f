//! Rows of dry friction in joints.

use stepper_real::Real;

use crate::compile::LanePlan;
use crate::constraints::constraint_set::{Constraints, Moment};
use crate::dynamics::inertia::MassMatrix;

impl<R: Real> Constraints<R> {
    /// Dry friction: |lambda| <= h f, and what drive trains lose, which depends on the direction.
    #[inline(always)]
    pub(crate) fn add_frictions(&mut self, plan: &LanePlan<R>, mass: &MassMatrix<R>, moment: &Moment<'_, R>) {
        for (i, friction) in plan.frictions.iter().enumerate() {
            let most = plan.params.friction(i) * moment.h;
            let mut bounds = [-most, most];
            if friction.driven {
                let [forwards, backwards] = moment.losses[i];
                bounds = [bounds[0] - forwards * moment.h, bounds[1] + backwards * moment.h];
            }
            let g = moment.v_free[friction.dof];
            self.add_scalar(plan, mass, friction.dof, plan.limits.len() + i, R::one(), moment.alive, [g, g], bounds);
        }
    }
}
