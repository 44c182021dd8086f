//! Contact normal of two hulls, found near the cached normal of the previous step. The first hull may be a box.
//!
//! The candidates are the facets of the Minkowski difference A - B of the hulls near the cached normal. First comes the pair of edges of
//! the previous step. Then come the faces of both hulls and the pair of edges along the cached normal. The last candidate is the facet that
//! a GJK search finds from the cached normal. A facet is accepted only if it is certainly the one that is nearest to the origin. The result
//! therefore does not depend on the cached normal: a search without it finds the same facet, up to rounding errors.
//!
//! Let n be the facet's normal, s the separation along n, and p the point of the facet that is nearest to the origin. Let m be the distance
//! of p from the outline of the facet. If the hulls are apart, the facet is certain, because two points of them have the distance s. Let
//! them overlap by d = -s. The facet is then certain if the ball of radius d around the origin is inside the convex hull of two sets. One
//! is the disc of radius m around p on the facet. The other is the ball of radius r around the difference of the hulls' centres, which is
//! inside A - B. With this centre at depth H below the facet and at distance L sideways from p, the conditions are 2 d < H and d (1 + 2 L /
//! H) < min(m, r).

use crate::facing::{Facing, GAP, Separation};
use crate::gjk;
use crate::linear_algebra::*;
use crate::pair::Pair;
use crate::polyhedron::Polyhedron;
use crate::search_limits::{CachedNormal, SearchLimits};
use crate::vectors::{V, neg};

/// Factor for rounding in the condition with which [`is_certain`] accepts a facet.
const SAFETY: f64 = 0.5;
/// Largest distance from the outline of a facet at which a point counts as being on the outline, relative to the size of the pair.
const ON_OUTLINE: f64 = 1e-9;
/// Difference of the extents along a direction below which a vertex counts as no farther than an edge, relative to the size of the pair.
const ROUNDING: f64 = 4e-15;
/// Sine of the angle between two edges below which they count as parallel.
const PARALLEL: f64 = 1e-3;
/// Largest value of 1 - cos(angle) between the direction of the search and the normal of a candidate facet.
const NEAR: f64 = 0.01;

/// Facet of the Minkowski difference A - B of two hulls that may be the nearest to the origin.
#[derive(Clone, Copy)]
enum Candidate {
    /// Face of the first hull, by its index.
    FirstFace(usize),
    /// Face of the second hull, by its index.
    SecondFace(usize),
    /// One edge of each hull, with the separation along their common perpendicular. The number is the distance of the closest points from
    /// the ends of the edges, m.
    Edges(Facing, f64),
}

/// Separation of two hulls, the largest along any direction, if the search near the cached normal finds it.
///
/// The result is `None` if it is uncertain whether another facet of the Minkowski difference A - B is nearer to the origin, and for pairs
/// other than a hull or box and a hull. If `limits` exclude a contact, the result may be a lower bound.
pub(super) fn largest_separation_near(pair: &Pair<'_>, cached: &CachedNormal, limits: &SearchLimits) -> Option<Facing> {
    let solids = pair.polyhedra()?;
    let [a, b] = solids;
    let exist = |e: &[[u32; 2]; 2]| (0..2).all(|k| e[k].iter().all(|&v| (v as usize) < solids[k].vertices()));
    let (n, edges) = (cached.normal, cached.edges.filter(exist));
    let last = edges.and_then(|edges| across_edges(pair, solids, edges, n));
    if let Some(facing) = last.and_then(|(facing, from_outline)| certain_edges(pair, facing, from_outline, limits)) {
        return Some(facing);
    }
    let back = rotate_back(&pair.mat, neg(n));
    let corners = edges.map_or_else(|| pair.corners(n), |[e, h]| [a.climb(e[0], n), b.climb(h[0], back)]);
    facet_along(pair, solids, n, corners, limits).or_else(|| {
        let [e, h] = edges.filter(|[e, h]| e[0] != e[1] && h[0] != h[1]).unwrap_or_else(|| {
            let [i, j] = corners;
            [[i, a.level(i, n)], [j, b.level(j, back)]]
        });
        let near = normal_from_gjk(pair, n, corners, [[e[0], h[0]], [e[1], h[0]], [e[0], h[1]]], limits)?;
        facet_along(pair, solids, near, pair.corners(near), limits)
    })
}

