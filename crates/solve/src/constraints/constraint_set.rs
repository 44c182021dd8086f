//! Operations of a kind of constraint: in a sweep, in the residual, in lane compaction, in Newton's method, in the position solve.

use crate::admissible_set::AdmissibleSet;
use crate::capacity::Capacity;
use crate::lane_map::LaneMap;
use serde::{Deserialize, Serialize};
use stepper_real::{Mask, Real, Scalar};

/// Rows of one kind of constraint in one solve: target velocities, compliances, and the numbers that follow for each constraint alone.
#[derive(Clone, Debug)]
pub struct Rows<T> {
    /// Rows of every constraint.
    pub(crate) items: Vec<T>,
    /// Whether any contact has a compliance.
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

    /// Exchanges the velocity and position targets of all rows.
    #[inline(always)]
    pub(crate) fn exchange_targets(&mut self) {
        for row in &mut self.items {
            row.exchange_targets();
        }
    }

    /// Copies rows, without allocation if the capacity suffices.
    #[inline(always)]
    pub(crate) fn copy(&mut self, from: &Self) {
        self.items.clear();
        self.items.extend_from_slice(&from.items);
        self.compliant = from.compliant;
    }
}

/// Impulse of one constraint: a number for each of its rows.
pub trait Impulse<R: Real>: Copy {
    /// Number of rows.
    const ROWS: usize;

    /// Zero impulse.
    fn zero() -> Self;

    /// Numbers of all impulses, one after the other.
    fn flatten(impulses: &[Self]) -> &[R];

    /// Rows of impulses as a flat list, mutable.
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

/// Rows of one constraint.
pub trait Row: Copy {
    /// Exchanges the targets of the velocity solve for those of the position solve, or back.
    fn exchange_targets(&mut self);
}

/// Lanes that take part in a sweep.
#[derive(Clone, Copy)]
pub struct SweepLanes<R: Real> {
    /// Lanes whose impulses change.
    pub(crate) running: R::Mask,
    /// Lanes in which a contact's local problem is solved exactly. The others make the weaker update.
    pub(crate) exact: R::Mask,
}

/// Unknowns that a sweep over one kind of constraint changes.
pub struct Unknowns<'a, R, I> {
    /// Impulse of every constraint of the kind.
    pub(crate) impulses: &'a mut [I],
    /// Initial value of every contact's local solve: the multiplier of its friction disc. Empty for kinds without one.
    pub(crate) multipliers: &'a mut [R],
    /// Scaled velocity change.
    pub(crate) w: &'a mut [R],
}

/// Damping of position targets.
#[derive(Clone, Copy, Debug)]
pub struct Damping<R> {
    /// Ratio of a row's compliance to its mobility.
    pub ratio: R,
    /// Growth of that ratio per velocity that a contact corrects, s/m.
    pub bending: R,
    /// Correction below which a row counts as not correcting, m/s or rad/s. It is 0, or larger so that rounding does not decide.
    pub negligible: R,
}

/// Normal impulses and targets of a reference solution, for one kind of constraint.
#[derive(Clone, Copy)]
pub struct ReferenceRows<'a, R> {
    /// Normal impulse of every constraint.
    pub(crate) lambda: &'a [R],
    /// Undamped g of every normal row.
    pub(crate) g: &'a [R],
}

/// One constraint of one lane, in scalar f64.
pub struct LaneConstraint<const N: usize> {
    /// Set of its admissible impulses.
    pub(crate) set: AdmissibleSet,
    /// Index in the list of constraints of its kind.
    pub(crate) source: usize,
    /// Velocity of every row before any impulse, with its bias, m/s.
    pub(crate) g: [f64; N],
    /// Impulse of every row, N s.
    pub(crate) lambda: [f64; N],
    /// Compliance R >= 0 on the diagonal of G, the same for all of its rows.
    pub(crate) compliance: f64,
    /// Additional compliance of the first row.
    pub(crate) normal_compliance: f64,
    /// Ratio of trace(G_ii) before elimination of equality rows to that after it, at least 1.
    pub(crate) trace_ratio: f64,
}

/// Receiver of the constraints of one lane.
pub trait LaneReceiver {
    /// Adds a constraint whose rows have the `entries` at the coordinates `support`.
    fn add<const N: usize>(&mut self, constraint: LaneConstraint<N>, support: &[u32], entries: impl Iterator<Item = [f64; N]>);

    /// Adds the scaled velocity change of a row with the `entries`, which no other row depends on.
    fn add_separate(&mut self, support: &[u32], change: impl Iterator<Item = f64>);
}

