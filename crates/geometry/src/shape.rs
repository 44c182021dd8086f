//! Convex shapes, their cores and support points.

use std::sync::Arc;

use crate::hull::Hull;
use crate::linear_algebra::*;
use crate::vectors::{V, along_axis, furthest, neg, unit_or, widest};

/// Convex shape in its frame, with lengths in m.
///
/// The shape consists of all points within [`Self::radius`] of its core. The core of a ball is a point and that of a capsule a segment.
/// All other shapes have radius 0.
#[derive(Clone, Debug)]
pub enum ConvexShape {
    /// Ball.
    Sphere {
        /// Radius, m.
        radius: f64,
    },
    /// Capsule: the points within the distance `radius` of a segment along z.
    Capsule {
        /// Radius, m.
        radius: f64,
        /// Half the length of the segment, m.
        half_length: f64,
    },
    /// Solid cylinder along z.
    Cylinder {
        /// Radius, m.
        radius: f64,
        /// Half the length, m.
        half_length: f64,
    },
    /// Ellipsoid.
    Ellipsoid {
        /// Semi-axes, m.
        radii: [f64; 3],
    },
    /// Box.
    Box {
        /// Half sizes, m.
        half: [f64; 3],
    },
    /// Convex hull of points.
    Hull(Arc<Hull>),
    /// Triangle. Its corners are counter-clockwise seen from outside.
    Triangle([V; 3]),
}

/// Ball without a radius, whose frame is that of another solid.
pub(super) static POINT: ConvexShape = ConvexShape::Sphere { radius: 0.0 };

impl ConvexShape {
    /// Rounding radius, m: the shape consists of all points within this distance of its core. It is 0 for shapes other than balls and
    /// capsules.
    #[inline]
    pub fn radius(&self) -> f64 {
        match *self {
            Self::Sphere { radius } | Self::Capsule { radius, .. } => radius,
            _ => 0.0,
        }
    }

    /// Support point: point of the shape without its rounding radius that is farthest along `d`, m. The length of `d` has no effect, even
    /// if several points are equally far.
    pub fn support(&self, d: V) -> V {
        self.corner(d).0
    }

    /// Point of the shape without its rounding radius that is farthest along `d`, m, and its vertex number. The number is 0 for round
    /// shapes and balls.
    #[inline]
    pub(super) fn corner(&self, d: V) -> (V, u32) {
        let round = |p: V| (p, 0);
        match self {
            Self::Sphere { .. } => round([0.0; 3]),
            Self::Capsule { half_length, .. } => ([0.0, 0.0, half_length.copysign(d[2])], u32::from(d[2].is_sign_negative())),
            Self::Cylinder { radius, half_length } => {
                let across = d[0] * d[0] + d[1] * d[1];
                let k = if across > 0.0 { radius / across.sqrt() } else { 0.0 };
                round([d[0] * k, d[1] * k, half_length.copysign(d[2])])
            }
            Self::Ellipsoid { radii: r } => {
                // x = R^2 d / |R d| maximises d . x over |R^-1 x| <= 1.
                let rd = [r[0] * d[0], r[1] * d[1], r[2] * d[2]];
                let u = unit_or(rd, [0.0; 3]);
                round([r[0] * u[0], r[1] * u[1], r[2] * u[2]])
            }
            Self::Box { half } => {
                let number = (0..3).fold(0, |bits, k| bits | u32::from(d[k].is_sign_negative()) << k);
                (std::array::from_fn(|k| half[k].copysign(d[k])), number)
            }
            Self::Hull(hull) => {
                let v = hull.support(d);
                (hull.points()[v], v as u32)
            }
            Self::Triangle(p) => {
                let k = furthest(p, d);
                (p[k], k as u32)
            }
        }
    }

    /// Point of the shape without its rounding radius that is farthest along `d`, m, and its vertex number. On a hull, the search starts at
    /// the vertex `from`.
    #[inline]
    pub(super) fn climb(&self, from: u32, d: V) -> (V, u32) {
        match self {
            Self::Hull(hull) => {
                let v = hull.climb(from as usize, d);
                (hull.points()[v], v as u32)
            }
            _ => self.corner(d),
        }
    }

