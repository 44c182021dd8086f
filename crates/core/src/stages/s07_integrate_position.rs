//! Stage 7: computes the configuration after the step from the velocity.

use stepper_real::Real;

use crate::compile::LaneModel;
use crate::dynamics::kinematics::displace;

/// Computes q+ = q (+) time v into `out`. The operator (+) displaces a configuration; it rotates quaternions. `time` is the time from the
/// configuration `q` to the end of the step, s.
pub fn integrate_position<R: Real>(compiled: &LaneModel<R>, q: &[R], v: &[R], time: R, out: &mut [R]) {
    displace(compiled, q, v, time, out);
}
