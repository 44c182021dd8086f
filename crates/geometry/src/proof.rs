//! Whether triangles are the surface of the convex hull of points: what a file says is not believed, and to look costs less than to make it
//! anew.
//!
//! A closed surface of triangles is that of a convex body if no edge of it is bent inwards, all of it faces away from one point, and a ray
//! from that point meets it once (Mehlhorn, Naher, Seel, Seidel, Schilz, Schirra & Uhrig 1999). All three are exact signs of volumes, a few
//! for each triangle. Points are then followed, from triangle to triangle, to the one that is before them as seen from that same point.

use crate::linear_algebra::*;
use crate::quickhull::volume_over;
use crate::vectors::V;

/// Of a product of two vectors, as a share of their lengths.
const ROUNDING: f64 = 1e-13;

/// The surface in question, closed: triangles of points (m), those across the edges that leave their corners, and a point inside.
pub(super) struct Suspect<'a> {
    pub(super) points: &'a [V],
    pub(super) triangles: &'a [[u32; 3]],
    pub(super) beside: &'a [[u32; 3]],
    pub(super) centre: V,
}

impl Suspect<'_> {
    /// Whether it is certainly convex; it may be where triangles are so narrow, or the whole so thin, that signs do not tell.
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

    /// Whether points are within `near` (m) of a surface that is convex, or inside of it.
    pub(super) fn holds(&self, points: &[V], near: f64) -> bool {
        let over = |t: usize, p: V| {
            let [a, b, c] = self.corners(&self.triangles[t]);
            let normal = cross(sub(b, a), sub(c, a));
            dot(normal, sub(p, a)) <= near * norm(normal)
        };
        let mut at = 0;
        // Neighbours in a list of points are often neighbours in space.
        points.iter().all(|&p| {
            for _ in 0..self.triangles.len() {
                match self.edge_before(&self.triangles[at], p) {
                    Some(k) => at = self.beside[at][k] as usize,
                    None => return over(at, p),
                }
            }
            // Over a flat face a way may lead round and round.
            (0..self.triangles.len()).all(|t| over(t, p))
        })
    }

    /// The first edge of a triangle beyond which a point is, seen from the centre; what is before an edge up to rounding is beyond none.
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
