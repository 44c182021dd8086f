//! Rows of one lane in scalar f64, gathered from the problem of all lanes. The solution's impulses are copied back to that lane.
//!
//! Entries that are exactly zero are left out, so that a lane does not depend on the contacts of other lanes.

use std::ops::Range;

use crate::constraints::constraint_set::{ConstraintSet, Impulse, LaneConstraint, Row, Rows, has_lane, number_of};
use crate::constraints::each_kind;
use crate::iterate::Iterate;
use crate::problem::System;
use stepper_real::{Real, Scalar};

/// Rows of one constraint of a lane.
#[derive(Clone, Debug)]
pub(super) struct LaneBlock {
    /// Admissible impulses and compliances. If the normal row has an additional compliance, the constraint has an extra coordinate. The
    /// normal row's entry there is the square root of this compliance.
    pub(super) constraint: LaneConstraint,
    /// Index of the constraint's kind: 0 for scalar rows, 1 for contacts with three rows, 2 for contacts with six rows.
    pub(super) kind: usize,
    /// Index of the constraint among the constraints of its kind, in the problem of all lanes.
    pub(super) source: usize,
    /// Range of the constraint's coordinates in the lane's list of coordinates.
    columns: Range<usize>,
    /// Index of the constraint's first entry in the lane's list of Jacobian entries.
    y: usize,
    /// Range of the constraint's rows in [`Lane::g`] and [`Lane::lambda`].
    pub(super) rows: Range<usize>,
}

/// Rows of one lane, stored sparse.
#[derive(Clone, Debug, Default)]
pub(super) struct Lane {
    /// Rows of each constraint of the lane.
    pub(super) blocks: Vec<LaneBlock>,
    /// Index of the kind of constraint that is being gathered.
    kind: usize,
    /// Coordinates of the constraints, one constraint after the other.
    pub(super) columns: Vec<u32>,
    /// Entries of the scaled Jacobian: for each coordinate, those of all rows of the constraint.
    y: Vec<f64>,
    /// Offset g of each row, m/s: its velocity before any impulse, plus its bias (minus the target velocity).
    pub(super) g: Vec<f64>,
    /// Impulse of each row, N s.
    pub(super) lambda: Vec<f64>,
    /// Scaled velocity change w = sum_i y_i lambda_i by the impulses lambda_i of all rows except the eliminated ones, where y_i are the
    /// rows of the scaled Jacobian. Its kinetic energy is |w|^2 / 2.
    pub(super) w: Vec<f64>,
    /// Part of the scaled velocity change w by eliminated rows. These rows are solved already, and no other row depends on this part.
    eliminated: Vec<f64>,
    /// Extra coordinates of the scaled velocity change w: one for each normal row with an additional compliance
    /// ([`LaneConstraint::normal_compliance`]). In the scaled Jacobian, this row has the square root of that compliance there, and no
    /// other row has an entry.
    ///
    /// The coordinates have the effect of the additional compliances. Newton's method itself supports only compliances that are the same
    /// for all rows of a cone.
    own: Vec<f64>,
}

impl Lane {
    /// Gathers the rows of lane `lane` from the problem of all lanes, one kind of constraint after the other. Eliminated rows are left out.
    pub(super) fn gather<R: Real>(&mut self, system: System<'_, R>, iterate: &Iterate<R>, lane: usize) {
        self.blocks.clear();
        self.columns.clear();
        self.y.clear();
        self.g.clear();
        self.lambda.clear();
        self.w.clear();
        self.own.clear();
        self.eliminated.clear();
        self.eliminated.resize(iterate.w.len(), 0.0);
        self.kind = 0;
        each_kind!([set: &system.problem] [rows: system] [impulses: &iterate] => {
            self.gather_kind(set, rows, impulses, lane);
            self.kind += 1;
        });
        self.w.extend(iterate.w.iter().zip(&self.eliminated).map(|(&x, part)| number_of(x, lane) - part));
        self.w.extend_from_slice(&self.own);
    }

    /// Coordinates of a constraint, and the entries of its rows at each.
    pub(super) fn entries(&self, block: &LaneBlock) -> (&[u32], &[f64]) {
        let columns = self.columns(block);
        (columns, &self.y[block.y..block.y + columns.len() * block.rows.len()])
    }

