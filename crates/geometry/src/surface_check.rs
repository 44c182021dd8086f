//! Check that triangles are the surface of the convex hull of points. Triangles from a file may be wrong, and the check takes less time
//! than a new hull.
//!
//! A closed surface of triangles is that of a convex body under three conditions (Mehlhorn, Naher, Seel, Seidel, Schilz, Schirra & Uhrig,
//! 1999). No edge is bent inwards, every triangle faces away from one inner point, and a ray from that point meets the surface once. Each
//! condition is the exact sign of a few volumes per triangle.
//!
//! The check then tests that every given point is inside. For each, it walks along the surface to the triangle that the ray from the
//! inner point to the given point crosses. The point must not be on the outer side of this triangle.

use crate::linear_algebra::*;
use crate::quickhull::volume_over;
use crate::vectors::V;

/// Rounding error of a dot product, relative to the product of both vectors' sums of absolute values.
const ROUNDING: f64 = 1e-13;

/// Closed surface of triangles that is checked for convexity.
pub(super) struct SurfaceCheck<'a> {
    /// Vertices of the surface, m.
    pub(super) points: &'a [V],
    /// Triangles of the surface as vertex indices, counter-clockwise seen from outside.
    pub(super) triangles: &'a [[u32; 3]],
    /// For each triangle, indices of the neighbouring triangles across the edges that start at its three corners.
    pub(super) neighbours: &'a [[u32; 3]],
    /// Point inside the surface, m.
    pub(super) centre: V,
}

impl SurfaceCheck<'_> {
    /// Whether the surface is certainly convex. The result may be false for a convex surface that is very thin or has very narrow
    /// triangles.
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
        (0..self.triangles.len()).all(|t| self.neighbours[t].iter().all(|&n| behind(t, n as usize)))
            && self.triangles.iter().all(|t| volume_over(self.corners(t), self.centre) < 0.0)
            && self.triangles.iter().filter(|t| before(t)).count() == 1
    }

    /// Whether all points are inside the surface or outside by at most `near`, m. The surface must be convex.
    pub(super) fn contains(&self, points: &[V], near: f64) -> bool {
        let over = |t: usize, p: V| {
            let [a, b, c] = self.corners(&self.triangles[t]);
            let normal = cross(sub(b, a), sub(c, a));
            dot(normal, sub(p, a)) <= near * norm(normal)
        };
        let mut at = 0;
        // Consecutive points of the list are often close to each other.
        points.iter().all(|&p| {
            for _ in 0..self.triangles.len() {
                match self.edge_outside(&self.triangles[at], p) {
                    Some(k) => at = self.neighbours[at][k] as usize,
                    None => return over(at, p),
                }
            }
            // On a flat face, rounding may make the walk circular.
            (0..self.triangles.len()).all(|t| over(t, p))
        })
    }

    /// First edge of a triangle that has the ray from the inner point to `p` on its outer side. `None` if the ray crosses the triangle. A
    /// ray through an edge, up to rounding, counts as crossing the triangle.
    fn edge_outside(&self, triangle: &[u32; 3], p: V) -> Option<usize> {
        let corners = self.corners(triangle).map(|q| sub(q, self.centre));
        let p = sub(p, self.centre);
        (0..3).find(|&k| {
            let side = cross(corners[k], corners[(k + 1) % 3]);
            dot(side, p) < -ROUNDING * (side[0].abs() + side[1].abs() + side[2].abs()) * (p[0].abs() + p[1].abs() + p[2].abs())
        })
    }

    /// Corners of a triangle of the surface, m.
    fn corners(&self, triangle: &[u32; 3]) -> [V; 3] {
        triangle.map(|v| self.points[v as usize])
    }
}