/// Separation of two hulls along the normal of a facet of their Minkowski difference A - B: the facet whose normal is near `normal`. `None`
/// if another facet may be nearer to the origin, and for pairs other than a hull or box and a hull.
///
/// If `limits` exclude a contact, the result may be a lower bound.
pub(super) fn facet(pair: &Pair<'_>, normal: V, limits: &SearchLimits) -> Option<Facing> {
    facet_along(pair, pair.polyhedra()?, normal, pair.corners(normal), limits)
}

/// Unit normal from the first hull to the second between their closest points, by a GJK search.
///
/// `cached` is the normal of the previous step. `corners` are the corner of the first hull that is farthest along it, and that of the
/// second hull in the opposite direction. If the hulls overlap, they are first moved apart along `cached` to a small gap. The search starts
/// from the triangle `start`, whose vertices are pairs of corners. It stops early if `limits` exclude a contact. `None` if the search
/// finds no distance between the hulls.
fn normal_from_gjk(pair: &Pair<'_>, cached: V, corners: [u32; 2], start: [[u32; 2]; 3], limits: &SearchLimits) -> Option<V> {
    let pushed = (GAP * pair.least() - pair.apart_at(cached, corners)).max(0.0);
    let shift = scale(cached, pushed);
    let start = start.map(|names| pair.vertex(names, shift));
    let enough = |n: V, gap: f64| pushed == 0.0 && limits.excludes_gap(n, gap, pair.size);
    gjk::nearest_from(pair, shift, start, enough).normal(0.0)
}

/// Separation of two hulls along the facet of their Minkowski difference near the direction `guess`, if the facet is certainly the nearest
/// to the origin.
///
/// `corners` are the vertex of the first hull that is farthest along `guess`, and that of the second hull in the opposite direction. If
/// `limits` exclude a contact, the result may be a lower bound.
fn facet_along(pair: &Pair<'_>, [a, b]: [Polyhedron<'_>; 2], guess: V, corners: [u32; 2], limits: &SearchLimits) -> Option<Facing> {
    let [i, j] = corners;
    let (x, y) = (a.point(i), pair.place(b.point(j)));
    let along = Separation { normal: guess, separation: dot(guess, sub(y, x)), points: [x, y] };
    if limits.excludes(pair, &along) {
        return Some(Facing { found: along, corners, ends: corners });
    }
    let back = rotate_back(&pair.mat, neg(guess));
    let (f, g) = (a.facing_at(i, guess), b.facing_at(j, back));
    let level = [[i, a.level(i, guess)], [j, b.level(j, back)]];
    let across = across_edges(pair, [a, b], level, guess);
    let mut tries = [
        (dot(a.normal(f), guess), Candidate::FirstFace(f)),
        (dot(b.normal(g), back), Candidate::SecondFace(g)),
        across.map_or((-1.0, Candidate::FirstFace(f)), |(facing, from_outline)| {
            (dot(facing.found.normal, guess), Candidate::Edges(facing, from_outline))
        }),
    ];
    tries.sort_unstable_by(|s, t| t.0.total_cmp(&s.0));
    let near = tries.into_iter().take_while(|t| t.0 > 1.0 - NEAR);
    near.map(|t| t.1).find_map(|facet| {
        let (found, corners, from_outline) = match facet {
            Candidate::FirstFace(f) => {
                let n = a.normal(f);
                let (separation, corners) = pair.separation_near(n, corners);
                let y = pair.place(b.point(corners[1]));
                (Separation { normal: n, separation, points: [add_scaled(y, n, -separation), y] }, corners, a.distance_from_outline(f, y))
            }
            Candidate::SecondFace(g) => {
                let n = neg(rotate(&pair.mat, b.normal(g)));
                let (separation, corners) = pair.separation_near(n, corners);
                let x = a.point(corners[0]);
                let local = rotate_back(&pair.mat, sub(x, pair.pos));
                (
                    Separation { normal: n, separation, points: [x, add_scaled(x, n, separation)] },
                    corners,
                    b.distance_from_outline(g, local),
                )
            }
            Candidate::Edges(facing, from_outline) => return certain_edges(pair, facing, from_outline, limits),
        };
        (limits.excludes(pair, &found) || is_certain(pair, &found, from_outline)).then_some(Facing { found, corners, ends: corners })
    })
}

