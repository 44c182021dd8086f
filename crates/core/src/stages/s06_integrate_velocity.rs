//! Stage 6: impulses become the next velocity.

use stepper_real::Real;

use crate::compile::LaneModel;
use crate::constraints::Constraints;
use crate::dynamics::inertia::MassMatrix;

/// v+ = v_free + L^-1 D^-1/2 w, where w is the scaled velocity change of stage 5: zero where nothing pushes. Returns whether anything does.
pub fn integrate_velocity<R: Real>(
    compiled: &LaneModel<R>,
    mass: &MassMatrix<R>,
    v_free: &[R],
    constraints: &Constraints<R>,
    out: &mut [R],
) -> bool {
    R::vectorize(
        #[inline(always)]
        || {
            out.copy_from_slice(&constraints.iterate.w);
            let pushed = constraints.iterate.changes_velocity();
            if pushed {
                mass.unscale(compiled, out);
            }
            for (out, &free) in out.iter_mut().zip(v_free) {
                *out = free + *out;
            }
            pushed
        },
    )
}
