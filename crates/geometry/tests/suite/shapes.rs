//! Convex bodies with their support functions, which determine their distances.
#![allow(dead_code, reason = "each test uses its own part")]

use proptest::prelude::*;
use stepper_geometry::ConvexShape;
use stepper_geometry::linear_algebra::*;
use stepper_geometry::pairs::ContactPoint;
use stepper_geometry::pairs::{Cuboid, Cylinder, Ellipsoid, Segment};

/// Number of cases of a property test: PROPTEST_CASES, or `usual`.
pub(crate) fn cases(usual: u32) -> ProptestConfig {
    let asked = std::env::var("PROPTEST_CASES").ok().and_then(|n| n.parse().ok());
    ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(asked.unwrap_or(usual)) }
}

/// Convex body.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Body {
    HalfSpace { origin: V3<f64>, normal: V3<f64> },
    Capsule(Segment<f64>),
    Cuboid(Cuboid<f64>),
    Cylinder(Cylinder<f64>),
    Ellipsoid(Ellipsoid<f64>),
}

impl Body {
    /// Maximum of u . x over all points x of the body.
    pub(crate) fn support(&self, u: V3<f64>) -> f64 {
        let local = |mat: &M3<f64>| rotate_back(mat, u);
        match self {
            Self::HalfSpace { origin, normal } => {
                if norm(sub(u, *normal)) < 1e-9 {
                    dot(u, *origin)
                } else {
                    f64::INFINITY
                }
            }
            Self::Capsule(s) => dot(u, s.centre) + dot(u, s.axis).abs() * s.half_length + s.radius * norm(u),
            Self::Cuboid(b) => {
                let l = local(&b.mat);
                dot(u, b.centre) + (0..3).map(|k| l[k].abs() * b.half[k]).sum::<f64>()
            }
            Self::Cylinder(c) => {
                let l = local(&c.mat);
                dot(u, c.centre) + c.radius * l[0].hypot(l[1]) + c.half_length * l[2].abs()
            }
            Self::Ellipsoid(e) => {
                let l = local(&e.mat);
                dot(u, e.centre) + norm([l[0] * e.radii[0], l[1] * e.radii[1], l[2] * e.radii[2]])
            }
        }
    }

    /// Rounding radius of the body, m; 0 except for capsules.
    fn radius(&self) -> f64 {
        if let Self::Capsule(s) = self { s.radius } else { 0.0 }
    }

    /// Level set function of the body at the point `p`, m. It is negative inside and zero on the surface. Outside it is at most the
    /// distance from the surface times a constant of order one.
    pub(crate) fn outside(&self, p: V3<f64>) -> f64 {
        match self {
            Self::HalfSpace { origin, normal } => dot(*normal, sub(p, *origin)),
            Self::Capsule(s) => {
                let along = dot(sub(p, s.centre), s.axis).clamp(-s.half_length, s.half_length);
                norm(sub(p, add_scaled(s.centre, s.axis, along))) - s.radius
            }
            Self::Cuboid(b) => {
                let x = rotate_back(&b.mat, sub(p, b.centre));
                (0..3).map(|k| x[k].abs() - b.half[k]).fold(f64::NEG_INFINITY, f64::max)
            }
            Self::Cylinder(c) => {
                let x = rotate_back(&c.mat, sub(p, c.centre));
                (x[0].hypot(x[1]) - c.radius).max(x[2].abs() - c.half_length)
            }
            Self::Ellipsoid(e) => {
                let x = rotate_back(&e.mat, sub(p, e.centre));
                let least = e.radii.iter().copied().fold(f64::INFINITY, f64::min);
                (norm([x[0] / e.radii[0], x[1] / e.radii[1], x[2] / e.radii[2]]) - 1.0) * least
            }
        }
    }

    pub(crate) fn moved(&self, turn: &M3<f64>, shift: V3<f64>) -> Self {
        let point = |p: V3<f64>| add(rotate(turn, p), shift);
        match *self {
            Self::HalfSpace { origin, normal } => Self::HalfSpace { origin: point(origin), normal: rotate(turn, normal) },
            Self::Capsule(s) => Self::Capsule(Segment { centre: point(s.centre), axis: rotate(turn, s.axis), ..s }),
            Self::Cuboid(b) => Self::Cuboid(Cuboid { centre: point(b.centre), mat: mat_mul(turn, &b.mat), ..b }),
            Self::Cylinder(c) => Self::Cylinder(Cylinder { centre: point(c.centre), mat: mat_mul(turn, &c.mat), ..c }),
            Self::Ellipsoid(e) => Self::Ellipsoid(Ellipsoid { centre: point(e.centre), mat: mat_mul(turn, &e.mat), ..e }),
        }
    }
}

/// Separation of two bodies along the unit vector `u` from a to b. Its maximum over all u is their signed distance: positive if they are
/// apart, else minus the smallest translation that separates them.
pub(crate) fn separation_along(a: &Body, b: &Body, u: V3<f64>) -> f64 {
    -b.support(scale(u, -1.0)) - a.support(u)
}

/// Largest separation of two bodies near the direction `u`. The search takes deterministic pseudo-random steps that shrink.
pub(crate) fn widest(a: &Body, b: &Body, mut u: V3<f64>) -> f64 {
    let mut best = separation_along(a, b, u);
    let mut size = 0.5;
    let mut seed = 1u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    while size > 1e-7 {
        let mut better = false;
        for _ in 0..12 {
            let tried = add_scaled(u, [random(), random(), random()], size);
            let tried = scale(tried, 1.0 / norm(tried));
            let found = separation_along(a, b, tried);
            if found > best {
                (u, best, better) = (tried, found, true);
            }
        }
        if !better {
            size *= 0.5;
        }
    }
    best
}

