//! Invalid inputs: slices of a wrong length, elements that do not exist, and builder calls in any order. Invalid inputs give an error that
//! names the fault, and no call panics.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use proptest::prelude::*;
use stepper_core::analysis::configurations;
use stepper_core::model::{
    ActuatorBuilder, BodyBuilder, EqualityBuilder, GeomBuilder, JointBuilder, Keyframe, ModelBuilder, SensorKind, Shape, Site, WORLD,
};
use stepper_core::rollout::{Numbers, Quantity, Recording};
use stepper_core::{
    AppliedInput, DerivedQuantity, Episode, Error, Field, Model, ModelError, Options, Parameter, Precision, RayCast, Simulation, StateRows,
    StepInputs, Transfer,
};

use crate::common::errors;

const NUM_ENVS: usize = 4;

/// Arm with a motor above a floor, a free ball, a mocap body that an inactive equality connects to the ball, and a sensor.
fn scene() -> Arc<Model> {
    let mut scene = Model::builder("arm");
    scene.geom(WORLD, GeomBuilder::plane("floor"));
    let hinge = JointBuilder::hinge("hip", [0.0, 1.0, 0.0]);
    scene.body(WORLD, BodyBuilder::new("arm").pos([0.0, 0.0, 1.0]).joint(hinge).geom(GeomBuilder::capsule("rod", 0.02, 0.2)));
    scene.body(WORLD, BodyBuilder::free("ball").pos([1.0, 0.0, 0.5]).geom(GeomBuilder::sphere("ball", 0.1)));
    scene.body(WORLD, BodyBuilder::new("hand").pos([1.0, 0.0, 1.0]).mocap());
    scene.actuator(ActuatorBuilder::motor("motor", "hip"));
    scene.position_sensor("angle", "hip");
    scene.equality(EqualityBuilder::connect("grip", ["ball", "hand"], [[0.0; 3]; 2]).inactive());
    Arc::new(scene.finish().unwrap())
}

fn simulation() -> Simulation {
    Simulation::new(scene(), Options::default(), Some(NUM_ENVS), Precision::F64, 1).unwrap()
}

fn is_length(error: &Error, found: usize) -> bool {
    let named = matches!(error, Error::Length { found: given, must, .. } if *given == found && *must != found);
    named && error.to_string().contains(&format!("has {found} numbers"))
}

#[test]
fn a_mask_of_the_wrong_length_moves_nothing() {
    let mut sim = simulation();
    for n in (1..=2 * NUM_ENVS).filter(|n| *n != NUM_ENVS) {
        let before = sim.save_state();
        let error = sim.step(&StepInputs { mask: &vec![false; n], ..StepInputs::default() }, 1).unwrap_err();
        assert!(matches!(error, Error::Length { name: "mask", found, must: NUM_ENVS, .. } if found == n), "{error}");
        assert!(sim.save_state() == before);
    }
    sim.step(&StepInputs { mask: &[true, false, false, false], ..StepInputs::default() }, 1).unwrap();
    assert_eq!([0, 1, 2, 3].map(|env| sim.time(env) > 0.0), [true, false, false, false]);
}

/// Call of a simulation that takes a slice of numbers.
type Call = fn(&mut Simulation, &[f64]) -> Result<(), Error>;

fn step(sim: &mut Simulation, inputs: StepInputs<'_>) -> Result<(), Error> {
    sim.step(&inputs, 1)
}

