//! Actuator dynamics: a control on its way to a force.
//!
//! ```text
//! control -> range -> delay -> servo (sampled and held, or continuous) -> lag -> affine force -> limits -> speed curve
//!     -> gear and friction -> joint
//! ```
//!
//! Delay, sampled servos and lag act between steps and are here; what depends on the motion within a step is in
//! [`crate::actuation::forces`], so that it can be implicit; losses are rows of dry friction, and the rotor's inertia is armature.
//! Everything is at the actuator's side: its length is MJCF's, its effort the force that its gear (MJCF's `gear`) hands on.

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
