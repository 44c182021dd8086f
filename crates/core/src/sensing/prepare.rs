//! What sensors share, made once for all of them.

use stepper_real::Real;

use crate::compile::LanePlan;
use crate::dynamics::kinematics::Kinematics;
use crate::sensing::inputs::{Moment, Room};
use crate::sensing::{frames, masses};

impl<R: Real> Room<R> {
    /// Makes what the sensors share.
    pub fn prepare(&mut self, plan: &LanePlan<R>, kinematics: &Kinematics<R>, moment: &Moment<'_, R>) {
        if !self.orientation.is_empty() {
            frames::orientations(plan, moment.q, &mut self.orientation);
        }
        if plan.sensing.needs.acceleration {
            frames::accelerations(plan, kinematics, moment, &mut self.velocity, &mut self.acceleration);
        } else if plan.sensing.needs.velocities {
            R::vectorize(
                #[inline(always)]
                || kinematics.velocities(plan, moment.v, &mut self.velocity),
            );
        }
        if plan.sensing.needs.contacts {
            self.felt.take_up(plan, moment);
        }
        for (k, (site, subtree)) in plan.sensing.carried.iter().enumerate() {
            self.carried[k] = masses::parent_force(plan, kinematics, self, moment, site, &plan.sensing.subtrees[*subtree]);
        }
    }
}