/// Checks a contact: the normal has length 1, and each body has a point at half the distance from the contact's position, along the normal.
pub(crate) fn is_contact(a: &Body, b: &Body, c: &ContactPoint<f64>) -> Result<(), TestCaseError> {
    prop_assert!((norm(c.normal) - 1.0).abs() < 1e-12, "normal of length {}", norm(c.normal));
    // The tolerance is the rounding error of coordinates of a few metres.
    let (on_a, on_b) = (add_scaled(c.pos, c.normal, -0.5 * c.distance), add_scaled(c.pos, c.normal, 0.5 * c.distance));
    prop_assert!(a.outside(on_a) < 1e-11 && b.outside(on_b) < 1e-11, "{} {} {c:?}", a.outside(on_a), b.outside(on_b));
    Ok(())
}

/// Checks that the smallest distance of the contacts is the signed distance of the bodies.
///
/// For bodies that are apart, two bounds suffice. A point of each body bounds the distance from above, and the separation along the normal
/// bounds it from below. For overlapping bodies, no direction that a search from `starts` finds has a smaller depth.
pub(crate) fn is_distance(a: &Body, b: &Body, contacts: &[ContactPoint<f64>], starts: &[V3<f64>]) -> Result<(), TestCaseError> {
    let nearest = contacts.iter().copied().min_by(|p, q| p.distance.total_cmp(&q.distance)).expect("a pair has a contact");
    contacts.iter().try_for_each(|c| is_contact(a, b, c))?;
    let along = separation_along(a, b, nearest.normal);
    // The normal is the direction between closest points with rounded coordinates. Coordinates of 2 m have errors of 2e-15 m. If the points
    // are nanometres apart, this rotates the normal. A point 2 m to the side, such as an end of a capsule or a corner of a box, is then off
    // by up to 4e-15 m^2 divided by the distance.
    let core = nearest.distance + a.radius() + b.radius();
    let turned = if core > 0.0 { 4e-15 / core } else { 0.0 };
    prop_assert!((along - nearest.distance).abs() < 1e-11 + turned, "separation {along} along the normal of {nearest:?}");
    if nearest.distance < 0.0 && !matches!(a, Body::HalfSpace { .. }) {
        for &u in starts {
            let found = widest(a, b, u);
            prop_assert!(found < nearest.distance + 1e-11, "{found} is a shorter way out than {nearest:?}");
        }
    }
    Ok(())
}

pub(crate) fn vector(size: f64) -> impl Strategy<Value = V3<f64>> {
    prop::array::uniform3(-size..size)
}

pub(crate) fn unit() -> impl Strategy<Value = V3<f64>> {
    vector(1.0).prop_filter("a direction", |v| norm(*v) > 0.1).prop_map(|v| scale(v, 1.0 / norm(v)))
}

/// Random shapes other than meshes. The function `s` gives the distribution of radii and half lengths, m.
pub(crate) fn simple<S: Strategy<Value = f64> + 'static>(s: impl Fn() -> S) -> impl Strategy<Value = ConvexShape> {
    prop_oneof![
        s().prop_map(|radius| ConvexShape::Sphere { radius }),
        (s(), s()).prop_map(|(radius, half_length)| ConvexShape::Capsule { radius, half_length }),
        (s(), s()).prop_map(|(radius, half_length)| ConvexShape::Cylinder { radius, half_length }),
        prop::array::uniform3(s()).prop_map(|radii| ConvexShape::Ellipsoid { radii }),
        prop::array::uniform3(s()).prop_map(|half| ConvexShape::Box { half }),
    ]
}

/// Rotations: random ones, and the 24 rotations of a cube, which make edges and faces parallel.
pub(crate) fn turn() -> impl Strategy<Value = M3<f64>> {
    let any = (unit(), -3.0..3.0f64).prop_map(|(axis, angle)| axis_rotation(axis, angle.sin(), angle.cos()));
    let square = (0..3usize, 0..4usize, 0..4usize).prop_map(|(i, j, k)| {
        let quarter = |axis: usize, n: usize| {
            let mut u = [0.0; 3];
            u[axis] = 1.0;
            let (sin, cos) = [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][n];
            axis_rotation(u, sin, cos)
        };
        mat_mul(&quarter(i, j), &quarter((i + 1) % 3, k))
    });
    prop_oneof![3 => any, 1 => square]
}

pub(crate) fn ball() -> impl Strategy<Value = Segment<f64>> {
    (vector(1.0), 0.02..0.4f64).prop_map(|(centre, radius)| Segment { centre, axis: [0.0, 0.0, 1.0], half_length: 0.0, radius })
}

pub(crate) fn capsule() -> impl Strategy<Value = Segment<f64>> {
    (vector(1.0), turn(), 0.02..1.0f64, 0.02..0.3f64).prop_map(|(centre, mat, half_length, radius)| Segment {
        centre,
        axis: column(&mat, 2),
        half_length,
        radius,
    })
}

pub(crate) fn cuboid() -> impl Strategy<Value = Cuboid<f64>> {
    (vector(0.5), turn(), prop::array::uniform3(0.01..0.8f64)).prop_map(|(centre, mat, half)| Cuboid { centre, mat, half })
}

pub(crate) fn cylinder() -> impl Strategy<Value = Cylinder<f64>> {
    (vector(0.5), turn(), 0.02..0.6f64, 0.02..0.6f64).prop_map(|(centre, mat, radius, half_length)| Cylinder {
        centre,
        mat,
        radius,
        half_length,
    })
}

pub(crate) fn ellipsoid() -> impl Strategy<Value = Ellipsoid<f64>> {
    (vector(0.5), turn(), prop::array::uniform3(0.05..0.6f64)).prop_map(|(centre, mat, radii)| Ellipsoid { centre, mat, radii })
}
