//! Grid of cells over a mesh, which finds the triangles near a small box.
//!
//! The cells divide the two longest sides of the mesh, as those of a height field. A cell is about as wide as a triangle, so a query reads a
//! few short lists. A bounding volume tree of the same mesh visits a dozen levels for every query.

use crate::linear_algebra::*;
use crate::vectors::V;

/// Largest number of entries of all cells together, per triangle. A triangle has an entry in each cell that its bounding box meets.
const MAX_ENTRIES: usize = 8;

/// Triangles of a mesh by cells.
#[derive(Clone, Debug)]
pub(crate) struct TriangleGrid {
    /// Axes of the mesh's frame that the cells divide.
    axes: [usize; 2],
    /// Least coordinates along these axes, m.
    low: [f64; 2],
    cells_per_metre: f64,
    /// Number of cells along these axes.
    cells: [usize; 2],
    /// The entries of cell c are `entries[first[c]..first[c + 1]]`.
    first: Vec<u32>,
    entries: Vec<u32>,
    /// Bounding box of every triangle: least coordinates, then greatest, rounded outwards, m.
    boxes: Vec<[f32; 6]>,
    /// Least and greatest coordinates of every cell along the third axis, rounded outwards, m.
    heights: Vec<[f32; 2]>,
}

impl TriangleGrid {
    /// Grid over triangles with these bounding boxes, least and greatest coordinates, m.
    pub(crate) fn new(boxes: &[[V; 2]]) -> Self {
        let corner = |pick: fn(f64, f64) -> f64, end: usize| {
            boxes.iter().map(|b| b[end]).reduce(|p, q| array_of(|k| pick(p[k], q[k]))).unwrap_or_default()
        };
        let (low, high) = (corner(f64::min, 0), corner(f64::max, 1));
        let side = sub(high, low);
        let shortest = (0..3).min_by(|&a, &b| side[a].total_cmp(&side[b])).unwrap_or(2);
        let axes = [(shortest + 1) % 3, (shortest + 2) % 3];
        let [a, b] = axes.map(|k| side[k]);
        let rounded = |[low, high]: &[V; 2]| array_of(|k| if k < 3 { round_down(low[k]) } else { -round_down(-high[k - 3]) });
        let mut grid = Self {
            axes,
            low: axes.map(|k| low[k]),
            cells_per_metre: 0.0,
            cells: [1; 2],
            first: vec![],
            entries: vec![],
            boxes: boxes.iter().map(rounded).collect(),
            heights: vec![],
        };
        // Two triangles per cell on a flat mesh; fewer and larger cells where triangles are much longer than wide.
        let area = (a * b).max(a.max(b).powi(2) / boxes.len().max(1) as f64);
        let mut cell = (2.0 * area / boxes.len().max(1) as f64).sqrt();
        while cell > 0.0 {
            grid.cells_per_metre = 1.0 / cell;
            grid.cells = [a, b].map(|side| (side * grid.cells_per_metre) as usize + 1);
            let count = |[low, high]: &[V; 2]| grid.cells_of(low, high).map(|range| range.len()).into_iter().product::<usize>();
            if boxes.iter().map(count).sum::<usize>() <= MAX_ENTRIES * boxes.len() {
                break;
            }
            cell *= 2.0;
        }
        grid.fill(boxes);
        grid
    }

    /// Lists the triangles of every cell, ascending.
    fn fill(&mut self, boxes: &[[V; 2]]) {
        let cells = |grid: &Self, [low, high]: &[V; 2]| {
            let ([columns, rows], width) = (grid.cells_of(low, high), grid.cells[0]);
            rows.flat_map(move |r| columns.clone().map(move |c| r * width + c))
        };
        let mut first = vec![0_u32; self.cells[0] * self.cells[1] + 1];
        boxes.iter().flat_map(|b| cells(self, b)).for_each(|cell| first[cell + 1] += 1);
        (1..first.len()).for_each(|cell| first[cell] += first[cell - 1]);
        let (mut next, mut entries) = (first.clone(), vec![0; first.last().map_or(0, |&n| n as usize)]);
        for (t, b) in (0..).zip(boxes) {
            for cell in cells(self, b) {
                entries[next[cell] as usize] = t;
                next[cell] += 1;
            }
        }
        let up = self.up_axis();
        let nothing = [f32::INFINITY, f32::NEG_INFINITY];
        let join = |[low, high]: [f32; 2], own: &[f32; 6]| [low.min(own[up]), high.max(own[up + 3])];
        let own = |ends: &[u32]| entries[ends[0] as usize..ends[1] as usize].iter().map(|&t| &self.boxes[t as usize]);
        self.heights = first.windows(2).map(|ends| own(ends).fold(nothing, join)).collect();
        (self.first, self.entries) = (first, entries);
    }

