//! General convex collision, one pair of shapes of one environment at a time, in f64.
//!
//! Every shape is a *core* thickened by a radius (a ball is a thick point, a capsule a thick segment; the others have radius 0). The
//! contact normal is the direction of the largest separation of the cores,
//!
//! ```text
//! s(n) = min over B of n . y - max over A of n . x,        n* = argmax s(n) over unit vectors,
//! ```
//!
//! which is the distance where the cores are apart and minus the least translation that parts them where they overlap (`separation.rs`).
//! Any unit vector gives a bound from below, so overlapping shapes always have a contact. The features that face each other along n* are
//! then laid on one another (`manifold.rs`).
//!
//! All is computed in the frame of the first shape: what a scene's place in the world changes is rounding. Nothing is remembered from call
//! to call: the same poses give the same contacts, whether a normal from before is known (`recall.rs`), or what parts the two
//! (`separating_plane.rs`), or not.

mod approach;
mod blocks;
mod bounding_box;
mod boxes;
mod clip;
#[cfg(feature = "internals")]
mod distance;
mod expand;
mod facing;
mod gjk;
mod hull;
mod known;
mod manifold;
mod narrow;
mod pair;
mod passing;
mod patch;
mod proof;
mod quickhull;
mod ray;
mod reach;
mod recall;
mod room;
mod separating_plane;
mod separation;
mod shape;
mod solid;
mod surface;
mod vectors;

pub use approach::Approach;
pub use bounding_box::BoundingBox;
pub use hull::{Hull, HullError};
pub use manifold::MAX_POINTS;
pub use narrow::Narrow;
pub use passing::SolidMotion;
pub use ray::RaySurface;
pub use reach::Reach;
pub use separating_plane::{SeparatingPlane, SeparatingPlanes};
pub use shape::ConvexShape;
pub use solid::Solid;
pub use surface::{Grid, MAX_SURFACE_POINTS, MeshSurface, Surface};
pub use vectors::Pose;

// What tests of this folder name besides.
#[cfg(feature = "internals")]
pub use {
    distance::distance,
    known::Known,
    manifold::{Manifold, Point},
    narrow::{collide, collide_plane},
    room::Room,
    surface::collide_surface,
};
