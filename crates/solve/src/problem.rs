//! Constraint problem, which no solve changes, and the system of rows that one solve reads.

use crate::capacity::Capacity;
use crate::constraints::constraint_set::{ConstraintList, ConstraintSet, LaneConstraint};
use crate::constraints::friction::{ContactList, FrictionContacts, RowCount};
use crate::constraints::scalar::{ScalarList, ScalarRows};
use stepper_real::{Mask, Real};

/// Constraint problem of one step, for every lane. Each row has an offset for the velocity solve and one for the position solve. A solve
/// does not change the problem. Sweeps visit the scalar rows first.
#[derive(Clone, Debug)]
pub struct Problem<R: Real> {
    /// Number of coordinates of the scaled velocity change w, one per degree of freedom. In these coordinates the kinetic energy is
    /// |w|^2 / 2.
    pub dimension: usize,
    /// Lanes with redundant supports that take up load for the first time. The solver first computes impulses of least norm in these
    /// lanes, which distribute the load evenly.
    ///
    /// Supports are redundant if statics does not determine how they share the load: a table with four legs, for example.
    pub newly_loaded: R::Mask,
    /// Mobility of a contact along its normal below which the contact is immovable, 1/kg. A new value applies to the contacts that are
    /// appended after it.
    pub least_mobility: R,
    /// Scalar rows: equalities, limits and dry friction.
    pub scalars: ScalarRows<R>,
    /// Contacts, with any number of rows.
    pub contacts: FrictionContacts<R>,
}

/// System that one solve reads: a problem, and for each kind of constraint a reference to the rows of this solve.
///
/// A system made from a `&Problem` is solved for velocities. One made from [`PositionRows`](crate::PositionRows) is solved for
/// positions: its rows have other offsets.
#[derive(Clone, Copy, Debug)]
pub struct System<'a, R: Real> {
    /// Problem, which the velocity solve and the position solve share.
    pub(crate) problem: &'a Problem<R>,
    /// Whether the solve must end with the residual of its impulses. For this it recomputes the scaled velocity change w from the
    /// impulses, and evaluates the residual. If false, a lane counts as solved once a sweep (Gauss-Seidel iteration) changes little,
    /// and Newton's method makes one pass.
    pub(crate) needs_residual: bool,
    /// Scalar rows of this solve.
    pub(crate) scalars: &'a ScalarList<R>,
    /// Contacts of this solve.
    pub(crate) contacts: &'a ContactList<R>,
}

impl<'a, R: Real> From<&'a Problem<R>> for System<'a, R> {
    #[inline(always)]
    fn from(problem: &'a Problem<R>) -> Self {
        System { problem, needs_residual: true, scalars: &problem.scalars.rows, contacts: &problem.contacts.rows }
    }
}

impl<R: Real> Problem<R> {
    /// Empty problem with memory for this capacity.
    pub fn new(capacity: &Capacity) -> Self {
        let columns = capacity.columns_per_contact;
        Self {
            dimension: capacity.dimension,
            newly_loaded: R::Mask::splat(false),
            least_mobility: R::zero(),
            scalars: ConstraintSet::new(capacity, capacity.scalar_entries, capacity.scalar_entries),
            contacts: ConstraintSet::new(capacity, columns * capacity.all_contacts(), columns * capacity.contact_rows()),
        }
    }

    /// Removes all rows.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.scalars.clear();
        self.contacts.clear();
        self.newly_loaded = R::Mask::splat(false);
    }

    /// Whether the problem has no rows.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.scalars.is_empty() && self.contacts.is_empty()
    }

    /// Appends a contact with three rows (n, t1, t2), with four rows (n, t1, t2, spin) if it has torsional friction, or with six rows
    /// (n, t1, t2, spin, roll1, roll2) if it has rolling friction. The rows have the entries `y` at the coordinates `columns`, ascending.
    ///
    /// The contact exists in the lanes `exists`, and `mu` is its friction coefficient. `g` has the offset of each row, m/s: the row's
    /// velocity before any impulse, plus its bias (minus the target velocity). The rows must be scaled so that all of them have the
    /// friction coefficient `mu`.
    #[inline(always)]
    pub fn push_contact<const N: usize>(&mut self, columns: &[u32], y: impl Fn(usize) -> [R; N], exists: R::Mask, mu: R, g: [R; N])
    where
        [R; N]: RowCount<R, N>,
    {
        self.contacts.push(columns, y, exists, mu, g, self.least_mobility);
    }

    /// Changes the offsets of all rows after a change of the free velocity. The offsets of the velocity solve and of
    /// the position solve change. `change` is the change of the free velocity, in the scaled coordinates of w (scaled velocity change).
    /// Each offset increases by the row's velocity due to this change.
    #[inline(always)]
    pub fn shift(&mut self, change: &[R]) {
        self.scalars.shift(change);
        self.contacts.shift(change);
    }

    /// Exchanges, in every row, the offset of the velocity solve and that of the position solve, in the lanes `lanes`.
    #[inline(always)]
    pub fn exchange_offsets(&mut self, lanes: R::Mask) {
        self.scalars.rows.exchange_offsets(lanes);
        self.contacts.rows.exchange_offsets(lanes);
    }
}

impl<R: Real> System<'_, R> {
    /// Admissible impulses and compliances, in the lane `lane`, of the constraint with the index `i`, which counts the scalar rows first.
    pub(crate) fn lane_constraint(&self, i: usize, lane: usize) -> LaneConstraint {
        match i.checked_sub(self.problem.scalars.len()) {
            None => self.scalars.lane_constraint(i, lane),
            Some(contact) => self.contacts.lane_constraint(contact, lane),
        }
    }

    /// Copy of the system whose solve need not end with an evaluation of the residual. Lanes whose last sweep changed little then report
    /// a residual of 0.
    #[inline(always)]
    pub fn without_final_residual(self) -> Self {
        Self { needs_residual: false, ..self }
    }

    /// Calls `f` for each row or contact that is active in a lane: it exists, an impulse can move it, and it is not deferred. `f` gets an
    /// iterator over the coordinates (columns of the Jacobian) at which this row or contact has entries in the lane, ascending.
    pub fn for_each_column_set(&self, lane: usize, mut f: impl FnMut(&mut dyn Iterator<Item = u32>)) {
        self.problem.scalars.for_each_column_set(self.scalars, lane, &mut f);
        self.problem.contacts.for_each_column_set(self.contacts, lane, &mut f);
    }
}
