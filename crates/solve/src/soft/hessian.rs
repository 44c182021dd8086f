//! Hessian M + J^T D J of the soft problem and its sparse factors L^T D L, over lanes. Elimination goes from the last row to the first.
//!
//! Without constraints between branches of a tree there is no fill-in (Featherstone 2008, section 6.5). There is also none if coordinates
//! with many connections come first. The pattern is that of all lanes. A lane without an entry has a zero there, which changes none of its
//! other numbers.

use std::ops::Range;

use stepper_real::Real;

use crate::constraints::constraint_set::is_nonzero;
use crate::soft::cone::Cone;
use crate::soft::problem::{Metric, SoftContacts, SoftProblem};

/// Symmetric matrix with a sparse pattern, replaced by its factors.
#[derive(Clone, Debug)]
pub(super) struct Hessian<R: Real> {
    /// Number of rows of the matrix.
    dimension: usize,
    /// Row of the matrix for each coordinate. The last row is eliminated first.
    places: Vec<u32>,
    /// Lower triangle of the matrix, row by row. Entries outside the pattern are never read. After factorisation it has rows of L with 1 /
    /// D on the diagonal.
    entries: Vec<R>,
    /// Columns left of the diagonal that are in the pattern of each row, as bits in words of 64.
    sets: Vec<u64>,
    /// Columns left of the diagonal that are in the pattern of each row, as ascending ranges. Rows of a tree have few ranges, and loops
    /// over a range need no index for each entry.
    runs: Vec<Vec<Range<usize>>>,
    /// For each row, whether its columns left of the diagonal are those of the previous row plus the index of the previous row. The joints
    /// of a body or of a limb have such rows.
    follows: Vec<bool>,
    /// Number of multiplications of a factorisation with the current pattern and of a solution with the factors, together.
    pub(super) work: usize,
    /// Buffer for a vector in the order of the matrix rows.
    ordered: Vec<R>,
}

/// Largest number of matrix rows that are eliminated together. The entries of the remaining rows are then read and written once for all
/// eliminated rows.
const BLOCK: usize = 3;

impl<R: Real> Hessian<R> {
    /// Workspace for a matrix whose rows are coordinates (degrees of freedom) in the order `order`.
    pub(super) fn new(order: &[u32]) -> Self {
        let dimension = order.len();
        let mut places = vec![0; dimension];
        order.iter().enumerate().for_each(|(place, &d)| places[d as usize] = place as u32);
        Self {
            dimension,
            places,
            entries: vec![R::zero(); dimension * dimension],
            sets: vec![0; dimension * dimension.div_ceil(64)],
            runs: (0..dimension).map(|i| Vec::with_capacity(i.div_ceil(2))).collect(),
            follows: vec![false; dimension],
            work: 0,
            ordered: vec![R::zero(); dimension],
        }
    }

    /// Finds the pattern of the factors for the rows of a problem and the mass matrix `metric`.
    pub(super) fn find_pattern(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>) {
        let words = self.dimension.div_ceil(64);
        self.sets.fill(0);
        let mut couple = |coordinates: &[u32]| {
            let places = coordinates.iter().map(|&d| self.places[d as usize]);
            let Some(last) = places.clone().max() else { return };
            let set = &mut self.sets[last as usize * words..][..words];
            for place in places.filter(|&place| place != last) {
                set[place as usize / 64] |= 1 << (place % 64);
            }
        };
        for i in 0..self.dimension {
            couple(metric.row(i).0);
        }
        problem.rows.iter().for_each(|row| couple(problem.entries(row).0));
        problem.contacts.items.iter().for_each(|contact| couple(problem.contacts.entries(contact).0));
        problem.rolling_contacts.items.iter().for_each(|contact| couple(problem.rolling_contacts.entries(contact).0));
        // Elimination of a row couples its other columns. The last of these columns receives the others in its set.
        self.work = 0;
        for i in (0..self.dimension).rev() {
            let runs = &mut self.runs[i];
            let (above, own) = self.sets.split_at_mut(i * words);
            let own = &mut own[..words];
            list_runs(own, runs);
            let columns: usize = runs.iter().map(ExactSizeIterator::len).sum();
            self.work += columns * (columns + 5) / 2;
            self.follows[i] = false;
            if let Some(parent) = runs.last().map(|run| run.end - 1) {
                let target = &mut above[parent * words..][..words];
                own[parent / 64] &= !(1 << (parent % 64));
                for (target, own) in target.iter_mut().zip(&*own) {
                    *target |= own;
                }
                // All rows from this one on have been eliminated, so that the pattern of the previous row is complete.
                self.follows[i] = parent + 1 == i && target == own;
                own[parent / 64] |= 1 << (parent % 64);
            }
        }
    }

