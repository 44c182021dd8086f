//! Hard equalities, taken out of every other row: what is left to be solved goes on in the motions that they allow.
//!
//! The rows e_k of separate equalities are orthogonal and demand e_k . w + g_k = 0. For another row y . w + g,
//!
//! ```text
//! y' = y - sum_k a_k e_k,    g' = g - sum_k a_k g_k,    a_k = y . e_k / |e_k|^2
//! ```
//!
//! is the same velocity for every w that they allow, and an impulse along y' leaves them as they are (the Schur complement of their block
//! of G; Golub & Van Loan 2013, section 3.2). So they are solved once, exactly, and impulses of the other rows are what they were. Sweeps
//! that go back and forth between a leg's coupling and the contact of its foot need two to five times as many.

use std::ops::Range;

use stepper_real::{Mask, Real, Scalar};
use stepper_solve::{ROUNDING_RATIO, ScalarRow, dependence_threshold, velocity_rounding};

use crate::compile::LaneModel;
use crate::constraints::constraint_set::Constraints;
use crate::dynamics::inertia::MassMatrix;
use crate::math::spatial::*;

impl<R: Real> Constraints<R> {
    /// Finds the separate equalities that share a degree of freedom with `support`, and adds what they move to it, with zeros in `column`.
    #[inline(always)]
    pub(crate) fn couple(&mut self, compiled: &LaneModel<R>) {
        if self.problem.scalars.separate() > 0 {
            self.words.fill(0);
            for &d in &self.support {
                self.words[d as usize / 64] |= 1 << (d % 64);
            }
        }
        self.find_coupled(compiled);
        if !self.coupled.is_empty() {
            self.list_support();
        }
    }

    /// The same of the dofs in `words`.
    #[inline(always)]
    pub(crate) fn find_coupled(&mut self, compiled: &LaneModel<R>) {
        self.coupled.clear();
        if self.problem.scalars.separate() > 0 {
            self.search_blocks(compiled);
        }
    }

    #[inline(never)]
    fn search_blocks(&mut self, compiled: &LaneModel<R>) {
        let mut start = 0;
        for block in compiled.equalities.iter().filter(|block| block.separate) {
            let rows = start..start + block.rows;
            start = rows.end;
            if block.set.iter().zip(&self.words).all(|(coupled, moved)| coupled & moved == 0) {
                continue;
            }
            for &d in &block.support {
                let d = d as usize;
                if self.words[d / 64] >> (d % 64) & 1 == 0 {
                    self.column[d] = zero();
                    self.signs[d] = [0; 2];
                }
            }
            for (word, coupled) in self.words.iter_mut().zip(&block.set) {
                *word |= coupled;
            }
            self.coupled.push(rows);
        }
    }

    /// Keeps the entries of separate equalities as `eliminate` reads them.
    #[inline(always)]
    pub(crate) fn store_eliminated(&mut self, compiled: &LaneModel<R>, mass: &MassMatrix<R>) {
        self.problem.scalars.mark_separate();
        let Self { problem, eliminated_entries, .. } = self;
        let [found, taken] = eliminated_entries;
        found.clear();
        taken.clear();
        let mut first = 0;
        for block in compiled.equalities.iter().filter(|block| block.separate) {
            let end = first + block.rows;
            while first < end {
                // Entries of up to four rows lie side by side.
                let rows = &problem.scalars[first..end.min(first + 4)];
                for (i, &d) in block.support.iter().enumerate() {
                    for row in rows {
                        let y = problem.scalars.entries(row).1[i];
                        found.push(y * mass.sqrt_inv_d[d as usize]);
                        taken.push(y * mass.sqrt_d[d as usize]);
                    }
                }
                first += rows.len();
            }
        }
    }

