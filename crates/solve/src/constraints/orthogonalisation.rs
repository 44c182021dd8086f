//! Equality rows, made orthogonal to one another (modified Gram-Schmidt; Golub & Van Loan 2013, algorithm 5.2.6).
//!
//! Hard equalities demand y_k . w + g_k = 0 whatever the impulses, so any invertible combination of them demands the same. Combined so that
//! their entries are orthogonal, a sweep over them is the exact solution of all of them together, where a sweep over the rows of a closed
//! loop as they come converges slowly. A row that depends on those before it (a planar loop closed in three dimensions, two welds of the
//! same bodies) is left with no entries and drops out.
//!
//! The length of what is left of a row cannot tell a dependent row from one that joins a light body to a heavy one: entries of a body go
//! with 1 / sqrt(mass). So a row that comes out short is projected a second time, after which it is orthogonal to the others relative to
//! its own length ("twice is enough"; Parlett 1998, section 6.9), and is then judged entry by entry: it is independent if any entry is more
//! than the rounding of the terms that it is the sum of. Each entry has a scale for that, the root of the sum of the squares of its terms,
//! and of what the rounding of coefficients brings from other entries. Masses and units do not matter, since an entry and its scale have
//! the same.

use std::ops::Range;

use crate::cone::masked;
use crate::constraints::scalar::{ScalarRow, ScalarRows};
use stepper_real::{Mask, Real, Scalar};

/// Ratio of the squared length of a row, its projections on other rows removed, to that before, above which it is independent.
/// Below it entries decide: see `entry_threshold`.
pub fn dependence_threshold<R: Real>() -> f64 {
    let root = <R::Scalar as Scalar>::EPSILON.to_f64().sqrt();
    root * root.sqrt()
}

/// Ratio of the square of an entry to that of its scale below which it counts as zero: 1.3e-6 of the scale in 64 bits, as many as loops
/// near a singularity need; in 32 bits 3.8e-6, eight times the rounding of a Jacobian of twenty links.
fn entry_threshold<R: Real>() -> f64 {
    dependence_threshold::<f64>().max((32.0 * <R::Scalar as Scalar>::EPSILON.to_f64()).powi(2))
}

/// Square of the ratio to what a second projection moves in an entry, which is rounding, below which the entry is rounding too.
pub const ROUNDING_RATIO: f64 = 16.0;

/// Ratio of a velocity to its scale below which it is rounding: the velocity that a dependent row demands after those before it are met.
pub fn velocity_rounding<R: Real>() -> f64 {
    32.0 * <R::Scalar as Scalar>::EPSILON.to_f64()
}

/// Scales of the rows of a block of equalities, which tell dependent rows.
#[derive(Debug)]
pub struct RowScales<'a, R> {
    /// Squared lengths of numbers that each row's entries are differences of.
    pub lengths: &'a [R],
    /// Squared scale of the velocity that each row demands, (m/s)^2.
    pub velocities: &'a mut [R],
    /// Scales of entries, which only a row that comes out short needs.
    pub entries: Option<EntryScales<'a, R>>,
}

/// Scales of the entries of a block's rows.
#[derive(Debug)]
pub struct EntryScales<'a, R> {
    /// Squared scales, one row after the other.
    pub squares: &'a mut [R],
    /// Workspace: a number for each row.
    pub coefficients: &'a mut [R],
}