    /// Vertex `corner` of a hull or box. For other shapes, the point without the rounding radius that is farthest along `d`, m.
    pub(super) fn support_at(&self, corner: u32, d: V) -> V {
        self.polyhedron().map_or_else(|| self.support(d), |polyhedron| polyhedron.point(corner))
    }

    /// Whether the shape is a convex hull of points.
    pub(crate) fn is_hull(&self) -> bool {
        matches!(self, Self::Hull(_))
    }

    /// Whether the shape without its rounding radius is a polytope, a segment or a point. False for cylinders and ellipsoids.
    pub(super) fn is_polytope(&self) -> bool {
        !matches!(self, Self::Cylinder { .. } | Self::Ellipsoid { .. })
    }

    /// Upper bound of the number of corners of a face, for the size of buffers.
    pub(super) fn corners(&self) -> usize {
        match self {
            Self::Hull(hull) => hull.points().len(),
            _ => 8,
        }
    }

    /// Point inside the shape, m: the origin of the frame, the centre of a hull's volume, or the centroid of a triangle.
    pub(super) fn centre(&self) -> V {
        match self {
            Self::Hull(hull) => hull.centre(),
            Self::Triangle([a, b, c]) => scale(add(add(*a, *b), *c), 1.0 / 3.0),
            _ => [0.0; 3],
        }
    }

    /// Radius of a ball around [`Self::centre`] that contains the whole shape, m.
    pub(super) fn bound(&self) -> f64 {
        match self {
            Self::Sphere { radius } => *radius,
            Self::Capsule { radius, half_length } => radius + half_length,
            Self::Cylinder { radius, half_length } => (radius * radius + half_length * half_length).sqrt(),
            Self::Ellipsoid { radii } => radii[0].max(radii[1]).max(radii[2]),
            Self::Box { half } => norm(*half),
            Self::Hull(hull) => hull.bound,
            Self::Triangle(p) => {
                let c = self.centre();
                let square = |x: &V| dot(sub(*x, c), sub(*x, c));
                p.iter().map(square).fold(0.0, f64::max).sqrt()
            }
        }
    }

    /// Largest distance of a point of the shape from a line along the unit vector `axis`, m. `offset` is the vector from a point of the
    /// line to the origin of the shape's frame.
    pub(super) fn radius_about(&self, axis: V, offset: V) -> f64 {
        let across = |p: V| {
            let arm = add(p, offset);
            add_scaled(arm, axis, -dot(arm, axis))
        };
        let furthest_of = |points: &[V]| points.iter().map(|&p| norm(across(p))).fold(0.0, f64::max);
        let core = match self {
            Self::Sphere { .. } => furthest_of(&[[0.0; 3]]),
            Self::Capsule { half_length, .. } => furthest_of(&[[0.0, 0.0, *half_length], [0.0, 0.0, -half_length]]),
            Self::Box { half } => (0..8u32).fold(0.0, |most: f64, bits| {
                most.max(norm(across(std::array::from_fn(|k| if bits >> k & 1 == 0 { half[k] } else { -half[k] }))))
            }),
            Self::Hull(hull) => furthest_of(hull.points()),
            Self::Triangle(points) => furthest_of(points),
            Self::Cylinder { .. } | Self::Ellipsoid { .. } => {
                // The support point along the direction of the last point is farther from the line than the last point.
                let [_, x, y] = contact_frame(axis);
                (0..8).fold(0.0, |most: f64, k| {
                    let (sin, cos) = (f64::from(k) * std::f64::consts::FRAC_PI_4).sin_cos();
                    let mut direction = add(scale(x, cos), scale(y, sin));
                    for _ in 0..16 {
                        direction = across(self.support(direction));
                    }
                    most.max(norm(direction))
                })
            }
        };
        core + self.radius()
    }

    /// Scale of the shape, m: about half its smallest extent. Tolerances are relative to it.
    pub(super) fn least(&self) -> f64 {
        match self {
            Self::Sphere { radius } | Self::Capsule { radius, .. } => *radius,
            Self::Cylinder { radius, half_length } => radius.min(*half_length),
            Self::Ellipsoid { radii: x } | Self::Box { half: x } => x[0].min(x[1]).min(x[2]),
            Self::Hull(hull) => hull.least,
            Self::Triangle([a, b, c]) => {
                let (u, v) = (sub(*b, *a), sub(*c, *a));
                let longest = dot(u, u).max(dot(v, v)).max(dot(sub(v, u), sub(v, u))).sqrt();
                0.25 * norm(cross(u, v)) / longest
            }
        }
    }

