//! Test that the result for a pair of solids does not depend on the pairs that the same workspace had before.

use std::sync::Arc;

use crate::shapes::{cases, simple, turn, vector};
use proptest::prelude::*;
use stepper_geometry::linear_algebra::*;
use stepper_geometry::{ConvexShape, Grid, Hull, Narrow, Point, Pose, SearchLimits, Solid, Surface};

fn convex() -> impl Strategy<Value = Solid> {
    let corners = prop::collection::vec(vector(0.4), 6..20);
    // Two regular polygons, one above the other: a hull whose flat side has more corners than a manifold has points.
    let prism = (3..9u32, 0.1..0.4f64).prop_map(|(n, half)| {
        let corner = |k: u32, z: f64| {
            let angle = std::f64::consts::TAU * f64::from(k) / f64::from(n);
            [half * angle.cos(), half * angle.sin(), z]
        };
        (0..n).flat_map(|k| [corner(k, -half), corner(k, half)]).collect::<Vec<_>>()
    });
    let hull = prop_oneof![corners, prism].prop_filter_map("has volume", |p| Hull::new(&p).ok().map(|h| ConvexShape::Hull(Arc::new(h))));
    prop_oneof![simple(|| 0.05..0.3), hull].prop_map(Solid::Convex)
}

fn first() -> impl Strategy<Value = Solid> {
    let grid = prop::collection::vec(-0.1..0.1f64, 9)
        .prop_map(|heights| Solid::Surface(Arc::new(Surface::Grid(Grid::new([3, 3], [1.0; 2], heights, 1.0)))));
    prop_oneof![1 => Just(Solid::HalfSpace), 1 => grid, 2 => convex()]
}

/// Two solids near each other, with their poses. In half of the pairs the second is above the first, not rotated, so that faces meet.
fn pair() -> impl Strategy<Value = ([Solid; 2], [Pose; 2])> {
    let above = ((-0.1..0.1f64, -0.1..0.1f64, 0.1..0.6f64), Just(IDENTITY)).prop_map(|((x, y, z), mat)| ([x, y, z], mat));
    let placed = prop_oneof![above, (vector(0.4), turn())];
    (first(), convex(), placed).prop_map(|(a, b, (pos, mat))| ([a, b], [Pose { pos: [0.0; 3], mat: IDENTITY }, Pose { pos, mat }]))
}

const IDENTITY: M3<f64> = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

fn bits(points: &[Point]) -> Vec<[u64; 8]> {
    let of = |p: &Point| {
        let [x, y, z] = p.pos.map(f64::to_bits);
        let [nx, ny, nz] = p.normal.map(f64::to_bits);
        [x, y, z, nx, ny, nz, p.distance.to_bits(), u64::from(p.feature)]
    };
    points.iter().map(of).collect()
}

proptest! {
    #![proptest_config(cases(1000))]

    #[test]
    fn contacts_do_not_depend_on_earlier_pairs(pairs in prop::collection::vec(pair(), 12)) {
        let mut reused = Narrow::default();
        for ([a, b], poses) in &pairs {
            let limits = SearchLimits::from(0.05);
            let mut fresh = Narrow::default();
            let found = fresh.collide([a, b], [poses[0], poses[1]], limits);
            let again = reused.collide([a, b], [poses[0], poses[1]], limits);
            prop_assert_eq!(bits(&found.points), bits(&again.points));
            prop_assert_eq!(found.separating_plane, again.separating_plane);
        }
    }
}
