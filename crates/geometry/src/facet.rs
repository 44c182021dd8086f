//! Triangle of a surface, with its neighbouring triangles and its convex edges.

use crate::linear_algebra::*;
use crate::pair::Pair;
use crate::round::ends;
use crate::surface::Surface;
use crate::vectors::{V, furthest};

/// Slope below which a neighbouring triangle counts as coplanar: height of its third corner below the plane, relative to the corner's
/// distance. Vertices of mesh files have single precision.
pub(super) const FLAT: f64 = 1e-6;

/// Value of 1 - cos(angle) between a direction and a triangle's normal below which the two are equal up to rounding.
pub(super) const PARALLEL: f64 = 1e-12;

/// Triangle of a surface, with its neighbours, in the frame of the surface. Edge k starts at corner k.
pub(super) struct Facet<'a> {
    /// Surface to which the triangle belongs.
    pub(super) surface: &'a Surface,
    /// Index of the triangle in the surface.
    index: u32,
    /// Corners of the triangle, m, counter-clockwise seen from outside.
    pub(super) corners: [V; 3],
    /// Outward unit normal of the triangle.
    pub(super) normal: V,
    /// Third corner of the neighbouring triangle across each edge, m; `None` without a neighbour.
    pub(super) across: [Option<V>; 3],
    /// Whether each edge is convex: the neighbour across it falls away from the triangle's plane. Edges without a neighbour count as
    /// convex.
    pub(super) bulges: [bool; 3],
}

/// Part of a triangle: the inside, an edge or a corner.
pub(super) enum Outline {
    /// The whole triangle: its inside, edges and corners.
    Inside,
    /// Edge of the triangle, by the index of the corner at which it starts.
    Edge(usize),
    /// Corner of the triangle, by its index.
    Corner(usize),
}

impl<'a> Facet<'a> {
    /// Triangle `index` of a surface, with these corners, m, and this unit normal.
    pub(super) fn new(surface: &'a Surface, index: u32, corners: [V; 3], normal: V) -> Self {
        let across = surface.across(index);
        let falls = |d: V| {
            let fall = -dot(normal, d);
            fall > 0.0 && fall * fall > FLAT * FLAT * dot(d, d)
        };
        let bulges = std::array::from_fn(|k| across[k].is_none_or(|p| falls(sub(p, corners[k]))));
        Self { surface, index, corners, normal, across, bulges }
    }

    /// Tangent of the angle by which the neighbour across each edge rises above the triangle's plane. It is at most 1, and 0 for a
    /// neighbour that falls.
    ///
    /// In the valley between two triangles, a point behind both planes may be below neither triangle. The point is then outside the edge by
    /// at most this tangent times its depth.
    pub(super) fn rises(&self) -> [f64; 3] {
        let Self { corners, normal, across, .. } = self;
        std::array::from_fn(|k| {
            across[k].map_or(0.0, |p| {
                let d = sub(p, corners[k]);
                let outwards = cross(sub(corners[(k + 1) % 3], corners[k]), *normal);
                let (rise, run) = (dot(*normal, d), dot(outwards, d) / norm(outwards));
                if rise <= FLAT * norm(d) {
                    0.0
                } else if rise < run {
                    rise / run
                } else {
                    1.0
                }
            })
        })
    }

    /// Part of the triangle that is farthest along `d`, and a corner of this part, m. `d` is a unit vector.
    pub(super) fn furthest(&self, d: V) -> (Outline, V) {
        let k = furthest(&self.corners, d);
        let p = self.corners[k];
        let [next, last] = [(k + 1) % 3, (k + 2) % 3];
        let is_level = |other: usize| {
            let u = sub(p, self.corners[other]);
            dot(d, u) <= FLAT * norm(u)
        };
        let outline = match (is_level(next), is_level(last)) {
            (false, false) => Outline::Corner(k),
            (true, false) => Outline::Edge(k),
            (false, true) => Outline::Edge(last),
            (true, true) => Outline::Inside,
        };
        (outline, p)
    }

    /// Whether no neighbour at a part of the triangle is closer to a shape in the direction `d` than the part itself.
    ///
    /// `at` is the part, `p` a point of it, m, and `d` a unit vector. The function tests the vertices next to the part that belong to
    /// neighbouring triangles. All directions along the surface that start at the part, except those along the triangle itself, are between
    /// the directions to these vertices.
    pub(super) fn is_nearest(&self, at: &Outline, p: V, d: V) -> bool {
        let is_farther = |w: V| {
            let u = sub(w, p);
            dot(d, u) <= FLAT * norm(u)
        };
        match at {
            Outline::Inside => true,
            Outline::Edge(k) => self.across[*k].is_none_or(is_farther),
            Outline::Corner(k) => self.surface.all_around(self.index, *k, is_farther),
        }
    }

    /// Whether a shape may be above or below the triangle, in the direction of the triangle's normal. True means that it is possible.
    ///
    /// For a ball, the position of its centre counts; for a capsule, the position of its axis. Other shapes always give true.
    ///
    /// The shape is the second one of `pair`, and `rises` is from [`Facet::rises`]. In a valley, a shape beyond an edge also counts if it
    /// is behind the planes of the triangle and of the neighbour at this edge.
    pub(super) fn may_be_under(&self, pair: &Pair<'_>, rises: &[f64; 3]) -> bool {
        let Some(ends) = ends(pair) else { return true };
        let Self { corners, normal, .. } = self;
        let tolerance = 2.0 * pair.tolerance;
        (0..3).all(|k| {
            let edge = sub(corners[(k + 1) % 3], corners[k]);
            let (out, length) = (cross(edge, *normal), norm(edge));
            ends.iter().any(|end| {
                let arm = sub(*end, corners[k]);
                dot(out, arm) <= (tolerance + rises[k] * (-dot(*normal, arm)).max(0.0)) * length
            })
        })
    }
}

/// Whether a point above a triangle remains above this triangle, or above neighbours that do not fall away from its plane. The point moves
/// by up to `sideways`, m, parallel to the plane.
///
/// The triangle is the one with the index `t` of the surface, with these corners, m, and this unit normal.
pub(super) fn stays_over(surface: &Surface, t: u32, corners: &[V; 3], normal: V, point: V, sideways: f64) -> bool {
    let mut facet = None;
    let foot = add_scaled(point, normal, -dot(normal, sub(point, corners[0])));
    (0..3).all(|k| {
        let [a, b] = [corners[k], corners[(k + 1) % 3]];
        let edge = sub(b, a);
        let outwards = cross(edge, normal);
        let inside = -dot(outwards, sub(foot, a));
        if inside > 0.0 && inside * inside > sideways * sideways * dot(edge, edge) {
            return true;
        }
        // Beyond the neighbour's other edges there may be lower triangles. An overhanging neighbour is not on the other side of the
        // shared edge.
        let facet = facet.get_or_insert_with(|| Facet::new(surface, t, *corners, normal));
        let is_far_from_others = |third: V| {
            let third = add_scaled(third, normal, -dot(normal, sub(third, a)));
            dot(outwards, sub(third, a)) > 0.0 && from_segment(foot, a, third).min(from_segment(foot, third, b)) > sideways
        };
        !facet.bulges[k] && facet.across[k].is_some_and(is_far_from_others)
    })
}

/// Distance of the point `x` from the segment between `a` and `b`, m.
pub(super) fn from_segment(x: V, a: V, b: V) -> f64 {
    let (edge, arm) = (sub(b, a), sub(x, a));
    norm(add_scaled(arm, edge, -(dot(arm, edge) / dot(edge, edge)).clamp(0.0, 1.0)))
}
