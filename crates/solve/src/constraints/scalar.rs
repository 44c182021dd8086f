//! Scalar rows: equalities, limits and dry friction, each with one impulse in an interval.

use std::ops::{Index, IndexMut, Range};
use std::slice::SliceIndex;

use crate::admissible_set::AdmissibleSet;
use crate::capacity::Capacity;
use crate::cone::{clamp, masked};
use crate::constraints::constraint_set::{
    ConstraintSet, Damping, LaneConstraint, LaneReceiver, ReferenceRows, Row, Rows, SavedConstraint, SweepLanes, Unknowns, blend_lane,
    is_nonzero, number_of,
};
use crate::entries::Entries;
use crate::lane_map::LaneMap;
use stepper_real::{Mask, Real, Scalar};

/// Row with a single impulse lambda in an interval: an equality (any lambda), a limit (`0 <= lambda`), or dry friction (`|lambda| <= h f`,
/// for a friction force f and a time step h).
#[derive(Clone, Copy, Debug)]
pub struct ScalarRow<R: Real> {
    /// Index of the row's first coordinate in the list of coordinates of all scalar rows.
    first_column: usize,
    /// Index of the row's first Jacobian entry in the list of entries of all scalar rows.
    pub(super) y: usize,
    /// Number of coordinates at which the row has Jacobian entries.
    pub(super) num_columns: usize,
    /// Lanes in which the row exists.
    pub active: R::Mask,
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
    /// Ratio of the row's diagonal entry of the Delassus matrix before elimination of equality rows to that after it, at least 1.
    pub(crate) trace_ratio: R,
    /// Mobility that scales the damping of the row's target, 1/kg. It is 0 for a row whose force law has a compliance.
    pub(super) mobility: R,
    /// Velocity by which damping at assembly reduced the row's target, m/s or rad/s, see [`ScalarRow::damp_correction`].
    pub(super) damping_deficit: R,
    /// Lanes in which no impulse can move the row.
    pub(super) immovable: R::Mask,
}

impl<R: Real> ScalarRow<R> {
    /// Range of the row's Jacobian entries in the list of entries of all scalar rows.
    #[inline(always)]
    pub fn entries(&self) -> Range<usize> {
        self.y..self.y + self.num_columns
    }

    /// Lanes in which no impulse can change the velocity of the row.
    #[inline(always)]
    pub fn immovable(&self) -> R::Mask {
        self.immovable
    }

    /// Coefficient c for which c times the entries y of this row is the projection of another row onto y. `along` is the dot product of the
    /// entries of both rows.
    #[inline(always)]
    pub fn projection(&self, along: R) -> R {
        along * self.inv_diagonal
    }

    /// Velocity correction after damping, m/s or rad/s, from the undamped `correction`. `ratio` is the compliance relative to the row's
    /// mobility. The row stores the difference between the two.
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

    /// Velocity by which an immovable row misses its target, m/s or rad/s; 0 for dry friction.
    ///
    /// For an equality it is the absolute value of `equality`. For a limit with the offset `g` it is -g, which is negative if the limit is
    /// met.
    #[inline(always)]
    fn unmet(&self, equality: R, g: R) -> R {
        let infinite = R::of(f64::INFINITY);
        let either = self.lo.le(-infinite);
        masked(self.hi.ge(infinite), R::select(either, equality.abs(), -g))
    }

    /// Placeholder for a row that exists in no lane. All fields are overwritten before use.
    fn blank() -> Self {
        let (none, zero) = (R::Mask::splat(false), R::zero());
        Self {
            first_column: 0,
            y: 0,
            num_columns: 0,
            active: none,
            g: zero,
            position_g: zero,
            lo: zero,
            hi: zero,
            compliance: zero,
            diagonal: zero,
            inv_diagonal: R::one(),
            trace_ratio: R::one(),
            mobility: zero,
            damping_deficit: zero,
            immovable: none,
        }
    }

    /// Gathers the lanes that `map` selects into `out`, whose registers are half as wide. It gathers only the fields that Gauss-Seidel
    /// iterations read.
    #[inline(always)]
    fn gather(&self, map: &LaneMap, out: &mut ScalarRow<R::Half>) {
        (out.first_column, out.y, out.num_columns) = (self.first_column, self.y, self.num_columns);
        out.active = map.gather_mask::<R>(self.active);
        out.g = map.gather(self.g);
        out.lo = map.gather(self.lo);
        out.hi = map.gather(self.hi);
        out.compliance = map.gather(self.compliance);
        out.diagonal = map.gather(self.diagonal);
        out.inv_diagonal = map.gather(self.inv_diagonal);
    }
}

