//! Equality rows, made orthogonal to one another (modified Gram-Schmidt; Golub & Van Loan 2013, algorithm 5.2.6).
//!
//! Hard equalities demand y_k . w + g_k = 0 whatever the impulses, so any invertible combination of them demands the same. Combined so that
//! their entries are orthogonal, a sweep over them is the exact solution of all of them together, where a sweep over the rows of a closed
//! loop as they come converges slowly. A row that depends on those before it (a planar loop closed in three dimensions, two welds of the
//! same bodies) is left with no entries and drops out.

use std::ops::Range;

use crate::{Problem, ScalarRow};
use stepper_real::{Mask, Real, Scalar};

/// Part of the squared length of a row at which what is left of it, its parts along other rows taken away, is rounding.
pub fn dependence<R: Real>() -> f64 {
    let root = <R::Scalar as Scalar>::EPSILON.to_f64().sqrt();
    root * root.sqrt()
}

impl<R: Real> ScalarRow<R> {
    /// Where its entries are among those of all scalar rows.
    #[inline(always)]
    pub fn entries(&self) -> Range<usize> {
        self.y..self.y + self.support.len()
    }

    /// How much of the row is in another one, when `along` is the product of the entries of both.
    #[inline(always)]
    pub fn share(&self, along: R) -> R {
        along * self.inv_diagonal
    }
}

impl<R: Real> Problem<R> {
    /// Makes all scalar rows that there are separate: each is an equality without compliance, and orthogonal to every other row that there is or
    /// that will be pushed. They are solved once, and not visited by sweeps: no other impulse moves them.
    #[inline(always)]
    pub fn separate(&mut self) {
        self.separate = self.scalars.len();
    }

    /// Says how many times trace(G_ii) of the scalar row pushed last was as large before separate rows were taken out of it. Residuals are measured
    /// by the whole.
    #[inline(always)]
    pub fn measure_scalar(&mut self, times: R) {
        if let Some(row) = self.scalars.last_mut() {
            row.whole = times;
            row.mobility *= times;
        }
    }

    /// Says what the damping of the demand of the scalar row pushed last is relative to: the mobility of its fellows, say, where the row itself
    /// can be nearly immovable.
    #[inline(always)]
    pub fn set_mobility(&mut self, mobility: R) {
        if let Some(row) = self.scalars.last_mut() {
            row.mobility = R::select(row.mobility.gt(R::zero()), mobility, R::zero());
        }
    }

    /// Says the same ratio of the contact pushed last.
    #[inline(always)]
    pub fn measure_contact(&mut self, times: R) {
        if let Some(block) = self.contacts.last_mut() {
            block.whole = times;
            (block.rho, block.inv_rho) = (block.rho / times, block.inv_rho * times);
        }
    }

    /// The same of the contact with six rows pushed last.
    #[inline(always)]
    pub fn measure_wide(&mut self, times: R) {
        if let Some(block) = self.wide.last_mut() {
            block.whole = times;
            (block.rho, block.inv_rho) = (block.rho / times, block.inv_rho * times);
        }
    }

    /// How many scalar rows are separate.
    #[inline(always)]
    pub fn separated(&self) -> usize {
        self.separate
    }

    /// Makes the scalar rows `rows` orthogonal; `also` holds more right-hand sides of each of them, which are combined like g.
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
        let tolerance = R::of(dependence::<R>());
        for (k, &size) in rows.clone().zip(sizes) {
            for j in rows.start..k {
                let share = self.remove(k, j);
                let other = also[j - rows.start];
                for (x, other) in also[k - rows.start].iter_mut().zip(other) {
                    *x -= share * other;
                }
            }
            let at = self.scalars[k].y;
            let n = self.scalars[k].support.len();
            let mut rest = R::zero();
            for &y in self.y.row(at, n) {
                rest += y * y;
            }
            let row = &mut self.scalars[k];
            let asked = row.active;
            row.active = asked.and(rest.gt(tolerance * size));
            row.held = asked.and_not(row.active);
            row.diagonal = R::select(row.active, rest, R::zero());
            row.inv_diagonal = R::one() / R::select(row.active, rest, R::one());
            decide(row, &mut also[k - rows.start]);
            let active = row.active;
            for y in self.y.row_mut(at, n) {
                *y = R::select(active, *y, R::zero());
            }
        }
    }

    /// Takes from row `k` its part along the earlier row `j`; returns how much of it.
    #[inline(always)]
    fn remove(&mut self, k: usize, j: usize) -> R {
        let n = self.scalars[k].support.len();
        debug_assert_eq!(n, self.scalars[j].support.len(), "rows of one support");
        let (before, row) = self.y.two_rows(self.scalars[j].y, self.scalars[k].y, n);
        let mut along = R::zero();
        for (&a, &b) in before.iter().zip(row.iter()) {
            along += a * b;
        }
        let share = self.scalars[j].share(along);
        for (&a, b) in before.iter().zip(row) {
            *b -= share * a;
        }
        let g = self.scalars[j].g;
        self.scalars[k].g -= share * g;
        share
    }
}
