//! Surfaces of triangles: concave meshes and height fields.

use std::ops::Range;

use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::Vector;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};

use crate::linear_algebra::*;
use crate::mesh_heights::{MeshHeights, cells_between};
use crate::shape::triangle_normal;
use crate::vectors::{V, extent, unit_or};

/// Surface of triangles in its frame, with lengths in m.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "a model has a few, behind pointers")]
pub enum Surface {
    /// Mesh, which may be concave.
    Mesh(MeshSurface),
    /// Height field.
    Grid(Grid),
}

/// Triangles of a mesh and their neighbours.
#[derive(Clone, Debug)]
pub struct MeshSurface {
    /// Vertices of the mesh, m.
    pub(super) vertices: Vec<V>,
    /// Triangles of the mesh as vertex indices, counter-clockwise seen from outside.
    faces: Vec<[u32; 3]>,
    /// Outward unit normal of each triangle.
    normals: Vec<V>,
    /// Third vertex of the neighbour across the edge that starts at each corner of a triangle; `None` without a neighbour. If an edge has
    /// several neighbours, the entry is for the neighbour that rises most above the triangle.
    across: Vec<[Option<u32>; 3]>,
    /// Vertices that share an edge with each vertex. Those of vertex v are in `around[first[v]..first[v + 1]]`.
    around: Vec<u32>,
    /// For each vertex, index in `around` of its first neighbour; the last entry is the length of `around`.
    first: Vec<u32>,
    /// Tree of the triangles' bounding boxes.
    pub(super) tree: Bvh,
    /// Largest height of the mesh in each cell of a grid.
    heights: MeshHeights,
    /// Smallest and largest coordinates of the mesh, m.
    pub(super) extent: [V; 2],
}

/// Height field: heights over a regular grid of points.
#[derive(Clone, Debug)]
pub struct Grid {
    /// Number of grid points along y and x.
    pub shape: [usize; 2],
    /// Half of the grid's extent along x and y, m.
    pub half: [f64; 2],
    /// Heights of the grid points, m, row by row with x fastest.
    pub elevation: Vec<f64>,
    /// Depth of the base of the solid ground below z = 0, m. Shapes below the base are not pushed up.
    pub base: f64,
    /// Largest height of the grid points, m.
    pub highest: f64,
    /// Coordinates x of the grid's columns and y of its rows, m.
    places: [Vec<f64>; 2],
}

/// Heights of a surface within a horizontal disc.
#[derive(Clone, Copy, Debug)]
pub struct DiscHeights {
    /// Largest height of the grid cells that a horizontal disc may overlap, m; minus infinity outside the surface.
    pub highest: f64,
    /// Whether the grid cells below a horizontal disc and their neighbours have the same height. Every contact normal is then vertical.
    /// True for a disc outside a height field, and always false for a mesh.
    pub level: bool,
}

impl MeshSurface {
    /// Mesh from its vertices, m, and triangles as vertex indices. Triangles without area are left out.
    pub fn new(vertices: &[V], faces: &[[u32; 3]]) -> Self {
        // Vertices at the same place are merged.
        let mut places = std::collections::BTreeMap::new();
        let one: Vec<u32> = (0..).zip(vertices).map(|(v, p)| *places.entry(p.map(|x| (x + 0.0).to_bits())).or_insert(v)).collect();
        let corners = |f: &[u32; 3]| f.map(|v| vertices[v as usize]);
        let has_area = |f: &[u32; 3]| {
            let [a, b, c] = corners(f);
            norm(cross(sub(b, a), sub(c, a))) > 0.0
        };
        let faces: Vec<[u32; 3]> = faces.iter().map(|f| f.map(|v| one[v as usize])).filter(has_area).collect();
        let mut thirds: std::collections::BTreeMap<[u32; 2], Vec<u32>> = std::collections::BTreeMap::new();
        let mut beside = std::collections::BTreeSet::new();
        for f in &faces {
            for k in 0..3 {
                let [a, b, c] = [f[k], f[(k + 1) % 3], f[(k + 2) % 3]];
                thirds.entry([a, b]).or_default().push(c);
                beside.extend([[a, b], [b, a]]);
            }
        }
        let neighbour = |f: &[u32; 3], k: usize| {
            let [a, b, c] = [f[k], f[(k + 1) % 3], f[(k + 2) % 3]];
            let rise = |v: &u32| rise(&corners(&[a, b, c]), vertices[*v as usize]);
            // The back side of a thin sheet is not a neighbour.
            let others = thirds.get(&[b, a]).into_iter().flatten().copied().filter(|&v| v != c);
            others.max_by(|x, y| rise(x).total_cmp(&rise(y)))
        };
        let normals = faces.iter().map(|f| triangle_normal(&corners(f))).collect();
        let across = faces.iter().map(|f| std::array::from_fn(|k| neighbour(f, k))).collect();
        let mut first = vec![0; vertices.len() + 1];
        beside.iter().for_each(|&[v, _]| first[v as usize + 1] += 1);
        (0..vertices.len()).for_each(|v| first[v + 1] += first[v]);
        let around = beside.into_iter().map(|[_, w]| w).collect();
        let boxes: Vec<Aabb> = faces.iter().map(|f| bounds(&corners(f))).collect();
        let tree = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
        let heights = MeshHeights::new(&boxes.iter().map(|b| [b.mins, b.maxs].map(|p| [p.x, p.y, p.z])).collect::<Vec<_>>());
        let extent = extent(faces.iter().flatten().map(|&v| vertices[v as usize]));
        Self { vertices: vertices.to_vec(), faces, normals, across, around, first, tree, heights, extent }
    }

