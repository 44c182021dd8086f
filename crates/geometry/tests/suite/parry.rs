//! Tests of distances, normals and closest points of convex shapes against parry's queries, for every pair of shapes except ellipsoids,
//! which parry does not have. PROPTEST_CASES=20000 tests more cases.

use parry3d_f64::math::{Matrix, Pose as ParryPose, Rotation, Vector};
use parry3d_f64::query;
use parry3d_f64::shape::{Ball, Capsule, ConvexPolyhedron, Cuboid, Cylinder, HalfSpace, Shape, Triangle};
use proptest::prelude::*;
use stepper_geometry::linear_algebra::*;
use stepper_geometry::{ConvexShape, Pose, distance};

use crate::convex::{hull, manifold, pose, separation, size};
use crate::pairs::{contacts, pair};
use crate::shapes::{Body, cases, separation_along, vector};

/// Distance above which directions are compared, m. Below it, parry's directions have large rounding errors.
const APART: f64 = 1e-4;

/// Largest excess of parry's distances over the exact ones, m. Parry's search along a cylinder's rim ends early. The excess was 1e-5 in
/// 20,000 cases.
const EXCESS: f64 = 5e-5;

/// Largest distance of closest points from the surface of their shape, m. The points are inexact where the distance changes little around
/// its minimum. It was 1.2e-5 in 200,000 cases.
const ON_SHAPE: f64 = 1e-4;

/// Largest accepted rounding error of parry's distances and depths, m. It was 1e-12 in 20,000 cases.
const ROUNDING: f64 = 1e-11;

/// Overlap above which parry may find another local minimum of the depth, m.
const DEEP: f64 = 0.02;

fn triangle() -> impl Strategy<Value = ConvexShape> {
    prop::array::uniform3(vector(0.6))
        .prop_filter("has area", |p| norm(cross(sub(p[1], p[0]), sub(p[2], p[0]))) > 0.05)
        .prop_map(ConvexShape::Triangle)
}

fn shape() -> impl Strategy<Value = ConvexShape> {
    prop_oneof![
        size().prop_map(|radius| ConvexShape::Sphere { radius }),
        (size(), size()).prop_map(|(radius, half_length)| ConvexShape::Capsule { radius, half_length }),
        (size(), size()).prop_map(|(radius, half_length)| ConvexShape::Cylinder { radius, half_length }),
        prop::array::uniform3(size()).prop_map(|half| ConvexShape::Box { half }),
        hull(),
        triangle(),
    ]
}

fn of(x: V3<f64>) -> Vector {
    Vector::new(x[0], x[1], x[2])
}

/// Parry's shape and its pose. For a cylinder the axes are exchanged, because parry's cylinder is along y.
fn in_parry(shape: &ConvexShape, pose: &Pose) -> (Box<dyn Shape>, ParryPose) {
    let [x, y, z] = [0, 1, 2].map(|k| of(column(&pose.mat, k)));
    let (shape, axes): (Box<dyn Shape>, _) = match shape {
        ConvexShape::Sphere { radius } => (Box::new(Ball::new(*radius)), [x, y, z]),
        ConvexShape::Capsule { radius, half_length } => (Box::new(Capsule::new_z(*half_length, *radius)), [x, y, z]),
        ConvexShape::Cylinder { radius, half_length } => (Box::new(Cylinder::new(*half_length, *radius)), [x, z, -y]),
        ConvexShape::Box { half } => (Box::new(Cuboid::new(of(*half))), [x, y, z]),
        ConvexShape::Hull(hull) => {
            let points: Vec<_> = hull.points().iter().map(|&p| of(p)).collect();
            let faces = hull.triangles().to_vec();
            (Box::new(ConvexPolyhedron::from_convex_mesh(points, &faces).expect("a hull is convex")), [x, y, z])
        }
        ConvexShape::Triangle(p) => (Box::new(Triangle::new(of(p[0]), of(p[1]), of(p[2]))), [x, y, z]),
        ConvexShape::Ellipsoid { .. } => unreachable!("parry has no ellipsoids"),
    };
    (shape, ParryPose::from_parts(of(pose.pos), Rotation::from_mat3(&Matrix::from_cols(axes[0], axes[1], axes[2]))))
}

/// Upper bound of the angle between the shortest vector between two convex shapes, of `length`, m, and one that is longer by `excess`, m.
///
/// The longer vector ends behind the plane that is perpendicular to the shortest one at its end. Hence cos(angle) >= length / (length +
/// excess).
fn turned(length: f64, excess: f64) -> f64 {
    (2.0 * excess / length).sqrt()
}

