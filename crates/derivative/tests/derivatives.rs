//! Derivatives of steps compared with differences of whole steps, and errors of wrong arguments.

use std::sync::Arc;

use stepper_core::model::{ActuatorBuilder, BodyBuilder, GeomBuilder, JointBuilder, WORLD};
use stepper_core::{Error, Field, Integrator, Model, Options, Precision, Simulation, StepInputs};
use stepper_derivative::{Derivative, DerivativeQuery, PerturbedCopies, StatePart, differentiate, find_kinks, kink};

/// Parts of the state with respect to which the tests differentiate: positions, velocities and controls.
const PARTS: [StatePart; 3] = [StatePart::Qpos, StatePart::Qvel, StatePart::Ctrl];

fn derivative(sim: &mut Simulation, ctrl: &[f64], width: f64) -> Result<Vec<Derivative>, Error> {
    let columns = 2 * sim.model().nv() + sim.model().nu();
    let offsets = (0..sim.num_envs()).flat_map(|_| [width, -width]);
    let offsets: Vec<f64> = offsets.flat_map(|x| std::iter::repeat_n(x, columns)).collect();
    differentiate(sim, ctrl, &DerivativeQuery { parts: &PARTS, offsets: &offsets, points: 2, tolerance: 1e-12 })
}

/// Model of a double pendulum with a motor, and a box on a vertical slide that rests on a floor.
fn arm_and_box() -> Arc<Model> {
    let mut scene = Model::builder("arm and box");
    scene.timestep(0.005).geom(WORLD, GeomBuilder::plane("floor"));
    let [axis, z] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let upper = BodyBuilder::new("upper").pos([0.0, 0.0, 2.0]).joint(JointBuilder::hinge("shoulder", axis).damping(0.1));
    let upper = scene.body(WORLD, upper.geom(GeomBuilder::capsule("upper", 0.04, 0.2).pos([0.0, 0.0, -0.2])));
    let lower = BodyBuilder::new("lower").pos([0.0, 0.0, -0.4]).joint(JointBuilder::hinge("elbow", axis));
    scene.body(upper, lower.geom(GeomBuilder::capsule("lower", 0.03, 0.2).pos([0.0, 0.0, -0.2])));
    let lift = BodyBuilder::new("lift").pos([1.0, 0.0, 0.1]).joint(JointBuilder::slide("lift", z));
    let lift = scene.body(WORLD, lift.geom(GeomBuilder::cuboid("box", [0.1, 0.1, 0.1])));
    assert!(lift > 0);
    scene.actuator(ActuatorBuilder::motor("motor", "shoulder"));
    Arc::new(scene.finish().unwrap())
}

fn simulation(model: &Arc<Model>, num_envs: usize, threads: usize) -> Simulation {
    let options = Options { tolerance: Some(1e-12), ..Options::default() };
    let mut sim = Simulation::new(model.clone(), options, Some(num_envs), Precision::F64, threads).unwrap();
    for env in 0..num_envs {
        let x = 0.1 * env as f64;
        sim.set(Field::Qpos, env, &[0.7 + x, -0.4, -1e-7]).unwrap();
        sim.set(Field::Qvel, env, &[0.5, -1.0 - x, 0.0]).unwrap();
    }
    sim
}

/// Configuration and velocity after one step from the state of `sim` and the control `ctrl`, both edited by `change`.
fn outcome(sim: &Simulation, ctrl: f64, change: impl Fn(&mut Vec<f64>, &mut Vec<f64>, &mut f64)) -> Vec<f64> {
    let mut sim = sim.clone();
    let (mut q, mut v, mut ctrl) = (sim.qpos(0), sim.qvel(0), ctrl);
    change(&mut q, &mut v, &mut ctrl);
    sim.set(Field::Qpos, 0, &q).unwrap();
    sim.set(Field::Qvel, 0, &v).unwrap();
    sim.step(&StepInputs { ctrl: &[ctrl], ..StepInputs::default() }, 1).unwrap();
    [sim.qpos(0), sim.qvel(0)].concat()
}

#[test]
fn slopes_are_those_of_differences_of_whole_steps() {
    let mut sim = simulation(&arm_and_box(), 1, 1);
    let found = &derivative(&mut sim, &[0.3], 1e-6).unwrap()[0];
    assert_eq!((found.sound, found.status), (true, 0));
    let h = 1e-5;
    for c in 0..7 {
        // Columns 2 and 5 are position and velocity of the box. Their differences cross the kink where its gap closes.
        if c == 2 || c == 5 {
            continue;
        }
        let side = |h: f64| {
            outcome(&sim, 0.3, |q, v, ctrl| match c {
                0..3 => q[c] += h,
                3..6 => v[c - 3] += h,
                _ => *ctrl += h,
            })
        };
        for (i, (ahead, behind)) in side(h).iter().zip(side(-h)).enumerate() {
            let difference = (ahead - behind) / (2.0 * h);
            // Errors of central differences of 1e-5: 1e-10 times a third derivative, and about 1e-11 by rounding.
            assert!((found.slopes[i * 7 + c] - difference).abs() < 1e-7, "row {i}, column {c}: {} {difference}", found.slopes[i * 7 + c]);
        }
    }
}

