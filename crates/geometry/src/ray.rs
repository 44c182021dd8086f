//! Distances along rays to meshes and height fields, one ray at a time, in f64.
//!
//! The triangles of a mesh are in a tree of boxes. The test of a triangle is that of Woop, Benthin & Wald (2013). With it, no ray passes
//! between two triangles that share an edge. With tests that round each triangle separately (parry's, MuJoCo's), a ray can. Triangles have
//! two sides: a ray that starts inside a mesh hits the surface where it leaves.
//!
//! A height field needs no triangles. Along a ray, the height above the ground is linear between crossings of the grid's lines and the
//! cells' diagonals. The ray hits the ground where this height changes its sign. The field is solid from the ground to its base.

use parry3d_f64::bounding_volume::BoundingVolume;
use parry3d_f64::math::Vector;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use parry3d_f64::query::Ray;

use crate::hull::Hull;
use crate::linear_algebra::*;
use crate::surface::{Grid, Surface, bounds};
use crate::vectors::{Pose, V, extent, widest};

/// Enlargement of the triangles' bounding boxes, relative to the largest coordinate of the mesh. Rounding then does not exclude a triangle
/// that a ray touches.
const MARGIN: f64 = 1e-12;

/// Mesh or height field for distances along rays.
#[derive(Clone, Debug)]
pub struct RaySurface {
    /// Triangles or height field, in the surface's frame, m.
    form: Form,
    /// Centre and radius of a ball that contains the surface, m.
    ball: (V, f64),
}

/// Geometry of a [`RaySurface`].
#[derive(Clone, Debug)]
enum Form {
    /// Triangles, and the tree of their bounding boxes.
    Mesh(Vec<[V; 3]>, Bvh),
    /// Height field.
    Field(Grid),
}

impl RaySurface {
    /// Surface of a mesh. `vertices` are in m, and `faces` are triangles as vertex indices.
    pub fn mesh(vertices: &[V], faces: &[[u32; 3]]) -> Self {
        let triangles: Vec<[V; 3]> = faces.iter().map(|f| f.map(|v| vertices[v as usize])).collect();
        let extent = vertices.iter().flatten().fold(0.0, |most: f64, x| most.max(x.abs()));
        let boxes: Vec<_> = triangles.iter().map(|t| bounds(t).loosened(MARGIN * extent)).collect();
        let ball = ball_about(triangles.as_flattened());
        Self { form: Form::Mesh(triangles, Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes)), ball }
    }

    /// Surface of a convex hull.
    pub fn hull(hull: &Hull) -> Self {
        Self::mesh(hull.points(), hull.triangles())
    }

    /// Height field, which is solid down to its base.
    pub fn field(grid: Grid) -> Self {
        let [x, y] = grid.half;
        let ball = ball_about(&[[-x, -y, -grid.base], [x, y, grid.highest.max(-grid.base)]]);
        Self { form: Form::Field(grid), ball }
    }

    /// Centre, in the frame of the surface, and radius of a ball that contains the surface, m.
    #[inline]
    pub fn ball(&self) -> (V, f64) {
        self.ball
    }

    /// Distance along a ray to the surface, m; infinite without a hit.
    ///
    /// The ray starts at `origin`, m, and has the unit vector `direction`, both in the world frame. `pose` is the pose of the surface.
    pub fn distance(&self, pose: &Pose, origin: V, direction: V) -> f64 {
        let (o, d) = (rotate_back(&pose.mat, sub(origin, pose.pos)), rotate_back(&pose.mat, direction));
        // A ray with a number that is not finite hits nothing.
        if !o.iter().chain(&d).all(|x| x.is_finite()) {
            return f64::INFINITY;
        }
        match &self.form {
            Form::Mesh(triangles, tree) => {
                first_met(tree, o, d, f64::MAX, |t| triangles[t as usize]).map_or(f64::INFINITY, |(_, distance)| distance)
            }
            Form::Field(grid) => over_field(grid, o, d),
        }
    }
}

