//! Tests of the contacts of convex hulls. The separation along the contact normal must be the largest over all facets' normals, and a
//! cached normal of the previous step must not change any result.

use std::sync::Arc;

use crate::convex::manifold;
use crate::shapes::{unit, vector};
use proptest::prelude::*;
use stepper_geometry::linear_algebra::*;
use stepper_geometry::{
    Approach, CachedNormal, ConvexShape, Hull, HullError, Manifold, Point, Pose, SearchLimits, SeparatingPlane, SeparatingPlanes, distance,
};

type V = V3<f64>;

fn rotation() -> impl Strategy<Value = M3<f64>> {
    let aligned = Just([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    let any = (unit(), -3.1..3.1f64).prop_map(|(u, x)| axis_rotation(u, x.sin(), x.cos()));
    prop_oneof![1 => aligned, 4 => any]
}

/// Random hulls: a few corners in a cube, many corners on a ball (a fine mesh), or a box (faces with four corners).
fn hull() -> impl Strategy<Value = Arc<Hull>> {
    let few = prop::collection::vec(vector(0.5), 4..12);
    let many = prop::collection::vec(unit().prop_map(|u| scale(u, 0.4)), 50..70);
    let cuboid = prop::array::uniform3(0.1..0.5f64).prop_map(|half| {
        let corner = |i: usize| std::array::from_fn(|k| if i >> k & 1 == 1 { half[k] } else { -half[k] });
        (0..8).map(corner).collect()
    });
    prop_oneof![few, many, cuboid]
        .prop_filter_map("has volume", |p: Vec<V>| Hull::new(&p).ok().filter(|h| h.points().len() > 3).map(Arc::new))
}

/// First shape of a pair: a hull, or a box together with the hull of its corners.
fn first_shape() -> impl Strategy<Value = (ConvexShape, Arc<Hull>)> {
    let cuboid = prop::array::uniform3(0.1..0.5f64).prop_map(|half| {
        let corners: Vec<V> = (0..8).map(|i| std::array::from_fn(|k| if i >> k & 1 == 1 { half[k] } else { -half[k] })).collect();
        (ConvexShape::Box { half }, Arc::new(Hull::new(&corners).expect("a box has volume")))
    });
    prop_oneof![2 => hull().prop_map(|hull| (ConvexShape::Hull(hull.clone()), hull)), 1 => cuboid]
}

/// Half sizes of a box, m; zeros for a hull.
fn half_of(shape: &ConvexShape) -> V {
    if let ConvexShape::Box { half } = *shape { half } else { [0.0; 3] }
}

fn reach(hull: &Hull, n: V) -> f64 {
    hull.points().iter().map(|p| dot(*p, n)).fold(f64::NEG_INFINITY, f64::max)
}

/// Maximum of n . x over all points x of the hull at its pose, in the world frame.
fn posed_reach(hull: &Hull, pose: &Pose, n: V) -> f64 {
    dot(n, pose.pos) + reach(hull, rotate_back(&pose.mat, n))
}

fn edges(hull: &Hull, pose: &Pose) -> Vec<V> {
    let edge = |[v, w]: [u32; 2]| rotate(&pose.mat, sub(hull.points()[w as usize], hull.points()[v as usize]));
    let around = hull.triangles().iter().flat_map(|t| (0..3).map(|k| [t[k], t[(k + 1) % 3]]));
    around.filter(|[v, w]| v < w).map(edge).collect()
}

/// Largest separation of two hulls along all normals that a facet of their Minkowski difference can have. For overlapping hulls it is minus
/// the penetration depth.
fn over_all_facets(a: &Hull, pa: &Pose, b: &Hull, pb: &Pose) -> f64 {
    let separation = |n: V| -posed_reach(a, pa, n) - posed_reach(b, pb, scale(n, -1.0));
    let faces = |hull: &Hull, pose: &Pose| {
        hull.triangles()
            .iter()
            .map(|t| {
                let [p, q, r] = t.map(|v| hull.points()[v as usize]);
                rotate(&pose.mat, cross(sub(q, p), sub(r, p)))
            })
            .collect::<Vec<V>>()
    };
    let (first, second) = (edges(a, pa), edges(b, pb));
    let across = first.iter().flat_map(|u| second.iter().map(|v| cross(*u, *v)));
    let of_first = faces(a, pa).into_iter();
    let of_second = faces(b, pb).into_iter().map(|n| scale(n, -1.0));
    let all = of_first.chain(of_second).chain(across.flat_map(|n| [n, scale(n, -1.0)]));
    all.filter(|n| norm(*n) > 1e-9).map(|n| separation(scale(n, 1.0 / norm(n)))).fold(f64::NEG_INFINITY, f64::max)
}

const PREDICTION: f64 = 0.02;

fn meet(a: &ConvexShape, pa: &Pose, b: &ConvexShape, pb: &Pose, known: Option<CachedNormal>, approach: Option<Approach>) -> Manifold {
    manifold(a, pa, b, pb, SearchLimits { cached: known, approach, ..PREDICTION.into() })
}

/// Contact points of two hulls. `known` is the contact normal of the previous step in world axes; `None` searches without it. `approach`
/// is the relative motion of the hulls, if they move.
fn contacts(a: &ConvexShape, pa: &Pose, b: &ConvexShape, pb: &Pose, known: Option<V>, approach: Option<Approach>) -> Vec<Point> {
    meet(a, pa, b, pb, known.map(|n| rotate_back(&pa.mat, n).into()), approach).points
}

/// Pose after a translation by `way`, m, and a rotation by the rotation vector `turn`, rad.
fn moved(pose: &Pose, way: V, turn: V) -> Pose {
    let angle = norm(turn);
    let mat = if angle > 0.0 { mat_mul(&axis_rotation(scale(turn, 1.0 / angle), angle.sin(), angle.cos()), &pose.mat) } else { pose.mat };
    Pose { pos: add(pose.pos, way), mat }
}

/// Whether the separating plane proves that two solids have no contact that can push within the step. `half` are the half sizes of the
/// first if it is a box, and `size` is the sum of their bounding radii, m.
fn are_parted(plane: &SeparatingPlane, half: V, [pa, pb]: [&Pose; 2], approach: &Approach, size: f64) -> bool {
    let mut partings = SeparatingPlanes::<f64>::none();
    partings.set_lane(0, plane);
    partings.separated_lanes(half, sub(pb.pos, pa.pos), [&pa.mat, &pb.mat], approach, size)
}

/// Size of two hulls, m: the sum of their bounding radii around their centres.
fn size(a: &Hull, b: &Hull) -> f64 {
    [a, b].iter().map(|h| h.points().iter().map(|p| norm(sub(*p, h.centre()))).fold(0.0, f64::max)).sum()
}

/// Poses of two hulls with the distance `gap`, m, and the unit normal between them. The second hull is roughly in the direction `towards`.
fn beside(a: &ConvexShape, ma: M3<f64>, b: &ConvexShape, mb: M3<f64>, towards: V, gap: f64) -> (Pose, Pose, V) {
    let (pa, far) = (Pose { pos: [0.1, -0.2, 0.3], mat: ma }, Pose { pos: scale(towards, 3.0), mat: mb });
    let (apart, n) = distance(a, &pa, b, &far);
    (pa, Pose { pos: add_scaled(far.pos, n, gap - apart), ..far }, n)
}

/// All numbers of some points, as bits.
fn bits(points: &[Point]) -> Vec<[u64; 8]> {
    let numbers = |p: &Point| [p.pos[0], p.pos[1], p.pos[2], p.normal[0], p.normal[1], p.normal[2], p.distance].map(f64::to_bits);
    points.iter().map(|p| std::array::from_fn(|i| numbers(p).get(i).copied().unwrap_or(p.feature.into()))).collect()
}

proptest! {
    #[test]
    fn the_depth_is_the_least_over_all_facets((first, a) in first_shape(), ma in rotation(), b in hull(), at in vector(0.5), mb in rotation()) {
        let (pa, pb) = (Pose { pos: [0.0; 3], mat: ma }, Pose { pos: at, mat: mb });
        let best = over_all_facets(&a, &pa, &b, &pb);
        if best >= 0.0 {
            return Ok(());
        }
        let (found, n) = distance(&first, &pa, &ConvexShape::Hull(b.clone()), &pb);
        // The normal of a face replaces one that is better by up to a billionth of the size, which is 2 m at most.
        prop_assert!((found - best).abs() < 2e-9, "{found}, over all facets {best}");
        let along = -posed_reach(&a, &pa, n) - posed_reach(&b, &pb, scale(n, -1.0));
        prop_assert!((found - along).abs() < 1e-12, "{found}, along its normal {along}");
    }

    #[test]
    fn supports_are_the_furthest_points(a in hull(), d in vector(1.0)) {
        let shape = ConvexShape::Hull(a.clone());
        prop_assert!(dot(shape.support(d), d) > reach(&a, d) - 1e-15);
    }

    #[test]
    fn a_known_normal_changes_no_bit((first, _) in first_shape(), ma in rotation(), b in hull(), towards in unit(), mb in rotation(),
                                     gap in prop_oneof![-0.03..0.02f64, -1e-4..1e-4f64, Just(0.0)], tilt in vector(0.02)) {
        let second = ConvexShape::Hull(b.clone());
        let (pa, pb, n) = beside(&first, ma, &second, mb, towards, gap);
        let scratch = contacts(&first, &pa, &second, &pb, None, None);
        for near in [n, add(n, tilt), towards, scale(n, -1.0)] {
            let known = Some(scale(near, 1.0 / norm(near)));
            prop_assert_eq!(bits(&contacts(&first, &pa, &second, &pb, known, None)), bits(&scratch));
        }
        for p in &scratch {
            prop_assert_eq!(bits(&contacts(&first, &pa, &second, &pb, Some(p.normal), None)), bits(&scratch));
        }
    }

    #[test]
    fn what_is_known_from_the_last_step_changes_no_bit((first, _) in first_shape(), ma in rotation(), b in hull(), towards in unit(), mb in rotation(),
                                                       gap in prop_oneof![-0.03..0.02f64, -1e-4..1e-4f64, Just(0.0)],
                                                       way in vector(1.0), turn in vector(1.0), speed in -6.0..-1.0f64) {
        let second = ConvexShape::Hull(b);
        let (pa, pb, _) = beside(&first, ma, &second, mb, towards, gap);
        let (mut known, mut pb) = (None, pb);
        for _ in 0..3 {
            let scratch = meet(&first, &pa, &second, &pb, None, None);
            let found = meet(&first, &pa, &second, &pb, known, None);
            prop_assert_eq!(bits(&found.points), bits(&scratch.points));
            known = found.separating_plane.map(|p| p.cached_normal());
            pb = moved(&pb, scale(way, 10f64.powf(speed)), scale(turn, 10f64.powf(speed)));
        }
    }

    #[test]
    fn what_parts_hulls_parts_them_wherever_they_go((first, a) in first_shape(), ma in rotation(), b in hull(), mb in rotation(), towards in unit(),
                                                    gap in prop_oneof![1e-5..0.02f64, 1e-5..1e-3f64], way in vector(1.0), turn in vector(1.0),
                                                    speed in -5.0..-1.0f64, hurry in -7.0..-3.0f64, growth in prop_oneof![Just(1.0), 0.8..1.2f64]) {
        let second = ConvexShape::Hull(b.clone());
        let (pa, pb, _) = beside(&first, ma, &second, mb, towards, gap);
        let still = Approach { displacement: [0.0; 3], rotation: [0.0; 3], radius: 1.0, slack: 0.1 * gap };
        let fast = Approach { displacement: scale(way, 10f64.powf(hurry)), ..still };
        let (half, size) = (half_of(&first), size(&a, &b));
        for approach in [still, fast] {
            let separating_plane = meet(&first, &pa, &second, &pb, None, Some(approach)).separating_plane.expect("they are near");
            if norm(approach.displacement) == 0.0 && gap > 1e-3 * size {
                prop_assert!(are_parted(&separating_plane, half, [&pa, &pb], &Approach { slack: 0.5 * gap, ..still }, size), "not even where they were");
            }
            // A box may have another size in the next step.
            let (grown, resized) = match first {
                ConvexShape::Box { half } => (scale(half, growth), ConvexShape::Box { half: scale(half, growth) }),
                _ => (half, first.clone()),
            };
            for away in [0.0, 0.3, 1.0] {
                let pb = moved(&pb, scale(way, away * 10f64.powf(speed)), scale(turn, away * 10f64.powf(speed)));
                let (distance, _) = distance(&resized, &pa, &second, &pb);
                for share in [0.9, 1.0 - 1e-4, 1.0 + 1e-9, 1.1] {
                    let nearest = Approach { slack: distance.max(0.0) * share, ..still };
                    prop_assert!(!are_parted(&separating_plane, grown, [&pa, &pb], &nearest, size) || distance > nearest.slack, "{distance} at {share}");
                }
            }
        }
    }

    /// No contact is missing that stage 3 of the step would accept. Stage 3 accepts contacts that are closer than the slack plus the
    /// distance that the bodies close in two steps.
    #[test]
    fn only_contacts_that_do_not_count_are_left_out((first, _) in first_shape(), ma in rotation(), b in hull(), mb in rotation(), towards in unit(),
                                                    gap in prop_oneof![1e-5..0.02f64, 1e-5..1e-3f64], way in vector(1.0), turn in vector(1.0),
                                                    speed in -5.0..-2.0f64, worst in prop_oneof![Just(0.0), 0.8..1.2f64], tilt in vector(0.5),
                                                    slack in 1e-6..1e-3f64) {
        let second = ConvexShape::Hull(b.clone());
        let (pa, pb, n) = beside(&first, ma, &second, mb, towards, gap);
        let tilted = add(n, tilt);
        let tilted = scale(tilted, 1.0 / norm(tilted));
        let (way, turn) = if worst > 0.0 {
            // Displacement for which the bound along the tilted normal is tightest: the contact normal halves the angle between both.
            let cos = dot(n, tilted);
            let closing = (gap - slack).max(0.0) * worst / (2.0 * cos.max(0.1));
            (scale(sub(tilted, scale(n, 2.0 * cos)), closing), [0.0; 3])
        } else {
            (scale(way, 10f64.powf(speed)), scale(turn, 10f64.powf(speed)))
        };
        let radius = b.points().iter().map(|p| norm(*p)).fold(0.0, f64::max) + 0.5 * PREDICTION;
        let seen = |x: V| rotate_back(&pa.mat, x);
        let approach = Some(Approach { displacement: seen(way), rotation: seen(turn), radius, slack });
        let all = contacts(&first, &pa, &second, &pb, None, None);
        let counts = |p: &&Point| {
            let motion = add(way, cross(turn, sub(p.pos, pb.pos)));
            p.distance < 2.0 * (-dot(p.normal, motion)).max(0.0) + slack
        };
        for known in [None, Some(n), Some(tilted), Some(towards)] {
            let kept = contacts(&first, &pa, &second, &pb, known.map(|n| scale(n, 1.0 / norm(n))), approach);
            if kept.is_empty() {
                prop_assert!(all.iter().find(counts).is_none(), "left out: {:?}", all.iter().find(counts));
            } else {
                prop_assert_eq!(bits(&kept), bits(&all));
            }
        }
    }
}

/// Random points of one type, before they are scaled. The types are points in a cube, points on a ball, points of a coarse lattice (many on
/// one plane or line, some twice), and points in single precision.
fn cloud() -> impl Strategy<Value = Vec<V>> {
    let anywhere = prop::collection::vec(vector(1.0), 8..200);
    let on_ball = prop::collection::vec(unit(), 8..200);
    let lattice = prop::collection::vec(prop::array::uniform3(-3..=3i32).prop_map(|p| p.map(f64::from)), 20..200);
    let single = prop::collection::vec(vector(1.0).prop_map(|p| p.map(|x| f64::from((x * 8.0).round() as f32 / 8.0))), 30..200);
    prop_oneof![anywhere, on_ball, lattice, single]
}

/// Whether the triangles of a hull are a closed surface of one piece and without holes.
fn is_closed(hull: &Hull) -> bool {
    let edges: std::collections::BTreeSet<(u32, u32)> =
        hull.triangles().iter().flat_map(|t| (0..3).map(move |k| (t[k], t[(k + 1) % 3]))).collect();
    let twice = edges.iter().all(|&(a, b)| edges.contains(&(b, a))) && edges.len() == 3 * hull.triangles().len();
    twice && hull.points().len() + hull.triangles().len() == edges.len() / 2 + 2
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn points_of_any_thickness_have_a_hull(cloud in cloud(), thin in prop::array::uniform3(prop_oneof![2 => Just(0.0), 3 => -11.0..0.0f64]),
                                           mat in rotation(), size in -4.0..3.0f64, at in prop_oneof![Just(0.0), Just(3.0)]) {
        let size = 10f64.powf(size);
        let scales = thin.map(|x| size * 10f64.powf(x));
        // Points on one plane before the scaling have no hull.
        let Ok(unscaled) = Hull::new(&cloud) else { return Ok(()) };
        let depth = |n: V, on: V| cloud.iter().map(|p| dot(n, sub(on, *p))).fold(0.0, f64::max);
        let width = unscaled.faces().iter().map(|f| depth(f.normal, unscaled.points()[f.vertices[0] as usize])).fold(f64::INFINITY, f64::min);
        let least = scales.into_iter().fold(f64::INFINITY, f64::min) * width;
        let points: Vec<V> = cloud.iter().map(|p| {
            let p = rotate(&mat, std::array::from_fn(|k| p[k] * scales[k]));
            p.map(|x| x + at * size)
        }).collect();
        let most = points.iter().flatten().fold(0.0, |most: f64, x| most.max(x.abs()));
        // Thinner sets of points may count as being on one plane.
        prop_assume!(least > 1e-12 * most);
        let hull = Hull::new(&points).unwrap();
        prop_assert!(is_closed(&hull), "not a closed surface");
        prop_assert!(hull.points().iter().all(|p| points.contains(p)), "a corner that nobody gave");
        // Faces are flat within a thousandth of the thickness, and within a millionth of the size.
        let rounding = 1e-14 * most;
        let flat = (2e-3 * least * 3.0).min(4e-6 * most) + rounding;
        for face in hull.faces() {
            let on = hull.points()[face.vertices[0] as usize];
            let furthest = points.iter().map(|p| dot(face.normal, sub(*p, on))).fold(f64::NEG_INFINITY, f64::max);
            // The plane through three points is inexact if they are nearly on a line.
            let of = |k: usize| hull.points()[face.vertices[k] as usize];
            let n = face.vertices.len();
            let (mut area, mut longest) = ([0.0; 3], 0.0f64);
            for k in 0..n {
                area = add(area, cross(sub(of(k), on), sub(of((k + 1) % n), on)));
                longest = longest.max(norm(sub(of(k), of((k + 1) % n))));
            }
            let flat = flat + rounding * (1.0 + most * longest / norm(area));
            prop_assert!(furthest <= flat, "{furthest} outside of a face, {flat} would do");
        }
        // The hull extends as far as the points in every direction.
        let shape = ConvexShape::Hull(Arc::new(hull.clone()));
        for p in points.iter().filter(|p| norm(sub(**p, hull.centre())) > 0.0).take(10) {
            let d = sub(*p, hull.centre());
            let d = scale(d, 1.0 / norm(d));
            let furthest = points.iter().map(|p| dot(d, *p)).fold(f64::NEG_INFINITY, f64::max);
            let reach = dot(d, shape.support(d));
            prop_assert!((furthest - reach).abs() <= rounding, "{furthest} {reach}");
        }
    }

    #[test]
    fn thin_hulls_touch_a_ball_where_they_are_nearest(cloud in prop::collection::vec(vector(1.0), 8..60), thin in -9.0..0.0f64, mat in rotation(),
                                                      towards in unit(), gap in 0.001..0.01f64) {
        let points: Vec<V> = cloud.iter().map(|p| rotate(&mat, [p[0], p[1], p[2] * 10f64.powf(thin)])).collect();
        let hull = Arc::new(Hull::new(&points).unwrap());
        let ball = ConvexShape::Sphere { radius: 0.1 };
        let still = Pose { pos: [0.0; 3], mat: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] };
        let far = Pose { pos: scale(towards, 3.0), ..still };
        let (apart, n) = distance(&ConvexShape::Hull(hull.clone()), &still, &ball, &far);
        let pose = Pose { pos: add_scaled(far.pos, n, gap - apart), ..far };
        let found = contacts(&ConvexShape::Hull(hull.clone()), &still, &ball, &pose, None, None);
        prop_assert_eq!(found.len(), 1);
        // The plane at the contact has the whole hull behind it and the ball in front of it, so that no point of the hull is closer. A
        // face's normal replaces a direction that separates better by at most 1e-9 of the size (at most 2 sqrt(3) m). Triangles on one
        // plane within a thousandth of the thickness, and a millionth of the size, are one face.
        let p = &found[0];
        let size = 2.0 * 3f64.sqrt();
        let rounding = 1e-9 * size + (1e-3 * 2.0 * 10f64.powf(thin)).min(1e-6 * size);
        prop_assert!((p.distance - gap).abs() < rounding, "{} {gap}", p.distance);
        let behind = points.iter().map(|x| dot(p.normal, sub(*x, pose.pos))).fold(f64::NEG_INFINITY, f64::max);
        prop_assert!((behind + 0.1 + gap).abs() < rounding, "{behind}");
    }
}

#[test]
fn what_is_on_one_plane_up_to_rounding_has_no_hull() {
    let turn = axis_rotation([0.6, 0.0, 0.8], 1f64.sin(), 1f64.cos());
    let flat: Vec<V> = (0..50).map(|k| rotate(&turn, [f64::from(k).sin(), f64::from(k * k).cos(), 0.0])).collect();
    assert_eq!(Hull::new(&flat), Err(HullError::Flat));
}

#[test]
fn a_hull_of_any_size_has_four_faces_or_there_is_none() {
    for exponent in -300..=300 {
        let size = 10f64.powi(exponent);
        let corners: Vec<V> = (0..8).map(|i| std::array::from_fn(|k| if i >> k & 1 == 1 { size } else { -size })).collect();
        match Hull::new(&corners) {
            Ok(hull) => assert_eq!(hull.faces().len(), 6, "{size:e}"),
            Err(error) => assert!(!(1e-9..1e9).contains(&size), "{size:e}: {error}"),
        }
    }
}

#[test]
fn what_is_too_large_for_a_hull_is_not_called_flat() {
    let cube = |size: f64| (0..8).map(|i| [0, 1, 2].map(|k| if i >> k & 1 == 0 { -size } else { size })).collect::<Vec<V>>();
    assert!(Hull::new(&cube(1e60)).is_ok());
    for size in [1e80, 1e120, 1e300] {
        assert_eq!(Hull::new(&cube(size)).unwrap_err(), HullError::TooLarge, "{size:e} m");
    }
    let plate: Vec<V> = cube(1.0).into_iter().map(|[x, y, _]| [x, y, 0.0]).collect();
    assert_eq!(Hull::new(&plate).unwrap_err(), HullError::Flat);
}
