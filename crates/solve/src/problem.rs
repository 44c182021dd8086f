//! Constraint problem, which no solve changes, and the system of rows that one solve reads.

use crate::capacity::Capacity;
use crate::constraints::constraint_set::{ConstraintSet, RowsRef};
use crate::constraints::{at_contact, by_kind, each_kind, make_kinds};
use stepper_real::{Mask, Real};

by_kind! {
    /// Constraint problem of one step, for every lane: one set of constraints for each kind (scalar rows, contacts, contacts with rolling
    /// friction). Each row has an offset for the velocity solve and one for the position solve. A solve does not change the problem.
    #[derive(Clone, Debug)]
    pub struct Problem[R: Real] {
        /// Number of coordinates of the scaled velocity change w, one per degree of freedom. In these coordinates the kinetic energy is
        /// |w|^2 / 2.
        dimension: usize,
        /// Lanes with redundant supports that take up load for the first time. The solver first computes impulses of least norm in these
        /// lanes, which distribute the load evenly.
        ///
        /// Supports are redundant if statics does not determine how they share the load: a table with four legs, for example.
        pub newly_loaded: R::Mask,
        /// Mobility of a contact along its normal below which the contact is immovable, 1/kg. A new value applies to the contacts that are
        /// appended after it.
        pub least_mobility: R,
    } each ConstraintSet[R]
}

by_kind! {
    /// System that one solve reads: a problem, and for each kind of constraint a reference to the rows of this solve.
    ///
    /// A system made from a `&Problem` is solved for velocities. One made from [`PositionRows`](crate::PositionRows) is solved for
    /// positions: its rows have other offsets.
    #[derive(Clone, Copy, Debug)]
    pub struct System['a, R: Real] {
        /// Problem, which the velocity solve and the position solve share.
        pub(crate) problem: &'a Problem<R>,
        /// Whether the solve must end with the residual of its impulses. For this it recomputes the scaled velocity change w from the
        /// impulses, and evaluates the residual. If false, a lane counts as solved once a sweep (Gauss-Seidel iteration) changes little,
        /// and Newton's method makes one pass.
        pub(crate) needs_residual: bool,
    } each RowsRef['a]
}

impl<'a, R: Real> From<&'a Problem<R>> for System<'a, R> {
    #[inline(always)]
    fn from(problem: &'a Problem<R>) -> Self {
        make_kinds!(System { problem, needs_residual: true, } [set: &problem] => &set.rows)
    }
}

impl<R: Real> Problem<R> {
    /// Empty problem with `dimension` coordinates, and with memory for `scalars` scalar rows and `contacts` contacts with three rows. Each
    /// row may have entries at every coordinate.
    pub fn with_capacity(dimension: usize, scalars: usize, contacts: usize) -> Self {
        let capacity = Capacity {
            dimension,
            scalars,
            scalar_entries: scalars * dimension,
            contacts,
            columns_per_contact: dimension,
            ..Capacity::default()
        };
        Self::new(&capacity)
    }

    /// Empty problem with memory for this capacity.
    pub fn new(capacity: &Capacity) -> Self {
        let (dimension, newly_loaded, least_mobility) = (capacity.dimension, R::Mask::splat(false), R::zero());
        make_kinds!(Self { dimension, newly_loaded, least_mobility, } [count: capacity] => ConstraintSet::new(count, capacity))
    }

    /// Removes all rows.
    #[inline(always)]
    pub fn clear(&mut self) {
        each_kind!([set: &mut self] => set.clear());
        self.newly_loaded = R::Mask::splat(false);
    }

