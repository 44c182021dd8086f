//! Set of the constraints of one kind (scalar rows or contacts), and the operations that each kind implements.
//!
//! The operations are for the residual, Newton's method and the position solve.

use std::fmt::Debug;
use std::ops::{Deref, Index, Range};
use std::slice::SliceIndex;

use crate::admissible_set::AdmissibleSet;
use crate::capacity::Capacity;
use crate::cone::masked;
use crate::entries::Entries;
use crate::reference::ReferenceRow;
use serde::{Deserialize, Serialize};
use stepper_real::{Mask, Real, Scalar};

/// Place of a constraint in the lists of its kind.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Span {
    /// Index of the first coordinate in the list of coordinates.
    pub(super) first_column: usize,
    /// Number of coordinates at which the constraint has Jacobian entries.
    pub(super) num_columns: usize,
    /// Index of the first Jacobian entry in the list of entries.
    pub(super) y: usize,
    /// Index of the first row among the rows of all constraints of the kind.
    pub(super) first_row: usize,
    /// Number of rows.
    pub(super) num_rows: usize,
}

/// Part that constraints of all kinds have: one scalar row, or the rows of one contact.
#[derive(Clone, Copy, Debug)]
pub struct ConstraintBase<R: Real> {
    /// Place in the lists of the kind.
    pub(super) span: Span,
    /// Lanes in which the solver reads the constraint: it exists there, an impulse can move it, and it is not deferred.
    pub active: R::Mask,
    /// Lanes in which no impulse can move the constraint, along its normal if it is a contact. A contact has no rows in these lanes, and
    /// its impulse does not change.
    pub immovable: R::Mask,
}

impl<R: Real> ConstraintBase<R> {
    /// Range of the constraint's rows among the rows of all constraints of the kind.
    #[inline(always)]
    pub fn rows(&self) -> Range<usize> {
        self.span.first_row..self.span.first_row + self.span.num_rows
    }

    /// Range of the constraint's coordinates in the list of coordinates of all constraints of the kind.
    #[inline(always)]
    pub(super) fn columns(&self) -> Range<usize> {
        self.span.first_column..self.span.first_column + self.span.num_columns
    }

    /// Range of the constraint's Jacobian entries in the list of entries of all constraints of the kind.
    #[inline(always)]
    pub fn entries(&self) -> Range<usize> {
        self.span.y..self.span.y + self.span.num_columns * self.span.num_rows
    }
}

/// Coordinates of a constraint, and the Jacobian entries of its rows: all rows at the first coordinate, then all rows at the second.
pub(crate) type RowEntries<'a, R> = (&'a [u32], &'a [R]);

/// Rows of all constraints of one kind in one solve, with an offset for the velocity solve and one for the position solve.
///
/// The argument `i` of a method is the index of a constraint. `entries` are its coordinates and Jacobian entries, and `lambda` is its
/// impulse, with a number for each row.
pub trait ConstraintList<R: Real>: Clone + Debug {
    /// One constraint.
    type Item: Copy + Debug + Deref<Target = ConstraintBase<R>>;

    /// Empty list with memory for a problem of this capacity.
    fn with_capacity(capacity: &Capacity) -> Self;

    /// Constraints of the list.
    fn items(&self) -> &[Self::Item];

    /// Removes all constraints.
    fn clear(&mut self);

    /// Replaces the list by a copy of another, without allocation if the capacity suffices.
    fn copy(&mut self, from: &Self);

    /// Offset g of each row in the velocity solve, and stored offset for the position solve, m/s or rad/s. The stored offset of a contact's
    /// tangential row is the difference between the offsets of both solves.
    fn offsets(&self, i: usize) -> [&[R]; 2];

    /// Exchanges the two offsets of every row in the lanes `lanes`: the offset g of the present solve, and the stored one of the other.
    fn exchange_offsets(&mut self, lanes: R::Mask);

