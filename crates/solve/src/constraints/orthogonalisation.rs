//! Equality rows, made orthogonal to one another (modified Gram-Schmidt; Golub & Van Loan 2013, algorithm 5.2.6).
//!
//! Hard equalities demand y_k . w + g_k = 0 whatever the impulses, so any invertible combination of them demands the same. Combined so that
//! their entries are orthogonal, a sweep over them is the exact solution of all of them together, where a sweep over the rows of a closed
//! loop as they come converges slowly. A row that depends on those before it (a planar loop closed in three dimensions, two welds of the
//! same bodies) is left with no entries and drops out.

use std::ops::Range;

use crate::constraints::scalar::{ScalarRow, ScalarRows};
use stepper_real::{Mask, Real, Scalar};

/// Ratio of the squared length of a row, its projections on other rows removed, to that before, below which it is rounding.
pub fn dependence_threshold<R: Real>() -> f64 {
    let root = <R::Scalar as Scalar>::EPSILON.to_f64().sqrt();
    root * root.sqrt()
}

impl<R: Real> ScalarRows<R> {
    /// Orthogonalises the rows `rows`; `also` holds more right-hand sides of each of them, which are combined like g.
    ///
    /// The rows must be equalities (any impulse) without compliance, pushed one after the other with the same support. Their impulses are
    /// then those of the combined rows. `sizes` are the squared lengths of numbers that each row's entries are differences of: a row
    /// shorter than 1e-6 of that (f32: 3e-3) is rounding, or so nearly dependent that no impulse should be asked for it, and drops out.
    /// `decide` may change the right-hand sides of a row that is done, before those after it reckon with them.
    #[inline(always)]
    pub fn orthogonalise<const N: usize>(
        &mut self,
        rows: Range<usize>,
        sizes: &[R],
        also: &mut [[R; N]],
        mut decide: impl FnMut(&mut ScalarRow<R>, &mut [R; N]),
    ) {
        let tolerance = R::of(dependence_threshold::<R>());
        for (k, &size) in rows.clone().zip(sizes) {
            for j in rows.start..k {
                let coefficient = self.remove_projection(k, j);
                let other = also[j - rows.start];
                for (x, other) in also[k - rows.start].iter_mut().zip(other) {
                    *x -= coefficient * other;
                }
            }
            let at = self.rows.items[k].y;
            let n = self.rows.items[k].coordinates;
            let mut rest = R::zero();
            for &y in self.y.row(at, n) {
                rest += y * y;
            }
            let row = &mut self.rows.items[k];
            let asked = row.active;
            row.active = asked.and(rest.gt(tolerance * size));
            row.immovable = asked.and_not(row.active);
            row.diagonal = R::select(row.active, rest, R::zero());
            row.inv_diagonal = R::one() / R::select(row.active, rest, R::one());
            decide(row, &mut also[k - rows.start]);
            let active = row.active;
            for y in self.y.row_mut(at, n) {
                *y = R::select(active, *y, R::zero());
            }
        }
    }

    /// Removes from row `k` its projection on the earlier row `j`; returns the coefficient of the projection.
    #[inline(always)]
    fn remove_projection(&mut self, k: usize, j: usize) -> R {
        let n = self.rows.items[k].coordinates;
        debug_assert_eq!(n, self.rows.items[j].coordinates, "rows of one support");
        let (before, row) = self.y.two_rows(self.rows.items[j].y, self.rows.items[k].y, n);
        let mut along = R::zero();
        for (&a, &b) in before.iter().zip(row.iter()) {
            along += a * b;
        }
        let coefficient = self.rows.items[j].projection(along);
        for (&a, b) in before.iter().zip(row) {
            *b -= coefficient * a;
        }
        let g = self.rows.items[j].g;
        self.rows.items[k].g -= coefficient * g;
        coefficient
    }
}
