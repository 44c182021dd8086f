//! Surfaces of triangles: concave meshes and height fields.
//!
//! A surface is solid behind its triangles (below them, for a height field): a contact never pulls a shape through. What is nearest to a
//! shape is found triangle by triangle, and the nearest point of one triangle is nearest of the surface around it only if no neighbour
//! comes nearer: with d from the point p to the shape and u along any way on the surface that leaves p,
//!
//! ```text
//! d . u <= 0.
//! ```
//!
//! Inside a triangle d is its normal; at an edge these d are between the normals of the two triangles that share it, at a corner they are
//! the cone of those around it (its Gauss image, and the shape is in its Voronoi region: Lin & Canny 1991). Where the surface does not
//! bulge there are none. What is nearest in another direction is a matter of the neighbour's: taken for a contact, it would be a tilted
//! plane that nothing is behind, and brakes what glides by. Of such a triangle only corners of the shape count that are over it, with its
//! own normal. The outer edges of a surface are free on their open side.

use std::ops::Range;

use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::Vector;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};

use crate::approach::Approach;
use crate::ball::{Ball, Touch, ball_over};
use crate::facet::{FLAT, Facet, Outline, PARALLEL};
use crate::facing::{Facing, Separation};
use crate::linear_algebra::*;
use crate::manifold::{LEVEL, Manifold, Point, VERTICES, reduce_points};
use crate::mesh_heights::{MeshHeights, cells_between};
use crate::pair::Pair;
use crate::reach::Reach;
use crate::room::Room;
use crate::round::{ends, is_over, may_touch, nearest_of_triangle};
use crate::separation::{self};
use crate::shape::ConvexShape;
use crate::shape::triangle_normal;
use crate::vectors::{Pose, V};
use crate::vectors::{furthest, neg, unit_or};

/// Points that a convex shape and a surface can have.
pub const MAX_SURFACE_POINTS: usize = 16;

/// Depth, in sizes of the pair, up to which a point belongs to the triangle that it is under. It saves the search for a nearer one:
/// contacts at rest are 1e-4 deep at the most.
const SHALLOW: f64 = 1e-3;

/// Distance from another triangle, relative to the depth, below which a deep point is that one's. A peg that overlaps the wall of its hole
/// by micrometres is centimetres under the face around the hole.
const NEARER: f64 = 0.5;

/// Cosines between the normals of two triangles of which one may take the other's points: they are not of one face, and not the two sides
/// of a sheet.
const TURNED: Range<f64> = -0.5..0.99;

/// A surface of triangles in its own frame, m.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "a model has a few, behind pointers")]
pub enum Surface {
    /// A mesh.
    Mesh(MeshSurface),
    /// A height field.
    Grid(Grid),
}

/// The triangles of a mesh, and who is beside whom.
#[derive(Clone, Debug)]
pub struct MeshSurface {
    vertices: Vec<V>,
    faces: Vec<[u32; 3]>,
    /// Unit normal of every triangle.
    normals: Vec<V>,
    /// Across the edge that leaves corner k of a triangle: the neighbour's third vertex; of several neighbours that of the one that rises
    /// most.
    across: Vec<[Option<u32>; 3]>,
    /// Vertices that share an edge with each: those of vertex v are in `around[first[v]..first[v + 1]]`.
    around: Vec<u32>,
    first: Vec<u32>,
    tree: Bvh,
    heights: MeshHeights,
    /// Least and greatest coordinates, m.
    extent: [V; 2],
}

/// Heights over a regular grid.
#[derive(Clone, Debug)]
pub struct Grid {
    /// Points along y and x.
    pub shape: [usize; 2],
    /// Half of the extent along x and y, m.
    pub half: [f64; 2],
    /// Row by row, x fastest, m.
    pub elevation: Vec<f64>,
    /// Shapes further below are not pushed up, m.
    pub base: f64,
    highest: f64,
    /// Coordinates x of the columns and y of the rows, m.
    places: [Vec<f64>; 2],
}

