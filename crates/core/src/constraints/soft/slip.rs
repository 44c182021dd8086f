//! Friction without slip, after the solution: which contacts are visited in which order.

use stepper_real::{Mask, Real};
use stepper_solve::soft::{ContactVisit, SlipEffort};

use crate::collision::contact_set::Contacts;
use crate::compile::LaneModel;
use crate::constraints::constraint_set::Constraints;
use crate::dynamics::inertia::MassMatrix;

impl<R: Real> Constraints<R> {
    /// Takes the slip out of friction in the lanes that have constraints, once the soft problem is solved. Returns the sweeps of each lane.
    pub fn remove_slip(
        &mut self,
        compiled: &LaneModel<R>,
        factors: &MassMatrix<R>,
        free: &[R],
        effort: SlipEffort<R::Scalar>,
        contacts: &Contacts<R>,
    ) -> R {
        let Some(mut system) = self.soft.take() else { return R::zero() };
        system.visits.clear();
        self.order_contacts(compiled, contacts, &mut system.visits);
        let sweeps = system.remove_slip(compiled, factors, free, self.owners.len(), effort, self.constrained);
        self.soft = Some(system);
        sweeps
    }

    /// Contacts in the order of their slots.
    fn order_contacts(&self, _compiled: &LaneModel<R>, _contacts: &Contacts<R>, visits: &mut Vec<ContactVisit<R::Mask>>) {
        let mut rolling = self.rolling_slots.iter().enumerate().peekable();
        for (index, &(k, lanes)) in self.slots.iter().enumerate() {
            while let Some((index, &(_, lanes, _))) = rolling.next_if(|(_, slot)| slot.0 <= k) {
                visits.push(ContactVisit { rolling: true, index, lanes });
            }
            visits.push(ContactVisit { rolling: false, index, lanes });
        }
        visits.extend(rolling.map(|(index, &(_, lanes, _))| ContactVisit { rolling: true, index, lanes }));
        visits.retain(|visit| visit.lanes.any());
    }
}
