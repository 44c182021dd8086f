//! Tests of per-environment parameters: the parameters that a compiled model has, and the same bits in all lane types.

use std::sync::Arc;

use crate::common::{action, bits, noise, start, walker};
use stepper_core::internals::compile::{CompiledModel, Params};
use stepper_core::model::{Model, Parameter};
use stepper_core::{Field, Level, Options, Precision, Simulation, StepInputs};

/// Values of the model field `name`, each multiplied by a random factor from 0.9 to 1.1. All degrees of freedom of a joint have the same
/// factor. `seed` selects the factors.
fn varied(model: &Model, name: &str, seed: u64) -> Vec<f64> {
    let values = model.field(name).unwrap().1;
    let owner = |k: usize| values[..k].iter().rposition(|x| *x != values[k]).unwrap_or(0) as u64;
    let seed = |k: usize| 1000 * seed + if name.starts_with("dof_") { owner(k) } else { k as u64 };
    // The principal moments of a rod are at the limit of the triangle inequality, so that all three get the same factor.
    let row = |k: usize| if name == "body_inertia" { k / 3 } else { k };
    // The relative orientation of a weld, columns 6 to 9, keeps its length.
    let fixed = |k: usize| name == "eq_data" && (6..10).contains(&(k % 11));
    values.iter().enumerate().map(|(k, x)| if fixed(k) { *x } else { x * (1.0 + 0.1 * noise(seed(row(k)))) }).collect()
}

/// Text of a compiled model without its parameters. The text leaves out the collision shapes, whose sizes are set when the geoms collide.
fn structure(compiled: &CompiledModel<f64>) -> String {
    let mut structure = compiled.structure.clone();
    structure.geoms.iter_mut().for_each(|g| g.solid = None);
    format!("{structure:?}")
}

#[test]
fn whatever_may_differ_is_a_parameter_and_a_plan_makes_those_of_its_variants() {
    let model = walker();
    let compiled = CompiledModel::<f64>::new(&model);
    let whole = structure(&compiled);
    for name in Parameter::ALL.map(Parameter::name) {
        let variant = model.replace(name, &varied(&model, name, 1)).unwrap();
        let own = CompiledModel::<f64>::new(&variant);
        let to_bits = |params: &Params<f64>| params.numbers().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(to_bits(&compiled.params_of(&variant)), to_bits(&own.params), "{name}");
        assert_eq!(own.params.numbers().len(), compiled.params.numbers().len(), "{name}");
        assert_eq!(structure(&own), whole, "{name}");
    }
}

fn simulation(model: &Arc<Model>, envs: &[usize], level: Level) -> Vec<Vec<u64>> {
    let mut sim = Simulation::at_level(model.clone(), Options::default(), Some(envs.len()), Precision::F64, 1, level);
    let numbers = |name: &str| envs.iter().flat_map(|&env| varied(model, name, env as u64)).collect();
    let fields: Vec<(Parameter, Vec<f64>)> = Parameter::ALL.into_iter().map(|field| (field, numbers(field.name()))).collect();
    let assigned: Vec<_> = fields.iter().map(|(field, values)| (*field, Some(&values[..]))).collect();
    sim.randomize(&assigned, &(0..envs.len()).collect::<Vec<_>>()).unwrap();
    for (e, &env) in envs.iter().enumerate() {
        let (q, v) = start(model, env);
        sim.set(Field::Qpos, e, &q).unwrap();
        sim.set(Field::Qvel, e, &v).unwrap();
    }
    for call in 0..60 {
        let ctrl: Vec<f64> = envs.iter().flat_map(|&env| action(model, env, call)).collect();
        sim.step(&StepInputs { ctrl: &ctrl, ..StepInputs::default() }, 2).unwrap();
    }
    (0..envs.len()).map(|e| bits(&sim, e)).collect()
}

#[test]
fn one_lane_and_eight_of_every_level_have_the_same_bits() {
    let model = walker();
    let all: Vec<usize> = (0..11).collect();
    let alone: Vec<_> = all.iter().map(|&env| simulation(&model, &[env], Level::Baseline).remove(0)).collect();
    for &level in Level::available() {
        assert_eq!(simulation(&model, &all, level), alone, "{level}");
    }
}

#[test]
fn nothing_changes_when_one_environment_is_refused() {
    let model = walker();
    let mut sim = Simulation::new(model.clone(), Options::default(), Some(3), Precision::F32, 1).unwrap();
    let mut masses = model.field("body_mass").unwrap().1.repeat(3);
    masses[1] = 7.0;
    let last = masses.len() - 1;
    masses[last] = -1.0;
    let error = sim.randomize(&[(Parameter::BodyMass, Some(&masses))], &[0, 1, 2]).unwrap_err().to_string();
    assert!(error.contains("environment 2: body") && error.contains("mass is -1 kg"), "{error}");
    assert!(sim.per_env_fields().next().is_none());
    assert_eq!(sim.parameter_bytes(), 0);
    let error = sim.randomize(&[(Parameter::BodyMass, Some(&masses[1..]))], &[0]).unwrap_err().to_string();
    assert!(error.contains("body_mass has"), "{error}");
}
