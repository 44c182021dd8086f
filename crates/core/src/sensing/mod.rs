//! Sensor models of stage 9: poses and motions of frames, momentum and energy, rays, contacts, and sensor errors.

mod contact_list;
pub mod errors;
pub mod frames;
pub mod inputs;
pub mod masses;
pub mod memory;
mod prepare;
pub mod proximity;
pub mod rays;
pub mod touching;

pub use frames::{motion_of, orientations};
pub use inputs::*;
pub(crate) use rays::{Placed, nearest};
pub use touching::contact_wrenches;
