//! Detection of meshes whose convex hull is much larger than the mesh.

use std::collections::BTreeMap;

use stepper_geometry::Hull;

use crate::{Mesh, Model, Shape, weld_groups};

/// Number of grid points along each axis. A hull contains about 2000 of the 4096 points, so that a volume of half the hull has an error of
/// about 2 %.
const POINTS: usize = 16;

/// Position of a grid point in its cell, as fractions of the cell's size. It is not the centre, so that the grid lines miss the edges of
/// symmetric meshes and of meshes whose vertices are on a grid.
const PLACE: [f64; 3] = [0.437_1, 0.541_3, 0.486_7];

/// Smallest ratio of hull volume to mesh volume that is reported for moving geoms. The hull of a robot link often has twice the volume of
/// the link.
const WIDE: f64 = 2.0;

/// Smallest ratio of hull volume to mesh volume that is reported for fixed geoms. It is below [`WIDE`], because a trench in a terrain is
/// only a small part of the volume of the terrain's hull.
const WIDE_FIXED: f64 = 1.25;

/// Geom that collides as a convex hull much larger than its mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WideHull {
    /// Index of the geom in the model.
    pub geom: usize,
    /// Ratio of the hull's volume to the mesh's volume. The mesh's volume is the space in the hull that other bodies cannot enter. The
    /// ratio is infinite for a mesh that encloses no space, such as an open surface.
    pub ratio: f64,
}

impl Model {
    /// Geoms whose convex hull is much larger than their mesh: at least twice the volume, or 1.25 times if no joint moves the geom. The
    /// mesh's volume is the space in the hull that other bodies cannot enter.
    pub fn wide_hulls(&self) -> Vec<WideHull> {
        let (group, moves) = weld_groups(self);
        let mut known: BTreeMap<usize, f64> = BTreeMap::new();
        let mut found = vec![];
        for (geom, shape) in self.geoms.iter().map(|g| &g.shape).enumerate() {
            let (Shape::Mesh { concave: false, .. }, Some(mesh), Some(hull)) = (shape, self.mesh_index(shape), self.hull_of(shape)) else {
                continue;
            };
            if self.meshes[mesh].faces.is_empty() {
                continue; // The mesh is its convex hull.
            }
            let ratio = *known.entry(mesh).or_insert_with(|| volume_ratio(&self.meshes[mesh], hull));
            let moving = moves[group[self.geoms[geom].body]];
            if ratio >= if moving { WIDE } else { WIDE_FIXED } {
                found.push(WideHull { geom, ratio });
            }
        }
        found
    }
}

/// Ratio of the hull's volume to the mesh's volume. The mesh's volume is the space in the hull that other bodies cannot enter. The ratio is
/// infinite if there is no such space, and 1 if no grid point is in the hull.
fn volume_ratio(mesh: &Mesh, hull: &Hull) -> f64 {
    let grid = Grid::new(mesh);
    let sights = [0, 1, 2].map(|axis| grid.sights(&mesh.vertices, &mesh.faces, axis));
    let around = grid.sights(hull.points(), hull.triangles(), 0);
    let (mut inside, mut open) = (0_usize, 0_usize);
    for cell in grid.cells().filter(|&cell| !around.of(&grid, cell).contains(&Sight::Free)) {
        inside += 1;
        let seen: Vec<Sight> = (0..3).flat_map(|axis| sights[axis].of(&grid, cell)).collect();
        let count = |kind: Sight| seen.iter().filter(|&&s| s == kind).count();
        open += usize::from(count(Sight::Free) > 0 && count(Sight::Back) <= count(Sight::Front));
    }
    if inside == 0 { 1.0 } else { inside as f64 / (inside - open) as f64 }
}

/// Side of the first triangle that a ray hits: none, front or back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sight {
    Free,
    Front,
    Back,
}

/// Grid of points in the bounding box of a mesh.
struct Grid {
    low: [f64; 3],
    step: [f64; 3],
}