/// Number of times that the straight path from `p` to `q` crosses a surface; 2 stands for two or more. Both points are in the surface's
/// frame, m.
///
/// A single crossing from the inside of a mesh to the outside does not count.
pub(super) fn crossings(surface: &Surface, p: V, q: V) -> usize {
    let d = sub(q, p);
    let length = norm(d);
    if !(length > 0.0 && length.is_finite()) {
        return 0;
    }
    match surface {
        Surface::Grid(grid) => {
            let high = grid.highest;
            if p[2] > high && q[2] > high {
                return 0;
            }
            match [grid.is_inside(p), grid.is_inside(q)] {
                [false, false] if over_field(grid, p, scale(d, 1.0 / length)) <= length => 2,
                [true, true] | [false, false] => 0,
                _ => 1,
            }
        }
        Surface::Mesh(mesh) => {
            let first_met = |from: V, d: V| first_met(&mesh.tree, from, d, 1.0, |t| mesh.triangle(t));
            let Some((triangle, first)) = first_met(p, d) else { return 0 };
            // The first triangle from the other end is the last one on the path.
            let back = first_met(q, scale(d, -1.0)).map_or(1.0 - first, |(_, part)| part);
            let [a, b, c] = mesh.triangle(triangle);
            let leaves = dot(cross(sub(b, a), sub(c, a)), d) > 0.0;
            match first + back < 1.0 - 1e-9 {
                true => 2,
                // Contact forces push a shape out if it starts behind the surface.
                false => usize::from(!leaves),
            }
        }
    }
}

/// First triangle on the path from `from` to `from + most d`, and the parameter t at which the path meets it: the point `from + t d`.
/// `None` if the path meets none. `tree` has the bounding boxes of the triangles.
fn first_met(tree: &Bvh, from: V, d: V, most: f64, triangle: impl Fn(u32) -> [V; 3]) -> Option<(u32, f64)> {
    let sheared = Sheared::new(from, d)?;
    let [o, along] = [from, d].map(|p| Vector::new(p[0], p[1], p[2]));
    tree.cast_ray(&Ray::new(o, along), most, |t, _| sheared.meet(&triangle(t)).filter(|&part| part <= most))
}

/// Centre and radius of the ball around the bounding box of points, m.
fn ball_about(points: &[V]) -> (V, f64) {
    let [low, high] = extent(points.iter().copied());
    let centre = scale(add(low, high), 0.5);
    (centre, norm(sub(high, centre)))
}

/// Frame in which a ray is the third axis, for tests of triangles. Points are sheared along the ray.
struct Sheared {
    /// Start of the ray, m.
    origin: V,
    /// Order of the coordinate axes. The last one is that of the ray's largest component.
    axes: [usize; 3],
    /// First two components of the ray's direction relative to the largest one.
    slopes: [f64; 2],
    /// Reciprocal of the largest component of the ray's direction.
    scale: f64,
}

impl Sheared {
    /// Frame of the ray from `origin`, m, along `d`. `None` if `d` is 0.
    fn new(origin: V, d: V) -> Option<Self> {
        let k = widest(d);
        let axes = [(k + 1) % 3, (k + 2) % 3, k];
        let scale = 1.0 / d[k];
        scale.is_finite().then(|| Self { origin, axes, slopes: [d[axes[0]] / d[k], d[axes[1]] / d[k]], scale })
    }

    /// Distance along the ray to a triangle with these corners, in multiples of the length of the ray's direction vector. `None` if the ray
    /// misses the triangle.
    fn meet(&self, corners: &[V; 3]) -> Option<f64> {
        let [i, j, k] = self.axes;
        let [a, b, c] = corners.map(|p| {
            let q = sub(p, self.origin);
            [q[i] - self.slopes[0] * q[k], q[j] - self.slopes[1] * q[k], self.scale * q[k]]
        });
        // In the neighbouring triangle, `across` of the same edge has exactly the opposite value.
        let across = |p: V, q: V| p[0] * q[1] - p[1] * q[0];
        let [u, v, w] = [across(b, c), across(c, a), across(a, b)];
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let total = u + v + w;
        let t = (u * a[2] + v * b[2] + w * c[2]) / total;
        // A triangle parallel to the ray has no projected area. The ray hits its neighbours instead.
        (total != 0.0 && t >= 0.0).then_some(t)
    }
}

