//! Elimination of hard equalities from all other rows. The solver then works within the motions that the equalities allow.
//!
//! The eliminated rows e_k are orthogonal and require e_k . w + g_k = 0. Here w is the velocity change by the impulses in scaled
//! coordinates, and g_k the offset of the row. Another row y . w + g becomes y' . w + g' with
//!
//! ```text
//! y' = y - sum_k a_k e_k,    g' = g - sum_k a_k g_k,    a_k = y . e_k / |e_k|^2
//! ```
//!
//! The new row has the same velocity for every allowed w, and an impulse along y' does not change the equalities. G of the rows y' is the
//! Schur complement of the equalities' block in G of all rows, where G is the Delassus matrix (Golub & Van Loan 2013, section 3.2). The
//! equalities are solved once, exactly, and the impulses of the other rows keep their meaning. Without elimination, Gauss-Seidel iterations
//! alternate between the coupling of a leg and the contact of its foot, and two to five times as many are needed.
//!
//! With the mass matrix L^T D L, y = J L^-1 D^-1/2 for a row J of the Jacobian. The code stores J L^-1, as `column`.

use std::ops::Range;

use stepper_real::{Mask, Real, Scalar, kernel};
use stepper_solve::{Problem, ROUNDING_RATIO, ScalarRow, dependence_threshold, velocity_rounding};

use crate::constraints::assembler::RowState;
use crate::constraints::row_builder::RowBuilder;
use crate::dynamics::inertia::MassMatrix;
use crate::math::spatial::*;
use crate::tuning::MIN_REMAINING_LENGTH;

impl<R: Real> RowBuilder<R> {
    /// Finds the eliminated equalities that share a degree of freedom with the row under construction. Adds the equalities' degrees of
    /// freedom to `dofs` of the row, with zeros in `column`.
    #[inline(always)]
    pub(crate) fn couple(&mut self, state: &RowState<'_, R>) {
        self.coupled.clear();
        if !state.compiled.equalities.is_empty() {
            self.words.fill(0);
            for &d in &self.dofs {
                self.words[d as usize / 64] |= 1 << (d % 64);
            }
            self.search_blocks(state);
            self.list_dofs();
        }
    }

    /// Finds the eliminated equalities that share a degree of freedom with the set `words` (one bit per degree of freedom). Adds their
    /// degrees of freedom to the set.
    #[inline(always)]
    pub(crate) fn find_coupled(&mut self, state: &RowState<'_, R>) {
        self.coupled.clear();
        if !state.compiled.equalities.is_empty() {
            self.search_blocks(state);
        }
    }

    /// Finds the blocks of eliminated equalities that have a degree of freedom in the set `words`. Most scenes have no such blocks, so that
    /// this code is not inlined.
    ///
    /// Blocks that are inactive in all lanes add their degrees of freedom too. A row's velocity is a sum over its degrees of freedom, and
    /// their number determines the order of the sum and so its rounding. The order in a lane must not depend on which equalities are
    /// active in other lanes.
    #[inline(never)]
    fn search_blocks(&mut self, state: &RowState<'_, R>) {
        let mut start = 0;
        for (k, block) in state.compiled.equalities.iter().enumerate().filter(|(_, block)| block.eliminated) {
            let active = state.active_equalities.has_rows(k);
            let rows = start..start + if active { block.rows } else { 0 };
            start = rows.end;
            if block.set.iter().zip(&self.words).all(|(coupled, moved)| coupled & moved == 0) {
                continue;
            }
            for &d in &block.dofs {
                let d = d as usize;
                if self.words[d / 64] >> (d % 64) & 1 == 0 {
                    self.column[d] = zero();
                    self.signs[d] = [0; 2];
                }
            }
            for (word, coupled) in self.words.iter_mut().zip(&block.set) {
                *word |= coupled;
            }
            if active {
                self.coupled.push(rows);
            }
        }
    }

