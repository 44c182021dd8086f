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

pub use frames::{frame, motion_of, orientations, site_motion};
pub use inputs::*;
pub use masses::{angular_momentum, com, com_velocity, kinetic, potential};
pub use proximity::proximity;
pub(crate) use rays::{Placed, nearest};
pub use rays::{inside, range};
pub use touching::{contact_wrenches, contacts, touch};
