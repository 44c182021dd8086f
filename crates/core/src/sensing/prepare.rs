//! Intermediate results of a step that several sensors share, computed once.

use stepper_real::Real;

use crate::compile::LaneModel;
use crate::dynamics::kinematics::Kinematics;
use crate::sensing::inputs::{SensorInput, SensorWorkspace};
use crate::sensing::{frames, masses};

impl<R: Real> SensorWorkspace<R> {
    /// Computes the intermediate results of all sensors: velocities, accelerations, contacts, and forces on subtrees.
    pub fn prepare(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, input: &SensorInput<'_, R>) {
        if !self.orientation.is_empty() {
            frames::orientations(compiled, input.q, &mut self.orientation);
        }
        if compiled.sensing.needs.acceleration {
            frames::accelerations(compiled, kinematics, input, &mut self.velocity, &mut self.acceleration);
        } else if compiled.sensing.needs.velocities {
            R::vectorize(
                #[inline(always)]
                || kinematics.velocities(compiled, input.v, &mut self.velocity),
            );
        }
        if compiled.sensing.needs.contacts {
            self.sensed_contacts.load_contacts(compiled, input);
        }
        for (k, (site, subtree)) in compiled.sensing.carried.iter().enumerate() {
            self.carried[k] = masses::parent_force(compiled, kinematics, self, input, site, &compiled.sensing.subtrees[*subtree]);
        }
    }
}
