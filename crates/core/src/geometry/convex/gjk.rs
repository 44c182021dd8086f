//! Distance of two convex sets: the point of their difference nearest to the origin.
//!
//! Gilbert, Johnson & Keerthi 1988; the nearest point of a simplex by its barycentric coordinates, with every face of it tried where they
//! are not all positive, so that degenerate simplices are no special case.

use super::V;
use super::pair::{Pair, Vertex};
use crate::spatial::*;

/// The nearest points found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nearest {
    /// From the second set to the first, x - y.
    pub(super) v: V,
    pub(super) x: V,
    pub(super) y: V,
    /// Whether the sets are apart.
    pub(super) apart: bool,
}

const ITERATIONS: usize = 200;

#[derive(Clone, Copy, Default)]
struct Simplex {
    vertex: [Vertex; 4],
    weight: [f64; 4],
    count: usize,
}

/// The nearest points of A and B + shift, searched from the direction `start` (from B to A); points further apart than `beyond` (m) where the
/// sets certainly are.
pub(super) fn nearest(pair: &Pair<'_>, shift: V, start: V, beyond: f64) -> Nearest {
    let mut simplex = Simplex { count: 1, ..Simplex::default() };
    simplex.vertex[0] = pair.support([-start[0], -start[1], -start[2]], shift);
    simplex.weight[0] = 1.0;
    let mut v = simplex.vertex[0].w;
    let rounding = 4e-16 * (pair.size + norm(v));
    for _ in 0..ITERATIONS {
        let length = norm(v);
        if length <= rounding {
            return simplex.result(v, false);
        }
        let vertex = pair.support([-v[0], -v[1], -v[2]], shift);
        // A plane at right angles to v parts the sets by v . w / |v|.
        if dot(v, vertex.w) > beyond * length {
            break;
        }
        // |v|^2 - v . w bounds what is left to gain.
        if length * length - dot(v, vertex.w) <= length * (rounding + 1e-15 * length) {
            break;
        }
        let mut next = simplex;
        next.vertex[next.count] = vertex;
        next.count += 1;
        if !next.reduce() {
            return next.result([0.0; 3], false);
        }
        let w = next.at();
        // No descent: the rest is rounding.
        if dot(w, w) >= length * length {
            break;
        }
        (simplex, v) = (next, w);
    }
    simplex.result(v, true)
}

impl Simplex {
    fn at(&self) -> V {
        self.mix(|p| p.w)
    }

    fn mix(&self, get: impl Fn(&Vertex) -> V) -> V {
        (0..self.count).fold([0.0; 3], |sum, i| add_scaled(sum, get(&self.vertex[i]), self.weight[i]))
    }

    fn result(&self, v: V, apart: bool) -> Nearest {
        Nearest { v, x: self.mix(|p| p.x), y: self.mix(|p| p.y), apart }
    }

    /// Keeps the smallest face that holds the point nearest to the origin; false where the origin is inside.
    fn reduce(&mut self) -> bool {
        let w: [V; 4] = std::array::from_fn(|i| self.vertex[i].w);
        let best = match self.count {
            2 => segment(&w, [0, 1]),
            3 => triangle(&w, [0, 1, 2]),
            _ => match tetrahedron(&w) {
                Some(best) => best,
                None => return false,
            },
        };
        let mut kept = Self::default();
        for i in 0..self.count {
            if best.weight[i] > 0.0 {
                kept.vertex[kept.count] = self.vertex[i];
                kept.weight[kept.count] = best.weight[i];
                kept.count += 1;
            }
        }
        *self = kept;
        true
    }
}

/// Barycentric coordinates of a point, and its distance from the origin, squared.
#[derive(Clone, Copy)]
struct Best {
    weight: [f64; 4],
    square: f64,
}

impl Best {
    fn new(w: &[V; 4], weight: [f64; 4]) -> Self {
        let p = (0..4).fold([0.0; 3], |sum, i| if weight[i] > 0.0 { add_scaled(sum, w[i], weight[i]) } else { sum });
        Self { weight, square: dot(p, p) }
    }

    fn or(self, other: Self) -> Self {
        if other.square < self.square { other } else { self }
    }
}

fn segment(w: &[V; 4], [i, j]: [usize; 2]) -> Best {
    let d = sub(w[j], w[i]);
    let t = -dot(w[i], d);
    let dd = dot(d, d);
    let mut weight = [0.0; 4];
    let t = if t <= 0.0 || dd == 0.0 { 0.0 } else { (t / dd).min(1.0) };
    weight[j] = t;
    weight[i] = 1.0 - t;
    Best::new(w, weight)
}

fn triangle(w: &[V; 4], [i, j, k]: [usize; 3]) -> Best {
    let n = cross(sub(w[j], w[i]), sub(w[k], w[i]));
    let nn = dot(n, n);
    let area = [dot(n, cross(w[j], w[k])), dot(n, cross(w[k], w[i])), dot(n, cross(w[i], w[j]))];
    let edges = || segment(w, [i, j]).or(segment(w, [j, k])).or(segment(w, [k, i]));
    if nn == 0.0 || area.iter().any(|&x| x <= 0.0) {
        return edges();
    }
    let sum = area[0] + area[1] + area[2];
    let mut weight = [0.0; 4];
    (weight[i], weight[j], weight[k]) = (area[0] / sum, area[1] / sum, area[2] / sum);
    let inside = Best::new(w, weight);
    // Thin triangles: rounding may leave an edge nearer.
    if nn < 1e-12 * dot(sub(w[j], w[i]), sub(w[j], w[i])).powi(2) { inside.or(edges()) } else { inside }
}

/// `None` where the origin is inside.
fn tetrahedron(w: &[V; 4]) -> Option<Best> {
    let (ab, ac, ad) = (sub(w[1], w[0]), sub(w[2], w[0]), sub(w[3], w[0]));
    let volume = dot(ab, cross(ac, ad));
    let part = [dot(w[1], cross(w[2], w[3])), -dot(w[0], cross(w[2], w[3])), dot(w[0], cross(w[1], w[3])), -dot(w[0], cross(w[1], w[2]))];
    let longest = dot(ab, ab).max(dot(ac, ac)).max(dot(ad, ad)).sqrt();
    let flat = volume.abs() <= 1e-14 * longest * longest * longest;
    if !flat && part.iter().all(|&x| x * volume > 0.0) {
        return None;
    }
    let faces = [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]];
    // A face hides the origin from the vertex opposite to it.
    let hides = |i: usize| flat || part[i] * volume <= 0.0;
    (0..4).filter(|&i| hides(i)).map(|i| triangle(w, faces[i])).reduce(Best::or)
}
