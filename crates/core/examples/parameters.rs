//! Parameters per environment: the sliding distance of a puck for four coefficients of friction.
//!
//!     cargo run --release -p stepper-core --example parameters

use std::error::Error;
use std::sync::Arc;

use stepper_core::model::{BodyBuilder, GeomBuilder, JointBuilder, WORLD};
use stepper_core::{Field, Model, Options, Parameter, Precision, Simulation, StepInputs};

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let mut scene = Model::builder("puck");
    scene.geom(WORLD, GeomBuilder::plane("ice").friction([0.0; 3]));
    let puck = BodyBuilder::new("puck").pos([0.0, 0.0, 0.02]).joint(JointBuilder::free("puck"));
    scene.body(WORLD, puck.geom(GeomBuilder::cuboid("puck", [0.05, 0.05, 0.02])));
    let model = Arc::new(scene.finish()?);

    // Sliding, torsional and rolling friction of every geom in every environment: (num_envs, ngeom, 3). A contact has the larger
    // coefficients of its two geoms.
    let coefficients = [0.1, 0.2, 0.3, 0.4];
    let friction: Vec<f64> = coefficients.iter().flat_map(|&mu| [0.0, 0.0, 0.0, mu, 0.0, 0.0]).collect();
    let envs: Vec<usize> = (0..coefficients.len()).collect();
    let mut sim = Simulation::new(model, Options::default(), Some(envs.len()), Precision::F64, 1)?;
    sim.randomize(&[(Parameter::GeomFriction, Some(&friction))], &envs)?;

    let speed = 1.0;
    for &env in &envs {
        sim.set(Field::Qvel, env, &[speed, 0.0, 0.0, 0.0, 0.0, 0.0])?;
    }
    sim.step(&StepInputs::default(), 1000)?;
    for (&env, mu) in envs.iter().zip(coefficients) {
        let (slid, coulomb) = (sim.qpos(env)[0], speed * speed / (2.0 * mu * 9.81));
        println!("friction {mu}: {slid:.4} m, by Coulomb's law {coulomb:.4} m");
        assert!((slid - coulomb).abs() < 2e-3 * speed);
    }
    Ok(())
}
