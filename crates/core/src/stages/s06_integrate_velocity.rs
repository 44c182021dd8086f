//! Stage 6: impulses become the next velocity.

use stepper_real::Real;

use crate::inertia::MassMatrix;
use crate::plan::LanePlan;

/// v+ = v_free + L^-1 D^-1/2 w, where w is the scaled velocity change of stage 5.
pub fn integrate_velocity<R: Real>(plan: &LanePlan<R>, mass: &MassMatrix<R>, v_free: &[R], w: &[R], out: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
            out.copy_from_slice(w);
            mass.unscale(plan, out);
            for i in 0..plan.nv {
                out[i] = v_free[i] + out[i];
            }
        },
    )
}
