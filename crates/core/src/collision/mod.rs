//! Collision detection: broad phase, narrow phase (with the kernels of stepper-geometry), and the contacts of a step.

pub(crate) mod adhesion;
pub mod broad_phase;
pub(crate) mod contact_reduction;
pub mod contact_set;
pub mod detection;
pub(crate) mod joint_path;
pub mod narrow_phase;
pub mod separation_cache;
pub(crate) mod static_search;
pub mod surface_velocity;
pub(crate) mod swept_pair;
pub mod terrain;
pub mod tunnelling;
