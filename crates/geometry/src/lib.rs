//! Collision geometry: contact points, distances, convex hulls and rays. It does not depend on bodies or models.
//!
//! ```
//! use std::sync::Arc;
//! use stepper_geometry::{ConvexShape, Hull, Narrow, Pose, Solid};
//!
//! let upright = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
//! let corners: Vec<[f64; 3]> = (0..8).map(|k| [0, 1, 2].map(|axis| if k >> axis & 1 == 1 { 0.1 } else { -0.1 })).collect();
//! let cube = Solid::Convex(ConvexShape::Hull(Arc::new(Hull::new(&corners)?)));
//! let table = Solid::Convex(ConvexShape::Box { half: [1.0, 1.0, 0.5] });
//!
//! // The cube floats 1 mm above the table. Contacts are found up to a distance of 1 cm.
//! let poses = [[0.0; 3], [0.2, 0.0, 0.601]].map(|pos| Pose { pos, mat: upright });
//! let mut narrow = Narrow::default();
//! let found = narrow.collide([&table, &cube], poses, 0.01);
//!
//! assert_eq!(found.points.len(), 4); // the corners of the lower face
//! for point in &found.points {
//!     assert_eq!(point.normal, [0.0, 0.0, 1.0]); // from the first solid to the second
//!     assert!((point.distance - 0.001).abs() < 1e-15); // m
//! }
//! # Ok::<(), stepper_geometry::HullError>(())
//! ```
//!
//! | to do | see |
//! |---|---|
//! | contact points of two solids | [`Narrow::collide`] |
//! | distance and normal of two convex shapes | [`distance`] |
//! | contacts of two simple shapes in every lane of a SIMD type | [`pairs`] |
//! | tests over lanes that two solids are too far apart to touch | [`BoundingBox`], [`SeparatingPlanes`] |
//! | convex hull of points | [`Hull`] |
//! | distance along a ray to a mesh or a height field | [`RaySurface`] |
//! | path of a string around a sphere or a cylinder | [`Obstacle::wrap`] |
//! | test whether two moving solids pass through each other | [`Narrow::may_pass`] |
//!
//! # Lanes
//!
//! [`pairs`], [`BoundingBox`] and [`SeparatingPlanes`] are written once over [`Real`](stepper_real::Real): `f64`, or a SIMD type with one
//! environment in each lane. Searches such as GJK need a different number of steps in each lane. The rest of the crate therefore computes
//! one pair at a time in f64, and only for pairs that the tests over lanes cannot exclude.
//!
//! ```
//! use stepper_geometry::pairs::{Segment, segments};
//!
//! let capsule = |z: f64, axis| Segment { centre: [0.0, 0.0, z], axis, half_length: 0.5, radius: 0.1 };
//! let (points, two) = segments(&capsule(0.0, [1.0, 0.0, 0.0]), &capsule(0.25, [0.0, 1.0, 0.0]));
//! assert!((points[0].distance - 0.05).abs() < 1e-15 && !two); // crossed capsules touch at one point
//! ```
//!
//! # Parts of parry
//!
//! The crate uses parry's tree of bounding boxes (`Bvh`), which finds the triangles of a mesh near a box or along a ray. Everything else is
//! implemented here, for three reasons:
//!
//! - A step must have the same bits whatever ran before. parry's contact manifolds start from the manifolds of the previous step. Here the
//!   contacts depend on the poses alone, and stored results only save time.
//! - Finite differences and small gaps need distances and normals that are exact up to rounding. parry's distances of cylinders have errors
//!   of up to 1e-5 m. The module `parry` of the tests compares distances, normals, closest points and depths of every pair of shapes.
//! - Pairs of simple shapes are computed over lanes, with the same instructions for all environments.
//!
//! # Method
//!
//! Every shape consists of the points within a radius of its *core*. The core of a ball is a point, and the core of a capsule is a segment.
//! All other shapes have radius 0. The contact normal is the direction of the largest separation of the cores,
//!
//! ```text
//! s(n) = min over B of n . y - max over A of n . x,        n* = argmax s(n) over unit vectors.
//! ```
//!
//! The largest separation is the distance of the cores. If they overlap, it is minus the smallest translation that separates them
//! (`separation.rs`). Any unit vector gives a lower bound, so overlapping shapes always have a contact. The contact points are the corners
//! of the intersection of the features that face each other along n* (`manifold.rs`).
//!
//! All computations are in the frame of the first shape, so that the position of a scene in the world changes only rounding. The same poses
//! always have the same contacts. A cached normal (`warm_start.rs`) or separating plane (`separating_plane.rs`) only saves time.

mod approach;
mod ball;
mod blocks;
mod bounding_box;
mod boxes;
mod clip;
mod collide;
mod expand;
mod facet;
mod facing;
mod gjk;
mod hull;
pub mod linear_algebra;
mod manifold;
mod mesh_heights;
mod narrow;
mod pair;
pub mod pairs;
mod passing;
mod polyhedron;
mod projected_feature;
mod quickhull;
mod ray;
mod round;
mod search_limits;
mod separating_plane;
mod separation;
mod shape;
mod solid;
mod surface;
mod surface_contacts;
mod vectors;
mod warm_start;
mod wrap;

pub use approach::Approach;
pub use bounding_box::BoundingBox;
pub use collide::distance;
pub use hull::{Face, Hull, HullError};
pub use manifold::{MAX_POINTS, Manifold, Point};
pub use narrow::Narrow;
pub use passing::SolidMotion;
pub use ray::RaySurface;
pub use search_limits::{CachedNormal, SearchLimits};
pub use separating_plane::{SeparatingPlane, SeparatingPlanes};
pub use shape::ConvexShape;
pub use solid::Solid;
pub use surface::{DiscHeights, Grid, MeshSurface, Surface};
pub use surface_contacts::MAX_SURFACE_POINTS;
pub use vectors::Pose;
pub use wrap::{Obstacle, Wrap};
