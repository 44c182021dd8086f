//! Triangle of a surface with the shape of the surface around it: the neighbouring triangles and the convex edges.

use crate::linear_algebra::*;
use crate::pair::Pair;
use crate::round::ends;
use crate::vectors::{V, furthest};

/// Relative height by which the corner of a neighbouring triangle must be below the plane for a convex edge. Vertices of mesh files have
/// single precision.
pub(super) const FLAT: f64 = 1e-6;

/// Difference of directions (1 - cos of the angle) below which a direction equals a triangle's normal up to rounding.
pub(super) const PARALLEL: f64 = 1e-12;

/// Triangle of a surface with its neighbours. Entry k of a list belongs to the edge that starts at corner k.
pub(super) struct Facet {
    pub(super) corners: [V; 3],
    pub(super) normal: V,
    /// Corner of each neighbouring triangle that is not on the shared edge, if there is a neighbour.
    pub(super) across: [Option<V>; 3],
    /// Whether each edge is convex. Edges without a neighbour count as convex.
    pub(super) bulges: [bool; 3],
}

/// Part of a triangle: inside, an edge or a corner.
pub(super) enum Outline {
    Inside,
    /// On the edge that starts at this corner.
    Edge(usize),
    Corner(usize),
}

impl Facet {
    /// A triangle with its unit normal and the third corners of its neighbours.
    pub(super) fn new(corners: [V; 3], normal: V, across: [Option<V>; 3]) -> Self {
        let falls = |d: V| {
            let fall = -dot(normal, d);
            fall > 0.0 && fall * fall > FLAT * FLAT * dot(d, d)
        };
        let bulges = std::array::from_fn(|k| across[k].is_none_or(|p| falls(sub(p, corners[k]))));
        Self { corners, normal, across, bulges }
    }

    /// Tangent of the angle by which each neighbouring triangle rises above this plane, at most 1, and 0 if it falls.
    ///
    /// In the valley between two triangles, a point behind both planes can be over neither triangle. Its distance from the edge is then at
    /// most this tangent times its depth.
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

    /// Part of the triangle that is farthest along `d`, and one of its corners that is farthest.
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

    /// Whether any part of the second shape of a pair may be over the triangle, or in the gap behind a valley with these [`Facet::rises`].
    ///
    /// The answer is no for a ball or capsule whose core is outside one edge.
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
