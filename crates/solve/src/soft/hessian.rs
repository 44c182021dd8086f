//! Hessian M + J^T D J of the soft problem and its sparse factors L^T D L, from the last coordinate to the first, over lanes.
//!
//! Without constraints between branches of a tree there is no fill-in (Featherstone 2008, section 6.5). Its pattern is that of all lanes:
//! a lane that lacks an entry has a zero there, which changes none of its other numbers.

use std::ops::Range;

use stepper_real::Real;

use crate::constraints::constraint_set::is_nonzero;
use crate::soft::cone::Cone;
use crate::soft::problem::{Metric, SoftContacts, SoftProblem};

/// Symmetric matrix with a sparse pattern, and its factors.
#[derive(Clone, Debug)]
pub(super) struct Hessian<R: Real> {
    dimension: usize,
    /// Lower triangle, row by row; entries outside the pattern are never read. Factored, a row of L with 1 / D on the diagonal.
    entries: Vec<R>,
    /// Columns left of the diagonal that each row has, as a set, in words of 64 bits.
    sets: Vec<u64>,
    /// The same as ranges, ascending: of a tree's row there are few, and what is done to a range needs no index for every entry.
    runs: Vec<Vec<Range<usize>>>,
}

impl<R: Real> Hessian<R> {
    /// Room for a matrix of this dimension.
    pub(super) fn new(dimension: usize) -> Self {
        Self {
            dimension,
            entries: vec![R::zero(); dimension * dimension],
            sets: vec![0; dimension * dimension.div_ceil(64)],
            runs: (0..dimension).map(|i| Vec::with_capacity(i.div_ceil(2))).collect(),
        }
    }

    /// Finds the pattern of the factors for the rows of a problem.
    pub(super) fn find_pattern(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>) {
        let words = self.dimension.div_ceil(64);
        self.sets.fill(0);
        let mut couple = |columns: &mut dyn Iterator<Item = u32>, last: u32| {
            let set = &mut self.sets[last as usize * words..][..words];
            for c in columns {
                set[c as usize / 64] |= 1 << (c % 64);
            }
        };
        for i in 0..self.dimension {
            couple(&mut metric.row(i).0[1..].iter().copied(), i as u32);
        }
        let rows = problem.rows.iter().map(|row| problem.entries(row).0);
        let contacts = problem.contacts.items.iter().map(|contact| problem.contacts.entries(contact).0);
        let rolling = problem.rolling_contacts.items.iter().map(|contact| problem.rolling_contacts.entries(contact).0);
        for support in rows.chain(contacts).chain(rolling) {
            if let [before @ .., last] = support {
                couple(&mut before.iter().copied(), *last);
            }
        }
        // Elimination of a row couples the others of its columns: the last of them takes the rest up.
        for i in (0..self.dimension).rev() {
            let runs = &mut self.runs[i];
            let (above, own) = self.sets.split_at_mut(i * words);
            let own = &own[..words];
            list_runs(own, runs);
            if let Some(parent) = runs.last().map(|run| run.end - 1) {
                let target = &mut above[parent * words..][..words];
                for (target, own) in target.iter_mut().zip(own) {
                    *target |= own;
                }
                target[parent / 64] &= !(1 << (parent % 64));
            }
        }
    }

    /// Makes the matrix: `argument` is where the rows of the problem are.
    #[inline(always)]
    pub(super) fn assemble(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, argument: &Argument<R>) {
        let n = self.dimension;
        for (i, runs) in self.runs.iter().enumerate() {
            let row = &mut self.entries[i * n..][..=i];
            for run in runs {
                row[run.clone()].fill(R::zero());
            }
            let (columns, entries) = metric.row(i);
            for (&c, &entry) in columns.iter().zip(entries) {
                row[c as usize] = entry;
            }
        }
        for (row, &u) in problem.rows.iter().zip(&argument.rows) {
            let ((support, jacobian), weight) = (problem.entries(row), row.curvature(u));
            if !is_nonzero(weight) {
                continue;
            }
            for (k, (&d, &j)) in support.iter().zip(jacobian).enumerate() {
                let (entries, scaled) = (&mut self.entries[d as usize * n..][..=d as usize], j * weight);
                for (&c, &j) in support[..=k].iter().zip(jacobian) {
                    entries[c as usize] += scaled * j;
                }
            }
        }
        self.add_contacts(&problem.contacts, problem.cone, &argument.contacts);
        self.add_contacts(&problem.rolling_contacts, problem.cone, &argument.rolling_contacts);
    }

    /// Makes the metric with the couplings among the rows, those from `first` on; `lumped`, with no more of each than its diagonal. The
    /// pattern must be that of the problem.
    #[inline(always)]
    pub(super) fn assemble_metric(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, first: usize, lumped: bool) {
        let n = self.dimension;
        for (i, runs) in self.runs.iter().enumerate() {
            let row = &mut self.entries[i * n..][..=i];
            for run in runs {
                row[run.clone()].fill(R::zero());
            }
            let (columns, entries) = metric.row(i);
            for (&c, &entry) in columns.iter().zip(entries) {
                row[c as usize] = entry;
            }
        }
        for row in &problem.rows[first..] {
            let (support, jacobian) = problem.entries(row);
            for (k, (&d, &j)) in support.iter().zip(jacobian).enumerate() {
                let (entries, scaled) = (&mut self.entries[d as usize * n..][..=d as usize], j * row.weight);
                let from = if lumped { k } else { 0 };
                for (&c, &j) in support[from..=k].iter().zip(&jacobian[from..=k]) {
                    entries[c as usize] += scaled * j;
                }
            }
        }
    }

