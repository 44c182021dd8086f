//! Factors of a matrix with a symmetric pattern, stored between the first entry of every row and the diagonal (Jennings, 1966).
//!
//! The first entries of the rows are the skyline. Elimination fills no entry outside it, so that its area is the required memory. An order
//! of the coordinates with a low skyline ([`crate::newton::ordering`]) uses the sparsity of the matrix. `A = L U` with a unit diagonal in
//! U. L is stored by rows, U by columns, both below the same skyline, in tiles of four rows or columns. There is no pivoting, because the
//! matrices are the identity plus a part that is positive semidefinite unless contacts slip. `factor` fails if a pivot is too small, which
//! is rare. A symmetric matrix takes half of the work, because U is then L^T with its rows divided by the pivots.

use crate::vectors::{TILE, Tile, add_multiple};

/// Entries of four consecutive rows in four consecutive columns of a matrix, column by column.
type Square = [Tile; TILE];

/// Matrix in skyline storage, replaced by its factors.
#[derive(Clone, Debug, Default)]
pub(super) struct Skyline {
    /// First tile of columns at which each tile of four rows has entries.
    first: Vec<usize>,
    /// Index in `lower` and `upper` at which each tile of rows begins.
    start: Vec<usize>,
    /// Factor L of the matrix, with its diagonal.
    lower: Vec<Square>,
    /// Factor U of the matrix, without its unit diagonal, transposed.
    upper: Vec<Square>,
    /// Lower triangle of the kept sum: a symmetric sum that remains from one factorisation to the next.
    kept: Vec<Square>,
    /// Whether the matrix is symmetric.
    is_symmetric: bool,
}

impl Skyline {
    /// Resets the pattern to the diagonal of a matrix with `tiles` tiles of four rows.
    pub(super) fn reset(&mut self, tiles: usize) {
        self.first.clear();
        self.first.extend(0..tiles);
    }

    /// Adds the entries between all coordinates of the tiles `tiles` to the pattern. A tile is four consecutive coordinates; the tiles are
    /// in ascending order.
    pub(super) fn reserve(&mut self, tiles: &[usize]) {
        for &tile in tiles {
            self.first[tile] = self.first[tile].min(tiles[0]);
        }
    }

    /// Allocates the entries of the pattern.
    pub(super) fn complete_pattern(&mut self) {
        self.start.clear();
        let mut next = 0;
        for (j, &first) in self.first.iter().enumerate() {
            self.start.push(next);
            next += j + 1 - first;
        }
        let empty = Square::default();
        self.lower.resize(next, empty);
        self.upper.resize(next, empty);
        self.kept.clear();
        self.kept.resize(next, empty);
    }

    /// Sets the kept sum to zero.
    pub(super) fn clear_kept(&mut self) {
        self.kept.fill(Square::default());
    }

    /// Adds `sum_r a_r^T b_r` to the kept sum, with the arguments of [`Skyline::add_symmetric`].
    #[inline(always)]
    pub(super) fn add_to_kept<const N: usize>(&mut self, tiles: &[usize], a: &[[Tile; N]], b: &[[Tile; N]]) {
        std::mem::swap(&mut self.lower, &mut self.kept);
        self.add_symmetric(tiles, a, b);
        std::mem::swap(&mut self.lower, &mut self.kept);
    }

    /// Sets the matrix to the identity plus `factor` times the kept sum. Until [`Skyline::complete`], it is in the lower triangle alone.
    #[inline(always)]
    pub(super) fn set_to_kept(&mut self, factor: f64) {
        for (lower, kept) in self.lower.iter_mut().zip(&self.kept) {
            for c in 0..TILE {
                for r in 0..TILE {
                    lower[c][r] = factor * kept[c][r];
                }
            }
        }
        self.upper.fill(Square::default());
        self.is_symmetric = true;
        for j in 0..self.first.len() {
            let diagonal = self.place(j, j);
            for k in 0..TILE {
                self.lower[diagonal][k][k] += 1.0;
            }
        }
    }

