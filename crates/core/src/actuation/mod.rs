//! Actuator models: from a control to a force.
//!
//! ```text
//! control -> range -> delay -> servo (sampled and held, or continuous) -> lag -> affine force -> limits -> torque-speed curve
//!     -> gear and friction -> joint
//! ```
//!
//! Delay, sampled servos and lag act between steps and are in this folder. The parts that depend on the motion within a step are in
//! [`crate::actuation::forces`], so that they can be implicit. Losses are rows of dry friction, and the rotor's inertia is armature. All
//! quantities are on the actuator's side: the length is MJCF's, and the effort is the force that the gear (MJCF's `gear`) transmits.

pub mod affine_force;
pub mod force_limits;
pub mod forces;
pub mod losses;
pub mod memory;
pub mod pipeline;
pub mod resampling;
pub mod site_wrench;

pub use crate::actuation::pipeline::ActuatorPipelines;
pub use crate::actuation::resampling::{ActuatorModels, ResampledActuators};
pub use crate::model::actuator_spec::{ActuatorSpec, Motor, Servo};