    /// Takes the coupled equalities out of the first `N` components of `column` on `support`, half solved but for D^-1/2, and out of what
    /// these rows demand: their velocities g of the step, and when positions are solved apart. Of a row that depends on them nothing is
    /// left. Returns the squared lengths of the rows before, and of what is left; nothing where no equality is coupled.
    #[inline(always)]
    pub(crate) fn eliminate<const N: usize>(&mut self, mass: &MassMatrix<R>, demands: &mut [[R; 2]; N]) -> Option<SquaredLengths<R, N>> {
        if self.coupled.is_empty() { None } else { Some(self.eliminate_coupled(mass, demands)) }
    }

    /// A kernel of its own: inlined where rows are made, it would be most of the code there, which few scenes need.
    #[inline(never)]
    fn eliminate_coupled<const N: usize>(&mut self, mass: &MassMatrix<R>, demands: &mut [[R; 2]; N]) -> SquaredLengths<R, N> {
        R::vectorize(
            #[inline(always)]
            || self.eliminate_blocks(mass, demands),
        )
    }

    #[inline(always)]
    fn eliminate_blocks<const N: usize>(&mut self, mass: &MassMatrix<R>, demands: &mut [[R; 2]; N]) -> SquaredLengths<R, N> {
        let mut whole = [R::zero(); N];
        for &d in &self.support {
            let (x, weight) = (&self.column[d as usize], mass.sqrt_inv_d[d as usize]);
            for n in 0..N {
                whole[n] += (x[n] * weight).square();
            }
        }
        let mut rest = whole;
        for block in 0..self.coupled.len() {
            let rows = self.coupled[block].clone();
            for first in rows.clone().step_by(4) {
                match rows.end - first {
                    1 => self.eliminate_rows::<N, 1>(first, demands, &mut rest),
                    2 => self.eliminate_rows::<N, 2>(first, demands, &mut rest),
                    3 => self.eliminate_rows::<N, 3>(first, demands, &mut rest),
                    _ => self.eliminate_rows::<N, 4>(first, demands, &mut rest),
                }
            }
        }
        let mut lengths = SquaredLengths { whole, rest };
        let mut short = [R::Mask::splat(false); N];
        let mut any = short[0];
        for n in 0..N {
            short[n] = rest[n].lt(whole[n] * R::of(inexact_part::<R>()));
            any = any.or(short[n]);
        }
        if any.any() {
            self.eliminate_again(mass, demands, &mut lengths, short);
        }
        lengths
    }

