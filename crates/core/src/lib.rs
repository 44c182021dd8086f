//! A rigid-body contact stepper for robots.
//!
//! A [`Simulation`] steps many environments of one [`Model`]: articulated bodies with hard contact, Coulomb friction, joint limits,
//! equalities, actuators and sensors. Units are SI, names are MuJoCo's (`qpos`, `qvel`, `ctrl`; nq, nv, nu; quaternions (w, x, y, z)).
//! Environments share SIMD lanes and threads. Each has the same bits for every batch size, thread count and CPU level. After every step a
//! residual gives the error of the constraint problem in m/s, and a [`Status`] per environment flags unsolved steps.
//!
//! ```
//! use stepper_core::model::{BodyBuilder, GeomBuilder, WORLD};
//! use stepper_core::{Model, Simulation, StepInputs};
//!
//! let mut scene = Model::builder("drop");
//! scene.geom(WORLD, GeomBuilder::plane("floor"));
//! scene.body(WORLD, BodyBuilder::free("ball").pos([0.0, 0.0, 0.6]).geom(GeomBuilder::sphere("ball", 0.1)));
//! let mut sim = Simulation::single(scene.finish()?)?;
//! sim.step(&StepInputs::default(), 1000)?;
//! println!("{:.3?} after {:.3} s: {}", sim.qpos(0), sim.time(0), sim.status(0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Many environments with separate states; contacts, poses and saved states:
//!
//! ```
//! use std::sync::Arc;
//! use stepper_core::model::{BodyBuilder, GeomBuilder, WORLD};
//! use stepper_core::{Field, Model, Options, Precision, SavedState, Simulation, Status, StepInputs};
//!
//! // A ball half a metre above a floor, with a time step of 1 ms.
//! let mut scene = Model::builder("drop");
//! scene.timestep(0.001).geom(WORLD, GeomBuilder::plane("floor"));
//! let ball = BodyBuilder::free("ball").pos([0.0, 0.0, 0.6]).geom(GeomBuilder::sphere("ball", 0.1).density(1000.0));
//! let ball = scene.body(WORLD, ball);
//! let model = Arc::new(scene.finish()?);
//!
//! // Sixteen of them, for a second and a half; number 3 starts with a sideways velocity.
//! let mut sim = Simulation::new(model.clone(), Options::default(), Some(16), Precision::F64, 1)?;
//! assert_eq!(sim.timestep(), 0.001); // the model's, unless the options have another
//! sim.set(Field::Qvel, 3, &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0])?;
//! sim.step(&StepInputs::default(), 1500)?;
//!
//! assert_eq!(sim.status(3), Status::OK);
//! let root = model.joint("ball")?; // its ranges in qpos and qvel
//! assert!((sim.qpos(0)[root.qpos][2] - 0.1).abs() < 1e-5); // m; it lies on the floor, within the slop
//! let weight = model.bodies[ball].mass * 9.81;
//! assert!((sim.contacts(0)[0].force[0] - weight).abs() < 1e-6 * weight); // N
//! let poses = sim.body_poses_of(3, &StepInputs::default())?;
//! assert!(poses[ball].pos[0] > 0.5); // m
//!
//! // A saved state belongs to its model. Continuing from it gives the same bits, and so does a clone.
//! let bytes = sim.save_state().to_bytes();
//! let mut other = Simulation::new(model, Options::default(), Some(16), Precision::F64, 1)?;
//! other.restore_state(&SavedState::from_bytes(&bytes)?)?;
//! let mut clone = sim.clone();
//! for simulation in [&mut sim, &mut other, &mut clone] {
//!     simulation.step(&StepInputs::default(), 100)?;
//! }
//! assert_eq!(other.qpos(3), sim.qpos(3));
//! assert_eq!(clone.qpos(3), sim.qpos(3));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The folder `examples/` has a controller loop, a batch with contacts and poses, saved states, and per-environment parameters.
//!
//! Models come from [`Model::builder`], from a [`model::Description`] that is filled in and finished, or from files. [`Model::load`] reads
//! the files of the Python package, which imports MJCF and URDF. [`Options::from_model`] returns the settings of such a file. A finished
//! model is valid and cannot be edited. Elements have indices, which [`Model::joint`](model::Description::joint) and the like find by name.
//!
//! # Errors and panics
//!
//! Invalid input is an [`Error`], which changes nothing; an invalid model is a [`ModelError`]. Both name the element or argument, the value
//! and the remedy, and have a variant for every case. An unsolved step is no error: its environment gets a [`Status`]. If a next state is
//! not finite, the environment gets [`Status::NON_FINITE`]. The bodies concerned keep their last finite state, and so do all bodies to
//! which constraints connect them. Other bodies and other environments continue.
//!
//! A control that is not finite is no error, because an error would end the steps of all other environments too. See [`StepInputs::ctrl`].
//!
//! Some methods take the index of an environment and return no `Result`. They panic if there is no such environment, like an index beyond
//! the end of a slice. The documentation of each lists this panic. Any other panic is a defect.
//!
//! # Features
//!
//! - `avx2` and `avx512` (on by default) compile the step for these CPU levels, in addition to the baseline (SSE2, or NEON). The engine
//!   runs the fastest level of the machine, with the same bits. `default-features = false` compiles the baseline alone, which builds
//!   faster.
//! - `nalgebra` (off by default) adds its types to the interface: fields of the state as vectors and matrices, body poses as isometries,
//!   contact forces in world axes. Builders take its vectors, points, rotations and isometries. The feature also exports nalgebra, in the
//!   version that the crate uses.
//! - `internals` (off by default) adds the module `internals` for the benches and tests of this workspace. It changes without notice.
//!
//! serde, postcard and sha2 are not optional. Saved models and states are bytes with a checksum. Every saved state has the digest of its
//! model, so that a simulation refuses the state of another model.

