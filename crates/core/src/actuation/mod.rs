//! Actuator models: from a control to a force.
//!
//! ```text
//! control -> range -> delay -> servo (sampled and held, or continuous) -> lag -> affine force -> limits -> torque-speed curve
//!     -> gear and friction -> joint
//! ```
//!
//! Before each step, the pipelines compute delay, servo and lag (`pipeline.rs`). Length and velocity terms of servos and affine forces act
//! within the step, where they can be implicit (`forces.rs`). Losses are rows of dry friction, and the rotor's inertia is armature.
//! Lengths, velocities and forces are those of the actuator, as in MJCF: a length is the joint's position times `gear`, and a force times
//! `gear` is the joint's force.

pub mod actuator_models;
pub mod affine_force;
pub mod force_limits;
pub mod forces;
pub mod losses;
pub mod memory;
pub mod moments;
pub(crate) mod muscle;
pub mod pipeline;

pub use crate::actuation::actuator_models::{ActuatorModels, ActuatorUpdate};
pub use crate::actuation::pipeline::ActuatorPipelines;
pub use crate::model::actuator_spec::{ActuatorSpec, Motor, Servo};
