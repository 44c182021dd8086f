//! Tests of the check whether moving solids pass through each other. PROPTEST_CASES=5000 tests more cases.

use crate::shapes::{simple, unit};
use proptest::prelude::*;
use stepper_geometry::linear_algebra::*;
use stepper_geometry::{ConvexShape, Narrow, Pose, Solid, SolidMotion};

const LEVEL: M3<f64> = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

/// Half thickness of the walls of a corner, m.
const THICKNESS: f64 = 1e-3;
/// Distance of the inner sides of the walls from the origin, m.
const ROOM: f64 = 0.5;

/// Wall perpendicular to an axis, with its inner side at the coordinate -[`ROOM`], and its motion: the wall is at rest.
fn wall(axis: usize) -> (Solid, SolidMotion) {
    let (mut half, mut pos) = ([ROOM + 4.0 * THICKNESS; 3], [0.0; 3]);
    (half[axis], pos[axis]) = (THICKNESS, -ROOM - THICKNESS);
    let still = SolidMotion { pose: Pose { pos, mat: LEVEL }, angular: [0.0; 3], root_velocity: [0.0; 3], linear: [0.0; 3] };
    (Solid::Convex(ConvexShape::Box { half }), still)
}

proptest! {
    /// A body whose centre leaves a corner between two walls passes one of them. The walls end 4 mm behind the corner's inner sides. The
    /// shortest translation out of a wall there leads around the wall's edge.
    #[test]
    fn a_body_whose_centre_leaves_a_corner_passes_one_of_its_walls(
        shape in simple(|| 0.01..0.06), axis in unit(), angle in -3.1..3.1f64, start in prop::array::uniform3(-0.3..0.3f64),
        beyond in prop::array::uniform2(2.0 * THICKNESS..0.1), along in -0.3..0.3f64,
    ) {
        let mat = axis_rotation(axis, angle.sin(), angle.cos());
        let end = [-ROOM - beyond[0], -ROOM - beyond[1], along];
        let motion = SolidMotion { pose: Pose { pos: start, mat }, angular: [0.0; 3], root_velocity: sub(end, start), linear: [0.0; 3] };
        let passes = [0, 1].map(|axis| {
            let (solid, still) = wall(axis);
            Narrow::default().may_pass([&Solid::Convex(shape.clone()), &solid], [motion, still], [0.0, 1.0], THICKNESS)
        });
        prop_assert!(passes[0] || passes[1]);
    }

    #[test]
    fn a_body_that_stays_in_a_corner_passes_no_wall(
        shape in simple(|| 0.01..0.06), axis in unit(), angle in -3.1..3.1f64, start in prop::array::uniform3(-0.3..0.3f64),
        end in prop::array::uniform3(-0.3..0.3f64),
    ) {
        let mat = axis_rotation(axis, angle.sin(), angle.cos());
        let motion = SolidMotion { pose: Pose { pos: start, mat }, angular: [0.0; 3], root_velocity: sub(end, start), linear: [0.0; 3] };
        for axis in 0..2 {
            let (solid, still) = wall(axis);
            prop_assert!(!Narrow::default().may_pass([&Solid::Convex(shape.clone()), &solid], [motion, still], [0.0, 1.0], THICKNESS));
        }
    }
}
