//! The direction of the largest separation of two cores.
//!
//! Where they are clearly apart it is the direction between their nearest points. Where they touch or overlap, the second is pushed out
//! along the best direction known until a small gap opens, and the direction between the nearest points across that gap is no worse:
//! with the shift t n0, t = gap - s(n0), the shifted separation is s'(n) = s(n) + t n . n0, so that
//!
//! ```text
//! s(n1) = s'(n1) - t n1 . n0 >= s'(n0) - t = s(n0).
//! ```
//!
//! Repeated, this climbs to the nearest local maximum of s, on smooth surfaces by the factor (depth + gap) / (radius of curvature + gap) each time.
//! No polytope is expanded, and there is always an answer: it starts from the best of the faces and axes of both shapes.

use super::gjk;
use super::pair::Pair;
use super::shape::ConvexShape;
use super::{V, neg, unit_or};
use crate::spatial::*;

/// A direction and what it separates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Separation {
    /// Unit, from the first to the second, in the first's frame.
    pub(super) normal: V,
    /// Of the cores, m; negative where they overlap.
    pub(super) separation: f64,
    /// The points of the cores that are nearest along it.
    pub(super) points: [V; 2],
}

/// The gap that is opened, as a share of the least extent.
const GAP: f64 = 1e-3;
/// Climbing steps at most; two to four are usual.
const CLIMBS: usize = 12;
/// Overlaps beyond this share of the least extent are deep: several ways out are tried, with a gap of [`FAR`].
const DEEP: f64 = 0.01;
const FAR: f64 = 0.5;
/// Directions within this of a face's normal (sine) may be taken for it.
const NEAR_FACE: f64 = 0.05;

/// The largest separation of the cores; stops early with a lower bound of it where that is beyond `prediction`.
pub(super) fn nearest(pair: &Pair<'_>, prediction: f64) -> Separation {
    let gap = GAP * pair.least;
    let start = neg(pair.apart);
    let first = gjk::nearest(pair, [0.0; 3], start, gap.max(prediction + pair.thickness()));
    let length = norm(first.v);
    if first.apart && length >= gap {
        let found = Separation { normal: scale(first.v, -1.0 / length), separation: length, points: [first.x, first.y] };
        return if length - pair.thickness() > prediction { found } else { prefer_face(pair, found) };
    }
    let mut starts = suggested(pair);
    if first.apart && length > 0.0 {
        starts.offer(pair, scale(first.v, -1.0 / length));
    }
    let [best, others @ ..] = starts.0;
    let mut found = climb(pair, best, gap);
    if found.separation < -DEEP * pair.least {
        // There may be a shorter way out elsewhere: look from further away.
        for start in [best].into_iter().chain(others).filter(|c| c.separation.is_finite()) {
            let far = climb(pair, start, FAR * pair.least);
            let near = climb(pair, Candidate { normal: far.normal, separation: far.separation }, gap);
            if near.separation > found.separation + 1e-9 * pair.size {
                found = near;
            }
        }
    }
    prefer_face(pair, found)
}

/// The best of the directions that the shapes suggest.
fn suggested(pair: &Pair<'_>) -> Best {
    let mut best = Best([Candidate { normal: [0.0, 0.0, 1.0], separation: f64::NEG_INFINITY }; 3]);
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

/// The best few, best first.
struct Best([Candidate; 3]);

impl Best {
    fn offer(&mut self, pair: &Pair<'_>, normal: V) {
        let separation = pair.separation(normal);
        if let Some(k) = self.0.iter().position(|c| separation > c.separation) {
            self.0[k..].rotate_right(1);
            self.0[k] = Candidate { normal, separation };
        }
    }
}

fn climb(pair: &Pair<'_>, start: Candidate, gap: f64) -> Separation {
    let mut best = start;
    let mut points = [pair.a.support(best.normal), pair.support_b(neg(best.normal))];
    // What a step gains at rest is rounding.
    let enough = 1e-14 * pair.size;
    for _ in 0..CLIMBS {
        let shift = scale(best.normal, gap - best.separation);
        let near = gjk::nearest(pair, shift, neg(best.normal), f64::INFINITY);
        let length = norm(near.v);
        if !near.apart || length == 0.0 {
            break;
        }
        let next = Candidate { normal: scale(near.v, -1.0 / length), separation: 0.0 };
        let next = Candidate { separation: pair.separation(next.normal), ..next };
        points = [near.x, sub(near.y, shift)];
        if next.separation <= best.separation + enough {
            break;
        }
        best = next;
    }
    Separation { normal: best.normal, separation: best.separation, points }
}

/// Takes the normal of a face instead where that separates as well up to rounding: the normals of resting contacts are then exact, and
/// do not change from step to step. The first shape's face is preferred.
fn prefer_face(pair: &Pair<'_>, found: Separation) -> Separation {
    let tie = 1e-9 * pair.size;
    for flat in pair.flats(found.normal).into_iter().flatten() {
        let cos = dot(flat, found.normal);
        if cos > 0.0 && 1.0 - cos < NEAR_FACE * NEAR_FACE {
            let separation = pair.separation(flat);
            if separation >= found.separation - tie {
                return Separation { normal: flat, separation, ..found };
            }
        }
    }
    found
}
