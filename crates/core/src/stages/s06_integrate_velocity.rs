//! Stage 6: computes the velocity after the step from the impulses.

use stepper_real::{Real, kernel};
use stepper_solve::Iterate;

use crate::compile::LaneModel;
use crate::dynamics::inertia::MassMatrix;

/// Computes v+ = v_free + L^-1 D^-1/2 w into `out`, nv, where w is the scaled velocity change of `impulses`, from stage 5. L and D are the
/// factors of the mass matrix M = L^T D L.
pub fn integrate_velocity<R: Real>(compiled: &LaneModel<R>, mass: &MassMatrix<R>, v_free: &[R], impulses: &Iterate<R>, out: &mut [R]) {
    kernel!(R, || {
        find_velocity_change(compiled, mass, impulses, out);
        for (v, &free) in out.iter_mut().zip(v_free) {
            *v += free;
        }
    })
}

/// Computes the change of the generalized velocity by `impulses` into `out`, nv.
pub fn find_velocity_change<R: Real>(compiled: &LaneModel<R>, mass: &MassMatrix<R>, impulses: &Iterate<R>, out: &mut [R]) {
    kernel!(R, || {
        out.copy_from_slice(&impulses.w);
        if impulses.changes_velocity() {
            mass.unscale(compiled, out);
        }
    })
}