/// Parry's shape and pose of a test body; `None` for ellipsoids, which parry does not have.
fn body_in_parry(body: &Body) -> Option<(Box<dyn Shape>, ParryPose)> {
    let along = |z: V3<f64>| {
        let [_, x, y] = contact_frame(z);
        M3::from([x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]])
    };
    let (shape, pos, mat) = match body {
        Body::HalfSpace { origin, normal } => {
            return Some((Box::new(HalfSpace::new(of(*normal))), ParryPose::from_translation(of(*origin))));
        }
        Body::Capsule(s) => (ConvexShape::Capsule { radius: s.radius, half_length: s.half_length }, s.centre, along(s.axis)),
        Body::Cuboid(b) => (ConvexShape::Box { half: b.half }, b.centre, b.mat),
        Body::Cylinder(c) => (ConvexShape::Cylinder { radius: c.radius, half_length: c.half_length }, c.centre, c.mat),
        Body::Ellipsoid(_) => return None,
    };
    Some(in_parry(&shape, &Pose { pos, mat }))
}

/// Contacts of two edges that pass each other at a distance have their closest points on both shapes. An earlier version had such a contact
/// 0.28 m away from a box.
#[test]
fn edges_that_pass_beside_one_another_share_no_contact() {
    let tilted = [
        [0.9999989158494855, -0.001472453342795306, -1.3453877930535819e-5],
        [0.001472453342795306, 0.9998319585599253, 0.018272562036480016],
        [-1.3453877930535819e-5, -0.018272562036480016, 0.9998330427104398],
    ];
    let upright = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let [a, b] = [[0.1, 0.1, 0.564464621351083], [0.27555303511020873, 0.1, 0.1]].map(|half| ConvexShape::Box { half });
    let pa = Pose { pos: [0.5903598600795051, 0.0, 0.7922738040883678], mat: tilted.concat().try_into().expect("nine numbers") };
    let pb = Pose { pos: [0.8049151980330389, 0.4752145884039592, 0.6994376279625252], mat: upright };
    let (found, _) = distance(&a, &pa, &b, &pb);
    for p in manifold(&a, &pa, &b, &pb, found + 1e-3).points {
        for ((shape, pose), side) in [(in_parry(&a, &pa), -0.5), (in_parry(&b, &pb), 0.5)] {
            let off = shape.distance_to_point(&pose, of(add_scaled(p.pos, p.normal, side * p.distance)), true);
            assert!(off < 1e-9, "{off} m beside {:?}", shape.shape_type()); // rounding
        }
    }
}