/// Intersections of the grid lines along one axis with triangles, one list for each grid line. An intersection has its coordinate on the
/// axis, m, and whether the triangle's normal points against the axis.
struct Sights {
    axis: usize,
    lines: Vec<Vec<(f64, bool)>>,
}

impl Grid {
    fn new(mesh: &Mesh) -> Self {
        let bound = |pick: fn(f64, f64) -> f64, start: f64| {
            std::array::from_fn::<f64, 3, _>(|k| mesh.vertices.iter().map(|v| v[k]).fold(start, pick))
        };
        let (low, high) = (bound(f64::min, f64::INFINITY), bound(f64::max, f64::NEG_INFINITY));
        Self { low, step: std::array::from_fn(|k| (high[k] - low[k]) / POINTS as f64) }
    }

    fn cells(&self) -> impl Iterator<Item = [usize; 3]> + use<> {
        (0..POINTS.pow(3)).map(|i| [i / POINTS / POINTS, i / POINTS % POINTS, i % POINTS])
    }

    fn at(&self, k: usize, i: usize) -> f64 {
        self.low[k] + (i as f64 + PLACE[k]) * self.step[k]
    }

    /// Indices of the grid points along the coordinate axis `k` between the coordinates `low` and `high`, m.
    fn between(&self, k: usize, low: f64, high: f64) -> std::ops::Range<usize> {
        let index = |x: f64| ((x - self.low[k]) / self.step[k] - PLACE[k]).ceil().clamp(0.0, POINTS as f64) as usize;
        index(low)..index(high)
    }

    /// Intersections of the grid lines along the coordinate axis `axis` with triangles, given by `points` and indices of points.
    fn sights(&self, points: &[[f64; 3]], triangles: &[[u32; 3]], axis: usize) -> Sights {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut lines = vec![vec![]; POINTS * POINTS];
        for corners in triangles.iter().map(|t| t.map(|i| points[i as usize])) {
            let [a, b, c] = corners;
            let area = (b[u] - a[u]) * (c[v] - a[v]) - (b[v] - a[v]) * (c[u] - a[u]);
            let bounds = |k: usize| self.between(k, a[k].min(b[k]).min(c[k]), a[k].max(b[k]).max(c[k]));
            if area == 0.0 {
                continue;
            }
            for (i, j) in bounds(u).flat_map(|i| bounds(v).map(move |j| (i, j))) {
                let p = [self.at(u, i), self.at(v, j)];
                let part = |s: [f64; 3], t: [f64; 3]| ((s[u] - p[0]) * (t[v] - p[1]) - (s[v] - p[1]) * (t[u] - p[0])) / area;
                let weights = [part(b, c), part(c, a), part(a, b)];
                if weights.iter().all(|&w| w >= 0.0) {
                    let place = (0..3).map(|k| weights[k] * corners[k][axis]).sum();
                    lines[i * POINTS + j].push((place, area < 0.0));
                }
            }
        }
        Sights { axis, lines }
    }
}

impl Sights {
    /// Sides (front or back) of the first triangles that two opposite rays from the grid point `cell` hit. The first ray points along the
    /// axis `self.axis`, the second in the opposite direction.
    fn of(&self, grid: &Grid, cell: [usize; 3]) -> [Sight; 2] {
        let (axis, u, v) = (self.axis, (self.axis + 1) % 3, (self.axis + 2) % 3);
        let (here, line) = (grid.at(axis, cell[axis]), &self.lines[cell[u] * POINTS + cell[v]]);
        let kind = |front: bool| if front { Sight::Front } else { Sight::Back };
        let ahead = line.iter().filter(|hit| hit.0 > here).min_by(|a, b| a.0.total_cmp(&b.0));
        let behind = line.iter().filter(|hit| hit.0 <= here).max_by(|a, b| a.0.total_cmp(&b.0));
        [ahead.map_or(Sight::Free, |hit| kind(hit.1)), behind.map_or(Sight::Free, |hit| kind(!hit.1))]
    }
}
