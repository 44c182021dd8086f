//! Contact normal of two hulls, found near the normal of the last step.
//!
//! The candidates are the facets of the difference A - B of the hulls near the old normal. First come the pair of edges of the last step,
//! then the faces of both hulls and the pairs of edges along the old normal. The last candidate is what a search for the closest points
//! finds from there. A facet is accepted only if it is certainly the one that is nearest to the origin. The result therefore does not
//! depend on the old normal: the search from scratch finds the same.
//!
//! Let n be the facet's normal, s the separation along n, and `room` the distance of the nearest point from the outline of the facet. The
//! facet is certain if the hulls are apart, because two points have the distance s. Let them overlap by d = -s. The facet is then certain
//! if the ball of radius d around the origin is inside the known part of the difference. That part consists of the disc of radius `room` on
//! the facet and of the ball of radius r around the difference of the centres. With this centre at depth H below the facet and at distance
//! L sideways from the nearest point, the conditions are 2 d < H and d (1 + 2 L / H) < min(room, r).

use crate::facing::{Facing, GAP, Separation};
use crate::gjk;
use crate::hull::Hull;
use crate::known::Known;
use crate::linear_algebra::*;
use crate::pair::Pair;
use crate::reach::Reach;
use crate::shape::ConvexShape;
use crate::vectors::{V, neg};

/// Safety factor for rounding in the condition of a certain facet.
const SURE: f64 = 0.5;
/// Distance from the outline of a facet below which a point counts as being on it, relative to the size of the pair.
const OUTLINE: f64 = 1e-9;
/// Difference below which a corner counts as equally far as an edge, relative to the size of the pair.
const ROUNDING: f64 = 4e-15;
/// Sine of the angle between two edges below which they count as parallel.
const PARALLEL: f64 = 1e-3;
/// Largest difference (1 - cos of the angle) between the old normal and a candidate.
const NEAR: f64 = 0.01;

/// Candidate for the facet: a face of the first hull, a face of the second hull, or an edge of each.
#[derive(Clone, Copy)]
enum Facet {
    First(usize),
    Second(usize),
    Across(Facing, f64),
}

/// Largest separation of two hulls, if one of the candidates near the old normal is certain (see the module). `None` for other shapes.
///
/// If the separation is beyond `reach`, the result is a lower bound.
pub(super) fn recall(pair: &Pair<'_>, known: &Known, reach: &Reach) -> Option<Facing> {
    let (ConvexShape::Hull(a), ConvexShape::Hull(b)) = (pair.a, pair.b) else { return None };
    let hulls: [&Hull; 2] = [a, b];
    let exist = |e: &[[u32; 2]; 2]| (0..2).all(|k| e[k].iter().all(|&v| (v as usize) < hulls[k].points().len()));
    let (n, edges) = (known.normal, known.edges.filter(exist));
    let last = edges.and_then(|edges| across_edges(pair, hulls, edges, n));
    if let Some(facing) = last.and_then(|(facing, room)| certain_across(pair, facing, room, reach)) {
        return Some(facing);
    }
    let back = rotate_back(&pair.mat, neg(n));
    let corners = edges.map_or_else(|| pair.corners(n), |[e, h]| [a.climb(e[0] as usize, n) as u32, b.climb(h[0] as usize, back) as u32]);
    facet_along(pair, hulls, n, corners, reach).or_else(|| {
        let [e, h] = edges.filter(|[e, h]| e[0] != e[1] && h[0] != h[1]).unwrap_or_else(|| {
            let [i, j] = corners;
            [[i, a.level(i as usize, n) as u32], [j, b.level(j as usize, back) as u32]]
        });
        let near = beside(pair, n, corners, [[e[0], h[0]], [e[1], h[0]], [e[0], h[1]]], reach)?;
        facet_along(pair, hulls, near, pair.corners(near), reach)
    })
}

/// Separation along the facet near `normal`, if it is certainly the largest. If it is beyond `reach`, the result is a lower bound.
pub(super) fn facet(pair: &Pair<'_>, normal: V, reach: &Reach) -> Option<Facing> {
    let (ConvexShape::Hull(a), ConvexShape::Hull(b)) = (pair.a, pair.b) else { return None };
    facet_along(pair, [a, b], normal, pair.corners(normal), reach)
}

/// Unit normal from the first to the second hull between their closest points, by a GJK search.
///
/// `known` is the normal of the last step. `corners` are the first hull's farthest corner along it, and the second hull's in the opposite
/// direction. If the hulls overlap there, the search first moves them apart along `known` to a small gap. It starts from the triangle
/// `start`, whose vertices are pairs of corners. It stops early at a normal along which the hulls are farther apart than `reach`.
fn beside(pair: &Pair<'_>, known: V, corners: [u32; 2], start: [[u32; 2]; 3], reach: &Reach) -> Option<V> {
    let pushed = (GAP * pair.least() - pair.apart_at(known, corners)).max(0.0);
    let shift = scale(known, pushed);
    let start = start.map(|names| pair.vertex(names, shift));
    let enough = |n: V, gap: f64| pushed == 0.0 && reach.is_parted(n, gap, pair.size);
    gjk::nearest_from(pair, shift, start, enough).normal(0.0)
}

