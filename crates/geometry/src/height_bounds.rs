//! Upper bounds on the height of a mesh, which reject shapes that are too high to touch it.

use std::ops::RangeInclusive;

use parry3d_f64::bounding_volume::Aabb;

use crate::vectors::V;

/// Largest number of cells along x or y.
const MAX_CELLS: usize = 512;

/// Greatest height of the triangles over each cell of a regular grid in the xy plane.
#[derive(Clone, Debug)]
pub(super) struct HeightBounds {
    /// Least coordinates along x and y, m.
    low: [f64; 2],
    /// Size of a cell along x and y, m.
    size: [f64; 2],
    /// Number of cells along x and y.
    cells: [usize; 2],
    /// Greatest height over each cell, x fastest, m; minus infinity over cells without triangles.
    heights: Vec<f64>,
}

impl HeightBounds {
    /// Bounds of the triangles in `boxes`, within the least and greatest coordinates `extent`, m. A cell is about as large as a triangle.
    pub(super) fn new([low, high]: [V; 2], boxes: &[Aabb]) -> Self {
        let cells = [0, 1].map(|k| {
            let mean = boxes.iter().map(|b| b.maxs[k] - b.mins[k]).sum::<f64>() / boxes.len() as f64;
            (((high[k] - low[k]) / mean) as usize).clamp(1, MAX_CELLS)
        });
        let size = [0, 1].map(|k| (high[k] - low[k]) / cells[k] as f64);
        let mut bounds = Self { low: [low[0], low[1]], size, cells, heights: vec![f64::NEG_INFINITY; cells[0] * cells[1]] };
        for b in boxes {
            let [x, y] = [0, 1].map(|k| bounds.range(k, b.mins[k], b.maxs[k]));
            for row in y {
                for height in &mut bounds.heights[row * cells[0] + x.start()..=row * cells[0] + x.end()] {
                    *height = height.max(b.maxs.z);
                }
            }
        }
        bounds
    }

    /// Bound on the height below a horizontal disc, m: minus infinity, or the height over the nearest cell, where there is no triangle.
    pub(super) fn highest_below(&self, [x, y]: [f64; 2], radius: f64) -> f64 {
        let [columns, rows] = [(0, x), (1, y)].map(|(k, at)| self.range(k, at - radius, at + radius));
        let in_row = |row: usize| &self.heights[row * self.cells[0] + columns.start()..=row * self.cells[0] + columns.end()];
        rows.flat_map(in_row).copied().fold(f64::NEG_INFINITY, f64::max)
    }

    /// Columns (k = 0) or rows (k = 1) of cells between two coordinates; the nearest cell of coordinates outside all cells.
    fn range(&self, k: usize, low: f64, high: f64) -> RangeInclusive<usize> {
        // A cell without extent gives NaN, which becomes 0 as an integer. The tolerance assigns a coordinate on a border to both cells.
        let at = |x: f64, tolerance: f64| ((((x - self.low[k]) / self.size[k]) + tolerance) as usize).min(self.cells[k] - 1);
        at(low, -1e-9)..=at(high, 1e-9)
    }
}
