//! Polyhedra: hulls and boxes, whose vertices, edges and faces have numbers.
//!
//! Bit k of the number of a box's vertex is 1 if coordinate k is negative. Face 2 k of a box is at the positive end of axis k, face 2 k + 1
//! at the negative end.

use crate::hull::Hull;
use crate::linear_algebra::*;
use crate::shape::ConvexShape;
use crate::vectors::{V, along_axis};

/// Polyhedron, in its frame.
#[derive(Clone, Copy)]
pub(super) enum Polyhedron<'a> {
    /// Convex hull of points.
    Hull(&'a Hull),
    /// Box with these half sizes, m.
    Box(V),
}

impl ConvexShape {
    /// The shape as a polyhedron; `None` unless it is a hull or a box.
    #[inline(always)]
    pub(super) fn polyhedron(&self) -> Option<Polyhedron<'_>> {
        match self {
            Self::Hull(hull) => Some(Polyhedron::Hull(hull)),
            Self::Box { half } => Some(Polyhedron::Box(*half)),
            _ => None,
        }
    }
}

impl Polyhedron<'_> {
    /// Number of vertices.
    pub(super) fn vertices(self) -> usize {
        match self {
            Self::Hull(hull) => hull.points().len(),
            Self::Box(_) => 8,
        }
    }

    /// Position of the vertex `vertex`, m.
    #[inline(always)]
    pub(super) fn point(self, vertex: u32) -> V {
        match self {
            Self::Hull(hull) => hull.points()[vertex as usize],
            Self::Box(half) => array_of(|k| if vertex >> k & 1 == 1 { -half[k] } else { half[k] }),
        }
    }

    /// Vertex that is farthest along `d`. The search in a hull starts at the vertex `from`.
    #[inline(always)]
    pub(super) fn climb(self, from: u32, d: V) -> u32 {
        match self {
            Self::Hull(hull) => hull.climb(from as usize, d) as u32,
            Self::Box(_) => (0..3).fold(0, |bits, k| bits | u32::from(d[k].is_sign_negative()) << k),
        }
    }

    /// Face whose normal is closest to `d`, among the faces that meet at a vertex.
    #[inline(always)]
    pub(super) fn facing_at(self, vertex: u32, d: V) -> usize {
        match self {
            Self::Hull(hull) => hull.facing_at(vertex as usize, d),
            Self::Box(_) => {
                let along = |k: usize| if vertex >> k & 1 == 1 { -d[k] } else { d[k] };
                let k = (1..3).fold(0, |best, k| if along(k) > along(best) { k } else { best });
                2 * k + (vertex >> k & 1) as usize
            }
        }
    }

    /// Outward unit normal of a face.
    #[inline(always)]
    pub(super) fn normal(self, face: usize) -> V {
        match self {
            Self::Hull(hull) => hull.faces[face].normal,
            Self::Box(_) => along_axis(face / 2, if face.is_multiple_of(2) { 1.0 } else { -1.0 }),
        }
    }

    /// Vertex at the other end of that edge of `vertex` that is closest to perpendicular to `d`.
    #[inline(always)]
    pub(super) fn level(self, vertex: u32, d: V) -> u32 {
        match self {
            Self::Hull(hull) => hull.level(vertex as usize, d) as u32,
            Self::Box(_) => vertex ^ 1 << (1..3).fold(0, |best, k| if d[k].abs() < d[best].abs() { k } else { best }),
        }
    }

    /// Distance of a point above a face from the outline of the face, m. It is negative outside of the outline.
    ///
    /// The point `p` is in the frame of the polyhedron, m.
    pub(super) fn distance_from_outline(self, face: usize, p: V) -> f64 {
        match self {
            Self::Hull(hull) => hull.distance_from_outline(face, p),
            Self::Box(half) => (1..3).map(|i| (face / 2 + i) % 3).map(|k| half[k] - p[k].abs()).fold(f64::INFINITY, f64::min),
        }
    }
}
