//! Contacts with surfaces of triangles: concave meshes and height fields.
//!
//! A surface is solid behind its triangles (below them, for a height field). Contact forces therefore never pull a shape through it.
//! Contacts are found triangle by triangle. The closest point p of a triangle is a contact only if no neighbour is closer to the shape.
//! With the vector d from p to the shape, this is the case if
//!
//! ```text
//! d . u <= 0
//! ```
//!
//! for every direction u along the surface that starts at p.
//!
//! Inside a triangle, only its normal is such a d. At an edge, the vectors d are between the normals of the two triangles. At a corner,
//! they are in the cone of the normals of its triangles. (This cone is the Gauss image of the corner, and the shape is in its Voronoi
//! region: Lin & Canny, 1991.) A concave edge has no such d.
//!
//! If the closest point belongs to a neighbour, the triangle has no contact there. Such a contact would be a tilted plane that is not part
//! of the surface, and would brake a shape that slides past. Corners of the shape above the triangle are still contacts, with the
//! triangle's normal. Edges without a neighbour count as convex.

use std::ops::Range;

use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::Vector;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};

use crate::approach::Approach;
use crate::ball::{Ball, TriangleTest, ball_over};
use crate::facet::{FLAT, Facet, Outline, PARALLEL};
use crate::facing::{Facing, Separation};
use crate::linear_algebra::*;
use crate::manifold::{LEVEL, Manifold, Point, Reach, VERTICES, reduce_points};
use crate::mesh_heights::{MeshHeights, cells_between};
use crate::pair::Pair;
use crate::round::{ends, is_over, may_touch, nearest_of_triangle};
use crate::search_limits::SearchLimits;
use crate::separation::{self};
use crate::shape::ConvexShape;
use crate::shape::triangle_normal;
use crate::vectors::{Pose, V};
use crate::vectors::{furthest, neg, unit_or};
use crate::workspace::Workspace;

/// Largest number of contact points of a convex shape and a surface.
pub const MAX_SURFACE_POINTS: usize = 16;

/// Depth up to which a contact point certainly belongs to the triangle above it, relative to the size of the pair. Deeper points may be
/// closer to another triangle. Contacts at rest are at most 1e-4 deep.
const SHALLOW: f64 = 1e-3;

/// Distance of a deep contact point from another triangle, relative to the point's depth, below which the point belongs to that triangle.
///
/// Example: a peg overlaps the wall of its hole by micrometres, and is centimetres below the face around the hole.
const NEARER: f64 = 0.5;

