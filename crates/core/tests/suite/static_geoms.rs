//! Broad phase of geoms that are fixed to the world. The tree of bounding boxes must find the same contacts as the search that uses
//! bounding balls.

use std::sync::Arc;

use crate::shapes::{cases, simple, vector};
use proptest::prelude::*;
use stepper_core::internals::collision::contact_set::Contacts;
use stepper_core::internals::collision::detection::CollisionWorkspace;
use stepper_core::internals::dynamics::kinematics::Kinematics;
use stepper_core::internals::probe::NoProbe;
use stepper_core::internals::stages::s03_detect::detect;
use stepper_core::model::{BodyBuilder, GeomBuilder, JointBuilder, Model, WORLD};
use stepper_core::{Field, Integrator, Level, Options, Precision, Simulation};
use stepper_geometry::ConvexShape;
use stepper_geometry::linear_algebra::*;

const STEP: f64 = 0.01;

fn geom(shape: &ConvexShape) -> GeomBuilder {
    match *shape {
        ConvexShape::Sphere { radius } => GeomBuilder::sphere("", radius),
        ConvexShape::Capsule { radius, half_length } => GeomBuilder::capsule("", radius, half_length),
        ConvexShape::Cylinder { radius, half_length } => GeomBuilder::cylinder("", radius, half_length),
        ConvexShape::Ellipsoid { radii } => GeomBuilder::ellipsoid("", radii),
        ConvexShape::Box { half } => GeomBuilder::cuboid("", half),
        _ => unreachable!("not drawn"),
    }
}

/// Position, linear velocity, angular velocity and shape of a body.
type Body = (V3<f64>, V3<f64>, V3<f64>, ConvexShape);

/// Identities and distances of the contacts that stage 3 detects between the geoms `ground` and the bodies. If `posed` is true, each ground
/// geom is on a mocap body, so that the tree of bounding boxes does not contain it. `margin` is the contact margin of the ground geoms.
fn contacts(ground: &[(V3<f64>, ConvexShape)], bodies: &[Body], posed: bool, margin: f64) -> Vec<(u64, f64)> {
    let mut scene = Model::builder("ground");
    scene.timestep(STEP).gravity([0.0; 3]);
    for (k, (pos, shape)) in ground.iter().enumerate() {
        // Detection keeps elastic contacts even if they are redundant with others of the same two bodies. Each mocap geom has a separate
        // body.
        let geom = geom(shape).condim(1).margin(margin).restitution(0.5);
        if posed {
            scene.body(WORLD, BodyBuilder::new(&format!("ground {k}")).pos(*pos).mocap().geom(geom));
        } else {
            scene.geom(WORLD, geom.pos(*pos));
        }
    }
    for (k, (.., shape)) in bodies.iter().enumerate() {
        // The bodies do not collide with each other.
        let body = BodyBuilder::new(&format!("{k}")).joint(JointBuilder::free("")).geom(geom(shape).condim(1).masks(1, 0));
        scene.body(WORLD, body.inertial(1.0, [0.0; 3], [0.1; 3]));
    }
    let options = Options { timestep: Some(STEP), integrator: Some(Integrator::Euler), ..Options::default() };
    let level = *Level::available().last().unwrap();
    let mut sim = Simulation::at_level(Arc::new(scene.finish().unwrap()), options, None, Precision::F64, 1, level);
    let q: Vec<f64> = bodies.iter().flat_map(|b| [b.0[0], b.0[1], b.0[2], 1.0, 0.0, 0.0, 0.0]).collect();
    let v: Vec<f64> = bodies.iter().flat_map(|b| b.1.into_iter().chain(b.2)).collect();
    sim.set(Field::Qpos, 0, &q).unwrap();
    let (compiled, mut contacts) = (sim.compiled(), Contacts::<f64>::new(256));
    let mut kinematics = Kinematics::new(compiled);
    for (m, (pos, _)) in compiled.mocap.iter().zip(ground) {
        kinematics.pos[m.frame] = *pos;
        kinematics.mat[m.frame] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    }
    kinematics.update(compiled, &q);
    let mut collision = CollisionWorkspace::new(compiled);
    detect(compiled, &kinematics, [&v, &v], [STEP, 0.0], true, &mut collision, &mut contacts, NoProbe);
    let of = |k: usize| (contacts.ids[k][0].0, contacts.data[k].point.distance);
    (0..contacts.count[0]).map(of).collect()
}

proptest! {
    #![proptest_config(cases(300))]

    #[test]
    fn fixed_geoms_have_the_contacts_of_posed_ones(
        ground in prop::collection::vec((vector(0.6), simple(|| 0.03..0.3)), 1..9),
        bodies in prop::collection::vec((vector(0.6), vector(3.0), vector(8.0), simple(|| 0.03..0.2)), 1..5),
        margin in prop_oneof![Just(0.0), 0.0..0.05f64],
    ) {
        prop_assert_eq!(contacts(&ground, &bodies, false, margin), contacts(&ground, &bodies, true, margin));
    }
}