    #[inline(always)]
    fn add_contacts<const N: usize>(&mut self, contacts: &SoftContacts<R, N>, cone: Cone, u: &[[R; N]]) {
        let n = self.dimension;
        for (contact, u) in contacts.items.iter().zip(u) {
            let ((support, jacobian), curvature) = (contacts.entries(contact), cone.curvature(contact, u));
            // Where a contact is open in every lane there is nothing to add, and what is not open moves along the normal.
            if !is_nonzero(curvature[0][0]) {
                continue;
            }
            for (k, (&d, j)) in support.iter().zip(jacobian).enumerate() {
                let mut scaled = [R::zero(); N];
                for i in 0..N {
                    let mut sum = curvature[i][0] * j[0];
                    for m in 1..N {
                        sum += curvature[i][m] * j[m];
                    }
                    scaled[i] = sum;
                }
                let entries = &mut self.entries[d as usize * n..][..=d as usize];
                for (&c, j) in support[..=k].iter().zip(jacobian) {
                    let mut sum = scaled[0] * j[0];
                    for m in 1..N {
                        sum += scaled[m] * j[m];
                    }
                    entries[c as usize] += sum;
                }
            }
        }
    }

    /// Replaces the matrix by its factors.
    #[inline(always)]
    pub(super) fn factor(&mut self) {
        let n = self.dimension;
        for i in (0..n).rev() {
            let (above, own) = self.entries.split_at_mut(i * n);
            let (own, runs) = (&mut own[..=i], &self.runs[i]);
            let inverse = R::one() / own[i];
            own[i] = inverse;
            for (r, run) in runs.iter().enumerate().rev() {
                for a in run.clone().rev() {
                    let scaled = own[a] * inverse;
                    let target = &mut above[a * n..][..=a];
                    // Columns up to this one are not scaled yet.
                    for before in &runs[..r] {
                        subtract(&mut target[before.clone()], &own[before.clone()], scaled);
                    }
                    subtract(&mut target[run.start..], &own[run.start..=a], scaled);
                    own[a] = scaled;
                }
            }
        }
    }

    /// x <- H^-1 x, once factored.
    #[inline(always)]
    pub(super) fn solve(&self, x: &mut [R]) {
        let n = self.dimension;
        for i in (0..n).rev() {
            let (row, value) = (&self.entries[i * n..][..=i], x[i]);
            for run in &self.runs[i] {
                subtract(&mut x[run.clone()], &row[run.clone()], value);
            }
        }
        for i in 0..n {
            let row = &self.entries[i * n..][..=i];
            let mut value = x[i] * row[i];
            for run in &self.runs[i] {
                for (&l, &x) in row[run.clone()].iter().zip(&x[run.clone()]) {
                    value -= l * x;
                }
            }
            x[i] = value;
        }
    }
}

/// x -= factor * y
#[inline(always)]
fn subtract<R: Real>(x: &mut [R], y: &[R], factor: R) {
    for (x, &y) in x.iter_mut().zip(y) {
        *x -= factor * y;
    }
}

/// Lists the ranges of a set.
fn list_runs(set: &[u64], runs: &mut Vec<Range<usize>>) {
    runs.clear();
    for (w, &word) in set.iter().enumerate() {
        let mut bits = word;
        while bits != 0 {
            let start = 64 * w + bits.trailing_zeros() as usize;
            let length = (bits >> (start % 64)).trailing_ones() as usize;
            match runs.last_mut() {
                Some(last) if last.end == start => last.end += length,
                _ => runs.push(start..start + length),
            }
            bits &= if start % 64 + length == 64 { 0 } else { !0 << (start % 64 + length) };
        }
    }
}

/// Arguments u = J a - r of all rows, or their change J p.
#[derive(Clone, Debug, Default)]
pub(super) struct Argument<R> {
    pub(super) rows: Vec<R>,
    pub(super) contacts: Vec<[R; 3]>,
    pub(super) rolling_contacts: Vec<[R; 6]>,
}

impl<R: Real> Argument<R> {
    /// J x, less the references if `relative`.
    #[inline(always)]
    pub(super) fn multiply(&mut self, problem: &SoftProblem<R>, x: &[R], relative: bool) {
        problem.multiply_rows(x, relative, &mut self.rows);
        problem.contacts.multiply(x, relative, &mut self.contacts);
        problem.rolling_contacts.multiply(x, relative, &mut self.rolling_contacts);
    }

    /// self += step * change
    #[inline(always)]
    pub(super) fn advance(&mut self, change: &Self, step: R) {
        advance(&mut self.rows, &change.rows, step);
        advance(self.contacts.as_flattened_mut(), change.contacts.as_flattened(), step);
        advance(self.rolling_contacts.as_flattened_mut(), change.rolling_contacts.as_flattened(), step);
    }
}

/// x += step * change
#[inline(always)]
pub(super) fn advance<R: Real>(x: &mut [R], change: &[R], step: R) {
    for (x, &change) in x.iter_mut().zip(change) {
        *x += step * change;
    }
}
