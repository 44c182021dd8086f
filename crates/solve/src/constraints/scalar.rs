//! Scalar rows: equalities, limits and dry friction, each with one impulse in an interval.

use std::ops::{Deref, IndexMut};

use crate::admissible_set::AdmissibleSet;
use crate::capacity::Capacity;
use crate::cone::{clamp, masked};
use crate::constraints::constraint_set::{
    ConstraintBase, ConstraintList, ConstraintSet, Damping, LaneConstraint, RowEntries, SavedConstraint, SweepLanes, add_transposed,
    is_nonzero, number_of,
};
use stepper_real::{Mask, Real};

/// Row with a single impulse lambda in an interval: an equality (any lambda), a limit (`0 <= lambda`), or dry friction (`|lambda| <= h f`,
/// for a friction force f and a time step h).
#[derive(Clone, Copy, Debug)]
pub struct ScalarRow<R: Real> {
    /// Place of the row, and the lanes in which it exists and in which an impulse can move it.
    pub(super) common: ConstraintBase<R>,
    /// Velocity g of the row before any impulse, plus its bias (the negated velocity target), m/s or rad/s. This value is for the velocity
    /// solve; `position_g` is for the position solve.
    pub g: R,
    /// Offset of the row in the position solve, m/s or rad/s: its velocity before any impulse, plus the bias of this solve.
    pub position_g: R,
    /// Least impulse of the row, N s or N m s.
    pub lo: R,
    /// Largest impulse of the row, N s or N m s.
    pub hi: R,
    /// Compliance R >= 0: velocity of the row per unit of impulse, in addition to the motion of the bodies, 1/kg. It is 0 for a hard row.
    pub compliance: R,
    /// Diagonal entry of the Delassus matrix for the row, compliance included, 1/kg.
    pub(super) diagonal: R,
    /// Inverse of the row's diagonal entry of the Delassus matrix, kg; 1 in lanes in which the row does not exist or cannot move.
    pub(super) inv_diagonal: R,
    /// Mobility of the row before the elimination of equality rows, divided by that after it, at least 1. The mobility is the row's
    /// diagonal entry of the Delassus matrix.
    pub(crate) mobility_ratio: R,
    /// Mobility that scales the damping of the row's target, 1/kg. It is 0 for a row whose force law has a compliance.
    pub(super) mobility: R,
    /// Velocity by which damping at assembly reduced the row's target, m/s or rad/s, see [`ScalarRow::damp_correction`].
    pub(super) damping_deficit: R,
}

impl<R: Real> ScalarRow<R> {
    /// Coefficient c for which c y is the projection of another row onto the entries y of this row. `along` is the dot product of the
    /// entries of both rows.
    #[inline(always)]
    pub fn projection(&self, along: R) -> R {
        along * self.inv_diagonal
    }

    /// Velocity y . w + g of the row at the scaled velocity change `w`, m/s or rad/s. The row has the entries `y` at the coordinates
    /// `columns`. The velocity due to the compliance is not included.
    #[inline(always)]
    fn velocity(&self, (columns, y): RowEntries<'_, R>, w: &[R]) -> R {
        // Two partial sums, so that additions do not wait for each other. The columns of a row are the same in all lanes, and so is the
        // order.
        let mut v = [R::zero(); 2];
        let (pairs, last) = columns.as_chunks::<2>();
        let (y, y_last) = y.as_chunks::<2>();
        for (c, y) in pairs.iter().zip(y) {
            for k in 0..2 {
                v[k] += y[k] * w[c[k] as usize];
            }
        }
        for (&c, &y) in last.iter().zip(y_last) {
            v[0] += y * w[c as usize];
        }
        (v[0] + v[1]) + self.g
    }

    /// Velocity correction after damping, m/s or rad/s, from the undamped `correction`. `ratio` is the ratio of the damping compliance to
    /// the row's mobility. The row stores the velocity by which damping reduces the correction (`damping_deficit`).
    ///
    /// This function is for rows that are combined with others before the position solve. [`PositionRows::damp`](crate::PositionRows::damp)
    /// then skips these rows.
    #[inline(always)]
    pub fn damp_correction(&mut self, ratio: R, correction: R) -> R {
        let stiffness = self.diagonal + ratio * self.mobility;
        let met = correction * (self.diagonal / R::select(stiffness.gt(R::zero()), stiffness, R::one()));
        let met = R::select(ratio.gt(R::zero()), met, correction);
        self.damping_deficit = R::select(self.immovable, correction, correction - met);
        met
    }
}

