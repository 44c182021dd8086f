//! Tests of collisions of general convex shapes: comparison with a search over directions, and the symmetries that collisions must have.
//! PROPTEST_CASES=5000 tests more cases.

use std::sync::Arc;

use crate::shapes::{simple, unit, vector};
use proptest::prelude::*;
use stepper_geometry::linear_algebra::*;
use stepper_geometry::{ConvexShape, Hull, Manifold, Narrow, Pose, SearchLimits, Solid, distance};

type V = V3<f64>;

pub(crate) fn rotation() -> impl Strategy<Value = M3<f64>> {
    let aligned = Just([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    let tilted = (unit(), -1e-5..1e-5f64).prop_map(|(u, x)| axis_rotation(u, x.sin(), x.cos()));
    let any = (unit(), -3.1..3.1f64).prop_map(|(u, x)| axis_rotation(u, x.sin(), x.cos()));
    prop_oneof![1 => aligned, 1 => tilted, 4 => any]
}

pub(crate) fn pose() -> impl Strategy<Value = Pose> {
    (vector(0.9), rotation()).prop_map(|(pos, mat)| Pose { pos, mat })
}

pub(crate) fn size() -> impl Strategy<Value = f64> {
    prop_oneof![0.1..0.6f64, Just(0.3)]
}

pub(crate) fn hull() -> impl Strategy<Value = ConvexShape> {
    let few = prop::collection::vec(vector(0.5), 4..12);
    let many = prop::collection::vec(unit().prop_map(|u| scale(u, 0.4)), 60..80);
    prop_oneof![few, many]
        .prop_filter_map("has volume", |p| Hull::new(&p).ok().filter(|h| h.points().len() > 3).map(|h| ConvexShape::Hull(Arc::new(h))))
}

fn shape() -> impl Strategy<Value = ConvexShape> {
    prop_oneof![
        5 => simple(size),
        1 => hull(),
        1 => prop::array::uniform3(vector(0.6))
            .prop_filter("has area", |p| norm(cross(sub(p[1], p[0]), sub(p[2], p[0]))) > 0.05)
            .prop_map(ConvexShape::Triangle),
    ]
}

/// Support function of a shape: maximum of n . x over the shape's points x. The vector `n` and the points are in the shape's frame.
fn reach(shape: &ConvexShape, n: V) -> f64 {
    let points = |p: &[V]| p.iter().map(|x| dot(*x, n)).fold(f64::NEG_INFINITY, f64::max);
    match shape {
        ConvexShape::Sphere { radius } => *radius,
        ConvexShape::Capsule { radius, half_length } => radius + half_length * n[2].abs(),
        ConvexShape::Cylinder { radius, half_length } => radius * (n[0] * n[0] + n[1] * n[1]).sqrt() + half_length * n[2].abs(),
        ConvexShape::Ellipsoid { radii } => norm([radii[0] * n[0], radii[1] * n[1], radii[2] * n[2]]),
        ConvexShape::Box { half } => (0..3).map(|k| half[k] * n[k].abs()).sum(),
        ConvexShape::Hull(hull) => points(hull.points()),
        ConvexShape::Triangle(p) => points(p),
    }
}

/// Separation of two shapes along the unit vector `n` from the first to the second, m; negative if they overlap along it.
pub(crate) fn separation(a: &ConvexShape, pa: &Pose, b: &ConvexShape, pb: &Pose, n: V) -> f64 {
    let back = |p: &Pose, n: V| rotate_back(&p.mat, n);
    dot(n, sub(pb.pos, pa.pos)) - reach(a, back(pa, n)) - reach(b, scale(back(pb, n), -1.0))
}

/// Largest separation over all directions. The search tests a grid on the sphere, then refines the best directions with ever smaller steps.
fn by_search(a: &ConvexShape, pa: &Pose, b: &ConvexShape, pb: &Pose) -> f64 {
    let s = |n: V| separation(a, pa, b, pb, scale(n, 1.0 / norm(n)));
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let count = 600;
    let mut starts: Vec<V> = (0..count)
        .map(|k| {
            let z = 1.0 - (2 * k + 1) as f64 / count as f64;
            let r = (1.0 - z * z).sqrt();
            [r * (golden * k as f64).cos(), r * (golden * k as f64).sin(), z]
        })
        .collect();
    starts.sort_by(|x, y| s(*y).total_cmp(&s(*x)));
    let climb = |start: V| {
        let (mut n, mut best, mut step) = (start, s(start), 0.1);
        let mut turn: f64 = 0.3;
        while step > 1e-9 {
            let axes = stepper_geometry::linear_algebra::contact_frame(n);
            turn += 1.1;
            let tries = (0..8).map(|k| {
                let x = turn + std::f64::consts::FRAC_PI_4 * f64::from(k);
                let m = add_scaled(add_scaled(n, axes[1], step * x.cos()), axes[2], step * x.sin());
                scale(m, 1.0 / norm(m))
            });
            let m = tries.max_by(|x, y| s(*x).total_cmp(&s(*y))).unwrap();
            if s(m) > best { (n, best) = (m, s(m)) } else { step *= 0.7 }
        }
        best
    };
    starts[..12].iter().map(|&n| climb(n)).fold(f64::NEG_INFINITY, f64::max)
}

pub(crate) fn manifold(a: &ConvexShape, pa: &Pose, b: &ConvexShape, pb: &Pose, limits: impl Into<SearchLimits>) -> Manifold {
    let [a, b] = [a, b].map(|shape| Solid::Convex(shape.clone()));
    Narrow::default().collide([&a, &b], [*pa, *pb], limits).clone()
}

/// Smallest separation along face normals, m, at which a face still determines the normal of a contact whose edges have the separation
/// `depth`. Overlaps are negative.
///
/// Edges determine the normal if they overlap by less than 0.95 of the faces' overlap, see `boxes.rs`.
fn by_faces(depth: f64) -> f64 {
    depth.min(depth / 0.95)
}

/// Whether two boxes touch in a sliver only: a face of each is in the same plane, and another face separates the boxes up to an overlap
/// of 1e-5 m.
///
/// Such boxes have no contact, see `boxes.rs`.
fn graze([a, b]: [&ConvexShape; 2], [pa, pb]: [&Pose; 2]) -> bool {
    let axes = [pa, pb].map(|p| [0, 1, 2].map(|k| column(&p.mat, k)));
    let apart = |n: V| separation(a, pa, b, pb, n).max(separation(a, pa, b, pb, scale(n, -1.0)));
    let parallel = |n: V, m: V| norm(cross(n, m)) < 1.1e-4;
    let sliver = 1e-5 + 1e-12;
    let in_plane = axes[0].into_iter().filter(|&n| apart(n).abs() <= sliver && axes[1].iter().any(|&m| parallel(n, m)));
    in_plane.into_iter().any(|n| axes.iter().flatten().any(|&m| !parallel(n, m) && apart(m) >= -sliver))
}

proptest! {
    #[test]
    fn the_distance_is_the_largest_separation(a in shape(), pa in pose(), b in shape(), pb in pose()) {
        let (found, n) = distance(&a, &pa, &b, &pb);
        let best = by_search(&a, &pa, &b, &pb);
        prop_assert!((norm(n) - 1.0).abs() < 1e-12);
        // The distance is the separation along the reported normal. It is therefore never too large.
        prop_assert!((separation(&a, &pa, &b, &pb, n) - found).abs() < 1e-8, "{found} {}", separation(&a, &pa, &b, &pb, n));
        if best > -0.02 {
            prop_assert!(found > best - 1e-7, "{found}, search {best}");
        } else {
            // Deep overlaps have several local minima of the depth. The search finds one of the smaller ones.
            prop_assert!(found > best * 1.5 - 0.01, "{found}, search {best}");
        }
    }

    #[test]
    fn manifolds_hold_the_deepest_point(a in shape(), pa in pose(), b in shape(), pb in pose(), max_distance in 0.0..0.1f64) {
        let points = manifold(&a, &pa, &b, &pb, max_distance).points;
        let (depth, _) = distance(&a, &pa, &b, &pb);
        if depth < max_distance - 1e-6 {
            prop_assert!(!points.is_empty(), "overlapping by {depth}, yet no contact");
        }
        if depth > max_distance + 1e-6 {
            prop_assert!(points.is_empty(), "apart by {depth}, yet a contact at {max_distance}");
        }
        let nearest = points.iter().map(|p| p.distance).fold(f64::INFINITY, f64::min);
        if !points.is_empty() && depth > -0.02 {
            // Faces are preferred to edges if their depths differ by up to a millionth of the size, and for boxes by the rule of
            // [`by_faces`].
            let boxes = [&a, &b].iter().all(|s| matches!(s, ConvexShape::Box { .. }));
            let deepest = if boxes { by_faces(depth) } else { depth };
            prop_assert!(nearest > deepest - 1e-5 && nearest < depth + 1e-5, "{nearest} {depth}");
        }
        prop_assert!(points.windows(2).all(|w| w[0].feature < w[1].feature), "features are distinct");
        for p in &points {
            prop_assert!((norm(p.normal) - 1.0).abs() < 1e-12 && p.distance <= max_distance);
            // Along the normal, a contact point is outside each shape by at most half the distance.
            let beyond = |s: &ConvexShape, pose: &Pose, n: V| dot(n, sub(p.pos, pose.pos)) - reach(s, rotate_back(&pose.mat, n));
            prop_assert!(beyond(&a, &pa, p.normal) <= 0.5 * p.distance + 1e-9);
            prop_assert!(beyond(&b, &pb, scale(p.normal, -1.0)) <= 0.5 * p.distance + 1e-9);
        }
    }

    #[test]
    fn boxes_by_their_axes_agree_with_the_general_way(ha in prop::array::uniform3(size()), hb in prop::array::uniform3(size()),
                                                      towards in unit(), mat in rotation(), gap in -0.01..0.01f64) {
        let [a, b] = [ha, hb].map(|half| ConvexShape::Box { half });
        let still = Pose { pos: [0.0; 3], mat: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] };
        // The second box is moved along a line until the distance is about the gap.
        let reaches = reach(&a, towards) + reach(&b, rotate_back(&mat, scale(towards, -1.0)));
        let pose = Pose { pos: scale(towards, reaches + gap), mat };
        let (general, _) = distance(&a, &still, &b, &pose);
        let points = manifold(&a, &still, &b, &pose, 10.0).points;
        if points.is_empty() {
            // The largest distance exceeds that of the boxes. Only boxes that touch in a sliver may therefore have no contact.
            prop_assert!(graze([&a, &b], [&still, &pose]), "no contact, {general} apart");
            return Ok(());
        }
        let nearest = points.iter().map(|p| p.distance).fold(f64::INFINITY, f64::min);
        // Faces are preferred to edges up to a millionth of the size, and up to the rule of [`by_faces`]. For an overlap, the test of the
        // axes includes all directions, and the general search only some shallow ones.
        prop_assert!(nearest > by_faces(general) - 3e-6, "{nearest} {general}");
        // Edges that are almost parallel, and almost perpendicular to the normal (both within a hundredth), touch at the ends of their
        // overlapping part. These ends are away from the closest points, and lower in proportion to the slope of the edges.
        let beside = if general > 0.0 { 1e-4 * 2.0 * ha.into_iter().chain(hb).fold(0.0, f64::max) } else { 0.0 };
        prop_assert!(nearest < general + 3e-6 + beside || (general < -1e-3 && general > 2.0 * nearest), "{nearest} {general}");
        prop_assert!(points.len() <= 4);
    }

    #[test]
    fn boxes_face_to_face_touch_at_the_corners_of_what_they_share(slide in prop::array::uniform2(-0.15..0.15f64), turn in rotation(),
                                                                  at in vector(3.0), gap in -1e-3..1e-3f64) {
        let b = ConvexShape::Box { half: [0.2, 0.3, 0.1] };
        let below = Pose { pos: at, mat: turn };
        let above = Pose { pos: add(at, rotate(&turn, [slide[0], slide[1], 0.2 + gap])), mat: turn };
        let points = manifold(&b, &below, &b, &above, 0.01).points;
        prop_assert_eq!(points.len(), 4);
        for p in points {
            let local = rotate_back(&turn, sub(p.pos, at));
            let off = |k: usize, half: f64| (local[k] - 0.5 * slide[k]).abs() - (half - 0.5 * slide[k].abs());
            prop_assert!(off(0, 0.2).abs() < 1e-9 && off(1, 0.3).abs() < 1e-9 && (p.distance - gap).abs() < 1e-9, "{local:?}");
            prop_assert!(norm(sub(p.normal, column(&turn, 2))) < 1e-9);
        }
    }

    #[test]
    fn swapping_turns_the_normal(a in shape(), pa in pose(), b in shape(), pb in pose()) {
        let ((d, n), (e, m)) = (distance(&a, &pa, &b, &pb), distance(&b, &pb, &a, &pa));
        if d > -0.02 {
            prop_assert!((d - e).abs() < 1e-7, "{d} {e}");
        }
        if d > 0.01 {
            prop_assert!(norm(add(n, m)) < 1e-5, "{n:?} {m:?}");
        }
    }

    #[test]
    fn contacts_move_with_the_scene(a in shape(), pa in pose(), b in shape(), pb in pose(), shift in vector(10.0), turn in rotation()) {
        let moved = |p: &Pose| Pose { pos: add(rotate(&turn, p.pos), shift), mat: mat_mul(&turn, &p.mat) };
        let (d, n) = distance(&a, &pa, &b, &pb);
        let (e, m) = distance(&a, &moved(&pa), &b, &moved(&pb));
        if d > -0.02 {
            prop_assert!((d - e).abs() < 1e-8);
        }
        if d > 1e-3 {
            prop_assert!(norm(sub(rotate(&turn, n), m)) < 1e-5);
        }
    }
}
