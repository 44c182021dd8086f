//! Signed distance of two convex shapes. Tests compare it with contacts.

use crate::expand::Polytope;
use crate::linear_algebra::*;
use crate::pair::Pair;
use crate::separation;
use crate::shape::ConvexShape;
use crate::vectors::{Pose, V};

/// Signed distance of two convex shapes, m, and the unit normal from the first to the second in the world frame. The distance of
/// overlapping shapes is minus the penetration depth.
pub fn distance(a: &ConvexShape, pose_a: &Pose, b: &ConvexShape, pose_b: &Pose) -> (f64, V) {
    let pair = Pair::new(a, pose_a, b, pose_b);
    let found = separation::nearest(&pair, &f64::INFINITY.into(), &mut Polytope::default()).found;
    (found.separation - pair.rounding_radii(), rotate(&pose_a.mat, found.normal))
}
