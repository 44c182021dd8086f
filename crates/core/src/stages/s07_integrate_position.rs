//! Stage 7: the velocity carries the configuration.

use stepper_real::Real;

use crate::compile::LanePlan;
use crate::dynamics::kinematics::displace;

/// q+ = q (+) h v.
pub fn integrate_position<R: Real>(plan: &LanePlan<R>, q: &[R], v: &[R], h: R, out: &mut [R]) {
    displace(plan, q, v, h, out);
}