/// All calls that take a slice of numbers: name, function, and valid lengths of the slice.
fn calls() -> Vec<(&'static str, Call, Vec<usize>)> {
    let n = NUM_ENVS;
    let (nq, nv, nu, nbody) = (8, 7, 1, 4);
    vec![
        ("ctrl of step", |sim, x| step(sim, StepInputs { ctrl: x, ..StepInputs::default() }), vec![0, nu, n * nu]),
        ("qfrc", |sim, x| step(sim, StepInputs { qfrc: x, ..StepInputs::default() }), vec![0, n * nv]),
        ("xfrc", |sim, x| step(sim, StepInputs { xfrc: x, ..StepInputs::default() }), vec![0, n * 6 * nbody]),
        ("eq_active", |sim, x| step(sim, StepInputs { eq_active: x, ..StepInputs::default() }), vec![0, n]),
        ("set_ctrl", |sim, x| sim.set_ctrl(x), vec![nu, n * nu]),
        ("applied forces", |sim, x| sim.apply(AppliedInput::QfrcApplied, x), vec![0, n * nv]),
        ("applied poses", |sim, x| sim.apply(AppliedInput::MocapQuat, x), vec![0, n * 4]),
        ("applied equalities", |sim, x| sim.apply(AppliedInput::EqActive, x), vec![0, n]),
        ("set", |sim, x| sim.set(Field::Qvel, 1, x), vec![nv]),
        ("correct", |sim, x| sim.correct(Field::Qvel, 1, x), vec![nv]),
        ("get", |sim, x| sim.get(Field::Qpos, 1, &mut x.to_vec()), vec![nq]),
        ("rows", |sim, x| sim.set_rows(&[0, 2], &StateRows { qvel: Some(x), ..StateRows::default() }, true), vec![nv, n * nv]),
        ("times", |sim, x| sim.set_rows(&[0, 2], &StateRows { time: Some(x), ..StateRows::default() }, true), vec![1, n]),
        (
            "seeds",
            |sim, x| {
                let seeds = vec![7; x.len()];
                sim.start_episodes(&[0, 1], &Episode { seed: Some(&seeds), ..Episode::default() })
            },
            vec![1, n],
        ),
        ("readings", |sim, x| sim.sense(true, &mut x.to_vec()), vec![n]),
        ("derived", |sim, x| sim.derive(DerivedQuantity::Acceleration, &mut x.to_vec()), vec![n * nv]),
        ("parameters", |sim, x| sim.randomize(&[(Parameter::DofDamping, Some(x))], &[0, 3]), vec![n * nv]),
        ("snapshot", |sim, x| sim.snapshot(1, &StepInputs { qfrc: x, ..StepInputs::default() }).map(|_| ()), vec![0, nv]),
        ("problem", |sim, x| sim.problem(1, &StepInputs { ctrl: x, ..StepInputs::default() }).map(|_| ()), vec![0, nu, n * nu]),
        ("integrate", |sim, x| configurations::integrate(sim.model(), x, &[0.0; 7]).map(|_| ()), vec![nq]),
        ("displacement", |sim, x| configurations::integrate(sim.model(), &sim.model().qpos0, x).map(|_| ()), vec![nv]),
        ("differentiate", |sim, x| configurations::differentiate(sim.model(), &sim.model().qpos0, x).map(|_| ()), vec![nq]),
        ("orientation", |sim, x| configurations::joint_without_orientation(sim.model(), x).map(|_| ()), vec![nq]),
        (
            "rays",
            |sim, x| {
                let rays = RayCast { points: x, directions: &[0.0, 0.0, -1.0], count: 1, geoms: &[0] };
                sim.cast_rays(&rays, Numbers::F64(&mut [0.0; NUM_ENVS]), &mut [0; NUM_ENVS])
            },
            vec![3, 3 * n],
        ),
        (
            "controls of a rollout",
            |sim, x| {
                let recording = Recording { quantities: vec![], status: &mut [0; 2 * NUM_ENVS], residual: &mut [0.0; 2 * NUM_ENVS] };
                sim.rollout(&StepInputs { ctrl: x, ..StepInputs::default() }, 2, 1, recording, None).map(|_| ())
            },
            vec![0, 2 * nu, 2 * n * nu],
        ),
        (
            "recorded quantity",
            |sim, x| {
                let mut own = x.to_vec();
                let quantities = vec![(Quantity::Qpos, Numbers::F64(&mut own))];
                let recording = Recording { quantities, status: &mut [0; NUM_ENVS], residual: &mut [0.0; NUM_ENVS] };
                sim.rollout(&StepInputs::default(), 1, 1, recording, None).map(|_| ())
            },
            vec![n * nq],
        ),
        (
            "recorded residual",
            |sim, x| {
                let mut own = x.to_vec();
                let recording = Recording { quantities: vec![], status: &mut [0; NUM_ENVS], residual: &mut own };
                sim.rollout(&StepInputs::default(), 1, 1, recording, None).map(|_| ())
            },
            vec![n],
        ),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    /// Slices of a wrong length give an error that names both lengths, and the state does not change.
    #[test]
    fn slices_of_a_wrong_length_are_refused(lengths in prop::collection::vec(0usize..130, 8)) {
        let mut sim = simulation();
        for (name, call, taken) in calls() {
            for &n in lengths.iter().chain(&taken) {
                let before = sim.save_state();
                let found = catch_unwind(AssertUnwindSafe(|| call(&mut sim, &vec![0.5; n])));
                let found = found.unwrap_or_else(|_| panic!("{name} panics with {n} numbers"));
                if taken.contains(&n) {
                    prop_assert!(found.is_ok(), "{name} with {n} numbers: {}", found.unwrap_err());
                } else {
                    let error = found.expect_err(name);
                    prop_assert!(is_length(&error, n), "{name} with {n} numbers: {error}");
                    prop_assert!(sim.save_state() == before, "{name} with {n} numbers changed the state");
                }
            }
        }
    }

    /// Calls of a model builder in any order give a model or an error. Lookups by name in the model find the added elements, and no call
    /// panics.
    #[test]
    fn builders_and_lookups_do_not_panic(calls in prop::collection::vec((0u8..12, 0usize..6, 0usize..6), 0..24)) {
        let built = catch_unwind(|| build(&calls));
        prop_assert!(built.is_ok(), "{calls:?}");
        let Ok(model) = built.unwrap() else { return Ok(()) };
        for i in 0..8 {
            let labels = [model.body_label(i), model.geom_label(i), model.joint_label(i), model.sensor_label(i)];
            prop_assert!(labels.iter().all(|label| !label.is_empty()));
            let name = format!("x{i}");
            for found in [model.body(&name), model.geom(&name), model.site(&name), model.actuator(&name), model.equality(&name), model.tendon(&name), model.pair(&name), model.keyframe(&name)] {
                let named = found.is_ok() || matches!(found, Err(ModelError::NoSuchName { .. }));
                prop_assert!(named, "{name}");
            }
            if let Ok(joint) = model.joint(&name) {
                prop_assert!(joint.qpos.end <= model.nq() && joint.qvel.end <= model.nv() && model.joints[joint.index].name == name);
            }
            if let Ok(sensor) = model.sensor(&name) {
                prop_assert!(sensor.readings.end <= model.nsensordata() && model.sensors[sensor.index].name == name);
            }
        }
        Simulation::single(model).unwrap().step(&StepInputs::default(), 1).unwrap();
    }
}

/// Tests that a mesh without faces counts as its convex hull, so that it is not reported as a mesh with a larger hull.
#[test]
fn a_mesh_without_faces_has_no_wide_hull() {
    let corners: Vec<[f64; 3]> = (0..8).map(|k| [0, 1, 2].map(|axis| f64::from(k >> axis & 1))).collect();
    let mut scene = Model::builder("points");
    scene.mesh("corners", &corners, &[]);
    scene.geom(0, GeomBuilder::mesh("cube", "corners"));
    assert!(scene.finish().unwrap().wide_hulls().is_empty());
}

/// Builds a model from calls of a builder. Each call has the kind of element to add, and two numbers that select its parent and the names
/// of other elements.
fn build(calls: &[(u8, usize, usize)]) -> Result<Model, ModelError> {
    let mut scene = Model::builder("any");
    let mut expected: Vec<(&str, usize, String)> = vec![];
    for (k, &(what, a, b)) in calls.iter().enumerate() {
        let (name, other) = (format!("x{a}"), format!("x{b}"));
        let own = format!("x{k}");
        let joint = match b % 4 {
            0 => JointBuilder::hinge(&own, [0.0, 1.0, 0.0]),
            1 => JointBuilder::slide(&own, [0.0, 0.0, 1.0]),
            2 => JointBuilder::ball(&own),
            _ => JointBuilder::free(&own),
        };
        let shape = if b % 2 == 0 { GeomBuilder::sphere(&own, 0.1) } else { GeomBuilder::mesh(&own, &other) };
        match what {
            0 | 1 => {
                let body = BodyBuilder::new(&own).pos([0.0, 0.0, k as f64]).joint(joint).geom(GeomBuilder::sphere("", 0.1));
                expected.push(("body", scene.body(a, body), own));
            }
            2 => _ = scene.geom(a, shape),
            3 => expected.push(("site", scene.site(a, site(&own)), own)),
            4 => expected.push(("actuator", scene.actuator(ActuatorBuilder::motor(&own, &name)), own)),
            5 => expected.push(("sensor", scene.position_sensor(&own, &name), own)),
            6 => expected.push(("sensor", scene.sensor(&own, SensorKind::JointVel(b)), own)),
            7 => expected.push(("equality", scene.equality(EqualityBuilder::connect(&own, [&name, &other], [[0.0; 3]; 2])), own)),
            8 => _ = scene.pair(&name, &other, [1.0, 0.0, 0.0]),
            9 => expected.push(("tendon", scene.tendon(&own, &[(&name, 1.0)]), own)),
            10 => _ = scene.exclude(&name, &other),
            _ => add_keyframe(&mut scene, a),
        }
    }
    let model = scene.finish()?;
    for (kind, index, name) in expected {
        let found = match kind {
            "body" => model.body(&name)?,
            "site" => model.site(&name)?,
            "actuator" => model.actuator(&name)?,
            "sensor" => model.sensor(&name)?.index,
            "equality" => model.equality(&name)?,
            _ => model.tendon(&name)?,
        };
        assert_eq!(found, index, "{kind} {name}");
    }
    Ok(model)
}

fn site(name: &str) -> Site {
    Site { name: name.into(), body: 0, shape: Shape::Sphere { radius: 0.01 }, pos: [0.0; 3], quat: [1.0, 0.0, 0.0, 0.0] }
}

fn add_keyframe(scene: &mut ModelBuilder, nq: usize) {
    scene.keyframe(Keyframe { name: String::new(), time: 0.0, qpos: vec![0.0; nq], qvel: vec![], act: vec![], ctrl: vec![] });
}

#[test]
fn names_are_found_and_unknown_ones_list_those_there_are() {
    let model = scene();
    let hip = model.joint("hip").unwrap();
    assert_eq!((hip.index, hip.qpos, hip.qvel), (0, 0..1, 0..1));
    assert_eq!(model.joint("ball").unwrap().qpos, 1..8);
    assert_eq!(model.sensor("angle").unwrap().readings, 0..1);
    assert_eq!((model.body("hand").unwrap(), model.geom("floor").unwrap(), model.equality("grip").unwrap()), (3, 0, 0));
    let error = model.joint("hup").unwrap_err();
    assert!(matches!(&error, ModelError::NoSuchName { kind: "joint", known, .. } if known[..] == ["hip", "ball"]));
    assert_eq!(error.to_string(), "there is no joint \"hup\" in the model; there are: hip, ball");
    assert!(model.site("").is_err() && model.geom_label(99) == "#99");
}

#[test]
fn a_geom_of_a_body_that_does_not_exist_is_an_error() {
    let mut scene = Model::builder("empty");
    scene.geom(3, GeomBuilder::sphere("ball", 0.1));
    let error = scene.finish().unwrap_err().to_string();
    assert!(error.contains("geom \"ball\"") && error.contains("body 3") && error.contains("has 1"), "{error}");
}

#[test]
fn controls_that_are_not_finite_stop_their_environment_alone() {
    let mut sim = simulation();
    let ctrl = [0.0, f64::NAN, f64::INFINITY, 1.0];
    sim.step(&StepInputs { ctrl: &ctrl, ..StepInputs::default() }, 3).unwrap();
    for env in 0..NUM_ENVS {
        let flagged = sim.status(env).contains(stepper_core::Status::NON_FINITE);
        assert_eq!(flagged, !ctrl[env].is_finite());
        assert!(sim.qpos(env).iter().all(|x| x.is_finite()));
    }
    sim.step(&StepInputs::default(), 1).unwrap();
    assert!(sim.status(1).contains(stepper_core::Status::NON_FINITE), "it stays in force");
    sim.step(&StepInputs { ctrl: &[0.0; NUM_ENVS], ..StepInputs::default() }, 1).unwrap();
    assert!(!sim.status(1).contains(stepper_core::Status::NON_FINITE));
}

#[test]
fn a_clone_goes_on_with_the_same_bits_and_by_itself() {
    for threads in [1, 2] {
        let mut sim = Simulation::new(scene(), Options::default(), Some(40), Precision::F64, threads).unwrap();
        sim.randomize(&[(Parameter::DofDamping, Some(&[0.1; 280]))], &(0..40).collect::<Vec<_>>()).unwrap();
        sim.step(&StepInputs { ctrl: &[0.3; 40], ..StepInputs::default() }, 50).unwrap();
        let mut clone = sim.clone();
        sim.step(&StepInputs::default(), 50).unwrap();
        let kept = clone.qpos(7);
        clone.step(&StepInputs::default(), 50).unwrap();
        assert_ne!(kept, sim.qpos(7));
        assert!((0..40).all(|env| clone.qpos(env) == sim.qpos(env)));
        assert_eq!(clone.ctrl(), sim.ctrl());
        let text = format!("{clone:?}");
        assert!(text.starts_with("Simulation { model: \"arm\", num_envs: 40"), "{text}");
    }
}

#[test]
fn uniform_noise_takes_no_density() {
    let mut sim = simulation();
    let given = |noise_density: f64| {
        let gaussian = errors(&scene()).swap_remove(0).unwrap();
        [Some(Transfer { uniform: true, noise_density: vec![noise_density], ..gaussian })]
    };
    let error = sim.set_sensor_models(&given(0.01)).unwrap_err();
    assert!(error.to_string().contains("noise_density is 0.01, must be 0 with uniform noise"), "{error}");
    sim.set_sensor_models(&given(0.0)).unwrap();
}

#[test]
fn an_equality_is_switched_per_environment() {
    let mut sim = simulation();
    sim.apply(AppliedInput::EqActive, &[0.0, 1.0, 0.0, 1.0]).unwrap();
    sim.step(&StepInputs::default(), 500).unwrap();
    let height = |env: usize| sim.qpos(env)[3];
    // The ball begins 0.5 m below the mocap body. An active equality pulls it up at no more than 1 m/s; without it the ball falls to the
    // floor.
    assert!(height(0) < 0.11 && height(1) > 0.9, "{} {}", height(0), height(1));
    assert_eq!(sim.qpos(0), sim.qpos(2));
    assert_eq!(sim.outcome(0).equality_violation, 0.0);
    sim.apply(AppliedInput::EqActive, &[]).unwrap();
    sim.step(&StepInputs::default(), 300).unwrap();
    assert!(sim.qpos(1)[3] < 0.11, "the model's own again, which does not act");
}

#[test]
fn errors_compare() {
    let mut sim = simulation();
    let error = |sim: &mut Simulation| sim.set_ctrl(&[0.0; 3]).unwrap_err();
    assert_eq!(error(&mut sim), error(&mut sim));
    assert_ne!(error(&mut sim), Error::NoEnvironments);
}

#[test]
fn options_of_a_file_are_those_that_it_asks_for() {
    use stepper_core::model::Requested;
    use stepper_core::{ContactLaw, Integrator};

    let model = Arc::unwrap_or_clone(scene());
    assert_eq!(Options::from_model(&model), Ok(Options::default()));
    let asking = |integrator: &str| {
        let mut description = model.clone().into_description();
        description.requested = Some(Requested {
            integrator: integrator.into(),
            solver: "Newton".into(),
            iterations: 100,
            cone: None,
            constrained: false,
            soft: vec![],
        });
        Options::from_model(&description)
    };
    let options = asking("implicitfast").unwrap();
    assert_eq!((options.contact, options.integrator, options.iterations), (ContactLaw::Mujoco, Some(Integrator::ImplicitFast), 100));
    assert_eq!(asking("leapfrog"), Err(Error::SourceIntegrator { found: "leapfrog".into() }));
}
