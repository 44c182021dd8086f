//! Orthogonalisation of equality rows (modified Gram-Schmidt; Golub & Van Loan 2013, algorithm 5.2.6).
//!
//! Hard equalities require y_k . w + g_k = 0 for all impulses, so that every invertible combination of the rows is equivalent. With
//! orthogonal rows one Gauss-Seidel iteration (a "sweep" over the rows) solves all equalities exactly. With the original rows of a closed
//! loop, sweeps converge slowly. A row that depends linearly on earlier rows loses all its entries and is removed. Examples are a planar
//! loop closed in three dimensions, and two welds of the same bodies.
//!
//! The remaining length of a row does not reveal dependence. A row that couples a light body to a heavy one is short as well, because the
//! entries of a body scale with 1 / sqrt(mass). A short row is therefore projected a second time, which makes it orthogonal to the others
//! relative to its remaining length ("twice is enough"; Parlett 1998, section 6.9). The row is then independent if any of its entries
//! exceeds the rounding error of the terms that were summed in this entry.
//!
//! The scale of an entry is the root of the sum of the squares of these terms. The sum includes the rounding error that coefficients
//! transfer from other entries. Masses and units cancel in the ratio of an entry to its scale, because both have the same factor.

use std::ops::Range;

use crate::cone::masked;
use crate::constraints::scalar::{ScalarRow, ScalarRows};
use stepper_real::{Mask, Real, Scalar, kernel};

/// Ratio of squared lengths above which a row is independent of the others. It is the squared length without the projections on the other
/// rows, divided by that before cancellation. For smaller ratios the sizes of the entries decide.
pub fn dependence_threshold<R: Real>() -> f64 {
    let root = <R::Scalar as Scalar>::EPSILON.to_f64().sqrt();
    root * root.sqrt()
}

/// Square of the ratio of an entry to its scale (size of the summed terms) below which the entry counts as zero.
///
/// The ratio is 1.3e-6 in 64 bits, enough for loops near a singularity. In 32 bits it is 3.8e-6, eight times the rounding error of a
/// Jacobian of twenty links.
fn entry_threshold<R: Real>() -> f64 {
    dependence_threshold::<f64>().max((32.0 * <R::Scalar as Scalar>::EPSILON.to_f64()).powi(2))
}

/// Square of the ratio of a Jacobian entry to its rounding error below which the entry counts as zero. The second projection changes an
/// entry by about its rounding error.
pub const ROUNDING_RATIO: f64 = 16.0;

/// Ratio of the target velocity of a linearly dependent row to its scale (size of the summed terms) below which the target is rounding
/// error.
pub fn velocity_rounding<R: Real>() -> f64 {
    32.0 * <R::Scalar as Scalar>::EPSILON.to_f64()
}

/// Scales of equality rows, with which linearly dependent rows are found. The scale of a number is the size of the terms whose sum it is,
/// and determines the number's rounding error.
#[derive(Debug)]
pub struct RowScales<'a, R> {
    /// Squared length of each row before cancellation: the row's entries are differences of numbers of this size.
    pub lengths: &'a [R],
    /// Squared scale of the target velocity of each row, (m/s)^2. The scale is the size of the terms that are summed in the target.
    pub velocities: &'a mut [R],
    /// Scales of the entries of all rows, which show whether an entry is rounding error. They may be `None` as long as no row is short.
    pub entries: Option<EntryScales<'a, R>>,
}

/// Scales of the entries of all rows: the size of the terms that are summed in each entry.
#[derive(Debug)]
pub struct EntryScales<'a, R> {
    /// Squared scale of each entry, row after row. The scale is the size of the terms that are summed in the entry.
    pub squares: &'a mut [R],
    /// Workspace with one number per row.
    pub coefficients: &'a mut [R],
}

