//! The contact normal of two hulls, if it is one of few near what it was in the last step.
//!
//! Along the old normal a face of one hull, or an edge of each, is tried as the facet of their difference that is nearest to the origin. It is
//! taken only where that is certain, so what is found does not depend on what was known: without it, the search from scratch finds the same.
//!
//! With n the facet's normal, s its separation and the nearest point at least `room` within its outline, it is certain where the hulls are apart
//! (two points at the distance s prove it), and where they overlap by d = -s and the ball of radius d about the origin lies in what is known of
//! the difference, the facet's disc of radius `room` and the ball of radius r about the difference of the centres: with that centre H deep below
//! the facet and L beside it, where 2 d < H and d (1 + 2 L / H) < min(room, r).

use super::hull::Hull;
use super::pair::Pair;
use super::separation::{NEAR_FACE, Separation, edges};
use super::shape::ConvexShape;
use super::{V, neg};
use crate::spatial::*;

/// The part of what would be certain that is taken for it: the rest is for rounding.
const SURE: f64 = 0.5;
/// Nearer to the outline than this share of the size the nearest point is on it.
const OUTLINE: f64 = 1e-9;

/// The largest separation, if that is certain; else, or for other shapes, `None`. Where it is beyond `prediction`, a lower bound of it.
pub(super) fn recall(pair: &Pair<'_>, known: V, prediction: f64) -> Option<Separation> {
    let (ConvexShape::Hull(a), ConvexShape::Hull(b)) = (pair.a, pair.b) else { return None };
    let [i, j] = pair.corners(known).map(|c| c as usize);
    let back = rotate_back(&pair.mat, neg(known));
    let is_near = |normal: V, d: V| 1.0 - dot(normal, d) < NEAR_FACE * NEAR_FACE;
    let f = a.facing_at(i, known);
    let n = a.face(f).normal;
    if is_near(n, known) {
        let y = pair.place(b.points()[b.climb(j, rotate_back(&pair.mat, neg(n)))]);
        let separation = dot(n, sub(y, a.points()[a.climb(i, n)]));
        let found = Separation::new(n, separation, [add_scaled(y, n, -separation), y]);
        if separation > prediction || is_certain(pair, &found, a.room_over(f, y)) {
            return Some(found);
        }
    }
    let g = b.facing_at(j, back);
    let m = b.face(g).normal;
    if is_near(m, back) {
        let n = neg(rotate(&pair.mat, m));
        let x = a.points()[a.climb(i, n)];
        let local = rotate_back(&pair.mat, sub(x, pair.pos));
        let separation = dot(m, sub(local, b.points()[b.climb(j, m)]));
        let found = Separation::new(n, separation, [x, add_scaled(x, n, separation)]);
        if separation > prediction || is_certain(pair, &found, b.room_over(g, local)) {
            return Some(found);
        }
    }
    let (k, l) = (a.level(i, known), b.level(j, back));
    let ends = |hull: &Hull, v: usize, w: usize| [v.min(w), v.max(w)].map(|c| hull.points()[c]);
    let (e, h) = (ends(a, i, k), ends(b, j, l).map(|p| pair.place(p)));
    let (found, [s, t]) = edges(e, h, known)?;
    let n = found.normal;
    let (u, v) = (sub(e[1], e[0]), sub(h[1], h[0]));
    let across = norm(cross(u, v));
    let room = (s.min(1.0 - s) * across / norm(v)).min(t.min(1.0 - t) * across / norm(u));
    let on = |hull: &Hull, v: usize, w: usize, d: V| [v, w].contains(&hull.climb(v, d));
    let certain = room > 0.0 && is_certain(pair, &found, room) && on(a, i, k, n) && on(b, j, l, rotate_back(&pair.mat, neg(n)));
    certain.then_some(found)
}

/// Whether a facet is the nearest of all, see above.
fn is_certain(pair: &Pair<'_>, facet: &Separation, room: f64) -> bool {
    let depth = -facet.separation;
    if room <= OUTLINE * pair.size || depth <= 0.0 {
        return room > OUTLINE * pair.size;
    }
    let along = dot(facet.normal, pair.apart);
    let below = along + depth;
    let beside = norm(add_scaled(pair.apart, facet.normal, -along));
    let ball = pair.a.least() + pair.b.least();
    2.0 * depth < below && depth * (below + 2.0 * beside) < SURE * room.min(ball) * below
}