/// Distance from `o` along the unit vector `d` to a height field in its frame, m; infinite without a hit.
fn over_field(grid: &Grid, o: V, d: V) -> f64 {
    // Part of the ray inside the bounding box of the field.
    let box_ends = [[-grid.half[0], grid.half[0]], [-grid.half[1], grid.half[1]], [-grid.base, grid.highest]];
    let (mut enter, mut leave) = (0.0, f64::INFINITY);
    for (k, [low, high]) in box_ends.into_iter().enumerate() {
        if d[k] == 0.0 {
            if o[k] < low || o[k] > high {
                return f64::INFINITY;
            }
            continue;
        }
        let (a, b) = ((low - o[k]) / d[k], (high - o[k]) / d[k]);
        enter = f64::max(enter, a.min(b));
        leave = f64::min(leave, a.max(b));
    }
    if enter > leave || !leave.is_finite() {
        return f64::INFINITY;
    }
    // `s` is the distance from the start of this part, m. Coordinates across the grid are in cells.
    let start = add_scaled(o, d, enter);
    let cells = [grid.shape[1] - 1, grid.shape[0] - 1].map(|n| n as f64);
    let per_length = [0, 1].map(|k| cells[k] / (2.0 * grid.half[k]));
    let first = [0, 1].map(|k| ((start[k] + grid.half[k]) * per_length[k]).clamp(0.0, cells[k]));
    let rate = [0, 1].map(|k| d[k] * per_length[k]);
    let above = |s: f64| {
        let at = [0, 1].map(|k| (first[k] + rate[k] * s).clamp(0.0, cells[k]));
        start[2] + d[2] * s - grid.height(at)
    };
    let mut height = above(0.0);
    // The ray enters through a side of the field or its base.
    if enter > 0.0 && height <= 0.0 {
        return enter;
    }
    let length = leave - enter;
    let [mut x, mut y] = [0, 1].map(|k| Lines::new(first[k], rate[k]));
    let mut diagonal = Lines::new(first[0] - first[1], rate[0] - rate[1]);
    let mut s = 0.0;
    // Each iteration crosses at least one line.
    for _ in 0..2 * (grid.shape[0] + grid.shape[1]) + 4 {
        let next = x.next.min(y.next).min(diagonal.next).max(s).min(length);
        let there = above(next);
        if (height > 0.0) != (there > 0.0) {
            return enter + s + (next - s) * (height / (height - there));
        }
        if next >= length {
            break;
        }
        (s, height) = (next, there);
        [&mut x, &mut y, &mut diagonal].into_iter().for_each(|lines| lines.pass(s));
    }
    // A ray that starts inside leaves through a side or the base.
    if height <= 0.0 { leave } else { f64::INFINITY }
}

/// Crossings of a ray with the grid lines of one coordinate: places where the coordinate is a whole number.
struct Lines {
    /// Coordinate of the ray at its start.
    first: f64,
    /// Change of the ray's coordinate per metre of its length.
    rate: f64,
    /// Coordinate of the next grid line on the ray.
    line: f64,
    /// Distance along the ray to the next grid line, m; infinite if the ray is parallel to the lines.
    next: f64,
}

impl Lines {
    /// Crossings of a ray whose coordinate is `first` at its start and changes by `rate` per metre.
    fn new(first: f64, rate: f64) -> Self {
        let line = if rate > 0.0 { first.floor() + 1.0 } else { first.ceil() - 1.0 };
        let mut lines = Self { first, rate, line, next: f64::INFINITY };
        lines.place();
        lines
    }

    /// Computes the distance along the ray to the next grid line.
    fn place(&mut self) {
        self.next = if self.rate == 0.0 { f64::INFINITY } else { (self.line - self.first) / self.rate };
    }

