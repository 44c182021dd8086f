//! Smooth dynamics of trees of bodies: kinematics, the mass matrix, Newton-Euler, gyroscopic motion, the medium, mocap bodies.

pub mod fluid;
pub mod frame_path;
pub mod gyroscopic;
pub mod implicit_weights;
pub mod inertia;
pub mod kinematics;
pub mod mocap;
