//! Part of a shape's surface that faces the other shape, projected along the contact normal.
//!
//! Coordinates are (x, y) in the projection plane and the height h along the normal. A corner has the number of its vertex and the number
//! of the edge to the next corner. These numbers identify contacts from step to step.

use crate::linear_algebra::*;
use crate::shape::ConvexShape;
use crate::vectors::{V, along_axis, furthest, widest};

/// Corner of a [`ProjectedFeature`].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Corner {
    /// Position along the first axis of the projection plane, m.
    pub(super) x: f64,
    /// Position along the second axis of the projection plane, m.
    pub(super) y: f64,
    /// Height of the corner along the contact normal, m.
    pub(super) h: f64,
    /// Number of the corner's vertex in the shape.
    pub(super) id: u32,
    /// Number of the feature's edge to the next corner, below [`EDGES`].
    pub(super) edge: u32,
}

/// Upper bound of the numbers of a projected feature's edges.
pub(super) const EDGES: u32 = 1 << 14;

/// Type of a [`ProjectedFeature`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Kind {
    /// Points of a shape that no edges connect.
    #[default]
    Points,
    /// Two corners, the ends of a segment.
    Segment,
    /// Corners in order around a flat face.
    Polygon,
    /// End face of a cylinder. Its corners are points of the rim.
    Disc,
}

/// Part of a shape's surface, projected along the contact normal: points, a segment, a polygon or a disc.
#[derive(Clone, Debug, Default)]
pub(super) struct ProjectedFeature {
    /// Type of the feature: points, segment, polygon or disc.
    pub(super) kind: Kind,
    /// Corners of the feature, or points of the rim of a disc.
    pub(super) corners: Vec<Corner>,
    /// Coefficients of the plane of a polygon or disc: h = plane . (1, x, y).
    pub(super) plane: V,
    /// Centre (x, y) of a disc, m.
    pub(super) centre: [f64; 2],
    /// Radius of a disc, m.
    pub(super) radius: f64,
}

/// Pose of a shape, and the axes along which its surface is projected.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    /// Position of the shape's frame, m.
    pub(super) pos: V,
    /// Orientation of the shape's frame.
    pub(super) mat: &'a M3<f64>,
    /// Contact normal, and the x and y axis of the projection plane.
    pub(super) axes: &'a [V; 3],
    /// Sign of the direction to the other shape: 1 along the normal, -1 opposite to it.
    pub(super) side: f64,
}

impl View<'_> {
    /// Coordinates x and y in the projection plane and height h along the normal, m, of the point `local` of the shape's frame.
    pub(super) fn project(&self, local: V) -> [f64; 3] {
        let p = add(self.pos, rotate(self.mat, local));
        [dot(p, self.axes[1]), dot(p, self.axes[2]), dot(p, self.axes[0])]
    }

    /// Unit vector towards the other shape, along the normal, in the shape's frame.
    pub(super) fn towards(&self) -> V {
        rotate_back(self.mat, scale(self.axes[0], self.side))
    }
}

/// Sine of the angle between a cylinder's axis and the contact normal above which an end face is a list of points instead of a disc.
const TILTED: f64 = 1e-3;
/// Sine of the angle between a cylinder's axis and the contact normal below which an end face has no lowest point.
const LEVEL: f64 = 1e-6;
/// Cosine of the angle between a cylinder's axis and the contact normal above which an end face, rather than the side, faces the other
/// shape.
const UPRIGHT: f64 = 0.7;

