//! Rows of one island (constraints that are coupled directly or by others), dense in the tiles of coordinates at which they have entries.
//!
//! Coordinates come in tiles of four (`vectors.rs`). The rows of a contact between two bodies have entries in a few tiles that may be far
//! apart. Entries are stored tile by tile, and in each tile row by row.

use stepper_real::Real;

use std::ops::Range;

use crate::admissible_set::AdmissibleSet;
use crate::constraints::constraint_set::LaneConstraint;
use crate::newton::lane::Lane;
use crate::vectors::{TILE, Tile, add_multiple, inner, with_row_count};

/// Rows of one constraint of an island, whose impulses are projected together.
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// Set of the constraint's admissible impulses.
    pub(super) set: AdmissibleSet,
    /// Range in [`Island::tiles`] of the tiles (of four coordinates) at which the constraint has entries.
    tiles: Range<usize>,
    /// Range of the constraint's entries in [`Island::y`].
    y: Range<usize>,
    /// Range of the constraint's rows in [`Island::g`] and [`Island::lambda`].
    pub(super) rows: Range<usize>,
    /// Rows of the constraint that are in the island, as bits. Rows without effect (types of friction that a contact lacks) are left out.
    used_rows: u32,
    /// Trace of the constraint's block of the Delassus matrix, before elimination of equality rows, 1/kg.
    pub(super) trace: f64,
    /// Step rho of the constraint's natural map, kg: number of rows divided by the trace of its block of the Delassus matrix, compliance
    /// included. The map is lambda - P_K(lambda - rho u) for the impulse lambda and the velocity u, and zero at the solution. P_K is the
    /// projection on the admissible impulses.
    pub(super) rho: f64,
    /// Compliance R >= 0 of each row of the constraint, 1/kg: it is added to the diagonal of the Delassus matrix G.
    pub(super) compliance: f64,
    /// Step of the constraint's natural map for the residual, kg: like `rho`, but without the additional compliance of the first row.
    natural_step: f64,
    /// Factor G / (G + R) for the residual of the constraint's first row, with the diagonal entry G of the Delassus matrix and the
    /// additional compliance R of a spring. The factor removes the part of the residual that is due to the spring, so that the error of the
    /// velocity remains.
    rigid_fraction: f64,
}

/// Constraints of one island of one lane, and its coordinates of w (scaled velocity change), whose number is a multiple of [`TILE`].
#[derive(Clone, Debug, Default)]
pub(super) struct Island {
    /// Rows of each constraint of the island.
    pub(super) blocks: Vec<Block>,
    /// Tiles (of four coordinates) at which each constraint has entries, ascending, one constraint after the other.
    tiles: Vec<usize>,
    /// Workspace of [`Island::gather`], for each tile: whether the present constraint has listed it, and its place in that list.
    place_of_tile: Vec<(bool, usize)>,
    /// Entries of the scaled Jacobian of all constraints of the island: for each tile of a constraint, those of all rows.
    y: Vec<Tile>,
    /// Offset g of each row, m/s: its velocity before any impulse, plus its bias (minus the target velocity).
    pub(super) g: Vec<f64>,
    /// Impulse of each row, N s.
    pub(super) lambda: Vec<f64>,
    /// Scaled velocity change w = sum_i y_i lambda_i by the impulses lambda_i, where y_i are the rows of the scaled Jacobian. Its kinetic
    /// energy is |w|^2 / 2. It is zero in the coordinates that fill the last tile.
    pub(super) w: Vec<f64>,
    /// Velocities Y w + g of all rows at the last call of [`Island::residual`], m/s: Y is the scaled Jacobian, and g the offset.
    pub(super) v: Vec<f64>,
}