/// Scalar rows of a problem, stored sparse.
///
/// A row's columns are the coordinates of w (scaled velocity change) at which the row has entries in any lane, ascending.
#[derive(Clone, Debug)]
pub struct ScalarRows<R: Real> {
    /// Scalar rows, with the offsets g of the velocity solve.
    pub(super) rows: Rows<ScalarRow<R>>,
    /// Coordinates at which the scalar rows have Jacobian entries, one row after the other.
    columns: Vec<u32>,
    /// Entries of the scaled Jacobian at the coordinates in `columns`.
    pub(super) y: Entries<R>,
    /// Number of eliminated scalar rows, which come first in the list, see [`ScalarRows::mark_eliminated`].
    eliminated: usize,
}

impl<R: Real> ScalarRows<R> {
    /// Number of rows.
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.rows.items.len()
    }

    /// Whether there is no row.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.rows.items.is_empty()
    }

    /// Iterator over the rows.
    #[inline(always)]
    pub fn iter(&self) -> std::slice::Iter<'_, ScalarRow<R>> {
        self.rows.items.iter()
    }

    /// Appends a row with the entries `y` at the coordinates `columns`, ascending.
    ///
    /// `sign` (1 or -1 per lane) multiplies the row. The row exists in the lanes `active`. `g` is its velocity before any impulse, plus its
    /// bias (minus the target velocity), m/s or rad/s. `bounds` are the least and the largest impulse.
    #[inline(always)]
    pub fn push(&mut self, columns: &[u32], y: impl Fn(usize) -> R, sign: R, active: R::Mask, g: R, bounds: [R; 2]) {
        let (s0, y0) = (self.columns.len(), self.y.len());
        let mut diagonal = R::zero();
        self.columns.extend_from_slice(columns);
        for (entry, &c) in self.y.extend_by(columns.len()).iter_mut().zip(columns) {
            let value = R::select(active, y(c as usize) * sign, R::zero());
            *entry = value;
            diagonal += value * value;
        }
        let movable = diagonal.gt(R::zero());
        self.rows.items.push(ScalarRow {
            first_column: s0,
            y: y0,
            num_columns: columns.len(),
            active: active.and(movable),
            g,
            position_g: g,
            lo: bounds[0],
            hi: bounds[1],
            compliance: R::zero(),
            diagonal,
            inv_diagonal: R::one() / R::select(movable, diagonal, R::one()),
            trace_ratio: R::one(),
            mobility: diagonal,
            damping_deficit: R::zero(),
            immovable: active.and_not(movable),
        });
    }

    /// Removes the row `first` and all rows after it.
    pub fn truncate(&mut self, first: usize) {
        if let Some(row) = self.rows.items.get(first) {
            self.columns.truncate(row.first_column);
            self.y.truncate(row.y);
            self.rows.items.truncate(first);
        }
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
            // A row with a compliance can move.
            row.immovable = row.immovable.and_not(compliance.gt(R::zero()));
        }
    }

    /// Sets the trace ratio of the last row of the list: its diagonal entry before elimination of equality rows divided by that after it.
    /// The scale of the residual uses the entry before elimination.
    #[inline(always)]
    pub fn set_trace_ratio(&mut self, ratio: R) {
        if let Some(row) = self.rows.items.last_mut() {
            row.trace_ratio = ratio;
            row.mobility *= ratio;
        }
    }

    /// Sets the mobility that scales the damping of the last row of the list, 1/kg.
    ///
    /// The rows of one equality have the same mobility here, so that a nearly immovable row is damped like the other rows.
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

    /// Number of eliminated rows: equalities that are solved once, see [`ScalarRows::mark_eliminated`].
    #[inline(always)]
    pub fn eliminated(&self) -> usize {
        self.eliminated
    }

    /// Solves the eliminated rows (equalities that no other row influences) exactly, in the lanes `lanes`.
    #[inline(always)]
    pub(crate) fn solve_eliminated(&self, rows: &Rows<ScalarRow<R>>, impulses: &mut [R], w: &mut [R], lanes: R::Mask) {
        for (row, lambda) in rows.items.iter().zip(impulses).take(self.eliminated) {
            let v = self.velocity(row, w);
            let d = masked(lanes.and(row.active), -(v * row.inv_diagonal));
            *lambda += d;
            self.add(row, d, w);
        }
    }

    /// Coordinates of a row, and its Jacobian entry at each.
    #[inline(always)]
    pub fn entries(&self, row: &ScalarRow<R>) -> (&[u32], &[R]) {
        (&self.columns[row.first_column..row.first_column + row.num_columns], self.y.row(row.y, row.num_columns))
    }

    /// Velocity y . w + g of a row at the scaled velocity change `w`, m/s or rad/s: y is the row of the scaled Jacobian, and g its velocity
    /// before any impulse. The part by its compliance is not included.
    #[inline(always)]
    pub fn velocity(&self, row: &ScalarRow<R>, w: &[R]) -> R {
        let (columns, y) = self.entries(row);
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
        (v[0] + v[1]) + row.g
    }

    /// Adds the scaled velocity change by the impulse `d` of a row to `w`.
    #[inline(always)]
    fn add(&self, row: &ScalarRow<R>, d: R, w: &mut [R]) {
        let (columns, y) = self.entries(row);
        for (&c, &y) in columns.iter().zip(y) {
            w[c as usize] += y * d;
        }
    }
}

