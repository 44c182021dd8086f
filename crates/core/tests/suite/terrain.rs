//! Contact detection (stage 3) with height fields. It may skip a pair before it tests triangles only if the pair has no contact.

use std::sync::Arc;

use crate::shapes::{cases, simple, unit, vector};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use proptest::prelude::*;
use stepper_core::internals::collision::contact_set::Contacts;
use stepper_core::internals::collision::detection::CollisionWorkspace;
use stepper_core::internals::dynamics::kinematics::Kinematics;
use stepper_core::internals::probe::NoProbe;
use stepper_core::internals::stages::s03_detect::detect;
use stepper_core::model::{BodyBuilder, GeomBuilder, HeightField, JointBuilder, Model, WORLD};
use stepper_core::{Field, Integrator, Level, Options, Precision, Simulation, Solver};
use stepper_geometry::linear_algebra::*;
use stepper_geometry::{ConvexShape, Grid, Narrow, Pose, SearchLimits, Solid, Surface};

const STEP: f64 = 0.01;
const POINTS: usize = 9;

/// Geom of a shape, and radius of a ball about its origin that contains the shape, m.
fn geom(shape: &ConvexShape) -> (GeomBuilder, f64) {
    match *shape {
        ConvexShape::Sphere { radius } => (GeomBuilder::sphere("", radius), radius),
        ConvexShape::Capsule { radius, half_length } => (GeomBuilder::capsule("", radius, half_length), radius + half_length),
        ConvexShape::Cylinder { radius, half_length } => (GeomBuilder::cylinder("", radius, half_length), radius.hypot(half_length)),
        ConvexShape::Ellipsoid { radii } => (GeomBuilder::ellipsoid("", radii), radii.into_iter().fold(0.0, f64::max)),
        ConvexShape::Box { half } => (GeomBuilder::cuboid("", half), norm(half)),
        _ => unreachable!("not drawn"),
    }
}

/// Heights over a square of 2 m, m: level, slightly rough or very rough.
fn elevation() -> impl Strategy<Value = Vec<f64>> {
    let heights = || prop::collection::vec(0.0..1.0f64, POINTS * POINTS);
    (prop_oneof![Just(0.0), Just(0.02), Just(0.3)], heights()).prop_map(|(most, z)| z.into_iter().map(|z| most * z).collect())
}

/// Random rotation, so that no faces are parallel. With parallel faces, rounding would decide which contacts exist.
fn turn() -> impl Strategy<Value = M3<f64>> {
    (unit(), -3.0..3.0f64).prop_map(|(axis, angle)| axis_rotation(axis, angle.sin(), angle.cos()))
}

fn quaternion(m: &M3<f64>) -> [f64; 4] {
    let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::from_row_slice(m)));
    [q.w, q.i, q.j, q.k]
}

/// Result of contact detection (stage 3) at the state of `sim`: whether the contacts are unreliable `time_before` seconds after the
/// beginning of the step, and the contacts.
///
/// The function calls stage 3 directly, because a step does not list contacts whose surfaces pass each other.
fn detected(sim: &Simulation, time_before: f64) -> (bool, Contacts<f64>) {
    let (compiled, mut contacts) = (sim.compiled(), Contacts::<f64>::new(64));
    let (mut qpos, mut qvel) = (vec![0.0; compiled.nq], vec![0.0; compiled.nv]);
    sim.get(Field::Qpos, 0, &mut qpos).unwrap();
    sim.get(Field::Qvel, 0, &mut qvel).unwrap();
    let mut kinematics = Kinematics::new(compiled);
    kinematics.update(compiled, &qpos);
    let velocities = [&qvel[..], &qvel[..]];
    let mut collision = CollisionWorkspace::new(compiled);
    let unreliable = detect(compiled, &kinematics, velocities, [STEP, time_before], true, &mut collision, &mut contacts, NoProbe);
    (unreliable, contacts)
}

/// Tests a ball with a radius of 2 cm that moves by up to 3 cm in the first half of a step.
#[test]
fn contacts_of_a_fast_ball_are_unreliable_where_it_overlaps_hits_or_may_have_passed_a_field() {
    const RADIUS: f64 = 0.02;
    let mut scene = Model::builder("field");
    scene.timestep(STEP);
    scene.height_field(HeightField {
        name: "flat".into(),
        shape: [POINTS; 2],
        half: [1.0; 2],
        elevation: vec![0.0; POINTS * POINTS],
        base: 0.5,
    });
    scene.geom(WORLD, GeomBuilder::height_field("flat", "flat"));
    scene.body(WORLD, BodyBuilder::new("ball").joint(JointBuilder::free("")).geom(GeomBuilder::sphere("", RADIUS)));
    let level = *Level::available().last().unwrap();
    let mut sim = Simulation::at_level(Arc::new(scene.finish().unwrap()), Options::default(), None, Precision::F64, 1, level);
    for (gap, velocity, expected) in [
        (-1e-4, [6.0, 0.0, 0.0], true),
        (1e-4, [6.0, 0.0, 0.0], true),
        (9e-3, [0.0, 0.0, 6.0], true),
        (11e-3, [0.0, 0.0, 6.0], false),
        (11e-3, [0.0, 0.0, -6.0], true),
        (61e-3, [0.0, 0.0, -6.0], false),
        (1e-4, [3.9, 0.0, 0.0], false),
        (-1e-4, [1.9, 0.0, 0.0], false),
        (-1e-4, [2.1, 0.0, 0.0], true),
    ] {
        sim.set(Field::Qpos, 0, &[0.03, 0.05, RADIUS + gap, 1.0, 0.0, 0.0, 0.0]).unwrap();
        sim.set(Field::Qvel, 0, &[velocity[0], velocity[1], velocity[2], 0.0, 0.0, 0.0]).unwrap();
        assert_eq!(detected(&sim, 0.5 * STEP).0, expected, "{gap} m above the field at {velocity:?} m/s");
    }
}

