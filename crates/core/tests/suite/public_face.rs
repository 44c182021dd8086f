//! Public behaviour of the crate: defaults that follow the model, errors that can be matched, and readings with their units.

use std::fmt::Debug;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use stepper_core::group_step::StatePart;
use stepper_core::model::{
    ActuatorBuilder, BodyBuilder, Description, EqualityBuilder, GeomBuilder, JointBuilder, JointPlace, Keyframe, ModelBuilder, SensorKind,
    SensorPlace, Shape, Site, TendonBuilder, WORLD,
};
use stepper_core::rollout::{Numbers, Quantity, Recording};
use stepper_core::{
    ActuatorSpec, AppliedInput, BodyPose, Contact, ContactLaw, DerivedQuantity, Episode, Error, Field, Integrator, Model, ModelError,
    Motor, Options, Outcome, Parameter, Precision, SavedState, Servo, Simulation, Snapshot, Solver, Stabilization, StateMisfit, StateRows,
    Status, StepInputs, Transfer, WorstRow,
};

const RADIUS: f64 = 0.1;

/// Model with the time step `timestep`, s: a ball that lies on a floor, and a mocap body.
fn ball(timestep: f64) -> Arc<Model> {
    let mut scene = Model::builder("ball");
    scene.timestep(timestep).geom(WORLD, GeomBuilder::plane("floor"));
    let body = BodyBuilder::new("ball").pos([0.0, 0.0, RADIUS]).joint(JointBuilder::free("root"));
    scene.body(WORLD, body.geom(GeomBuilder::sphere("ball", RADIUS).mass(2.0)));
    scene.body(WORLD, BodyBuilder::new("hand").pos([1.0, 0.0, 1.0]).mocap());
    Arc::new(scene.finish().unwrap())
}

fn simulation(model: Arc<Model>, options: Options, num_envs: usize) -> Simulation {
    Simulation::new(model, options, Some(num_envs), Precision::F64, 1).unwrap()
}

#[test]
fn the_time_step_is_the_models_unless_it_is_given() {
    let mut sim = simulation(ball(0.001), Options::default(), 2);
    sim.step(&StepInputs::default(), 1).unwrap();
    assert_eq!((sim.timestep(), sim.time(0)), (0.001, 0.001));
    let mut sim = simulation(ball(0.001), Options { timestep: Some(0.005), ..Options::default() }, 2);
    sim.step(&StepInputs::default(), 1).unwrap();
    assert_eq!((sim.timestep(), sim.time(1)), (0.005, 0.005));
}

#[test]
fn the_tolerance_follows_the_contact_law_and_the_precision_unless_it_is_given() {
    let mujoco = Options { contact: ContactLaw::Mujoco, ..Options::default() };
    assert_eq!(Simulation::new(ball(0.002), mujoco, Some(2), Precision::F64, 1).unwrap().tolerance(), 1e-6);
    let short = Options { timestep: Some(5e-4), ..Options::default() };
    assert!(
        (Simulation::new(ball(0.002), short, Some(2), Precision::F64, 1).unwrap().tolerance() / (6e-3 * 9.81 * 5e-4) - 1.0).abs() < 1e-12
    );
    for (precision, tolerance) in [(Precision::F64, 1e-4), (Precision::F32, 1e-4)] {
        let make = |options: Options| Simulation::new(ball(0.002), options, Some(2), precision, 1).unwrap();
        let mut sim = make(Options::default());
        assert_eq!(sim.tolerance(), tolerance);
        sim.step(&StepInputs::default(), 100).unwrap();
        assert_eq!(sim.status(0), Status::OK);
        assert_eq!(make(Options { tolerance: Some(1e-3), ..Options::default() }).tolerance(), 1e-3);
    }
}

#[test]
fn a_state_of_another_model_is_refused_and_named() {
    let (model, other) = (ball(0.002), ball(0.001));
    let state = SavedState::from_bytes(&simulation(model.clone(), Options::default(), 2).save_state().to_bytes()).unwrap();
    let mut sim = simulation(other.clone(), Options::default(), 2);
    sim.step(&StepInputs::default(), 3).unwrap();
    let before = sim.qpos(0);
    let error = sim.restore_state(&state).unwrap_err();
    let hex = |digest: [u8; 32]| digest[..6].iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    let text = error.to_string();
    assert!(text.contains(&hex(model.digest())) && text.contains(&hex(other.digest())) && text.contains("\"ball\""), "{text}");
    assert!(matches!(error, Error::OtherModel { state, model: own, .. } if state == model.digest() && own == other.digest()));
    assert_eq!(sim.qpos(0), before, "nothing is changed by it");
    assert!(matches!(SavedState::from_bytes(b"stepper"), Err(Error::NotAState(_))));
}