impl Island {
    /// Gathers the constraints `members` of a lane into the island.
    ///
    /// `coordinates` are the lane's coordinates of w (scaled velocity change) that belong to the island, in the order of the island.
    /// `number` is the inverse: the index in the island of each coordinate of the lane.
    #[inline(always)]
    pub(super) fn gather(&mut self, lane: &Lane, members: &[usize], coordinates: &[u32], number: &[u32]) {
        self.blocks.clear();
        self.tiles.clear();
        self.y.clear();
        self.g.clear();
        self.lambda.clear();
        self.w.clear();
        self.w.extend(coordinates.iter().map(|&c| lane.w[c as usize]));
        self.w.resize(coordinates.len().next_multiple_of(TILE), 0.0);
        self.place_of_tile.resize(self.w.len() / TILE, (false, 0));
        for block in members.iter().map(|&i| &lane.blocks[i]) {
            let (columns, entries) = lane.entries(block);
            let places = || columns.iter().map(|&c| number[c as usize] as usize);
            let first = self.tiles.len();
            for tile in places().map(|c| c / TILE) {
                if !std::mem::replace(&mut self.place_of_tile[tile].0, true) {
                    self.tiles.push(tile);
                }
            }
            let tiles = first..self.tiles.len();
            self.tiles[tiles.clone()].sort_unstable();
            for (place, &tile) in self.tiles[tiles.clone()].iter().enumerate() {
                self.place_of_tile[tile] = (false, place);
            }
            let (dim, at, row) = (block.rows.len(), self.y.len(), self.g.len());
            let used_rows = lane.used_rows(block);
            let rows = used_rows.count_ones() as usize;
            self.y.resize(at + rows * tiles.len(), [0.0; TILE]);
            for (c, entries) in places().zip(entries.chunks_exact(dim)) {
                let (_, place) = self.place_of_tile[c / TILE];
                for (k, r) in bits(used_rows).enumerate() {
                    self.y[at + rows * place + k][c % TILE] = entries[r];
                }
            }
            self.g.extend(bits(used_rows).map(|r| lane.g[block.rows.start + r]));
            self.lambda.extend(bits(used_rows).map(|r| lane.lambda[block.rows.start + r]));
            let LaneConstraint { set, compliance, normal_compliance, mobility_ratio } = block.constraint;
            let own = if normal_compliance > 0.0 { dim } else { 0 };
            let bodies = &entries[..entries.len() - own];
            let damped = compliance * dim as f64;
            let trace = (inner(entries, entries) + damped) * mobility_ratio;
            let normal = bodies.iter().step_by(dim).map(|y| y * y).sum::<f64>() + compliance;
            self.blocks.push(Block {
                set,
                tiles,
                y: at..self.y.len(),
                rows: row..self.g.len(),
                used_rows,
                trace,
                rho: dim as f64 / trace,
                compliance,
                natural_step: if own == 0 { dim as f64 / trace } else { dim as f64 / ((inner(bodies, bodies) + damped) * mobility_ratio) },
                rigid_fraction: if own == 0 { 1.0 } else { normal / (normal + normal_compliance) },
            });
        }
    }

    /// Copies the impulses and the scaled velocity change w back to the lane. The arguments are those of [`Island::gather`].
    pub(super) fn scatter(&self, lane: &mut Lane, members: &[usize], coordinates: &[u32]) {
        for (&i, block) in members.iter().zip(&self.blocks) {
            let start = lane.blocks[i].rows.start;
            for (r, &lambda) in bits(block.used_rows).zip(&self.lambda[block.rows.clone()]) {
                lane.lambda[start + r] = lambda;
            }
        }
        for (&c, &w) in coordinates.iter().zip(&self.w) {
            lane.w[c as usize] = w;
        }
    }

    /// Tiles (four consecutive coordinates each) at which the rows of a constraint have entries, ascending.
    #[inline(always)]
    pub(super) fn tiles(&self, block: &Block) -> &[usize] {
        &self.tiles[block.tiles.clone()]
    }

    /// Entries of the `N` rows of a constraint in each of its tiles.
    #[inline(always)]
    pub(super) fn entries<const N: usize>(&self, block: &Block) -> &[[Tile; N]] {
        self.y[block.y.clone()].as_chunks().0
    }