/// Separation along the facet near the normal `known`, see [`facet`].
///
/// `corners` are the corner of the first hull that is farthest along the normal, and of the second hull in the opposite direction.
fn facet_along(pair: &Pair<'_>, [a, b]: [&Hull; 2], known: V, corners: [u32; 2], reach: &Reach) -> Option<Facing> {
    let [i, j] = corners.map(|c| c as usize);
    let (x, y) = (a.points()[i], pair.place(b.points()[j]));
    let along = Separation { normal: known, separation: dot(known, sub(y, x)), points: [x, y] };
    if reach.is_beyond(pair, &along) {
        return Some(Facing { found: along, corners, ends: corners });
    }
    let back = rotate_back(&pair.mat, neg(known));
    let (f, g) = (a.facing_at(i, known), b.facing_at(j, back));
    let level = [[corners[0], a.level(i, known) as u32], [corners[1], b.level(j, back) as u32]];
    let across = across_edges(pair, [a, b], level, known);
    let mut tries = [
        (dot(a.face(f).normal, known), Facet::First(f)),
        (dot(b.face(g).normal, back), Facet::Second(g)),
        across.map_or((-1.0, Facet::First(f)), |(facing, room)| (dot(facing.found.normal, known), Facet::Across(facing, room))),
    ];
    tries.sort_unstable_by(|s, t| t.0.total_cmp(&s.0));
    let near = tries.into_iter().take_while(|t| t.0 > 1.0 - NEAR);
    near.map(|t| t.1).find_map(|facet| {
        let (found, corners, room) = match facet {
            Facet::First(f) => {
                let n = a.face(f).normal;
                let (separation, corners) = pair.separation_near(n, corners);
                let y = pair.place(b.points()[corners[1] as usize]);
                (Separation { normal: n, separation, points: [add_scaled(y, n, -separation), y] }, corners, a.room_over(f, y))
            }
            Facet::Second(g) => {
                let n = neg(rotate(&pair.mat, b.face(g).normal));
                let (separation, corners) = pair.separation_near(n, corners);
                let x = a.points()[corners[0] as usize];
                let local = rotate_back(&pair.mat, sub(x, pair.pos));
                (Separation { normal: n, separation, points: [x, add_scaled(x, n, separation)] }, corners, b.room_over(g, local))
            }
            Facet::Across(facing, room) => return certain_across(pair, facing, room, reach),
        };
        (reach.is_beyond(pair, &found) || is_certain(pair, &found, room)).then_some(Facing { found, corners, ends: corners })
    })
}

/// The separation `facing` across two edges, if it is certain or beyond `reach`. `room` is its distance from the ends of the edges, m.
fn certain_across(pair: &Pair<'_>, facing: Facing, room: f64, reach: &Reach) -> Option<Facing> {
    let Facing { found, corners, .. } = facing;
    // No corner may be farther in this direction than the edges.
    let furthest = pair.separation_near(found.normal, corners).0 >= found.separation - ROUNDING * pair.size;
    (furthest && (reach.is_beyond(pair, &found) || is_certain(pair, &found, room))).then_some(facing)
}

/// Separation along the common perpendicular of two edges, on the side of `known`, and its distance from the ends of the edges, m.
fn across_edges(pair: &Pair<'_>, [a, b]: [&Hull; 2], [e, h]: [[u32; 2]; 2], known: V) -> Option<(Facing, f64)> {
    let sorted = |[v, w]: [u32; 2]| [v.min(w), v.max(w)];
    let names = [sorted(e), sorted(h)];
    let e = names[0].map(|v| a.points()[v as usize]);
    let h = names[1].map(|v| pair.place(b.points()[v as usize]));
    let (found, [s, t]) = edges(e, h, known)?;
    let (u, v) = (sub(e[1], e[0]), sub(h[1], h[0]));
    let area = norm(cross(u, v));
    let room = (s.min(1.0 - s) * area / norm(v)).min(t.min(1.0 - t) * area / norm(u));
    let [corners, ends] = [0, 1].map(|end| [names[0][end], names[1][end]]);
    (room > 0.0).then_some((Facing { found, corners, ends }, room))
}

/// Separation along the common perpendicular of two lines, and its places on both edges: 0 at the first end, 1 at the second.
fn edges([p, q]: [V; 2], [r, s]: [V; 2], towards: V) -> Option<(Separation, [f64; 2])> {
    let (u, v, d) = (sub(q, p), sub(s, r), sub(r, p));
    let n = cross(u, v);
    let nn = dot(n, n);
    if nn <= PARALLEL * PARALLEL * dot(u, u) * dot(v, v) {
        return None;
    }
    let at = [dot(cross(d, v), n) / nn, dot(cross(d, u), n) / nn];
    let normal = scale(n, 1f64.copysign(dot(n, towards)) / nn.sqrt());
    let points = [add_scaled(p, u, at[0]), add_scaled(r, v, at[1])];
    Some((Separation { normal, separation: dot(normal, d), points }, at))
}

/// Whether a facet is certainly the one that is nearest to the origin, see the module.
pub(super) fn is_certain(pair: &Pair<'_>, facet: &Separation, room: f64) -> bool {
    let depth = -facet.separation;
    if room <= OUTLINE * pair.size {
        return false;
    }
    if depth <= 0.0 {
        return true;
    }
    let along = dot(facet.normal, pair.apart);
    let below = along + depth;
    let beside = norm(add_scaled(pair.apart, facet.normal, -along));
    let ball = pair.a.ball() + pair.b.ball();
    2.0 * depth < below && depth * (below + 2.0 * beside) < SURE * room.min(ball) * below
}