impl<R: Real> Row for ScalarRow<R> {
    #[inline(always)]
    fn exchange_offsets(&mut self) {
        std::mem::swap(&mut self.g, &mut self.position_g);
    }
}

impl<R: Real> ConstraintSet<R> for ScalarRows<R> {
    type Row = ScalarRow<R>;
    type Impulse = R;
    type Half = ScalarRows<R::Half>;

    fn new(rows: usize, capacity: &Capacity) -> Self {
        Self {
            rows: Rows::with_capacity(rows),
            columns: Vec::with_capacity(capacity.scalar_entries),
            y: Entries::with_capacity(capacity.scalar_entries, R::zero()),
            eliminated: 0,
        }
    }

    #[inline(always)]
    fn rows(&self) -> &Rows<ScalarRow<R>> {
        &self.rows
    }

    #[inline(always)]
    fn rows_mut(&mut self) -> &mut Rows<ScalarRow<R>> {
        &mut self.rows
    }

    #[inline(always)]
    fn clear(&mut self) {
        self.rows.clear();
        self.columns.clear();
        self.y.clear();
        self.eliminated = 0;
    }

    #[inline(always)]
    fn gather(&self, rows: &Rows<ScalarRow<R>>, map: &LaneMap, out: &mut Self::Half) {
        out.columns.clear();
        out.columns.extend_from_slice(&self.columns);
        out.y.map_from(
            &self.y,
            #[inline(always)]
            |&y| map.gather(y),
        );
        out.eliminated = self.eliminated;
        out.rows.items.resize_with(rows.items.len(), ScalarRow::blank);
        for (row, out) in rows.items.iter().zip(&mut out.rows.items) {
            row.gather(map, out);
        }
    }

    fn for_each_column_set(&self, rows: &Rows<ScalarRow<R>>, lane: usize, f: &mut impl FnMut(&mut dyn Iterator<Item = u32>)) {
        for row in rows.items.iter().filter(|row| row.active.bits() >> lane & 1 == 1) {
            let (columns, y) = self.entries(row);
            f(&mut columns.iter().zip(y).filter(|(_, y)| y.lane(lane).to_f64() != 0.0).map(|(c, _)| *c));
        }
    }

    fn gather_lane(&self, rows: &Rows<ScalarRow<R>>, impulses: &[R], lane: usize, to: &mut impl LaneReceiver) {
        let number = |x: R| number_of(x, lane);
        for (i, (row, &lambda)) in rows.items.iter().zip(impulses).enumerate() {
            let (columns, y) = self.entries(row);
            if i < self.eliminated {
                to.add_eliminated(columns, y.iter().map(|&y| number(y) * number(lambda)));
            } else if row.active.bits() >> lane & 1 == 1 {
                let constraint = LaneConstraint {
                    set: AdmissibleSet::Interval { lo: number(row.lo), hi: number(row.hi) },
                    source: i,
                    g: [number(row.g)],
                    lambda: [number(lambda)],
                    compliance: number(row.compliance),
                    normal_compliance: 0.0,
                    trace_ratio: number(row.trace_ratio),
                };
                to.add(constraint, columns, y.iter().map(|&y| [number(y)]));
            }
        }
    }

