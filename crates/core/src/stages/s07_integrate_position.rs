//! Stage 7: moves the configuration with the velocity.

use stepper_real::Real;

use crate::compile::LaneModel;
use crate::dynamics::kinematics::displace;

/// Computes q+ = q (+) h v.
pub fn integrate_position<R: Real>(compiled: &LaneModel<R>, q: &[R], v: &[R], h: R, out: &mut [R]) {
    displace(compiled, q, v, h, out);
}
