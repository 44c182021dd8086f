//! Rows of one lane in scalar f64, gathered from the problem of all lanes. The solution's impulses are copied back to that lane.
//!
//! Entries that are exactly zero are left out, so that a lane does not depend on the contacts of other lanes.

use std::ops::Range;

use crate::constraints::constraint_set::{ConstraintList, ConstraintSet, LaneConstraint, has_lane, number_of};
use crate::constraints::friction::MAX_CONTACT_ROWS;
use crate::iterate::Iterate;
use crate::problem::System;
use stepper_real::{Real, Scalar};

/// Rows of one constraint of a lane.
#[derive(Clone, Debug)]
pub(super) struct LaneBlock {
    /// Admissible impulses and compliances. If the normal row has an additional compliance, the constraint has an extra coordinate. The
    /// normal row's entry there is the square root of this compliance.
    pub(super) constraint: LaneConstraint,
    /// Index of the constraint in the problem of all lanes, which counts the scalar rows first, then the contacts.
    pub(super) source: usize,
    /// Index of the constraint's first row in the problem of all lanes, which counts the scalar rows first.
    pub(super) source_row: usize,
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
    /// Gathers the rows of lane `lane` from the problem of all lanes, the scalar rows first. Eliminated rows are left out.
    #[inline(always)]
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
        let System { problem, scalars, contacts, .. } = system;
        self.gather_set(&problem.scalars, scalars, &iterate.scalars, lane, 0);
        self.gather_set(&problem.contacts, contacts, &iterate.contacts, lane, problem.scalars.len());
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
        for block in &self.blocks {
            let first = match block.source_row.checked_sub(iterate.scalars.len()) {
                None => &mut iterate.scalars[block.source_row..],
                Some(row) => &mut iterate.contacts[row..],
            };
            for (to, &x) in first.iter_mut().zip(&self.lambda[block.rows.clone()]) {
                to.set_lane(lane, Scalar::from_f64(x));
            }
        }
        for ((to, &x), part) in iterate.w.iter_mut().zip(&self.w).zip(&self.eliminated) {
            to.set_lane(lane, Scalar::from_f64(x + part));
        }
    }

    /// Gathers the constraints of one set that exist in lane `lane`. `before` is the number of constraints, and of their rows, in the sets
    /// before it.
    #[inline(always)]
    fn gather_set<R: Real, T: ConstraintList<R>>(
        &mut self,
        set: &ConstraintSet<R, T>,
        rows: &T,
        impulses: &[R],
        lane: usize,
        before: usize,
    ) {
        for (i, row) in rows.items().iter().enumerate() {
            let ((columns, y), [g, _], lambda) = (set.entries(row), rows.offsets(i), &impulses[row.rows()]);
            let entries = y.iter().map(|&y| number_of(y, lane));
            if i < set.eliminated {
                let lambda = number_of(lambda[0], lane);
                columns.iter().zip(entries).for_each(|(&c, y)| self.eliminated[c as usize] += y * lambda);
            } else if has_lane::<R>(row.active, lane) {
                let mut numbers = [[0.0; MAX_CONTACT_ROWS]; 2];
                for (to, from) in numbers.iter_mut().zip([g, lambda]) {
                    to.iter_mut().zip(from).for_each(|(to, &x)| *to = number_of(x, lane));
                }
                let numbers = numbers.each_ref().map(|numbers| &numbers[..g.len()]);
                self.add(rows.lane_constraint(i, lane), [before + i, before + row.rows().start], numbers, columns, entries);
            }
        }
    }

    /// Appends a constraint with the offsets g and the impulses lambda of its rows. `source` is its index, and that of its first row, in
    /// the problem of all lanes. `entries` are the entries of all rows at each coordinate in turn. An immovable constraint (without
    /// entries) is left out, because its impulses have no effect.
    pub(super) fn add(
        &mut self,
        constraint: LaneConstraint,
        [source, source_row]: [usize; 2],
        [g, lambda]: [&[f64]; 2],
        columns: &[u32],
        mut entries: impl Iterator<Item = f64>,
    ) {
        let (s0, y0, row) = (self.columns.len(), self.y.len(), self.g.len());
        for &c in columns {
            let start = self.y.len();
            self.y.extend(entries.by_ref().take(g.len()));
            if self.y[start..].iter().any(|&y| y != 0.0) {
                self.columns.push(c);
            } else {
                self.y.truncate(start);
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
            self.blocks.push(LaneBlock { constraint, source, source_row, columns, y: y0, rows });
        }
    }
}