/// Range of the cosine between the normals of two triangles, within which a contact point of one may belong to the other. Above it the
/// triangles are part of one face. Below it they are the two sides of a thin sheet.
const TURNED: Range<f64> = -0.5..0.99;

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
    vertices: Vec<V>,
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
    highest: f64,
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
        let used = || faces.iter().flatten().map(|&v| vertices[v as usize]);
        let extent =
            [f64::min, f64::max].map(|pick: fn(f64, f64) -> f64| used().reduce(|p, q| array_of(|k| pick(p[k], q[k]))).unwrap_or_default());
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
    let fold = |pick: fn(f64, f64) -> f64, k: usize| points.iter().map(|p| p[k]).reduce(pick).unwrap_or(0.0);
    let corner = |pick: fn(f64, f64) -> f64| Vector::new(fold(pick, 0), fold(pick, 1), fold(pick, 2));
    Aabb::new(corner(f64::min), corner(f64::max))
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

    /// Largest height of the height field, m.
    #[inline]
    pub fn highest(&self) -> f64 {
        self.highest
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

    /// Triangle `t` of the height field with its neighbours.
    ///
    /// Each cell is divided by the diagonal from its corner with the smallest coordinates, as in MuJoCo's `mjc_ConvexHField`.
    fn facet(&self, t: usize) -> Facet {
        let ((r, c, upper), corners) = (self.cell_of(t), self.triangle(t));
        let third = if upper {
            [Some(self.vertex(c + 1, r)), self.near(Some(c + 1), Some(r + 2)), self.near(c.checked_sub(1), Some(r))]
        } else {
            [self.near(Some(c), r.checked_sub(1)), self.near(Some(c + 2), Some(r + 1)), Some(self.vertex(c, r + 1))]
        };
        Facet::new(corners, triangle_normal(&corners), third)
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
    fn is_below(&self, p: V) -> bool {
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
    fn normal(&self, t: u32, corners: &[V; 3]) -> V {
        match self {
            Self::Mesh(m) => m.normals[t as usize],
            Self::Grid(_) => triangle_normal(corners),
        }
    }

    /// Triangle `t` of the surface, with its neighbours.
    fn facet(&self, t: usize) -> Facet {
        match self {
            Self::Mesh(m) => {
                let at = |v: u32| m.vertices[v as usize];
                Facet::new(m.faces[t].map(at), m.normals[t], m.across[t].map(|v| v.map(at)))
            }
            Self::Grid(g) => g.facet(t),
        }
    }

    /// Whether triangle `t` has an edge without a neighbour (mesh), or is in a cell at the border (grid).
    fn is_at_border(&self, t: u32) -> bool {
        match self {
            Self::Mesh(m) => m.across[t as usize].iter().any(Option::is_none),
            Self::Grid(g) => {
                let ((r, c, _), [rows, columns]) = (g.cell_of(t as usize), g.shape);
                r == 0 || c == 0 || r == rows - 2 || c == columns - 2
            }
        }
    }

    /// Whether `visit` returns true for all vertices next to a part (inside, edge or corner) of triangle `t`. It stops at the first false.
    ///
    /// Each vertex is passed as its position, m. It belongs to a neighbouring triangle. All directions along the surface that start at the
    /// part, except those along the triangle itself, are between the directions to these vertices.
    fn all_beside(&self, t: usize, facet: &Facet, at: &Outline, mut visit: impl FnMut(V) -> bool) -> bool {
        match (at, self) {
            (Outline::Inside, _) => true,
            (Outline::Edge(k), _) => facet.across[*k].is_none_or(visit),
            (Outline::Corner(k), Self::Grid(g)) => g.around(t, *k).all(visit),
            (Outline::Corner(k), Self::Mesh(m)) => {
                let v = m.faces[t][*k] as usize;
                m.around[m.first[v] as usize..m.first[v + 1] as usize].iter().all(|&w| visit(m.vertices[w as usize]))
            }
        }
    }

    /// Whether a point above triangle `t` remains above this triangle, or above neighbours that do not fall away from its plane. The point
    /// moves by up to `sideways`, m, parallel to the plane.
    fn stays_over(&self, t: u32, corners: &[V; 3], normal: V, point: V, sideways: f64) -> bool {
        let mut facet = None;
        let foot = add_scaled(point, normal, -dot(normal, sub(point, corners[0])));
        (0..3).all(|k| {
            let [a, b] = [corners[k], corners[(k + 1) % 3]];
            let edge = sub(b, a);
            let outwards = cross(edge, normal);
            let inside = -dot(outwards, sub(foot, a));
            if inside > 0.0 && inside * inside > sideways * sideways * dot(edge, edge) {
                return true;
            }
            // Beyond the neighbour's other edges there may be lower triangles. An overhanging neighbour is not on the other side of the
            // shared edge.
            let facet = facet.get_or_insert_with(|| self.facet(t as usize));
            let is_far_from_others = |third: V| {
                let third = add_scaled(third, normal, -dot(normal, sub(third, a)));
                dot(outwards, sub(third, a)) > 0.0 && from_segment(foot, a, third).min(from_segment(foot, third, b)) > sideways
            };
            !facet.bulges[k] && facet.across[k].is_some_and(is_far_from_others)
        })
    }

    /// Whether no neighbour at a part of triangle `t` is closer to a shape in the direction `d` than the part itself.
    ///
    /// `at` is the part, `p` a point of it, m, and `d` a unit vector.
    fn is_nearest(&self, t: usize, facet: &Facet, at: &Outline, p: V, d: V) -> bool {
        self.all_beside(t, facet, at, |w| {
            let u = sub(w, p);
            dot(d, u) <= FLAT * norm(u)
        })
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

/// Finds the contact points of a surface and a convex shape and writes them to `out`. There are at most [`MAX_SURFACE_POINTS`].
///
/// The distance of each point is at most `limits.max_distance`, m. Normals point from the surface to the shape. Points and normals are in
/// the world frame.
///
/// If `limits.approach` is given, points that cannot push within the step may be absent. The normal of a contact at an edge or corner is a
/// positive combination of the normals of the triangles there. The contact's closing speed is therefore at most the same combination of the
/// closing speeds of these triangles. The contact can push only if a contact with one of the triangles can. At a border of the surface this
/// need not be true, so that all triangles there are tested.
pub fn collide_surface(
    a: &Surface,
    pose_a: &Pose,
    b: &ConvexShape,
    pose_b: &Pose,
    limits: impl Into<SearchLimits>,
    out: &mut Manifold,
    workspace: &mut Workspace,
) {
    let limits = limits.into();
    let (SearchLimits { max_distance, approach, .. }, within) = (limits, limits.reach());
    out.clear();
    let nothing = ConvexShape::Sphere { radius: 0.0 };
    let whole = Pair::new(&nothing, pose_a, b, pose_b);
    if !whole.is_finite() {
        return;
    }
    let reach = max_distance + b.radius();
    let core = ends(&whole);
    let nearer = approach.filter(|_| matches!(a, Surface::Mesh(_)));
    let [low, high] = search_box(&whole, core.as_deref(), reach, nearer);
    let mut triangles = std::mem::take(&mut workspace.triangles);
    a.candidates(low, high, &mut triangles);
    let mut culled = nearer.is_some();
    workspace.all.clear();
    workspace.owners.clear();
    // Triangle with the smallest separation, among the triangles whose closest point belongs to a neighbour.
    let mut left: Option<(u32, Facing)> = None;
    for &t in &triangles {
        let corners = a.triangle(t);
        let normal = a.normal(t, &corners);
        // The separation along the normal is a lower bound of the distance.
        let along = match &core {
            Some(ends) => ends.iter().map(|end| dot(normal, sub(*end, corners[0]))).reduce(f64::min).unwrap_or_default(),
            None => dot(normal, whole.support_b(neg(normal))) - dot(normal, corners[furthest(&corners, normal)]),
        };
        if along - b.radius() > max_distance {
            continue;
        }
        if let Some(approach) = &approach
            && approach.excludes_normal(normal, along - b.radius(), whole.size)
            && !a.is_at_border(t)
        {
            culled = true;
            continue;
        }
        if let Some(ends) = &core {
            // Most triangles are outside the projection of a ball or capsule. Most balls are above exactly one triangle.
            if !may_touch(&corners, normal, ends, reach) {
                continue;
            }
            if let [centre] = ends[..] {
                if along > 0.0 && is_over(&corners, normal, centre) {
                    let stays_over_face =
                        approach.is_some_and(|approach| a.stays_over(t, &corners, normal, centre, approach.sideways(normal)));
                    workspace.all.push(Point {
                        feature: feature_id(t, 0),
                        stays_over_face,
                        ..ball_over(normal, centre, along, b.radius())
                    });
                    workspace.owners.push(t);
                    continue;
                }
                // A ball beside the triangle may be too far from its outline, or have no contact that can push. A ball behind a triangle of
                // a mesh is on the other side of a wall.
                let mut is_far = || {
                    let apart = sub(centre, nearest_of_triangle(&corners, centre));
                    let (distance, n) = (norm(apart), unit_or(apart, normal));
                    if distance - b.radius() > max_distance {
                        return true;
                    }
                    let cannot_push = approach.is_some_and(|a| a.excludes_normal(n, distance - b.radius(), whole.size));
                    culled |= cannot_push;
                    cannot_push
                };
                let is_left_out = if along > 0.0 { is_far() } else { matches!(a, Surface::Mesh(_)) };
                if is_left_out {
                    continue;
                }
            }
        }
        let facet = a.facet(t as usize);
        let triangle = ConvexShape::Triangle(facet.corners);
        let pair = Pair::between(&triangle, b, whole.pos, whole.mat);
        if let Some(facing) = touch(a, t as usize, &facet, &pair, along, within, out, workspace)
            && left.as_ref().is_none_or(|(_, other)| facing.found.separation < other.found.separation)
        {
            left = Some((t, facing));
        }
        workspace.all.extend(out.points.drain(..).map(|p| Point { feature: feature_id(t, p.feature), ..p }));
        workspace.owners.resize(workspace.all.len(), t);
    }
    if workspace.all.iter().any(|p| p.distance < -SHALLOW * whole.size) {
        drop_nearer_elsewhere(a, &triangles, whole.size, workspace);
    }
    workspace.triangles = triangles;
    if culled && left.is_some() && workspace.all.is_empty() {
        // The closest point may belong to a skipped triangle: one whose contacts cannot push within the step. The second search skips none.
        return collide_surface(a, pose_a, b, pose_b, SearchLimits { approach: None, ..limits }, out, workspace);
    }
    // If no triangle accepted a point, rounding caused all to reject the closest one.
    if let Some((t, facing)) = left.filter(|_| workspace.all.is_empty()) {
        let triangle = ConvexShape::Triangle(a.facet(t as usize).corners);
        let pair = Pair::between(&triangle, b, whole.pos, whole.mat);
        workspace.clipper.manifold(&pair, &facing, within, out);
        workspace.all.extend(out.points.drain(..).map(|p| Point { feature: feature_id(t, p.feature), ..p }));
    }
    reduce_points(&mut workspace.all, whole.size, within, MAX_SURFACE_POINTS, out);
    out.move_to_world(pose_a);
}

/// Smallest and largest coordinates of the box in which triangles can have contacts with a shape, m, in the frame of the surface.
///
/// The shape is the second one of `whole`. `core` is the centre of a ball or the ends of a capsule's segment; `None` for other shapes.
/// Triangles count if they are within `reach` of the shape without its rounding radius, m. If `approach` is given, they count only if their
/// contacts can push within the step.
///
/// A contact joins a point x of the surface and a point y of the shape. For contacts that can push, [`Approach::max_components`] bounds y -
/// x. The box can therefore be smaller with `approach`, but is never smaller than for a shape at rest.
pub(super) fn search_box(whole: &Pair<'_>, core: Option<&[V]>, reach: f64, approach: Option<Approach>) -> [V; 2] {
    let [low, high] = whole.extent_b(core);
    let [against_axes, along_axes] = approach.map_or([[f64::INFINITY; 3]; 2], |approach| approach.max_components(whole.size));
    let reach = |most: f64| reach.min(whole.b.radius() + most);
    [array_of(|k| low[k] - reach(along_axes[k])), array_of(|k| high[k] + reach(against_axes[k]))]
}

/// Finds the contact points of a half space and the vertices of a mesh and writes them to `out`, in the world frame.
///
/// The half space is below the xy plane of the pose `plane`. Points are within `reach`. A height field gets no contact points.
pub(super) fn collide_plane_surface(
    plane: &Pose,
    surface: &Surface,
    pose: &Pose,
    reach: Reach,
    out: &mut Manifold,
    workspace: &mut Workspace,
) {
    out.clear();
    let nothing = ConvexShape::Sphere { radius: 0.0 };
    if let Surface::Mesh(mesh) = surface {
        workspace.clipper.cloud(&Pair::new(&nothing, plane, &nothing, pose), &mesh.vertices, reach, out);
        out.move_to_world(plane);
    }
}

/// Identifier of a contact point of a triangle and a shape. At a vertex of the shape it is the same for all triangles. At an edge or face
/// it depends on the triangle.
fn feature_id(triangle: u32, feature: u32) -> u32 {
    if feature < VERTICES { feature } else { crate::manifold::mix(triangle, feature) }
}

/// Adds the contact points of triangle `t` and a shape to `out`. The shape is the second one of `pair`.
///
/// `along` is the separation of the triangle and the shape without its rounding radius, along the normal of the triangle, m. Points beyond
/// `reach` are left out. If there are no points because the closest point belongs to a neighbour, the
/// result is the separation of triangle and shape; else `None`.
#[expect(clippy::too_many_arguments, reason = "a triangle, a shape, and where points go")]
fn touch(
    surface: &Surface,
    t: usize,
    facet: &Facet,
    pair: &Pair<'_>,
    along: f64,
    reach: Reach,
    out: &mut Manifold,
    workspace: &mut Workspace,
) -> Option<Facing> {
    if let ConvexShape::Sphere { radius } = *pair.b {
        let ball = Ball { facet, pair, height: along, radius, max_distance: reach.max_distance };
        let grid = if let Surface::Grid(grid) = surface { Some(grid) } else { None };
        let is_below = grid.map(|grid| |p: V| grid.is_below(p));
        match ball.touch(is_below, |at, p, d| surface.is_nearest(t, facet, at, p, d), out) {
            TriangleTest::Complete => return None,
            TriangleTest::LeftToNeighbour(facing) => return Some(facing),
            TriangleTest::Unclear => {}
        }
    }
    touch_any(surface, t, facet, pair, along, reach, out, workspace)
}

/// Adds the contact points of triangle `t` and a shape by the general search, which works for all shapes. The arguments and the result are
/// the same as for [`touch`].
#[expect(clippy::too_many_arguments, reason = "a triangle, a shape, and where points go")]
fn touch_any(
    surface: &Surface,
    t: usize,
    facet: &Facet,
    pair: &Pair<'_>,
    along: f64,
    reach: Reach,
    out: &mut Manifold,
    workspace: &mut Workspace,
) -> Option<Facing> {
    let normal = facet.normal;
    let flat = Separation { normal, separation: along, points: [facet.corners[0]; 2] };
    let over = |workspace: &mut Workspace, out: &mut Manifold| {
        let rises = if along < 0.0 { facet.rises() } else { [0.0; 3] };
        if facet.may_be_under(pair, &rises) {
            workspace.clipper.over_facet(pair, &Facing::new(pair, flat), &facet.bulges, &rises, reach, out);
        }
    };
    let behind = dot(normal, pair.apart) <= 0.0;
    if behind && let Surface::Grid(grid) = surface {
        // The shape is inside a height field, or outside again on the other side of a sharp crest.
        over(workspace, out);
        if !grid.is_below(add(pair.apart, pair.a.centre())) {
            out.points.retain(|p| p.distance >= 0.0 || grid.is_below(add_scaled(p.pos, p.normal, 0.5 * p.distance)));
        }
        return None;
    }
    if behind && dot(normal, sub(pair.support_b(normal), facet.corners[0])) <= 0.0 {
        // The whole shape is on the other side of a wall of a mesh.
        return None;
    }
    // If the shape's centre is behind a triangle of a mesh, its closest point may be on the triangle's outline, at a sharp edge. The
    // shape's corners above or below the triangle are then not contacts.
    let over = |workspace: &mut Workspace, out: &mut Manifold| {
        if !behind {
            over(workspace, out);
        }
    };
    if facet.bulges == [false; 3] {
        // At concave edges, the neighbours are at least as close.
        over(workspace, out);
        return None;
    }
    let facing = separation::nearest(pair, &reach.max_distance.into(), &mut workspace.polytope);
    let found = &facing.found;
    if found.separation - pair.rounding_radii() > reach.max_distance {
        return None;
    }
    let cos = dot(found.normal, normal);
    if behind && (cos <= 0.0 || found.separation <= 0.0) {
        return None;
    }
    if 1.0 - cos <= PARALLEL {
        over(workspace, out);
        return None;
    }
    let (at, p) = facet.furthest(found.normal);
    if cos > 0.0 && !matches!(at, Outline::Inside) && surface.is_nearest(t, facet, &at, p, found.normal) {
        workspace.clipper.manifold(pair, &facing, reach, out);
        if out.is_single_unnamed() && 1.0 - cos <= LEVEL {
            // The other corners of a slightly tilted shape above the triangle are as close, or soon will be.
            over(workspace, out);
        }
        return None;
    }
    over(workspace, out);
    (out.points.is_empty() && cos > 0.0).then_some(facing)
}

/// Removes contact points that are deep below their triangle and much closer to another of the `triangles`, unless no point would remain.
///
/// A point behind the other triangle is removed only if that triangle has a shallower point. Otherwise, at a sharp ridge, the deep point is
/// the only contact there. `size` is the size of the pair, m.
#[cold]
fn drop_nearer_elsewhere(surface: &Surface, triangles: &[u32], size: f64, workspace: &mut Workspace) {
    let Workspace { all, owners, is_own, .. } = workspace;
    let belongs = |p: &Point| {
        let (x, reach) = (add_scaled(p.pos, p.normal, 0.5 * p.distance), -NEARER * p.distance);
        let has_shallower = |t: &u32| owners.iter().zip(all.iter()).any(|(owner, other)| owner == t && other.distance > p.distance);
        let is_nearer = |t: &u32| {
            let corners = surface.triangle(*t);
            let normal = surface.normal(*t, &corners);
            let height = dot(normal, sub(x, corners[0]));
            // Rounding of poses in single precision.
            let touches = height.abs() <= 1e-7 * size;
            (touches || height < 0.0 && has_shallower(t))
                && TURNED.contains(&dot(normal, p.normal))
                && distance(&corners, normal, x) < reach
        };
        p.distance >= -SHALLOW * size || !triangles.iter().any(is_nearer)
    };
    is_own.clear();
    is_own.extend(all.iter().map(belongs));
    if is_own.contains(&true) {
        let mut own = is_own.iter();
        all.retain(|_| own.next() == Some(&true));
    }
}

/// Distance of the point `x` from a triangle with this unit normal, m.
fn distance(corners: &[V; 3], normal: V, x: V) -> f64 {
    if is_over(corners, normal, x) {
        return dot(normal, sub(x, corners[0])).abs();
    }
    (0..3).map(|k| from_segment(x, corners[k], corners[(k + 1) % 3])).fold(f64::INFINITY, f64::min)
}

/// Distance of the point `x` from the segment between `a` and `b`, m.
fn from_segment(x: V, a: V, b: V) -> f64 {
    let (edge, arm) = (sub(b, a), sub(x, a));
    norm(add_scaled(arm, edge, -(dot(arm, edge) / dot(edge, edge)).clamp(0.0, 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]

        /// The general search finds the same contact points of a ball as the closed form, up to rounding.
        #[test]
        fn a_ball_touches_as_any_shape_does(
            heights in prop::collection::vec(0.0..0.3f64, 16), level in prop::bool::ANY, cell in 0..9usize, upper in 0..2usize,
            radius in 0.01..0.4f64, at in (-1.5..1.5f64, -1.5..1.5f64, -0.3..0.7f64),
        ) {
            let heights = if level { vec![0.1; 16] } else { heights };
            let surface = Surface::Grid(Grid::new([4, 4], [1.5; 2], heights, 1.0));
            let (t, shape) = (2 * cell + upper, ConvexShape::Sphere { radius });
            let facet = surface.facet(t);
            let triangle = ConvexShape::Triangle(facet.corners);
            let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
            let pair = Pair::between(&triangle, &shape, [at.0, at.1, at.2], identity);
            let (height, max_distance) = (pair.separation(facet.normal), 0.1);
            if height - radius > max_distance {
                return Ok(());
            }
            let (mut own, mut any) = (Manifold::default(), Manifold::default());
            let ball = Ball { facet: &facet, pair: &pair, height, radius, max_distance };
            let Surface::Grid(grid) = &surface else { unreachable!("made above") };
            let left = ball.touch(Some(|p: V| grid.is_below(p)), |at, p, d| surface.is_nearest(t, &facet, at, p, d), &mut own);
            let left_any = touch_any(&surface, t, &facet, &pair, height, SearchLimits::from(max_distance).reach(), &mut any, &mut Workspace::default());
            match left {
                TriangleTest::Unclear => return Ok(()),
                TriangleTest::Complete => prop_assert!(left_any.is_none()),
                TriangleTest::LeftToNeighbour(facing) => {
                    prop_assert!((facing.found.separation - left_any.unwrap().found.separation).abs() < 1e-12);
                }
            }
            prop_assert_eq!(own.points.len(), any.points.len());
            for (a, b) in own.points.iter().zip(&any.points) {
                prop_assert_eq!(a.feature, b.feature);
                // The normal of the search errs by the rounding of positions over the distance.
                prop_assert!((a.distance - b.distance).abs() < 1e-12 && norm(sub(a.pos, b.pos)) < 1e-9 && norm(sub(a.normal, b.normal)) < 1e-9);
            }
        }
    }
}
