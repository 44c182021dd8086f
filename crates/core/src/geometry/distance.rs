//! Distance of two solids, for tests that hold contacts against it.

use crate::geometry::expand::Polytope;
use crate::geometry::pair::Pair;
use crate::geometry::separation;
use crate::geometry::shape::ConvexShape;
use crate::geometry::vectors::{Pose, V};
use crate::math::spatial::*;

/// Signed distance of two convex shapes (m; minus the depth where they overlap) and the unit normal from the first to the second, in the
/// world.
pub fn distance(a: &ConvexShape, pose_a: &Pose, b: &ConvexShape, pose_b: &Pose) -> (f64, V) {
    let pair = Pair::new(a, pose_a, b, pose_b);
    let found = separation::nearest(&pair, &f64::INFINITY.into(), &mut Polytope::default()).found;
    (found.separation - pair.thickness(), rotate(&pose_a.mat, found.normal))
}