impl<R: Real> ScalarRows<R> {
    /// Makes the Jacobians of the scalar rows with the indices `rows` orthogonal to each other. `right_hand_sides` has `N` further
    /// right-hand sides of each of these rows, which are combined in the same way as the offset g.
    ///
    /// The rows must be equalities without compliance and bounds, pushed consecutively with the same columns. Afterwards the impulses and
    /// `scales` refer to the combined rows. A row is removed if two conditions hold:
    ///
    /// - The row is shorter than its length in `scales` by a factor of 1e6 (f32: 4e2).
    /// - None of its entries exceeds 1e-6 (f32: 4e-6) of the entry's scale.
    ///
    /// Such a row is rounding error, or so nearly dependent that its impulse would be meaningless. `adjust` may change the right-hand sides
    /// of a finished row before later rows use them.
    ///
    /// Returns false if a row is short and `scales.entries` is `None`. The caller must then push the rows again, and repeat the call with
    /// the scales of the entries.
    #[inline(always)]
    #[must_use]
    pub fn orthogonalise<const N: usize>(
        &mut self,
        rows: Range<usize>,
        scales: RowScales<'_, R>,
        right_hand_sides: &mut [[R; N]],
        mut adjust: impl FnMut(&mut ScalarRow<R>, &mut [R; N]),
    ) -> bool {
        let tolerance = R::of(dependence_threshold::<R>());
        let RowScales { lengths, velocities, mut entries } = scales;
        for (k, &length) in rows.clone().zip(lengths) {
            let n = self.rows.items[k].span.num_columns;
            for j in rows.start..k {
                let coefficient = self.remove_projection(k, j, None);
                let (i, square) = (j - rows.start, coefficient * coefficient);
                subtract_right_hand_sides(right_hand_sides, k - rows.start, i, coefficient);
                if let Some(EntryScales { squares, .. }) = &mut entries {
                    let (before, own) = squares.split_at_mut((k - rows.start) * n);
                    for (x, &other) in own.iter_mut().zip(&before[i * n..][..n]) {
                        *x += square * other;
                    }
                }
                let other = velocities[i];
                velocities[k - rows.start] += square * other;
            }
            let mut remaining = self.squared_length(k);
            let short = self.rows.items[k].active.and_not(remaining.gt(tolerance * length));
            let mut independent = short.not();
            if short.any() {
                let Some(EntryScales { squares, coefficients }) = &mut entries else { return false };
                let own = &mut squares[(k - rows.start) * n..][..n];
                independent = independent.or(self.repeat_projection(rows.start..k, k, short, [own, coefficients], right_hand_sides));
                remaining = R::select(short, self.squared_length(k), remaining);
            }
            let row = &mut self.rows.items[k];
            let was_active = row.active;
            row.common.active = was_active.and(independent).and(remaining.gt(R::zero()));
            row.common.immovable = row.immovable.or(was_active.and_not(row.active));
            row.diagonal = R::select(row.active, remaining, R::zero());
            row.inv_diagonal = R::one() / R::select(row.active, remaining, R::one());
            adjust(row, &mut right_hand_sides[k - rows.start]);
            let (active, entries) = (row.active, row.entries());
            for y in self.y.range_mut(entries) {
                *y = R::select(active, *y, R::zero());
            }
        }
        true
    }

    /// Subtracts the projections of row `k` on the rows `others` a second time, in the lanes `lanes`, in which row `k` is short. Returns
    /// the lanes in which row `k` is independent of the other rows.
    ///
    /// The rounding error of the coefficients is added to the squared scales of the row's entries.
    #[cold]
    #[inline(never)]
    fn repeat_projection<const N: usize>(
        &mut self,
        others: Range<usize>,
        k: usize,
        lanes: R::Mask,
        [scales, coefficients]: [&mut [R]; 2],
        right_hand_sides: &mut [[R; N]],
    ) -> R::Mask {
        kernel!(R, || {
            let threshold = R::of(entry_threshold::<R>());
            let rounding = R::of(ROUNDING_RATIO / entry_threshold::<R>());
            for (j, coefficient) in others.clone().zip(&mut *coefficients) {
                let row = &self.rows.items[j];
                let mut square = R::zero();
                for (&scale, &y) in scales.iter().zip(self.y.range(row.entries())) {
                    square += scale * y.square();
                }
                *coefficient = square * row.inv_diagonal.square();
            }
            for (j, &error) in others.clone().zip(&*coefficients) {
                let coefficient = self.remove_projection(k, j, Some(lanes));
                let square = error + rounding * coefficient.square();
                subtract_right_hand_sides(right_hand_sides, k - others.start, j - others.start, coefficient);
                for (x, &y) in scales.iter_mut().zip(self.y.range(self.rows.items[j].entries())) {
                    *x += square * y.square();
                }
            }
            let mut independent = R::Mask::splat(false);
            for (&y, &scale) in self.y.range(self.rows.items[k].entries()).iter().zip(&*scales) {
                independent = independent.or(y.square().gt(threshold * scale));
            }
            independent.and(lanes)
        })
    }

    /// Squared length of row `k`.
    #[inline(always)]
    fn squared_length(&self, k: usize) -> R {
        let mut sum = R::zero();
        for &y in self.y.range(self.rows.items[k].entries()) {
            sum += y * y;
        }
        sum
    }

    /// Subtracts from row `k` its projection on the earlier row `j`, in `lanes` or in all lanes. Returns the multiple of row `j` that was
    /// subtracted.
    #[inline(always)]
    fn remove_projection(&mut self, k: usize, j: usize, lanes: Option<R::Mask>) -> R {
        let [earlier, own] = [j, k].map(|i| self.rows.items[i].entries());
        debug_assert_eq!(earlier.len(), own.len(), "rows with the same columns");
        let (before, row) = self.y.two_ranges(earlier, own);
        let mut product = R::zero();
        for (&a, &b) in before.iter().zip(row.iter()) {
            product += a * b;
        }
        let mut coefficient = self.rows.items[j].projection(product);
        if let Some(lanes) = lanes {
            coefficient = masked(lanes, coefficient);
            for (&a, b) in before.iter().zip(row) {
                *b = R::select(lanes, *b - coefficient * a, *b);
            }
        } else {
            for (&a, b) in before.iter().zip(row) {
                *b -= coefficient * a;
            }
        }
        let g = self.rows.items[j].g;
        self.rows.items[k].g -= coefficient * g;
        coefficient
    }
}

/// Subtracts `coefficient` times the right-hand sides of row `j` from those of row `k`.
#[inline(always)]
fn subtract_right_hand_sides<R: Real, const N: usize>(right_hand_sides: &mut [[R; N]], k: usize, j: usize, coefficient: R) {
    let other = right_hand_sides[j];
    for (x, other) in right_hand_sides[k].iter_mut().zip(other) {
        *x -= coefficient * other;
    }
}