impl ProjectedFeature {
    /// Sets the feature to the part of a shape's surface that faces the other shape, around its farthest corner `corner`.
    ///
    /// The part is a whole face even if only an edge touches, because each of its corners has a height.
    pub(super) fn fill(&mut self, shape: &ConvexShape, view: &View<'_>, corner: u32) {
        let d = view.towards();
        self.corners.clear();
        self.kind = Kind::Points;
        match shape {
            ConvexShape::Sphere { .. } => self.push(view, [0.0; 3], 0, 0),
            ConvexShape::Ellipsoid { .. } => self.push(view, shape.support(d), 0, 0),
            ConvexShape::Capsule { half_length, .. } => {
                self.kind = Kind::Segment;
                self.push(view, [0.0, 0.0, -half_length], 0, 0);
                self.push(view, [0.0, 0.0, *half_length], 1, 0);
            }
            ConvexShape::Cylinder { radius, half_length } => self.cylinder(view, d, *radius, *half_length),
            ConvexShape::Box { half } => self.cuboid(view, d, *half),
            ConvexShape::Hull(hull) => {
                let face = &hull.faces[hull.facing_at(corner as usize, d)];
                let n = face.vertices.len();
                for (k, &v) in face.vertices.iter().enumerate() {
                    let next = face.vertices[(k + 1) % n];
                    let edge = (v.min(next).wrapping_mul(131)).wrapping_add(v.max(next)) % EDGES;
                    self.push(view, hull.points()[v as usize], v, edge);
                }
                self.flat(view, face.normal);
            }
            ConvexShape::Triangle(p) => {
                (0..3).for_each(|k| self.push(view, p[k], k as u32, k as u32));
                self.flat(view, crate::shape::triangle_normal(p));
            }
        }
    }

    /// Adds the vertices of all faces that meet at the lowest vertex `corner` of a hull, for contacts with a half space.
    pub(super) fn add_neighbours(&mut self, shape: &ConvexShape, view: &View<'_>, corner: u32) {
        if let ConvexShape::Hull(hull) = shape {
            let faces = &hull.around[corner as usize];
            for v in faces.iter().flat_map(|&f| &hull.faces[f as usize].vertices) {
                if self.corners.iter().all(|c| c.id != *v) {
                    self.push(view, hull.points()[*v as usize], *v, 0);
                }
            }
        }
    }

    /// Adds a corner to the feature. `local` is its position in the shape's frame, m, `id` the number of the vertex and `edge` that of the
    /// edge to the next corner.
    fn push(&mut self, view: &View<'_>, local: V, id: u32, edge: u32) {
        let [x, y, h] = view.project(local);
        self.corners.push(Corner { x, y, h, id, edge });
    }

    /// Makes the feature a polygon on a plane with this unit normal in the shape's frame.
    fn flat(&mut self, view: &View<'_>, normal: V) {
        self.kind = Kind::Polygon;
        self.set_plane(view, normal);
    }

    /// Sets the plane of the feature: through the first corner, with this unit normal in the shape's frame.
    fn set_plane(&mut self, view: &View<'_>, normal: V) {
        let m = rotate(view.mat, normal);
        let [up, mx, my] = view.axes.map(|axis| dot(m, axis));
        let c = self.corners[0];
        // The height of a face parallel to the contact normal is undefined, and is not used.
        let k = if up.abs() > 1e-3 { -1.0 / up } else { 0.0 };
        self.plane = [c.h - k * (mx * c.x + my * c.y), k * mx, k * my];
    }

    /// Whether all corners of the feature are at the same height. Differences of up to `slope` times the distance from the first corner are
    /// ignored.
    pub(super) fn is_level(&self, slope: f64) -> bool {
        let Some(o) = self.corners.first() else { return true };
        self.corners.iter().all(|c| {
            let (x, y, h) = (c.x - o.x, c.y - o.y, c.h - o.h);
            h * h <= slope * slope * (x * x + y * y)
        })
    }

    /// Height of the feature's plane at (x, y), m.
    pub(super) fn height(&self, x: f64, y: f64) -> f64 {
        self.plane[0] + self.plane[1] * x + self.plane[2] * y
    }

    /// Sets the feature to the face of a box that is farthest along `d`, in the box's frame. `half` are the half sizes, m.
    fn cuboid(&mut self, view: &View<'_>, d: V, half: V) {
        let k = widest(d);
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let top = u32::from(d[k] > 0.0) << k;
        // The corners are in order around the face. Edge e starts at corner e and runs along axis i or j.
        for (e, (si, sj)) in [(0, 0), (1, 0), (1, 1), (0, 1)].into_iter().enumerate() {
            let id = top | si << i | sj << j;
            let along = if e % 2 == 0 { i } else { j };
            // The number of an edge combines the number of its lower vertex with its axis.
            let next: u32 = [1 << i, 1 << j, 1 << i, 1 << j][e];
            let edge = (id & !next) | (along as u32) << 3;
            let p = std::array::from_fn(|a| if id >> a & 1 == 1 { half[a] } else { -half[a] });
            self.push(view, p, id, edge);
        }
        self.flat(view, along_axis(k, 1f64.copysign(d[k])));
    }

