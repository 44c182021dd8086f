//! Test that no step reads values that an earlier step left in the work buffers.

use crate::common::{action, start, walker};
use stepper_core::{Field, Integrator, Options, Precision, Simulation, Stabilization, Status, StepInputs};

#[test]
fn nothing_is_read_before_the_step_has_made_it() {
    let model = walker();
    for integrator in [Integrator::Euler, Integrator::Midpoint, Integrator::Implicit, Integrator::Rk4] {
        for stabilization in [Stabilization::Split, Stabilization::Baumgarte] {
            for precision in [Precision::F64, Precision::F32] {
                let options = Options { integrator: Some(integrator), stabilization, ..Options::default() };
                let mut sim = Simulation::new(model.clone(), options, Some(5), precision, 1).unwrap();
                sim.poison();
                for env in 0..5 {
                    let (q, v) = start(&model, env);
                    sim.set(Field::Qpos, env, &q).unwrap();
                    sim.set(Field::Qvel, env, &v).unwrap();
                }
                for call in 0..250 {
                    let ctrl: Vec<f64> = (0..5).flat_map(|env| action(&model, env, call)).collect();
                    sim.step(&StepInputs { ctrl: &ctrl, ..StepInputs::default() }, 1).unwrap();
                    for env in 0..5 {
                        let finite = !sim.status(env).contains(Status::NON_FINITE);
                        assert!(finite, "{integrator:?}, {stabilization:?}, {precision:?}, step {call}, environment {env}");
                    }
                }
            }
        }
    }
}
