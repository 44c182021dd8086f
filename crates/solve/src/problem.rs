//! The constraint problem: what is fixed during a solve.

use crate::capacity::Capacity;
use crate::constraints::ConstraintSet;
use crate::constraints::rolling::RollingContacts;
use crate::constraints::scalar::ScalarRows;
use crate::constraints::sliding::SlidingContacts;
use crate::lane_map::LaneMap;
use stepper_real::{Mask, Real};

/// Constraint problem of one step, for every lane: one set of constraints per kind, which sweeps visit in the order of the fields.
#[derive(Clone, Debug)]
pub struct Problem<R: Real> {
    dimension: usize,
    /// Equalities, limits and dry friction.
    pub scalars: ScalarRows<R>,
    /// Contacts with sliding friction.
    pub contacts: SlidingContacts<R>,
    /// Contacts with torsional or rolling friction.
    pub rolling_contacts: RollingContacts<R>,
    /// Lanes in which the rows do not determine how a load is distributed.
    pub hyperstatic: R::Mask,
    /// Least mobility along the normal of a contact that can move, 1/kg, for the contacts that are pushed from now on.
    pub least_mobility: R,
}

impl<R: Real> Problem<R> {
    /// An empty problem in `dimension` coordinates, with room for so many rows that may touch every coordinate.
    pub fn with_capacity(dimension: usize, scalars: usize, contacts: usize) -> Self {
        let contact_support = dimension;
        Self::new(&Capacity { dimension, scalars, scalar_entries: scalars * dimension, contacts, rolling_contacts: 0, contact_support })
    }

    /// An empty problem of this capacity.
    pub fn new(capacity: &Capacity) -> Self {
        let Capacity { contacts, rolling_contacts, contact_support, .. } = *capacity;
        Self {
            dimension: capacity.dimension,
            scalars: ScalarRows::with_capacity(capacity.scalars, capacity.scalar_entries),
            contacts: SlidingContacts::with_capacity(contacts, contacts * contact_support),
            rolling_contacts: RollingContacts::with_capacity(rolling_contacts, rolling_contacts * contact_support),
            hyperstatic: R::Mask::splat(false),
            least_mobility: R::zero(),
        }
    }

    /// Removes all rows.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.scalars.clear();
        self.contacts.clear();
        self.rolling_contacts.clear();
        self.hyperstatic = R::Mask::splat(false);
    }

    /// Gathers some lanes into `out`, as far as sweeps need them.
    #[inline(always)]
    pub(crate) fn gather(&self, map: &LaneMap, out: &mut Problem<R::Half>) {
        self.scalars.gather(map, &mut out.scalars);
        self.contacts.gather(map, &mut out.contacts);
        self.rolling_contacts.gather(map, &mut out.rolling_contacts);
    }

    /// Number of coordinates of w.
    #[inline(always)]
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Whether there is no row at all.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.scalars.is_empty() && self.contacts.is_empty() && self.rolling_contacts.is_empty()
    }

    /// Appends a contact whose rows (n, t1, t2) have the entries `y` at the coordinates `support` (ascending).
    #[inline(always)]
    pub fn push_contact(&mut self, support: &[u32], y: impl Fn(usize) -> [R; 3], active: R::Mask, mu: R, g: [R; 3]) {
        self.contacts.push(support, y, active, mu, g, self.least_mobility);
    }

    /// Appends a contact whose rows (n, t1, t2, spin, roll1, roll2), scaled so that their friction is `mu` in all, have the entries `y` at
    /// the coordinates `support` (ascending).
    #[inline(always)]
    pub fn push_rolling_contact(&mut self, support: &[u32], y: impl Fn(usize) -> [R; 6], active: R::Mask, mu: R, g: [R; 6]) {
        self.rolling_contacts.push(support, y, active, mu, g, self.least_mobility);
    }

    /// Calls `f` for every row or contact that exists in a lane with the coordinates that it touches there, ascending.
    pub fn for_each_support(&self, lane: usize, mut f: impl FnMut(&mut dyn Iterator<Item = u32>)) {
        self.scalars.for_each_support(lane, &mut f);
        self.contacts.for_each_support(lane, &mut f);
        self.rolling_contacts.for_each_support(lane, &mut f);
    }
}