/// Scalar rows of one solve.
#[derive(Clone, Debug)]
pub struct ScalarList<R: Real> {
    /// Rows of the list.
    pub(super) items: Vec<ScalarRow<R>>,
}

/// Scalar rows of a problem.
pub type ScalarRows<R> = ConstraintSet<R, ScalarList<R>>;

impl<R: Real> ScalarRows<R> {
    /// Appends a row with the entries `y` at the coordinates `columns`, ascending.
    ///
    /// `sign` (1 or -1 per lane) multiplies the entries, but not `g`. The row exists in the lanes `exists`. `g` is the velocity of the row
    /// before any impulse, plus its bias (minus the target velocity), m/s or rad/s. `bounds` are the least and the largest impulse.
    #[inline(always)]
    pub fn push(&mut self, columns: &[u32], y: impl Fn(usize) -> R, sign: R, exists: R::Mask, g: R, bounds: [R; 2]) {
        let mut diagonal = R::zero();
        let span = self.push_entries(
            columns,
            #[inline(always)]
            |c| [R::select(exists, y(c) * sign, R::zero())],
            #[inline(always)]
            |&[value]| diagonal += value * value,
        );
        let movable = diagonal.gt(R::zero());
        self.rows.items.push(ScalarRow {
            common: ConstraintBase { span, active: exists.and(movable), immovable: exists.and_not(movable) },
            g,
            position_g: g,
            lo: bounds[0],
            hi: bounds[1],
            compliance: R::zero(),
            diagonal,
            inv_diagonal: R::one() / R::select(movable, diagonal, R::one()),
            mobility_ratio: R::one(),
            mobility: diagonal,
            damping_deficit: R::zero(),
        });
    }

    /// Sets the offset of the last row of the list for the position solve, m/s or rad/s. By default it is that of the velocity solve.
    #[inline(always)]
    pub fn set_position_offset(&mut self, position_g: R) {
        if let Some(row) = self.rows.items.last_mut() {
            row.position_g = position_g;
        }
    }

    /// Sets the compliance R >= 0 of the last row of the list, 1/kg.
    #[inline(always)]
    pub fn set_compliance(&mut self, compliance: R) {
        if let Some(row) = self.rows.items.last_mut() {
            row.compliance = compliance;
            row.mobility = R::select(compliance.gt(R::zero()), R::zero(), row.mobility);
            row.diagonal += compliance;
            row.inv_diagonal = R::one() / R::select(row.diagonal.gt(R::zero()), row.diagonal, R::one());
            // A row with a compliance does not count as immovable.
            row.common.immovable = row.immovable.and_not(compliance.gt(R::zero()));
        }
    }

    /// Sets the mobility ratio of the last row of the list. The ratio is the row's diagonal entry of the Delassus matrix before elimination
    /// of equality rows, divided by that after it. The step of the residual is the inverse of the entry before elimination.
    #[inline(always)]
    pub fn set_mobility_ratio(&mut self, ratio: R) {
        if let Some(row) = self.rows.items.last_mut() {
            row.mobility_ratio = ratio;
            row.mobility *= ratio;
        }
    }

    /// Sets the mobility that scales the damping of the last row of the list, 1/kg.
    ///
    /// The caller gives the rows of one equality the same mobility, so that a nearly immovable row is damped like the other rows. A row
    /// with a compliance keeps the mobility 0.
    #[inline(always)]
    pub fn set_mobility(&mut self, mobility: R) {
        if let Some(row) = self.rows.items.last_mut() {
            row.mobility = R::select(row.mobility.gt(R::zero()), mobility, R::zero());
        }
    }

    /// Marks all rows of the list as eliminated. They must be equalities without compliance, and orthogonal to every other row, including
    /// the rows that are pushed later.
    ///
    /// They are solved once. Gauss-Seidel iterations skip them, because no other impulse changes their velocities.
    #[inline(always)]
    pub fn mark_eliminated(&mut self) {
        self.eliminated = self.rows.items.len();
    }

    /// Removes the row with the index `first` and all rows after it.
    pub fn truncate(&mut self, first: usize) {
        if let Some(row) = self.rows.items.get(first) {
            self.columns.truncate(row.span.first_column);
            self.y.truncate(row.span.y);
            self.rows.items.truncate(first);
        }
    }

