//! Factors of a matrix with a symmetric pattern, stored between the first entry of every row and the diagonal (Jennings, 1966).
//!
//! The first entries of the rows are the skyline. Elimination fills no entry outside it, so that its area is the required memory. An order
//! of the coordinates with a low skyline ([`crate::newton::ordering`]) uses the sparsity of the matrix. `A = L U` with a unit diagonal in
//! U. L is stored by rows, U by columns, both below the same skyline, in tiles of four rows or columns. There is no pivoting, because the
//! matrices are the identity plus a part that is positive semidefinite unless contacts slip. `factor` fails if a pivot is too small. A
//! symmetric matrix takes half of the work, because U is then L^T with its rows divided by the pivots.

use crate::vectors::{TILE, tile};

/// Entries of four consecutive rows in one column of a matrix.
type Tile = [f64; TILE];

/// Matrix in skyline storage, replaced by its factors.
#[derive(Clone, Debug, Default)]
pub(super) struct Skyline {
    /// First column at which each tile of four rows has entries, a multiple of four.
    first: Vec<usize>,
    /// Index in `lower` and `upper` at which each tile of rows begins.
    start: Vec<usize>,
    /// Factor L of the matrix, with its diagonal.
    lower: Vec<Tile>,
    /// Factor U of the matrix, without its unit diagonal.
    upper: Vec<Tile>,
    /// Lower triangle of the kept sum: a symmetric sum that remains from one factorisation to the next.
    kept: Vec<Tile>,
    /// Whether the matrix is symmetric.
    is_symmetric: bool,
}

impl Skyline {
    /// Resets the pattern to the diagonal of a matrix with `dimension` rows.
    pub(super) fn reset(&mut self, dimension: usize) {
        self.first.clear();
        self.first.extend((0..dimension).step_by(TILE));
    }

    /// Adds the entries between all coordinates of the tiles `tiles` to the pattern. A tile is four consecutive coordinates; the tiles are
    /// in ascending order.
    pub(super) fn reserve(&mut self, tiles: &[usize]) {
        for &tile in tiles {
            self.first[tile] = self.first[tile].min(TILE * tiles[0]);
        }
    }

    /// Allocates the entries of the pattern.
    pub(super) fn complete_pattern(&mut self) {
        self.start.clear();
        let mut next = 0;
        for (j, &first) in self.first.iter().enumerate() {
            self.start.push(next);
            next += TILE * (j + 1) - first;
        }
        self.lower.resize(next, [0.0; TILE]);
        self.upper.resize(next, [0.0; TILE]);
        self.kept.clear();
        self.kept.resize(next, [0.0; TILE]);
    }

    /// Sets the kept sum to zero.
    pub(super) fn clear_kept(&mut self) {
        self.kept.fill([0.0; TILE]);
    }

    /// Adds `sum_r a_r^T b_r` to the kept sum, with the arguments of [`Skyline::add_symmetric`].
    #[inline(always)]
    pub(super) fn add_to_kept(&mut self, tiles: &[usize], a: &[f64], b: &[f64]) {
        std::mem::swap(&mut self.lower, &mut self.kept);
        self.add_symmetric(tiles, a, b);
        std::mem::swap(&mut self.lower, &mut self.kept);
    }

    /// Sets the matrix to the identity plus `factor` times the kept sum. Until [`Skyline::complete`], it is in the lower triangle alone.
    #[inline(always)]
    pub(super) fn set_to_kept(&mut self, factor: f64) {
        for (lower, kept) in self.lower.iter_mut().zip(&self.kept) {
            for r in 0..TILE {
                lower[r] = factor * kept[r];
            }
        }
        self.upper.fill([0.0; TILE]);
        self.is_symmetric = true;
        for j in 0..self.first.len() {
            let at = self.place(j, TILE * j);
            for k in 0..TILE {
                self.lower[at + k][k] += 1.0;
            }
        }
    }

    /// Index in `lower` and `upper` of the entries in column `c` of the four rows of tile `j`.
    #[inline(always)]
    fn place(&self, j: usize, c: usize) -> usize {
        self.start[j] + c - self.first[j]
    }

