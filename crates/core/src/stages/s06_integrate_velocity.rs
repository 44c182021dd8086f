//! Stage 6: computes the velocity after the step from the impulses.

use stepper_real::{Real, kernel};

use crate::compile::LaneModel;
use crate::constraints::VelocitySolution;
use crate::dynamics::inertia::MassMatrix;

/// Computes v+ = v_free + L^-1 D^-1/2 w into `velocity.v`, where w is the scaled velocity change of stage 5. L and D are the factors of the
/// mass matrix M = L^T D L.
pub fn integrate_velocity<R: Real>(compiled: &LaneModel<R>, mass: &MassMatrix<R>, v_free: &[R], velocity: &mut VelocitySolution<R>) {
    kernel!(R, || {
        let VelocitySolution { impulses, v, .. } = velocity;
        v.copy_from_slice(&impulses.w);
        if impulses.changes_velocity() {
            mass.unscale(compiled, v);
        }
        for (v, &free) in v.iter_mut().zip(v_free) {
            *v = free + *v;
        }
    })
}