    /// Index in `lower` and `upper` of the entries in the four rows of tile `j` and the four columns of tile `k`.
    #[inline(always)]
    fn place(&self, j: usize, k: usize) -> usize {
        self.start[j] + k - self.first[j]
    }

    /// Adds the symmetric sum `sum_r a_r^T b_r` to the entries between the coordinates of the tiles `tiles`, ascending. A tile is four
    /// consecutive coordinates. Until [`Skyline::complete`], the sum is in the lower triangle alone.
    ///
    /// `a` and `b` have the numbers of the `N` rows a_r and b_r in each tile.
    #[inline(always)]
    pub(super) fn add_symmetric<const N: usize>(&mut self, tiles: &[usize], a: &[[Tile; N]], b: &[[Tile; N]]) {
        for (i, (&j, a)) in tiles.iter().zip(a).enumerate() {
            for (&k, b) in tiles[..=i].iter().zip(b) {
                let place = self.place(j, k);
                // The copy lets the compiler keep the square in registers.
                let mut square = self.lower[place];
                for r in 0..N {
                    add_outer(&mut square, &a[r], &b[r]);
                }
                self.lower[place] = square;
            }
        }
    }

    /// Adds `a^T b + sum_r q_r^T q_r`, with the arguments' numbers in each tile as in [`Skyline::add_symmetric`]. Until
    /// [`Skyline::complete`], the upper triangle gets only its difference from the lower one.
    #[inline(always)]
    pub(super) fn add_unsymmetric<const N: usize>(&mut self, tiles: &[usize], [a, b]: [&[Tile]; 2], q: &[[Tile; N]]) {
        self.is_symmetric = false;
        for (i, &j) in tiles.iter().enumerate() {
            for (k, &column) in tiles[..=i].iter().enumerate() {
                let place = self.place(j, column);
                let (mut lower, mut upper) = (self.lower[place], self.upper[place]);
                for c in 0..TILE {
                    for r in 0..TILE {
                        let below = a[i][r] * b[k][c];
                        lower[c][r] += below;
                        upper[c][r] += b[i][r] * a[k][c] - below;
                    }
                }
                for r in 0..N {
                    add_outer(&mut lower, &q[i][r], &q[k][r]);
                }
                (self.lower[place], self.upper[place]) = (lower, upper);
            }
        }
    }

    /// Completes the upper triangle after the last sum. So far it has the difference between the two triangles. The factors of a symmetric
    /// matrix do not read it.
    #[inline(always)]
    pub(super) fn complete(&mut self) {
        if self.is_symmetric {
            return;
        }
        for (upper, lower) in self.upper.iter_mut().zip(&self.lower) {
            for c in 0..TILE {
                for r in 0..TILE {
                    upper[c][r] += lower[c][r];
                }
            }
        }
    }

    /// Replaces the matrix by its factors L U. Returns false if the size of a pivot is not above `least`; the factors are then invalid.
    #[inline(always)]
    pub(super) fn factor(&mut self, least: f64) -> bool {
        for j in 0..self.first.len() {
            for k in self.first[j]..j {
                self.eliminate(j, k);
            }
            if !self.factor_diagonal(j, least) {
                return false;
            }
        }
        true
    }

    /// Eliminates the entries of the four rows of tile `j` in the four columns of tile `k`, where k < j.
    #[inline(always)]
    fn eliminate(&mut self, j: usize, k: usize) {
        let from = self.first[j].max(self.first[k]);
        let [own, other, here, corner] = [self.place(j, from), self.place(k, from), self.place(j, k), self.place(k, k)];
        let (mut l, pivots) = (self.lower[here], self.lower[corner]);
        subtract_products(&mut l, &self.lower[own..here], &self.upper[other..corner]);
        let upper = &self.upper[corner];
        for c in 1..TILE {
            for m in 0..c {
                let (before, column) = (l[m], upper[m][c]);
                add_multiple(&mut l[c], -column, &before);
            }
        }
        // U times the pivots, which is L^T if the matrix is symmetric.
        let mut u = l;
        if !self.is_symmetric {
            u = self.upper[here];
            subtract_products(&mut u, &self.upper[own..here], &self.lower[other..corner]);
            for c in 1..TILE {
                for m in 0..c {
                    let (before, factor) = (u[m], pivots[m][c] / pivots[m][m]);
                    add_multiple(&mut u[c], -factor, &before);
                }
            }
        }
        for c in 0..TILE {
            for r in 0..TILE {
                u[c][r] /= pivots[c][c];
            }
        }
        (self.lower[here], self.upper[here]) = (l, u);
    }

