//! Vectors, matrices and poses of a simulation in nalgebra's types, with the feature `nalgebra`.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use stepper_core::model::{BodyBuilder, GeomBuilder, JointBuilder, WORLD};
use stepper_core::{Field, Model, Options, Precision, Simulation, StepInputs};

/// Simulation of two environments with a box on a slope of 0.1 rad.
fn slope() -> Simulation {
    let mut scene = Model::builder("slope");
    let (sine, cosine) = 0.05_f64.sin_cos();
    scene.geom(WORLD, GeomBuilder::plane("slope").quat([cosine, 0.0, sine, 0.0]));
    let body = BodyBuilder::new("box").pos([0.0, 0.0, 0.05]).quat([cosine, 0.0, sine, 0.0]).joint(JointBuilder::free("root"));
    scene.body(WORLD, body.geom(GeomBuilder::cuboid("box", [0.1, 0.1, 0.05]).mass(3.0)));
    Simulation::new(Arc::new(scene.finish().unwrap()), Options::default(), Some(2), Precision::F64, 1).unwrap()
}

#[test]
fn vectors_and_matrices_have_the_numbers_of_the_slices() {
    let mut sim = slope();
    sim.step(&StepInputs::default(), 5).unwrap();
    let q = sim.vector(Field::Qpos, 1);
    assert_eq!(q.as_slice(), sim.qpos(1));
    sim.set(Field::Qpos, 0, q.as_slice()).unwrap();
    let all = sim.matrix(Field::Qvel);
    assert_eq!(all.shape(), (6, 2));
    assert_eq!(all.column(1).as_slice(), sim.qvel(1));
    let mass = sim.mass_matrix(0);
    assert_eq!((mass.shape(), mass[(0, 0)]), ((6, 6), 3.0));
    assert!((&mass - mass.transpose()).norm() < 1e-15);
}

#[test]
fn a_pose_is_an_isometry() {
    let sim = slope();
    let pose = sim.body_poses_of(0, &StepInputs::default()).unwrap()[1];
    let up = pose.isometry() * Vector3::z();
    assert!((up - Vector3::new(0.1_f64.sin(), 0.0, 0.1_f64.cos())).norm() < 1e-15);
    assert_eq!(pose.isometry().translation.vector, Vector3::from(pose.pos));
}

#[test]
fn contact_forces_hold_the_weight_in_world_axes() {
    let mut sim = slope();
    sim.step(&StepInputs::default(), 200).unwrap();
    let force: Vector3<f64> = sim.contacts(1).iter().map(|contact| contact.world_force()).sum();
    assert!((force - Vector3::new(0.0, 0.0, 3.0 * 9.81)).norm() < 1e-5, "{force}");
    let contact = sim.contacts(1)[0];
    assert!((contact.rotation().determinant() - 1.0).abs() < 1e-14);
    assert_eq!((contact.point().coords, contact.world_torque()), (Vector3::from(contact.pos), Vector3::zeros()));
}

#[test]
fn builders_take_nalgebras_types_in_nalgebras_order() {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.1);
    let mut scene = Model::builder("moon");
    scene.gravity(Vector3::new(0.0, 0.0, -1.62)).geom(WORLD, GeomBuilder::plane("slope").quat(turn));
    let geom = GeomBuilder::cuboid("box", Vector3::new(0.1, 0.1, 0.05)).pos(Point3::new(0.0, 0.0, 0.01));
    let pose = Isometry3::from_parts(Vector3::new(0.0, 0.0, 0.05).into(), turn);
    scene.body(WORLD, BodyBuilder::free("box").pose(pose).geom(geom));
    scene.body(
        WORLD,
        BodyBuilder::new("arm").joint(JointBuilder::hinge("pivot", Vector3::y())).inertial(1.0, Vector3::zeros(), Vector3::repeat(0.1)),
    );
    let model = scene.finish().unwrap();
    let quat = [turn.w, turn.i, turn.j, turn.k];
    assert_eq!((model.bodies[1].pos, model.bodies[1].quat, model.geoms[0].quat), ([0.0, 0.0, 0.05], quat, quat));
    assert_eq!((model.gravity, model.geoms[1].pos, model.joints[1].axis), ([0.0, 0.0, -1.62], [0.0, 0.0, 0.01], [0.0, 1.0, 0.0]));
    // The simulation returns the orientation that was given to the builder.
    let sim = Simulation::single(model).unwrap();
    assert!((sim.body_poses_of(0, &StepInputs::default()).unwrap()[1].isometry().rotation.angle_to(&turn)) < 1e-12);
}
