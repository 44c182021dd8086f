//! Distance of two convex sets: the point of their difference nearest to the origin.
//!
//! Gilbert, Johnson & Keerthi 1988; the nearest point of a simplex by its barycentric coordinates, with every face of it tried that the
//! origin is beyond, and all of them where it is degenerate, so that degenerate simplices are no special case.

use crate::facing::Separation;
use crate::linear_algebra::*;
use crate::pair::{Pair, Vertex};
use crate::vectors::{V, neg};

/// Corners of the difference around the point of it that is nearest to the origin.
#[derive(Clone, Copy, Debug, Default)]
struct Simplex {
    vertex: [Vertex; 4],
    weight: [f64; 4],
    count: usize,
}

/// What the search ended with.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nearest {
    /// From the second set to the first, x - y; the origin is inside where it is 0.
    v: V,
    simplex: Simplex,
}

const ITERATIONS: usize = 200;
/// A corner of a triangle narrower than this (sine) has two edges much longer than the third, or nearly in line.
const NARROW: f64 = 0.01;

/// The nearest points of A and B + shift, searched from the direction `start` (from B to A); points further apart than `beyond` (m) where
/// the sets certainly are.
pub(super) fn nearest(pair: &Pair<'_>, shift: V, start: V, beyond: f64) -> Nearest {
    let mut simplex = Simplex { count: 1, ..Simplex::default() };
    simplex.vertex[0] = pair.support([-start[0], -start[1], -start[2]], shift);
    simplex.weight[0] = 1.0;
    let v = simplex.vertex[0].w;
    // A plane at right angles to v parts the sets by v . w / |v|.
    search(pair, shift, simplex, v, |_, length, along| along > beyond * length)
}

/// The same, searched from three corners of the difference, and no further than to a plane that is `enough`, told by its normal (unit, from
/// A to B) and by how far it parts the sets, m.
pub(super) fn nearest_from(pair: &Pair<'_>, shift: V, corners: [Vertex; 3], enough: impl Fn(V, f64) -> bool) -> Nearest {
    let [a, b, c] = corners;
    let mut simplex = Simplex { vertex: [a, b, c, c], weight: [0.0; 4], count: 3 };
    let v = simplex.reduce().unwrap_or([0.0; 3]);
    search(pair, shift, simplex, v, |v, length, along| along > 0.0 && enough(scale(v, -1.0 / length), along / length))
}

/// From a simplex and the point `v` of it that is nearest to the origin until rounding, or a plane that parts the sets enough, ends it.
#[inline(always)]
fn search(pair: &Pair<'_>, shift: V, mut simplex: Simplex, mut v: V, enough: impl Fn(V, f64, f64) -> bool) -> Nearest {
    let named = pair.is_polytope();
    let rounding = 4e-16 * (pair.size + norm(v));
    for _ in 0..ITERATIONS {
        let length = norm(v);
        if length <= rounding {
            return Nearest { v: [0.0; 3], simplex };
        }
        let vertex = pair.support([-v[0], -v[1], -v[2]], shift);
        let along = dot(v, vertex.w);
        if enough(v, length, along) {
            break;
        }
        // |v|^2 - v . w bounds what is left to gain. A corner that is there already brings nothing new.
        if length * length - along <= length * (rounding + 1e-15 * length) || (named && simplex.has(&vertex)) {
            break;
        }
        simplex.vertex[simplex.count] = vertex;
        simplex.count += 1;
        let Some(next) = simplex.reduce() else { return Nearest { v: [0.0; 3], simplex } };
        v = next;
        // No descent: the rest is rounding.
        if dot(v, v) >= length * length {
            break;
        }
    }
    Nearest { v, simplex }
}

impl Nearest {
    /// The corner of the difference that is furthest along `normal`.
    pub(super) fn corner(pair: &Pair<'_>, normal: V) -> Self {
        let vertex = pair.support(normal, [0.0; 3]);
        let mut simplex = Simplex { count: 1, ..Simplex::default() };
        (simplex.vertex[0], simplex.weight[0]) = (vertex, 1.0);
        Self { v: vertex.w, simplex }
    }

    /// Nearest places of the sets without the shift of the second set.
    pub(super) fn moved_back(mut self, shift: V) -> Self {
        self.v = add(self.v, shift);
        for vertex in &mut self.simplex.vertex[..self.simplex.count] {
            vertex.y = sub(vertex.y, shift);
            vertex.w = sub(vertex.x, vertex.y);
        }
        self
    }

    /// Distance of the nearest point from the outline of the triangle around it, m; 0 where there is no triangle, or where it leans from
    /// the plane at right angles to `normal` by more than `flat`, m.
    pub(super) fn room_on_facet(&self, normal: V, flat: f64) -> f64 {
        let [a, b, c] = [0, 1, 2].map(|k| self.simplex.vertex[k].w);
        let edges = [sub(c, b), sub(a, c), sub(b, a)];
        if self.simplex.count != 3 || edges.iter().any(|e| dot(*e, normal).abs() > flat) {
            return 0.0;
        }
        let twice = norm(cross(edges[0], edges[1]));
        (0..3).map(|k| self.simplex.weight[k] * twice / norm(edges[k])).fold(f64::INFINITY, f64::min)
    }

    /// Corners of the smallest simplex that holds the nearest point; a tetrahedron holds the origin.
    pub(super) fn vertices(&self) -> &[Vertex] {
        self.simplex.vertices()
    }

    /// The distance, m.
    pub(super) fn length(&self) -> f64 {
        norm(self.v)
    }