    /// Solves the eliminated rows (equalities that no other row influences) exactly, in the lanes `lanes`.
    #[inline(always)]
    pub(crate) fn solve_eliminated(&self, rows: &ScalarList<R>, impulses: &mut [R], w: &mut [R], lanes: R::Mask) {
        for (row, lambda) in rows.items.iter().zip(impulses).take(self.eliminated) {
            let (columns, y) = self.entries(row);
            let d = masked(lanes.and(row.active), -(row.velocity((columns, y), w) * row.inv_diagonal));
            *lambda += d;
            add_transposed(columns, y.as_chunks().0, [d], w);
        }
    }

    /// Appends a constraint that was read from a file, with the same numbers in every lane.
    pub(crate) fn load(&mut self, saved: &SavedConstraint) {
        let (all, immovable) = (R::Mask::splat(true), R::Mask::splat(saved.immovable));
        let bounds = saved.set.map(R::of);
        self.push(&saved.columns, |c| saved.entries::<R, 1>(c)[0], R::one(), all.and_not(immovable), R::of(saved.g[0]), bounds);
        if saved.eliminated {
            self.mark_eliminated();
        }
        self.set_compliance(R::of(saved.compliance));
        self.set_position_offset(R::of(saved.position_g[0]));
        if let Some(row) = self.rows.items.last_mut() {
            (row.mobility_ratio, row.mobility) = (R::of(saved.mobility_ratio), R::of(saved.mobility));
            (row.damping_deficit, row.common.immovable) = (R::of(saved.damping_deficit), immovable);
        }
    }

    /// Makes one Gauss-Seidel iteration over the rows that are not eliminated: each in turn gets the impulse that solves this row at
    /// constant other impulses.
    ///
    /// Returns the larger of `change` and the largest change of a velocity, m/s.
    #[inline(always)]
    pub(crate) fn sweep(&self, rows: &ScalarList<R>, impulses: &mut [R], w: &mut [R], lanes: SweepLanes<R>, mut change: R) -> R {
        for (i, row) in rows.items.iter().enumerate().skip(self.eliminated) {
            let lanes = lanes.running.and(row.active);
            if lanes.none() {
                continue;
            }
            let lambda = impulses[i];
            let (columns, y) = self.entries(row);
            let v = row.velocity((columns, y), w) + row.compliance * lambda;
            let next = clamp(lambda - v * row.inv_diagonal, row.lo, row.hi);
            let d = masked(lanes, next - lambda);
            impulses[i] = R::select(lanes, next, lambda);
            if is_nonzero(d) {
                add_transposed(columns, y.as_chunks().0, [d], w);
            }
            change = change.max(d.abs() * row.diagonal);
        }
        change
    }
}

impl<R: Real> IndexMut<usize> for ScalarRows<R> {
    #[inline(always)]
    fn index_mut(&mut self, i: usize) -> &mut ScalarRow<R> {
        &mut self.rows.items[i]
    }
}

impl<R: Real> Deref for ScalarRow<R> {
    type Target = ConstraintBase<R>;

    #[inline(always)]
    fn deref(&self) -> &ConstraintBase<R> {
        &self.common
    }
}

impl<R: Real> ConstraintList<R> for ScalarList<R> {
    type Item = ScalarRow<R>;

    fn with_capacity(capacity: &Capacity) -> Self {
        Self { items: Vec::with_capacity(capacity.scalars) }
    }

    #[inline(always)]
    fn items(&self) -> &[ScalarRow<R>] {
        &self.items
    }

    #[inline(always)]
    fn clear(&mut self) {
        self.items.clear();
    }

    #[inline(always)]
    fn copy(&mut self, from: &Self) {
        self.items.clone_from(&from.items);
    }

    #[inline(always)]
    fn offsets(&self, i: usize) -> [&[R]; 2] {
        let ScalarRow { g, position_g, .. } = &self.items[i];
        [std::slice::from_ref(g), std::slice::from_ref(position_g)]
    }

    #[inline(always)]
    fn exchange_offsets(&mut self, lanes: R::Mask) {
        for ScalarRow { g, position_g, .. } in &mut self.items {
            (*g, *position_g) = (R::select(lanes, *position_g, *g), R::select(lanes, *g, *position_g));
        }
    }

    fn lane_constraint(&self, i: usize, lane: usize) -> LaneConstraint {
        let (row, number) = (&self.items[i], |x: R| number_of(x, lane));
        LaneConstraint {
            set: AdmissibleSet::Interval { lo: number(row.lo), hi: number(row.hi) },
            compliance: number(row.compliance),
            normal_compliance: 0.0,
            mobility_ratio: number(row.mobility_ratio),
        }
    }

