//! Stage 7: computes the configuration after the step from the velocity.

use stepper_real::Real;

use crate::compile::LaneModel;
use crate::dynamics::kinematics::displace;

/// Computes q+ = q (+) h v into `out`. The operator (+) displaces a configuration; it rotates quaternions.
pub fn integrate_position<R: Real>(compiled: &LaneModel<R>, q: &[R], v: &[R], h: R, out: &mut [R]) {
    displace(compiled, q, v, h, out);
}
