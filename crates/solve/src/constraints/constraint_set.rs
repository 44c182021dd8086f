//! Set of the constraints of one kind, and the operations that each kind implements for one constraint.
//!
//! The operations are for the residual, Newton's method and the position solve.

use std::fmt::Debug;
use std::ops::{Index, IndexMut};
use std::slice::SliceIndex;

use crate::admissible_set::AdmissibleSet;
use crate::capacity::Capacity;
use crate::cone::masked;
use crate::entries::Entries;
use serde::{Deserialize, Serialize};
use stepper_real::{Mask, Real, Scalar};

/// Rows of all constraints of one kind in one solve, with their offsets g and compliances.
#[derive(Clone, Debug)]
pub struct Rows<T> {
    /// Rows of each constraint of one kind.
    pub(crate) items: Vec<T>,
    /// Whether any constraint of the list may have a compliance, so that the solver must read it.
    pub(crate) compliant: bool,
}

impl<T> Default for Rows<T> {
    fn default() -> Self {
        Self { items: Vec::new(), compliant: false }
    }
}

impl<T: Copy> Rows<T> {
    /// Empty list with capacity for `constraints` constraints.
    pub(crate) fn with_capacity(constraints: usize) -> Self {
        Self { items: Vec::with_capacity(constraints), compliant: false }
    }

    /// Removes all rows.
    #[inline(always)]
    pub(crate) fn clear(&mut self) {
        self.items.clear();
        self.compliant = false;
    }

    /// Exchanges the two offsets of every row in the lanes `lanes`: that of the velocity solve and that of the position solve.
    #[inline(always)]
    pub(crate) fn exchange_offsets<R: Real>(&mut self, lanes: R::Mask)
    where
        T: Row<R>,
    {
        for row in &mut self.items {
            row.exchange_offsets(lanes);
        }
    }

    /// Replaces the rows by copies of others, without allocation if the capacity suffices.
    #[inline(always)]
    pub(crate) fn copy(&mut self, from: &Self) {
        self.items.clear();
        self.items.extend_from_slice(&from.items);
        self.compliant = from.compliant;
    }
}

/// Reference to the rows of all constraints of one kind.
pub(crate) type RowsRef<'a, T> = &'a Rows<T>;

/// Impulses of all constraints of one kind.
pub(crate) type Impulses<R, T> = Vec<<T as Row<R>>::Impulse>;

/// Impulse of one constraint: a number for each of its rows, N s or N m s. The Jacobian entries of the rows at one coordinate have the same
/// type.
pub trait Impulse<R: Real>: Copy + Debug {
    /// Number of rows of the constraint.
    const ROWS: usize;
    /// Numbers of all rows in one lane.
    type Numbers: AsRef<[f64]>;

    /// Impulse `normal` in the normal row, and zero in every other row.
    fn of_normal(normal: R) -> Self;

    /// Impulse of the normal row, or of the only row.
    fn normal(self) -> R;

    /// Scalar product of two impulses: the sum of the products over the rows.
    fn dot(self, other: Self) -> R;

    /// Numbers of the rows in the lane `lane`.
    fn numbers(self, lane: usize) -> Self::Numbers;

    /// Numbers of all impulses as a flat list, constraint by constraint.
    fn flatten(impulses: &[Self]) -> &[R];

    /// Numbers of all impulses as a flat, mutable list, constraint by constraint.
    fn flatten_mut(impulses: &mut [Self]) -> &mut [R];

    /// Impulse of zero in every row.
    #[inline(always)]
    fn zero() -> Self {
        Self::of_normal(R::zero())
    }
}

impl<R: Real> Impulse<R> for R {
    const ROWS: usize = 1;
    type Numbers = [f64; 1];

    #[inline(always)]
    fn of_normal(normal: R) -> Self {
        normal
    }

    #[inline(always)]
    fn normal(self) -> R {
        self
    }

    #[inline(always)]
    fn dot(self, other: Self) -> R {
        self * other
    }

