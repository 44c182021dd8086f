//! Tests of every pair of simple shapes against the definition of distance, and of the symmetries that contacts must have.

use crate::shapes::{Body, ball, capsule, cases, cuboid, cylinder, ellipsoid, is_distance, turn, unit, vector};
use proptest::prelude::*;
use stepper_geometry::linear_algebra::*;
use stepper_geometry::pairs::ContactPoint;
use stepper_geometry::pairs::{
    capsule_box, cylinder_rims, face_clearance, plane_ellipsoid, plane_sphere, segments, sphere_box, sphere_cylinder, sphere_ellipsoid,
};

/// Contacts of two bodies, from the contact function for their pair of shapes.
pub(crate) fn contacts(a: &Body, b: &Body) -> Vec<ContactPoint<f64>> {
    let present = |points: [ContactPoint<f64>; 2], exist: [bool; 2]| points.into_iter().zip(exist).filter(|x| x.1).map(|x| x.0).collect();
    match (a, b) {
        (Body::HalfSpace { origin, normal }, Body::Cylinder(c)) => {
            cylinder_rims(*normal, [0.0; 3], c).into_iter().map(|p| plane_sphere(*origin, *normal, p, 0.0)).collect()
        }
        (Body::HalfSpace { origin, normal }, Body::Ellipsoid(e)) => vec![plane_ellipsoid(*origin, *normal, e)],
        (Body::Capsule(s), Body::Cuboid(c)) if s.half_length == 0.0 => vec![sphere_box(s.centre, s.radius, c)],
        (Body::Capsule(s), Body::Cuboid(c)) => {
            let (points, exist) = capsule_box(s, c);
            present(points, exist)
        }
        (Body::Capsule(s), Body::Cylinder(c)) => vec![sphere_cylinder(s.centre, s.radius, c)],
        (Body::Capsule(s), Body::Ellipsoid(e)) => vec![sphere_ellipsoid(s.centre, s.radius, e)],
        (Body::Capsule(s), Body::Capsule(t)) => {
            let (points, two) = segments(s, t);
            present(points, [true, two])
        }
        _ => unreachable!("no kernel"),
    }
}

fn half_space() -> impl Strategy<Value = Body> {
    (vector(0.5), turn()).prop_map(|(origin, mat)| Body::HalfSpace { origin, normal: column(&mat, 2) })
}

/// Random pairs of bodies whose shapes have a contact function over lanes.
pub(crate) fn pair() -> impl Strategy<Value = (Body, Body)> {
    prop_oneof![
        1 => (half_space(), cylinder().prop_map(Body::Cylinder)),
        1 => (half_space(), ellipsoid().prop_map(Body::Ellipsoid)),
        1 => (ball().prop_map(Body::Capsule), cuboid().prop_map(Body::Cuboid)),
        1 => (ball().prop_map(Body::Capsule), cylinder().prop_map(Body::Cylinder)),
        2 => (ball().prop_map(Body::Capsule), ellipsoid().prop_map(Body::Ellipsoid)),
        3 => (capsule().prop_map(Body::Capsule), cuboid().prop_map(Body::Cuboid)),
    ]
}

proptest! {
    #![proptest_config(cases(4000))]

    #[test]
    fn distances_are_the_least_translations((a, b) in pair(), starts in prop::collection::vec(unit(), 4)) {
        is_distance(&a, &b, &contacts(&a, &b), &starts)?;
    }

    /// A point above a face of a box stays above it while it moves along the face by less than the clearance. At the clearance it reaches
    /// the border of the face.
    #[test]
    fn a_point_stays_over_a_face_until_it_has_moved_by_the_clearance(b in cuboid(), at in vector(1.0), u in unit(), share in 0.0..1.0f64) {
        let clearance = face_clearance(at, &b);
        let x = rotate_back(&b.mat, sub(at, b.centre));
        let beyond: Vec<usize> = (0..3).filter(|&k| x[k].abs() > b.half[k]).collect();
        prop_assert_eq!(clearance > 0.0, beyond.len() == 1 && (0..3).all(|k| x[k].abs() != b.half[k]));
        if clearance <= 0.0 {
            return Ok(());
        }
        let normal = scale(column(&b.mat, beyond[0]), x[beyond[0]].signum());
        let along = add_scaled(u, normal, -dot(u, normal));
        if norm(along) < 1e-3 {
            return Ok(());
        }
        let moved = add_scaled(at, along, share * clearance / norm(along));
        let height = |at: V3<f64>| sphere_box(at, 0.0, &b).distance;
        // The tolerance is the rounding error of coordinates up to 2 m.
        prop_assert!((height(moved) - height(at)).abs() < 1e-12);
    }

    /// The smallest distance of the contacts does not change if both bodies are rotated and moved together, up to rounding.
    #[test]
    fn contacts_move_with_the_scene((a, b) in pair(), turn in turn(), shift in vector(10.0)) {
        let nearest = |found: Vec<ContactPoint<f64>>| found.into_iter().map(|c| c.distance).fold(f64::INFINITY, f64::min);
        let (here, there) = (nearest(contacts(&a, &b)), nearest(contacts(&a.moved(&turn, shift), &b.moved(&turn, shift))));
        prop_assert!((here - there).abs() < 1e-12, "{here} {there}");
    }

    /// A capsule that lies on a face, or along an edge, has contacts at both ends of the part that lies there.
    #[test]
    fn lying_capsules_have_two_contacts(b in cuboid(), along in 0..3usize, tilt in prop_oneof![Just(0.0), -1e-3..1e-3f64],
                                        spot in vector(0.9), radius in 0.02..0.2f64, half_length in 0.05..1.0f64, gap in -0.01..0.01f64) {
        let (i, k) = (along, (along + 1) % 3);
        let (sin, cos) = f64::sin_cos(tilt);
        let (mut p, mut d) = ([0.0; 3], [0.0; 3]);
        for m in 0..3 {
            p[m] = spot[m] * b.half[m];
        }
        p[k] = b.half[k] + radius + gap + half_length * sin.abs();
        (d[i], d[k]) = (cos, sin);
        let capsule = stepper_geometry::pairs::Segment {
            centre: add(b.centre, rotate(&b.mat, p)), axis: rotate(&b.mat, d), half_length, radius,
        };
        let (points, exist) = capsule_box(&capsule, &b);
        prop_assert_eq!(exist, [true, true]);
        let ends = points.map(|c| dot(sub(c.pos, capsule.centre), capsule.axis));
        let expected = [(-b.half[i] - p[i]).max(-half_length), (b.half[i] - p[i]).min(half_length)];
        // A tilt of a thousandth moves the contact by a thousandth of the radius.
        for (found, expected) in ends.into_iter().zip(expected) {
            prop_assert!((found - expected).abs() < 2.0 * sin.abs() * (radius + half_length) + 1e-9, "{ends:?} {expected:?}");
        }
        let lowest = points[0].distance.min(points[1].distance);
        let reach = if sin > 0.0 { half_length + expected[0] } else { half_length - expected[1] };
        prop_assert!((lowest - gap - reach * sin.abs()).abs() < 2.0 * sin * sin * (radius + half_length) + 1e-12, "{lowest} {gap}");
    }
}
