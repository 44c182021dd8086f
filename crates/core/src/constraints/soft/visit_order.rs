//! Order in which sweeps without slip visit contacts.

use std::ops::Range;

use stepper_real::Real;
use stepper_solve::soft::ContactVisit;

/// Sort key of a pair of geoms: the lower body, the other body, the geoms.
pub(super) type Key = [u32; 4];

/// Order of contacts, and the workspace that computes it.
#[derive(Clone, Debug)]
pub(super) struct VisitOrder<R: Real> {
    /// Contacts to visit.
    pub(super) visits: Vec<ContactVisit<R::Mask>>,
    /// Ranges of every slot in the list of contacts with three rows, and in the list of contacts with six.
    pub(super) places: Vec<[Range<usize>; 2]>,
    /// Key and slot of the contacts of one lane.
    pub(super) keyed: Vec<(Key, u32)>,
    /// Slots of every lane in their order, lane by lane.
    pub(super) order: Vec<u32>,
}

impl<R: Real> VisitOrder<R> {
    /// Workspace for `contacts` contacts in a lane.
    pub(super) fn new(contacts: usize) -> Self {
        Self {
            visits: Vec::with_capacity(contacts * R::LANES),
            places: Vec::with_capacity(contacts),
            keyed: Vec::with_capacity(contacts),
            order: Vec::with_capacity(contacts * R::LANES),
        }
    }
}