proptest! {
    #![proptest_config(cases(2000))]

    #[test]
    fn shapes_apart_have_the_distance_and_normal_of_parry(a in shape(), pa in pose(), b in shape(), pb in pose()) {
        let (found, n) = distance(&a, &pa, &b, &pb);
        let ((a, pa), (b, pb)) = (in_parry(&a, &pa), in_parry(&b, &pb));
        let theirs = query::distance(&pa, &*a, &pb, &*b).unwrap().distance;
        let excess = theirs - found.max(0.0);
        prop_assert!(excess > -ROUNDING && excess < EXCESS, "{found}, parry {theirs}");
        if found > APART {
            let theirs = query::contact(&pa, &*a, &pb, &*b, f64::MAX).unwrap().expect("within reach");
            let way = theirs.point2 - theirs.point1;
            let excess = (way.length() - found).max(0.0);
            // The normal of a face may replace a direction that is better by a billionth of the size, which is 2 m.
            let bound = turned(found, excess) + turned(found, 2e-9);
            prop_assert!(excess < EXCESS && (way / way.length() - of(n)).length() < bound, "{n:?}, parry {way}");
        }
    }

    #[test]
    fn nearest_points_are_on_the_shapes_of_parry(a in shape(), pa in pose(), b in shape(), pb in pose()) {
        let (found, _) = distance(&a, &pa, &b, &pb);
        if found > 0.0 {
            // Two edges of boxes that are parallel within a hundredth have contacts at the ends of their overlapping part. A contact may
            // then be off its shapes by a hundredth of their size.
            let leaning = if let (ConvexShape::Box { half: x }, ConvexShape::Box { half: y }) = (&a, &b) { 1e-2 * norm(*x).max(norm(*y)) } else { 0.0 };
            let points = manifold(&a, &pa, &b, &pb, found + 1e-3).points;
            let nearest = points.iter().min_by(|p, q| p.distance.total_cmp(&q.distance)).expect("a contact within reach");
            // Faces are preferred to edges up to a millionth of the size, as in `convex.rs`.
            prop_assert!((nearest.distance - found).abs() < 1e-5 + 1e-2 * leaning, "{nearest:?}, {found} apart");
            let at = |x: f64| of(add_scaled(nearest.pos, nearest.normal, x * nearest.distance));
            for ((shape, pose), point) in [(in_parry(&a, &pa), at(-0.5)), (in_parry(&b, &pb), at(0.5))] {
                let off = shape.distance_to_point(&pose, point, true);
                prop_assert!(off < ON_SHAPE + leaning, "{off} m beside {:?}, {nearest:?}", shape.shape_type());
            }
        }
    }

    #[test]
    fn shallow_overlaps_are_as_deep_as_in_parry(a in shape(), pa in pose(), b in shape(), pb in pose()) {
        // The shapes are moved along the normal to a shallow overlap, because random poses rarely have one.
        let (depth, n) = distance(&a, &pa, &b, &pb);
        let pb = Pose { pos: add_scaled(pb.pos, n, -depth - 0.5 * DEEP * depth.abs().min(1.0)), ..pb };
        let (found, _) = distance(&a, &pa, &b, &pb);
        let ((ga, qa), (gb, qb)) = (in_parry(&a, &pa), in_parry(&b, &pb));
        let Some(theirs) = query::contact(&qa, &*ga, &qb, &*gb, 0.0).unwrap().filter(|_| found > -DEEP) else { return Ok(()) };
        prop_assert!(found < theirs.dist + ROUNDING, "{found}, parry {theirs:?}");
        let along = separation(&a, &pa, &b, &pb, theirs.normal1.to_array());
        // The tolerance is that of `convex.rs`. It exceeds the billionth of the size by which faces are preferred.
        prop_assert!(found > along - 1e-7, "{found}, {along} along the normal of {theirs:?}");
    }

    #[test]
    fn deep_overlaps_are_no_deeper_than_in_parry(a in shape(), pa in pose(), b in shape(), pb in pose()) {
        let (found, n) = distance(&a, &pa, &b, &pb);
        let ((ga, qa), (gb, qb)) = (in_parry(&a, &pa), in_parry(&b, &pb));
        let Some(theirs) = query::contact(&qa, &*ga, &qb, &*gb, 0.0).unwrap().filter(|_| found < -DEEP) else { return Ok(()) };
        let along = separation(&a, &pa, &b, &pb, theirs.normal1.to_array());
        // Depths that differ by 3e-8 of the size, 2 m, count as equal.
        prop_assert!(found > along - 1e-7, "{found} along {n:?}, {along} along the normal of {theirs:?}");
    }

    /// Contacts from the functions over lanes have the distance and normal that parry finds, for all shapes except ellipsoids.
    #[test]
    fn kernels_have_the_distance_and_normal_of_parry((a, b) in pair()) {
        let (Some((ga, pa)), Some((gb, pb))) = (body_in_parry(&a), body_in_parry(&b)) else { return Ok(()) };
        let nearest = contacts(&a, &b).into_iter().min_by(|p, q| p.distance.total_cmp(&q.distance)).expect("a pair has a contact");
        let theirs = query::contact(&pa, &*ga, &pb, &*gb, f64::MAX).unwrap().expect("within reach");
        let excess = theirs.dist - nearest.distance;
        prop_assert!(excess > -ROUNDING, "{nearest:?}, parry {theirs:?}");
        // Parry's normal must not have a smaller depth, because no direction has a larger separation than the contact normal. If points are
        // a nanometre apart, rounding rotates the normal between them by 1e-6, as in `is_distance`.
        let [along, other] = [nearest.normal, theirs.normal1.to_array()].map(|n| separation_along(&a, &b, n));
        prop_assert!(other < nearest.distance + ROUNDING && along > nearest.distance - 1e-6, "{nearest:?}, parry {theirs:?}");
        if nearest.distance > APART {
            prop_assert!(excess < EXCESS, "{nearest:?}, parry {theirs:?}");
            let bound = turned(nearest.distance, excess.max(0.0) + 1e-14); // rounding of lengths of 2 m
            prop_assert!((theirs.normal1 - of(nearest.normal)).length() < bound, "{nearest:?}, parry {theirs:?}");
        }
    }
}
