//! Faults in one environment: they do not change other environments, and a status flag or an error reports them.

use crate::common::{action, bits, start, walker};
use stepper_core::{Field, Options, Precision, SavedState, Simulation, Status, StepInputs};

fn simulation(n: usize, options: Options) -> Simulation {
    let model = walker();
    let mut sim = Simulation::new(model.clone(), options, Some(n), Precision::F64, 1).unwrap();
    for env in 0..n {
        let (q, v) = start(&model, env);
        sim.set(Field::Qpos, env, &q).unwrap();
        sim.set(Field::Qvel, env, &v).unwrap();
    }
    sim
}

#[test]
fn a_nan_action_stops_its_robot_and_nothing_else() {
    let options = Options { timestep: Some(0.004), ..Options::default() };
    let (mut sick, mut well) = (simulation(9, options), simulation(9, options));
    let model = sick.model().clone();
    let nu = model.nu();
    // Coordinates of the ball and the crate, which nothing connects to the walker.
    let free = ["ball", "crate"].map(|name| model.joint(name).expect("a joint of the walker's model").qpos);
    let mut before = Vec::new();
    for call in 0..100 {
        let good: Vec<f64> = (0..9).flat_map(|env| action(&model, env, call)).collect();
        let mut bad = good.clone();
        if call >= 50 {
            bad[3 * nu + 1] = f64::NAN;
        }
        sick.step(&StepInputs { ctrl: &bad, ..StepInputs::default() }, 1).unwrap();
        well.step(&StepInputs { ctrl: &good, ..StepInputs::default() }, 1).unwrap();
        for env in 0..9 {
            if env != 3 || call < 50 {
                assert_eq!(bits(&sick, env), bits(&well, env), "environment {env}, call {call}");
            }
        }
        let flagged = sick.status(3).contains(Status::NON_FINITE);
        assert_eq!(flagged, call >= 50);
        let mut q = vec![0.0; model.nq()];
        sick.get(Field::Qpos, 3, &mut q).unwrap();
        assert!(q.iter().all(|x| x.is_finite()));
        if call > 49 {
            for (i, (now, before)) in q.iter().zip(&before).enumerate() {
                assert!(
                    free.iter().any(|range| range.contains(&i)) || now == before,
                    "the walker keeps its last finite state: coordinate {i}, call {call}"
                );
            }
            assert!(free.iter().all(|range| q[range.clone()] != before[range.clone()]), "ball and crate move on, call {call}");
        }
        before = q;
    }
    assert!((sick.time(3) - 100.0 * 0.004).abs() < 1e-12 && (sick.time(0) - 100.0 * 0.004).abs() < 1e-12);
    // With finite controls the environment makes steps again.
    let good: Vec<f64> = (0..9).flat_map(|env| action(&model, env, 100)).collect();
    sick.step(&StepInputs { ctrl: &good, ..StepInputs::default() }, 1).unwrap();
    assert!(!sick.status(3).contains(Status::NON_FINITE));
}

#[test]
fn contacts_without_room_are_said() {
    let mut sim = simulation(3, Options { timestep: Some(0.004), max_contacts: Some(2), ..Options::default() });
    let mut said = Status::OK;
    for _ in 0..200 {
        sim.step(&StepInputs::default(), 1).unwrap();
        for env in 0..3 {
            assert!(sim.contacts(env).len() <= 2);
            said |= sim.status(env);
        }
    }
    assert!(said.contains(Status::CONTACTS_FULL), "{said}");
}

#[test]
fn the_state_is_all_that_survives() {
    let options = Options { timestep: Some(0.004), ..Options::default() };
    let mut sim = simulation(5, options);
    let model = sim.model().clone();
    let step = |sim: &mut Simulation, call: usize| {
        let ctrl: Vec<f64> = (0..5).flat_map(|env| action(&model, env, call)).collect();
        sim.step(&StepInputs { ctrl: &ctrl, ..StepInputs::default() }, 1).unwrap();
    };
    (0..80).for_each(|call| step(&mut sim, call));
    let saved = sim.save_state();
    (80..120).for_each(|call| step(&mut sim, call));
    // A new simulation has new work buffers.
    let mut again = simulation(5, options);
    again.restore_state(&saved).unwrap();
    (80..120).for_each(|call| step(&mut again, call));
    (0..5).for_each(|env| assert_eq!(bits(&sim, env), bits(&again, env)));
    assert!(simulation(4, options).restore_state(&saved).is_err());
    let bytes = saved.to_bytes();
    assert!(SavedState::from_bytes(&bytes[..bytes.len() - 3]).is_err());
}

#[test]
fn wrong_input_is_named() {
    let mut sim = simulation(2, Options::default());
    let message = sim.set(Field::Qpos, 1, &vec![0.0; sim.model().nq()]).unwrap_err().to_string();
    assert!(message.contains("root") && message.contains("environment 1"), "{message}");
    let message = sim.step(&StepInputs { ctrl: &[0.0; 3], ..StepInputs::default() }, 1).unwrap_err().to_string();
    assert!(message.contains("ctrl has 3 numbers"), "{message}");
    let message = Simulation::new(walker(), Options { baumgarte: 2.0, ..Options::default() }, None, Precision::F64, 1).err().unwrap();
    assert!(message.to_string().contains("baumgarte is 2"), "{message}");
}

#[test]
fn a_model_without_contacts_limits_or_controls_steps_in_every_lane() {
    use stepper_core::model::{BodyBuilder, GeomBuilder, JointBuilder, Model, WORLD};
    let mut scene = Model::builder("pendulum");
    let rod = BodyBuilder::new("rod").joint(JointBuilder::hinge("pivot", [0.0, 1.0, 0.0]));
    scene.body(WORLD, rod.geom(GeomBuilder::capsule("rod", 0.02, 0.3).pos([0.3, 0.0, 0.0]).quat([0.8, 0.0, 0.6, 0.0])));
    let model = std::sync::Arc::new(scene.finish().unwrap());
    let mut sim = Simulation::new(model, Options::default(), Some(9), Precision::F64, 1).unwrap();
    (0..9).for_each(|env| sim.reset(env));
    sim.step(&StepInputs::default(), 10).unwrap();
    let first = bits(&sim, 0);
    (0..9).for_each(|env| assert_eq!(bits(&sim, env), first));
}