#[test]
fn a_finished_model_is_edited_through_its_description_alone() {
    // A doctest of `Model`, which must not compile, tests that its fields cannot be assigned.
    let mut description = Arc::unwrap_or_clone(ball(0.002)).into_description();
    description.timestep = 0.004;
    let model = description.finish(true).unwrap();
    assert_eq!(simulation(Arc::new(model.clone()), Options::default(), 1).timestep(), 0.004);
    for timestep in [-0.002, 0.0, f64::NAN] {
        let mut description = model.clone().into_description();
        description.timestep = timestep;
        assert!(matches!(description.finish(true), Err(ModelError::Invalid { .. })), "{timestep}");
        assert!(model.replace("timestep", &[timestep]).is_err(), "{timestep}");
        let options = Options { timestep: Some(timestep), ..Options::default() };
        let error = Simulation::new(Arc::new(model.clone()), options, None, Precision::F64, 1).err().unwrap();
        assert!(matches!(error, Error::Option { name: "timestep", .. }), "{error}");
    }
}

#[test]
fn a_contact_has_its_force_in_newtons_whatever_the_time_step() {
    for timestep in [0.001, 0.004] {
        let mut sim = simulation(ball(timestep), Options::default(), 3);
        sim.step(&StepInputs::default(), 10).unwrap();
        let [contact] = sim.contacts(2)[..] else { panic!("one contact") };
        let weight = 2.0 * 9.81;
        assert!((contact.force[0] - weight).abs() < 1e-6 * weight, "{contact:?}");
        assert_eq!((contact.geoms, contact.bodies), ([0, 1], [0, 1]));
        assert_eq!((contact.normal, contact.frame()[0]), ([0.0, 0.0, 1.0], contact.normal));
    }
}

#[test]
fn a_status_says_its_flags() {
    let both = Status::NOT_CONVERGED | Status::DEEP;
    assert!(both.contains(Status::DEEP) && !both.contains(Status::OVER_LIMIT) && !both.is_empty());
    assert_eq!((both.to_string(), format!("{both:?}")), ("NOT_CONVERGED | DEEP".into(), "Status(NOT_CONVERGED | DEEP)".into()));
    assert!(Status::OK.is_empty() && Status::OK.to_string() == "OK");
    assert_eq!(Status::from_bits_retain(65), both, "as a rollout writes them down");

    let mut sim = simulation(ball(0.002), Options::default(), 2);
    sim.set(Field::Qpos, 1, &[0.0, 0.0, 0.5 * RADIUS, 1.0, 0.0, 0.0, 0.0]).unwrap();
    sim.step(&StepInputs::default(), 1).unwrap();
    assert_eq!((sim.status(0), sim.status(1)), (Status::OK, Status::DEEP));
}

/// Keyframe with `nq` configuration coordinates, all equal to 1.
fn keyframe(name: &str, nq: usize) -> Keyframe {
    Keyframe { name: name.into(), time: 1.0, qpos: vec![1.0; nq], qvel: vec![1.0; nq.min(6)], act: vec![], ctrl: vec![] }
}

/// Message of the panic of a call.
fn panic_of<T>(call: impl FnOnce() -> T) -> String {
    let payload = catch_unwind(AssertUnwindSafe(call)).err().expect("it panics");
    payload.downcast_ref::<String>().cloned().unwrap_or_default()
}

