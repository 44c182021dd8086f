//! A state saved as bytes, restored, and continued with the same bits; and one environment copied to all others.
//!
//!     cargo run --release -p stepper-core --example states

use std::error::Error;
use std::sync::Arc;

use stepper_core::model::{BodyBuilder, GeomBuilder, JointBuilder, WORLD};
use stepper_core::{Field, Model, Options, Precision, SavedState, Simulation, StepInputs};

fn heap() -> Result<Model, stepper_core::ModelError> {
    let mut scene = Model::builder("heap");
    scene.geom(WORLD, GeomBuilder::plane("floor"));
    for k in 0..4 {
        let brick = BodyBuilder::new(&format!("brick {k}")).pos([0.03 * f64::from(k), 0.0, 0.1 + 0.12 * f64::from(k)]);
        let joint = JointBuilder::free(&format!("joint {k}"));
        scene.body(WORLD, brick.joint(joint).geom(GeomBuilder::cuboid(&format!("geom {k}"), [0.1, 0.08, 0.05]).density(500.0)));
    }
    scene.finish()
}

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let model = Arc::new(heap()?);
    let make = |num_envs| Simulation::new(model.clone(), Options::default(), Some(num_envs), Precision::F64, 1);

    // Half a second, saved as bytes that a file or another process may keep.
    let mut sim = make(4)?;
    for env in 0..4 {
        let speed = 0.2 * env as f64;
        sim.set(Field::Qvel, env, &[&[speed, 0.0, 0.0], &[0.0; 21][..]].concat())?;
    }
    sim.step(&StepInputs::default(), 250)?;
    let bytes = sim.save_state().to_bytes();
    println!("{} bytes for {} environments", bytes.len(), sim.num_envs());

    // Another simulation of the same model continues from these bytes, with the same bits as the first one.
    let mut other = make(4)?;
    other.restore_state(&SavedState::from_bytes(&bytes)?)?;
    for simulation in [&mut sim, &mut other] {
        simulation.step(&StepInputs::default(), 250)?;
    }
    assert!((0..4).all(|env| sim.qpos(env) == other.qpos(env)));

    // The state of one environment becomes the state of all environments of another batch.
    let mut many = make(64)?;
    many.restore_state(&sim.save_state_of(3))?;
    assert_eq!(many.qpos(63), sim.qpos(3));

    // A saved state belongs to its model. Restoring it in a simulation of another model is an error.
    let moon = Arc::new(model.replace("gravity", &[0.0, 0.0, -1.62])?);
    let mut there = Simulation::new(moon, Options::default(), Some(4), Precision::F64, 1)?;
    println!("refused: {}", there.restore_state(&sim.save_state()).unwrap_err());
    Ok(())
}