    /// Factorises the diagonal block of four by four entries of tile `j`. Returns false if the size of a pivot is not above `least`.
    #[inline(always)]
    fn factor_diagonal(&mut self, j: usize, least: f64) -> bool {
        let (first, here) = (self.start[j], self.place(j, j));
        // Entry `d[c][r]` is row r, column c.
        let mut d = self.lower[here];
        subtract_products(&mut d, &self.lower[first..here], &self.upper[first..here]);
        for c in 0..TILE {
            let pivot = d[c][c];
            // The comparison rejects a NaN too.
            if pivot.abs().partial_cmp(&least) != Some(std::cmp::Ordering::Greater) {
                return false;
            }
            for k in c + 1..TILE {
                d[k][c] /= pivot;
                let u = d[k][c];
                for r in c + 1..TILE {
                    d[k][r] -= d[c][r] * u;
                }
            }
        }
        self.lower[here] = d;
        // Transposed. Only the entries above the diagonal of U are read.
        self.upper[here] = std::array::from_fn(|m| std::array::from_fn(|c| d[c][m]));
        true
    }

    /// Replaces `x` by A^-1 x, where A is the matrix that has been factorised.
    #[inline(always)]
    pub(super) fn solve(&self, x: &mut [f64]) {
        let x = x.as_chunks_mut::<TILE>().0;
        for j in 0..self.first.len() {
            let here = self.place(j, j);
            let mut sum = x[j];
            for (l, x) in self.lower[self.start[j]..here].iter().zip(&x[self.first[j]..]) {
                for c in 0..TILE {
                    add_multiple(&mut sum, -x[c], &l[c]);
                }
            }
            let l = &self.lower[here];
            for c in 0..TILE {
                sum[c] /= l[c][c];
                for r in c + 1..TILE {
                    sum[r] -= l[c][r] * sum[c];
                }
            }
            x[j] = sum;
        }
        for j in (0..self.first.len()).rev() {
            let here = self.place(j, j);
            let (mut sum, upper) = (x[j], &self.upper[here]);
            for c in (0..TILE).rev() {
                for m in 0..c {
                    sum[m] -= upper[m][c] * sum[c];
                }
            }
            x[j] = sum;
            for (u, x) in self.upper[self.start[j]..here].iter().zip(&mut x[self.first[j]..]) {
                for c in 0..TILE {
                    x[c] -= (u[c][0] * sum[0] + u[c][1] * sum[1]) + (u[c][2] * sum[2] + u[c][3] * sum[3]);
                }
            }
        }
    }
}

/// Adds the outer product of two tiles: `square[c][r] += a[r] b[c]`.
#[inline(always)]
fn add_outer(square: &mut Square, a: &Tile, b: &Tile) {
    for c in 0..TILE {
        add_multiple(&mut square[c], b[c], a);
    }
}

/// Subtracts the products of the squares of `a` and the transposed squares of `b`: `d[c][r] -= sum a[m][r] b[m][c]`.
#[inline(always)]
fn subtract_products(d: &mut Square, a: &[Square], b: &[Square]) {
    let mut square = *d;
    for (a, b) in a.iter().zip(b) {
        for m in 0..TILE {
            for c in 0..TILE {
                add_multiple(&mut square[c], -b[m][c], &a[m]);
            }
        }
    }
    *d = square;
}
