//! Narrow phase: one file per pair of shapes. Every function is stateless: the same poses give the same contacts.
//!
//! Normals point from the first geom to the second, positions are halfway between the surfaces.

mod boxes;
mod cylinder;
mod ellipsoid;
mod plane;
mod segments;

pub use crate::collision::pairs::boxes::{Cuboid, capsule_box, sphere_box};
pub use crate::collision::pairs::cylinder::{Cylinder, cylinder_rims, plane_point, sphere_cylinder};
pub use crate::collision::pairs::ellipsoid::{Ellipsoid, plane_ellipsoid, sphere_ellipsoid};
pub use crate::collision::pairs::plane::{plane_box, plane_sphere};
pub use crate::collision::pairs::segments::{Segment, segments};