#[test]
fn an_environment_that_does_not_exist_is_named() {
    // A group has up to eight lanes. Those beyond the third lane have no environment.
    let model = ball(0.002);
    let mut sim = simulation(model.clone(), Options::default(), 3);
    let expected = "env is 3, must be below 3";
    let reads: [fn(&Simulation); 11] = [
        |sim| drop(sim.qpos(3)),
        |sim| drop(sim.qvel(3)),
        |sim| _ = sim.time(3),
        |sim| _ = sim.status(3),
        |sim| drop(sim.sensor_faults(3)),
        |sim| drop(sim.actuator_saturation(3)),
        |sim| drop(sim.switches(3)),
        |sim| _ = sim.outcome(3),
        |sim| _ = sim.worst_row(3),
        |sim| drop(sim.contacts(3)),
        |sim| drop(sim.save_state_of(3)),
    ];
    for read in reads {
        assert_eq!(panic_of(|| read(&sim)), expected);
    }
    #[cfg(feature = "nalgebra")]
    for read in [|sim: &Simulation| drop(sim.vector(Field::Qpos, 3)), |sim: &Simulation| drop(sim.mass_matrix(3))] {
        assert_eq!(panic_of(|| read(&sim)), expected);
    }
    let writes: [fn(&mut Simulation); 3] = [|sim| sim.reset(3), |sim| sim.begin_episode(3, None), |sim| sim.set_random_stream(3, 0)];
    for write in writes {
        assert_eq!(panic_of(|| write(&mut sim)), expected);
    }
    let (q, state) = (model.qpos0.clone(), sim.save_state());
    let inputs = StepInputs::default();
    let errors = [
        sim.set(Field::Qpos, 3, &q).unwrap_err(),
        sim.correct(Field::Qpos, 3, &q).unwrap_err(),
        sim.get(Field::Qpos, 3, &mut [0.0; 7]).unwrap_err(),
        sim.set_time(3, 0.0).unwrap_err(),
        sim.body_poses_of(3, &inputs).unwrap_err(),
        sim.snapshot(3, &inputs).unwrap_err(),
        sim.restore_state_in(&state, &[0, 3]).unwrap_err(),
        sim.randomize(&[], &[3]).unwrap_err(),
        sim.reset_parameters(&[3]).unwrap_err(),
        sim.set_rows(&[3], &StateRows::default(), true).unwrap_err(),
        sim.start_episodes(&[3], &Episode::default()).unwrap_err(),
        sim.start_from(3, &keyframe("", 7)).unwrap_err(),
        sim.problem(3, &inputs).unwrap_err(),
        sim.save_problem(3, &inputs, "problem").unwrap_err(),
    ];
    for error in errors {
        assert!(matches!(error, Error::Environment { env: 3, num_envs: 3 }) && error.to_string() == expected, "{error}");
    }
    for envs in [[1, 0], [1, 1]] {
        assert!(matches!(sim.randomize(&[], &envs), Err(Error::Order { before: 1, .. })));
        assert!(matches!(sim.restore_state_in(&state, &envs), Err(Error::Order { before: 1, .. })));
    }
}

#[test]
fn an_array_of_the_wrong_length_is_neither_read_nor_written() {
    let sim = simulation(ball(0.002), Options::default(), 2);
    for n in [0, 1, 6, 8] {
        let mut out = vec![-7.0; n];
        let error = sim.get(Field::Qpos, 1, &mut out).unwrap_err();
        assert!(matches!(error, Error::Length { name: "qpos", found, must: 7, .. } if found == n), "{error}");
        assert_eq!(out, vec![-7.0; n]);
    }
    let mut sim = sim;
    let before = (sim.qpos(0), sim.qvel(0));
    let wrong = |ctrl: usize, qvel: usize| Keyframe { qvel: vec![1.0; qvel], ctrl: vec![0.0; ctrl], ..keyframe("", 7) };
    assert!(matches!(sim.start_from(0, &wrong(1, 6)), Err(Error::Length { name: "ctrl", found: 1, must: 0, .. })));
    assert!(matches!(sim.start_from(0, &wrong(0, 5)), Err(Error::Length { name: "qvel", found: 5, must: 6, .. })));
    assert_eq!((sim.qpos(0), sim.qvel(0), sim.time(0)), (before.0, before.1, 0.0), "nothing of a keyframe that does not fit is taken");
}

