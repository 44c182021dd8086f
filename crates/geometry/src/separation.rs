//! Largest separation of the cores of two convex shapes (the shapes without their rounding radii), and its direction.
//!
//! If the cores are apart, the direction is that between their closest points (`gjk.rs`). If polytopes overlap, it is the normal of the
//! facet of their difference that is nearest to the origin (`expand.rs`). If the result is near that of the previous step, neither search
//! is needed (`warm_start.rs`).
//!
//! Round shapes that touch or overlap, and polytopes for which rounding hides the result, need another method. Let s(n) be the separation
//! along the unit vector n. The second core is moved along the best direction n0 so far until there is a small gap. The direction n1
//! between the closest points across that gap is at least as good. With the shift t n0, t = gap - s(n0), the shifted separation is s'(n) =
//! s(n) + t n . n0, so that
//!
//! ```text
//! s(n1) = s'(n1) - t n1 . n0 >= s'(n0) - t = s(n0).
//! ```
//!
//! Repetition climbs to a local maximum of s. On smooth surfaces, each step reduces the error by the factor (depth + gap) / (radius of
//! curvature + gap). There is always a result, because the climb starts from the best of the face normals and axes of both shapes.
//!
//! The overlap may be shallower in another direction. Each of three conditions proves that it is not. First, a closest point of one shape
//! is as deep below the other shape's surface as the shapes overlap. Second, the ball around the origin with the depth as radius is
//! inside a ball that can roll within the difference. Third, this ball is inside the part of the difference that is described in
//! `warm_start.rs`. Without such a proof, a search of the difference (`expand.rs`) finds a shallower direction, or shows that there is
//! none.

use crate::expand::Polytope;
use crate::facing::{EQUAL_SEPARATION, Facing, GAP, Separation};
use crate::gjk::{self, Nearest};
use crate::linear_algebra::*;
use crate::pair::Pair;
use crate::round;
use crate::search_limits::SearchLimits;
use crate::shape::ConvexShape;
use crate::vectors::{Pose, V, neg, unit_or};
use crate::warm_start::{facet, is_certain, largest_separation_near};

/// Distance of two polytopes, relative to the size of the pair, above which the direction between their closest points is exact.
const CLEAR: f64 = 1e-9;
/// Largest number of steps of [`climb`], which finds the direction of the largest separation of overlapping shapes. Two to four are usual.
const CLIMBS: usize = 12;
/// Smallest reduction of the penetration depth for which a shallower direction is searched for, relative to the size of the pair.
const SHALLOWER: f64 = 3e-8;
/// Distance of a point from the outline of a facet of the Minkowski difference, relative to the size of the pair. The point is the facet's
/// nearest one to the origin. Above this distance, the search for a shallower direction starts with the facet's vertices.
const WIDE: f64 = 0.01;
/// Sine of the angle between the contact normal and a face's normal below which the face's normal may replace the contact normal.
pub(super) const NEAR_FACE: f64 = 0.05;
/// Sideways offset, parallel to a face, of the closest points of two polytopes, relative to the size of the pair. With a larger offset, the
/// other shape's closest point is not above the face.
pub(super) const SIDEWAYS: f64 = 1e-7;

/// Largest separation of two shapes without their rounding radii. The normal is that of a face, if the separation along it is equal up to
/// rounding.
///
/// If `limits` exclude a contact, the search may stop early, and the separation is a lower bound or an estimate. A cached normal saves
/// time, and changes the result by rounding errors at most.
pub(super) fn nearest(pair: &Pair<'_>, limits: &SearchLimits, polytope: &mut Polytope) -> Facing {
    let from_cache = || limits.cached.and_then(|cached| largest_separation_near(pair, &cached, limits));
    let mut facing = round::nearest(pair).or_else(from_cache).unwrap_or_else(|| search(pair, limits, polytope));
    if !limits.excludes(pair, &facing.found) {
        facing = prefer_face(pair, facing);
    }
    // Zeros get the same sign on every path.
    facing.found.normal = facing.found.normal.map(|x| x + 0.0);
    facing
}