    /// Number of coordinates of the scaled velocity change w.
    #[inline(always)]
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Whether the problem has no rows.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        let mut empty = true;
        each_kind!([set: &self] => empty &= set.rows.items.is_empty());
        empty
    }

    /// Appends a contact whose rows (n, t1, t2) have the entries `y` at the coordinates `columns`, ascending.
    ///
    /// The contact exists in the lanes `exists`, and `mu` is its friction coefficient. `g` has the offset of each row, m/s: the row's
    /// velocity before any impulse, plus its bias (minus the target velocity).
    #[inline(always)]
    pub fn push_contact(&mut self, columns: &[u32], y: impl Fn(usize) -> [R; 3], exists: R::Mask, mu: R, g: [R; 3]) {
        self.contacts.push(columns, y, exists, mu, g, self.least_mobility);
    }

    /// Appends a contact with rolling friction, whose rows (n, t1, t2, spin, roll1, roll2) have the entries `y` at the coordinates
    /// `columns`, ascending.
    ///
    /// The contact exists in the lanes `exists`, and `mu` is its friction coefficient. `g` has the offset of each row, m/s: the row's
    /// velocity before any impulse, plus its bias (minus the target velocity). The rows must be scaled so that all of them have the
    /// friction coefficient `mu`.
    #[inline(always)]
    pub fn push_rolling_contact(&mut self, columns: &[u32], y: impl Fn(usize) -> [R; 6], exists: R::Mask, mu: R, g: [R; 6]) {
        self.rolling_contacts.push(columns, y, exists, mu, g, self.least_mobility);
    }

    /// Changes the offsets of all rows after a change of the free velocity. The offsets of the velocity solve and of
    /// the position solve change. `change` is the change of the free velocity, in the scaled coordinates of w (scaled velocity change).
    /// Each offset increases by the row's velocity due to this change.
    #[inline(always)]
    pub fn shift(&mut self, change: &[R]) {
        each_kind!([set: &mut self] => {
            let mut rows = std::mem::take(&mut set.rows);
            set.shift(&mut rows, change);
            set.rows = rows;
        });
    }

    /// Activates the rows of contact `i` in those lanes of `lanes` in which they are deferred. Returns these lanes.
    ///
    /// The index `i` counts the contacts with three rows first, then those with six rows (rolling friction).
    #[inline(always)]
    pub fn activate_contact(&mut self, i: usize, lanes: R::Mask) -> R::Mask {
        at_contact!(i of self.contacts.len(), [set: &mut self] => set.activate(i, lanes))
    }

    /// Defers the rows of contact `i` in the lanes `lanes`: the solver ignores them until they are activated. In these lanes they must be
    /// active and have no impulse.
    ///
    /// The index `i` counts the contacts with three rows first, then those with six rows (rolling friction).
    #[inline(always)]
    pub fn defer_contact(&mut self, i: usize, lanes: R::Mask) {
        at_contact!(i of self.contacts.len(), [set: &mut self] => set.defer_contact(i, lanes))
    }

    /// Offset g of the normal row of contact `i` in the velocity solve, m/s.
    ///
    /// The index `i` counts the contacts with three rows first, then those with six rows (rolling friction).
    #[inline(always)]
    pub fn normal_offset_mut(&mut self, i: usize) -> &mut R {
        at_contact!(i of self.contacts.len(), [set: &mut self] => &mut set[i].g[0])
    }

    /// Lanes in which the solver reads contact `i`: it exists there, is movable along its normal, and is not deferred.
    ///
    /// The index `i` counts the contacts with three rows first, then those with six rows (rolling friction).
    #[inline(always)]
    pub fn contact_lanes(&self, i: usize) -> R::Mask {
        at_contact!(i of self.contacts.len(), [set: &self] => set[i].active)
    }

    /// Friction coefficient of the rows of contact `i`.
    ///
    /// The index `i` counts the contacts with three rows first, then those with six rows (rolling friction).
    #[inline(always)]
    pub fn contact_friction(&self, i: usize) -> R {
        at_contact!(i of self.contacts.len(), [set: &self] => set[i].mu)
    }

    /// Velocity of contact `i` under impulses that cause the scaled velocity change `w`, m/s, as six numbers. The last three are zeros for
    /// a contact with three rows.
    ///
    /// The index `i` counts the contacts with three rows first, then those with six rows (rolling friction).
    #[inline(always)]
    pub fn contact_velocity(&self, i: usize, w: &[R]) -> [R; 6] {
        at_contact!(i of self.contacts.len(), [set: &self] => set.padded_velocity(i, w))
    }

    /// Calls `f` with each coordinate of contact `i` and with the entries of the contact's rows there in the lane `lane`. The entries are
    /// six numbers; the last three are zeros for a contact with three rows.
    ///
    /// The index `i` counts the contacts with three rows first, then those with six rows (rolling friction).
    #[inline(always)]
    pub fn for_each_contact_entry(&self, i: usize, lane: usize, f: impl FnMut(u32, [f64; 6])) {
        at_contact!(i of self.contacts.len(), [set: &self] => set.for_each_entry(i, lane, f))
    }

    /// Normal velocity of contact `i`, m/s, under impulses that cause the scaled velocity change `w`. It includes the bias, so that it is 0
    /// at the contact's target velocity.
    ///
    /// The index `i` counts the contacts with three rows first, then those with six rows (rolling friction).
    #[inline(always)]
    pub fn normal_velocity_above_target(&self, i: usize, w: &[R]) -> R {
        at_contact!(i of self.contacts.len(), [set: &self] => set.normal_velocity_above_target(i, w))
    }

    /// Exchanges, in every row, the offset of the velocity solve and that of the position solve, in the lanes `lanes`.
    #[inline(always)]
    pub fn exchange_offsets(&mut self, lanes: R::Mask) {
        each_kind!([set: &mut self] => set.rows.exchange_offsets(lanes));
    }
}

impl<R: Real> System<'_, R> {
    /// Copy of the system whose solve need not end with an evaluation of the residual. Lanes whose last sweep changed little then report
    /// a residual of 0.
    #[inline(always)]
    pub fn without_final_residual(self) -> Self {
        Self { needs_residual: false, ..self }
    }

    /// Calls `f` for each row or contact that is active in a lane: it exists, an impulse can move it, and it is not deferred. `f` gets an
    /// iterator over the coordinates (columns of the Jacobian) at which this row or contact has entries in the lane, ascending.
    pub fn for_each_column_set(&self, lane: usize, mut f: impl FnMut(&mut dyn Iterator<Item = u32>)) {
        each_kind!([set: &self.problem] [rows: self] => set.for_each_column_set(rows, lane, &mut f));
    }
}
