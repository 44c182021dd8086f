//! Stage 6: impulses become the next velocity.

use stepper_real::Real;

use crate::inertia::MassMatrix;
use crate::plan::LanePlan;

/// v+ = v_free + L^-1 D^-1/2 w, where w is the scaled velocity change of stage 5. `w` is used up.
pub fn integrate_velocity<R: Real>(plan: &LanePlan<R>, mass: &MassMatrix<R>, v_free: &[R], w: &mut [R], out: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
            mass.unscale(plan, w);
            for i in 0..plan.nv {
                out[i] = v_free[i] + w[i];
            }
        },
    )
}