    /// Sets the feature to the end face of a cylinder, or the line on its side, that is farthest along `d` in the cylinder's frame.
    fn cylinder(&mut self, view: &View<'_>, d: V, radius: f64, half_length: f64) {
        let cap = half_length.copysign(d[2]);
        let across = (d[0] * d[0] + d[1] * d[1]).sqrt();
        let top = u32::from(cap > 0.0) << 4;
        let lowest = |z: f64| [radius * d[0] / across, radius * d[1] / across, z];
        if d[2].abs() <= UPRIGHT {
            self.kind = Kind::Segment;
            self.push(view, lowest(-half_length), 5, 0);
            self.push(view, lowest(half_length), 5 | 1 << 4, 0);
            return;
        }
        // Four points of the rim that are fixed to the body, and the lowest one, because the cylinder can tip over any point of the rim.
        for (k, (x, y)) in [(radius, 0.0), (0.0, radius), (-radius, 0.0), (0.0, -radius)].into_iter().enumerate() {
            self.push(view, [x, y, cap], top | k as u32, 0);
        }
        if across > LEVEL {
            self.push(view, lowest(cap), top | 4, 0);
        }
        if across <= TILTED {
            self.kind = Kind::Disc;
            self.radius = radius;
            let [x, y, _] = view.project([0.0, 0.0, cap]);
            self.centre = [x, y];
            self.set_plane(view, [0.0, 0.0, 1f64.copysign(d[2])]);
        }
    }
}

/// Ends of the straight line on a shape's surface that is farthest along `d`: an edge, or a line on the side of a round shape.
///
/// `d` is a unit vector. Both `d` and the ends, m, are in the shape's frame. `corner` is the corner that is farthest along `d`. The result
/// is `None` if the line is inclined: if the sine of its angle to the plane across `d` exceeds `tolerance`.
pub(super) fn edge(shape: &ConvexShape, d: V, corner: u32, tolerance: f64) -> Option<[V; 2]> {
    match shape {
        ConvexShape::Sphere { .. } | ConvexShape::Ellipsoid { .. } => None,
        ConvexShape::Capsule { half_length: h, .. } => (d[2].abs() < tolerance).then_some([[0.0, 0.0, -h], [0.0, 0.0, *h]]),
        ConvexShape::Cylinder { half_length: h, .. } => {
            let [x, y, _] = shape.support(d);
            (d[2].abs() < tolerance).then_some([[x, y, -h], [x, y, *h]])
        }
        ConvexShape::Box { half } => {
            // Next to a slightly tilted face, two edges are nearly perpendicular to the direction. The closer one is chosen.
            let k = (0..3).min_by(|&i, &j| d[i].abs().total_cmp(&d[j].abs())).filter(|&k| d[k].abs() < tolerance)?;
            let mut ends = [shape.support(d); 2];
            (ends[0][k], ends[1][k]) = (-half[k], half[k]);
            Some(ends)
        }
        ConvexShape::Hull(hull) => {
            let level = hull.level(corner as usize, d);
            let [p, q] = [corner as usize, level].map(|v| hull.points()[v]);
            (dot(d, sub(q, p)).abs() < tolerance * norm(sub(q, p))).then_some([p, q])
        }
        ConvexShape::Triangle(t) => {
            let v = furthest(t, d);
            let slope = |k: usize| dot(d, sub(t[k], t[v])).abs() / norm(sub(t[k], t[v]));
            let (i, j) = ((v + 1) % 3, (v + 2) % 3);
            let k = if slope(i) <= slope(j) { i } else { j };
            (slope(k) < tolerance).then(|| [t[v], t[k]])
        }
    }
}