    /// Computes the Hessian M + J^T D J at the relative accelerations `argument` of all rows.
    #[inline(always)]
    pub(super) fn assemble(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, argument: &Argument<R>) {
        self.copy_metric(metric);
        for (row, &u) in problem.rows.iter().zip(&argument.rows) {
            let ((columns, jacobian), weight) = (problem.entries(row), row.curvature(u));
            if !is_nonzero(weight) {
                continue;
            }
            for (k, (&d, &j)) in columns.iter().zip(jacobian).enumerate() {
                let scaled = j * weight;
                for (&c, &j) in columns[..=k].iter().zip(jacobian) {
                    *self.entry(d, c) += scaled * j;
                }
            }
        }
        self.add_contacts(&problem.contacts, problem.cone, &argument.contacts);
        self.add_contacts(&problem.rolling_contacts, problem.cone, &argument.rolling_contacts);
    }

    /// Sets the entries to those of the mass matrix, and to zero where only other terms have entries.
    #[inline(always)]
    fn copy_metric(&mut self, metric: &impl Metric<R>) {
        for (i, runs) in self.runs.iter().enumerate() {
            let row = &mut self.entries[i * self.dimension..][..=i];
            for run in runs {
                row[run.clone()].fill(R::zero());
            }
        }
        for i in 0..self.dimension {
            let (columns, entries) = metric.row(i);
            for (&c, &entry) in columns.iter().zip(entries) {
                *self.entry(i as u32, c) = entry;
            }
        }
    }

    /// Entry of the symmetric matrix for the coordinates `a` and `b`, mutable.
    #[inline(always)]
    fn entry(&mut self, a: u32, b: u32) -> &mut R {
        let (a, b) = (self.places[a as usize] as usize, self.places[b as usize] as usize);
        &mut self.entries[a.max(b) * self.dimension + a.min(b)]
    }

    /// Adds the terms J^T C J of all contacts to the Hessian. C is the second derivative of a contact's convex function at its relative
    /// acceleration in `u`.
    #[inline(always)]
    fn add_contacts<const N: usize>(&mut self, contacts: &SoftContacts<R, N>, cone: Cone, u: &[[R; N]]) {
        for (contact, u) in contacts.items.iter().zip(u) {
            let ((columns, jacobian), curvature) = (contacts.entries(contact), cone.curvature(contact, u));
            // A contact that is open in every lane adds nothing, and an active one has a curvature along the normal.
            if !is_nonzero(curvature[0][0]) {
                continue;
            }
            if N == 6 && contact.does_not_roll {
                self.add_contact::<N, 4>(columns, jacobian, &curvature);
            } else {
                self.add_contact::<N, N>(columns, jacobian, &curvature);
            }
        }
    }

    /// Adds the term J^T C J of the first `U` rows of a contact to the Hessian. `columns` are its coordinates, and C = `curvature` is the
    /// second derivative of its convex function.
    #[inline(always)]
    fn add_contact<const N: usize, const U: usize>(&mut self, columns: &[u32], jacobian: &[[R; N]], curvature: &[[R; N]; N]) {
        for (k, (&d, j)) in columns.iter().zip(jacobian).enumerate() {
            let mut scaled = [R::zero(); U];
            for i in 0..U {
                let mut sum = curvature[i][0] * j[0];
                for m in 1..U {
                    sum += curvature[i][m] * j[m];
                }
                scaled[i] = sum;
            }
            for (&c, j) in columns[..=k].iter().zip(jacobian) {
                let mut sum = scaled[0] * j[0];
                for m in 1..U {
                    sum += scaled[m] * j[m];
                }
                *self.entry(d, c) += sum;
            }
        }
    }

    /// Replaces the matrix by its factors L^T D L: L below the diagonal, 1 / D on it.
    #[inline(always)]
    pub(super) fn factor(&mut self) {
        let mut end = self.dimension;
        while end > 0 {
            let mut first = end - 1;
            while self.follows[first] && end - first < BLOCK {
                first -= 1;
            }
            match end - first {
                1 => self.eliminate::<1>(first),
                2 => self.eliminate::<2>(first),
                _ => self.eliminate::<BLOCK>(first),
            }
            end = first;
        }
    }

    /// Eliminates `W` rows of the matrix, from row `first` on. The columns of each row after the first must be those of the previous row
    /// plus the index of the previous row.
    ///
    /// Subtractions start with the last row, so that the bits are those of an elimination row by row.
    #[inline(always)]
    fn eliminate<const W: usize>(&mut self, first: usize) {
        let n = self.dimension;
        let (above, block) = self.entries.split_at_mut(first * n);
        let runs = &self.runs[first];
        let mut inverse = [R::zero(); W];
        for t in (0..W).rev() {
            let (before, own) = block.split_at_mut(t * n);
            inverse[t] = R::one() / own[first + t];
            own[first + t] = inverse[t];
            for r in (0..t).rev() {
                let (target, scaled) = (&mut before[r * n..], own[first + r] * inverse[t]);
                for run in runs {
                    subtract(&mut target[run.clone()], &own[run.clone()], scaled);
                }
                subtract(&mut target[first..=first + r], &own[first..=first + r], scaled);
                own[first + r] = scaled;
            }
        }
        for (r, run) in runs.iter().enumerate().rev() {
            for a in run.clone().rev() {
                let mut scaled = [R::zero(); W];
                for t in 0..W {
                    scaled[t] = block[t * n + a] * inverse[t];
                }
                let target = &mut above[a * n..][..=a];
                // Columns up to this one are not scaled yet.
                for before in &runs[..r] {
                    subtract_rows(&mut target[before.clone()], block, n, before.start, scaled);
                }
                subtract_rows(&mut target[run.start..], block, n, run.start, scaled);
                for t in 0..W {
                    block[t * n + a] = scaled[t];
                }
            }
        }
    }