/// Heights of a surface below a disc.
#[derive(Clone, Copy, Debug)]
pub struct Under {
    /// Greatest height of the cells there, m; minus infinity outside the surface.
    pub highest: f64,
    /// Whether these cells and their neighbours have one height. Every contact normal is then vertical.
    pub level: bool,
}

impl MeshSurface {
    /// Triangles without area are left out.
    pub fn new(vertices: &[V], faces: &[[u32; 3]]) -> Self {
        // Vertices at one place are one, whatever the file says.
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
            // The other side of a sheet is no neighbour.
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

    /// Corners of triangle `t`.
    pub(super) fn triangle(&self, t: u32) -> [V; 3] {
        self.faces[t as usize].map(|v| self.vertices[v as usize])
    }

    /// Least and greatest coordinates, m.
    pub(super) fn extent(&self) -> [V; 2] {
        self.extent
    }

    /// Boxes about the triangles.
    pub(super) fn tree(&self) -> &Bvh {
        &self.tree
    }
}

/// The angle by which a neighbour with the third corner `p` rises from a triangle across the edge that leaves its first corner.
fn rise(corners: &[V; 3], p: V) -> f64 {
    let [a, b, _] = *corners;
    let n = triangle_normal(corners);
    let d = sub(p, a);
    dot(n, d).atan2(dot(unit_or(cross(sub(b, a), n), [0.0; 3]), d))
}

/// The box about points.
pub(super) fn bounds(points: &[V]) -> Aabb {
    let fold = |pick: fn(f64, f64) -> f64, k: usize| points.iter().map(|p| p[k]).reduce(pick).unwrap_or(0.0);
    let corner = |pick: fn(f64, f64) -> f64| Vector::new(fold(pick, 0), fold(pick, 1), fold(pick, 2));
    Aabb::new(corner(f64::min), corner(f64::max))
}

impl Grid {
    /// Heights `elevation` (row by row, x fastest, m) of `shape` points along y and x, over a rectangle of the half sizes `half` along x
    /// and y, m.
    pub fn new(shape: [usize; 2], half: [f64; 2], elevation: Vec<f64>, base: f64) -> Self {
        let highest = elevation.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let places = [0, 1].map(|k| {
            let n = shape[1 - k];
            (0..n).map(|i| -half[k] + 2.0 * half[k] * i as f64 / (n - 1) as f64).collect()
        });
        Self { shape, half, elevation, base, highest, places }
    }

    /// Greatest height, m.
    #[inline]
    pub fn highest(&self) -> f64 {
        self.highest
    }

    fn vertex(&self, c: usize, r: usize) -> V {
        [self.places[0][c], self.places[1][r], self.elevation[r * self.shape[1] + c]]
    }

    fn near(&self, c: Option<usize>, r: Option<usize>) -> Option<V> {
        let (c, r) = (c?, r?);
        (c < self.shape[1] && r < self.shape[0]).then(|| self.vertex(c, r))
    }

    /// Corners of triangle `t`.
    fn triangle(&self, t: u32) -> [V; 3] {
        let (cell, upper) = (t as usize / 2, t % 2 == 1);
        let (r, c) = (cell / (self.shape[1] - 1), cell % (self.shape[1] - 1));
        let at = |dc: usize, dr: usize| self.vertex(c + dc, r + dr);
        if upper { [at(0, 0), at(1, 1), at(0, 1)] } else { [at(0, 0), at(1, 0), at(1, 1)] }
    }

    /// Triangle `t`: two in every cell, parted by the diagonal from its least corner, as in MuJoCo's `mjc_ConvexHField`.
    fn facet(&self, t: usize) -> Facet {
        let (cell, upper) = (t / 2, t % 2 == 1);
        let (r, c) = (cell / (self.shape[1] - 1), cell % (self.shape[1] - 1));
        let at = |dc: usize, dr: usize| self.vertex(c + dc, r + dr);
        let (corners, third) = if upper {
            let third = [Some(at(1, 0)), self.near(Some(c + 1), Some(r + 2)), self.near(c.checked_sub(1), Some(r))];
            ([at(0, 0), at(1, 1), at(0, 1)], third)
        } else {
            let third = [self.near(Some(c), r.checked_sub(1)), self.near(Some(c + 2), Some(r + 1)), Some(at(0, 1))];
            ([at(0, 0), at(1, 0), at(1, 1)], third)
        };
        Facet::new(corners, triangle_normal(&corners), third)
    }