    fn save(&self, rows: &Rows<ScalarRow<R>>, impulses: &[R], lane: usize) -> Vec<SavedConstraint> {
        let number = |x: R| number_of(x, lane);
        let exists = |mask: R::Mask| mask.bits() >> lane & 1 == 1;
        let there = rows.items.iter().zip(impulses).enumerate().filter(|(_, (row, _))| exists(row.active) || exists(row.immovable));
        let save = |(i, (row, &impulse)): (usize, (&ScalarRow<R>, &R))| {
            let (columns, y) = self.entries(row);
            SavedConstraint {
                columns: columns.to_vec(),
                y: y.iter().map(|&y| number(y)).collect(),
                g: vec![number(row.g)],
                position_g: vec![number(row.position_g)],
                impulse: vec![number(impulse)],
                set: [number(row.lo), number(row.hi)],
                compliance: number(row.compliance),
                trace_ratio: number(row.trace_ratio),
                mobility: number(row.mobility),
                damping_deficit: number(row.damping_deficit),
                eliminated: i < self.eliminated,
                immovable: exists(row.immovable),
            }
        };
        there.map(save).collect()
    }

    fn load(&mut self, saved: &SavedConstraint) {
        let (all, immovable) = (R::Mask::splat(true), R::Mask::splat(saved.immovable));
        let bounds = saved.set.map(R::of);
        self.push(&saved.columns, |c| saved.entries::<R, 1>(c)[0], R::one(), all.and_not(immovable), R::of(saved.g[0]), bounds);
        if saved.eliminated {
            self.mark_eliminated();
        }
        self.set_compliance(R::of(saved.compliance));
        self.set_position_offset(R::of(saved.position_g[0]));
        if let Some(row) = self.rows.items.last_mut() {
            (row.trace_ratio, row.mobility) = (R::of(saved.trace_ratio), R::of(saved.mobility));
            (row.damping_deficit, row.immovable) = (R::of(saved.damping_deficit), immovable);
        }
    }

    fn blend(&self, rows: &Rows<ScalarRow<R>>, impulses: &mut [R], from: &[R], lane: usize, weight: &mut impl FnMut(u32) -> f64) {
        for (row, (impulse, from)) in rows.items.iter().zip(impulses.iter_mut().zip(from)) {
            let (columns, y) = self.entries(row);
            let first = columns.iter().zip(y).find(|(_, y)| number_of(**y, lane) != 0.0);
            if let (Some((&c, _)), true) = (first, row.active.bits() >> lane & 1 == 1) {
                blend_lane(std::slice::from_mut(impulse), std::slice::from_ref(from), lane, weight(c));
            }
        }
    }

    #[inline(always)]
    fn add_impulses(&self, impulses: &[R], w: &mut [R]) {
        for (row, &lambda) in self.rows.items.iter().zip(impulses) {
            self.add(row, lambda, w);
        }
    }

    #[inline(always)]
    fn sweep(&self, rows: &Rows<ScalarRow<R>>, unknowns: Unknowns<'_, R, R>, lanes: SweepLanes<R>, mut change: R) -> R {
        let Unknowns { impulses, w, .. } = unknowns;
        for (i, row) in rows.items.iter().enumerate().skip(self.eliminated) {
            let lanes = lanes.running.and(row.active);
            if lanes.none() {
                continue;
            }
            let lambda = impulses[i];
            let v = self.velocity(row, w) + row.compliance * lambda;
            let next = clamp(lambda - v * row.inv_diagonal, row.lo, row.hi);
            let d = masked(lanes, next - lambda);
            impulses[i] = R::select(lanes, next, lambda);
            if is_nonzero(d) {
                self.add(row, d, w);
            }
            change = change.max(d.abs() * row.diagonal);
        }
        change
    }

    #[inline(always)]
    fn velocities(&self, rows: &Rows<ScalarRow<R>>, impulses: &[R], w: &[R], out: &mut Vec<R>) {
        for (row, &lambda) in rows.items.iter().zip(impulses) {
            out.push(self.velocity(row, w) + row.compliance * lambda);
        }
    }

    fn compliances(&self, rows: &Rows<ScalarRow<R>>, out: &mut Vec<R>) {
        out.extend(rows.items.iter().map(|row| row.compliance));
    }

    #[inline(always)]
    fn for_each_residual(&self, rows: &Rows<ScalarRow<R>>, impulses: &[R], w: &[R], mut f: impl FnMut(R)) {
        for (row, &lambda) in rows.items.iter().zip(impulses) {
            let v = self.velocity(row, w) + row.compliance * lambda;
            let (mut rho, mut inv_rho) = (row.inv_diagonal, row.diagonal);
            if self.eliminated > 0 {
                (rho, inv_rho) = (rho / row.trace_ratio, inv_rho * row.trace_ratio);
            }
            let mapped = clamp(lambda - rho * v, row.lo, row.hi);
            // `clamp` replaces a velocity v that is NaN by a bound. The product of v with 0 restores the NaN.
            f(masked(row.active, (lambda - mapped).abs() * inv_rho + v * R::zero()));
        }
    }

