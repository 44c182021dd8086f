//! Surfaces of triangles: concave meshes and height fields.
//!
//! A surface is solid behind its triangles (below them, for a height field): a contact never pulls a shape through. What a shape touches first
//! may be an edge or corner between triangles; where the surface does not bulge there, the edge is inside the surface's outline, and its normal would
//! be felt as a bump. So the normal at such a feature is that of the triangle, and the contact exists only where the shape is over the triangle: its
//! neighbour has the rest.

use std::ops::Range;

use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::Vector;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};

use super::manifold::{Manifold, Point, VERTICES, thin};
use super::pair::Pair;
use super::separation::{self, Facing, Separation};
use super::shape::triangle_normal;
use super::{ConvexShape, Pose, Room, V};
use crate::spatial::*;

/// Points that a convex shape and a surface can have.
pub const MAX_SURFACE_POINTS: usize = 16;

/// An edge bulges where the neighbour falls away by more than this share of its size: vertices of mesh files are in single precision.
const FLAT: f64 = 1e-6;

/// A surface of triangles in its own frame, m.
#[derive(Clone, Debug)]
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
    /// Across the edge that leaves corner k of a triangle: the neighbour's third vertex.
    across: Vec<[Option<u32>; 3]>,
    tree: Bvh,
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
}

/// What a grid is like under a shape.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Under {
    /// Greatest height of the cells there, m; minus infinity off the grid.
    pub(crate) highest: f64,
    /// Whether they are level and no neighbour falls away: every contact is upright then.
    pub(crate) level: bool,
}

/// A triangle, and where the surface bulges at the edges that leave its corners (an outer edge does).
struct Facet {
    corners: [V; 3],
    bulges: [bool; 3],
}

impl MeshSurface {
    /// Triangles without area are left out.
    pub fn new(vertices: &[V], faces: &[[u32; 3]]) -> Self {
        let corners = |f: &[u32; 3]| f.map(|v| vertices[v as usize]);
        let has_area = |f: &&[u32; 3]| {
            let [a, b, c] = corners(f);
            norm(cross(sub(b, a), sub(c, a))) > 0.0
        };
        let faces: Vec<[u32; 3]> = faces.iter().filter(has_area).copied().collect();
        let mut third = std::collections::BTreeMap::new();
        // Vertices at one place are one, whatever the file says.
        let place = |v: u32| vertices[v as usize].map(|x| (x + 0.0).to_bits());
        for f in &faces {
            (0..3).for_each(|k| {
                third.insert((place(f[k]), place(f[(k + 1) % 3])), f[(k + 2) % 3]);
            });
        }
        let neighbour = |f: &[u32; 3], k: usize| third.get(&(place(f[(k + 1) % 3]), place(f[k]))).copied();
        let across = faces.iter().map(|f| std::array::from_fn(|k| neighbour(f, k))).collect();
        let boxes: Vec<Aabb> = faces.iter().map(|f| bounds(&corners(f))).collect();
        let tree = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
        Self { vertices: vertices.to_vec(), faces, across, tree }
    }
}

fn bounds(points: &[V]) -> Aabb {
    let fold = |pick: fn(f64, f64) -> f64, k: usize| points.iter().map(|p| p[k]).reduce(pick).unwrap_or(0.0);
    let corner = |pick: fn(f64, f64) -> f64| Vector::new(fold(pick, 0), fold(pick, 1), fold(pick, 2));
    Aabb::new(corner(f64::min), corner(f64::max))
}

impl Grid {
    /// Heights `elevation` (row by row, x fastest, m) of `shape` points along y and x, over a rectangle of the half sizes `half` along x and y, m.
    pub fn new(shape: [usize; 2], half: [f64; 2], elevation: Vec<f64>, base: f64) -> Self {
        let highest = elevation.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Self { shape, half, elevation, base, highest }
    }

    /// Greatest height, m.
    pub(crate) fn highest(&self) -> f64 {
        self.highest
    }