    /// Advances to the following grid line, if the distance `s` along the ray, m, has reached the next one.
    fn pass(&mut self, s: f64) {
        if self.next <= s {
            self.line += 1f64.copysign(self.rate);
            self.place();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UPRIGHT: Pose = Pose { pos: [0.3, -0.2, 0.1], mat: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] };

    /// Pseudo-random number in -1..1.
    fn noise(seed: &mut u64) -> f64 {
        *seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (*seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn unit(d: V) -> V {
        scale(d, 1.0 / norm(d))
    }

    fn tetrahedron() -> (Vec<V>, Vec<[u32; 3]>) {
        let vertices = vec![[1.0, 0.1, -0.4], [-0.7, 0.9, -0.5], [-0.6, -0.8, -0.3], [0.1, 0.2, 1.1]];
        (vertices, vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    }

    /// A ray from inside a closed mesh hits the mesh in every direction, also at an edge or a corner, up to the rounding of its direction.
    #[test]
    fn no_ray_leaves_a_closed_mesh_between_its_triangles() {
        let (vertices, faces) = tetrahedron();
        let surface = RaySurface::mesh(&vertices, &faces);
        let mut seed = 1;
        for k in 0..30_000 {
            let (a, b) = (vertices[k % 4], vertices[(k + 1 + k / 4 % 3) % 4]);
            let share = 0.5 + 0.5 * noise(&mut seed);
            let aim = add_scaled(scale(a, 1.0 - share), b, share);
            let from = [0.02 * noise(&mut seed), 0.02 * noise(&mut seed), 0.02 * noise(&mut seed)];
            let way = sub(aim, from);
            let found = surface.distance(&UPRIGHT, add(UPRIGHT.pos, from), unit(way));
            // The hit is on the edge, up to the rounding of the direction.
            assert!((found - norm(way)).abs() < 1e-12, "{found} {}", norm(way));
            let back = surface.distance(&UPRIGHT, add(UPRIGHT.pos, add_scaled(from, way, 1.5)), unit(way));
            assert_eq!(back, f64::INFINITY);
        }
    }

    fn hills() -> Grid {
        let mut seed = 7;
        Grid::new([5, 8], [2.0, 0.9], (0..40).map(|_| 0.3 + 0.3 * noise(&mut seed)).collect(), 0.2)
    }

    /// A mesh of the height field's triangles, sides and base has the same ray distances as the field.
    #[test]
    fn a_field_is_its_triangles() {
        let grid = hills();
        let [rows, columns] = grid.shape;
        let top = |r: usize, c: usize| -> V {
            let at = |k: usize, n: usize, half: f64| -half + 2.0 * half * k as f64 / (n - 1) as f64;
            [at(c, columns, grid.half[0]), at(r, rows, grid.half[1]), grid.elevation[r * columns + c]]
        };
        let low = |p: V| [p[0], p[1], -grid.base];
        let mut corners: Vec<[V; 3]> = vec![];
        for r in 0..rows - 1 {
            for c in 0..columns - 1 {
                let [a, b, d, e] = [top(r, c), top(r, c + 1), top(r + 1, c + 1), top(r + 1, c)];
                corners.extend([[a, b, d], [a, d, e], [low(a), low(b), low(d)], [low(a), low(d), low(e)]]);
            }
        }
        let edge = |a: V, b: V| [[a, b, low(b)], [a, low(b), low(a)]];
        (0..columns - 1).for_each(|c| [0, rows - 1].iter().for_each(|&r| corners.extend(edge(top(r, c), top(r, c + 1)))));
        (0..rows - 1).for_each(|r| [0, columns - 1].iter().for_each(|&c| corners.extend(edge(top(r, c), top(r + 1, c)))));
        let vertices: Vec<V> = corners.iter().flatten().copied().collect();
        let faces: Vec<[u32; 3]> = (0..corners.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        let (field, mesh) = (RaySurface::field(grid), RaySurface::mesh(&vertices, &faces));
        let (mut seed, mut met) = (3, 0);
        for k in 0..40_000 {
            let from = [3.0 * noise(&mut seed), 1.5 * noise(&mut seed), noise(&mut seed)];
            let mut way = [noise(&mut seed), noise(&mut seed), 0.5 * noise(&mut seed)];
            // Some rays are parallel to the axes of the grid.
            if k % 5 < 3 {
                way = [0.0; 3];
                way[k % 5] = 1.0;
            }
            let [a, b] = [&field, &mesh].map(|surface| surface.distance(&UPRIGHT, add(UPRIGHT.pos, from), unit(way)));
            met += usize::from(a.is_finite());
            assert!(a == b || (a - b).abs() < 1e-11, "{from:?} {way:?}: {a} {b}");
        }
        assert!(met > 8_000, "{met}");
    }

    #[test]
    fn what_is_not_a_number_meets_nothing() {
        let (vertices, faces) = tetrahedron();
        for surface in [RaySurface::mesh(&vertices, &faces), RaySurface::field(hills())] {
            for bad in [f64::NAN, f64::INFINITY] {
                assert_eq!(surface.distance(&UPRIGHT, [bad, 0.0, 2.0], [0.0, 0.0, -1.0]), f64::INFINITY);
                assert_eq!(surface.distance(&UPRIGHT, [0.0, 0.0, 2.0], [0.0, 0.0, -bad]), f64::INFINITY);
            }
            // The square of a very large distance is infinite.
            assert_eq!(surface.distance(&UPRIGHT, [1e300, 0.0, 2.0], [0.0, 0.6, -0.8]), f64::INFINITY);
        }
    }
}