/// Constraint of one lane, of any kind, as a file stores it. Numbers per row are in the order of the rows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SavedConstraint {
    /// Coordinates of the constraint, ascending.
    pub(crate) support: Vec<u32>,
    /// Jacobian entries, coordinate by coordinate: for each the entry of every row.
    pub(crate) y: Vec<f64>,
    /// Target g of the velocity solve.
    pub(crate) g: Vec<f64>,
    /// Target g of the position solve.
    pub(crate) position_g: Vec<f64>,
    /// Initial impulse.
    pub(crate) impulse: Vec<f64>,
    /// Bounds of the impulse of a scalar row; the coefficient of friction of a contact, twice.
    pub(crate) set: [f64; 2],
    /// Compliance, at least 0.
    pub(crate) compliance: f64,
    /// Ratio of trace(G_ii) before elimination of equality rows to that after it, at least 1.
    pub(crate) trace_ratio: f64,
    /// Mobility that scales the damping of a scalar row.
    pub(crate) mobility: f64,
    /// Velocity by which damping already reduced the target of a scalar row.
    pub(crate) damping_deficit: f64,
    /// Whether the row is eliminated, so that sweeps skip it.
    pub(crate) eliminated: bool,
    /// Whether the constraint is immovable.
    pub(crate) immovable: bool,
}

impl SavedConstraint {
    /// Whether a problem in `dimension` coordinates can have this constraint, with `rows` rows.
    pub(crate) fn is_sound(&self, dimension: usize, rows: usize) -> bool {
        let lists = [&self.g, &self.position_g, &self.impulse];
        let numbers = lists.into_iter().flatten().chain(&self.y).chain([&self.mobility, &self.damping_deficit]);
        lists.iter().all(|list| list.len() == rows)
            && self.y.len() == rows * self.support.len()
            && self.support.is_sorted_by(|a, b| a < b)
            && self.support.last().is_none_or(|&last| (last as usize) < dimension)
            && numbers.copied().all(f64::is_finite)
            && self.set[0] <= self.set[1]
            && (0.0..f64::INFINITY).contains(&self.compliance)
            && (1.0..f64::INFINITY).contains(&self.trace_ratio)
    }

    /// Entries of the coordinate `c`.
    pub(crate) fn entries<R: Real, const N: usize>(&self, c: usize) -> [R; N] {
        let place = self.support.binary_search(&(c as u32)).map_or(0, |k| k * N);
        std::array::from_fn(|row| R::of(self.y[place + row]))
    }
}

/// Operations of one kind of constraint on all constraints of that kind.
///
/// `self` has the parts that all solves share, `rows` those of one solve. Results over all kinds (a sum, a maximum) pass from one kind to
/// the next. The order of the arithmetic is therefore that of the rows.
pub trait ConstraintSet<R: Real>: Sized {
    /// Rows of one constraint.
    type Row: Row;
    /// Impulse of one constraint: a number, or one for each row of a contact.
    type Impulse: Impulse<R>;
    /// Set of the same kind in half the lanes.
    type Half: ConstraintSet<R::Half>;

    /// Empty set with capacity for `constraints` constraints.
    fn new(constraints: usize, capacity: &Capacity) -> Self;

    /// Rows of the velocity solve.
    fn rows(&self) -> &Rows<Self::Row>;

    /// Rows of one solve, mutable.
    fn rows_mut(&mut self) -> &mut Rows<Self::Row>;

    /// Number of multipliers that sweeps keep.
    fn multipliers(&self) -> usize {
        0
    }

    /// Removes all constraints.
    fn clear(&mut self);

    /// Gathers some lanes of all constraints into `out`, with the parts that sweeps need.
    fn gather(&self, rows: &Rows<Self::Row>, map: &LaneMap, out: &mut Self::Half);

    /// Calls `f` for every constraint that exists in a lane, with the coordinates that it touches there, ascending.
    fn for_each_support(&self, rows: &Rows<Self::Row>, lane: usize, f: &mut impl FnMut(&mut dyn Iterator<Item = u32>));

    /// Passes the constraints that exist in a lane to Newton's method.
    fn gather_lane(&self, rows: &Rows<Self::Row>, impulses: &[Self::Impulse], lane: usize, to: &mut impl LaneReceiver);

    /// Constraints of a lane for a file, with their impulses.
    fn save(&self, rows: &Rows<Self::Row>, impulses: &[Self::Impulse], lane: usize) -> Vec<SavedConstraint>;

    /// Appends a saved constraint in every lane.
    fn load(&mut self, saved: &SavedConstraint);

