//! Broad phase of the dynamic pairs. Dynamic pairs are pairs of geoms that are too numerous to list: their number grows with the square of
//! the number of free bodies. The search finds the pairs of two moving geoms whose bounding balls overlap. `static_search.rs` finds the
//! pairs of a moving and a static geom.
//!
//! The search has no memory of earlier steps, and runs lane by lane in scalar code. The centres of the balls are sorted into cells: cubes
//! that are at least as wide as each of these balls. Geoms that can touch are therefore in the same cell or in neighbouring cells (Ericson,
//! 2005, section 7.1). The balls are sorted by the keys of their cells, so that a row of cells along z is a range of the sorted list. The
//! search visits the balls in this order. For each of four neighbouring rows, it stores the index of the first ball to test, which only
//! increases. Very fast geoms, whose balls are more than twice as large as any geom with its margin, have no cell. The search compares
//! them with all geoms.

use stepper_real::{Real, Scalar};

use crate::collision::static_search::merge;
use crate::compile::{DynamicPairs, LaneModel};
use crate::math::lanes::{merge_lanes, with_lane};
use crate::math::spatial::*;

/// Number of bits of one integer coordinate of a cell in the cell's [`key`].
const BITS: u32 = 21;
/// Offsets (dx, dy), in cells, from a row of cells along z to the four neighbouring rows that come after it in the sorted list of cells.
/// The other four neighbouring rows come before it, and their balls have already been tested against those of this row.
const ROWS: [(i64, i64); 4] = [(0, 1), (1, -1), (1, 0), (1, 1)];

/// Ball that contains a geom during the time of a search ([`Broad::find`]), in world axes and m.
#[derive(Clone, Copy, Debug, Default)]
struct Ball {
    centre: [f64; 3],
    radius: f64,
    /// Index of the geom in [`DynamicPairs::members`].
    member: u32,
}

/// Broad phase of the dynamic pairs: near pairs, and the workspace of the search.
#[derive(Clone, Debug, Default)]
pub(crate) struct Broad {
    /// Bounding balls of the moving geoms in the present lane.
    balls: Vec<Ball>,
    /// For each ball that has a cell: key of the cell, and index of the ball in `balls`. Sorted by key.
    cells: Vec<(u64, u32)>,
    /// Indices in `balls` of the balls that are too large for a cell.
    without_cell: Vec<u32>,
    /// Pairs of members whose balls overlap in one lane. Each integer encodes the lane and the two members.
    found_pairs: Vec<u64>,
    /// Dynamic pairs that can touch, ascending: index of the pair in the compiled model, and lanes (bits) in which it can touch. They
    /// include those with a static geom after [`Broad::add`].
    pub(crate) pairs: Vec<(u32, u32)>,
}

impl Broad {
    /// Finds the dynamic pairs of two moving geoms that can touch in the lanes `alive` (bits), and stores them in `pairs`.
    ///
    /// `pos` has the centres of all geoms, m. `displacement` has the upper bounds of their displacements, m: during two steps in stage 3,
    /// and during the tested motion in the tunnelling check. The function adds `slack`, m, to each bound.
    pub(crate) fn find<R: Real>(
        &mut self,
        compiled: &LaneModel<R>,
        dynamic_pairs: &DynamicPairs<R::Scalar>,
        alive: u32,
        pos: &[V3<R>],
        displacement: &[R],
        slack: R,
    ) {
        self.found_pairs.clear();
        for lane in (0..R::LANES).filter(|l| alive >> l & 1 == 1) {
            self.balls.clear();
            self.balls.extend(dynamic_pairs.moving.iter().map(|&i| {
                let member = &dynamic_pairs.members[i as usize];
                let g = member.geom;
                let centre = of_lane(&pos[g], lane);
                let reach = (compiled.params.geom(g).bounding_radius.lane(lane).to_f64() + member.margin)
                    + (displacement[g].lane(lane).to_f64() + slack.lane(lane).to_f64());
                // The sum of two radii is slightly larger than in `GeomPoses::balls_touch`, also in single precision.
                let rounding = 1e-6 * (reach + centre.iter().map(|x| x.abs()).sum::<f64>());
                Ball { centre, radius: reach + rounding, member: i }
            }));
            self.sort_into_cells(dynamic_pairs);
            self.visit_neighbours(lane as u64);
            self.visit_without_cell(lane as u64);
        }
        self.found_pairs.sort_unstable();
        let index = |pair: u64| dynamic_pairs.table.index((pair >> 32) as usize, pair as u32 as usize) as u32;
        merge_lanes(&self.found_pairs, index, &mut self.pairs);
    }

