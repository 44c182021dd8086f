//! The whole of stage 3: every pair that overlaps has its contact, whoever stands beside it and in which order.

use std::sync::Arc;

use crate::shapes::{cases, turn, vector};
use proptest::prelude::*;
use stepper_core::model::{BodyBuilder, GeomBuilder, JointBuilder, Model, WORLD};
use stepper_core::{Field, Level, Options, Precision, Simulation, Solver, Status, StepInputs};
use stepper_geometry::linear_algebra::*;
use stepper_geometry::pairs::{Cuboid, Segment, capsule_box, segments, sphere_box};

/// So many bodies that their pairs are not listed: 79 would do.
const CROWD: usize = 90;
/// Short enough that nothing moves.
const INSTANT: f64 = 1e-9;

/// Balls and capsules of very different sizes, one in twenty too large for the crowd, over a thick slab.
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

/// The quaternion of a rotation (Shepperd's method).
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

/// Body names (0 is the world) and distances of what overlaps, from the simulation: contacts of environment `env`.
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

/// The same from every pair in turn.
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
    // The contacts are looked at, not the motion.
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
            // Quaternions there and rotations here differ by rounding.
            prop_assert_eq!(found.len(), expected.len());
            for (f, e) in found.iter().zip(&expected) {
                prop_assert!(f.0 == e.0 && (f.1 - e.1).abs() < 1e-12, "{f:?} {e:?}");
            }
            // Alone: the same bits.
            let alone = simulate(&forward, &[all[env]], Precision::F64);
            let bits = |sim: &Simulation, env: usize| -> Vec<u64> {
                sim.contacts(env).iter().flat_map(|c| c.pos.into_iter().chain(c.normal).chain([c.distance])).map(f64::to_bits).collect()
            };
            prop_assert_eq!(bits(&alone, 0), bits(&together, env));
        }
        // Bodies in the opposite order: the geoms of every pair swapped.
        let backward = heap((0..CROWD).rev());
        let mut reversed = coordinates[0].clone();
        reversed.reverse();
        let swapped = found(&simulate(&backward, &[&reversed], Precision::F64), 0);
        let here = found(&together, 0);
        prop_assert_eq!(swapped.len(), here.len());
        for (s, h) in swapped.iter().zip(&here) {
            // Capsules that are parallel up to an angle of 1e-3 touch twice, at the ends of what they share as measured along the first:
            // the other way round these are that angle of their distance (less than 1 m) beside, on a slope of that angle.
            let twice = here.iter().filter(|c| c.0 == h.0).count() == 2;
            let rounding = if twice { 1e-6 } else { 1e-12 };
            prop_assert!(s.0 == h.0 && (s.1 - h.1).abs() < rounding, "{s:?} {h:?}");
        }
    }
}