/// Signed distance of two shapes, m, and the unit normal from the first to the second in the world frame. `pose_a` is the pose of the first
/// shape.
pub(super) fn signed_distance(pair: &Pair<'_>, pose_a: &Pose, polytope: &mut Polytope) -> (f64, V) {
    let found = nearest(pair, &f64::INFINITY.into(), polytope).found;
    (found.separation - pair.rounding_radii(), rotate(&pose_a.mat, found.normal))
}

/// Largest separation of two shapes without their rounding radii, computed without a cached normal.
pub(super) fn search(pair: &Pair<'_>, limits: &SearchLimits, polytope: &mut Polytope) -> Facing {
    let distance = limits.max_distance + pair.rounding_radii();
    let found = if pair.is_polytope() { of_polytopes(pair, distance, polytope) } else { of_round_bodies(pair, distance, polytope) };
    // The normal in `own` is exactly that of the facet, without the rounding error of the search.
    let own = if limits.excludes(pair, &found) { None } else { facet(pair, found.normal, limits) };
    own.unwrap_or_else(|| Facing::new(pair, found))
}

/// Largest separation of two polytopes. If they are certainly farther apart than `max_distance`, m, the search may stop early.
fn of_polytopes(pair: &Pair<'_>, max_distance: f64, polytope: &mut Polytope) -> Separation {
    let first = gjk::nearest(pair, [0.0; 3], neg(pair.apart), max_distance.max(CLEAR * pair.size));
    if let Some(normal) = first.normal(CLEAR * pair.size) {
        return first.separation(normal);
    }
    // The GJK simplex is a tetrahedron, if the origin is inside the difference.
    polytope.nearest_facet(pair, first.simplex.vertices()).unwrap_or_else(|| of_overlap(pair, &first, polytope))
}

/// Largest separation of two shapes of which at least one is round. If they are certainly farther apart than `max_distance`, m, the search
/// may stop early.
fn of_round_bodies(pair: &Pair<'_>, max_distance: f64, polytope: &mut Polytope) -> Separation {
    let gap = GAP * pair.least();
    let first = gjk::nearest(pair, [0.0; 3], neg(pair.apart), max_distance.max(gap));
    first.normal(gap).map_or_else(|| of_overlap(pair, &first, polytope), |normal| first.separation(normal))
}

/// Largest separation of overlapping shapes, by [`climb`]. The climb is repeated from every shallower direction that is found.
///
/// `first` is the result of a GJK search.
fn of_overlap(pair: &Pair<'_>, first: &Nearest, polytope: &mut Polytope) -> Separation {
    let mut best = suggested(pair);
    if let Some(normal) = first.normal(0.0) {
        best.offer(pair, normal);
    }
    let (mut found, near) = climb(pair, best);
    let least = SHALLOWER * pair.size;
    let from_outline = near.distance_from_outline(found.normal, least);
    if -found.separation <= certain_depth(pair, &found) + least || is_certain(pair, &found, from_outline) {
        return found;
    }
    // With the vertices of a small facet, the polytope would have narrow faces.
    polytope.enclose(pair, first.simplex.vertices(), if from_outline > WIDE * pair.size { near.simplex.vertices() } else { &[] });
    for _ in 0..CLIMBS {
        let Some(normal) = polytope.shallower(pair, -found.separation, least) else { break };
        found = climb(pair, Candidate { normal, separation: pair.separation(normal) }).0;
    }
    found
}

/// Depth up to which a found local minimum of the penetration depth is certainly the least over all directions, m.
///
/// This depth is the larger of two numbers. One is the depth of a closest point of one shape below the surface of the other. The other is
/// the radius of a ball that can roll along the whole inner surface of the shapes' Minkowski difference. That ball contains the ball
/// around the origin whose radius is the found depth.
fn certain_depth(pair: &Pair<'_>, found: &Separation) -> f64 {
    let [x, y] = found.points;
    let of_points = pair.a.depth_of(y).max(pair.b.depth_of(rotate_back(&pair.mat, sub(x, pair.pos))));
    of_points.max(pair.a.roll() + pair.b.roll())
}

