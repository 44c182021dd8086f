//! A rigid-body contact stepper for robots.
//!
//! A simulator is a promise about the next state: a state-transition model, a sensor model and an error budget. One step is ten
//! [`stages`], each explicit and measured; [`step::step`] reads them aloud.

pub mod batch;
pub mod constraints;
pub mod contacts;
pub mod geometry;
pub mod inertia;
pub mod kinematics;
pub mod model;
pub mod options;
pub mod plan;
pub mod query;
mod rk4;
mod simulation;
pub mod spatial;
pub mod stages;
pub mod state;
pub mod step;
pub mod worker;

pub use model::{Model, ModelError};
pub use options::{Integrator, Options, Stabilization};
pub use simulation::{Error, Precision, Simulation};
pub use stages::s10_record::Status;
pub use stepper_real::Level;