    fn vertex(&self, c: usize, r: usize) -> V {
        let at = |k: usize, n: usize, half: f64| -half + 2.0 * half * k as f64 / (n - 1) as f64;
        let [rows, columns] = self.shape;
        [at(c, columns, self.half[0]), at(r, rows, self.half[1]), self.elevation[r * columns + c]]
    }

    fn near(&self, c: Option<usize>, r: Option<usize>) -> Option<V> {
        let (c, r) = (c?, r?);
        (c < self.shape[1] && r < self.shape[0]).then(|| self.vertex(c, r))
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
        Facet::new(corners, third)
    }

    /// Columns (k = 0) or rows (k = 1) of cells between two places along x or y.
    fn cells(&self, k: usize, low: f64, high: f64) -> Range<usize> {
        let n = self.shape[1 - k];
        let cell = 2.0 * self.half[k] / (n - 1) as f64;
        // Saturating: what is off the grid has an empty range.
        let first = ((low + self.half[k]) / cell).floor().max(0.0) as usize;
        let last = ((high + self.half[k]) / cell).floor();
        first..if last < 0.0 { 0 } else { (last as usize + 1).min(n - 1) }
    }

    /// What is under a disc.
    pub(crate) fn under_disc(&self, [x, y]: [f64; 2], radius: f64) -> Under {
        let [rows, columns] = self.shape;
        let (c, r) = (self.cells(0, x - radius, x + radius), self.cells(1, y - radius, y + radius));
        let mut highest = f64::NEG_INFINITY;
        if c.is_empty() || r.is_empty() {
            return Under { highest, level: true };
        }
        // Cells beside them show whether an edge falls away; at the border of the grid it does.
        let mut level = c.start > 0 && r.start > 0 && c.end < columns - 1 && r.end < rows - 1;
        let first = self.elevation[r.start * columns + c.start];
        for row in r.start.saturating_sub(1)..=(r.end + 1).min(rows - 1) {
            for column in c.start.saturating_sub(1)..=(c.end + 1).min(columns - 1) {
                let height = self.elevation[row * columns + column];
                level &= height == first;
                if (c.start..=c.end).contains(&column) && (r.start..=r.end).contains(&row) {
                    highest = highest.max(height);
                }
            }
        }
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

impl Facet {
    fn new(corners: [V; 3], third: [Option<V>; 3]) -> Self {
        let n = triangle_normal(&corners);
        let bulges = std::array::from_fn(|k| {
            third[k].is_none_or(|p| {
                let d = sub(p, corners[k]);
                dot(n, d) < -FLAT * norm(d)
            })
        });
        Self { corners, bulges }
    }

    /// Of the edges and corners that a point of the triangle is on: whether any bulges, and whether any does not.
    fn outline_at(&self, p: V) -> (bool, bool) {
        let [a, b, c] = self.corners;
        let n = cross(sub(b, a), sub(c, a));
        let nn = dot(n, n);
        let (mut any, mut none) = (false, false);
        for k in 0..3 {
            let (q, r) = (self.corners[k], self.corners[(k + 1) % 3]);
            // Barycentric coordinate of the corner opposite to the edge.
            if dot(n, cross(sub(r, q), sub(p, q))) < 1e-9 * nn {
                any |= self.bulges[k];
                none |= !self.bulges[k];
            }
        }
        (any, none)
    }
}

impl Surface {
    fn facet(&self, t: usize) -> Facet {
        match self {
            Self::Mesh(m) => {
                let at = |v: u32| m.vertices[v as usize];
                Facet::new(m.faces[t].map(at), m.across[t].map(|v| v.map(at)))
            }
            Self::Grid(g) => g.facet(t),
        }
    }

    fn candidates(&self, low: V, high: V, out: &mut Vec<u32>) {
        out.clear();
        match self {
            Self::Mesh(m) => {
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

/// Finds the contact points of a surface and a convex shape that are within `prediction` (m) of each other: at most [`MAX_SURFACE_POINTS`],
/// normals from the surface.
pub fn collide_surface(a: &Surface, pose_a: &Pose, b: &ConvexShape, pose_b: &Pose, prediction: f64, out: &mut Manifold, room: &mut Room) {
    out.clear();
    let nothing = ConvexShape::Sphere { radius: 0.0 };
    let whole = Pair::new(&nothing, pose_a, b, pose_b);
    if !whole.is_finite() {
        return;
    }
    let reach = prediction + b.radius();
    let along = |k: usize, sign: f64| {
        let mut d = [0.0; 3];
        d[k] = sign;
        whole.support_b(d)[k] + sign * reach
    };
    let mut triangles = std::mem::take(&mut room.triangles);
    a.candidates([0, 1, 2].map(|k| along(k, -1.0)), [0, 1, 2].map(|k| along(k, 1.0)), &mut triangles);
    room.all.clear();
    for &t in &triangles {
        let facet = a.facet(t as usize);
        let triangle = ConvexShape::Triangle(facet.corners);
        let pair = Pair::between(&triangle, b, whole.pos, whole.mat);
        touch(&facet, &pair, matches!(a, Surface::Grid(_)), prediction, out, room);
        room.all.extend(out.points.drain(..).map(|p| Point { feature: name(t, p.feature), ..p }));
    }
    room.triangles = triangles;
    thin(&mut room.all, whole.size, MAX_SURFACE_POINTS, out);
    out.place(pose_a);
}

/// The half space below the xy plane of `plane` and the vertices of a surface, as [`super::collide_plane`].
pub(super) fn collide_plane_surface(plane: &Pose, surface: &Surface, pose: &Pose, prediction: f64, out: &mut Manifold, room: &mut Room) {
    out.clear();
    let nothing = ConvexShape::Sphere { radius: 0.0 };
    if let Surface::Mesh(mesh) = surface {
        room.clipper.cloud(&Pair::new(&nothing, plane, &nothing, pose), &mesh.vertices, prediction, out);
        out.place(plane);
    }
}

/// A vertex of the shape keeps its name from triangle to triangle, all else is named with the triangle.
fn name(triangle: u32, feature: u32) -> u32 {
    if feature < VERTICES { feature } else { super::manifold::mix(triangle, feature) }
}

/// The points of a triangle.
fn touch(facet: &Facet, pair: &Pair<'_>, upward: bool, prediction: f64, out: &mut Manifold, room: &mut Room) {
    let normal = triangle_normal(&facet.corners);
    let flat = Separation { normal, separation: pair.separation(normal), points: [facet.corners[0]; 2] };
    if flat.separation - pair.thickness() > prediction {
        return;
    }
    if dot(normal, pair.apart) <= 0.0 {
        // Behind the triangle: inside a height field, on the other side of a wall of a mesh.
        if upward {
            room.clipper.over_first(pair, &Facing::new(pair, flat), prediction, out);
        }
        return;
    }
    if facet.bulges == [false; 3] {
        // Every normal is the triangle's, whatever is nearest.
        room.clipper.over_first(pair, &Facing::new(pair, flat), prediction, out);
        return;
    }
    let facing = separation::nearest(pair, &prediction.into(), &mut room.polytope);
    let found = &facing.found;
    if found.separation - pair.thickness() > prediction {
        return;
    }
    let (bulges, level) = facet.outline_at(found.points[0]);
    let cos = dot(found.normal, normal);
    let own = bulges && cos > 0.0 && 1.0 - cos > 1e-12;
    if !own || level {
        // Only what is over the triangle: the neighbours have the rest.
        room.clipper.over_first(pair, &Facing::new(pair, flat), prediction, out);
    }
    if own && out.points.is_empty() {
        room.clipper.manifold(pair, &facing, prediction, out);
    }
}