    /// Projects what is left of rows a second time, in the lanes `short`, in which it is short: it is then orthogonal to the equalities
    /// relative to its own length, and that is summed from what is left instead of by subtraction. Of a row of which no entry is more than
    /// a thousandth of the terms that it is the sum of, nothing is left, nor of what it demands if that is rounding.
    #[cold]
    #[inline(never)]
    fn eliminate_again<const N: usize>(
        &mut self,
        mass: &MassMatrix<R>,
        demands: &mut [[R; 2]; N],
        lengths: &mut SquaredLengths<R, N>,
        short: [R::Mask; N],
    ) {
        R::vectorize(
            #[inline(always)]
            || {
                let rounding = R::of(ROUNDING_RATIO / MIN_REMAINING_LENGTH);
                let Self { problem, column, coupled, projections, removed_scales, velocity_scales, support, .. } = self;
                for &d in &*support {
                    removed_scales[d as usize] = zero();
                }
                let mut speed = [[R::zero(); 2]; N];
                for k in coupled.iter().flat_map(Range::clone) {
                    let (row, share) = (&problem.scalars[k], projections[k]);
                    let (support, entries) = problem.scalars.entries(row);
                    let mut along = [R::zero(); N];
                    for (&d, &y) in support.iter().zip(entries) {
                        let (x, weight) = (&column[d as usize], mass.sqrt_inv_d[d as usize]);
                        for n in 0..N {
                            along[n] += x[n] * weight * y;
                        }
                    }
                    for n in 0..N {
                        along[n] = R::select(short[n], row.projection(along[n]), R::zero());
                        let g = [row.g, row.position_g];
                        demands[n] = sub(demands[n], scale(g, along[n]));
                        let other = share[n].square() * velocity_scales[k];
                        for (speed, g) in speed[n].iter_mut().zip(g) {
                            *speed += (share[n] * g).square() + other;
                        }
                    }
                    for (&d, &y) in support.iter().zip(entries) {
                        let (x, scale, y) = (&mut column[d as usize], &mut removed_scales[d as usize], y * mass.sqrt_d[d as usize]);
                        for n in 0..N {
                            let again = along[n] * y;
                            x[n] = R::select(short[n], x[n] - again, x[n]);
                            scale[n] += (share[n] * y).square() + again.square() * rounding;
                        }
                    }
                }
                // What the rounding of a coefficient makes of an entry: terms may have no part in it.
                for k in coupled.iter().flat_map(Range::clone) {
                    let (row, share) = (&problem.scalars[k], &mut projections[k]);
                    let (support, entries) = problem.scalars.entries(row);
                    let mut square = [R::zero(); N];
                    for (&d, &y) in support.iter().zip(entries) {
                        let (x, taken, y) = (&column[d as usize], &removed_scales[d as usize], y * mass.sqrt_inv_d[d as usize]);
                        for n in 0..N {
                            square[n] += (x[n].square() + taken[n]) * y.square();
                        }
                    }
                    for n in 0..N {
                        share[n] = row.projection(square[n].sqrt());
                    }
                }
                for k in coupled.iter().flat_map(Range::clone) {
                    let share = projections[k];
                    let (support, entries) = problem.scalars.entries(&problem.scalars[k]);
                    for (&d, &y) in support.iter().zip(entries) {
                        let (scale, y) = (&mut removed_scales[d as usize], y * mass.sqrt_d[d as usize]);
                        for n in 0..N {
                            scale[n] += (share[n] * y).square();
                        }
                    }
                }
                for n in 0..N {
                    let (mut rest, mut independent) = (R::zero(), R::Mask::splat(false));
                    for &d in &*support {
                        let (x, scale) = (column[d as usize][n], removed_scales[d as usize][n]);
                        rest += (x * mass.sqrt_inv_d[d as usize]).square();
                        independent = independent.or(x.square().gt(scale * R::of(MIN_REMAINING_LENGTH)));
                    }
                    let threshold = dependence_threshold::<R>().max(MIN_REMAINING_LENGTH);
                    let depends = short[n].and(lengths.rest[n].lt(lengths.whole[n] * R::of(threshold))).and_not(independent);
                    for &d in &*support {
                        let x = &mut column[d as usize][n];
                        *x = R::select(depends, R::zero(), *x);
                    }
                    lengths.rest[n] = R::select(short[n], R::select(depends, R::zero(), rest), lengths.rest[n]);
                    for (g, speed) in demands[n].iter_mut().zip(speed[n]) {
                        let none = depends.and(g.square().le(speed * R::of(velocity_rounding::<R>().powi(2))));
                        *g = R::select(none, R::zero(), *g);
                    }
                }
            },
        )
    }

    /// Adds to the scales of the first component of `column` those of what the last elimination has taken from it.
    #[inline(always)]
    pub(crate) fn add_removed_scales(&mut self, mass: &MassMatrix<R>) {
        let Self { problem, coupled, projections, scales, .. } = self;
        for k in coupled.iter().flat_map(Range::clone) {
            let (row, share) = (&problem.scalars[k], &mut projections[k]);
            let (support, entries) = problem.scalars.entries(row);
            let mut square = R::zero();
            for (&d, &y) in support.iter().zip(entries) {
                square += scales[d as usize][0] * (y * mass.sqrt_inv_d[d as usize]).square();
            }
            share[0] = row.projection(square.sqrt()).max(share[0].abs());
        }
        for k in coupled.iter().flat_map(Range::clone) {
            let share = projections[k];
            let (support, entries) = problem.scalars.entries(&problem.scalars[k]);
            for (&d, &y) in support.iter().zip(entries) {
                scales[d as usize][0] += (share[0] * y * mass.sqrt_d[d as usize]).square();
            }
        }
    }

