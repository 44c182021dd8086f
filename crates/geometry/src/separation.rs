//! Direction of the largest separation of two cores.
//!
//! If the cores are apart, it is the direction between their closest points (`gjk.rs`). If polytopes overlap, it is the normal of the facet
//! of their difference that is nearest to the origin (`expand.rs`). A contact near that of the last step needs neither (`recall.rs`).
//!
//! Round shapes that touch or overlap, and polytopes for which rounding hides the result, need another method. The second core is moved
//! along the best known direction n0 until there is a small gap. The direction n1 between the closest points across that gap is at least as
//! good. With the shift t n0, t = gap - s(n0), the shifted separation is s'(n) = s(n) + t n . n0, so that
//!
//! ```text
//! s(n1) = s'(n1) - t n1 . n0 >= s'(n0) - t = s(n0).
//! ```
//!
//! Repetition converges to a local maximum of s. On smooth surfaces, each step reduces the error by the factor (depth + gap) / (radius of
//! curvature + gap). There is always a result, because the climb starts from the best of the face normals and axes of both shapes.
//!
//! The overlap may be shallower in another direction. This is impossible if a closest point is as deep below the other shape's surface. It
//! is also impossible if the ball around the origin with the depth as radius is inside a ball that can roll within the difference. The same
//! holds if it is inside the known part of the difference (`recall.rs`). Otherwise a search of the difference (`expand.rs`) finds a
//! shallower direction, or shows that there is none.

use crate::expand::Polytope;
use crate::facing::{ALIKE, Facing, GAP, Separation};
use crate::gjk::{self, Nearest};
use crate::linear_algebra::*;
use crate::pair::Pair;
use crate::reach::Reach;
use crate::recall::{facet, is_certain, recall};
use crate::round;
use crate::shape::ConvexShape;
use crate::vectors::{V, neg, unit_or};

/// Distance of polytopes, relative to their size, above which the direction between their closest points is certain.
const CLEAR: f64 = 1e-9;
/// Largest number of climbing steps. Two to four are usual.
const CLIMBS: usize = 12;
/// Least difference of depth for which a shallower direction is searched for, relative to the size of the pair.
const SHALLOWER: f64 = 3e-8;
/// Distance of the nearest point from the outline of its facet, relative to the size of the pair. Above it, the search for a shallower
/// direction starts with the facet's corners.
const WIDE: f64 = 0.01;
/// Sine of the angle to a face's normal below which the normal may replace the direction.
pub(super) const NEAR_FACE: f64 = 0.05;
/// Sideways distance of the closest points above which neither is over the other, relative to the size of the pair.
pub(super) const BESIDE: f64 = 1e-7;

/// Largest separation of the cores. The search stops early, with a lower bound, if that is beyond reach.
///
/// A known normal saves time and does not change the result.
pub(super) fn nearest(pair: &Pair<'_>, reach: &Reach, polytope: &mut Polytope) -> Facing {
    let known = || reach.known.and_then(|known| recall(pair, &known, reach));
    let mut facing = round::nearest(pair).or_else(known).unwrap_or_else(|| search(pair, reach, polytope));
    if !reach.is_beyond(pair, &facing.found) {
        facing = prefer_face(pair, facing);
    }
    // Zeros get the same sign on every path.
    facing.found.normal = facing.found.normal.map(|x| x + 0.0);
    facing
}

pub(super) fn search(pair: &Pair<'_>, reach: &Reach, polytope: &mut Polytope) -> Facing {
    let distance = reach.prediction + pair.thickness();
    let found = if pair.is_polytope() { of_polytopes(pair, distance, polytope) } else { of_round_bodies(pair, distance, polytope) };
    // The normal is that of the facet, without the rounding error of the search.
    let own = if reach.is_beyond(pair, &found) { None } else { facet(pair, found.normal, reach) };
    own.unwrap_or_else(|| Facing::new(pair, found))
}

fn of_polytopes(pair: &Pair<'_>, reach: f64, polytope: &mut Polytope) -> Separation {
    let first = gjk::nearest(pair, [0.0; 3], neg(pair.apart), reach.max(CLEAR * pair.size));
    if let Some(normal) = first.normal(CLEAR * pair.size) {
        return first.separation(normal);
    }
    // If the origin is inside the difference, the simplex is a tetrahedron.
    polytope.nearest_facet(pair, first.vertices()).unwrap_or_else(|| of_overlap(pair, &first, polytope))
}

