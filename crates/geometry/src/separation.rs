//! The direction of the largest separation of two cores.
//!
//! Where they are apart it is the direction between their nearest points (`gjk.rs`). Where polytopes overlap it is the normal of the facet
//! of their difference that is nearest to the origin (`expand.rs`); a contact that is near what it was needs neither (`recall.rs`).
//!
//! Where round bodies touch or overlap, and where rounding leaves polytopes undecided, the second is pushed out along the best direction
//! known until a small gap opens, and the direction between the nearest points across that gap is no worse: with the shift t n0, t = gap -
//! s(n0), the shifted separation is s'(n) = s(n) + t n . n0, so that
//!
//! ```text
//! s(n1) = s'(n1) - t n1 . n0 >= s'(n0) - t = s(n0).
//! ```
//!
//! Repeated, this climbs to the nearest local maximum of s, on smooth surfaces by the factor (depth + gap) / (radius of curvature + gap)
//! each time, and there is always an answer: it starts from the best of the faces and axes of both shapes.
//!
//! An overlap may have a shorter way out elsewhere. There is certainly none where a nearest point is as deep below the other's surface,
//! or where the ball of the depth's radius about the origin lies in a ball that rolls within the difference, or in what is known of it
//! (`recall.rs`). Else a search of the difference (`expand.rs`) shows that no way out is shorter, or finds one.

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

/// Polytopes are clear of one another beyond this share of their size: the direction between their nearest points is certain.
const CLEAR: f64 = 1e-9;
/// Climbing steps at most; two to four are usual.
const CLIMBS: usize = 12;
/// Depth by which another way out of an overlap must be shorter to be looked for, as a share of the size.
const SHALLOWER: f64 = 3e-8;
/// Room on a facet beyond which its corners are where the search for shorter ways begins, as a share of the size.
const WIDE: f64 = 0.01;
/// Directions within this of a face's normal (sine) may be taken for it.
pub(super) const NEAR_FACE: f64 = 0.05;
/// Nearest points further beside one another than this share of the size are not one over the other.
pub(super) const BESIDE: f64 = 1e-7;

/// The largest separation of the cores; stops early with a lower bound of it where that is beyond reach.
///
/// What is known of the normal saves time, and changes nothing.
pub(super) fn nearest(pair: &Pair<'_>, reach: &Reach, polytope: &mut Polytope) -> Facing {
    let known = || reach.known.and_then(|known| recall(pair, &known, reach));
    let mut facing = round::nearest(pair).or_else(known).unwrap_or_else(|| search(pair, reach, polytope));
    if !reach.is_beyond(pair, &facing.found) {
        facing = prefer_face(pair, facing);
    }
    // A zero has one sign, whichever way it was found.
    facing.found.normal = facing.found.normal.map(|x| x + 0.0);
    facing
}

pub(super) fn search(pair: &Pair<'_>, reach: &Reach, polytope: &mut Polytope) -> Facing {
    let distance = reach.prediction + pair.thickness();
    let found = if pair.is_polytope() { of_polytopes(pair, distance, polytope) } else { of_round_bodies(pair, distance, polytope) };
    // Rounding of the search is left behind: the normal is the facet's own.
    let own = if reach.is_beyond(pair, &found) { None } else { facet(pair, found.normal, reach) };
    own.unwrap_or_else(|| Facing::new(pair, found))
}

fn of_polytopes(pair: &Pair<'_>, reach: f64, polytope: &mut Polytope) -> Separation {
    let first = gjk::nearest(pair, [0.0; 3], neg(pair.apart), reach.max(CLEAR * pair.size));
    if let Some(normal) = first.normal(CLEAR * pair.size) {
        return first.separation(normal);
    }
    // Only a tetrahedron holds the origin.
    polytope.nearest_facet(pair, first.vertices()).unwrap_or_else(|| of_overlap(pair, &first, polytope))
}

fn of_round_bodies(pair: &Pair<'_>, reach: f64, polytope: &mut Polytope) -> Separation {
    let gap = GAP * pair.least();
    let first = gjk::nearest(pair, [0.0; 3], neg(pair.apart), reach.max(gap));
    first.normal(gap).map_or_else(|| of_overlap(pair, &first, polytope), |normal| first.separation(normal))
}

/// By climbing, see above, and from a shorter way out again, if there is one; `first` is what the search without a gap found.
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
    // A small facet would be among narrow ones.
    polytope.enclose(pair, first.vertices(), if room > WIDE * pair.size { near.vertices() } else { &[] });
    for _ in 0..CLIMBS {
        let Some(normal) = polytope.shallower(pair, -found.separation, least) else { break };
        found = climb(pair, Candidate { normal, separation: pair.separation(normal) }).0;
    }
    found
}

/// Depth that no way out of an overlap is shorter than, m: that of a nearest point below the other shape's surface, or the radius of a ball
/// that rolls within the difference.
fn certain_depth(pair: &Pair<'_>, found: &Separation) -> f64 {
    let [x, y] = found.points;
    let of_points = pair.a.depth_of(y).max(pair.b.depth_of(rotate_back(&pair.mat, sub(x, pair.pos))));
    of_points.max(pair.a.roll() + pair.b.roll())
}

/// The best of the directions that the shapes suggest.
fn suggested(pair: &Pair<'_>) -> Candidate {
    let mut best = Candidate { normal: [0.0, 0.0, 1.0], separation: f64::NEG_INFINITY };
    best.offer(pair, unit_or(pair.apart, [0.0, 0.0, 1.0]));
    pair.a.directions(pair.apart, |n| best.offer(pair, n));
    pair.b.directions(neg(rotate_back(&pair.mat, pair.apart)), |n| best.offer(pair, neg(rotate(&pair.mat, n))));
    // Sides of round bodies that cross.
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
    /// Takes a direction instead, if it separates more.
    fn offer(&mut self, pair: &Pair<'_>, normal: V) {
        let separation = pair.separation(normal);
        if separation > self.separation {
            *self = Self { normal, separation };
        }
    }
}

/// The local maximum of the separation that a climb from `start` reaches, and the nearest points across the gap there.
fn climb(pair: &Pair<'_>, start: Candidate) -> (Separation, Nearest) {
    let gap = GAP * pair.least();
    let mut best = start;
    // What a step gains at rest is rounding.
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

/// Whether nearest points are beside one another as seen along a face's normal: what is nearest is not over the face then, and clipped with
/// the face as reference it would be lost, with as much height as what is around it is steep. Of polytopes, whose nearest points are exact.
fn is_beside(pair: &Pair<'_>, found: &Separation, flat: V) -> bool {
    let [x, y] = found.points;
    let apart = sub(y, x);
    found.separation > 0.0 && pair.is_polytope() && norm(add_scaled(apart, flat, -dot(apart, flat))) > BESIDE * pair.size
}

/// Takes the normal of a face instead where that separates as well up to rounding: the normals of resting contacts are then exact, and
/// do not change from step to step. The first shape's face is preferred.
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
        // Any two points bound what it can separate.
        if cos > 0.0 && 1.0 - cos < NEAR_FACE * NEAR_FACE && pair.apart_at(flat, corners) >= worse {
            let (separation, corners) = pair.separation_near(flat, corners);
            if separation >= worse {
                return Facing { found: Separation { normal: flat, separation, ..found }, corners, ends };
            }
        }
    }
    facing
}