    /// Adds the symmetric sum `sum_r a_r^T b_r` to the entries between the coordinates of the tiles `tiles`, ascending. A tile is four
    /// consecutive coordinates. Until [`Skyline::complete`], the sum is in the lower triangle alone.
    ///
    /// `a` and `b` are lists of rows a_r and b_r. Each row has the numbers of its tiles, one tile after the other.
    #[inline(always)]
    pub(super) fn add_symmetric(&mut self, tiles: &[usize], a: &[f64], b: &[f64]) {
        let n = TILE * tiles.len();
        // Three rows at a time, the rows of a contact.
        let (mut at, rows) = (0, a.len() / n);
        while at < rows {
            let some = if rows - at >= 3 { 3 } else { 1 };
            let (a, b) = (&a[at * n..(at + some) * n], &b[at * n..(at + some) * n]);
            if some == 3 {
                self.add_rows::<3>(tiles, a, b);
            } else {
                self.add_rows::<1>(tiles, a, b);
            }
            at += some;
        }
    }

    /// Adds `sum_r a_r^T b_r` as [`Skyline::add_symmetric`] does, for `N` rows at a time.
    #[inline(always)]
    fn add_rows<const N: usize>(&mut self, tiles: &[usize], a: &[f64], b: &[f64]) {
        let n = TILE * tiles.len();
        for (i, &j) in tiles.iter().enumerate() {
            let own: [Tile; N] = std::array::from_fn(|r| tile(a, r * n + TILE * i));
            for (k, &column) in tiles[..=i].iter().enumerate() {
                let place = self.place(j, TILE * column);
                add_tile(&mut self.lower[place..place + TILE], &own, b, n, TILE * k);
            }
        }
    }

