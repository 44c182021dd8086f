//! Tests of the narrow phase against sampled points, and of the symmetries that it must have.

use proptest::prelude::*;

use stepper_geometry::linear_algebra::*;
use stepper_geometry::pairs::{Segment, plane_box, plane_sphere, segments};

fn vector(size: f64) -> impl Strategy<Value = V3<f64>> {
    prop::array::uniform3(-size..size)
}

fn unit() -> impl Strategy<Value = V3<f64>> {
    vector(1.0).prop_filter("a direction", |v| norm(*v) > 0.1).prop_map(|v| scale(v, 1.0 / norm(v)))
}

fn segment() -> impl Strategy<Value = Segment<f64>> {
    let half = prop_oneof![Just(0.0), 0.05..1.0];
    (vector(1.5), unit(), half, 0.05..0.3f64).prop_map(|(centre, axis, half_length, radius)| Segment { centre, axis, half_length, radius })
}

/// Distance of a point from a segment.
fn from_point(s: &Segment<f64>, p: V3<f64>) -> f64 {
    let along = dot(sub(p, s.centre), s.axis).clamp(-s.half_length, s.half_length);
    norm(sub(p, add_scaled(s.centre, s.axis, along)))
}

/// Distance of two segments by golden-section search along the first one. The search finds the minimum, because the distance from a convex
/// set is a convex function.
fn by_search(a: &Segment<f64>, b: &Segment<f64>) -> f64 {
    let (mut lo, mut hi) = (-a.half_length, a.half_length);
    let at = |x: f64| from_point(b, add_scaled(a.centre, a.axis, x));
    for _ in 0..200 {
        let (x, y) = (lo + (hi - lo) * 0.382, lo + (hi - lo) * 0.618);
        if at(x) < at(y) { hi = y } else { lo = x }
    }
    at(0.5 * (lo + hi)) - a.radius - b.radius
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn capsules_are_as_far_apart_as_a_search_finds(a in segment(), b in segment()) {
        let (points, two) = segments(&a, &b);
        let nearest = if two { points[0].distance.min(points[1].distance) } else { points[0].distance };
        // The position of a minimum is accurate to the square root of the rounding error, and its value to the rounding error. Capsules
        // within 0.06 degrees of parallel count as parallel, which changes the distance by the square of that angle.
        prop_assert!((nearest - by_search(&a, &b)).abs() < 2e-6, "{nearest}, search {}", by_search(&a, &b));
        for point in &points[..1 + usize::from(two)] {
            prop_assert!((norm(point.normal) - 1.0).abs() < 1e-12);
            // The position is halfway: as deep in one surface as in the other.
            let (da, db) = (from_point(&a, point.pos) - a.radius, from_point(&b, point.pos) - b.radius);
            if !two && point.distance > -2.0 * a.radius.min(b.radius) {
                prop_assert!((da - 0.5 * point.distance).abs() < 1e-9 && (db - 0.5 * point.distance).abs() < 1e-9, "{da} {db} {}", point.distance);
            }
        }
    }

    #[test]
    fn swapping_capsules_turns_the_normal(a in segment(), b in segment()) {
        let (ab, two) = segments(&a, &b);
        let (ba, two_back) = segments(&b, &a);
        prop_assert_eq!(two, two_back);
        if !two {
            // The tolerances are the rounding error over the sine of the angle between the axes, which is above 1e-3 here.
            prop_assert!((ab[0].distance - ba[0].distance).abs() < 1e-9);
            let determinant = 1.0 - dot(a.axis, b.axis).powi(2);
            if norm(sub(a.centre, b.centre)) > 0.1 && determinant > 1e-2 && (ab[0].distance + a.radius + b.radius) > 1e-3 {
                prop_assert!(norm(add(ab[0].normal, ba[0].normal)) < 1e-6 && norm(sub(ab[0].pos, ba[0].pos)) < 1e-6);
            }
        }
    }

    #[test]
    fn contacts_move_with_the_scene(a in segment(), b in segment(), shift in vector(10.0), turn in unit(), angle in -3.0..3.0f64) {
        let m = axis_rotation(turn, angle.sin(), angle.cos());
        let moved = |s: &Segment<f64>| Segment { centre: add(rotate(&m, s.centre), shift), axis: rotate(&m, s.axis), ..*s };
        let ((here, _), (there, _)) = (segments(&a, &b), segments(&moved(&a), &moved(&b)));
        prop_assert!((here[0].distance - there[0].distance).abs() < 1e-9);
    }

    #[test]
    fn parallel_capsules_touch_at_both_ends_of_their_overlap(axis in unit(), offset in 0.1..0.5f64, slide in -1.0..1.0f64) {
        let [_, side, _] = contact_frame(axis);
        let a = Segment { centre: [0.0; 3], axis, half_length: 0.6, radius: 0.1 };
        let b = Segment { centre: add(scale(side, offset), scale(axis, slide)), axis: scale(axis, -1.0), half_length: 0.5, radius: 0.1 };
        let (points, two) = segments(&a, &b);
        prop_assert!(two);
        let ends = points.map(|p| dot(p.pos, axis));
        prop_assert!((ends[0] - (slide - 0.5).max(-0.6)).abs() < 1e-9 && (ends[1] - (slide + 0.5).min(0.6)).abs() < 1e-9);
        prop_assert!(points.iter().all(|p| (p.distance - (offset - 0.2)).abs() < 1e-9 && norm(sub(p.normal, side)) < 1e-6));
    }

    #[test]
    fn planes_see_the_deepest_point(origin in vector(2.0), normal in unit(), centre in vector(2.0), half in prop::array::uniform3(0.05..1.0f64),
                                    turn in unit(), angle in -3.0..3.0f64) {
        let mat = axis_rotation(turn, angle.sin(), angle.cos());
        let corners: Vec<_> = (0..8).map(|k| plane_box(origin, normal, centre, &mat, half, k)).collect();
        // Lowest point of the box, from its support function.
        let local = rotate_back(&mat, normal);
        let deepest = dot(normal, sub(centre, origin)) - (0..3).map(|k| half[k] * local[k].abs()).sum::<f64>();
        let found = corners.iter().map(|c| c.distance).fold(f64::INFINITY, f64::min);
        prop_assert!((found - deepest).abs() < 1e-12);
        for c in &corners {
            prop_assert!((dot(normal, sub(c.pos, origin)) - 0.5 * c.distance).abs() < 1e-12);
        }
        let ball = plane_sphere(origin, normal, centre, half[0]);
        prop_assert!((ball.distance - (dot(normal, sub(centre, origin)) - half[0])).abs() < 1e-12);
    }

    #[test]
    fn frames_are_right_handed(n in unit()) {
        let [a, b, c] = contact_frame(n);
        prop_assert!(dot(a, b).abs() < 1e-12 && dot(a, c).abs() < 1e-12 && dot(b, c).abs() < 1e-12);
        prop_assert!(norm(sub(cross(a, b), c)) < 1e-12 && (norm(b) - 1.0).abs() < 1e-12);
    }
}

#[test]
fn centres_that_coincide_still_get_a_normal() {
    let s = Segment { centre: [1.0, 2.0, 3.0], axis: [0.0, 0.0, 1.0], half_length: 0.0, radius: 0.5_f64 };
    let (points, two) = segments(&s, &s);
    assert!(!two);
    assert_eq!((points[0].distance, norm(points[0].normal)), (-1.0, 1.0));
}