impl<R: Real> ScalarRows<R> {
    /// Orthogonalises the rows `rows`; `right_hand_sides` holds more right-hand sides of each of them, which are combined like g.
    ///
    /// The rows must be equalities (any impulse) without compliance, pushed one after the other with the same support. Their impulses are
    /// then those of the combined rows. A row drops out if it is shorter than its length in `scales` by a factor of 1e6 (f32: 4e2) and no
    /// entry of it is more than 1e-6 (f32: 4e-6) of its scale: it is rounding, or so nearly dependent that no impulse should be asked for
    /// it. `scales` become those of the combined rows. `decide` may change the right-hand sides of a row that is done, before those after
    /// it reckon with them.
    ///
    /// Returns false if a row comes out short and `scales` has none of entries: push the rows again and call this with them.
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
            let at = self.rows.items[k].y;
            let n = self.rows.items[k].coordinates;
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
            let mut remaining = self.squared_length(at, n);
            let short = self.rows.items[k].active.and_not(remaining.gt(tolerance * length));
            let mut independent = short.not();
            if short.any() {
                let Some(EntryScales { squares, coefficients }) = &mut entries else { return false };
                let own = &mut squares[(k - rows.start) * n..][..n];
                independent = independent.or(self.project_again(rows.start..k, k, short, [own, coefficients], right_hand_sides));
                remaining = R::select(short, self.squared_length(at, n), remaining);
            }
            let row = &mut self.rows.items[k];
            let was_active = row.active;
            row.active = was_active.and(independent).and(remaining.gt(R::zero()));
            row.immovable = row.immovable.or(was_active.and_not(row.active));
            row.diagonal = R::select(row.active, remaining, R::zero());
            row.inv_diagonal = R::one() / R::select(row.active, remaining, R::one());
            adjust(row, &mut right_hand_sides[k - rows.start]);
            let active = row.active;
            for y in self.y.row_mut(at, n) {
                *y = R::select(active, *y, R::zero());
            }
        }
        true
    }

    /// Removes from row `k` its projections on the rows `others` once more, in the lanes `lanes`, in which it is short. Returns those in
    /// which it does not depend on them. The squared scales of its entries take in what the rounding of coefficients makes of them.
    #[cold]
    #[inline(never)]
    fn project_again<const N: usize>(
        &mut self,
        others: Range<usize>,
        k: usize,
        lanes: R::Mask,
        [scales, coefficients]: [&mut [R]; 2],
        right_hand_sides: &mut [[R; N]],
    ) -> R::Mask {
        R::vectorize(
            #[inline(always)]
            || {
                let threshold = R::of(entry_threshold::<R>());
                let rounding = R::of(ROUNDING_RATIO / entry_threshold::<R>());
                let n = scales.len();
                for (j, coefficient) in others.clone().zip(&mut *coefficients) {
                    let row = &self.rows.items[j];
                    let mut square = R::zero();
                    for (&scale, &y) in scales.iter().zip(self.y.row(row.y, n)) {
                        square += scale * y.square();
                    }
                    *coefficient = square * row.inv_diagonal.square();
                }
                for (j, &error) in others.clone().zip(&*coefficients) {
                    let coefficient = self.remove_projection(k, j, Some(lanes));
                    let square = error + rounding * coefficient.square();
                    subtract_right_hand_sides(right_hand_sides, k - others.start, j - others.start, coefficient);
                    for (x, &y) in scales.iter_mut().zip(self.y.row(self.rows.items[j].y, n)) {
                        *x += square * y.square();
                    }
                }
                let mut independent = R::Mask::splat(false);
                for (&y, &scale) in self.y.row(self.rows.items[k].y, n).iter().zip(&*scales) {
                    independent = independent.or(y.square().gt(threshold * scale));
                }
                independent.and(lanes)
            },
        )
    }

    /// Squared length of the `n` entries from `at` on.
    #[inline(always)]
    fn squared_length(&self, at: usize, n: usize) -> R {
        let mut sum = R::zero();
        for &y in self.y.row(at, n) {
            sum += y * y;
        }
        sum
    }

    /// Removes from row `k` its projection on the earlier row `j`, in some lanes or in all; returns the coefficient of the projection.
    #[inline(always)]
    fn remove_projection(&mut self, k: usize, j: usize, lanes: Option<R::Mask>) -> R {
        let n = self.rows.items[k].coordinates;
        debug_assert_eq!(n, self.rows.items[j].coordinates, "rows of one support");
        let (before, row) = self.y.two_rows(self.rows.items[j].y, self.rows.items[k].y, n);
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

/// Subtracts the right-hand sides of row `j`, times the coefficient of a projection, from those of row `k`.
#[inline(always)]
fn subtract_right_hand_sides<R: Real, const N: usize>(right_hand_sides: &mut [[R; N]], k: usize, j: usize, coefficient: R) {
    let other = right_hand_sides[j];
    for (x, other) in right_hand_sides[k].iter_mut().zip(other) {
        *x -= coefficient * other;
    }
}