    /// Corners of triangle `t` of the mesh, m.
    pub(super) fn triangle(&self, t: u32) -> [V; 3] {
        self.faces[t as usize].map(|v| self.vertices[v as usize])
    }
}

/// Angle by which a neighbouring triangle rises above the plane of a triangle, rad; negative if it falls.
///
/// The two triangles share the edge from the first to the second of the `corners`, m. `p` is the neighbour's third corner, m.
fn rise(corners: &[V; 3], p: V) -> f64 {
    let [a, b, _] = *corners;
    let n = triangle_normal(corners);
    let d = sub(p, a);
    dot(n, d).atan2(dot(unit_or(cross(sub(b, a), n), [0.0; 3]), d))
}

/// Bounding box of points, m.
pub(super) fn bounds(points: &[V]) -> Aabb {
    let [low, high] = extent(points.iter().copied()).map(|[x, y, z]| Vector::new(x, y, z));
    Aabb::new(low, high)
}

impl Grid {
    /// Height field of `shape` points along y and x over a rectangle with the half sizes `half` along x and y, m.
    ///
    /// `elevation` are the heights, m, row by row with x fastest. The ground is solid down to `base` below z = 0, m.
    pub fn new(shape: [usize; 2], half: [f64; 2], elevation: Vec<f64>, base: f64) -> Self {
        let highest = elevation.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let places = [0, 1].map(|k| {
            let n = shape[1 - k];
            (0..n).map(|i| -half[k] + 2.0 * half[k] * i as f64 / (n - 1) as f64).collect()
        });
        Self { shape, half, elevation, base, highest, places }
    }

    /// Point of the grid in column `c` and row `r`, m.
    fn vertex(&self, c: usize, r: usize) -> V {
        [self.places[0][c], self.places[1][r], self.elevation[r * self.shape[1] + c]]
    }

    /// Point of the grid in column `c` and row `r`, m; `None` outside the grid.
    fn near(&self, c: Option<usize>, r: Option<usize>) -> Option<V> {
        let (c, r) = (c?, r?);
        (c < self.shape[1] && r < self.shape[0]).then(|| self.vertex(c, r))
    }

    /// Row and column of the cell with triangle `t`, and whether the triangle is the upper one. Cell k has the triangles 2 k and 2 k + 1.
    #[inline(always)]
    fn cell_of(&self, t: usize) -> (usize, usize, bool) {
        let (cell, columns) = (t / 2, self.shape[1] - 1);
        (cell / columns, cell % columns, t % 2 == 1)
    }

    /// Corners of triangle `t`, m.
    #[inline(always)]
    fn triangle(&self, t: usize) -> [V; 3] {
        let (r, c, upper) = self.cell_of(t);
        let at = |dc: usize, dr: usize| self.vertex(c + dc, r + dr);
        if upper { [at(0, 0), at(1, 1), at(0, 1)] } else { [at(0, 0), at(1, 0), at(1, 1)] }
    }

