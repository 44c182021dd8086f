//! Narrow phase: one file per pair of shapes. Every function is stateless: the same poses give the same contacts.
//!
//! Normals point from the first geom to the second, positions are halfway between the surfaces.

mod plane;
mod segments;

pub use plane::{plane_box, plane_sphere};
pub use segments::{Segment, segments};
