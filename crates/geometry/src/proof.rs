//! Checks that triangles are the surface of the convex hull of points. The triangles of a file are not trusted, and the check takes less
//! time than a new hull.
//!
//! A closed surface of triangles is that of a convex body under three conditions (Mehlhorn, Naher, Seel, Seidel, Schilz, Schirra & Uhrig,
//! 1999). No edge is bent inwards, every triangle faces away from one inner point, and a ray from that point meets the surface once. Each
//! condition is the exact sign of a few volumes per triangle. For every given point, the check then walks from triangle to triangle to the
//! one that the ray from the inner point to it crosses.

use crate::linear_algebra::*;
use crate::quickhull::volume_over;
use crate::vectors::V;

/// Rounding error of a dot product, relative to the product of both vectors' sums of absolute values.
const ROUNDING: f64 = 1e-13;

/// Closed surface to check: points, m, triangles, their neighbours across the edge that starts at each corner, and an inner point.
pub(super) struct Suspect<'a> {
    pub(super) points: &'a [V],
    pub(super) triangles: &'a [[u32; 3]],
    pub(super) beside: &'a [[u32; 3]],
    pub(super) centre: V,
}

impl Suspect<'_> {
    /// Whether the surface is certainly convex. A convex surface with very narrow triangles, or a very thin one, may give false.
    pub(super) fn is_convex(&self) -> bool {
        let behind = |t: usize, n: usize| {
            let apex = self.triangles[n].iter().find(|v| !self.triangles[t].contains(v));
            apex.is_some_and(|&v| volume_over(self.corners(&self.triangles[t]), self.points[v as usize]) <= 0.0)
        };
        let [a, b, c] = self.corners(&self.triangles[0]);
        let middle = scale(add(add(a, b), c), 1.0 / 3.0);
        let before = |t: &[u32; 3]| {
            let corners = self.corners(t);
            (0..3).all(|k| volume_over([self.centre, corners[k], corners[(k + 1) % 3]], middle) >= 0.0)
        };
        (0..self.triangles.len()).all(|t| self.beside[t].iter().all(|&n| behind(t, n as usize)))
            && self.triangles.iter().all(|t| volume_over(self.corners(t), self.centre) < 0.0)
            && self.triangles.iter().filter(|t| before(t)).count() == 1
    }

    /// Whether all points are inside the surface, which is convex, or outside by at most `near`, m.
    pub(super) fn holds(&self, points: &[V], near: f64) -> bool {
        let over = |t: usize, p: V| {
            let [a, b, c] = self.corners(&self.triangles[t]);
            let normal = cross(sub(b, a), sub(c, a));
            dot(normal, sub(p, a)) <= near * norm(normal)
        };
        let mut at = 0;
        // Consecutive points of the list are often close to each other.
        points.iter().all(|&p| {
            for _ in 0..self.triangles.len() {
                match self.edge_before(&self.triangles[at], p) {
                    Some(k) => at = self.beside[at][k] as usize,
                    None => return over(at, p),
                }
            }
            // On a flat face, rounding may make the walk circular.
            (0..self.triangles.len()).all(|t| over(t, p))
        })
    }

    /// First edge of a triangle that the point is outside of, seen from the inner point. Points on an edge up to rounding are not outside
    /// of it.
    fn edge_before(&self, triangle: &[u32; 3], p: V) -> Option<usize> {
        let corners = self.corners(triangle).map(|q| sub(q, self.centre));
        let p = sub(p, self.centre);
        (0..3).find(|&k| {
            let side = cross(corners[k], corners[(k + 1) % 3]);
            dot(side, p) < -ROUNDING * (side[0].abs() + side[1].abs() + side[2].abs()) * (p[0].abs() + p[1].abs() + p[2].abs())
        })
    }

    fn corners(&self, triangle: &[u32; 3]) -> [V; 3] {
        triangle.map(|v| self.points[v as usize])
    }
}