//! # Build times and debug builds
//!
//! The step is compiled once for every lane type and CPU level. A release build of this crate takes about 4 minutes of processor time for
//! one level (`STEPPER_ONE_LEVEL=native`, for development) and 8 for all. In a debug build a step takes many times as long, unless
//! dependencies are optimised in the program's Cargo.toml:
//!
//! ```toml
//! [profile.dev.package."*"]
//! opt-level = 3
//! ```

// Lints run with the feature `internals`. Without it, most items that are public for benches and tests cannot be reached from outside.
#![cfg_attr(not(feature = "internals"), allow(unreachable_pub))]

mod actuation;
pub mod analysis;
mod batch;
mod collision;
mod compile;
mod constraints;
mod dynamics;
mod error;
pub mod group_step;
mod integrators;
mod math;
pub mod model;
mod options;
mod probe;
mod sensing;
mod stages;
mod step;
mod tuning;

pub use actuation::{ActuatorSpec, Motor, Servo};
pub use analysis::derived::DerivedQuantity;
pub use analysis::quantities::Snapshot;
pub use batch::WorstRow;
pub use batch::inputs::{AppliedInput, Episode, Field, StateRows, StepInputs};
pub use batch::ray_query::RayCast;
pub use batch::saved_state::SavedState;
pub use batch::simulation::{ActuatorNumbers, BodyPose, Contact, Outcome, Simulation};
pub use error::{Error, StateMisfit};
pub use math::precision::Precision;
pub use model::{Model, ModelError, Parameter};
#[cfg(feature = "nalgebra")]
pub use nalgebra;
pub use options::{ContactLaw, Integrator, Options, Solver, Stabilization};
pub use sensing::errors::Transfer;
pub use stages::s10_record::Status;
pub use stepper_real::{Level, LevelError};
pub use tuning::MAX_FRICTION;

/// Recorded quantities of [`Simulation::rollout`], and their output arrays.
pub mod rollout {
    pub use crate::batch::rollout::{Numbers, Quantity, Recording};
}

/// Interface for benches and tests of this workspace; it changes without notice.
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod internals {
    pub use stepper_geometry as geometry;

    /// Makes the contents of private modules public.
    macro_rules! publish {
        ($($module:ident)*) => { $(pub mod $module { pub use crate::$module::*; })* };
    }
    publish!(actuation batch collision compile constraints dynamics integrators math options probe sensing stages step);
}