    /// Eliminates the coupled equalities from the rows in the first `N` components of `column`, and from their offsets g, `offsets`.
    ///
    /// `offsets` has two offsets per row, m/s: of the velocity solve and of the position solve. A row that is a linear combination of the
    /// equality rows becomes zero. Returns the squared lengths (diagonal entries of G) of the rows before and after the elimination, 1/kg;
    /// `None` without coupled equalities.
    #[inline(always)]
    pub(crate) fn eliminate<const N: usize>(
        &mut self,
        rows: &Problem<R>,
        mass: &MassMatrix<R>,
        offsets: &mut [[R; 2]; N],
    ) -> Option<[[R; N]; 2]> {
        if self.coupled.is_empty() { None } else { Some(self.eliminate_coupled(rows, mass, offsets)) }
    }

    /// Subtracts the coupled equalities from the rows in `column`, in chunks of up to four. Rows that became short are projected a second
    /// time.
    ///
    /// The function is compiled separately: inlined, it would dominate the row assembly, and few scenes need it.
    #[inline(never)]
    fn eliminate_coupled<const N: usize>(&mut self, rows: &Problem<R>, mass: &MassMatrix<R>, offsets: &mut [[R; 2]; N]) -> [[R; N]; 2] {
        kernel!(R, || {
            let mut before = [R::zero(); N];
            for &d in &self.dofs {
                let (x, weight) = (&self.column[d as usize], mass.sqrt_inv_d[d as usize]);
                for n in 0..N {
                    before[n] += (x[n] * weight).square();
                }
            }
            let mut after = before;
            for block in 0..self.coupled.len() {
                let range = self.coupled[block].clone();
                for first in range.clone().step_by(4) {
                    match range.end - first {
                        1 => self.eliminate_rows::<N, 1>(rows, first, offsets, &mut after),
                        2 => self.eliminate_rows::<N, 2>(rows, first, offsets, &mut after),
                        3 => self.eliminate_rows::<N, 3>(rows, first, offsets, &mut after),
                        _ => self.eliminate_rows::<N, 4>(rows, first, offsets, &mut after),
                    }
                }
            }
            let mut lengths = [before, after];
            let mut short = [R::Mask::splat(false); N];
            let mut any = short[0];
            for n in 0..N {
                short[n] = after[n].lt(before[n] * R::of(reprojection_threshold::<R>()));
                any = any.or(short[n]);
            }
            if any.any() {
                self.repeat_elimination(rows, mass, offsets, &mut lengths, short);
            }
            lengths
        })
    }

