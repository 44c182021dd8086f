//! Rows of the limits of hinge and slide joints.

use stepper_real::{Mask, Real};

use crate::compile::LaneModel;
use crate::constraints::assembler::{Assembler, AssemblyInput};
use crate::dynamics::inertia::MassMatrix;
use crate::options::StepSettings;
use crate::tuning::LIMIT_LOOK_AHEAD;

impl<R: Real> Assembler<'_, R> {
    /// Adds the rows of joint limits: one row for the nearer end of each range, if the joint can reach that end within the step.
    #[inline(always)]
    pub(crate) fn add_limits(
        &mut self,
        compiled: &LaneModel<R>,
        options: &StepSettings,
        mass: &MassMatrix<R>,
        assembly: &AssemblyInput<'_, R>,
    ) {
        let bounds = [R::zero(), R::of(f64::INFINITY)];
        for (i, limit) in compiled.limits.iter().enumerate() {
            let q = assembly.q[limit.q];
            let [lowest, highest] = compiled.params.limit(i);
            let (below, above) = (q - lowest, highest - q);
            let low = below.le(above);
            let sign = R::select(low, R::one(), -R::one());
            let phi = R::select(low, below, above);
            let v = assembly.v_free[limit.dof] * sign;
            let closing = (-v).max(R::zero()) * (assembly.h + assembly.h);
            let active = assembly.alive.and(phi.le(closing + R::of(LIMIT_LOOK_AHEAD)));
            if active.none() {
                self.velocity.scalar_impulse[i] = R::zero();
                continue;
            }
            let solved = assembly.solved_overlaps.map(|solved| solved.limit(i));
            let (bias, position) = self.limit_biases(options, phi, solved, assembly.h, active);
            self.add_scalar(compiled, mass, limit.dof, i, sign, active, [v + bias, v + position], bounds);
        }
    }
}
