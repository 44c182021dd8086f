//! The scenes are what they claim to be, and the taken-apart step is the step.

use stepper_benches::clock::Run;
use stepper_benches::episode::{Episode, lanes, single};
use stepper_benches::peers::{Course, Engine, Ours, Rapier, Setting, answer, errors};
use stepper_benches::rig::Rig;
use stepper_benches::scenes::{Scene, ant, humanoid};
use stepper_core::batch::{Field, StepInputs};
use stepper_core::model::{Model, Shape};
use stepper_core::plan::Plan;
use stepper_core::{Integrator, Level, Options, Precision, Simulation};
use stepper_real::Real;

fn shapes(model: &Model) -> [usize; 3] {
    let count = |is: fn(&Shape) -> bool| model.geoms.iter().filter(|g| is(&g.shape)).count();
    [count(|s| matches!(s, Shape::Plane)), count(|s| matches!(s, Shape::Sphere { .. })), count(|s| matches!(s, Shape::Capsule { .. }))]
}

fn height(simulation: &Simulation, env: usize) -> f64 {
    let mut q = vec![0.0; simulation.model().nq()];
    simulation.get(Field::Qpos, env, &mut q);
    q[2]
}

#[test]
fn robots_have_the_parts_that_they_claim() {
    let model = humanoid();
    assert_eq!((model.nq(), model.nv(), model.nu(), shapes(&model)), (28, 27, 21, [1, 3, 16]));
    assert_eq!(model.geoms.iter().filter(|g| g.name.contains("sole")).count(), 4);
    let model = ant();
    assert_eq!((model.nq(), model.nv(), model.nu(), shapes(&model)), (15, 14, 8, [1, 1, 12]));
}

#[test]
fn the_thrown_about_lie_on_the_floor_and_every_step_is_solved() {
    for (scene, low, high) in [(Scene::humanoid(), 0.0, 0.9), (Scene::ant(), 0.1, 2.5)] {
        let mut episode = lanes(&scene, Precision::F64, Level::Baseline);
        let (mut contacts, mut flags, mut sweeps, mut heights) = (0, 0, 0.0, 0.0);
        for call in 0..10 {
            episode.run();
            for env in 0..64 {
                let simulation = episode.simulation();
                contacts += simulation.contacts(env).len();
                sweeps += simulation.certificate(env).1 / 640.0;
                heights += height(simulation, env) / 640.0;
                if simulation.status(env) != 0 {
                    println!(
                        "{}: call {call} environment {env}: status {} residual {:.1e}",
                        scene.name,
                        simulation.status(env),
                        simulation.certificate(env).0
                    );
                    flags |= simulation.status(env);
                }
            }
        }
        println!("{}: {:.2} contacts, {sweeps:.1} sweeps, height {heights:.2} m", scene.name, contacts as f64 / 640.0);
        assert!(contacts > 640, "{}: {contacts} contacts", scene.name);
        assert!(low < heights && heights < high, "{}: height {heights}", scene.name);
        assert_eq!(flags, 0, "{}: a step was not solved", scene.name);
    }
}

#[test]
fn without_control_the_ant_stands_and_the_humanoid_collapses() {
    for (scene, low, high) in [(Scene::ant(), 0.2, 1.0), (Scene::humanoid(), 0.0, 0.9)] {
        let options = Options { timestep: scene.model.timestep, ..Options::default() };
        let mut simulation = Simulation::new(scene.model.clone(), options, None, Precision::F64, 1).unwrap();
        let mut flags = 0;
        for _ in 0..1000 {
            simulation.step(&StepInputs::default(), 1).unwrap();
            flags |= simulation.status(0);
        }
        let (z, contacts) = (height(&simulation, 0), simulation.contacts(0));
        let force: f64 = contacts.iter().map(|(_, c)| c.impulse[0]).sum();
        println!("{}: height {z:.3} m, {} contacts, {force:.3} N", scene.name, contacts.len());
        assert!(low < z && z < high && !contacts.is_empty(), "{}: height {z}", scene.name);
        assert_eq!(flags, 0, "{}: status", scene.name);
    }
}

#[test]
fn runs_repeat_their_bits() {
    let mut episode = single(&Scene::ant());
    let mut bits = || {
        episode.rewind();
        episode.run();
        episode.0[3].simulation().save_state()
    };
    assert_eq!(bits(), bits());
}

#[test]
fn the_rig_makes_the_step() {
    let scene = Scene::humanoid();
    let plan = Plan::new(&scene.model);
    let episode = Episode::new(&scene, 0, 8, Precision::F64, Level::Baseline);
    let mut rig = Rig::<stepper_real::F64x8>::new(&plan, &episode);
    let mut simulation =
        Simulation::at_level(scene.model.clone(), *episode.simulation().options(), Some(8), Precision::F64, 1, Level::Baseline);
    let mut q = vec![0.0; plan.nq];
    let mut v = vec![0.0; plan.nv];
    for env in 0..8 {
        episode.simulation().get(Field::Qpos, env, &mut q);
        episode.simulation().get(Field::Qvel, env, &mut v);
        simulation.set(Field::Qpos, env, &q).unwrap();
        simulation.set(Field::Qvel, env, &v).unwrap();
    }
    for control in episode.controls() {
        rig.control(control);
        for _ in 0..5 {
            rig.step(&plan);
            simulation.step(&StepInputs { ctrl: control, ..StepInputs::default() }, 1).unwrap();
        }
        for env in 0..8 {
            simulation.get(Field::Qpos, env, &mut q);
            let rig: Vec<f64> = rig.q.iter().map(|x| x.lane(env)).collect();
            assert_eq!(rig, q, "environment {env}");
        }
    }
}

#[test]
fn rapier_with_small_steps_tends_to_our_answer() {
    let course = Course::Chain(5);
    let answer = answer(course);
    let error = |dt: f64| errors(course, &mut Rapier::new(course, Setting { dt, substeps: 1, coulomb: false }), &answer);
    let [coarse, fine] = [error(1e-4), error(2.5e-5)];
    println!("rapier: {coarse:?} at 0.1 ms, {fine:?} at 0.025 ms");
    assert!(fine[0] < 0.3 * coarse[0] && fine[1] < 0.3 * coarse[1], "{coarse:?} {fine:?}");
    let mut ours = Ours::new(course, 2e-4, Integrator::Rk4, Precision::F64, 1, Level::Baseline);
    let own = errors(course, &mut ours, &answer);
    println!("rk4: {own:?} at 0.2 ms");
    assert!(own[0] < 1e-9);
    assert_eq!(ours.steps(), 2500);
}