    /// The points that share an edge with corner `k` of triangle `t`.
    fn around(&self, t: usize, k: usize) -> impl Iterator<Item = V> + '_ {
        let cell = t / 2;
        let (r, c) = (cell / (self.shape[1] - 1), cell % (self.shape[1] - 1));
        let (dc, dr) = if t % 2 == 1 { [(0, 0), (1, 1), (0, 1)][k] } else { [(0, 0), (1, 0), (1, 1)][k] };
        let (c, r) = (c + dc, r + dr);
        let beside = [(-1, -1), (0, -1), (1, 0), (1, 1), (0, 1), (-1, 0)];
        beside.into_iter().filter_map(move |(x, y)| self.near(c.checked_add_signed(x), r.checked_add_signed(y)))
    }

    /// Columns (k = 0) or rows (k = 1) of cells between two places along x or y.
    fn cells(&self, k: usize, low: f64, high: f64) -> Range<usize> {
        let count = self.shape[1 - k] - 1;
        let cell = 2.0 * self.half[k] / count as f64;
        cells_between([low, high].map(|x| (x + self.half[k]) / cell), count)
    }

    /// Whether a point is below the surface; beside the grid, below the point of its border that is nearest.
    fn holds(&self, p: V) -> bool {
        // Along x and y, in cells.
        let at = [0, 1].map(|k| {
            let cells = self.shape[1 - k] - 1;
            ((p[k] + self.half[k]) / (2.0 * self.half[k])).clamp(0.0, 1.0) * cells as f64
        });
        p[2] <= self.height(at)
    }

    /// Whether a point is in the ground that is over the base.
    pub(super) fn is_inside(&self, p: V) -> bool {
        p[0].abs() <= self.half[0] && p[1].abs() <= self.half[1] && p[2] >= -self.base && self.holds(p)
    }

    /// Height at a place along x and y in cells from the least corner, within the grid, m.
    pub(super) fn height(&self, at: [f64; 2]) -> f64 {
        // The cell, and how far across it.
        let [(c, x), (r, y)] = [0, 1].map(|k| {
            let first = (at[k] as usize).min(self.shape[1 - k] - 2);
            (first, at[k] - first as f64)
        });
        let height = |dc: usize, dr: usize| self.elevation[(r + dr) * self.shape[1] + c + dc];
        let beside = if x > y { height(1, 0) } else { height(0, 1) };
        let (first, last) = (x.max(y), x.min(y));
        (1.0 - first) * height(0, 0) + (first - last) * beside + last * height(1, 1)
    }

    /// Heights of the grid below a horizontal disc.
    fn under_disc(&self, [x, y]: [f64; 2], radius: f64) -> Under {
        let [rows, columns] = self.shape;
        let (c, r) = (self.cells(0, x - radius, x + radius), self.cells(1, y - radius, y + radius));
        let mut highest = f64::NEG_INFINITY;
        if c.is_empty() || r.is_empty() {
            return Under { highest, level: true };
        }
        let row = |row: usize, columns_of: Range<usize>| &self.elevation[row * columns + columns_of.start..row * columns + columns_of.end];
        for height in (r.start..=r.end).flat_map(|k| row(k, c.start..c.end + 1)) {
            highest = highest.max(*height);
        }
        // Neighbouring cells show whether an edge falls away; at the border of the grid it does.
        let level = c.start > 0
            && r.start > 0
            && c.end < columns - 1
            && r.end < rows - 1
            && (r.start - 1..=r.end + 1).all(|k| row(k, c.start - 1..c.end + 2).iter().all(|height| *height == highest));
        Under { highest, level }
    }

    /// Triangles of the cells under a box.
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
    /// Corners of triangle `t`.
    pub(super) fn triangle(&self, t: u32) -> [V; 3] {
        match self {
            Self::Mesh(m) => m.triangle(t),
            Self::Grid(g) => g.triangle(t),
        }
    }