    fn numbers(self, lane: usize) -> [f64; 1] {
        [number_of(self, lane)]
    }

    #[inline(always)]
    fn flatten(impulses: &[Self]) -> &[R] {
        impulses
    }

    #[inline(always)]
    fn flatten_mut(impulses: &mut [Self]) -> &mut [R] {
        impulses
    }
}

impl<R: Real, const N: usize> Impulse<R> for [R; N] {
    const ROWS: usize = N;
    type Numbers = [f64; N];

    #[inline(always)]
    fn of_normal(normal: R) -> Self {
        let mut impulse = [R::zero(); N];
        impulse[0] = normal;
        impulse
    }

    #[inline(always)]
    fn normal(self) -> R {
        self[0]
    }

    #[inline(always)]
    fn dot(self, other: Self) -> R {
        let mut sum = self[0] * other[0];
        for k in 1..N {
            sum += self[k] * other[k];
        }
        sum
    }

    fn numbers(self, lane: usize) -> [f64; N] {
        self.map(|x| number_of(x, lane))
    }

    #[inline(always)]
    fn flatten(impulses: &[Self]) -> &[R] {
        impulses.as_flattened()
    }

    #[inline(always)]
    fn flatten_mut(impulses: &mut [Self]) -> &mut [R] {
        impulses.as_flattened_mut()
    }
}

/// Place of a constraint's coordinates and Jacobian entries in the lists of its set.
#[derive(Clone, Copy, Debug, Default)]
pub struct Span {
    /// Index of the first coordinate in the list of coordinates.
    pub(super) first_column: usize,
    /// Index of the first Jacobian entry in the list of entries.
    pub(super) y: usize,
    /// Number of coordinates at which the constraint has Jacobian entries.
    pub(super) num_columns: usize,
}

/// Rows of one constraint, with an offset for the velocity solve and one for the position solve.
pub trait Row<R: Real>: Copy + Debug {
    /// Impulse of the constraint: a number, or an array with one for each row of a contact.
    type Impulse: Impulse<R>;

    /// Largest number of Jacobian entries of `constraints` constraints of this kind, from the numbers in `capacity`.
    fn num_entries(constraints: usize, capacity: &Capacity) -> usize;

    /// Placeholder for a constraint that exists in no lane. All fields are overwritten before use.
    fn blank() -> Self;

    /// Place of the coordinates and Jacobian entries.
    fn span(&self) -> Span;

    /// Lanes in which the solver reads the constraint: it exists there, an impulse can move it, and it is not deferred.
    fn active(&self) -> R::Mask;

    /// Lanes in which no impulse can move the constraint, along its normal if it is a contact.
    fn immovable(&self) -> R::Mask;

    /// Offset g of each row in the velocity solve, and stored offset for the position solve, m/s or rad/s. The stored offset of a contact's
    /// tangential row is the difference between the offsets of both solves.
    fn offsets(&self) -> [Self::Impulse; 2];

    /// Exchanges the two offsets of each row in the lanes `lanes`: the offset g of the present solve, and the stored one of the other.
    fn exchange_offsets(&mut self, lanes: R::Mask);

    /// Admissible impulses and compliances of the constraint in the lane `lane`, for Newton's method.
    fn lane_constraint(&self, lane: usize) -> LaneConstraint;

    /// Constraint of the lane `lane` as a file stores it. The caller adds the fields that are the same for all kinds, such as the entries
    /// and offsets.
    fn save(&self, lane: usize) -> SavedConstraint;

    /// Velocity y . w + g of each row at the scaled velocity change `w`, m/s or rad/s. The rows have the entries `y` at the coordinates
    /// `columns`. The velocity due to the compliance is not included.
    fn velocity(&self, columns: &[u32], y: &[Self::Impulse], w: &[R]) -> Self::Impulse;