#[test]
fn errors_have_types_to_match() {
    let model = ball(0.002);
    let new = |options: Options, num_envs| Simulation::new(model.clone(), options, num_envs, Precision::F32, 1).err().unwrap();
    assert!(matches!(new(Options { iterations: 0, ..Options::default() }, None), Error::Option { name: "iterations", .. }));
    assert!(matches!(new(Options::default(), Some(0)), Error::NoEnvironments));
    assert!(matches!(new(Options::default(), Some(usize::MAX / 2)), Error::Memory { num_envs, .. } if num_envs == usize::MAX / 2));

    let mut sim = Simulation::new(model.clone(), Options::default(), Some(2), Precision::F32, 1).unwrap();
    let mut q = model.qpos0.clone();
    q[1] = f64::NAN;
    assert!(matches!(sim.set(Field::Qpos, 1, &q), Err(Error::NotFinite { env: 1, .. })));
    q[1] = 1e39;
    assert!(matches!(sim.set(Field::Qpos, 1, &q), Err(Error::TooLarge { env: 1, value: 1e39, .. })));
    assert!(matches!(sim.set(Field::Qpos, 0, &[0.0; 7]), Err(Error::Quaternion { env: 0, address: 3, .. })));
    assert!(matches!(sim.set_time(0, f64::INFINITY), Err(Error::NotFinite { env: 0, .. })));
    let inputs = StepInputs { ctrl: &[1.0], ..StepInputs::default() };
    assert!(matches!(sim.step(&inputs, 1), Err(Error::Length { name: "ctrl", found: 1, must: 0, .. })));
    let inputs = StepInputs { mocap_pos: &[0.0; 6], ..StepInputs::default() };
    assert!(matches!(sim.step(&inputs, 1), Err(Error::MocapPoses)));
    assert!(matches!(sim.set_sensor_models(&[None]), Err(Error::Count { name: "transfers", found: 1, must: 0, .. })));
    assert!(matches!(sim.set_actuator_models(&[None]), Err(Error::Count { name: "drives", found: 1, must: 0, .. })));
    let state = simulation(model, Options::default(), 2).save_state();
    assert!(matches!(sim.restore_state(&state), Err(Error::StatePrecision { found: Precision::F64, must: Precision::F32 })));
    let three = Simulation::new(sim.model().clone(), Options::default(), Some(3), Precision::F32, 1).unwrap().save_state();
    assert!(matches!(sim.restore_state(&three), Err(Error::StateMisfit(_))));
}

