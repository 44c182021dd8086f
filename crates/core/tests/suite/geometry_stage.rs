//! Contact detection (stage 3) with many bodies: it finds every overlapping pair, regardless of the other environments in the batch and of
//! the order of the bodies.

use std::sync::Arc;

use crate::shapes::{cases, turn, vector};
use proptest::prelude::*;
use stepper_core::model::{BodyBuilder, GeomBuilder, JointBuilder, Model, WORLD};
use stepper_core::{Field, Level, Options, Precision, Simulation, Solver, Status, StepInputs};
use stepper_geometry::linear_algebra::*;
use stepper_geometry::pairs::{Cuboid, Segment, capsule_box, segments, sphere_box};

/// Number of bodies. From 79 bodies on, the compiled model does not list their pairs, so that the broad phase must find them.
const CROWD: usize = 90;
/// Time step in which the bodies move by a negligible distance, s.
const INSTANT: f64 = 1e-9;

/// Model of balls and capsules above a thick slab, in the order `order`. One body in twenty is so large that the compiled model lists its
/// pairs.
fn heap(order: impl Iterator<Item = usize>) -> Arc<Model> {
    let mut scene = Model::builder("heap");
    scene.timestep(INSTANT).gravity([0.0; 3]).geom(WORLD, GeomBuilder::cuboid("slab", SLAB.half).pos(SLAB.centre));
    for i in order {
        let [radius, half_length] = size(i);
        let geom = if half_length == 0.0 { GeomBuilder::sphere("", radius) } else { GeomBuilder::capsule("", radius, half_length) };
        scene.body(WORLD, BodyBuilder::new(&format!("{i}")).joint(JointBuilder::free("")).geom(geom));
    }
    Arc::new(scene.finish().unwrap())
}

const SLAB: Cuboid<f64> = Cuboid { centre: [0.0, 0.0, -1.3], mat: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], half: [3.0, 3.0, 0.5] };

fn size(i: usize) -> [f64; 2] {
    let radius = if i % 20 == 7 { 0.5 } else { 0.02 + 0.002 * (i % 13) as f64 };
    [radius, if i.is_multiple_of(3) { 0.03 } else { 0.0 }]
}

type Pose = (V3<f64>, M3<f64>);

fn coordinates((pos, mat): &Pose) -> [f64; 7] {
    let [w, x, y, z] = quaternion(mat);
    [pos[0], pos[1], pos[2], w, x, y, z]
}

/// Quaternion (w, x, y, z) of a rotation matrix, by Shepperd's method.
fn quaternion(m: &M3<f64>) -> [f64; 4] {
    let t = [m[0] + m[4] + m[8], m[0], m[4], m[8]];
    let k = (0..4).max_by(|&a, &b| t[a].total_cmp(&t[b])).unwrap();
    let q = match k {
        0 => [1.0 + t[0], m[7] - m[5], m[2] - m[6], m[3] - m[1]],
        1 => [m[7] - m[5], 1.0 + m[0] - m[4] - m[8], m[1] + m[3], m[2] + m[6]],
        2 => [m[2] - m[6], m[1] + m[3], 1.0 - m[0] + m[4] - m[8], m[5] + m[7]],
        _ => [m[3] - m[1], m[2] + m[6], m[5] + m[7], 1.0 - m[0] - m[4] + m[8]],
    };
    let n = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    q.map(|x| x / n)
}

/// Overlaps among the contacts of environment `env` of the simulation: numbers of the two bodies (0 for the world, ascending) and distance,
/// m.
fn found(sim: &Simulation, env: usize) -> Vec<([usize; 2], f64)> {
    let model = sim.model();
    let body = |g: usize| model.bodies[model.geoms[g].body].name.parse().map_or(0, |i: usize| i + 1);
    let contacts = sim.contacts(env).into_iter().map(|c| {
        let mut bodies = c.geoms.map(body);
        bodies.sort_unstable();
        (bodies, c.distance)
    });
    sorted(contacts.filter(|c| c.1 < 0.0).collect())
}

fn sorted(mut all: Vec<([usize; 2], f64)>) -> Vec<([usize; 2], f64)> {
    all.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    all
}