    /// Sum of the velocity `v` of each row and the velocity R lambda due to its compliance R, m/s or rad/s. `compliant` is whether any
    /// constraint of the list may have a compliance. If it is false, contacts return `v`.
    fn add_compliance(&self, v: Self::Impulse, compliant: bool, lambda: Self::Impulse) -> Self::Impulse;

    /// Compliance that all rows of the constraint have, 1/kg, without the additional compliance of a contact's normal.
    fn uniform_compliance(&self) -> R;

    /// Residual |lambda - P_K(lambda - rho u)| / rho of the natural map, m/s. The velocity u is `v`, for a contact with De Saxce's term mu
    /// |v_t| in the normal row. `has_eliminated` is whether the set has eliminated rows.
    fn residual(&self, v: Self::Impulse, lambda: Self::Impulse, has_eliminated: bool) -> R;

    /// Magnitude of the normal impulse, N s.
    fn normal_impulse(lambda: Self::Impulse) -> R;

    /// Sum of `sum` and the potential `g . lambda + R lambda^2 / 2` of the impulse lambda, J. R is the compliance.
    fn add_potential(&self, lambda: Self::Impulse, sum: R) -> R;

    /// Replaces the offset of each row in the velocity solve by `moved`. The row's offset in the position solve
    /// changes by the same amount. (A contact's tangential offsets of the position solve are relative to those of the velocity solve, and
    /// remain.)
    fn shift(&mut self, moved: Self::Impulse);

    /// Offset of the normal row without damping, m/s or rad/s.
    fn undamped_offset(&self) -> R;

    /// Adds a compliance that damps the position targets of the rows. It acts on the difference from the impulse `lambda`: this impulse
    /// itself causes no additional velocity. For a contact, `added_mobility`, 1/kg, is added to the mobility that scales the compliance.
    /// Scalar rows ignore it.
    fn damp(&mut self, lambda: Self::Impulse, damping: Damping<R>, added_mobility: R);

    /// Velocity by which damping prevents the normal row from meeting its target, m/s or rad/s. `change` is the change of the row's
    /// impulse since the reference solution, and zero for an eliminated row.
    fn shortfall(&self, change: R) -> R;

    /// Target velocity that the normal row misses in lanes in which no impulse can move it, m/s or rad/s. The caller ignores the other
    /// lanes.
    fn immovable_target(&self) -> R;

    /// Target velocity that the normal row misses in lanes in which no impulse can move it, without the part that corrects a position
    /// error, m/s or rad/s. The caller ignores the other lanes.
    fn unmet_velocity(&self) -> R;

