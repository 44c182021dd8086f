//! Smooth dynamics of articulated bodies: kinematics, mass matrix, Newton-Euler, gyroscopic motion, fluid forces and mocap bodies.

pub mod fluid;
pub mod frame_path;
pub mod gyroscopic;
pub mod implicit_weights;
pub mod inertia;
pub mod kinematics;
pub mod mocap;
pub(crate) mod path_lengths;
