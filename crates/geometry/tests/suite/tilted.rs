//! Tests of bodies that lie on a flat face with a small tilt from rounding or motion. They must touch the face everywhere above it.
//! PROPTEST_CASES=5000 tests more cases.

use std::sync::Arc;

use crate::shapes::unit;
use proptest::prelude::*;
use stepper_geometry::linear_algebra::*;
use stepper_geometry::{ConvexShape, Grid, Hull, Narrow, Point, Pose, SearchLimits, Solid, Surface};

/// Half sizes of the floor along x and y, m.
const FLOOR: [f64; 2] = [0.05, 0.3];
/// Half sizes of the body along x, y and z, m.
const BODY: [f64; 3] = [0.03, 0.02, 0.02];

/// Largest distance of a contact in the search, m. It exceeds the height of the highest corner of the most tilted body.
const PREDICTION: f64 = 1e-3;

/// Smallest fraction of the common area of body and floor that the contact points must span. Four corners of a hexagon span at least half
/// of the hexagon, and those of an octagon at least 0.6.
const LEAST_SHARE: f64 = 0.5;

fn cuboid(half: [f64; 3]) -> Hull {
    let corner = |k: usize| std::array::from_fn(|i| if k >> i & 1 == 0 { -half[i] } else { half[i] });
    Hull::new(&(0..8).map(corner).collect::<Vec<_>>()).expect("has volume")
}

/// Floor, and the height of its top above the origin of its frame, m. `kind` selects a box (0), a hull (1) or a height field (2).
fn floor(kind: usize) -> (Solid, f64) {
    let half = [FLOOR[0], FLOOR[1], 0.05];
    match kind {
        0 => (Solid::Convex(ConvexShape::Box { half }), 0.05),
        1 => (Solid::Convex(ConvexShape::Hull(Arc::new(cuboid(half)))), 0.05),
        _ => (Solid::Surface(Surface::Grid(Grid::new([3, 3], FLOOR, vec![0.0; 9], 0.1)).into()), 0.0),
    }
}

fn body(kind: usize) -> ConvexShape {
    if kind == 0 { ConvexShape::Box { half: BODY } } else { ConvexShape::Hull(Arc::new(cuboid(BODY))) }
}

type P = [f64; 2];

/// Twice the area of the triangle of three points; negative if they are clockwise.
fn turn(a: P, b: P, c: P) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Area of a polygon with its corners in order.
fn area(p: &[P]) -> f64 {
    (1..p.len().max(2) - 1).map(|k| 0.5 * turn(p[0], p[k], p[k + 1])).sum::<f64>().abs()
}

/// Area of the convex hull of some points.
fn hull_area(points: &[P]) -> f64 {
    let mut sorted = points.to_vec();
    sorted.sort_by(|p, q| p[0].total_cmp(&q[0]).then(p[1].total_cmp(&q[1])));
    let chain = |points: &mut dyn Iterator<Item = &P>| {
        let mut out: Vec<P> = vec![];
        for p in points {
            while out.len() > 1 && turn(out[out.len() - 2], out[out.len() - 1], *p) <= 0.0 {
                out.pop();
            }
            out.push(*p);
        }
        out.pop();
        out
    };
    let (mut lower, upper) = (chain(&mut sorted.iter()), chain(&mut sorted.iter().rev()));
    lower.extend(upper);
    area(&lower)
}

/// Part of a polygon that is over the rectangle of the floor, seen from above, as a polygon.
fn over_floor(corners: &[P]) -> Vec<P> {
    let mut polygon = corners.to_vec();
    for (axis, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
        let outside = |p: &P| sign * p[axis] - FLOOR[axis];
        let mut next = vec![];
        for k in 0..polygon.len() {
            let (p, q) = (polygon[k], polygon[(k + 1) % polygon.len()]);
            let (a, b) = (outside(&p), outside(&q));
            if a <= 0.0 {
                next.push(p);
            }
            if (a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0) {
                let x = a / (a - b);
                next.push([p[0] + (q[0] - p[0]) * x, p[1] + (q[1] - p[1]) * x]);
            }
        }
        polygon = next;
    }
    polygon
}

/// Contact points of a tilted body and the floor, and the area of the body's lower face above the floor, m^2.
///
/// `floors` selects the floor as in [`floor`], and `bodies` a box (0) or a hull (1). `epsilon` is the relative rounding error of the
/// poses. `at` is the place (x, y) of the body's centre, and `depth` the overlap, m. `tilt` has the direction of the tilt axis and the
/// angle, rad; `yaw`, rad, is about the vertical.
fn meet(floors: usize, bodies: usize, epsilon: f64, at: P, yaw: f64, tilt: (V3<f64>, f64), depth: f64) -> (Vec<Point>, f64) {
    let ((ground, top), shape) = (floor(floors), body(bodies));
    let axis = [tilt.0[0], tilt.0[1], 0.0];
    let axis = if norm(axis) > 1e-3 { scale(axis, 1.0 / norm(axis)) } else { [1.0, 0.0, 0.0] };
    let mat = mat_mul(&axis_rotation(axis, tilt.1.sin(), tilt.1.cos()), &axis_rotation([0.0, 0.0, 1.0], yaw.sin(), yaw.cos()));
    let bottom = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| [x * BODY[0], y * BODY[1], -BODY[2]]);
    let corners = bottom.map(|p| {
        let p = rotate(&mat, p);
        [at[0] + p[0], at[1] + p[1]]
    });
    let common = over_floor(&corners);
    // The lowest point of the part over the floor is `depth` below the floor's top.
    let normal = rotate(&mat, [0.0, 0.0, 1.0]);
    let origin = rotate(&mat, [0.0, 0.0, -BODY[2]]);
    let height = |p: &P| origin[2] - (normal[0] * (p[0] - at[0] - origin[0]) + normal[1] * (p[1] - at[1] - origin[1])) / normal[2];
    let lowest = common.iter().map(height).fold(f64::INFINITY, f64::min);
    let poses = [
        Pose { pos: [0.0, 0.0, -top], mat: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] },
        Pose { pos: [at[0], at[1], -lowest - depth], mat },
    ];
    let reach = SearchLimits { epsilon, ..PREDICTION.into() };
    let points = Narrow::default().collide([&ground, &Solid::Convex(shape)], poses, reach).points.clone();
    (points, area(&common))
}

proptest! {
    #[test]
    fn a_tilted_body_touches_the_floor_wherever_it_is_over_it(
        floors in 0..3usize, bodies in 0..2usize, single in prop::bool::ANY, at in (-0.07..0.07f64, -0.28..0.28f64), yaw in -3.1..3.1f64,
        axis in unit(), tilt in -9.0..-4.0f64, depth in -1e-6..1e-6f64,
    ) {
        let epsilon = if single { f64::from(f32::EPSILON) } else { f64::EPSILON };
        let (points, common) = meet(floors, bodies, epsilon, [at.0, at.1], yaw, (axis, 10f64.powf(tilt)), depth);
        if common < 0.1 * 4.0 * BODY[0] * BODY[1] {
            return Ok(());
        }
        let upright: Vec<P> = points.iter().filter(|p| p.normal[2] > 0.99).map(|p| [p.pos[0], p.pos[1]]).collect();
        prop_assert!(hull_area(&upright) > LEAST_SHARE * common, "{} of {common}: {points:?}", hull_area(&upright));
    }
}