    /// Axis of the mesh's frame along which it is shortest: the cells are columns along it.
    pub(crate) fn up_axis(&self) -> usize {
        3 - self.axes[0] - self.axes[1]
    }

    /// Greatest coordinate along [`TriangleGrid::up_axis`] of the cells that a disc about the point `at` across this axis meets, m. Minus
    /// infinity beside the mesh.
    pub(crate) fn highest_under(&self, at: &V, radius: f64) -> f64 {
        let [columns, rows] = self.cells_of(&at.map(|x| x - radius), &at.map(|x| x + radius));
        let row = |row: usize| &self.heights[row * self.cells[0] + columns.start..row * self.cells[0] + columns.end.max(columns.start)];
        let highest = rows.flat_map(row).map(|height| height[1]).fold(f32::NEG_INFINITY, f32::max);
        f64::from(highest)
    }

    /// Cells along both axes that a box meets.
    fn cells_of(&self, low: &V, high: &V) -> [std::ops::Range<usize>; 2] {
        std::array::from_fn(|k| {
            // Saturating, so that a box beside the mesh has an empty range.
            let place = |x: &V| ((x[self.axes[k]] - self.low[k]) * self.cells_per_metre).floor();
            let last = place(high);
            place(low).max(0.0) as usize..if last < 0.0 { 0 } else { (last as usize).saturating_add(1).min(self.cells[k]) }
        })
    }

    /// Triangles whose bounding boxes meet the box from `low` to `high`, ascending, up to rounding to single precision.
    pub(crate) fn find(&self, low: &V, high: &V, out: &mut Vec<u32>) {
        let [columns, rows] = self.cells_of(low, high);
        let (low, high): ([f32; 3], [f32; 3]) = (low.map(round_down), high.map(|x| -round_down(-x)));
        let up = self.up_axis();
        for row in rows {
            for cell in row * self.cells[0] + columns.start..row * self.cells[0] + columns.end {
                if self.heights[cell][0] > high[up] || low[up] > self.heights[cell][1] {
                    continue;
                }
                for &t in &self.entries[self.first[cell] as usize..self.first[cell + 1] as usize] {
                    let own = &self.boxes[t as usize];
                    if (0..3).all(|k| own[k] <= high[k] && low[k] <= own[k + 3]) {
                        out.push(t);
                    }
                }
            }
        }
        out.sort_unstable();
        out.dedup();
    }
}

/// A number in single precision that is not above `x`.
fn round_down(x: f64) -> f32 {
    let rounded = x as f32;
    if f64::from(rounded) > x { rounded.next_down() } else { rounded }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn boxes() -> impl Strategy<Value = Vec<[V; 2]>> {
        let side = prop_oneof![Just(0.0), 0.0..0.1, 0.0..3.0];
        let one = (prop::array::uniform3(-1.0..1.0f64), prop::array::uniform3(side));
        prop::collection::vec(one.prop_map(|(low, side)| [low, add(low, side)]), 0..80)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        /// Every triangle whose box meets the query is found once, also if the query is empty, infinite or beside the mesh.
        #[test]
        fn a_query_finds_what_a_test_of_all_boxes_finds(
            boxes in boxes(), low in prop::array::uniform3(-3.0..3.0f64), side in prop_oneof![0.0..0.3f64, 0.0..9.0, Just(f64::INFINITY)],
        ) {
            let (high, mut found) = (low.map(|x| x + side), vec![]);
            TriangleGrid::new(&boxes).find(&low, &high, &mut found);
            let all = (0..).zip(&boxes);
            // Bounds are rounded by at most one unit in the last place of 4 m, 2.4e-7 m, and the query by one.
            let meets = |b: &[V; 2], hair: f64| (0..3).all(|k| b[0][k] <= high[k] + hair && low[k] <= b[1][k] + hair);
            let at_least: Vec<u32> = all.clone().filter(|(_, b)| meets(b, 0.0)).map(|(t, _)| t).collect();
            let at_most: Vec<u32> = all.filter(|(_, b)| meets(b, 1e-6)).map(|(t, _)| t).collect();
            prop_assert!(found.is_sorted() && at_least.iter().all(|t| found.contains(t)));
            prop_assert!(found.iter().all(|t| at_most.contains(t)));
            found.dedup();
            prop_assert!(found.len() <= at_most.len());
        }
    }
}