    /// Adds the outer product `a^T b` of two rows, with the arguments of [`Skyline::add_symmetric`].
    #[inline(always)]
    pub(super) fn add_outer(&mut self, tiles: &[usize], a: &[f64], b: &[f64]) {
        self.is_symmetric = false;
        for (i, &j) in tiles.iter().enumerate() {
            let (own_a, own_b) = (tile(a, TILE * i), tile(b, TILE * i));
            for (k, &column) in tiles[..=i].iter().enumerate() {
                let place = self.place(j, TILE * column);
                let (a, b) = (tile(a, TILE * k), tile(b, TILE * k));
                let (lower, upper) = (&mut self.lower[place..place + TILE], &mut self.upper[place..place + TILE]);
                for c in 0..TILE {
                    for r in 0..TILE {
                        let below = own_a[r] * b[c];
                        lower[c][r] += below;
                        upper[c][r] += own_b[r] * a[c] - below;
                    }
                }
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
            for r in 0..TILE {
                upper[r] += lower[r];
            }
        }
    }

    /// Replaces the matrix by its factors L U. Returns false if the size of a pivot is not above `least`; the factors are then invalid.
    #[inline(always)]
    pub(super) fn factor(&mut self, least: f64) -> bool {
        for j in 0..self.first.len() {
            for k in self.first[j] / TILE..j {
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
        let (own, other) = (self.place(j, from), self.place(k, from));
        let count = (TILE * k).saturating_sub(from);
        let (here, corner) = (self.place(j, TILE * k), self.place(k, TILE * k));
        let mut l: [Tile; TILE] = std::array::from_fn(|c| self.lower[here + c]);
        for (l_jm, u_mk) in self.lower[own..own + count].iter().zip(&self.upper[other..other + count]) {
            subtract_outer(&mut l, l_jm, u_mk);
        }
        for c in 1..TILE {
            for m in 0..c {
                let u = self.upper[corner + m][c];
                for r in 0..TILE {
                    l[c][r] -= l[m][r] * u;
                }
            }
        }
        let mut u = if self.is_symmetric { l } else { self.eliminate_upper([own, other, count], here, corner) };
        for c in 0..TILE {
            let pivot = self.lower[corner + c][c];
            for r in 0..TILE {
                u[c][r] /= pivot;
            }
            self.lower[here + c] = l[c];
            self.upper[here + c] = u[c];
        }
    }

    /// Entries of U times their pivots, for the same four rows and columns as in [`Skyline::eliminate`]. `own` and `other` are the indices
    /// of the `count` products that are subtracted, `here` and `corner` those of the entries and of the pivots.
    #[inline(always)]
    fn eliminate_upper(&self, [own, other, count]: [usize; 3], here: usize, corner: usize) -> [Tile; TILE] {
        let mut u: [Tile; TILE] = std::array::from_fn(|c| self.upper[here + c]);
        for (u_mj, l_km) in self.upper[own..own + count].iter().zip(&self.lower[other..other + count]) {
            subtract_outer(&mut u, u_mj, l_km);
        }
        for c in 1..TILE {
            for m in 0..c {
                let factor = self.lower[corner + m][c] / self.lower[corner + m][m];
                for r in 0..TILE {
                    u[c][r] -= u[m][r] * factor;
                }
            }
        }
        u
    }

    /// Factorises the diagonal block of four by four entries of tile `j`. Returns false if the size of a pivot is not above `least`.
    #[inline(always)]
    fn factor_diagonal(&mut self, j: usize, least: f64) -> bool {
        let (first, here) = (self.start[j], self.place(j, TILE * j));
        let mut d: [Tile; TILE] = std::array::from_fn(|c| self.lower[here + c]);
        for (l, u) in self.lower[first..here].iter().zip(&self.upper[first..here]) {
            subtract_outer(&mut d, l, u);
        }
        // Entry `d[c][r]` is row r, column c.
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
        for m in 0..TILE {
            self.lower[here + m] = d[m];
            // Row m of U, by columns.
            self.upper[here + m] = std::array::from_fn(|c| d[c][m]);
        }
        true
    }

    /// Replaces `x` by A^-1 x, where A is the matrix that has been factorised.
    #[inline(always)]
    pub(super) fn solve(&self, x: &mut [f64]) {
        for j in 0..self.first.len() {
            let here = self.place(j, TILE * j);
            let (before, own) = x.split_at_mut(TILE * j);
            let mut sum: Tile = std::array::from_fn(|r| own[r]);
            for (l, x) in self.lower[self.start[j]..here].iter().zip(&before[self.first[j]..]) {
                for r in 0..TILE {
                    sum[r] -= l[r] * x;
                }
            }
            for c in 0..TILE {
                let l = &self.lower[here + c];
                sum[c] /= l[c];
                for r in c + 1..TILE {
                    sum[r] -= l[r] * sum[c];
                }
            }
            own[..TILE].copy_from_slice(&sum);
        }
        for j in (0..self.first.len()).rev() {
            let here = self.place(j, TILE * j);
            let (before, own) = x.split_at_mut(TILE * j);
            let mut sum: Tile = std::array::from_fn(|r| own[r]);
            for c in (0..TILE).rev() {
                for m in 0..c {
                    sum[m] -= self.upper[here + m][c] * sum[c];
                }
            }
            own[..TILE].copy_from_slice(&sum);
            for (u, x) in self.upper[self.start[j]..here].iter().zip(&mut before[self.first[j]..]) {
                *x -= (u[0] * sum[0] + u[1] * sum[1]) + (u[2] * sum[2] + u[3] * sum[3]);
            }
        }
    }
}

/// Subtracts the outer product of two tiles: `d[c][r] -= a[r] b[c]`.
#[inline(always)]
fn subtract_outer(d: &mut [Tile; TILE], a: &Tile, b: &Tile) {
    for c in 0..TILE {
        for r in 0..TILE {
            d[c][r] -= a[r] * b[c];
        }
    }
}

/// Adds a product of `N` rows to a block of four by four entries: `out[c][k] += sum_r a_r[k] b_r[column + c]`. The rows of `b` have `n`
/// numbers.
#[inline(always)]
fn add_tile<const N: usize>(out: &mut [Tile], a: &[Tile; N], b: &[f64], n: usize, column: usize) {
    // The block is in registers. Column by column, the compiler would vectorise the wrong dimension.
    let mut d: [Tile; TILE] = std::array::from_fn(|c| out[c]);
    for (r, a) in a.iter().enumerate() {
        let b = tile(b, r * n + column);
        for c in 0..TILE {
            for k in 0..TILE {
                d[c][k] += a[k] * b[c];
            }
        }
    }
    out.copy_from_slice(&d);
}