    /// Impulse of the normal row in a proof of infeasibility, N s or N m s: the change from `before`, the impulse of the reference
    /// solution, to `now`.
    ///
    /// The impulse is 0 for rows that cannot be in a proof (dry friction, and rows with the compliance of a spring). A decrease counts for
    /// equalities only.
    fn witness(&self, now: R, before: R) -> R;
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

/// Unknowns that a sweep over one kind of constraint changes.
pub(crate) struct Unknowns<'a, R, I> {
    /// Impulse of each constraint of one kind.
    pub(crate) impulses: &'a mut [I],
    /// Multiplier of the friction disc of each contact (slip velocity divided by friction impulse, 1/kg), from which its next local
    /// solution starts. Empty for kinds without contacts.
    pub(crate) multipliers: &'a mut [R],
    /// Scaled velocity change w by all impulses, in coordinates in which its kinetic energy is |w|^2 / 2.
    pub(crate) w: &'a mut [R],
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

/// Normal impulses and offsets of a reference solution, for one kind of constraint.
#[derive(Clone, Copy)]
pub(crate) struct ReferenceRows<'a, R> {
    /// Normal impulse of each constraint, N s or N m s.
    pub(crate) lambda: &'a [R],
    /// Offset g of each normal row without damping, m/s or rad/s: its velocity before any impulse, plus its bias (minus the target
    /// velocity).
    pub(crate) g: &'a [R],
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
    /// Whether a problem with `dimension` coordinates can have this constraint, with `rows` rows.
    pub(crate) fn is_sound(&self, dimension: usize, rows: usize) -> bool {
        let lists = [&self.g, &self.position_g, &self.impulse];
        let numbers = lists.into_iter().flatten().chain(&self.y).chain([&self.mobility, &self.damping_deficit]);
        lists.iter().all(|list| list.len() == rows)
            && self.y.len() == rows * self.columns.len()
            && self.columns.is_sorted_by(|a, b| a < b)
            && self.columns.last().is_none_or(|&last| (last as usize) < dimension)
            && numbers.copied().all(f64::is_finite)
            && self.set[0] <= self.set[1]
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
/// its methods. Methods that compute a sum or a maximum over all kinds get the result of the previous kinds as an argument. Every sum
/// therefore has the order of the rows.
#[derive(Clone, Debug)]
pub struct ConstraintSet<R: Real, T: Row<R>> {
    /// Rows of each constraint, with the offsets g of the velocity solve.
    pub(crate) rows: Rows<T>,
    /// Coordinates at which the constraints have Jacobian entries, one constraint after the other.
    columns: Vec<u32>,
    /// Entries of the scaled Jacobian, for all rows of a constraint, at the coordinates in `columns`.
    pub(super) y: Entries<T::Impulse>,
    /// Number of eliminated rows, which come first in the list, see [`ScalarRows::mark_eliminated`](crate::ScalarRows::mark_eliminated).
    pub(crate) eliminated: usize,
}

impl<R: Real, T: Row<R>> ConstraintSet<R, T> {
    /// Empty set with capacity for `constraints` constraints.
    pub(crate) fn new(constraints: usize, capacity: &Capacity) -> Self {
        let entries = T::num_entries(constraints, capacity);
        Self {
            rows: Rows::with_capacity(constraints),
            columns: Vec::with_capacity(entries),
            y: Entries::with_capacity(entries, Impulse::zero()),
            eliminated: 0,
        }
    }

    /// Number of constraints.
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.rows.items.len()
    }

    /// Whether there is no constraint.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.rows.items.is_empty()
    }

