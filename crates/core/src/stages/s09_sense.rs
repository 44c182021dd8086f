//! Stage 9: the new state becomes an observation.

use stepper_real::Real;

use crate::plan::{Plan, SensorPlan};

/// True readings of all sensors.
#[inline(always)]
pub fn sense<R: Real>(plan: &Plan<R::Scalar>, q: &[R], v: &[R], out: &mut [R]) {
    for (reading, sensor) in out.iter_mut().zip(&plan.sensors) {
        *reading = match *sensor {
            SensorPlan::Position(at) => q[at],
            SensorPlan::Velocity(dof) => v[dof],
        };
    }
}
