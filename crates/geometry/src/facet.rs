//! A triangle of a surface, and what is beside it.

use crate::linear_algebra::*;
use crate::pair::Pair;
use crate::round::ends;
use crate::vectors::{V, furthest};

/// An edge bulges where the neighbour falls away by more than this share of its size: vertices of mesh files are in single precision.
pub(super) const FLAT: f64 = 1e-6;

/// A direction is that of a triangle's normal: 1 - cos of what rounding leaves.
pub(super) const PARALLEL: f64 = 1e-12;

/// A triangle, and what is beside it: entry k belongs to the edge that leaves corner k.
pub(super) struct Facet {
    pub(super) corners: [V; 3],
    pub(super) normal: V,
    /// The neighbours' third corners.
    pub(super) across: [Option<V>; 3],
    /// Where the surface bulges (it does at an outer edge).
    pub(super) bulges: [bool; 3],
}

/// A part of a triangle.
pub(super) enum Outline {
    Inside,
    /// On the edge that leaves a corner.
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

    /// Tangent of the angle by which each neighbour rises, at most 1: behind a valley, this share of its depth is over neither of the two.
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

    /// What of the triangle is furthest along `d`, and a corner that is.
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

    /// Whether any part of the second shape of a pair may be over the triangle, or behind it beside a valley of these [`Facet::rises`]. A
    /// ball or capsule that is beyond an edge with its whole core is not.
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
