//! Stage 7: computes the configuration after the step from the velocity.

use stepper_real::Real;

use crate::compile::LaneModel;
use crate::constraints::evaluation_times::EvaluationTimes;

/// Computes q+ = q (+) t v into `out`, where t is the time from the evaluation of each mechanism to the end of the step. The operator (+)
/// displaces a configuration; it rotates quaternions.
pub(crate) fn integrate_position<R: Real>(compiled: &LaneModel<R>, q: &[R], v: &[R], times: &EvaluationTimes<R>, out: &mut [R]) {
    times.displace_after(compiled, q, v, out);
}
