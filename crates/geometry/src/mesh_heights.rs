//! Largest heights of a mesh over a grid of cells. A shape that is above these heights needs no test of single triangles.

use std::ops::Range;

use crate::linear_algebra::*;
use crate::vectors::{V, extent};

/// Largest average number of cells that the bounding box of a triangle overlaps. It bounds the time of the construction.
const MAX_CELLS_MET: usize = 8;

/// Largest number of cells per triangle. It bounds the memory of narrow meshes.
const MAX_CELLS: usize = 2;

/// Largest height of a mesh in each cell of a grid. Heights are coordinates along the axis of the mesh's frame in which the mesh has the
/// smallest extent.
#[derive(Clone, Debug)]
pub(crate) struct MeshHeights {
    /// The two axes of the mesh's frame along which the grid of heights extends.
    axes: [usize; 2],
    /// Smallest coordinates of the mesh along the two axes of the grid, m.
    low: [f64; 2],
    /// Number of cells per metre, the same along both axes of the grid.
    cells_per_metre: f64,
    /// Number of cells along the two axes of the grid.
    cells: [usize; 2],
    /// Largest height of the mesh in each grid cell, m, with the first axis fastest. It is minus infinity in cells without a triangle.
    highest: Vec<f64>,
}

impl MeshHeights {
    /// Grid of largest heights, from the bounding boxes of the mesh's triangles: the smallest and largest coordinates of each triangle, m.
    pub(crate) fn new(boxes: &[[V; 2]]) -> Self {
        let [low, high] = extent(boxes.iter().flatten().copied());
        let side = sub(high, low);
        let shortest = (0..3).min_by(|&a, &b| side[a].total_cmp(&side[b])).unwrap_or(2);
        let axes = [(shortest + 1) % 3, (shortest + 2) % 3];
        let mut heights = Self { axes, low: axes.map(|k| low[k]), cells_per_metre: 0.0, cells: [1; 2], highest: vec![] };
        // The first cell size gives two triangles per cell, if all triangles are level and equally large. The loop doubles it until both
        // limits are met.
        let [a, b] = axes.map(|k| side[k]);
        let mut cell = (2.0 * a * b / boxes.len().max(1) as f64).sqrt();
        while cell > 0.0 {
            heights.cells_per_metre = 1.0 / cell;
            heights.cells = [a, b].map(|side| (side * heights.cells_per_metre) as usize + 1);
            let count = |[low, high]: &[V; 2]| heights.cells_of(low, high).map(|range| range.len()).into_iter().product::<usize>();
            let number = heights.cells[0].saturating_mul(heights.cells[1]);
            if number <= MAX_CELLS * boxes.len() + 1 && boxes.iter().map(count).sum::<usize>() <= MAX_CELLS_MET * boxes.len() {
                break;
            }
            cell *= 2.0;
        }
        heights.highest = vec![f64::NEG_INFINITY; heights.cells[0] * heights.cells[1]];
        for [low, high] in boxes {
            let [columns, rows] = heights.cells_of(low, high);
            for cell in rows.flat_map(|row| columns.clone().map(move |column| row * heights.cells[0] + column)) {
                heights.highest[cell] = heights.highest[cell].max(high[shortest]);
            }
        }
        heights
    }

    /// Axis of the mesh's frame along which heights are measured.
    pub(crate) fn up_axis(&self) -> usize {
        3 - self.axes[0] - self.axes[1]
    }

    /// Largest height of the mesh in the grid cells below or above a box, m; minus infinity without a triangle in these cells. `low` and
    /// `high` are the corners of the box, m.
    pub(crate) fn highest_in(&self, low: &V, high: &V) -> f64 {
        let [columns, rows] = self.cells_of(low, high);
        let row = |row: usize| &self.highest[row * self.cells[0] + columns.start..][..columns.len()];
        rows.filter(|_| !columns.is_empty()).flat_map(row).copied().fold(f64::NEG_INFINITY, f64::max)
    }

    /// Ranges of grid cells along both axes that a box overlaps. `low` and `high` are the corners of the box, m.
    fn cells_of(&self, low: &V, high: &V) -> [Range<usize>; 2] {
        std::array::from_fn(|k| {
            let places = [low, high].map(|x| (x[self.axes[k]] - self.low[k]) * self.cells_per_metre);
            cells_between(places, self.cells[k])
        })
    }
}

/// Range of the cells of an axis that overlap the interval from `low` to `high`. Coordinates are in cells. The axis has `count` cells, and
/// cell 0 begins at 0.
///
/// The range is empty if the interval ends before the first cell or begins after the last one.
pub(crate) fn cells_between([low, high]: [f64; 2], count: usize) -> Range<usize> {
    // The casts saturate, so that a coordinate may be negative or infinite.
    let last = high.floor();
    low.floor().max(0.0) as usize..if last < 0.0 { 0 } else { (last as usize).saturating_add(1).min(count) }
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
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// The result is an upper bound of the heights of all boxes below or above the query. The query may be infinite or outside the
        /// mesh.
        #[test]
        fn heights_bound_all_boxes_below_a_query(
            boxes in boxes(), low in prop::array::uniform3(-3.0..3.0f64), side in prop_oneof![0.0..0.3f64, 0.0..9.0, Just(f64::INFINITY)],
        ) {
            let (high, heights) = (low.map(|x| x + side), MeshHeights::new(&boxes));
            let found = heights.highest_in(&low, &high);
            let meets = |b: &&[V; 2]| heights.axes.iter().all(|&k| b[0][k] <= high[k] && low[k] <= b[1][k]);
            for b in boxes.iter().filter(meets) {
                prop_assert!(b[1][heights.up_axis()] <= found);
            }
            prop_assert!(found == f64::NEG_INFINITY || boxes.iter().any(|b| b[1][heights.up_axis()] == found));
        }
    }
}
