//! Noslip iterations after the solution with MuJoCo's contact law, and the order of contacts in them.
//!
//! Iterations that stop before they converge depend on the order. The order is MuJoCo's: ascending pairs of bodies, then pairs of geoms, in
//! every lane separately. The contact points of one pair of geoms are in stepper's order.

use stepper_real::{Mask, Real};
use stepper_solve::soft::{ContactVisit, SlipEffort};

use crate::collision::contact_set::Contacts;
use crate::compile::LaneModel;
use crate::constraints::soft::system::{Key, SoftSystem, TreeMass, VisitOrder};
use crate::dynamics::inertia::MassMatrix;

impl<R: Real> SoftSystem<R> {
    /// Removes slip of contacts by noslip iterations, after the problem is solved. Returns the number of iterations in each lane.
    pub fn remove_slip(
        &mut self,
        compiled: &LaneModel<R>,
        factors: &MassMatrix<R>,
        free: &[R],
        effort: SlipEffort<R::Scalar>,
        contacts: &Contacts<R>,
    ) -> R {
        self.order_contacts(compiled, contacts);
        let Self { problem, solver, acceleration, mass, order, .. } = self;
        let metric = TreeMass { compiled, mass, factors };
        solver.remove_slip(problem, &metric, free, &order.visits, effort, self.constrained, acceleration)
    }

    /// Determines the order in which noslip iterations visit the contacts of the problem.
    fn order_contacts(&mut self, compiled: &LaneModel<R>, contacts: &Contacts<R>) {
        let VisitOrder { visits, places, keyed, order } = &mut self.order;
        let slots = contacts.slots();
        places.clear();
        places.resize(slots, 0..0);
        // The contacts of a slot follow one another.
        for (i, &(slot, _)) in self.contacts.iter().enumerate() {
            let range = &mut places[slot];
            *range = if range.start == range.end { i } else { range.start }..i + 1;
        }
        order.clear();
        order.resize(slots * R::LANES, u32::MAX);
        for l in 0..R::LANES {
            keyed.clear();
            for k in (0..slots).filter(|&k| contacts.lanes_of(k) >> l & 1 == 1) {
                keyed.push((visit_key(compiled, contacts.ids[k][l].pair()), k as u32));
            }
            // If two keys are equal, the lower slot comes first. The list is usually sorted already.
            keyed.sort_unstable();
            for (to, &(_, k)) in order[l * slots..].iter_mut().zip(&*keyed) {
                *to = k;
            }
        }
        visits.clear();
        for p in 0..slots {
            let mut rest = u32::MAX >> (32 - R::LANES);
            while rest != 0 {
                let first = order[rest.trailing_zeros() as usize * slots + p];
                let same = (0..R::LANES).filter(|l| order[l * slots + p] == first).fold(0, |bits, l| bits | 1 << l);
                rest &= !same;
                let Some(places) = places.get(first as usize) else { continue };
                let there = R::Mask::from_bits(same);
                for (_, contact) in &self.contacts[places.clone()] {
                    let lanes = contact.lanes.and(there);
                    if lanes.any() {
                        visits.push(ContactVisit { lanes, ..*contact });
                    }
                }
            }
        }
    }
}

/// Sort key of the contacts of a pair of geoms.
fn visit_key<R: Real>(compiled: &LaneModel<R>, pair: usize) -> Key {
    let (Some(geoms), Some(softness)) = (compiled.pair_geoms(pair), &compiled.softness) else { return [u32::MAX; 4] };
    let [a, b] = geoms.map(|g| compiled.geoms[g].index);
    let bodies = [a, b].map(|g| softness.geom_bodies[g]);
    [bodies[0].min(bodies[1]), bodies[0].max(bodies[1]), a as u32, b as u32]
}
