//! Factors of a full matrix with partial pivoting (Golub & Van Loan 2013, algorithm 3.4.1), for small islands whose matrix has pivots that
//! are too small for the skyline factorisation.

use crate::vectors::{TILE, Tile};

/// Full matrix, replaced by the factors L U of its rows in the order of partial pivoting.
#[derive(Clone, Debug, Default)]
pub(super) struct Dense {
    /// Number of rows and columns.
    dimension: usize,
    /// Entries of the matrix or of its factors, row by row.
    entries: Vec<f64>,
    /// For each row, the row with which partial pivoting exchanged it.
    exchanged: Vec<usize>,
}

impl Dense {
    /// Sets the matrix to the identity with `dimension` rows.
    pub(super) fn set_identity(&mut self, dimension: usize) {
        self.dimension = dimension;
        self.entries.clear();
        self.entries.resize(dimension * dimension, 0.0);
        self.entries.iter_mut().step_by(dimension + 1).for_each(|x| *x = 1.0);
    }

    /// Adds `sum_r a_r^T b_r` to the entries between the coordinates of the tiles `tiles`. A tile is four consecutive coordinates.
    ///
    /// `a` and `b` have the numbers of the `N` rows a_r and b_r in each tile.
    #[inline(always)]
    pub(super) fn add_product<const N: usize>(&mut self, tiles: &[usize], a: &[[Tile; N]], b: &[[Tile; N]]) {
        for (&j, a) in tiles.iter().zip(a) {
            for (&k, b) in tiles.iter().zip(b) {
                for i in 0..TILE {
                    let at = (TILE * j + i) * self.dimension + TILE * k;
                    for (c, entry) in self.entries[at..at + TILE].iter_mut().enumerate() {
                        for r in 0..N {
                            *entry += a[r][i] * b[r][c];
                        }
                    }
                }
            }
        }
    }

    /// Replaces the matrix A by its factors L U, with partial pivoting. Returns false if it is singular up to rounding, or not finite.
    #[inline(always)]
    pub(super) fn factor(&mut self) -> bool {
        let n = self.dimension;
        self.exchanged.clear();
        for k in 0..n {
            let (mut row, mut most) = (k, 0.0);
            for i in k..n {
                let size = self.entries[i * n + k].abs();
                if size > most {
                    (row, most) = (i, size);
                }
            }
            if !(most > f64::EPSILON && most.is_finite()) {
                return false;
            }
            self.exchanged.push(row);
            if row != k {
                for c in 0..n {
                    self.entries.swap(k * n + c, row * n + c);
                }
            }
            let (above, below) = self.entries.split_at_mut((k + 1) * n);
            let pivot = &above[k * n + k..];
            for row in below.chunks_exact_mut(n) {
                let factor = row[k] / pivot[0];
                row[k] = factor;
                for (x, p) in row[k + 1..].iter_mut().zip(&pivot[1..]) {
                    *x -= factor * p;
                }
            }
        }
        true
    }

    /// Replaces `x` by A^-1 x, where A is the matrix that has been factorised.
    #[inline(always)]
    pub(super) fn solve(&self, x: &mut [f64]) {
        let n = self.dimension;
        for (k, &row) in self.exchanged.iter().enumerate() {
            x.swap(k, row);
        }
        for i in 1..n {
            let (before, own) = x.split_at_mut(i);
            for (l, x) in self.entries[i * n..i * n + i].iter().zip(before.iter()) {
                own[0] -= l * x;
            }
        }
        for i in (0..n).rev() {
            let (own, after) = x[i..].split_at_mut(1);
            let row = &self.entries[i * n + i..(i + 1) * n];
            for (u, x) in row[1..].iter().zip(after.iter()) {
                own[0] -= u * x;
            }
            own[0] /= row[0];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Dense, Tile};

    /// Rows of a matrix in one tile, whose last numbers are 0, from their first three numbers.
    fn rows<const N: usize>(rows: [[f64; 3]; N]) -> [[Tile; N]; 1] {
        [rows.map(|[a, b, c]| [a, b, c, 0.0])]
    }

    #[test]
    fn a_matrix_with_zeros_on_its_diagonal_is_solved() {
        let mut matrix = Dense::default();
        matrix.set_identity(8);
        // [0 2 0; 3 0 0; 0 0 -4] in the coordinates of the second tile.
        let unit = rows([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
        matrix.add_product(&[1], &unit, &rows([[-1.0, 2.0, 0.0], [3.0, -1.0, 0.0], [0.0, 0.0, -5.0]]));
        assert!(matrix.factor());
        let mut x = [1.0, 1.0, 1.0, 1.0, 2.0, 9.0, 8.0, 1.0];
        matrix.solve(&mut x);
        assert_eq!(x, [1.0, 1.0, 1.0, 1.0, 3.0, 1.0, -2.0, 1.0]);
    }

    #[test]
    fn a_singular_matrix_has_no_factors() {
        let mut matrix = Dense::default();
        matrix.set_identity(4);
        matrix.add_product(&[0], &rows([[1.0, 0.0, 0.0]]), &rows([[-1.0, 0.0, 0.0]]));
        assert!(!matrix.factor());
    }
}