    /// Iterator over the constraints.
    #[inline(always)]
    pub fn iter(&self) -> std::slice::Iter<'_, T> {
        self.rows.items.iter()
    }

    /// Coordinates of a constraint, and the entries of its rows at each.
    #[inline(always)]
    pub fn entries(&self, row: &T) -> (&[u32], &[T::Impulse]) {
        let Span { first_column, y, num_columns } = row.span();
        (&self.columns[first_column..first_column + num_columns], self.y.row(y, num_columns))
    }

    /// Velocity y . w + g of each row of a constraint at the scaled velocity change `w`, m/s or rad/s: y is the scaled Jacobian, and g
    /// the offset of the row (velocity before any impulse, plus bias). The velocity due to the compliance is not included.
    #[inline(always)]
    pub fn velocity(&self, row: &T, w: &[R]) -> T::Impulse {
        let (columns, y) = self.entries(row);
        row.velocity(columns, y, w)
    }

    /// Velocity of each row of a constraint under the impulse `lambda`, including the velocity due to the compliance, m/s or rad/s.
    /// `compliant` is whether any constraint of the list may have a compliance.
    #[inline(always)]
    pub(super) fn velocity_under(&self, row: &T, compliant: bool, w: &[R], lambda: T::Impulse) -> T::Impulse {
        row.add_compliance(self.velocity(row, w), compliant, lambda)
    }

    /// Adds the scaled velocity change by the impulse `d` of a constraint to `w`.
    #[inline(always)]
    pub fn add(&self, row: &T, d: T::Impulse, w: &mut [R]) {
        let (columns, y) = self.entries(row);
        add_transposed(columns, y, d, w);
    }

    /// Appends the coordinates `columns` and their entries `y`. Returns their place. `visit` is called with each entry.
    #[inline(always)]
    pub(super) fn push_entries(&mut self, columns: &[u32], y: impl Fn(usize) -> T::Impulse, mut visit: impl FnMut(T::Impulse)) -> Span {
        let span = Span { first_column: self.columns.len(), y: self.y.len(), num_columns: columns.len() };
        self.columns.extend_from_slice(columns);
        for (entry, &c) in self.y.extend_by(columns.len()).iter_mut().zip(columns) {
            *entry = y(c as usize);
            visit(*entry);
        }
        span
    }

    /// Removes the constraint with the index `first` and all constraints after it.
    pub fn truncate(&mut self, first: usize) {
        if let Some(row) = self.rows.items.get(first) {
            let Span { first_column, y, .. } = row.span();
            self.columns.truncate(first_column);
            self.y.truncate(y);
            self.rows.items.truncate(first);
        }
    }

    /// Removes all constraints.
    #[inline(always)]
    pub(crate) fn clear(&mut self) {
        self.rows.clear();
        self.columns.clear();
        self.y.clear();
        self.eliminated = 0;
    }

    /// Calls `f` for each constraint that is active in a lane ([`Row::active`]). `f` gets an iterator over the coordinates at which this
    /// constraint has entries in the lane, ascending.
    pub(crate) fn for_each_column_set(&self, rows: &Rows<T>, lane: usize, f: &mut impl FnMut(&mut dyn Iterator<Item = u32>)) {
        for row in rows.items.iter().filter(|row| has_lane::<R>(row.active(), lane)) {
            f(&mut self.columns_in(row, lane));
        }
    }

    /// Iterator over the coordinates at which a constraint has entries in a lane, ascending.
    fn columns_in(&self, row: &T, lane: usize) -> impl Iterator<Item = u32> {
        let (columns, y) = self.entries(row);
        let touches = move |y: &T::Impulse| y.numbers(lane).as_ref().iter().any(|&y| y != 0.0);
        columns.iter().zip(y).filter(move |(_, y)| touches(y)).map(|(c, _)| *c)
    }

    /// Constraints of a lane, with their impulses, as a file stores them. Deferred contacts are left out.
    pub(crate) fn save(&self, rows: &Rows<T>, impulses: &[T::Impulse], lane: usize) -> Vec<SavedConstraint> {
        let exists = |row: &T| has_lane::<R>(row.active(), lane) || has_lane::<R>(row.immovable(), lane);
        let there = rows.items.iter().zip(impulses).enumerate().filter(|(_, (row, _))| exists(row));
        let save = |(i, (row, &impulse)): (usize, (&T, &T::Impulse))| {
            let (columns, y) = self.entries(row);
            let [g, position_g, impulse] = [row.offsets()[0], row.offsets()[1], impulse].map(|x| x.numbers(lane).as_ref().to_vec());
            SavedConstraint {
                columns: columns.to_vec(),
                y: Impulse::<R>::flatten(y).iter().map(|&y| number_of(y, lane)).collect(),
                g,
                position_g,
                impulse,
                eliminated: i < self.eliminated,
                immovable: has_lane::<R>(row.immovable(), lane),
                ..row.save(lane)
            }
        };
        there.map(save).collect()
    }

    /// Adds the scaled velocity change by all impulses to `w`.
    #[inline(always)]
    pub(crate) fn add_impulses(&self, impulses: &[T::Impulse], w: &mut [R]) {
        for (row, &lambda) in self.rows.items.iter().zip(impulses) {
            self.add(row, lambda, w);
        }
    }

    /// Appends the velocities of all rows at the scaled velocity change `w`, m/s or rad/s. They include the velocity due to each row's
    /// compliance.
    #[inline(always)]
    pub(crate) fn velocities(&self, rows: &Rows<T>, impulses: &[T::Impulse], w: &[R], out: &mut Vec<R>) {
        for (row, &lambda) in rows.items.iter().zip(impulses) {
            let v = self.velocity_under(row, rows.compliant, w, lambda);
            out.extend_from_slice(Impulse::<R>::flatten(&[v]));
        }
    }

    /// Appends the compliance of each row, without the additional compliance of contact normals.
    pub(crate) fn compliances(&self, rows: &Rows<T>, out: &mut Vec<R>) {
        out.extend(rows.items.iter().flat_map(|row| std::iter::repeat_n(row.uniform_compliance(), T::Impulse::ROWS)));
    }

    /// Calls `f` with the natural-map residual |lambda - P_K(lambda - rho u)| / rho of each constraint in turn, m/s; 0 for constraints that
    /// are not active. See [`residual`](crate::residual()).
    #[inline(always)]
    pub(crate) fn for_each_residual(&self, rows: &Rows<T>, impulses: &[T::Impulse], w: &[R], mut f: impl FnMut(R)) {
        for (row, &lambda) in rows.items.iter().zip(impulses) {
            let v = self.velocity_under(row, rows.compliant, w, lambda);
            f(masked(row.active(), row.residual(v, lambda, self.eliminated > 0)));
        }
    }

    /// Calls `f` for each active constraint of a lane, with its coordinates, its residual, m/s, and its normal impulse, N s.
    pub(crate) fn for_each_load(
        &self,
        rows: &Rows<T>,
        impulses: &[T::Impulse],
        w: &[R],
        lane: usize,
        f: &mut impl FnMut(&mut dyn Iterator<Item = u32>, f64, f64),
    ) {
        for (row, &lambda) in rows.items.iter().zip(impulses).filter(|(row, _)| has_lane::<R>(row.active(), lane)) {
            let v = self.velocity_under(row, rows.compliant, w, lambda);
            let (residual, impulse) = (row.residual(v, lambda, self.eliminated > 0), T::normal_impulse(lambda));
            f(&mut self.columns_in(row, lane), number_of(residual, lane), number_of(impulse, lane));
        }
    }

    /// Sum of `sum` and the magnitudes of all normal impulses, N s.
    #[inline(always)]
    pub(crate) fn sum_normal_impulses(&self, rows: &Rows<T>, impulses: &[T::Impulse], mut sum: R) -> R {
        for (row, &lambda) in rows.items.iter().zip(impulses) {
            sum += masked(row.active(), T::normal_impulse(lambda));
        }
        sum
    }

    /// Sum of `sum` and the potential `g . lambda + R lambda^2 / 2` of all impulses lambda, J. Here g are the offsets of the velocity solve
    /// and R the compliances.
    #[inline(always)]
    pub(crate) fn add_potential(&self, impulses: &[T::Impulse], mut sum: R) -> R {
        for (row, &lambda) in self.rows.items.iter().zip(impulses) {
            sum = row.add_potential(lambda, sum);
        }
        sum
    }

    /// Changes the offsets of all rows after a change of the free velocity. The offsets of the velocity solve and of
    /// the position solve change. `change` is the change of the free velocity, in the scaled coordinates of w (scaled velocity change).
    /// Each offset increases by the row's velocity due to this change.
    #[inline(always)]
    pub(crate) fn shift(&self, rows: &mut Rows<T>, change: &[R]) {
        for row in &mut rows.items {
            row.shift(self.velocity(row, change));
        }
    }

    /// Damps the position targets of all rows that are not eliminated by a compliance, see
    /// [`PositionRows::damp`](crate::PositionRows::damp). The compliance acts on the difference from `impulses`. These impulses therefore
    /// cause no additional velocity.
    ///
    /// `added_mobilities` has a number for each constraint, 1/kg, which is added to the mobility of a contact. The function appends the
    /// normal impulse of each constraint to `reference_lambda`, and the undamped offset of each normal row to `reference_g`.
    #[inline(always)]
    pub(crate) fn damp(
        &self,
        rows: &mut Rows<T>,
        impulses: &[T::Impulse],
        damping: Damping<R>,
        added_mobilities: &[R],
        [reference_lambda, reference_g]: [&mut Vec<R>; 2],
    ) {
        for (k, ((row, &lambda), &added)) in rows.items.iter_mut().zip(impulses).zip(added_mobilities).enumerate() {
            reference_lambda.push(lambda.normal());
            reference_g.push(row.undamped_offset());
            // Eliminated rows are damped at assembly, because other rows are combined with them.
            if k >= self.eliminated {
                row.damp(lambda, damping, added);
            }
        }
        rows.compliant = true;
    }

    /// Calls `f` with the velocity by which damping prevents the normal row of each constraint from meeting its target, m/s or rad/s.
    /// `before` has the normal impulses of the reference solution, at which damping causes no velocity.
    #[inline(always)]
    pub(crate) fn for_each_shortfall(&self, rows: &Rows<T>, impulses: &[T::Impulse], before: &[R], mut f: impl FnMut(R)) {
        for (k, ((row, now), &before)) in rows.items.iter().zip(impulses).zip(before).enumerate() {
            let change = if k < self.eliminated { R::zero() } else { now.normal() - before };
            f(masked(row.active(), row.shortfall(change)));
        }
    }

    /// Calls `f` with the target of each constraint that no impulse can move, m/s or rad/s; 0 for the others.
    #[inline(always)]
    pub(crate) fn for_each_immovable_target(&self, rows: &Rows<T>, mut f: impl FnMut(R)) {
        for row in &rows.items {
            f(masked(row.immovable(), row.immovable_target()));
        }
    }

    /// Calls `f` with the target velocity of each constraint that no impulse can move, without position corrections, m/s or rad/s; 0 for
    /// the others.
    #[inline(always)]
    pub(crate) fn for_each_unmet_velocity(&self, rows: &Rows<T>, mut f: impl FnMut(R)) {
        for row in &rows.items {
            f(masked(row.immovable(), row.unmet_velocity()));
        }
    }

    /// Adds the constraints of this kind to a proof of infeasibility, see [`System::witness`](crate::System::witness).
    ///
    /// Let z be the impulses beyond the reference, and u the velocities by which the rows miss their targets under the impulses of the
    /// reference. The function adds the scaled momentum J^T z to `momentum`, and returns `missing_work` - z . u, J.
    #[inline(always)]
    pub(crate) fn witness(
        &self,
        rows: &Rows<T>,
        impulses: &[T::Impulse],
        reference: ReferenceRows<'_, R>,
        w: &[R],
        momentum: &mut [R],
        mut missing_work: R,
    ) -> R {
        for ((row, now), (&before, &g)) in rows.items.iter().zip(impulses).zip(reference.lambda.iter().zip(reference.g)) {
            let z = row.witness(now.normal(), before);
            let u = self.velocity(row, w).normal() - row.offsets()[0].normal() + g;
            missing_work -= z * u;
            self.add(row, Impulse::of_normal(z), momentum);
        }
        missing_work
    }
}

impl<R: Real, T: Row<R>, I: SliceIndex<[T]>> Index<I> for ConstraintSet<R, T> {
    type Output = I::Output;

    #[inline(always)]
    fn index(&self, i: I) -> &I::Output {
        &self.rows.items[i]
    }
}

impl<R: Real, T: Row<R>, I: SliceIndex<[T]>> IndexMut<I> for ConstraintSet<R, T> {
    #[inline(always)]
    fn index_mut(&mut self, i: I) -> &mut I::Output {
        &mut self.rows.items[i]
    }
}

/// Adds the product J^T x to `out`, for the rows J of one constraint, which have the entries `y` at the coordinates `columns`.
#[inline(always)]
pub(crate) fn add_transposed<R: Real, I: Impulse<R>>(columns: &[u32], y: &[I], x: I, out: &mut [R]) {
    for (&c, &y) in columns.iter().zip(y) {
        out[c as usize] += y.dot(x);
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
