//! A controller loop at 100 Hz around a simulation at 500 Hz: read the state, compute controls, step, check the status. It balances a pole
//! on a cart.
//!
//!     cargo run --release -p stepper-core --example controller

use std::error::Error;

use stepper_core::model::{ActuatorBuilder, BodyBuilder, GeomBuilder, JointBuilder, WORLD};
use stepper_core::{Field, Model, Simulation, Status, StepInputs};

/// Period of the controller, in steps of the simulation.
const STEPS: usize = 5;
/// Gains of the controller: of cart position and pole angle, N/m and N/rad, and of their velocities, N s/m and N s/rad.
const GAINS: ([f64; 2], [f64; 2]) = ([1.0, 35.0], [2.5, 8.0]);

fn cart_pole() -> Result<Model, stepper_core::ModelError> {
    let mut scene = Model::builder("cart-pole");
    let cart = BodyBuilder::new("cart").joint(JointBuilder::slide("rail", [1.0, 0.0, 0.0]).range(-2.0, 2.0));
    let cart = scene.body(WORLD, cart.geom(GeomBuilder::cuboid("cart", [0.1, 0.05, 0.05]).mass(1.0).masks(0, 0)));
    let pole = GeomBuilder::capsule("pole", 0.02, 0.5).pos([0.0, 0.0, 0.5]).mass(0.2).masks(0, 0);
    scene.body(cart, BodyBuilder::new("pole").joint(JointBuilder::hinge("hinge", [0.0, 1.0, 0.0])).geom(pole));
    scene.actuator(ActuatorBuilder::motor("motor", "rail").ctrl_range(-10.0, 10.0));
    scene.timestep(0.002);
    scene.finish()
}

/// Force on the cart, N, that keeps the pole upright and the cart at the origin.
fn control(qpos: &[f64], qvel: &[f64]) -> f64 {
    let weighted = |gains: [f64; 2], values: &[f64]| gains[0] * values[0] + gains[1] * values[1];
    weighted(GAINS.0, qpos) + weighted(GAINS.1, qvel)
}

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let mut sim = Simulation::single(cart_pole()?)?;
    sim.set(Field::Qpos, 0, &[0.3, 0.1])?; // m, rad: beside the origin, and leaning

    for period in 0..1000 {
        let force = control(&sim.qpos(0), &sim.qvel(0));
        // A control that is not finite is no error: the status would have the flag NON_FINITE.
        sim.step(&StepInputs { ctrl: &[force], ..StepInputs::default() }, STEPS)?;
        if sim.status(0) != Status::OK {
            println!("{:.3} s: {}, residual {:.1e} m/s", sim.time(0), sim.status(0), sim.outcome(0).residual);
        }
        if period % 100 == 0 {
            println!("{:5.2} s: cart {:+.3} m, pole {:+.3} rad, force {force:+.2} N", sim.time(0), sim.qpos(0)[0], sim.qpos(0)[1]);
        }
    }
    let [cart, pole] = [sim.qpos(0)[0], sim.qpos(0)[1]];
    assert!(cart.abs() < 0.01 && pole.abs() < 0.001, "balanced: {cart} m, {pole} rad");
    Ok(())
}
