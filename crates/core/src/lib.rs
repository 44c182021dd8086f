//! A rigid-body contact stepper for robots.
//!
//! A simulator is a promise about the next state: a state-transition model, a sensor model and an error budget. One step is ten
//! [`stages`], each explicit and measured; [`step::step`] reads them aloud.
//!
//! ```
//! use std::sync::Arc;
//! use stepper_core::batch::{Field, StepInputs};
//! use stepper_core::model::{BodyBuilder, GeomBuilder, JointBuilder, Model, WORLD};
//! use stepper_core::{Options, Precision, Simulation, Status};
//!
//! // A ball half a metre above a floor.
//! let mut scene = Model::builder("drop");
//! scene.geom(WORLD, GeomBuilder::plane("floor"));
//! let ball = BodyBuilder::new("ball").pos([0.0, 0.0, 0.6]).joint(JointBuilder::free("root"));
//! scene.body(WORLD, ball.geom(GeomBuilder::sphere("ball", 0.1).density(1000.0)));
//! let model = Arc::new(scene.finish()?);
//!
//! // Sixteen of them, for a second.
//! let mut sim = Simulation::new(model.clone(), Options::default(), Some(16), Precision::F64, 1)?;
//! sim.step(&StepInputs::default(), 500)?;
//!
//! let mut q = vec![0.0; model.nq()];
//! sim.get(Field::Qpos, 3, &mut q);
//! assert!((q[2] - 0.1).abs() < 1e-5); // at rest on the floor, within the slop
//! assert_eq!(sim.status(3), Status::OK.0);
//! let weight = model.bodies[1].mass * 9.81;
//! assert!((sim.contacts(3)[0].1.impulse[0] - weight).abs() < 1e-6 * weight); // N
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Models come from [`Model::builder`], or from files that the Python package saved: [`Model::load`].

pub mod actuation;
pub mod batch;
mod broad;
pub mod constraints;
pub mod contacts;
pub mod drive;
pub mod fluid;
pub mod geometry;
pub mod inertia;
mod islands;
pub mod kinematics;
mod lanes;
pub mod limit;
pub mod mocap;
pub mod model;
pub mod normals;
pub mod options;
pub mod overlaps;
pub mod plan;
pub mod query;
pub mod restitution;
mod rk4;
pub mod rollout;
pub mod saved;
pub mod sensing;
mod simulation;
pub mod spatial;
pub mod spin;
pub mod stages;
pub mod state;
pub mod step;
pub mod surfaces;
pub mod theta;
pub mod worker;

pub use model::{Model, ModelError};
pub use options::{Integrator, Options, Solver, Stabilization};
pub use rollout::Precision;
pub use saved::SavedState;
pub use simulation::{Error, Simulation};
pub use stages::s10_record::Status;
pub use stepper_real::Level;