    /// Third corner of the neighbour of triangle `t` across each edge, m; `None` without a neighbour.
    ///
    /// Each cell is divided by the diagonal from its corner with the smallest coordinates, as in MuJoCo's `mjc_ConvexHField`.
    fn across(&self, t: usize) -> [Option<V>; 3] {
        let (r, c, upper) = self.cell_of(t);
        if upper {
            [Some(self.vertex(c + 1, r)), self.near(Some(c + 1), Some(r + 2)), self.near(c.checked_sub(1), Some(r))]
        } else {
            [self.near(Some(c), r.checked_sub(1)), self.near(Some(c + 2), Some(r + 1)), Some(self.vertex(c, r + 1))]
        }
    }

    /// Grid points that share an edge with corner `k` of triangle `t`, m.
    fn around(&self, t: usize, k: usize) -> impl Iterator<Item = V> + '_ {
        let (r, c, upper) = self.cell_of(t);
        let (dc, dr) = if upper { [(0, 0), (1, 1), (0, 1)][k] } else { [(0, 0), (1, 0), (1, 1)][k] };
        let (c, r) = (c + dc, r + dr);
        let beside = [(-1, -1), (0, -1), (1, 0), (1, 1), (0, 1), (-1, 0)];
        beside.into_iter().filter_map(move |(x, y)| self.near(c.checked_add_signed(x), r.checked_add_signed(y)))
    }

    /// Range of columns (k = 0) or rows (k = 1) of cells between the coordinates `low` and `high` along x or y, m.
    fn cells(&self, k: usize, low: f64, high: f64) -> Range<usize> {
        let count = self.shape[1 - k] - 1;
        let cell = 2.0 * self.half[k] / count as f64;
        cells_between([low, high].map(|x| (x + self.half[k]) / cell), count)
    }

    /// Whether a point is below the height field. Outside the grid, the height is that of the closest point of its border.
    pub(super) fn is_below(&self, p: V) -> bool {
        // Coordinates along x and y, in cells.
        let at = [0, 1].map(|k| {
            let cells = self.shape[1 - k] - 1;
            ((p[k] + self.half[k]) / (2.0 * self.half[k])).clamp(0.0, 1.0) * cells as f64
        });
        p[2] <= self.height(at)
    }

    /// Whether a point is in the solid ground, between the surface and the base.
    pub(super) fn is_inside(&self, p: V) -> bool {
        p[0].abs() <= self.half[0] && p[1].abs() <= self.half[1] && p[2] >= -self.base && self.is_below(p)
    }

    /// Height at a place within the grid, m. `at` are the coordinates along x and y, in cells from the point with the smallest coordinates.
    pub(super) fn height(&self, at: [f64; 2]) -> f64 {
        // Cell, and position within it.
        let [(c, x), (r, y)] = [0, 1].map(|k| {
            let first = (at[k] as usize).min(self.shape[1 - k] - 2);
            (first, at[k] - first as f64)
        });
        let height = |dc: usize, dr: usize| self.elevation[(r + dr) * self.shape[1] + c + dc];
        let beside = if x > y { height(1, 0) } else { height(0, 1) };
        let (first, last) = (x.max(y), x.min(y));
        (1.0 - first) * height(0, 0) + (first - last) * beside + last * height(1, 1)
    }

    /// Heights within a horizontal disc with the centre (x, y) and this radius, m.
    fn heights_below_disc(&self, [x, y]: [f64; 2], radius: f64) -> DiscHeights {
        let [rows, columns] = self.shape;
        let (c, r) = (self.cells(0, x - radius, x + radius), self.cells(1, y - radius, y + radius));
        let mut highest = f64::NEG_INFINITY;
        if c.is_empty() || r.is_empty() {
            return DiscHeights { highest, level: true };
        }
        let row = |row: usize, columns_of: Range<usize>| &self.elevation[row * columns + columns_of.start..row * columns + columns_of.end];
        for height in (r.start..=r.end).flat_map(|k| row(k, c.start..c.end + 1)) {
            highest = highest.max(*height);
        }
        // Neighbouring cells must have the same height, because the surface may fall off at the edge between them. At the border of the
        // grid it does.
        let level = c.start > 0
            && r.start > 0
            && c.end < columns - 1
            && r.end < rows - 1
            && (r.start - 1..=r.end + 1).all(|k| row(k, c.start - 1..c.end + 2).iter().all(|height| *height == highest));
        DiscHeights { highest, level }
    }

    /// Adds to `out` the triangles of all cells below or inside a box with the corners `low` and `high`, m.
    fn under(&self, low: V, high: V, out: &mut Vec<u32>) {
        let columns = self.shape[1];
        for r in self.cells(1, low[1], high[1]) {
            for c in self.cells(0, low[0], high[0]) {
                let cell = r * (columns - 1) + c;
                let top = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dc, dr)| self.elevation[(r + dr) * columns + c + dc]);
                if top.into_iter().fold(f64::NEG_INFINITY, f64::max) >= low[2] {
                    out.extend([2 * cell as u32, 2 * cell as u32 + 1]);
                }
            }
        }
    }
}