    /// The direction from the first set to the second, if they are further apart than `clear`, m.
    pub(super) fn normal(&self, clear: f64) -> Option<V> {
        let length = self.length();
        (length > clear).then(|| scale(self.v, -1.0 / length))
    }

    /// The same with all that goes with it.
    pub(super) fn separation(&self, normal: V) -> Separation {
        Separation { normal, separation: self.length(), points: self.points() }
    }

    /// The nearest points.
    pub(super) fn points(&self) -> [V; 2] {
        let mix = |get: fn(&Vertex) -> V| {
            self.simplex.vertices().iter().zip(self.simplex.weight).fold([0.0; 3], |sum, (p, k)| add_scaled(sum, get(p), k))
        };
        [mix(|p| p.x), mix(|p| p.y)]
    }
}

impl Simplex {
    fn vertices(&self) -> &[Vertex] {
        &self.vertex[..self.count]
    }

    #[inline(always)]
    fn has(&self, vertex: &Vertex) -> bool {
        self.vertices().iter().any(|known| known.names == vertex.names)
    }

    /// Reduces the simplex to the smallest face that contains the point nearest to the origin, and returns the point. The result is
    /// `None` if the origin is inside the simplex.
    #[inline(always)]
    fn reduce(&mut self) -> Option<V> {
        let w: [V; 4] = std::array::from_fn(|i| self.vertex[i].w);
        let best = match self.count {
            2 => segment(&w, [0, 1]),
            3 => triangle(&w, [0, 1, 2]),
            _ => tetrahedron(&w)?,
        };
        let mut kept = 0;
        for i in 0..self.count {
            if best.weight[i] > 0.0 {
                self.vertex[kept] = self.vertex[i];
                self.weight[kept] = best.weight[i];
                kept += 1;
            }
        }
        self.count = kept;
        Some(best.point)
    }
}

/// A point of a simplex: barycentric coordinates, place, and distance from the origin, squared.
#[derive(Clone, Copy)]
struct Best {
    weight: [f64; 4],
    point: V,
    square: f64,
}

impl Best {
    const NONE: Self = Self { weight: [0.0; 4], point: [0.0; 3], square: f64::INFINITY };

    #[inline(always)]
    fn or(self, other: Self) -> Self {
        if other.square < self.square { other } else { self }
    }
}

#[inline(always)]
fn segment(w: &[V; 4], [i, j]: [usize; 2]) -> Best {
    let d = sub(w[j], w[i]);
    let t = -dot(w[i], d);
    let dd = dot(d, d);
    let t = if t <= 0.0 || dd == 0.0 { 0.0 } else { (t / dd).min(1.0) };
    let mut weight = [0.0; 4];
    weight[j] = t;
    weight[i] = 1.0 - t;
    let point = if t == 1.0 { w[j] } else { add_scaled(w[i], d, t) };
    Best { weight, point, square: dot(point, point) }
}

#[inline(always)]
fn triangle(w: &[V; 4], [i, j, k]: [usize; 3]) -> Best {
    let (u, v) = (sub(w[j], w[i]), sub(w[k], w[i]));
    let mut n = cross(u, v);
    let mut nn = dot(n, n);
    if nn < NARROW * NARROW * dot(u, u) * dot(v, v) {
        // Two long edges leave their rounding in the normal of a narrow triangle; its shortest edge and one of them do not.
        let across = sub(w[k], w[j]);
        n = if dot(u, u) < dot(v, v) { cross(u, across) } else { cross(across, neg(v)) };
        nn = dot(n, n);
    }
    let area = [dot(n, cross(w[j], w[k])), dot(n, cross(w[k], w[i])), dot(n, cross(w[i], w[j]))];
    // Thin triangles: rounding may leave an edge nearer.
    let thin = nn <= 1e-12 * dot(u, u) * dot(u, u);
    let mut best = Best::NONE;
    if nn > 0.0 && area.iter().all(|&x| x > 0.0) {
        let sum = area[0] + area[1] + area[2];
        let mut weight = [0.0; 4];
        (weight[i], weight[j], weight[k]) = (area[0] / sum, area[1] / sum, area[2] / sum);
        // Along the normal: its direction is exact however near the origin is.
        let point = scale(n, dot(n, w[i]) / nn);
        best = Best { weight, point, square: dot(point, point) };
        if !thin {
            return best;
        }
    }
    // The nearest edge is one that the origin is beyond.
    for (beyond, edge) in area.into_iter().zip([[j, k], [k, i], [i, j]]) {
        if beyond <= 0.0 || thin {
            best = best.or(segment(w, edge));
        }
    }
    best
}

/// `None` where the origin is inside.
#[inline(always)]
fn tetrahedron(w: &[V; 4]) -> Option<Best> {
    let (ab, ac, ad) = (sub(w[1], w[0]), sub(w[2], w[0]), sub(w[3], w[0]));
    let volume = dot(ab, cross(ac, ad));
    let (ab_cd, ac_bd) = (cross(w[2], w[3]), cross(w[0], w[1]));
    let part = [dot(w[1], ab_cd), -dot(w[0], ab_cd), dot(w[3], ac_bd), -dot(w[2], ac_bd)];
    let longest = dot(ab, ab).max(dot(ac, ac)).max(dot(ad, ad)).sqrt();
    let flat = volume.abs() <= 1e-14 * longest * longest * longest;
    if !flat && part.iter().all(|&x| x * volume > 0.0) {
        return None;
    }
    let faces = [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]];
    // A face hides the origin from the vertex opposite to it.
    let mut best = Best::NONE;
    for i in 0..4 {
        if flat || part[i] * volume <= 0.0 {
            best = best.or(triangle(w, faces[i]));
        }
    }
    Some(best)
}