    fn save(&self, i: usize, lane: usize) -> SavedConstraint {
        let (row, number) = (&self.items[i], |x: R| number_of(x, lane));
        SavedConstraint {
            set: [number(row.lo), number(row.hi)],
            compliance: number(row.compliance),
            mobility_ratio: number(row.mobility_ratio),
            mobility: number(row.mobility),
            damping_deficit: number(row.damping_deficit),
            ..SavedConstraint::default()
        }
    }

    #[inline(always)]
    fn push_velocity(&self, i: usize, entries: RowEntries<'_, R>, w: &[R], lambda: &[R], out: &mut Vec<R>) {
        let row = &self.items[i];
        out.push(row.velocity(entries, w) + row.compliance * lambda[0]);
    }

    #[inline(always)]
    fn normal_velocity(&self, i: usize, entries: RowEntries<'_, R>, w: &[R]) -> R {
        self.items[i].velocity(entries, w)
    }

    #[inline(always)]
    fn add(&self, _i: usize, (columns, y): RowEntries<'_, R>, lambda: &[R], w: &mut [R]) {
        add_transposed(columns, y.as_chunks().0, [lambda[0]], w);
    }

    #[inline(always)]
    fn residual(&self, i: usize, entries: RowEntries<'_, R>, w: &[R], lambda: &[R], has_eliminated: bool) -> R {
        let (row, lambda) = (&self.items[i], lambda[0]);
        let v = row.velocity(entries, w) + row.compliance * lambda;
        let (mut rho, mut inv_rho) = (row.inv_diagonal, row.diagonal);
        if has_eliminated {
            (rho, inv_rho) = (rho / row.mobility_ratio, inv_rho * row.mobility_ratio);
        }
        let mapped = clamp(lambda - rho * v, row.lo, row.hi);
        // `clamp` replaces a velocity v that is NaN by a bound. The product of v with 0 restores the NaN.
        (lambda - mapped).abs() * inv_rho + v * R::zero()
    }

    #[inline(always)]
    fn add_potential(&self, i: usize, lambda: &[R], sum: R) -> R {
        let row = &self.items[i];
        sum + (row.g + row.compliance * R::of(0.5) * lambda[0]) * lambda[0]
    }

    #[inline(always)]
    fn shift(&mut self, i: usize, entries: RowEntries<'_, R>, change: &[R]) {
        let row = &mut self.items[i];
        let moved = row.velocity(entries, change);
        row.position_g += moved - row.g;
        row.g = moved;
    }

    #[inline(always)]
    fn damping_deficit(&self, i: usize) -> R {
        self.items[i].damping_deficit
    }

    #[inline(always)]
    fn damp(&mut self, i: usize, lambda: &[R], damping: Damping<R>, _added_mobility: R) {
        let row = &mut self.items[i];
        // The negated comparison counts a NaN as a correction.
        let corrects = (row.g - row.position_g).abs().le(damping.negligible).not();
        let compliance = masked(corrects, damping.ratio * row.mobility);
        row.g -= compliance * lambda[0];
        row.compliance += compliance;
        row.diagonal += compliance;
        row.inv_diagonal = R::one() / R::select(row.diagonal.gt(R::zero()), row.diagonal, R::one());
    }

    #[inline(always)]
    fn shortfall(&self, i: usize, change: R) -> R {
        let row = &self.items[i];
        // The compliance of a spring is part of its force law. Only rows without a spring (with a mobility) are damped.
        masked(row.mobility.gt(R::zero()), (row.compliance * change).abs().max(row.damping_deficit.abs()))
    }

    #[inline(always)]
    fn unmet(&self, i: usize, missed: R, g: R) -> R {
        let (row, infinite) = (&self.items[i], R::of(f64::INFINITY));
        masked(row.hi.ge(infinite), R::select(row.lo.le(-infinite), missed.abs(), -g))
    }

    #[inline(always)]
    fn witness(&self, i: usize, now: R, before: R) -> R {
        let (row, change, infinite) = (&self.items[i], now - before, R::of(f64::INFINITY));
        let unbounded = row.active.and(row.mobility.gt(R::zero())).and(row.hi.ge(infinite));
        masked(unbounded, R::select(row.lo.le(-infinite), change, change.max(R::zero())))
    }
}