#[test]
fn body_poses_are_those_of_the_present_configuration() {
    let mut sim = simulation(ball(0.002), Options::default(), 2);
    let half = 0.5_f64.sqrt();
    sim.set(Field::Qpos, 1, &[1.0, 2.0, 3.0, half, half, 0.0, 0.0]).unwrap();
    let poses = sim.body_poses_of(1, &StepInputs::default()).unwrap();
    assert_eq!((poses.len(), poses[0].pos, poses[0].quat), (3, [0.0; 3], [1.0, 0.0, 0.0, 0.0]));
    assert_eq!(poses[1].pos, [1.0, 2.0, 3.0]);
    assert!(poses[1].quat.iter().zip([half, half, 0.0, 0.0]).all(|(x, y)| (x - y).abs() < 1e-15));
    assert_eq!((poses[2].pos, poses[2].quat), ([1.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0]), "where the model has it");

    let (pos, quat) = ([9.0, 9.0, 9.0, 0.0, 0.0, 5.0], [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    let inputs = StepInputs { mocap_pos: &pos, mocap_quat: &quat, ..StepInputs::default() };
    let hand = sim.body_poses_of(1, &inputs).unwrap()[2];
    assert_eq!((hand.pos, hand.quat), ([0.0, 0.0, 5.0], [0.0, 1.0, 0.0, 0.0]), "where the user has it");

    sim.apply(AppliedInput::MocapPos, &pos).unwrap();
    sim.apply(AppliedInput::MocapQuat, &quat).unwrap();
    let before = sim.revision();
    let (mut positions, mut orientations) = ([0.0; 2 * 3 * 3], [0.0; 2 * 3 * 4]);
    sim.derive(DerivedQuantity::BodyPos, &mut positions).unwrap();
    sim.derive(DerivedQuantity::BodyQuat, &mut orientations).unwrap();
    assert_eq!((&positions[15..], &orientations[20..]), (&hand.pos[..], &hand.quat[..]));
    assert_eq!(sim.revision(), before, "asking changes nothing");
    sim.apply(AppliedInput::MocapPos, &pos).unwrap();
    assert_eq!(sim.revision(), before, "nor does the same again");
    sim.step(&StepInputs::default(), 1).unwrap();
    assert!(sim.revision() > before);

    let (mut together, mut alone, mut motion) = ([0.0; 18], [0.0; 18], [0.0; 36]);
    let both = vec![(DerivedQuantity::SubtreeCom, Numbers::F64(&mut together)), (DerivedQuantity::BodyMotion, Numbers::F64(&mut motion))];
    sim.derive_together(both).unwrap();
    sim.derive(DerivedQuantity::SubtreeCom, &mut alone).unwrap();
    assert_eq!(together, alone);
    let refused = sim.derive_together(vec![(DerivedQuantity::BodyPos, Numbers::F32(&mut [0.0; 18]))]).unwrap_err();
    assert!(matches!(refused, Error::ArrayPrecision { name: "xpos", found: Precision::F32, must: Precision::F64 }), "{refused}");

    let refused = sim.derive(DerivedQuantity::BodyJacobian(3), &mut [0.0; 72]).unwrap_err();
    assert!(matches!(refused, Error::Element { element: "body", found: 3, count: 3 }), "{refused}");
    assert!(matches!(
        sim.derive(DerivedQuantity::Acceleration, &mut [0.0; 3]),
        Err(Error::Length { name: "qacc", found: 3, must: 12, .. })
    ));
}

#[test]
fn parameters_have_the_names_of_their_fields() {
    for parameter in Parameter::ALL {
        assert_eq!(parameter.name().parse::<Parameter>().unwrap(), parameter);
        assert!(ball(0.002).field(parameter.name()).is_some(), "{parameter:?}");
    }
    let text = |name: &str| name.parse::<Parameter>().unwrap_err().to_string();
    assert!(text("qpos0").contains("the same in all environments") && text("qpos0").contains("body_mass"));
    assert!(text("colour").contains("no such field"));

    let mut sim = simulation(ball(0.002), Options::default(), 2);
    sim.randomize(&[(Parameter::BodyMass, Some(&[0.0, 2.0, 0.0, 0.0, 5.0, 0.0]))], &[0, 1]).unwrap();
    sim.step(&StepInputs::default(), 10).unwrap();
    let force = |env: usize| sim.contacts(env)[0].force[0];
    assert!((force(0) - 2.0 * 9.81).abs() < 1e-4 && (force(1) - 5.0 * 9.81).abs() < 1e-4);
}

#[test]
fn a_single_simulation_is_one_environment_with_default_options() {
    let model = ball(0.002);
    let mut single = Simulation::single(model.clone()).unwrap();
    let mut same = Simulation::new(model.clone(), Options::default(), Some(1), Precision::F64, 1).unwrap();
    assert_eq!((single.num_envs(), single.precision(), single.threads(), *single.options()), (1, Precision::F64, 1, Options::default()));
    for sim in [&mut single, &mut same] {
        sim.set(Field::Qvel, 0, &[1.0, 0.0, 2.0, 0.0, 3.0, 0.0]).unwrap();
        sim.step(&StepInputs::default(), 300).unwrap();
    }
    assert_eq!(single.save_state(), same.save_state());
    // `Simulation::single` also accepts a model that is not in an `Arc`.
    assert_eq!(Simulation::single(Arc::unwrap_or_clone(model)).unwrap().qpos(0)[2], RADIUS);
}

#[test]
fn debug_of_a_simulation_has_its_settings_and_not_its_states() {
    let text = |num_envs: usize, precision: Precision| {
        format!("{:?}", Simulation::new(ball(0.001), Options::default(), Some(num_envs), precision, 1).unwrap())
    };
    let few = text(2, Precision::F32);
    let begin = "Simulation { model: \"ball\", num_envs: 2, precision: F32, timestep: 0.001, threads: 1, options: Options {";
    assert!(few.starts_with(begin) && few.ends_with(".. }"), "{few}");
    assert_eq!(text(500, Precision::F32), few.replace("num_envs: 2", "num_envs: 500"));
}

#[test]
fn public_types_are_printed_cloned_and_compared() {
    fn printed<T: Debug>() {}
    fn cloned<T: Clone + Debug>() {}
    fn compared<T: PartialEq + Clone + Debug>() {}
    printed::<Numbers<'_>>();
    printed::<Recording<'_>>();
    cloned::<Simulation>();
    cloned::<Snapshot<'_>>();
    cloned::<StepInputs<'_>>();
    cloned::<(ModelBuilder, BodyBuilder, GeomBuilder, JointBuilder, ActuatorBuilder, EqualityBuilder, TendonBuilder)>();
    compared::<(Error, ModelError, StateMisfit)>();
    compared::<(Model, Description, JointPlace, SensorPlace, Keyframe, Parameter, SensorKind)>();
    compared::<(Options, ContactLaw, Integrator, Solver, Stabilization, Precision)>();
    compared::<(Status, Contact, Outcome, BodyPose, WorstRow, SavedState, StatePart)>();
    compared::<(Field, AppliedInput, DerivedQuantity, Quantity, Transfer, ActuatorSpec, Servo, Motor)>();
}

#[test]
fn builders_return_the_indices_that_names_find() {
    let mut scene = Model::builder("two of each");
    let mut sites = vec![];
    let mut indices: Vec<[(&str, usize); 8]> = vec![];
    for (body, geom, joint, number) in [("upper", "upper bone", "hip", 1.0), ("lower", "lower bone", "knee", 2.0)] {
        let parent = indices.last().map_or(WORLD, |all| all[0].1);
        let hinge = JointBuilder::hinge(joint, [0.0, 1.0, 0.0]);
        let limb = BodyBuilder::new(body).pos([0.0, 0.0, 1.0]).joint(hinge).geom(GeomBuilder::capsule(geom, 0.02, 0.2));
        let body_index = scene.body(parent, limb);
        let place = Site { name: body.into(), body: 0, shape: Shape::Sphere { radius: 0.01 }, pos: [0.0; 3], quat: [1.0, 0.0, 0.0, 0.0] };
        sites.push(scene.site(body_index, place));
        indices.push([
            (body, body_index),
            (joint, scene.actuator(ActuatorBuilder::motor(joint, joint))),
            (body, scene.velocity_sensor(body, joint)),
            (joint, scene.position_sensor(joint, joint)),
            (body, scene.tendon(body, &[(joint, number)])),
            (joint, scene.fixed_tendon(TendonBuilder::new(joint, &[(joint, number)]))),
            (joint, scene.equality(EqualityBuilder::joint(joint, joint, None, [0.0; 5]).inactive())),
            (body, scene.keyframe(Keyframe { qpos: vec![number; 2], qvel: vec![0.0; 2], ctrl: vec![0.0; 2], ..keyframe(body, 2) })),
        ]);
    }
    scene.geom(WORLD, GeomBuilder::plane("floor"));
    let pairs = ["upper bone", "lower bone"].map(|geom| scene.pair(geom, "floor", [0.3, 0.0, 0.0]));
    let model = scene.finish().unwrap();
    for [body, actuator, velocity, position, tendon, fixed, equality, keyframe] in indices {
        assert_eq!(model.body(body.0).unwrap(), body.1);
        assert_eq!(model.actuator(actuator.0).unwrap(), actuator.1);
        assert_eq!(model.sensor(velocity.0).unwrap().index, velocity.1);
        assert_eq!(model.sensor(position.0).unwrap().index, position.1);
        assert_eq!(model.tendon(tendon.0).unwrap(), tendon.1);
        assert_eq!(model.tendon(fixed.0).unwrap(), fixed.1);
        assert_eq!(model.equality(equality.0).unwrap(), equality.1);
        assert_eq!(model.keyframe(keyframe.0).unwrap(), keyframe.1);
    }
    assert_eq!([model.site("upper").unwrap(), model.site("lower").unwrap()], sites[..]);
    // Contact pairs of a builder have no names, so that the test identifies each pair by its geoms.
    for (pair, geom) in pairs.into_iter().zip(["upper bone", "lower bone"]) {
        let both = model.pairs[pair].geoms;
        assert!(both.contains(&model.geom(geom).unwrap()) && both.contains(&model.geom("floor").unwrap()));
    }
    // Geoms of the world come first in the model, regardless of the order in which they were added. Lookups by name return these indices.
    assert_eq!(["floor", "upper bone", "lower bone"].map(|geom| model.geom(geom).unwrap()), [0, 1, 2]);
}