    /// Projects the rows in `column` a second time, in the lanes `short` in which little of them remained after the first projection.
    ///
    /// After the first projection, rounding errors can be large compared with what remains of a row. The second projection removes them. A
    /// row becomes zero if none of its entries exceeds a thousandth of the terms that were summed in it. The offset of such a row becomes
    /// zero if the offset is rounding error.
    #[cold]
    #[inline(never)]
    fn repeat_elimination<const N: usize>(
        &mut self,
        rows: &Problem<R>,
        mass: &MassMatrix<R>,
        offsets: &mut [[R; 2]; N],
        lengths: &mut [[R; N]; 2],
        short: [R::Mask; N],
    ) {
        kernel!(R, || {
            let rounding = R::of(ROUNDING_RATIO / MIN_REMAINING_LENGTH);
            let Self { column, coupled, projections, removed_scales, velocity_scales, dofs, .. } = self;
            for &d in &*dofs {
                removed_scales[d as usize] = zero();
            }
            let mut speed = [[R::zero(); 2]; N];
            for k in coupled.iter().flat_map(Range::clone) {
                let (row, coefficient) = (&rows.scalars[k], projections[k]);
                let (dofs, entries) = rows.scalars.entries(row);
                let mut product = [R::zero(); N];
                for (&d, &y) in dofs.iter().zip(entries) {
                    let (x, weight) = (&column[d as usize], mass.sqrt_inv_d[d as usize]);
                    for n in 0..N {
                        product[n] += x[n] * weight * y;
                    }
                }
                for n in 0..N {
                    product[n] = R::select(short[n], row.projection(product[n]), R::zero());
                    let g = [row.g, row.position_g];
                    offsets[n] = sub(offsets[n], scale(g, product[n]));
                    let other = coefficient[n].square() * velocity_scales[k];
                    for (speed, g) in speed[n].iter_mut().zip(g) {
                        *speed += (coefficient[n] * g).square() + other;
                    }
                }
                for (&d, &y) in dofs.iter().zip(entries) {
                    let (x, scale, y) = (&mut column[d as usize], &mut removed_scales[d as usize], y * mass.sqrt_d[d as usize]);
                    for n in 0..N {
                        let repeated = product[n] * y;
                        x[n] = R::select(short[n], x[n] - repeated, x[n]);
                        scale[n] += (coefficient[n] * y).square() + repeated.square() * rounding;
                    }
                }
            }
            // The coefficient also has a rounding error, which the projection transfers to all entries of the equality.
            for k in coupled.iter().flat_map(Range::clone) {
                let (row, coefficient) = (&rows.scalars[k], &mut projections[k]);
                let (dofs, entries) = rows.scalars.entries(row);
                let mut square = [R::zero(); N];
                for (&d, &y) in dofs.iter().zip(entries) {
                    let (x, taken, y) = (&column[d as usize], &removed_scales[d as usize], y * mass.sqrt_inv_d[d as usize]);
                    for n in 0..N {
                        square[n] += (x[n].square() + taken[n]) * y.square();
                    }
                }
                for n in 0..N {
                    coefficient[n] = row.projection(square[n].sqrt());
                }
            }
            for k in coupled.iter().flat_map(Range::clone) {
                let coefficient = projections[k];
                let (dofs, entries) = rows.scalars.entries(&rows.scalars[k]);
                for (&d, &y) in dofs.iter().zip(entries) {
                    let (scale, y) = (&mut removed_scales[d as usize], y * mass.sqrt_d[d as usize]);
                    for n in 0..N {
                        scale[n] += (coefficient[n] * y).square();
                    }
                }
            }
            for n in 0..N {
                let (mut after, mut independent) = (R::zero(), R::Mask::splat(false));
                for &d in &*dofs {
                    let (x, scale) = (column[d as usize][n], removed_scales[d as usize][n]);
                    after += (x * mass.sqrt_inv_d[d as usize]).square();
                    independent = independent.or(x.square().gt(scale * R::of(MIN_REMAINING_LENGTH)));
                }
                let threshold = dependence_threshold::<R>().max(MIN_REMAINING_LENGTH);
                let [before, after_first] = [lengths[0][n], lengths[1][n]];
                let depends = short[n].and(after_first.lt(before * R::of(threshold))).and_not(independent);
                for &d in &*dofs {
                    let x = &mut column[d as usize][n];
                    *x = R::select(depends, R::zero(), *x);
                }
                lengths[1][n] = R::select(short[n], R::select(depends, R::zero(), after), after_first);
                for (g, speed) in offsets[n].iter_mut().zip(speed[n]) {
                    let none = depends.and(g.square().le(speed * R::of(velocity_rounding::<R>().powi(2))));
                    *g = R::select(none, R::zero(), *g);
                }
            }
        })
    }

    /// Updates the scales of the first component of `column` after an elimination: adds the scales of the terms that were subtracted. The
    /// scale of an entry is the size of the terms that it sums.
    #[inline(always)]
    pub(crate) fn add_removed_scales(&mut self, rows: &Problem<R>, mass: &MassMatrix<R>) {
        let Self { coupled, projections, scales, .. } = self;
        for k in coupled.iter().flat_map(Range::clone) {
            let (row, coefficient) = (&rows.scalars[k], &mut projections[k]);
            let (dofs, entries) = rows.scalars.entries(row);
            let mut square = R::zero();
            for (&d, &y) in dofs.iter().zip(entries) {
                square += scales[d as usize][0] * (y * mass.sqrt_inv_d[d as usize]).square();
            }
            coefficient[0] = row.projection(square.sqrt()).max(coefficient[0].abs());
        }
        for k in coupled.iter().flat_map(Range::clone) {
            let coefficient = projections[k];
            let (dofs, entries) = rows.scalars.entries(&rows.scalars[k]);
            for (&d, &y) in dofs.iter().zip(entries) {
                scales[d as usize][0] += (coefficient[0] * y * mass.sqrt_d[d as usize]).square();
            }
        }
    }