    /// Radius of the largest ball that can touch every point of the shape's surface from inside, m. It is 0 except for ellipsoids.
    pub(super) fn roll(&self) -> f64 {
        let Self::Ellipsoid { radii: [x, y, z] } = *self else { return 0.0 };
        let shortest = x.min(y).min(z);
        shortest * shortest / x.max(y).max(z)
    }

    /// Depth of the point `p` below the surface of a box or cylinder, m; 0 for other shapes.
    pub(super) fn depth_of(&self, p: V) -> f64 {
        match self {
            Self::Box { half } => (0..3).map(|k| half[k] - p[k].abs()).fold(f64::INFINITY, f64::min),
            Self::Cylinder { radius, half_length } => (radius - p[0].hypot(p[1])).min(half_length - p[2].abs()),
            _ => 0.0,
        }
    }

    /// Radius of a ball around [`Self::centre`] that is inside the shape without its rounding radius, m.
    pub(super) fn ball(&self) -> f64 {
        match self {
            Self::Sphere { .. } | Self::Capsule { .. } | Self::Triangle(_) => 0.0,
            _ => self.least(),
        }
    }

    /// Outward unit normal of the flat face whose normal is closest to `d`, among the faces at `corner`. `None` if the shape has no flat
    /// face.
    ///
    /// `corner` is the corner that is farthest along `d`.
    pub(super) fn flat(&self, d: V, corner: u32) -> Option<V> {
        match self {
            Self::Sphere { .. } | Self::Capsule { .. } | Self::Ellipsoid { .. } => None,
            Self::Cylinder { .. } => Some([0.0, 0.0, 1f64.copysign(d[2])]),
            Self::Box { .. } => {
                let k = widest(d);
                Some(along_axis(k, 1f64.copysign(d[k])))
            }
            Self::Hull(hull) => Some(hull.faces[hull.facing_at(corner as usize, d)].normal),
            Self::Triangle(p) => {
                let n = triangle_normal(p);
                Some(if dot(n, d) < 0.0 { neg(n) } else { n })
            }
        }
    }

    /// Calls `visit` with candidates for the direction of the largest separation from an overlapping shape. The line between the centres is
    /// not among them.
    ///
    /// `towards` is the vector from the centre of this shape to the centre of the other, m, in the frame of this shape.
    pub(super) fn directions(&self, towards: V, mut visit: impl FnMut(V)) {
        match self {
            Self::Sphere { .. } => {}
            Self::Capsule { .. } => visit(unit_or([towards[0], towards[1], 0.0], [1.0, 0.0, 0.0])),
            Self::Cylinder { .. } => {
                visit([0.0, 0.0, 1.0]);
                visit([0.0, 0.0, -1.0]);
                visit(unit_or([towards[0], towards[1], 0.0], [1.0, 0.0, 0.0]));
            }
            Self::Ellipsoid { radii } => {
                let gradient = std::array::from_fn(|k| towards[k] / (radii[k] * radii[k]));
                visit(unit_or(gradient, [0.0, 0.0, 1.0]));
                axes(visit);
            }
            Self::Box { .. } => axes(visit),
            Self::Hull(hull) => hull.directions(towards, visit),
            Self::Triangle(p) => {
                let n = triangle_normal(p);
                visit(n);
                visit(neg(n));
            }
        }
    }
}

/// Calls `visit` with the unit vectors along the three axes, in both directions.
fn axes(mut visit: impl FnMut(V)) {
    for k in 0..3 {
        visit(along_axis(k, 1.0));
        visit(along_axis(k, -1.0));
    }
}

/// Unit normal of a triangle, on the side from which its corners are counter-clockwise. It is the z axis if the triangle has no area.
pub(super) fn triangle_normal(p: &[V; 3]) -> V {
    unit_or(cross(sub(p[1], p[0]), sub(p[2], p[0])), [0.0, 0.0, 1.0])
}
