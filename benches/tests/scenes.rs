//! Tests that scenes have the documented properties, and that the instrumentation of a step does not change the results of the step.

use stepper_benches::clock::Run;
use stepper_benches::counted::operations;
use stepper_benches::episode::{Episode, lanes, single};
use stepper_benches::peers::{Course, Engine, Ours, Rapier, Setting, answer, errors};
use stepper_benches::recorder::nanoseconds;
use stepper_benches::scenes::{Scene, ant, humanoid};
use stepper_core::internals::probe::{Counter, Span};
use stepper_core::model::{Model, Shape};
use stepper_core::{Field, Integrator, Level, Options, Outcome, Precision, Simulation, Status, StepInputs};

fn shapes(model: &Model) -> [usize; 3] {
    let count = |is: fn(&Shape) -> bool| model.geoms.iter().filter(|g| is(&g.shape)).count();
    [count(|s| matches!(s, Shape::Plane)), count(|s| matches!(s, Shape::Sphere { .. })), count(|s| matches!(s, Shape::Capsule { .. }))]
}

fn height(simulation: &Simulation, env: usize) -> f64 {
    let mut q = vec![0.0; simulation.model().nq()];
    simulation.get(Field::Qpos, env, &mut q).unwrap();
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
fn the_thrown_about_lie_on_the_floor_and_nearly_every_step_is_solved() {
    for (scene, low, high) in [(Scene::humanoid(), 0.0, 0.9), (Scene::ant(), 0.1, 2.5)] {
        let mut episode = lanes(&scene, Precision::F64, Level::Baseline);
        episode.rewind();
        let tally = Tally::of(episode.simulation_mut(), |call| (0..64).flat_map(|env| scene.action(env, call)).collect());
        println!("{}, thrown about: {tally:?}", scene.name);
        assert!(tally.contacts > 0.5 && low < tally.height && tally.height < high);
        assert!(Status::NOT_CONVERGED.contains(tally.flags), "{}", tally.flags);
        // Measured: 1.3 % of the humanoid's steps.
        assert!(tally.not_converged < 0.02);
    }
}

#[test]
fn without_control_the_ant_stands_and_the_humanoid_collapses() {
    for (scene, low, high) in [(Scene::ant(), 0.2, 1.0), (Scene::humanoid(), 0.0, 0.9)] {
        let options = Options::default();
        let mut simulation = Simulation::new(scene.model.clone(), options, None, Precision::F64, 1).unwrap();
        println!("{}, falling: {:?}", scene.name, Tally::of(&mut simulation, |_| vec![]));
        let tally = Tally::of(&mut simulation, |_| vec![]);
        let force: f64 = simulation.contacts(0).iter().map(|c| c.force[0]).sum();
        println!("{}, left alone: {tally:?}, {force:.3} N", scene.name);
        assert!(tally.contacts >= 1.0 && low < tally.height && tally.height < high);
        assert_eq!(tally.flags, Status::OK);
    }
}

/// Statistics over a thousand steps of all environments.
#[derive(Debug, Default)]
struct Tally {
    /// Mean number of contacts of an environment.
    contacts: f64,
    /// Mean number of Gauss-Seidel iterations in a step.
    sweeps: f64,
    /// Mean height of the root body, m.
    height: f64,
    /// Fraction of the steps that were not solved.
    not_converged: f64,
    /// Largest residual, m/s.
    worst_residual: f64,
    /// All status flags that occurred.
    flags: Status,
}

impl Tally {
    fn of(simulation: &mut Simulation, control: impl Fn(usize) -> Vec<f64>) -> Self {
        let mut tally = Self::default();
        let n = simulation.num_envs();
        for step in 0..1000 {
            let ctrl = control(1000 + step / 5);
            simulation.step(&StepInputs { ctrl: &ctrl, ..StepInputs::default() }, 1).unwrap();
            for env in 0..n {
                let share = 1.0 / (1000 * n) as f64;
                let Outcome { status, residual, sweeps, .. } = simulation.outcome(env);
                tally.contacts += share * simulation.contacts(env).len() as f64;
                tally.sweeps += share * f64::from(sweeps);
                tally.height += share * height(simulation, env);
                tally.not_converged += share * f64::from(u8::from(status.contains(Status::NOT_CONVERGED)));
                tally.worst_residual = tally.worst_residual.max(residual);
                tally.flags |= status;
            }
        }
        tally
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
fn a_probed_step_keeps_its_bits_and_all_of_its_time_has_a_row() {
    let scene = Scene::humanoid();
    let level = *Level::available().last().expect("some level is always available");
    let episode = || Episode::new(&scene, 0, 1, Precision::F64, level);
    let mut plain = episode();
    plain.run();
    let bits = plain.simulation().save_state();
    let (mut probed, mut counted) = (episode().probe(), episode().probe_operations());
    let (time, work) = (probed.record(nanoseconds, 5), counted.record(operations, 1));
    assert_eq!(probed.simulation().save_state(), bits);
    assert_eq!(counted.simulation().save_state(), bits);
    assert_eq!(time.counters, work.counters);
    assert_eq!(time.counters[Counter::GroupSteps as usize], 100.0);
    assert_eq!(time.spans[Span::Record as usize].times, 200.0);
    assert!(time.unaccounted.readings[0] < 0.1 * time.sum(), "{:?}", time.unaccounted);
    // Operations outside all spans: two products in each of 100 steps.
    assert_eq!(work.unaccounted.readings[..2], [200.0, 0.0]);
}

#[test]
fn an_environment_alone_goes_its_way_in_the_batch_and_counting_keeps_its_bits() {
    let level = *Level::available().last().expect("some level is always available");
    for precision in [Precision::F64, Precision::F32] {
        let mut batch = Episode::new(&Scene::ant(), 0, 4, precision, level);
        batch.run();
        let mut there = vec![0.0; batch.simulation().model().nq()];
        batch.simulation().get(Field::Qpos, 2, &mut there).unwrap();
        let mut alone = batch.of_one(2).unwrap().probe_operations();
        let work = alone.record(operations, 1);
        assert!(alone.is_at(&there));
        assert!(work.sum() > 1e5, "{}", work.sum());
    }
}

#[test]
fn heap_and_wall_stay_where_they_are_and_balls_roll_as_they_should() {
    for (course, most) in [(Course::Heap, 1e-3), (Course::Wall, 1e-3), (Course::Balls, 1e-3)] {
        let answer = answer(course);
        let mut ours = Ours::new(course, course.timestep(), Integrator::Midpoint, Precision::F64, 1, Level::available()[0]);
        let own = errors(course, &mut ours, &answer);
        let theirs = errors(course, &mut Rapier::new(course, Setting { dt: course.timestep(), substeps: 4, coulomb: false }), &answer);
        println!("{}: {own:?}, rapier {theirs:?}", course.name());
        assert!(own[0] < most && own[1] < 1e-3, "{own:?}");
        assert!(theirs[0] < 0.2, "{theirs:?}");
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
