//! Contacts of pairs of simple shapes over lanes, one file per shape. Every function is stateless: the same poses give the same contacts.
//!
//! Normals point from the first shape to the second. Positions are halfway between the surfaces.

mod boxes;
mod contact_point;
mod cylinder;
mod ellipsoid;
mod plane;
mod segments;

pub use crate::pairs::boxes::{Cuboid, capsule_box, face_clearance, sphere_box};
pub use crate::pairs::contact_point::{ContactPoint, DISTANCE_ROUNDINGS};
pub use crate::pairs::cylinder::{Cylinder, cylinder_rims, sphere_cylinder};
pub use crate::pairs::ellipsoid::{Ellipsoid, plane_ellipsoid, sphere_ellipsoid};
pub use crate::pairs::plane::{plane_box, plane_sphere};
pub use crate::pairs::segments::{Segment, segments};