    /// Admissible impulses and compliances of the constraint in the lane `lane`, for Newton's method.
    fn lane_constraint(&self, i: usize, lane: usize) -> LaneConstraint;

    /// Constraint of the lane `lane` as a file stores it. The caller adds the fields that are the same for all kinds, such as the entries
    /// and offsets.
    fn save(&self, i: usize, lane: usize) -> SavedConstraint;

    /// Appends the velocity y . w + g + R lambda of each row at the scaled velocity change `w`, m/s or rad/s. R is the compliance.
    fn push_velocity(&self, i: usize, entries: RowEntries<'_, R>, w: &[R], lambda: &[R], out: &mut Vec<R>);

    /// Velocity y . w + g of the normal row at the scaled velocity change `w`, m/s or rad/s, without the velocity due to the compliance.
    fn normal_velocity(&self, i: usize, entries: RowEntries<'_, R>, w: &[R]) -> R;

    /// Adds the scaled velocity change by the impulse `lambda` to `w`.
    fn add(&self, i: usize, entries: RowEntries<'_, R>, lambda: &[R], w: &mut [R]);

    /// Residual |lambda - P_K(lambda - rho u)| / rho of the natural map at the scaled velocity change `w`, m/s. The velocity u of a contact
    /// has De Saxce's term mu |v_t| in the normal row. `has_eliminated` is whether the set has eliminated rows.
    fn residual(&self, i: usize, entries: RowEntries<'_, R>, w: &[R], lambda: &[R], has_eliminated: bool) -> R;

    /// Sum of `sum` and the potential `g . lambda + R lambda^2 / 2` of the impulse lambda, J. R is the compliance.
    fn add_potential(&self, i: usize, lambda: &[R], sum: R) -> R;

    /// Increases the offset of each row by its velocity due to the change `change` of the free velocity, which has the scaled coordinates
    /// of w. The row's offset in the position solve changes by the same amount. (A contact's tangential offsets of the position solve are
    /// relative to those of the velocity solve, and remain.)
    fn shift(&mut self, i: usize, entries: RowEntries<'_, R>, change: &[R]);

    /// Velocity by which damping at assembly reduced the target of the normal row, m/s or rad/s; 0 for a contact.
    fn damping_deficit(&self, i: usize) -> R;

    /// Adds a compliance that damps the position targets of the rows. It acts on the difference from the impulse `lambda`: this impulse
    /// itself causes no additional velocity. For a contact, `added_mobility`, 1/kg, is added to the mobility that scales the compliance.
    /// Scalar rows ignore it.
    fn damp(&mut self, i: usize, lambda: &[R], damping: Damping<R>, added_mobility: R);

    /// Velocity by which damping prevents the normal row from meeting its target, m/s or rad/s. `change` is the change of the row's
    /// impulse since the reference solution, and zero for an eliminated row.
    fn shortfall(&self, i: usize, change: R) -> R;

    /// Velocity by which the normal row misses its target in lanes in which no impulse can move it, m/s or rad/s; 0 for dry friction. The
    /// caller ignores the other lanes.
    ///
    /// For an equality the result is the absolute value of `missed`, the missed velocity with either sign. For a limit or a contact with
    /// the offset `g` the result is -g, which is negative if the target is met.
    fn unmet(&self, i: usize, missed: R, g: R) -> R;

    /// Impulse of the normal row in a proof of infeasibility, N s or N m s: the change from `before`, the impulse of the reference
    /// solution, to `now`.
    ///
    /// The impulse is 0 for rows that cannot be in a proof (dry friction, and rows with the compliance of a spring). A decrease counts for
    /// equalities only.
    fn witness(&self, i: usize, now: R, before: R) -> R;
}

/// Lanes that take part in a sweep (one Gauss-Seidel iteration).
#[derive(Clone, Copy)]
pub(crate) struct SweepLanes<R: Real> {
    /// Lanes whose impulses change in the sweep.
    pub(crate) running: R::Mask,
    /// Lanes in which a contact's local problem is solved exactly. The other lanes use the weaker update of
    /// [`LocalSolver::relax`](crate::LocalSolver::relax).
    pub(crate) exact: R::Mask,
}

/// Parameters of the compliance that damps position targets.
#[derive(Clone, Copy, Debug)]
pub struct Damping<R> {
    /// Ratio of the compliance that damps a row to the row's mobility.
    pub ratio: R,
    /// Growth of the damping ratio of a contact per velocity that the contact corrects, s/m.
    pub bending: R,
    /// Velocity correction below which a row is not damped, m/s or rad/s. It is 0, or a larger number so that rounding errors do not count
    /// as corrections.
    pub negligible: R,
}

/// Admissible impulses and compliances of one constraint in one lane, in scalar f64.
#[derive(Clone, Copy, Debug)]
pub struct LaneConstraint {
    /// Set of the constraint's admissible impulses.
    pub(crate) set: AdmissibleSet,
    /// Compliance R >= 0 of each row of the constraint, 1/kg: it is added to the diagonal of the Delassus matrix G.
    pub(crate) compliance: f64,
    /// Additional compliance of the constraint's first row, 1/kg.
    pub(crate) normal_compliance: f64,
    /// Mobility of the constraint before the elimination of equality rows, divided by that after it, at least 1. The mobility is
    /// trace(G_ii), where G_ii is the constraint's block of the Delassus matrix.
    pub(crate) mobility_ratio: f64,
}

/// Constraint of one lane, of any kind, as a file stores it. Lists with a number per row are in the order of the rows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SavedConstraint {
    /// Coordinates at which the constraint's rows have Jacobian entries, ascending.
    pub(crate) columns: Vec<u32>,
    /// Entries of the constraint's scaled Jacobian: for each coordinate, those of all rows.
    pub(crate) y: Vec<f64>,
    /// Offset g of each row in the velocity solve, m/s or rad/s.
    pub(crate) g: Vec<f64>,
    /// Stored offset of each row for the position solve, m/s or rad/s. For a contact's tangential row it is the difference from the offset
    /// in the velocity solve.
    pub(crate) position_g: Vec<f64>,
    /// Initial impulse of each row, N s or N m s.
    pub(crate) impulse: Vec<f64>,
    /// Least and largest impulse of a scalar row. For a contact, both numbers are its friction coefficient.
    pub(crate) set: [f64; 2],
    /// Compliance of the normal row of a contact, or of a scalar row, 1/kg, at least 0.
    pub(crate) compliance: f64,
    /// Mobility of the constraint before the elimination of equality rows, divided by that after it, at least 1. The mobility is
    /// trace(G_ii), where G_ii is the constraint's block of the Delassus matrix.
    pub(crate) mobility_ratio: f64,
    /// Mobility that scales the damping of a scalar row, 1/kg or 1/(kg m^2).
    pub(crate) mobility: f64,
    /// Velocity by which damping at assembly reduced the target of a scalar row, m/s or rad/s.
    pub(crate) damping_deficit: f64,
    /// Whether the row is eliminated: it is solved once, and sweeps skip it.
    pub(crate) eliminated: bool,
    /// Whether no impulse can move the constraint, along its normal if it is a contact.
    pub(crate) immovable: bool,
}

impl SavedConstraint {
    /// Whether a problem with `dimension` coordinates can have this constraint, with one of the numbers `counts` of rows.
    pub(crate) fn is_sound(&self, dimension: usize, counts: &[usize]) -> bool {
        let rows = self.g.len();
        let lists = [&self.g, &self.position_g, &self.impulse];
        let numbers = lists.into_iter().flatten().chain(&self.y).chain([&self.mobility, &self.damping_deficit]);
        counts.contains(&rows)
            && lists.iter().all(|list| list.len() == rows)
            && self.y.len() == rows * self.columns.len()
            && self.columns.is_sorted_by(|a, b| a < b)
            && self.columns.last().is_none_or(|&last| (last as usize) < dimension)
            && numbers.copied().all(f64::is_finite)
            && (self.set[0] <= self.set[1] && (rows == 1 || (0.0..f64::INFINITY).contains(&self.set[0])))
            && (0.0..f64::INFINITY).contains(&self.compliance)
            && (1.0..f64::INFINITY).contains(&self.mobility_ratio)
    }

    /// Entry of each row at the coordinate `c`.
    pub(crate) fn entries<R: Real, const N: usize>(&self, c: usize) -> [R; N] {
        let place = self.columns.binary_search(&(c as u32)).map_or(0, |k| k * N);
        std::array::from_fn(|row| R::of(self.y[place + row]))
    }
}

/// Constraints of one kind, stored sparse.
///
/// The columns of a constraint are the coordinates of w (scaled velocity change) at which it has entries in any lane, ascending. A lane
/// without an entry at a listed coordinate has zeros there.
///
/// The set has the parts that the velocity solve and the position solve share. The rows of one of these solves are the argument `rows` of
/// its methods, and `impulses` are the impulses of all rows. Methods that compute a sum or a maximum over all kinds get the result of the
/// previous kinds as an argument. Every sum therefore has the order of the rows.
#[derive(Clone, Debug)]
pub struct ConstraintSet<R: Real, T: ConstraintList<R>> {
    /// Rows of each constraint, with the offsets g of the velocity solve.
    pub(crate) rows: T,
    /// Coordinates at which the constraints have Jacobian entries, one constraint after the other.
    pub(super) columns: Vec<u32>,
    /// Entries of the scaled Jacobian at the coordinates in `columns`: at each coordinate, those of all rows of the constraint.
    pub(super) y: Entries<R>,
    /// Number of eliminated rows, which come first in the list, see [`ScalarRows::mark_eliminated`](crate::ScalarRows::mark_eliminated).
    pub(crate) eliminated: usize,
}

impl<R: Real, T: ConstraintList<R>> ConstraintSet<R, T> {
    /// Empty set with memory for a problem of this capacity, in which the constraints of this kind have `columns` coordinates and `entries`
    /// Jacobian entries together.
    pub(crate) fn new(capacity: &Capacity, columns: usize, entries: usize) -> Self {
        Self {
            rows: T::with_capacity(capacity),
            columns: Vec::with_capacity(columns),
            y: Entries::with_capacity(entries, R::zero()),
            eliminated: 0,
        }
    }

    /// Number of constraints.
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.rows.items().len()
    }

    /// Whether there is no constraint.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.rows.items().is_empty()
    }

    /// Iterator over the constraints.
    #[inline(always)]
    pub fn iter(&self) -> std::slice::Iter<'_, T::Item> {
        self.rows.items().iter()
    }

    /// Coordinates of a constraint, and the entries of its rows: all rows at the first coordinate, then all rows at the second.
    #[inline(always)]
    pub fn entries(&self, row: &T::Item) -> (&[u32], &[R]) {
        (&self.columns[row.columns()], self.y.range(row.entries()))
    }

    /// Adds the scaled velocity change by the impulse `lambda` of constraint `i` to `w`.
    #[inline(always)]
    pub(crate) fn add(&self, i: usize, lambda: &[R], w: &mut [R]) {
        self.rows.add(i, self.entries(&self[i]), lambda, w);
    }

    /// Place of a new constraint after the last one: appends the coordinates `columns` and the entries `y` of its rows there. `visit` is
    /// called with the entries at each coordinate.
    #[inline(always)]
    pub(super) fn push_entries<const N: usize>(
        &mut self,
        columns: &[u32],
        y: impl Fn(usize) -> [R; N],
        mut visit: impl FnMut(&[R; N]),
    ) -> Span {
        let first_row = self.rows.items().last().map_or(0, |last| last.rows().end);
        let span = Span { first_column: self.columns.len(), num_columns: columns.len(), y: self.y.len(), first_row, num_rows: N };
        self.columns.extend_from_slice(columns);
        for (entries, &c) in self.y.extend_by(columns.len() * N).as_chunks_mut::<N>().0.iter_mut().zip(columns) {
            *entries = y(c as usize);
            visit(entries);
        }
        span
    }

    /// Removes all constraints.
    #[inline(always)]
    pub(crate) fn clear(&mut self) {
        self.rows.clear();
        self.columns.clear();
        self.y.clear();
        self.eliminated = 0;
    }

    /// Calls `f` for each constraint that is active in a lane ([`ConstraintBase::active`]). `f` gets an iterator over the coordinates at
    /// which this constraint has entries in the lane, ascending.
    pub(crate) fn for_each_column_set(&self, rows: &T, lane: usize, f: &mut impl FnMut(&mut dyn Iterator<Item = u32>)) {
        for row in rows.items().iter().filter(|row| has_lane::<R>(row.active, lane)) {
            f(&mut self.columns_in(row, lane));
        }
    }

    /// Iterator over the coordinates at which a constraint has entries in a lane, ascending.
    fn columns_in(&self, row: &T::Item, lane: usize) -> impl Iterator<Item = u32> {
        let (columns, y) = self.entries(row);
        let touches = move |y: &[R]| y.iter().any(|&y| number_of(y, lane) != 0.0);
        columns.iter().zip(y.chunks_exact(row.span.num_rows)).filter(move |(_, y)| touches(y)).map(|(c, _)| *c)
    }

    /// Constraints of a lane, with their impulses, as a file stores them. Deferred contacts are left out.
    pub(crate) fn save(&self, rows: &T, impulses: &[R], lane: usize) -> Vec<SavedConstraint> {
        let exists = |row: &T::Item| has_lane::<R>(row.active, lane) || has_lane::<R>(row.immovable, lane);
        let numbers = |list: &[R]| list.iter().map(|&x| number_of(x, lane)).collect::<Vec<f64>>();
        let save = |(i, row): (usize, &T::Item)| {
            let ((columns, y), [g, position_g]) = (self.entries(row), rows.offsets(i));
            SavedConstraint {
                columns: columns.to_vec(),
                y: numbers(y),
                g: numbers(g),
                position_g: numbers(position_g),
                impulse: numbers(&impulses[row.rows()]),
                eliminated: i < self.eliminated,
                immovable: has_lane::<R>(row.immovable, lane),
                ..rows.save(i, lane)
            }
        };
        rows.items().iter().enumerate().filter(|(_, row)| exists(row)).map(save).collect()
    }

    /// Adds the scaled velocity change by all impulses to `w`.
    #[inline(always)]
    pub(crate) fn add_impulses(&self, impulses: &[R], w: &mut [R]) {
        for (i, row) in self.iter().enumerate() {
            self.add(i, &impulses[row.rows()], w);
        }
    }

    /// Appends the velocities of all rows at the scaled velocity change `w`, m/s or rad/s. They include the velocity due to each row's
    /// compliance.
    #[inline(always)]
    pub(crate) fn velocities(&self, rows: &T, impulses: &[R], w: &[R], out: &mut Vec<R>) {
        for (i, row) in rows.items().iter().enumerate() {
            rows.push_velocity(i, self.entries(row), w, &impulses[row.rows()], out);
        }
    }

    /// Calls `f` with the natural-map residual |lambda - P_K(lambda - rho u)| / rho of each constraint in turn, m/s; 0 for constraints that
    /// are not active. See [`residual`](crate::residual()).
    #[inline(always)]
    pub(crate) fn for_each_residual(&self, rows: &T, impulses: &[R], w: &[R], mut f: impl FnMut(R)) {
        for (i, row) in rows.items().iter().enumerate() {
            let residual = rows.residual(i, self.entries(row), w, &impulses[row.rows()], self.eliminated > 0);
            f(masked(row.active, residual));
        }
    }

    /// Calls `f` for each active constraint of a lane, with its coordinates, its residual, m/s, and its normal impulse, N s.
    pub(crate) fn for_each_load(
        &self,
        rows: &T,
        impulses: &[R],
        w: &[R],
        lane: usize,
        f: &mut impl FnMut(&mut dyn Iterator<Item = u32>, f64, f64),
    ) {
        for (i, row) in rows.items().iter().enumerate().filter(|(_, row)| has_lane::<R>(row.active, lane)) {
            let lambda = &impulses[row.rows()];
            let residual = rows.residual(i, self.entries(row), w, lambda, self.eliminated > 0);
            f(&mut self.columns_in(row, lane), number_of(residual, lane), number_of(lambda[0].abs(), lane));
        }
    }

    /// Sum of `sum` and the magnitudes of all normal impulses, N s.
    #[inline(always)]
    pub(crate) fn sum_normal_impulses(&self, rows: &T, impulses: &[R], mut sum: R) -> R {
        for row in rows.items() {
            sum += masked(row.active, impulses[row.rows().start].abs());
        }
        sum
    }

    /// Sum of `sum` and the potential `g . lambda + R lambda^2 / 2` of all impulses lambda, J. Here g are the offsets of the velocity solve
    /// and R the compliances.
    #[inline(always)]
    pub(crate) fn add_potential(&self, impulses: &[R], mut sum: R) -> R {
        for (i, row) in self.iter().enumerate() {
            sum = self.rows.add_potential(i, &impulses[row.rows()], sum);
        }
        sum
    }

    /// Changes the offsets of all rows after a change of the free velocity. The offsets of the velocity solve and of
    /// the position solve change. `change` is the change of the free velocity, in the scaled coordinates of w (scaled velocity change).
    /// Each offset increases by the row's velocity due to this change.
    #[inline(always)]
    pub(crate) fn shift(&mut self, change: &[R]) {
        for i in 0..self.len() {
            let entries = (&self.columns[self[i].columns()], self.y.range(self[i].entries()));
            self.rows.shift(i, entries, change);
        }
    }

    /// Damps the position targets of all rows that are not eliminated by a compliance, see
    /// [`PositionRows::damp`](crate::PositionRows::damp). The compliance acts on the difference from `impulses`. These impulses therefore
    /// cause no additional velocity.
    ///
    /// `added_mobilities` has a number for each constraint, 1/kg, which is added to the mobility of a contact. The function appends the
    /// normal row of each constraint to `reference`.
    #[inline(always)]
    pub(crate) fn damp(
        &self,
        rows: &mut T,
        impulses: &[R],
        damping: Damping<R>,
        added_mobilities: &[R],
        reference: &mut Vec<ReferenceRow<R>>,
    ) {
        for (i, &added) in added_mobilities.iter().enumerate() {
            let lambda = &impulses[rows.items()[i].rows()];
            reference.push(ReferenceRow { lambda: lambda[0], g: rows.offsets(i)[0][0] + rows.damping_deficit(i) });
            // Eliminated rows are damped at assembly, because other rows are combined with them.
            if i >= self.eliminated {
                rows.damp(i, lambda, damping, added);
            }
        }
    }

    /// Calls `f` with the velocity by which damping prevents the normal row of each constraint from meeting its target, m/s or rad/s.
    /// `reference` has the normal rows of the reference solution, at whose impulses damping causes no velocity.
    #[inline(always)]
    pub(crate) fn for_each_shortfall(&self, rows: &T, impulses: &[R], reference: &[ReferenceRow<R>], mut f: impl FnMut(R)) {
        for (i, (row, before)) in rows.items().iter().zip(reference).enumerate() {
            let change = if i < self.eliminated { R::zero() } else { impulses[row.rows().start] - before.lambda };
            f(masked(row.active, rows.shortfall(i, change)));
        }
    }

    /// Calls `f` with the target of each constraint that no impulse can move, m/s or rad/s; 0 for the others.
    #[inline(always)]
    pub(crate) fn for_each_immovable_target(&self, rows: &T, mut f: impl FnMut(R)) {
        for (i, row) in rows.items().iter().enumerate() {
            f(masked(row.immovable, rows.unmet(i, rows.damping_deficit(i), rows.offsets(i)[0][0])));
        }
    }

    /// Calls `f` with the target velocity of each constraint that no impulse can move, without position corrections, m/s or rad/s; 0 for
    /// the others.
    #[inline(always)]
    pub(crate) fn for_each_unmet_velocity(&self, rows: &T, mut f: impl FnMut(R)) {
        for (i, row) in rows.items().iter().enumerate() {
            let [g, position_g] = rows.offsets(i);
            f(masked(row.immovable, rows.unmet(i, g[0].abs().min(position_g[0].abs()), g[0].max(position_g[0]))));
        }
    }

    /// Adds the constraints of this kind to a proof of infeasibility, see [`System::witness`](crate::System::witness).
    ///
    /// Let z be the impulses beyond the reference, and u the velocities by which the rows miss their targets under the impulses of the
    /// reference. The function adds the scaled momentum J^T z to `momentum`, and returns `missing_work` - z . u, J.
    #[inline(always)]
    pub(crate) fn witness(
        &self,
        rows: &T,
        impulses: &[R],
        reference: &[ReferenceRow<R>],
        w: &[R],
        momentum: &mut [R],
        mut missing_work: R,
    ) -> R {
        for (i, (row, before)) in rows.items().iter().zip(reference).enumerate() {
            let z = rows.witness(i, impulses[row.rows().start], before.lambda);
            let (columns, y) = self.entries(row);
            let u = rows.normal_velocity(i, (columns, y), w) - rows.offsets(i)[0][0] + before.g;
            missing_work -= z * u;
            for (&c, y) in columns.iter().zip(y.chunks_exact(row.span.num_rows)) {
                momentum[c as usize] += y[0] * z;
            }
        }
        missing_work
    }
}

impl<R: Real, T: ConstraintList<R>, I: SliceIndex<[T::Item]>> Index<I> for ConstraintSet<R, T> {
    type Output = I::Output;