/// The separation `facing` along the common perpendicular of two edges, if it is certainly the largest or if `limits` exclude a contact.
///
/// `from_outline` is the distance of the closest points from the ends of the edges, m.
fn certain_edges(pair: &Pair<'_>, facing: Facing, from_outline: f64, limits: &SearchLimits) -> Option<Facing> {
    let Facing { found, corners, .. } = facing;
    // No vertex may be farther along this normal than the edges.
    let furthest = pair.separation_near(found.normal, corners).0 >= found.separation - ROUNDING * pair.size;
    (furthest && (limits.excludes(pair, &found) || is_certain(pair, &found, from_outline))).then_some(facing)
}

/// Separation of two hulls along the common perpendicular of an edge of each, and distance of the closest points from the ends of the
/// edges, m.
///
/// `e` and `h` are the vertices of the edges of the first and second hull. The normal is the direction of the perpendicular that is closer
/// to `towards`. `None` if the closest points are not inside the edges.
fn across_edges(pair: &Pair<'_>, [a, b]: [Polyhedron<'_>; 2], [e, h]: [[u32; 2]; 2], towards: V) -> Option<(Facing, f64)> {
    let sorted = |[v, w]: [u32; 2]| [v.min(w), v.max(w)];
    let names = [sorted(e), sorted(h)];
    let e = names[0].map(|v| a.point(v));
    let h = names[1].map(|v| pair.place(b.point(v)));
    let (found, [s, t]) = common_perpendicular(e, h, towards)?;
    let (u, v) = (sub(e[1], e[0]), sub(h[1], h[0]));
    let area = norm(cross(u, v));
    let from_outline = (s.min(1.0 - s) * area / norm(v)).min(t.min(1.0 - t) * area / norm(u));
    let [corners, ends] = [0, 1].map(|end| [names[0][end], names[1][end]]);
    (from_outline > 0.0).then_some((Facing { found, corners, ends }, from_outline))
}

/// Separation of two lines along their common perpendicular, and the parameter of the closest point on each line. `None` if the lines are
/// parallel.
///
/// A parameter is 0 at the first given point of its line, and 1 at the second. The normal is the direction of the perpendicular that is
/// closer to `towards`.
fn common_perpendicular([p, q]: [V; 2], [r, s]: [V; 2], towards: V) -> Option<(Separation, [f64; 2])> {
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

/// Whether a facet of the Minkowski difference A - B of two shapes is certainly the one that is nearest to the origin. The condition is in
/// the documentation of this module.
///
/// `facet` is the separation of the shapes along the facet's normal. Let p be the point of the facet that is nearest to the origin.
/// `from_outline` is the distance of p from the outline of the facet, m.
pub(super) fn is_certain(pair: &Pair<'_>, facet: &Separation, from_outline: f64) -> bool {
    let depth = -facet.separation;
    if from_outline <= ON_OUTLINE * pair.size {
        return false;
    }
    if depth <= 0.0 {
        return true;
    }
    let along = dot(facet.normal, pair.apart);
    let below = along + depth;
    let beside = norm(add_scaled(pair.apart, facet.normal, -along));
    let ball = pair.a.ball() + pair.b.ball();
    2.0 * depth < below && depth * (below + 2.0 * beside) < SAFETY * from_outline.min(ball) * below
}