    /// Multiplies the island's scaled Jacobian Y by the vector `x`, and writes Y x to `out`.
    #[inline(always)]
    pub(super) fn multiply(&self, x: &[f64], out: &mut Vec<f64>) {
        out.resize(self.g.len(), 0.0);
        let x = x.as_chunks().0;
        for block in &self.blocks {
            let out = &mut out[block.rows.clone()];
            with_row_count!(out.len(), N => out.copy_from_slice(&multiply_rows::<N>(self.tiles(block), self.entries(block), x)));
        }
    }

    /// Adds Y^T x to `out` for the rows of one constraint, where Y is the scaled Jacobian.
    #[inline(always)]
    pub(super) fn add_transposed<const N: usize>(&self, block: &Block, x: [f64; N], out: &mut [f64]) {
        if x == [0.0; N] {
            return;
        }
        let out = out.as_chunks_mut().0;
        for (y, &t) in self.entries::<N>(block).iter().zip(self.tiles(block)) {
            for r in 0..N {
                add_multiple(&mut out[t], x[r], &y[r]);
            }
        }
    }

    /// Sum of the sizes of all impulses, N s.
    pub(super) fn total_impulse(&self) -> f64 {
        self.lambda.iter().map(|x| x.abs()).sum()
    }

    /// Largest slip speed of all contacts with an impulse at the last call of [`Island::residual`], m/s.
    pub(super) fn fastest_slip(&self) -> f64 {
        let loaded = self.blocks.iter().filter(|block| self.lambda[block.rows.start] > 0.0);
        loaded.fold(0.0, |most, Block { rows, compliance, .. }| {
            let tangents = rows.start + 1..rows.end;
            most.max(tangents.map(|k| (self.v[k] + compliance * self.lambda[k]).powi(2)).sum::<f64>().sqrt())
        })
    }

    /// Computes the scaled velocity change w from the impulses.
    #[inline(always)]
    pub(super) fn compute_w(&mut self) {
        let mut w = std::mem::take(&mut self.w);
        w.fill(0.0);
        for block in &self.blocks {
            let lambda = &self.lambda[block.rows.clone()];
            with_row_count!(lambda.len(), N => self.add_transposed::<N>(block, std::array::from_fn(|r| lambda[r]), &mut w));
        }
        self.w = w;
    }

    /// Natural-map residual of the exact Coulomb problem, m/s; [`crate::residual()`] has its definition.
    #[inline(always)]
    pub(super) fn residual(&mut self) -> f64 {
        let mut v = std::mem::take(&mut self.v);
        self.multiply(&self.w, &mut v);
        for (v, g) in v.iter_mut().zip(&self.g) {
            *v += g;
        }
        self.v = v;
        let mut worst = 0.0;
        for block in &self.blocks {
            let Block { rows, set, compliance, natural_step, rigid_fraction, .. } = block;
            let (lambda, v) = (&self.lambda[rows.clone()], &self.v[rows.clone()]);
            worst = Real::max_or_nan(worst, set.natural_residual(lambda, v, *compliance, *natural_step, *rigid_fraction));
        }
        worst
    }
}

/// Dot products of `N` rows with the vector `x`. The rows have the entries `y` in the tiles `tiles`. Of each product, four partial sums are
/// added at the end, so that additional tiles of zeros would change nothing.
#[inline(always)]
fn multiply_rows<const N: usize>(tiles: &[usize], y: &[[Tile; N]], x: &[Tile]) -> [f64; N] {
    let mut sums = [[0.0; TILE]; N];
    for (y, &t) in y.iter().zip(tiles) {
        let x = x[t];
        for r in 0..N {
            for c in 0..TILE {
                sums[r][c] += y[r][c] * x[c];
            }
        }
    }
    sums.map(|sum| (sum[0] + sum[1]) + (sum[2] + sum[3]))
}

/// Indices of the bits of `set` that are 1, ascending.
#[inline(always)]
fn bits(mut set: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = (set != 0).then(|| set.trailing_zeros() as usize);
        set &= set.wrapping_sub(1);
        place
    })
}