    /// Sorts the balls into cells.
    fn sort_into_cells(&mut self, dynamic_pairs: &DynamicPairs<impl Scalar>) {
        let widest = self.balls.iter().map(|b| b.radius).fold(0.0, f64::max);
        // Without this limit, one fast geom would make all cells large.
        let limit = widest.min(2.0 * dynamic_pairs.widest);
        let per_metre = 0.5 / limit;
        self.cells.clear();
        self.without_cell.clear();
        for (i, ball) in self.balls.iter().enumerate() {
            if ball.radius > limit {
                self.without_cell.push(i as u32);
            } else {
                self.cells.push((key(ball.centre.map(|x| x * per_metre)), i as u32));
            }
        }
        self.cells.sort_unstable();
    }

    /// Tests each ball that has a cell against the balls that follow it in the same cell and in the neighbouring cells.
    fn visit_neighbours(&mut self, lane: u64) {
        let mut starts = [0; ROWS.len()];
        for e in 0..self.cells.len() {
            let (key, a) = self.cells[e];
            // The rest of the same cell, and the next cell along z.
            visit(&self.balls, &self.cells, &mut self.found_pairs, a, e + 1, key + 1, lane);
            for (start, (dx, dy)) in starts.iter_mut().zip(ROWS) {
                // In each neighbouring row, three cells can hold a ball that touches this one.
                let first = key.wrapping_add_signed((dx << (2 * BITS)) + (dy << BITS) - 1);
                while self.cells.get(*start).is_some_and(|c| c.0 < first) {
                    *start += 1;
                }
                visit(&self.balls, &self.cells, &mut self.found_pairs, a, *start, first + 2, lane);
            }
        }
    }

    /// Tests each ball that has no cell against all others.
    fn visit_without_cell(&mut self, lane: u64) {
        for (k, &a) in self.without_cell.iter().enumerate() {
            let rest = self.cells.iter().map(|c| c.1).chain(self.without_cell[k + 1..].iter().copied());
            for b in rest {
                add_if_overlapping(&self.balls, &mut self.found_pairs, a, b, lane);
            }
        }
    }

    /// Merges `pairs`, found by the search for static pairs, into the list `self.pairs`. Both lists ascend.
    pub(crate) fn add(&mut self, pairs: &[(u32, u32)]) {
        let count = self.pairs.len();
        self.pairs.resize(count + pairs.len(), (0, 0));
        merge(pairs, &mut self.pairs, count);
    }
}

/// Tests the ball `a` for overlap with each ball of the sorted list `cells`, from index `from` to the last ball whose cell has a key of at
/// most `last`.
fn visit(balls: &[Ball], cells: &[(u64, u32)], found: &mut Vec<u64>, a: u32, from: usize, last: u64, lane: u64) {
    for &(_, b) in cells[from..].iter().take_while(|c| c.0 <= last) {
        add_if_overlapping(balls, found, a, b, lane);
    }
}

/// Appends the pair of the balls `a` and `b` to `found` if they overlap.
#[inline]
fn add_if_overlapping(balls: &[Ball], found: &mut Vec<u64>, a: u32, b: u32, lane: u64) {
    let (p, q) = (&balls[a as usize], &balls[b as usize]);
    let reach = p.radius + q.radius;
    let apart = sub(p.centre, q.centre);
    if dot(apart, apart) <= reach * reach {
        let (i, j) = (p.member.min(q.member), p.member.max(q.member));
        found.push(with_lane(u64::from(i) << 32 | u64::from(j), lane));
    }
}

/// Key of the cell that contains `x`, a position in units of the cell width. Keys ascend by x, then y, then z.
///
/// Beyond a million cells from the origin, all cells along an axis have the same coordinate. This costs time and misses no pair.
fn key(x: [f64; 3]) -> u64 {
    let half = 1_i64 << (BITS - 1);
    let place = |x: f64| ((x.floor() as i64).clamp(2 - half, half - 3) + half) as u64;
    place(x[0]) << (2 * BITS) | place(x[1]) << BITS | place(x[2])
}