/// Direction with the largest separation among the face normals and axes of two shapes.
fn suggested(pair: &Pair<'_>) -> Candidate {
    let mut best = Candidate { normal: [0.0, 0.0, 1.0], separation: f64::NEG_INFINITY };
    best.offer(pair, unit_or(pair.apart, [0.0, 0.0, 1.0]));
    pair.a.directions(pair.apart, |n| best.offer(pair, n));
    pair.b.directions(neg(rotate_back(&pair.mat, pair.apart)), |n| best.offer(pair, neg(rotate(&pair.mat, n))));
    // Common perpendicular of the axes of two round shapes.
    if let (Some(x), Some(y)) = (axis(pair.a), axis(pair.b)) {
        let n = cross(x, rotate(&pair.mat, y));
        let length = norm(n);
        if length > 1e-6 {
            let n = scale(n, 1.0 / length);
            best.offer(pair, n);
            best.offer(pair, neg(n));
        }
    }
    best
}

/// Axis of revolution of a capsule or cylinder, in its frame; `None` for other shapes.
fn axis(shape: &ConvexShape) -> Option<V> {
    matches!(shape, ConvexShape::Capsule { .. } | ConvexShape::Cylinder { .. }).then_some([0.0, 0.0, 1.0])
}

/// Direction along which two shapes may have their largest separation, with the separation along it.
#[derive(Clone, Copy)]
struct Candidate {
    /// Unit vector from the first shape to the second.
    normal: V,
    /// Separation along the normal of the shapes' cores (the shapes without their rounding radii), m.
    separation: f64,
}

impl Candidate {
    /// Replaces the candidate by the unit vector `normal`, if the separation along it is larger.
    fn offer(&mut self, pair: &Pair<'_>, normal: V) {
        let separation = pair.separation(normal);
        if separation > self.separation {
            *self = Self { normal, separation };
        }
    }
}

/// Climbs from the direction `start` to a local maximum of the separation of overlapping shapes.
///
/// Each step moves the shapes apart along the current direction and takes the direction between their closest points. Returns the
/// separation, and the last GJK result with the shapes moved back.
fn climb(pair: &Pair<'_>, start: Candidate) -> (Separation, Nearest) {
    let gap = GAP * pair.least();
    let mut best = start;
    // Gains below this are rounding errors.
    let enough = 1e-14 * pair.size;
    let mut near = Nearest::corner(pair, best.normal);
    let mut points = near.points();
    for _ in 0..CLIMBS {
        let shift = scale(best.normal, gap - best.separation);
        let across = gjk::nearest(pair, shift, neg(best.normal), f64::INFINITY);
        let Some(normal) = across.normal(0.0) else { break };
        let [x, y] = across.points();
        (near, points) = (across.moved_back(shift), [x, sub(y, shift)]);
        let next = Candidate { normal, separation: pair.separation(normal) };
        if next.separation <= best.separation + enough {
            break;
        }
        best = next;
    }
    (Separation { normal: best.normal, separation: best.separation, points }, near)
}

/// Whether the closest points of two polytopes are offset sideways, seen along the normal `flat` of a face.
///
/// The closest feature is then not above the face. Clipping with this face as the reference would lose it. The result is false for other
/// shapes, because only polytopes have exact closest points.
fn is_beside(pair: &Pair<'_>, found: &Separation, flat: V) -> bool {
    let [x, y] = found.points;
    let apart = sub(y, x);
    found.separation > 0.0 && pair.is_polytope() && norm(add_scaled(apart, flat, -dot(apart, flat))) > SIDEWAYS * pair.size
}

/// Replaces the contact normal by that of a face, if the separation along the face's normal is equal up to rounding. The first shape's face
/// is preferred.
///
/// Normals of resting contacts are therefore exact, and do not change from step to step.
fn prefer_face(pair: &Pair<'_>, facing: Facing) -> Facing {
    let Facing { found, corners, ends } = facing;
    let worse = found.separation - EQUAL_SEPARATION * pair.size;
    for flat in pair.flats(found.normal, corners).into_iter().flatten() {
        if flat == found.normal {
            return facing;
        }
        let cos = dot(flat, found.normal);
        if is_beside(pair, &found, flat) {
            continue;
        }
        // The distance of any two points along the direction is an upper bound of the separation along it.
        if cos > 0.0 && 1.0 - cos < NEAR_FACE * NEAR_FACE && pair.apart_at(flat, corners) >= worse {
            let (separation, corners) = pair.separation_near(flat, corners);
            if separation >= worse {
                return Facing { found: Separation { normal: flat, separation, ..found }, corners, ends };
            }
        }
    }
    facing
}