    /// Subtracts `K` equality rows with the same degrees of freedom, starting at row `first`, from the rows in `column`. Also updates
    /// `after`, the squared lengths of the rows in `column`.
    ///
    /// One pass over these degrees of freedom computes the coefficients, and another subtracts. Entries elsewhere keep their bits.
    #[inline(always)]
    fn eliminate_rows<const N: usize, const K: usize>(
        &mut self,
        rows: &Problem<R>,
        first: usize,
        offsets: &mut [[R; 2]; N],
        after: &mut [R; N],
    ) {
        let Self { column, eliminated_entries, projections, .. } = self;
        let chunk: &[ScalarRow<R>; K] = rows.scalars[first..].first_chunk().expect("a block has its rows");
        let (dofs, _) = rows.scalars.entries(&chunk[0]);
        let at = chunk[0].entries().start;
        let [over_sqrt_d, times_sqrt_d] = [&eliminated_entries[0], &eliminated_entries[1]].map(
            #[inline(always)]
            |entries| entries[at..].as_chunks::<K>().0,
        );
        let mut product = [[R::zero(); K]; N];
        for (&d, y) in dofs.iter().zip(over_sqrt_d) {
            let x = &column[d as usize];
            for n in 0..N {
                for k in 0..K {
                    product[n][k] += x[n] * y[k];
                }
            }
        }
        for k in 0..K {
            let g = [chunk[k].g, chunk[k].position_g];
            let kept = &mut projections[first + k];
            for n in 0..N {
                let coefficient = chunk[k].projection(product[n][k]);
                kept[n] = coefficient;
                after[n] -= coefficient * product[n][k];
                offsets[n] = sub(offsets[n], scale(g, coefficient));
                product[n][k] = coefficient;
            }
        }
        for (&d, y) in dofs.iter().zip(times_sqrt_d) {
            let x = &mut column[d as usize];
            for n in 0..N {
                for k in 0..K {
                    x[n] -= product[n][k] * y[k];
                }
            }
        }
    }
}

impl<R: Real> RowBuilder<R> {
    /// Marks all rows assembled so far as eliminated. Stores two copies of their entries for [`RowBuilder::eliminate`]: times D^-1/2, and
    /// times D^1/2.
    #[inline(always)]
    pub(crate) fn store_eliminated(&mut self, rows: &mut Problem<R>, state: &RowState<'_, R>) {
        let RowState { compiled, mass, active_equalities, .. } = *state;
        rows.scalars.mark_eliminated();
        let [over_sqrt_d, times_sqrt_d] = &mut self.eliminated_entries;
        over_sqrt_d.clear();
        times_sqrt_d.clear();
        let mut first = 0;
        for (k, block) in compiled.equalities.iter().enumerate() {
            if !block.eliminated || !active_equalities.has_rows(k) {
                continue;
            }
            let end = first + block.rows;
            while first < end {
                // Interleave the entries of up to four rows.
                let chunk = &rows.scalars[first..end.min(first + 4)];
                for (i, &d) in block.dofs.iter().enumerate() {
                    for row in chunk {
                        let y = rows.scalars.entries(row).1[i];
                        over_sqrt_d.push(y * mass.sqrt_inv_d[d as usize]);
                        times_sqrt_d.push(y * mass.sqrt_d[d as usize]);
                    }
                }
                first += chunk.len();
            }
        }
    }
}

/// Squared length of a row after elimination, relative to its squared length before, below which the row is projected a second time.
///
/// In 32 bits, a single projection of such a row leaves an error of 1e-6 along the equalities. That error moves a light body relative to
/// the heavy one to which it is coupled.
fn reprojection_threshold<R: Real>() -> f64 {
    if <R::Scalar as Scalar>::IS_SINGLE { 1e-2 } else { MIN_REMAINING_LENGTH }
}

/// Mobility of some rows before the elimination of equalities, divided by their mobility after it. The mobility is the sum of the rows'
/// squared lengths, the trace of their block of the Delassus matrix.
///
/// If the elimination leaves nothing of the rows, the function returns 1. Without elimination the result is exactly 1, without rounding
/// error.
#[inline(always)]
pub(crate) fn mobility_ratio<R: Real>(before: &[R], after: &[R]) -> R {
    let [mut mobility_before, mut mobility_after] = [R::zero(); 2];
    for (&before, &after) in before.iter().zip(after) {
        mobility_before += before;
        mobility_after += after;
    }
    let positive = mobility_after.gt(R::zero());
    R::select(positive, mobility_before / R::select(positive, mobility_after, R::one()), R::one())
}