    /// The same of `K` rows from `first` on, which have one support: what they hold is found in one pass over it, and taken away in
    /// another. What does not touch them keeps its bits. `rest` are the squared lengths of what is left.
    #[inline(always)]
    fn eliminate_rows<const N: usize, const K: usize>(&mut self, first: usize, demands: &mut [[R; 2]; N], rest: &mut [R; N]) {
        let Self { problem, column, eliminated_entries, projections, .. } = self;
        let rows: &[ScalarRow<R>; K] = problem.scalars[first..].first_chunk().expect("a block has its rows");
        let (support, _) = problem.scalars.entries(&rows[0]);
        let at = rows[0].entries().start;
        let [found, taken] = [&eliminated_entries[0], &eliminated_entries[1]].map(
            #[inline(always)]
            |entries| entries[at..].as_chunks::<K>().0,
        );
        let mut along = [[R::zero(); K]; N];
        for (&d, y) in support.iter().zip(found) {
            let x = &column[d as usize];
            for n in 0..N {
                for k in 0..K {
                    along[n][k] += x[n] * y[k];
                }
            }
        }
        for k in 0..K {
            let g = [rows[k].g, rows[k].position_g];
            let kept = &mut projections[first + k];
            for n in 0..N {
                let share = rows[k].projection(along[n][k]);
                kept[n] = share;
                rest[n] -= share * along[n][k];
                demands[n] = sub(demands[n], scale(g, share));
                along[n][k] = share;
            }
        }
        for (&d, y) in support.iter().zip(taken) {
            let x = &mut column[d as usize];
            for n in 0..N {
                for k in 0..K {
                    x[n] -= along[n][k] * y[k];
                }
            }
        }
    }
}

/// Part of the squared length of a row that equalities leave, below which they may prevent it: a contact whose normal they let move by a
/// thousandth of what the bodies could has impulses a million times as large as it should, and nothing but rounding decides between them.
/// That a light body is coupled to a heavy one leaves as little, so the same part of the square of every entry decides.
const MIN_REMAINING_LENGTH: f64 = 1e-6;

/// Part of the squared length of a row that equalities leave, below which it is projected twice: in 32 bits one projection leaves a part
/// of 1e-6 along the equalities there, and moves a light body that much more than the heavy one that it is coupled to.
fn inexact_part<R: Real>() -> f64 {
    if <R::Scalar as Scalar>::EPSILON.to_f64() > 1e-12 { 1e-2 } else { MIN_REMAINING_LENGTH }
}

/// Squared lengths of rows in the metric of G.
#[derive(Clone, Copy)]
pub(crate) struct SquaredLengths<R, const N: usize> {
    pub(crate) whole: [R; N],
    /// Of what is left when equalities are taken out.
    pub(crate) rest: [R; N],
}

impl<R: Real, const N: usize> SquaredLengths<R, N> {
    /// See [`trace_ratio`].
    #[inline(always)]
    pub(crate) fn trace_ratio(self) -> R {
        trace_ratio(&self.whole, &self.rest)
    }
}

/// Ratio of trace(G) before the elimination of separate equalities to that after it; 1 where nothing is left, and exactly 1 where nothing
/// was eliminated.
#[inline(always)]
pub(crate) fn trace_ratio<R: Real>(whole: &[R], rest: &[R]) -> R {
    let [mut before, mut after] = [R::zero(); 2];
    for (&whole, &rest) in whole.iter().zip(rest) {
        before += whole;
        after += rest;
    }
    let there = after.gt(R::zero());
    R::select(there, before / R::select(there, after, R::one()), R::one())
}
