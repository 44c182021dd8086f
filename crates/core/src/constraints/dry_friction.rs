//! Rows of dry friction (`frictionloss`) in joints.

use stepper_real::Real;

use crate::compile::LaneModel;
use crate::constraints::assembler::{Assembler, AssemblyInput};
use crate::dynamics::inertia::MassMatrix;

impl<R: Real> Assembler<'_, R> {
    /// Adds the rows of dry friction, |lambda| <= h f for a friction force f. Friction losses of actuator dynamics add to f, and depend on
    /// the direction of motion.
    #[inline(always)]
    pub(crate) fn add_frictions(&mut self, compiled: &LaneModel<R>, mass: &MassMatrix<R>, assembly: &AssemblyInput<'_, R>) {
        for (i, friction) in compiled.frictions.iter().enumerate() {
            let most = compiled.params.friction(i) * assembly.h;
            let mut bounds = [-most, most];
            if friction.driven {
                let [forwards, backwards] = assembly.losses[i];
                bounds = [bounds[0] - forwards * assembly.h, bounds[1] + backwards * assembly.h];
            }
            let g = assembly.v_free[friction.dof];
            self.add_scalar(compiled, mass, friction.dof, compiled.limits.len() + i, R::one(), assembly.alive, [g, g], bounds);
        }
    }
}