    /// Coordinates of a constraint, ascending; there is at least one.
    pub(super) fn columns(&self, block: &LaneBlock) -> &[u32] {
        &self.columns[block.columns.clone()]
    }

    /// Rows of a constraint that have an effect, as bits: those with a nonzero entry, offset g or impulse, and always the first row.
    pub(super) fn used_rows(&self, block: &LaneBlock) -> u32 {
        let (_, entries) = self.entries(block);
        let dim = block.rows.len();
        let mut busy = 1;
        for own in entries.chunks_exact(dim) {
            for (r, &y) in own.iter().enumerate() {
                busy |= u32::from(y != 0.0) << r;
            }
        }
        for (r, k) in block.rows.clone().enumerate() {
            busy |= u32::from(self.g[k] != 0.0 || self.lambda[k] != 0.0) << r;
        }
        busy
    }

    /// Copies the impulses and the scaled velocity change w back to lane `lane` of an iterate.
    pub(super) fn scatter<R: Real>(&self, lane: usize, iterate: &mut Iterate<R>) {
        let mut kinds = 0..;
        each_kind!([impulses: &mut iterate] => {
            let kind = kinds.next();
            for block in self.blocks.iter().filter(|block| Some(block.kind) == kind) {
                let impulse = Impulse::<R>::flatten_mut(std::slice::from_mut(&mut impulses[block.source]));
                for (to, &x) in impulse.iter_mut().zip(&self.lambda[block.rows.clone()]) {
                    to.set_lane(lane, Scalar::from_f64(x));
                }
            }
        });
        for ((to, &x), part) in iterate.w.iter_mut().zip(&self.w).zip(&self.eliminated) {
            to.set_lane(lane, Scalar::from_f64(x + part));
        }
    }

    /// Gathers the constraints of one kind that exist in lane `lane`.
    fn gather_kind<R: Real, T: Row<R>>(&mut self, set: &ConstraintSet<R, T>, rows: &Rows<T>, impulses: &[T::Impulse], lane: usize) {
        for (source, (row, &lambda)) in rows.items.iter().zip(impulses).enumerate() {
            let (columns, y) = set.entries(row);
            let entries = y.iter().map(|y| y.numbers(lane));
            let [g, lambda] = [row.offsets()[0], lambda].map(|x| x.numbers(lane));
            if source < set.eliminated {
                let change = entries.map(|y| y.as_ref()[0] * lambda.as_ref()[0]);
                columns.iter().zip(change).for_each(|(&c, change)| self.eliminated[c as usize] += change);
            } else if has_lane::<R>(row.active(), lane) {
                self.add(row.lane_constraint(lane), source, [g.as_ref(), lambda.as_ref()], columns, entries);
            }
        }
    }

    /// Appends a constraint with the offsets g and the impulses lambda of its rows. `source` is its index among the constraints of its
    /// kind. An immovable constraint (without entries) is left out, because its impulses have no effect.
    pub(super) fn add<T: AsRef<[f64]>>(
        &mut self,
        constraint: LaneConstraint,
        source: usize,
        [g, lambda]: [&[f64]; 2],
        columns: &[u32],
        entries: impl Iterator<Item = T>,
    ) {
        let (s0, y0, row) = (self.columns.len(), self.y.len(), self.g.len());
        for (&c, y) in columns.iter().zip(entries) {
            if y.as_ref().iter().any(|&y| y != 0.0) {
                self.columns.push(c);
                self.y.extend_from_slice(y.as_ref());
            }
        }
        if self.columns.len() > s0 {
            if constraint.normal_compliance > 0.0 {
                let entry = constraint.normal_compliance.sqrt();
                self.columns.push((self.eliminated.len() + self.own.len()) as u32);
                self.y.extend((0..g.len()).map(|row| if row == 0 { entry } else { 0.0 }));
                self.own.push(entry * lambda[0]);
            }
            self.g.extend_from_slice(g);
            self.lambda.extend_from_slice(lambda);
            let (columns, rows) = (s0..self.columns.len(), row..row + g.len());
            self.blocks.push(LaneBlock { constraint, kind: self.kind, source, columns, y: y0, rows });
        }
    }
}