    /// Replaces `x` by H^-1 x, from the factors of the Hessian H.
    #[inline(always)]
    pub(super) fn solve(&mut self, x: &mut [R]) {
        for (&place, &x) in self.places.iter().zip(&*x) {
            self.ordered[place as usize] = x;
        }
        let (n, ordered) = (self.dimension, &mut self.ordered);
        for i in (0..n).rev() {
            let (row, value) = (&self.entries[i * n..][..=i], ordered[i]);
            for run in &self.runs[i] {
                subtract(&mut ordered[run.clone()], &row[run.clone()], value);
            }
        }
        for i in 0..n {
            let row = &self.entries[i * n..][..=i];
            let mut value = ordered[i] * row[i];
            for run in &self.runs[i] {
                for (&l, &x) in row[run.clone()].iter().zip(&ordered[run.clone()]) {
                    value -= l * x;
                }
            }
            ordered[i] = value;
        }
        for (&place, x) in self.places.iter().zip(x) {
            *x = ordered[place as usize];
        }
    }
}

/// Subtracts `factor` times `y` from `x`.
#[inline(always)]
fn subtract<R: Real>(x: &mut [R], y: &[R], factor: R) {
    for (x, &y) in x.iter_mut().zip(y) {
        *x -= factor * y;
    }
}

/// Subtracts `W` rows, each times its entry of `factors`, from `x`, the last row first. Row t begins at index `t * n + start` of `rows` and
/// has the length of `x`.
#[inline(always)]
fn subtract_rows<R: Real, const W: usize>(x: &mut [R], rows: &[R], n: usize, start: usize, factors: [R; W]) {
    let mut parts = [&rows[..0]; W];
    for t in 0..W {
        parts[t] = &rows[t * n + start..][..x.len()];
    }
    for (i, x) in x.iter_mut().enumerate() {
        let mut value = *x;
        for t in (0..W).rev() {
            value -= factors[t] * parts[t][i];
        }
        *x = value;
    }
}

/// Lists the ranges of consecutive 1 bits of a bit set.
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

/// Relative acceleration u = J a - r of each row, where r is its reference acceleration; or its change J p along a direction p.
#[derive(Clone, Debug, Default)]
pub(super) struct Argument<R> {
    /// Relative acceleration, or its change, of each scalar row.
    pub(super) rows: Vec<R>,
    /// Relative accelerations, or their changes, of each contact with three rows.
    pub(super) contacts: Vec<[R; 3]>,
    /// Relative accelerations, or their changes, of each contact with six rows.
    pub(super) rolling_contacts: Vec<[R; 6]>,
}

impl<R: Real> Argument<R> {
    /// Multiplies the Jacobian J of all rows of a problem by the vector `x`, and stores J x. If `relative`, the reference accelerations are
    /// subtracted.
    #[inline(always)]
    pub(super) fn multiply(&mut self, problem: &SoftProblem<R>, x: &[R], relative: bool) {
        problem.multiply_rows(x, relative, &mut self.rows);
        problem.contacts.multiply(x, relative, &mut self.contacts);
        problem.rolling_contacts.multiply(x, relative, &mut self.rolling_contacts);
    }

    /// Sets the relative accelerations of all rows of a problem to zero.
    pub(super) fn clear_for(&mut self, problem: &SoftProblem<R>) {
        let Self { rows, contacts, rolling_contacts } = self;
        rows.clear();
        rows.resize(problem.rows.len(), R::zero());
        contacts.clear();
        contacts.resize(problem.contacts.items.len(), [R::zero(); 3]);
        rolling_contacts.clear();
        rolling_contacts.resize(problem.rolling_contacts.items.len(), [R::zero(); 6]);
    }

    /// Moves the relative accelerations of all rows by `step` times their change `change`.
    #[inline(always)]
    pub(super) fn advance(&mut self, change: &Self, step: R) {
        advance(&mut self.rows, &change.rows, step);
        advance(self.contacts.as_flattened_mut(), change.contacts.as_flattened(), step);
        advance(self.rolling_contacts.as_flattened_mut(), change.rolling_contacts.as_flattened(), step);
    }
}

/// Adds `step` times `change` to `x`.
#[inline(always)]
pub(super) fn advance<R: Real>(x: &mut [R], change: &[R], step: R) {
    for (x, &change) in x.iter_mut().zip(change) {
        *x += step * change;
    }
}