    #[inline(always)]
    fn index(&self, i: I) -> &I::Output {
        &self.rows.items()[i]
    }
}

/// Adds the product J^T x to `out`, for the rows J of one constraint, which have the entries `y` at the coordinates `columns`.
#[inline(always)]
pub(crate) fn add_transposed<R: Real, const N: usize>(columns: &[u32], y: &[[R; N]], x: [R; N], out: &mut [R]) {
    for (&c, y) in columns.iter().zip(y) {
        let mut sum = y[0] * x[0];
        for k in 1..N {
            sum += y[k] * x[k];
        }
        out[c as usize] += sum;
    }
}

/// Product J w of the rows J of one contact, which have the entries `y` at the coordinates `columns`.
#[inline(always)]
pub(crate) fn multiply<R: Real, const N: usize>(columns: &[u32], y: &[[R; N]], w: &[R]) -> [R; N] {
    let mut v = [R::zero(); N];
    for (&c, y) in columns.iter().zip(y) {
        let w = w[c as usize];
        for k in 0..N {
            v[k] += y[k] * w;
        }
    }
    v
}

/// Whether a mask has the lane `lane`.
#[inline(always)]
pub(crate) fn has_lane<R: Real>(mask: R::Mask, lane: usize) -> bool {
    mask.bits() >> lane & 1 == 1
}

/// Whether `d` is nonzero in any lane.
///
/// Many limits and contacts remain open from sweep to sweep. Adding their zeros would change nothing, because no sum is ever -0.
#[inline(always)]
pub(crate) fn is_nonzero<R: Real>(d: R) -> bool {
    !d.eq(R::zero()).all()
}

/// Number of `x` in lane `lane`, as f64.
#[inline(always)]
pub(crate) fn number_of<R: Real>(x: R, lane: usize) -> f64 {
    x.lane(lane).to_f64()
}