#[test]
fn a_box_that_rests_keeps_no_velocity_and_is_near_the_kink_of_its_gap() {
    let mut sim = simulation(&arm_and_box(), 1, 1);
    let found = &derivative(&mut sim, &[0.3], 1e-6).unwrap()[0];
    // Derivative of the box's velocity after the step with respect to the velocity before the step. The contact stops the box, so that it
    // is zero up to rounding.
    assert!(found.slopes[5 * 7 + 5].abs() < 1e-12);
    assert!(found.distance <= 1.0);
    assert_eq!(found.causes[2] & kink::GAP, kink::GAP);
    assert_eq!(found.causes[0] | found.causes[1] | found.causes[6], 0);
}

#[test]
fn environments_have_the_same_bits_for_every_batch_and_thread_count() {
    let model = arm_and_box();
    let ctrl: Vec<f64> = (0..19).map(|env| 0.01 * f64::from(env)).collect();
    let all = derivative(&mut simulation(&model, 19, 1), &ctrl, 1e-6).unwrap();
    assert_eq!(derivative(&mut simulation(&model, 19, 2), &ctrl, 1e-6).unwrap(), all);
    let mut last = simulation(&model, 1, 1);
    last.set(Field::Qpos, 0, &simulation(&model, 19, 1).qpos(18)).unwrap();
    last.set(Field::Qvel, 0, &simulation(&model, 19, 1).qvel(18)).unwrap();
    assert_eq!(derivative(&mut last, &ctrl[18..], 1e-6).unwrap()[0], all[18]);
}

#[test]
fn the_simulation_keeps_its_state() {
    let mut sim = simulation(&arm_and_box(), 3, 1);
    let before = sim.save_state().to_bytes();
    derivative(&mut sim, &[0.3; 3], 1e-6).unwrap();
    assert!(sim.save_state().to_bytes() == before);
}

#[test]
fn settings_without_implicit_derivatives_are_refused() {
    let model = arm_and_box();
    let make = |options: Options, precision| Simulation::new(model.clone(), options, Some(1), precision, 1).unwrap();
    let rk4 = Options { integrator: Some(Integrator::Rk4), ..Options::default() };
    let error = derivative(&mut make(rk4, Precision::F64), &[0.0], 1e-6).unwrap_err();
    assert!(matches!(error, Error::Option { name: "integrator", .. }), "{error}");
    let error = derivative(&mut make(Options::default(), Precision::F32), &[0.0], 1e-6).unwrap_err();
    assert!(matches!(error, Error::Option { name: "precision", .. }), "{error}");
    let error = derivative(&mut make(Options::default(), Precision::F64), &[0.0; 2], 1e-6).unwrap_err();
    assert!(matches!(error, Error::Length { name: "ctrl", found: 2, must: 1, .. }), "{error}");
}

#[test]
fn copies_on_both_sides_of_a_contact_have_a_kink() {
    let mut scene = Model::builder("ball");
    scene.timestep(0.001).geom(WORLD, GeomBuilder::plane("floor"));
    scene.body(WORLD, BodyBuilder::free("ball").geom(GeomBuilder::sphere("ball", 0.1)));
    let model = Arc::new(scene.finish().unwrap());
    let mut sim = Simulation::new(model, Options::default(), Some(3), Precision::F64, 1).unwrap();
    for (env, height) in [0.0, 1.0, -1e-6].into_iter().enumerate() {
        sim.set(Field::Qpos, env, &[0.0, 0.0, 0.1 + height, 1.0, 0.0, 0.0, 0.0]).unwrap();
    }
    sim.step(&StepInputs::default(), 1).unwrap();
    let copies = PerturbedCopies {
        count: 3,
        columns: 1,
        sides: 2,
        one_sided: &[false],
        limited: &[],
        ranges: &[],
        limit_positions: &[],
        rubbing: &[],
        smooth_at_rest: true,
        tolerance: 1e-6,
    };
    let kinks = find_kinks(&sim, &copies).unwrap();
    assert_eq!(kinks.causes[0] & kink::CONTACT, kink::CONTACT);
    assert!(kinks.distance[0] <= 1.0);
    let error = find_kinks(&sim, &PerturbedCopies { count: 2, ..copies }).unwrap_err();
    assert!(matches!(error, Error::Length { name: "copies", .. }), "{error}");
}