    /// Replaces the impulses of a lane by a weighted mean with those of `from`; see [`Snapshot::blend`](crate::Snapshot::blend).
    fn blend(
        &self,
        rows: &Rows<Self::Row>,
        impulses: &mut [Self::Impulse],
        from: &[Self::Impulse],
        lane: usize,
        weight: &mut impl FnMut(u32) -> f64,
    );

    /// Adds w += Y lambda.
    fn add_impulses(&self, impulses: &[Self::Impulse], w: &mut [R]);

    /// Visits every constraint once. Each gets the impulse that solves it while the others stay. Returns the larger of `change` and the
    /// largest change of a velocity, m/s.
    fn sweep(&self, rows: &Rows<Self::Row>, unknowns: Unknowns<'_, R, Self::Impulse>, lanes: SweepLanes<R>, change: R) -> R;

    /// Appends the velocities of all rows at the scaled velocity change w, m/s, including those by their compliance.
    fn velocities(&self, rows: &Rows<Self::Row>, impulses: &[Self::Impulse], w: &[R], out: &mut Vec<R>);

    /// Appends the compliance of all rows, without the additional compliance of contact normals.
    fn compliances(&self, rows: &Rows<Self::Row>, out: &mut Vec<R>);

    /// Calls `f` with the natural-map residual of every constraint, m/s, in their order; see [`residual`](crate::residual()).
    fn for_each_residual(&self, rows: &Rows<Self::Row>, impulses: &[Self::Impulse], w: &[R], f: impl FnMut(R));

    /// Sum of `sum` and the magnitudes of all normal impulses.
    fn sum_normal_impulses(&self, rows: &Rows<Self::Row>, impulses: &[Self::Impulse], sum: R) -> R;

    /// Sum of `sum` and the potential `g . lambda + R lambda^2 / 2` of the impulses in the velocity solve, J.
    fn add_potential(&self, impulses: &[Self::Impulse], sum: R) -> R;

    /// Adds the row velocities of `change`, a scaled change of the free velocity, to the targets of both solves (velocity and position) in
    /// all rows, in the lanes `lanes`.
    fn shift(&self, rows: &mut Rows<Self::Row>, change: &[R], lanes: R::Mask);

    /// Damps the targets of the rows relative to `impulses`, which are appended to the reference; see
    /// [`PositionRows::damp`](crate::PositionRows::damp).
    fn damp(&self, rows: &mut Rows<Self::Row>, impulses: &[Self::Impulse], damping: Damping<R>, floors: &[R], reference: [&mut Vec<R>; 2]);

    /// Larger of `most` and the largest difference between the target of a normal row and its velocity that damping causes, m/s or rad/s.
    fn shortfall(&self, rows: &Rows<Self::Row>, impulses: &[Self::Impulse], before: &[R], most: R) -> R;

    /// Larger of `most` and the largest target of an immovable row, m/s or rad/s.
    fn immovable_target(&self, rows: &Rows<Self::Row>, most: R) -> R;

    /// Larger of `most` and the largest target velocity of an immovable row without position correction, m/s or rad/s.
    fn unmet_velocity(&self, rows: &Rows<Self::Row>, most: R) -> R;

    /// Adds J^T z of a witness of infeasibility to `momentum`, scaled; returns `lack` - z . u, J. See
    /// [`System::witness`](crate::System::witness).
    fn witness(
        &self,
        rows: &Rows<Self::Row>,
        impulses: &[Self::Impulse],
        reference: ReferenceRows<'_, R>,
        w: &[R],
        momentum: &mut [R],
        lack: R,
    ) -> R;
}

/// Whether any lane's impulse changes.
///
/// Many limits and contacts stay open from sweep to sweep. Adding their zeros would change nothing, because no sum is ever -0.
#[inline(always)]
pub(crate) fn is_nonzero<R: Real>(d: R) -> bool {
    !d.eq(R::zero()).all()
}

/// Larger of two numbers. A NaN on the right is returned, so that it is never hidden.
#[inline(always)]
pub(crate) fn worse<R: Real>(a: R, b: R) -> R {
    R::select(b.le(a), a, b)
}

/// Replaces the numbers of a lane by `from + weight (number - from)`.
pub(crate) fn blend_lane<R: Real>(numbers: &mut [R], from: &[R], lane: usize, weight: f64) {
    for (number, from) in numbers.iter_mut().zip(from) {
        let [now, from] = [*number, *from].map(|x| number_of(x, lane));
        number.set_lane(lane, Scalar::from_f64(from + weight * (now - from)));
    }
}

/// Number in lane `lane` of a register, as f64.
#[inline(always)]
pub(crate) fn number_of<R: Real>(x: R, lane: usize) -> f64 {
    x.lane(lane).to_f64()
}
