//! A pendulum over a floor, built in code and stepped in a batch: contacts and poses of one environment.
//!
//!     cargo run --release -p stepper-core --example batch

use std::error::Error;
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

use stepper_core::model::{ActuatorBuilder, BodyBuilder, GeomBuilder, JointBuilder, WORLD};
use stepper_core::{Field, Model, Options, Precision, Simulation, Status, StepInputs};

const NUM_ENVS: usize = 8;

fn pendulum() -> Result<Model, stepper_core::ModelError> {
    let mut scene = Model::builder("pendulum");
    scene.timestep(0.001).geom(WORLD, GeomBuilder::plane("floor"));
    let pivot = JointBuilder::hinge("pivot", [0.0, 1.0, 0.0]).damping(0.05);
    let rod = GeomBuilder::capsule("rod", 0.02, 0.25).pos([0.0, 0.0, -0.25]);
    scene.body(WORLD, BodyBuilder::new("rod").pos([0.0, 0.0, 0.4]).joint(pivot).geom(rod));
    scene.actuator(ActuatorBuilder::motor("motor", "pivot").ctrl_range(-2.0, 2.0));
    scene.finish()
}

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let model = Arc::new(pendulum()?);
    let mut sim = Simulation::new(model.clone(), Options::default(), Some(NUM_ENVS), Precision::F64, 1)?;
    assert_eq!(sim.timestep(), 0.001); // that of the model

    // Every environment has its own initial angle, above the pivot, and its own torque. The rod is longer than the height of its pivot, so
    // that it falls against the floor.
    for env in 0..NUM_ENVS {
        sim.set(Field::Qpos, env, &[FRAC_PI_2 + PI * (env as f64 + 0.5) / NUM_ENVS as f64])?;
    }
    let torques: Vec<f64> = (0..NUM_ENVS).map(|env| 0.1 * env as f64).collect();
    sim.step(&StepInputs { ctrl: &torques, ..StepInputs::default() }, 3000)?;

    for env in 0..NUM_ENVS {
        let touching: f64 = sim.contacts(env).iter().map(|contact| contact.force[0]).sum();
        println!(
            "environment {env}: {:.2} s, angle {:+.3} rad, {touching:.3} N on the floor, {}",
            sim.time(env),
            sim.qpos(env)[0],
            sim.status(env)
        );
        assert!((sim.status(env) & (Status::NON_FINITE | Status::CONTACTS_FULL)).is_empty());
    }

    for contact in sim.contacts(0) {
        let names = contact.geoms.map(|geom| model.geom_label(geom));
        println!("{} on {}: {:.3?} N at {:.3?} m, distance {:+.1e} m", names[0], names[1], contact.force, contact.pos, contact.distance);
    }
    for (body, pose) in sim.body_poses_of(0, &StepInputs::default())?.iter().enumerate() {
        println!("{}: position {:.3?} m, orientation {:.3?}", model.body_label(body), pose.pos, pose.quat);
    }
    Ok(())
}