impl Surface {
    /// Corners of triangle `t` of the surface, m.
    pub(super) fn triangle(&self, t: u32) -> [V; 3] {
        match self {
            Self::Mesh(m) => m.triangle(t),
            Self::Grid(g) => g.triangle(t as usize),
        }
    }

    /// Outward unit normal of triangle `t`, whose corners are `corners`.
    pub(super) fn normal(&self, t: u32, corners: &[V; 3]) -> V {
        match self {
            Self::Mesh(m) => m.normals[t as usize],
            Self::Grid(_) => triangle_normal(corners),
        }
    }

    /// Third corner of the neighbour of triangle `t` across each edge, m; `None` without a neighbour.
    pub(super) fn across(&self, t: u32) -> [Option<V>; 3] {
        match self {
            Self::Mesh(m) => m.across[t as usize].map(|v| v.map(|v| m.vertices[v as usize])),
            Self::Grid(g) => g.across(t as usize),
        }
    }

    /// Whether triangle `t` has an edge without a neighbour (mesh), or is in a cell at the border (grid).
    pub(super) fn is_at_border(&self, t: u32) -> bool {
        match self {
            Self::Mesh(m) => m.across[t as usize].iter().any(Option::is_none),
            Self::Grid(g) => {
                let ((r, c, _), [rows, columns]) = (g.cell_of(t as usize), g.shape);
                r == 0 || c == 0 || r == rows - 2 || c == columns - 2
            }
        }
    }

    /// Whether `visit` returns true for all vertices that share an edge with corner `k` of triangle `t`. It stops at the first false. Each
    /// vertex is passed as its position, m.
    pub(super) fn all_around(&self, t: u32, k: usize, mut visit: impl FnMut(V) -> bool) -> bool {
        match self {
            Self::Mesh(m) => {
                let v = m.faces[t as usize][k] as usize;
                m.around[m.first[v] as usize..m.first[v + 1] as usize].iter().all(|&w| visit(m.vertices[w as usize]))
            }
            Self::Grid(g) => g.around(t as usize, k).all(visit),
        }
    }

    /// Axis of the surface's frame along which heights are measured: z for a height field, and for a mesh the axis along which it is
    /// shortest.
    pub fn up_axis(&self) -> usize {
        match self {
            Self::Mesh(m) => m.heights.up_axis(),
            Self::Grid(_) => 2,
        }
    }

    /// Largest height of the surface along [`Surface::up_axis`], m.
    pub fn highest(&self) -> f64 {
        match self {
            Self::Mesh(m) => m.extent[1][self.up_axis()],
            Self::Grid(g) => g.highest,
        }
    }

    /// Heights of the surface within a disc around the point `at` in the surface's frame. The disc is perpendicular to
    /// [`Surface::up_axis`]. Lengths are in m.
    pub fn heights_below_disc(&self, at: V, radius: f64) -> DiscHeights {
        match self {
            Self::Mesh(m) => DiscHeights { highest: m.heights.highest_in(&at.map(|x| x - radius), &at.map(|x| x + radius)), level: false },
            Self::Grid(g) => g.heights_below_disc([at[0], at[1]], radius),
        }
    }

    /// Writes the indices of the triangles in the box from `low` to `high` to `out`, in ascending order. Triangles near the box may be
    /// included.
    pub(super) fn candidates(&self, low: V, high: V, out: &mut Vec<u32>) {
        out.clear();
        match self {
            Self::Mesh(m) => {
                if low[self.up_axis()] > m.heights.highest_in(&low, &high) {
                    return;
                }
                let [a, b] = [low, high].map(|p| Vector::new(p[0], p[1], p[2]));
                out.extend(m.tree.intersect_aabb(&Aabb::new(a, b)));
                out.sort_unstable();
            }
            Self::Grid(g) => {
                if high[2] >= -g.base {
                    g.under(low, high, out);
                }
            }
        }
    }
}