proptest! {
    #![proptest_config(cases(2000))]

    #[test]
    fn every_contact_that_can_close_within_the_step_is_taken_up(
        elevation in elevation(), shape in simple(|| 0.03..0.2), field in (vector(3.0), turn()), mat in turn(),
        at in (-1.1..1.1f64, -1.1..1.1f64, -0.1..0.2f64), v in vector(4.0), w in vector(10.0), margin in prop_oneof![Just(0.0), 0.0..0.02f64],
    ) {
        let (geom, bound) = geom(&shape);
        let (origin, tilt) = field;
        // Height of the shape's lowest point, relative to its origin, in the frame of the height field.
        let turned = rotate(&mat, shape.support(rotate_back(&mat, [0.0, 0.0, -1.0])));
        let low = turned[2] - shape.radius();
        let near = elevation[0] + at.2 - low;
        let pose = Pose { pos: add(origin, rotate(&tilt, [at.0, at.1, near])), mat: mat_mul(&tilt, &mat) };

        let mut scene = Model::builder("field");
        scene.timestep(STEP).gravity([0.0; 3]);
        let asset = HeightField { name: "rough".into(), shape: [POINTS; 2], half: [1.0; 2], elevation: elevation.clone(), base: 0.5 };
        scene.height_field(asset);
        scene.geom(WORLD, GeomBuilder::height_field("rough", "rough").pos(origin).quat(quaternion(&tilt)).margin(margin));
        // With equal principal moments of inertia, rotation does not change the angular velocity.
        let body = BodyBuilder::new("body").joint(JointBuilder::free("")).geom(geom.condim(1)).inertial(1.0, [0.0; 3], [0.1; 3]);
        scene.body(WORLD, body);
        let options = Options { timestep: Some(STEP), integrator: Some(Integrator::Euler), solver: Solver::Pgs, iterations: 1, ..Options::default() };
        let level = *Level::available().last().unwrap();
        let mut sim = Simulation::at_level(Arc::new(scene.finish().unwrap()), options, None, Precision::F64, 1, level);
        let q = quaternion(&pose.mat);
        sim.set(Field::Qpos, 0, &[pose.pos[0], pose.pos[1], pose.pos[2], q[0], q[1], q[2], q[3]]).unwrap();
        let local = rotate_back(&pose.mat, w);
        sim.set(Field::Qvel, 0, &[v[0], v[1], v[2], local[0], local[1], local[2]]).unwrap();
        let (_, contacts) = detected(&sim, 0.0);

        // Reference: direct test of all triangles, up to the distance that any point of the shape can move in two steps.
        let grid = Solid::Surface(Surface::Grid(Grid::new([POINTS; 2], [1.0; 2], elevation, 0.5)).into());
        let slack = 1e-6;
        let prediction = margin + (norm(v) + norm(w) * bound) * 2.0 * STEP + slack;
        // Which points stand for two surfaces depends on whether the surfaces count as touching.
        let limits = SearchLimits { touching: margin + slack, ..SearchLimits::from(prediction) };
        let mut narrow = Narrow::default();
        let found = narrow.collide([&grid, &Solid::Convex(shape)], [Pose { pos: origin, mat: tilt }, pose], limits);
        let limit = |pos: V3<f64>, normal: V3<f64>| (-dot(normal, add(v, cross(w, sub(pos, pose.pos))))).max(0.0) * 2.0 * STEP + slack;
        let room: Vec<f64> = found.points.iter().map(|p| limit(p.pos, p.normal) - (p.distance - margin)).collect();
        prop_assume!(room.iter().all(|x| x.abs() > 1e-9));
        let least = |x: &mut dyn Iterator<Item = f64>| x.reduce(f64::min);
        let expected = least(&mut found.points.iter().zip(&room).filter(|x| *x.1 > 0.0).map(|x| x.0.distance - margin));
        let seen = least(&mut contacts.data[..contacts.count[0]].iter().map(|slot| slot.point.distance));
        // Detection skips the pair completely or not at all. The simulation uses quaternions and the reference rotation matrices, which
        // differ by rounding. The lowest point of a rim rotates by the square root of the rounding error, 1e-8 rad, so that the distances
        // also differ.
        prop_assert_eq!(seen.is_some(), expected.is_some(), "{:?} {:?}", seen, expected);
        prop_assert!((seen.unwrap_or(0.0) - expected.unwrap_or(0.0)).abs() < 1e-6, "{seen:?} {expected:?}");
    }
}