    #[inline(always)]
    fn sum_normal_impulses(&self, rows: &Rows<ScalarRow<R>>, impulses: &[R], mut sum: R) -> R {
        for (row, &lambda) in rows.items.iter().zip(impulses) {
            sum += masked(row.active, lambda.abs());
        }
        sum
    }

    #[inline(always)]
    fn add_potential(&self, impulses: &[R], mut sum: R) -> R {
        for (row, &lambda) in self.rows.items.iter().zip(impulses) {
            sum += (row.g + row.compliance * R::of(0.5) * lambda) * lambda;
        }
        sum
    }

    #[inline(always)]
    fn shift(&self, rows: &mut Rows<ScalarRow<R>>, change: &[R], lanes: R::Mask) {
        for row in &mut rows.items {
            let g = R::select(lanes, self.velocity(row, change), row.g);
            row.position_g = R::select(lanes, row.position_g + (g - row.g), row.position_g);
            row.g = g;
        }
    }

    #[inline(always)]
    fn damp(
        &self,
        rows: &mut Rows<ScalarRow<R>>,
        impulses: &[R],
        damping: Damping<R>,
        _floors: &[R],
        [reference_lambda, reference_g]: [&mut Vec<R>; 2],
    ) {
        for (k, (row, &lambda)) in rows.items.iter_mut().zip(impulses).enumerate() {
            reference_lambda.push(lambda);
            reference_g.push(row.g + row.damping_deficit);
            // Eliminated rows are damped at assembly, because other rows are combined with them.
            if k >= self.eliminated {
                // The negated comparison counts a NaN as a correction.
                let corrects = (row.g - row.position_g).abs().le(damping.negligible).not();
                let compliance = masked(corrects, damping.ratio * row.mobility);
                row.g -= compliance * lambda;
                row.compliance += compliance;
                row.diagonal += compliance;
                row.inv_diagonal = R::one() / R::select(row.diagonal.gt(R::zero()), row.diagonal, R::one());
            }
        }
    }

    #[inline(always)]
    fn shortfall(&self, rows: &Rows<ScalarRow<R>>, impulses: &[R], before: &[R], mut most: R) -> R {
        for (k, (row, &now)) in rows.items.iter().zip(impulses).enumerate() {
            let change = now - before[k];
            let give = if k < self.eliminated { R::zero() } else { row.compliance * change };
            // The compliance of a spring is part of its force law. Only rows without a spring (with a mobility) are damped.
            most = most.max(masked(row.active.and(row.mobility.gt(R::zero())), give.abs().max(row.damping_deficit.abs())));
        }
        most
    }

    #[inline(always)]
    fn immovable_target(&self, rows: &Rows<ScalarRow<R>>, mut most: R) -> R {
        for row in &rows.items {
            most = most.max(masked(row.immovable, row.unmet(row.damping_deficit, row.g)));
        }
        most
    }

    #[inline(always)]
    fn unmet_velocity(&self, rows: &Rows<ScalarRow<R>>, mut most: R) -> R {
        for row in &rows.items {
            let [least, larger] = [row.g.abs().min(row.position_g.abs()), row.g.max(row.position_g)];
            most = most.max(masked(row.immovable, row.unmet(least, larger)));
        }
        most
    }

    #[inline(always)]
    fn witness(
        &self,
        rows: &Rows<ScalarRow<R>>,
        impulses: &[R],
        reference: ReferenceRows<'_, R>,
        w: &[R],
        momentum: &mut [R],
        mut missing_work: R,
    ) -> R {
        let infinite = R::of(f64::INFINITY);
        for ((row, &now), (&before, &g)) in rows.items.iter().zip(impulses).zip(reference.lambda.iter().zip(reference.g)) {
            let change = now - before;
            let unbounded = row.active.and(row.mobility.gt(R::zero())).and(row.hi.ge(infinite));
            let z = masked(unbounded, R::select(row.lo.le(-infinite), change, change.max(R::zero())));
            let u = self.velocity(row, w) - row.g + g;
            missing_work -= z * u;
            self.add(row, z, momentum);
        }
        missing_work
    }
}

impl<R: Real, I: SliceIndex<[ScalarRow<R>]>> Index<I> for ScalarRows<R> {
    type Output = I::Output;

    #[inline(always)]
    fn index(&self, i: I) -> &I::Output {
        &self.rows.items[i]
    }
}

impl<R: Real, I: SliceIndex<[ScalarRow<R>]>> IndexMut<I> for ScalarRows<R> {
    #[inline(always)]
    fn index_mut(&mut self, i: I) -> &mut I::Output {
        &mut self.rows.items[i]
    }
}