    /// Unit normal of triangle `t`, whose corners are `corners`.
    fn normal(&self, t: u32, corners: &[V; 3]) -> V {
        match self {
            Self::Mesh(m) => m.normals[t as usize],
            Self::Grid(_) => triangle_normal(corners),
        }
    }

    fn facet(&self, t: usize) -> Facet {
        match self {
            Self::Mesh(m) => {
                let at = |v: u32| m.vertices[v as usize];
                Facet::new(m.faces[t].map(at), m.normals[t], m.across[t].map(|v| v.map(at)))
            }
            Self::Grid(g) => g.facet(t),
        }
    }

    /// Whether triangle `t` has an edge without neighbour (mesh), or is in a cell at the border (grid).
    fn is_at_border(&self, t: u32) -> bool {
        match self {
            Self::Mesh(m) => m.across[t as usize].iter().any(Option::is_none),
            Self::Grid(g) => {
                let (cell, [rows, columns]) = (t as usize / 2, g.shape);
                let (r, c) = (cell / (columns - 1), cell % (columns - 1));
                r == 0 || c == 0 || r == rows - 2 || c == columns - 2
            }
        }
    }

    /// Visits corners of the neighbours at a part of triangle `t`: all ways on the surface that leave the part, but along the triangle
    /// itself, are between the ways to these. Ends where `visit` says false, and returns that.
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

    /// Whether a point over triangle `t` stays over it, or over neighbours that do not fall away from it, if it moves `sideways` (m).
    fn keeps_over(&self, t: u32, corners: &[V; 3], normal: V, point: V, sideways: f64) -> bool {
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
            // Beyond the neighbour's other edges there may be lower triangles. A neighbour that overhangs is not beyond the edge.
            let facet = facet.get_or_insert_with(|| self.facet(t as usize));
            let is_far_from_others = |third: V| {
                let third = add_scaled(third, normal, -dot(normal, sub(third, a)));
                dot(outwards, sub(third, a)) > 0.0 && from_segment(foot, a, third).min(from_segment(foot, third, b)) > sideways
            };
            !facet.bulges[k] && facet.across[k].is_some_and(is_far_from_others)
        })
    }

    /// Whether no neighbour at the part of triangle `t` that `p` is a point of is nearer to what is in the direction `d` (unit) from there.
    fn is_nearest(&self, t: usize, facet: &Facet, at: &Outline, p: V, d: V) -> bool {
        self.all_beside(t, facet, at, |w| {
            let u = sub(w, p);
            dot(d, u) <= FLAT * norm(u)
        })
    }

    /// Axis of the surface's frame along which heights are measured: z of a height field, and of a mesh the axis along which it is
    /// shortest.
    pub fn up_axis(&self) -> usize {
        match self {
            Self::Mesh(m) => m.heights.up_axis(),
            Self::Grid(_) => 2,
        }
    }

    /// Greatest height, m.
    pub fn highest(&self) -> f64 {
        match self {
            Self::Mesh(m) => m.extent[1][self.up_axis()],
            Self::Grid(g) => g.highest,
        }
    }

    /// Heights of the surface below a disc about the point `at` in the surface's frame, across [`Surface::up_axis`].
    pub fn under_disc(&self, at: V, radius: f64) -> Under {
        match self {
            Self::Mesh(m) => Under { highest: m.heights.highest_in(&at.map(|x| x - radius), &at.map(|x| x + radius)), level: false },
            Self::Grid(g) => g.under_disc([at[0], at[1]], radius),
        }
    }

    /// Triangles in the box from `low` to `high`, ascending, and others near it.
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

