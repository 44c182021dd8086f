//! Intermediate results of a step that several sensors share, computed once.

use stepper_real::{Real, kernel};

use crate::compile::LaneModel;
use crate::dynamics::kinematics::Kinematics;
use crate::sensing::frames::{accelerations, orientations};
use crate::sensing::inputs::{SensorInput, SensorView, SensorWorkspace};

impl<R: Real> SensorWorkspace<R> {
    /// Computes the intermediate results of all sensors: velocities, accelerations, contacts, and forces on subtrees. Returns the view from
    /// which sensors read, the true readings, and a buffer for contacts.
    pub fn prepare<'a>(
        &'a mut self,
        compiled: &'a LaneModel<R>,
        kinematics: &'a Kinematics<R>,
        input: &'a SensorInput<'a, R>,
    ) -> (SensorView<'a, R>, &'a mut [R], &'a mut Vec<(f64, usize)>) {
        let Self { truth, orientation, velocity, acceleration, site_forces, sensed_contacts, order } = self;
        if !orientation.is_empty() {
            orientations(compiled, input.q, orientation);
        }
        if compiled.sensing.needs.acceleration {
            accelerations(compiled, kinematics, input, velocity, acceleration);
        } else if compiled.sensing.needs.velocities {
            kernel!(R, || kinematics.velocities(compiled, input.v, velocity));
        }
        if compiled.sensing.needs.contacts {
            sensed_contacts.load_contacts(compiled, input);
        }
        let (orientations, velocities, accelerations) = (&orientation[..], &velocity[..], &acceleration[..]);
        let view = SensorView { compiled, kinematics, input, orientations, velocities, accelerations, site_forces: &[], sensed_contacts };
        for (site_forces, (site, subtree)) in site_forces.iter_mut().zip(&compiled.sensing.force_sites) {
            *site_forces = view.parent_force(site, &compiled.sensing.subtrees[*subtree]);
        }
        (SensorView { site_forces, ..view }, truth, order)
    }
}
