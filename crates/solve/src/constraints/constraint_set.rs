//! Operations that each kind of constraint implements: in a sweep, in the residual, in lane compaction, in Newton's method and in the
//! position solve.

use crate::admissible_set::AdmissibleSet;
use crate::capacity::Capacity;
use crate::lane_map::LaneMap;
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

impl<T: Row> Rows<T> {
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

    /// Exchanges the two offsets of every row: that of the velocity solve and that of the position solve.
    #[inline(always)]
    pub(crate) fn exchange_offsets(&mut self) {
        for row in &mut self.items {
            row.exchange_offsets();
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

/// Impulse of one constraint: a number for each of its rows, N s or N m s.
pub trait Impulse<R: Real>: Copy {
    /// Number of rows of the constraint.
    const ROWS: usize;

    /// Impulse of zero in every row.
    fn zero() -> Self;

    /// Numbers of all impulses as a flat list, constraint by constraint.
    fn flatten(impulses: &[Self]) -> &[R];

    /// Numbers of all impulses as a flat, mutable list, constraint by constraint.
    fn flatten_mut(impulses: &mut [Self]) -> &mut [R];
}

impl<R: Real> Impulse<R> for R {
    const ROWS: usize = 1;

    #[inline(always)]
    fn zero() -> Self {
        R::zero()
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

    #[inline(always)]
    fn zero() -> Self {
        [R::zero(); N]
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

/// Rows of one constraint, with an offset for the velocity solve and one for the position solve.
pub trait Row: Copy {
    /// Exchanges the two offsets of each row: the offset g, with which the row is solved, and the stored offset of the other solve.
    fn exchange_offsets(&mut self);
}

/// Lanes that take part in a sweep (one Gauss-Seidel iteration).
#[derive(Clone, Copy)]
pub struct SweepLanes<R: Real> {
    /// Lanes whose impulses change in the sweep.
    pub(crate) running: R::Mask,
    /// Lanes in which a contact's local problem is solved exactly. The other lanes use the weaker update of
    /// [`LocalSolver::relax`](crate::LocalSolver::relax).
    pub(crate) exact: R::Mask,
}

/// Unknowns that a sweep over one kind of constraint changes.
pub struct Unknowns<'a, R, I> {
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
pub struct ReferenceRows<'a, R> {
    /// Normal impulse of each constraint, N s or N m s.
    pub(crate) lambda: &'a [R],
    /// Offset g of each normal row without damping, m/s or rad/s: its velocity before any impulse, plus its bias (minus the target
    /// velocity).
    pub(crate) g: &'a [R],
}

/// One constraint of one lane with `N` rows, in scalar f64.
pub struct LaneConstraint<const N: usize> {
    /// Set of the constraint's admissible impulses.
    pub(crate) set: AdmissibleSet,
    /// Index of the constraint among the constraints of its kind.
    pub(crate) source: usize,
    /// Offset g of each row, m/s: its velocity before any impulse, plus its bias (minus the target velocity).
    pub(crate) g: [f64; N],
    /// Impulse of each row of the constraint, N s.
    pub(crate) lambda: [f64; N],
    /// Compliance R >= 0 of each row of the constraint, 1/kg: it is added to the diagonal of the Delassus matrix G.
    pub(crate) compliance: f64,
    /// Additional compliance of the constraint's first row, 1/kg.
    pub(crate) normal_compliance: f64,
    /// Ratio of trace(G_ii) before elimination of equality rows to that after it, at least 1. G_ii is the constraint's block of the
    /// Delassus matrix.
    pub(crate) trace_ratio: f64,
}

/// Receiver of the constraints of one lane, for Newton's method.
pub trait LaneReceiver {
    /// Adds a constraint whose rows have the `entries` at the coordinates `columns`, ascending.
    fn add<const N: usize>(&mut self, constraint: LaneConstraint<N>, columns: &[u32], entries: impl Iterator<Item = [f64; N]>);

    /// Adds the scaled velocity change by the impulse of an eliminated row: `change` at the coordinates `columns`. No other row depends on
    /// it.
    fn add_eliminated(&mut self, columns: &[u32], change: impl Iterator<Item = f64>);
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
    /// Offset of each row in the position solve, m/s or rad/s.
    pub(crate) position_g: Vec<f64>,
    /// Initial impulse of each row, N s or N m s.
    pub(crate) impulse: Vec<f64>,
    /// Least and largest impulse of a scalar row, or the friction coefficient of a contact, twice.
    pub(crate) set: [f64; 2],
    /// Compliance of the normal row of a contact, or of a scalar row, at least 0.
    pub(crate) compliance: f64,
    /// Ratio of trace(G_ii) before elimination of equality rows to that after it, at least 1. G_ii is the constraint's block of the
    /// Delassus matrix.
    pub(crate) trace_ratio: f64,
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
            && (1.0..f64::INFINITY).contains(&self.trace_ratio)
    }

    /// Entry of each row at the coordinate `c`.
    pub(crate) fn entries<R: Real, const N: usize>(&self, c: usize) -> [R; N] {
        let place = self.columns.binary_search(&(c as u32)).map_or(0, |k| k * N);
        std::array::from_fn(|row| R::of(self.y[place + row]))
    }
}

/// Operations of one kind of constraint on all constraints of that kind.
///
/// `self` has the parts that the velocity solve and the position solve share, and `rows` has the other parts for one of these solves.
/// Functions that compute a sum or a maximum over all kinds get the result of the previous kinds as an argument. The order of the
/// arithmetic is therefore that of the rows.
pub trait ConstraintSet<R: Real>: Sized {
    /// Rows of one constraint of this kind.
    type Row: Row;
    /// Impulse of one constraint: a number, or an array with one for each row of a contact.
    type Impulse: Impulse<R>;
    /// Constraints of the same kind in half of the lanes.
    type Half: ConstraintSet<R::Half>;

    /// Empty set with capacity for `constraints` constraints.
    fn new(constraints: usize, capacity: &Capacity) -> Self;

    /// Rows with the offsets of the velocity solve.
    fn rows(&self) -> &Rows<Self::Row>;

    /// Rows with the offsets of the velocity solve, mutable.
    fn rows_mut(&mut self) -> &mut Rows<Self::Row>;

    /// Number of multipliers of friction discs (slip velocity divided by friction impulse) that sweeps store: one per contact.
    fn multipliers(&self) -> usize {
        0
    }

    /// Removes all constraints.
    fn clear(&mut self);

    /// Gathers lanes of all constraints into `out`, whose registers are half as wide. `map` selects the lanes. Only the data that
    /// Gauss-Seidel iterations need are gathered.
    fn gather(&self, rows: &Rows<Self::Row>, map: &LaneMap, out: &mut Self::Half);

    /// Calls `f` for each constraint that exists in a lane. `f` gets an iterator over the coordinates at which this constraint has entries
    /// in the lane, ascending.
    fn for_each_column_set(&self, rows: &Rows<Self::Row>, lane: usize, f: &mut impl FnMut(&mut dyn Iterator<Item = u32>));

    /// Passes all constraints that exist in a lane to the receiver of Newton's method.
    fn gather_lane(&self, rows: &Rows<Self::Row>, impulses: &[Self::Impulse], lane: usize, to: &mut impl LaneReceiver);

    /// Constraints of a lane, with their impulses, as a file stores them.
    fn save(&self, rows: &Rows<Self::Row>, impulses: &[Self::Impulse], lane: usize) -> Vec<SavedConstraint>;

    /// Appends a constraint that was read from a file, with the same numbers in every lane.
    fn load(&mut self, saved: &SavedConstraint);

    /// Replaces the impulses of a lane by a weighted mean of these impulses and the impulses `from`, see
    /// [`Snapshot::blend`](crate::Snapshot::blend).
    fn blend(
        &self,
        rows: &Rows<Self::Row>,
        impulses: &mut [Self::Impulse],
        from: &[Self::Impulse],
        lane: usize,
        weight: &mut impl FnMut(u32) -> f64,
    );

    /// Adds the scaled velocity change by all impulses to `w`.
    fn add_impulses(&self, impulses: &[Self::Impulse], w: &mut [R]);

    /// Makes one Gauss-Seidel iteration over the constraints of this kind: each in turn gets the impulse that solves it at constant other
    /// impulses.
    ///
    /// Returns the larger of `change` and the largest change of a velocity, m/s.
    fn sweep(&self, rows: &Rows<Self::Row>, unknowns: Unknowns<'_, R, Self::Impulse>, lanes: SweepLanes<R>, change: R) -> R;

    /// Appends the velocities of all rows at the scaled velocity change `w`, m/s or rad/s. They include the contribution of the compliance.
    fn velocities(&self, rows: &Rows<Self::Row>, impulses: &[Self::Impulse], w: &[R], out: &mut Vec<R>);

    /// Appends the compliance of each row, without the additional compliance of contact normals.
    fn compliances(&self, rows: &Rows<Self::Row>, out: &mut Vec<R>);

    /// Calls `f` with the natural-map residual |lambda - P_K(lambda - rho u)| / rho of each constraint in turn, m/s, see
    /// [`residual`](crate::residual()).
    fn for_each_residual(&self, rows: &Rows<Self::Row>, impulses: &[Self::Impulse], w: &[R], f: impl FnMut(R));

    /// Sum of `sum` and the magnitudes of all normal impulses, N s.
    fn sum_normal_impulses(&self, rows: &Rows<Self::Row>, impulses: &[Self::Impulse], sum: R) -> R;

    /// Sum of `sum` and the potential `g . lambda + R lambda^2 / 2` of all impulses lambda, J. Here g are the offsets of the velocity solve
    /// and R the compliances.
    fn add_potential(&self, impulses: &[Self::Impulse], sum: R) -> R;

    /// Changes the velocity and position targets of all rows in the lanes `lanes`, after a change of the free velocity. `change` is the
    /// change of the free velocity, in the scaled coordinates of w (scaled velocity change). Each target increases by the row's velocity
    /// due to this change.
    fn shift(&self, rows: &mut Rows<Self::Row>, change: &[R], lanes: R::Mask);

    /// Damps the targets of the rows by a compliance, see [`PositionRows::damp`](crate::PositionRows::damp). The compliance acts on the
    /// difference from the present `impulses`, which therefore cause no additional velocity.
    ///
    /// `floors` has a minimum mobility per constraint, 1/kg. `reference` are two lists, to which the normal impulses and the undamped
    /// targets are appended.
    fn damp(&self, rows: &mut Rows<Self::Row>, impulses: &[Self::Impulse], damping: Damping<R>, floors: &[R], reference: [&mut Vec<R>; 2]);

    /// Larger of `most` and the largest velocity by which damping prevents a normal row from meeting its target, m/s or rad/s. `before` are
    /// the impulses of the reference solution, at which damping causes no velocity.
    fn shortfall(&self, rows: &Rows<Self::Row>, impulses: &[Self::Impulse], before: &[R], most: R) -> R;

    /// Larger of `most` and the largest target of a row that no impulse can move, m/s or rad/s.
    fn immovable_target(&self, rows: &Rows<Self::Row>, most: R) -> R;

    /// Larger of `most` and the largest velocity target, without its position correction, of a row that no impulse can move, m/s or rad/s.
    fn unmet_velocity(&self, rows: &Rows<Self::Row>, most: R) -> R;

    /// Adds the constraints of this kind to a proof of infeasibility, see [`System::witness`](crate::System::witness).
    ///
    /// Let z be the impulses beyond the reference, and u the velocities by which the rows miss their targets under the impulses of the
    /// reference. The function adds the scaled momentum J^T z to `momentum`, and returns `missing_work` - z . u, J.
    fn witness(
        &self,
        rows: &Rows<Self::Row>,
        impulses: &[Self::Impulse],
        reference: ReferenceRows<'_, R>,
        w: &[R],
        momentum: &mut [R],
        missing_work: R,
    ) -> R;
}

/// Whether `d` is nonzero in any lane.
///
/// Many limits and contacts remain open from sweep to sweep. Adding their zeros would change nothing, because no sum is ever -0.
#[inline(always)]
pub(crate) fn is_nonzero<R: Real>(d: R) -> bool {
    !d.eq(R::zero()).all()
}

/// Replaces the number x in the lane `lane` of each entry of `numbers` by y + weight (x - y). Here y is the number in the same lane of the
/// corresponding entry of `from`.
pub(crate) fn blend_lane<R: Real>(numbers: &mut [R], from: &[R], lane: usize, weight: f64) {
    for (number, from) in numbers.iter_mut().zip(from) {
        let [now, from] = [*number, *from].map(|x| number_of(x, lane));
        number.set_lane(lane, Scalar::from_f64(from + weight * (now - from)));
    }
}

/// Number of `x` in lane `lane`, as f64.
#[inline(always)]
pub(crate) fn number_of<R: Real>(x: R, lane: usize) -> f64 {
    x.lane(lane).to_f64()
}