/// Finds the contact points of a surface and a convex shape that are at most `reach.prediction` (m) apart: at most [`MAX_SURFACE_POINTS`],
/// normals from the surface.
///
/// If the approach of the shape is known, points that do not count within the step may be absent. The normal of a contact at an edge or
/// corner is a positive combination of the normals of the triangles there. The contact therefore closes by at most the same combination of
/// the approaches to these triangles. It counts only if a contact with one of the triangles counts. At a border this need not hold.
pub fn collide_surface(
    a: &Surface,
    pose_a: &Pose,
    b: &ConvexShape,
    pose_b: &Pose,
    reach: impl Into<Reach>,
    out: &mut Manifold,
    room: &mut Room,
) {
    let Reach { prediction, approach, .. } = reach.into();
    out.clear();
    let nothing = ConvexShape::Sphere { radius: 0.0 };
    let whole = Pair::new(&nothing, pose_a, b, pose_b);
    if !whole.is_finite() {
        return;
    }
    let reach = prediction + b.radius();
    let core = ends(&whole);
    let nearer = approach.filter(|_| matches!(a, Surface::Mesh(_)));
    let [low, high] = search_box(&whole, core.as_deref(), reach, nearer);
    let mut triangles = std::mem::take(&mut room.triangles);
    a.candidates(low, high, &mut triangles);
    let mut culled = nearer.is_some();
    room.all.clear();
    room.owners.clear();
    // Triangle with the smallest separation among those whose nearest point belongs to a neighbour.
    let mut left: Option<(u32, Facing)> = None;
    for &t in &triangles {
        let corners = a.triangle(t);
        let normal = a.normal(t, &corners);
        // Nothing is nearer than along the normal.
        let along = match &core {
            Some(ends) => ends.iter().map(|end| dot(normal, sub(*end, corners[0]))).reduce(f64::min).unwrap_or_default(),
            None => dot(normal, whole.support_b(neg(normal))) - dot(normal, corners[furthest(&corners, normal)]),
        };
        if along - b.radius() > prediction {
            continue;
        }
        if let Some(approach) = &approach
            && approach.keeps_along(normal, along - b.radius(), whole.size)
            && !a.is_at_border(t)
        {
            culled = true;
            continue;
        }
        if let Some(ends) = &core {
            // Most triangles are beside a ball or capsule, and most balls are over one.
            if !may_touch(&corners, normal, ends, reach) {
                continue;
            }
            if let [centre] = ends[..] {
                if along > 0.0 && is_over(&corners, normal, centre) {
                    let stays_over_face =
                        approach.is_some_and(|approach| a.keeps_over(t, &corners, normal, centre, approach.sideways(normal)));
                    room.all.push(Point { feature: name(t, 0), stays_over_face, ..ball_over(normal, centre, along, b.radius()) });
                    room.owners.push(t);
                    continue;
                }
                // Behind a wall of a mesh, or too far from the outline.
                let mut is_far = || {
                    let apart = sub(centre, nearest_of_triangle(&corners, centre));
                    let (distance, n) = (norm(apart), unit_or(apart, normal));
                    if distance - b.radius() > prediction {
                        return true;
                    }
                    let keeps = approach.is_some_and(|a| a.keeps_along(n, distance - b.radius(), whole.size));
                    culled |= keeps;
                    keeps
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
        if let Some(facing) = touch(a, t as usize, &facet, &pair, along, prediction, out, room)
            && left.as_ref().is_none_or(|(_, other)| facing.found.separation < other.found.separation)
        {
            left = Some((t, facing));
        }
        room.all.extend(out.points.drain(..).map(|p| Point { feature: name(t, p.feature), ..p }));
        room.owners.resize(room.all.len(), t);
    }
    if room.all.iter().any(|p| p.distance < -SHALLOW * whole.size) {
        drop_nearer_elsewhere(a, &triangles, whole.size, room);
    }
    room.triangles = triangles;
    if culled && left.is_some() && room.all.is_empty() {
        // The neighbour may be a triangle that was left out.
        return collide_surface(a, pose_a, b, pose_b, prediction, out, room);
    }
    // If no triangle accepted a point, rounding rejected the nearest one.
    if let Some((t, facing)) = left.filter(|_| room.all.is_empty()) {
        let triangle = ConvexShape::Triangle(a.facet(t as usize).corners);
        let pair = Pair::between(&triangle, b, whole.pos, whole.mat);
        room.clipper.manifold(&pair, &facing, prediction, out);
        room.all.extend(out.points.drain(..).map(|p| Point { feature: name(t, p.feature), ..p }));
    }
    reduce_points(&mut room.all, whole.size, MAX_SURFACE_POINTS, out);
    out.place(pose_a);
}

/// Least and greatest coordinates of the triangles that are within `reach` of the core of a shape, m, or whose contacts can count if its
/// `approach` is known.
///
/// A contact joins a point x of the surface and a point y of the shape, and y - x is a multiple of its normal. The box is at least that
/// of a shape at rest.
pub(super) fn search_box(whole: &Pair<'_>, core: Option<&[V]>, reach: f64, approach: Option<Approach>) -> [V; 2] {
    let [low, high] = whole.extent_b(core);
    let [against_axes, along_axes] = approach.map_or([[f64::INFINITY; 3]; 2], |approach| approach.max_components(whole.size));
    let reach = |most: f64| reach.min(whole.b.radius() + most);
    [array_of(|k| low[k] - reach(along_axes[k])), array_of(|k| high[k] + reach(against_axes[k]))]
}

/// The half space below the xy plane of `plane` and the vertices of a surface, as [`crate::collide_plane`].
pub(super) fn collide_plane_surface(plane: &Pose, surface: &Surface, pose: &Pose, prediction: f64, out: &mut Manifold, room: &mut Room) {
    out.clear();
    let nothing = ConvexShape::Sphere { radius: 0.0 };
    if let Surface::Mesh(mesh) = surface {
        room.clipper.cloud(&Pair::new(&nothing, plane, &nothing, pose), &mesh.vertices, prediction, out);
        out.place(plane);
    }
}

/// Identifier of a feature of the shape in contact with a triangle. That of a vertex is the same for all triangles; that of an edge or face
/// includes the triangle.
fn name(triangle: u32, feature: u32) -> u32 {
    if feature < VERTICES { feature } else { crate::manifold::mix(triangle, feature) }
}

/// The points of a triangle; the direction of what is nearest, where that is left to its neighbours. `along` is the separation along the
/// normal of the triangle, m.
#[expect(clippy::too_many_arguments, reason = "a triangle, a shape, and where points go")]
fn touch(
    surface: &Surface,
    t: usize,
    facet: &Facet,
    pair: &Pair<'_>,
    along: f64,
    prediction: f64,
    out: &mut Manifold,
    room: &mut Room,
) -> Option<Facing> {
    if let ConvexShape::Sphere { radius } = *pair.b {
        let ball = Ball { facet, pair, height: along, radius, prediction };
        let grid = if let Surface::Grid(grid) = surface { Some(grid) } else { None };
        let holds = grid.map(|grid| |p: V| grid.holds(p));
        match ball.touch(holds, |at, p, d| surface.is_nearest(t, facet, at, p, d), out) {
            Touch::Found => return None,
            Touch::Left(facing) => return Some(facing),
            Touch::Unknown => {}
        }
    }
    touch_any(surface, t, facet, pair, along, prediction, out, room)
}

/// [`touch`] for any shape.
#[expect(clippy::too_many_arguments, reason = "a triangle, a shape, and where points go")]
fn touch_any(
    surface: &Surface,
    t: usize,
    facet: &Facet,
    pair: &Pair<'_>,
    along: f64,
    prediction: f64,
    out: &mut Manifold,
    room: &mut Room,
) -> Option<Facing> {
    let normal = facet.normal;
    let flat = Separation { normal, separation: along, points: [facet.corners[0]; 2] };
    let over = |room: &mut Room, out: &mut Manifold| {
        let rises = if along < 0.0 { facet.rises() } else { [0.0; 3] };
        if facet.may_be_under(pair, &rises) {
            room.clipper.over_facet(pair, &Facing::new(pair, flat), &facet.bulges, &rises, prediction, out);
        }
    };
    let behind = dot(normal, pair.apart) <= 0.0;
    if behind && let Surface::Grid(grid) = surface {
        // Inside a height field, or outside again beyond a sharp crest.
        over(room, out);
        if !grid.holds(add(pair.apart, pair.a.centre())) {
            out.points.retain(|p| p.distance >= 0.0 || grid.holds(add_scaled(p.pos, p.normal, 0.5 * p.distance)));
        }
        return None;
    }
    if behind && dot(normal, sub(pair.support_b(normal), facet.corners[0])) <= 0.0 {
        // Whole on the other side of a wall of a mesh.
        return None;
    }
    // Of a mesh, a shape whose centre is behind the face, beyond a sharp edge of it, may be nearest to its outline; what is over it is
    // behind.
    let over = |room: &mut Room, out: &mut Manifold| {
        if !behind {
            over(room, out);
        }
    };
    if facet.bulges == [false; 3] {
        // Nothing is nearest at its outline that is not the neighbours' too.
        over(room, out);
        return None;
    }
    let facing = separation::nearest(pair, &prediction.into(), &mut room.polytope);
    let found = &facing.found;
    if found.separation - pair.thickness() > prediction {
        return None;
    }
    let cos = dot(found.normal, normal);
    if behind && (cos <= 0.0 || found.separation <= 0.0) {
        return None;
    }
    if 1.0 - cos <= PARALLEL {
        over(room, out);
        return None;
    }
    let (at, p) = facet.furthest(found.normal);
    if cos > 0.0 && !matches!(at, Outline::Inside) && surface.is_nearest(t, facet, &at, p, found.normal) {
        room.clipper.manifold(pair, &facing, prediction, out);
        if out.is_lone() && 1.0 - cos <= LEVEL {
            // A shape that leans a little is as near at the other corners of what it has over the triangle, or will be soon.
            over(room, out);
        }
        return None;
    }
    over(room, out);
    (out.points.is_empty() && cos > 0.0).then_some(facing)
}

/// Drops the points that are deep under their triangle and much nearer to another of the `triangles`, unless that leaves none.
///
/// A point behind the other triangle is dropped only if that triangle has a shallower point. Otherwise, at a sharp ridge, the deep point is
/// the only contact there, and stays.
#[cold]
fn drop_nearer_elsewhere(surface: &Surface, triangles: &[u32], size: f64, room: &mut Room) {
    let Room { all, owners, is_own, .. } = room;
    let belongs = |p: &Point| {
        let (x, reach) = (add_scaled(p.pos, p.normal, 0.5 * p.distance), -NEARER * p.distance);
        let has_shallower = |t: &u32| owners.iter().zip(all.iter()).any(|(owner, other)| owner == t && other.distance > p.distance);
        let is_nearer = |t: &u32| {
            let corners = surface.triangle(*t);
            let normal = surface.normal(*t, &corners);
            let height = dot(normal, sub(x, corners[0]));
            // Up to the rounding of poses in 32 bits.
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

/// Distance of a point from a triangle.
fn distance(corners: &[V; 3], normal: V, x: V) -> f64 {
    if is_over(corners, normal, x) {
        return dot(normal, sub(x, corners[0])).abs();
    }
    (0..3).map(|k| from_segment(x, corners[k], corners[(k + 1) % 3])).fold(f64::INFINITY, f64::min)
}

/// Distance of a point from the segment from `a` to `b`.
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

        /// The search finds the same points, up to its rounding.
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
            let (height, prediction) = (pair.separation(facet.normal), 0.1);
            if height - radius > prediction {
                return Ok(());
            }
            let (mut own, mut any) = (Manifold::default(), Manifold::default());
            let ball = Ball { facet: &facet, pair: &pair, height, radius, prediction };
            let Surface::Grid(grid) = &surface else { unreachable!("made above") };
            let left = ball.touch(Some(|p: V| grid.holds(p)), |at, p, d| surface.is_nearest(t, &facet, at, p, d), &mut own);
            let left_any = touch_any(&surface, t, &facet, &pair, height, prediction, &mut any, &mut Room::default());
            match left {
                Touch::Unknown => return Ok(()),
                Touch::Found => prop_assert!(left_any.is_none()),
                Touch::Left(facing) => {
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