/// Overlaps that direct tests of all pairs of bodies find, in the format of [`found`].
fn expected(poses: &[Pose]) -> Vec<([usize; 2], f64)> {
    let core = |i: usize| {
        let [radius, half_length] = size(i);
        Segment { centre: poses[i].0, axis: column(&poses[i].1, 2), half_length, radius }
    };
    let mut all = Vec::new();
    for i in 0..poses.len() {
        let a = core(i);
        if a.half_length == 0.0 {
            all.push(([0, i + 1], sphere_box(a.centre, a.radius, &SLAB).distance));
        } else {
            let (points, exist) = capsule_box(&a, &SLAB);
            all.extend((0..2).filter(|&k| exist[k]).map(|k| ([0, i + 1], points[k].distance)));
        }
        for j in i + 1..poses.len() {
            let (points, two) = segments(&a, &core(j));
            all.extend(points[..1 + usize::from(two)].iter().map(|p| ([i + 1, j + 1], p.distance)));
        }
    }
    all.retain(|c| c.1 < 0.0);
    sorted(all)
}

fn simulate(model: &Arc<Model>, scenes: &[&[[f64; 7]]], precision: Precision) -> Simulation {
    let level = *Level::available().last().unwrap();
    // The test compares contacts, not the motion, so that one solver iteration suffices.
    let options = Options { timestep: Some(INSTANT), max_contacts: Some(20_000), solver: Solver::Pgs, iterations: 1, ..Options::default() };
    let mut sim = Simulation::at_level(model.clone(), options, Some(scenes.len()), precision, 1, level);
    for (env, scene) in scenes.iter().enumerate() {
        sim.set(Field::Qpos, env, &scene.concat()).unwrap();
    }
    sim.step(&StepInputs::default(), 1).unwrap();
    for env in 0..scenes.len() {
        assert!(!sim.status(env).contains(Status::CONTACTS_FULL));
    }
    sim
}

fn scene(spread: f64) -> impl Strategy<Value = Vec<Pose>> {
    prop::collection::vec((vector(spread), turn()), CROWD)
}

proptest! {
    #![proptest_config(cases(12))]

    #[test]
    fn every_overlap_of_a_crowd_is_found(scenes in prop::collection::vec(prop_oneof![scene(0.3), scene(1.0), scene(30.0)], 3)) {
        let forward = heap(0..CROWD);
        let coordinates: Vec<Vec<[f64; 7]>> = scenes.iter().map(|s| s.iter().map(coordinates).collect()).collect();
        let all: Vec<&[[f64; 7]]> = coordinates.iter().map(Vec::as_slice).collect();
        let together = simulate(&forward, &all, Precision::F64);
        for (env, poses) in scenes.iter().enumerate() {
            let (found, expected) = (found(&together, env), expected(poses));
            // The simulation uses quaternions and the direct tests rotation matrices, so that distances differ by rounding.
            prop_assert_eq!(found.len(), expected.len());
            for (f, e) in found.iter().zip(&expected) {
                prop_assert!(f.0 == e.0 && (f.1 - e.1).abs() < 1e-12, "{f:?} {e:?}");
            }
            // A simulation of this environment alone must give the same bits.
            let alone = simulate(&forward, &[all[env]], Precision::F64);
            let bits = |sim: &Simulation, env: usize| -> Vec<u64> {
                sim.contacts(env).iter().flat_map(|c| c.pos.into_iter().chain(c.normal).chain([c.distance])).map(f64::to_bits).collect()
            };
            prop_assert_eq!(bits(&alone, 0), bits(&together, env));
        }
        // With the bodies in the opposite order, the geoms of every pair are swapped.
        let backward = heap((0..CROWD).rev());
        let mut reversed = coordinates[0].clone();
        reversed.reverse();
        let swapped = found(&simulate(&backward, &[&reversed], Precision::F64), 0);
        let here = found(&together, 0);
        prop_assert_eq!(swapped.len(), here.len());
        for (s, h) in swapped.iter().zip(&here) {
            // Capsules whose axes have an angle below 1e-3 rad touch at two points: the ends of their common length, measured along the
            // first capsule. Swapped geoms move these points by the angle times the distance of the capsules (less than 1 m). This changes
            // the distance by the shift times the angle.
            let twice = here.iter().filter(|c| c.0 == h.0).count() == 2;
            let rounding = if twice { 1e-6 } else { 1e-12 };
            prop_assert!(s.0 == h.0 && (s.1 - h.1).abs() < rounding, "{s:?} {h:?}");
        }
    }
}
