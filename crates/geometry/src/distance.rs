//! Distance of two solids, for tests that hold contacts against it.

use crate::expand::Polytope;
use crate::linear_algebra::*;
use crate::pair::Pair;
use crate::separation;
use crate::shape::ConvexShape;
use crate::vectors::{Pose, V};

/// Signed distance of two convex shapes (m; minus the depth where they overlap) and the unit normal from the first to the second, in the
/// world.
pub fn distance(a: &ConvexShape, pose_a: &Pose, b: &ConvexShape, pose_b: &Pose) -> (f64, V) {
    let pair = Pair::new(a, pose_a, b, pose_b);
    let found = separation::nearest(&pair, &f64::INFINITY.into(), &mut Polytope::default()).found;
    (found.separation - pair.thickness(), rotate(&pose_a.mat, found.normal))
}
