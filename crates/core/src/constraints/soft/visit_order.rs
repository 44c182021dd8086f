//! Order in which noslip iterations visit contacts.

use std::ops::Range;

use stepper_real::Real;
use stepper_solve::soft::ContactVisit;

/// Sort key of a pair of geoms: lower body, other body, and the two geoms.
pub(super) type Key = [u32; 4];

/// Order of contacts for noslip iterations, and the workspace that computes it.
#[derive(Clone, Debug)]
pub(super) struct VisitOrder<R: Real> {
    /// Contacts in the order of the visits, with the lanes of each visit.
    pub(super) visits: Vec<ContactVisit<R::Mask>>,
    /// For every slot of the contact set, ranges of its contacts in the problem. The first range is among the contacts with three rows, the
    /// second among those with six.
    pub(super) places: Vec<[Range<usize>; 2]>,
    /// Sort key and slot of the contacts in one lane.
    pub(super) keyed: Vec<(Key, u32)>,
    /// Sorted slots of every lane, lane by lane.
    pub(super) order: Vec<u32>,
}

impl<R: Real> VisitOrder<R> {
    /// Workspace for at most `contacts` contacts per lane.
    pub(super) fn new(contacts: usize) -> Self {
        Self {
            visits: Vec::with_capacity(contacts * R::LANES),
            places: Vec::with_capacity(contacts),
            keyed: Vec::with_capacity(contacts),
            order: Vec::with_capacity(contacts * R::LANES),
        }
    }
}