fn of_round_bodies(pair: &Pair<'_>, reach: f64, polytope: &mut Polytope) -> Separation {
    let gap = GAP * pair.least();
    let first = gjk::nearest(pair, [0.0; 3], neg(pair.apart), reach.max(gap));
    first.normal(gap).map_or_else(|| of_overlap(pair, &first, polytope), |normal| first.separation(normal))
}

/// Separation of overlapping cores by climbing (see the module), repeated from every shallower direction that is found.
///
/// `first` is the result of the search without a gap.
fn of_overlap(pair: &Pair<'_>, first: &Nearest, polytope: &mut Polytope) -> Separation {
    let mut best = suggested(pair);
    if let Some(normal) = first.normal(0.0) {
        best.offer(pair, normal);
    }
    let (mut found, near) = climb(pair, best);
    let least = SHALLOWER * pair.size;
    let room = near.room_on_facet(found.normal, least);
    if -found.separation <= certain_depth(pair, &found) + least || is_certain(pair, &found, room) {
        return found;
    }
    // Near a small facet, the polytope would have narrow faces.
    polytope.enclose(pair, first.vertices(), if room > WIDE * pair.size { near.vertices() } else { &[] });
    for _ in 0..CLIMBS {
        let Some(normal) = polytope.shallower(pair, -found.separation, least) else { break };
        found = climb(pair, Candidate { normal, separation: pair.separation(normal) }).0;
    }
    found
}

/// Lower bound of the depth of an overlap in any direction, m. It is the depth of a closest point below the other shape's surface, or the
/// radius of a ball that can roll within the difference.
fn certain_depth(pair: &Pair<'_>, found: &Separation) -> f64 {
    let [x, y] = found.points;
    let of_points = pair.a.depth_of(y).max(pair.b.depth_of(rotate_back(&pair.mat, sub(x, pair.pos))));
    of_points.max(pair.a.roll() + pair.b.roll())
}

/// Best of the candidate directions of both shapes.
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

/// Axis of revolution of a shape that is long in that direction.
fn axis(shape: &ConvexShape) -> Option<V> {
    matches!(shape, ConvexShape::Capsule { .. } | ConvexShape::Cylinder { .. }).then_some([0.0, 0.0, 1.0])
}

#[derive(Clone, Copy)]
struct Candidate {
    normal: V,
    separation: f64,
}

impl Candidate {
    /// Replaces the candidate by a direction that has a larger separation.
    fn offer(&mut self, pair: &Pair<'_>, normal: V) {
        let separation = pair.separation(normal);
        if separation > self.separation {
            *self = Self { normal, separation };
        }
    }
}

/// Climbs from `start` to a local maximum of the separation. Returns it with the closest points across the gap.
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

/// Whether the closest points of polytopes have a sideways distance, seen along the normal `flat` of a face.
///
/// The closest feature is then not over the face, and clipping with this face as the reference would lose it. Only polytopes have exact
/// closest points.
fn is_beside(pair: &Pair<'_>, found: &Separation, flat: V) -> bool {
    let [x, y] = found.points;
    let apart = sub(y, x);
    found.separation > 0.0 && pair.is_polytope() && norm(add_scaled(apart, flat, -dot(apart, flat))) > BESIDE * pair.size
}

/// Replaces the normal by that of a face, if the separation is equal up to rounding. The first shape's face is preferred.
///
/// Normals of resting contacts are therefore exact, and do not change from step to step.
fn prefer_face(pair: &Pair<'_>, facing: Facing) -> Facing {
    let Facing { found, corners, ends } = facing;
    let worse = found.separation - ALIKE * pair.size;
    for flat in pair.flats(found.normal, corners).into_iter().flatten() {
        if flat == found.normal {
            return facing;
        }
        let cos = dot(flat, found.normal);
        if is_beside(pair, &found, flat) {
            continue;
        }
        // The distance of any two points along the direction bounds its separation.
        if cos > 0.0 && 1.0 - cos < NEAR_FACE * NEAR_FACE && pair.apart_at(flat, corners) >= worse {
            let (separation, corners) = pair.separation_near(flat, corners);
            if separation >= worse {
                return Facing { found: Separation { normal: flat, separation, ..found }, corners, ends };
            }
        }
    }
    facing
}
