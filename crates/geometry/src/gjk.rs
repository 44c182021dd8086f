//! Distance of two convex sets: the distance of the origin from their Minkowski difference A - B.
//!
//! The method is from Gilbert, Johnson & Keerthi (1988). The nearest point of a simplex follows from barycentric coordinates. Every face
//! with the origin on its outer side is tried. All faces of a degenerate simplex are tried, because rounding would decide on which side of
//! them the origin is.

use crate::facing::Separation;
use crate::linear_algebra::*;
use crate::pair::{Pair, Vertex};
use crate::vectors::{V, neg};

/// Simplex of up to four vertices of the Minkowski difference A - B, which contains the point of A - B that is nearest to the origin.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Simplex {
    /// Vertices of the simplex. Only the first `count` are used.
    vertex: [Vertex; 4],
    /// Barycentric coordinates of the point of the simplex that is nearest to the origin.
    weight: [f64; 4],
    /// Number of the simplex's vertices in use.
    count: usize,
}

/// Result of a GJK search: the point of the Minkowski difference A - B that is nearest to the origin, and its simplex.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nearest {
    /// Nearest point, m: the vector from the closest point of B to the closest point of A. It is 0 if the sets overlap.
    v: V,
    /// Smallest simplex that contains the point of A - B nearest to the origin. If the origin is inside A - B, it is a tetrahedron around
    /// it.
    pub(super) simplex: Simplex,
}

/// Largest number of GJK iterations.
const ITERATIONS: usize = 200;
/// Sine of an angle of a triangle below which the normal is computed from the shortest edge, because the rounding error is smaller.
const NARROW: f64 = 0.01;

/// Closest points of two shapes A and B without their rounding radii, where B is moved by `shift`, m. The search starts in the direction
/// `start`, from B to A.
///
/// The search may stop early once the distance certainly exceeds `beyond`, m.
pub(super) fn nearest(pair: &Pair<'_>, shift: V, start: V, beyond: f64) -> Nearest {
    let mut simplex = Simplex { count: 1, ..Simplex::default() };
    simplex.vertex[0] = pair.support([-start[0], -start[1], -start[2]], shift);
    simplex.weight[0] = 1.0;
    let v = simplex.vertex[0].w;
    // A plane perpendicular to v separates the sets by v . w / |v|.
    search(pair, shift, simplex, v, |_, length, along| along > beyond * length)
}

/// Closest points of two shapes A and B without their rounding radii, where B is moved by `shift`, m. The search starts from the triangle
/// `corners` of the Minkowski difference A - B.
///
/// `enough` is called with the unit normal of a separating plane, from A to B, and the separation along it, m. The search stops if it
/// returns true.
pub(super) fn nearest_from(pair: &Pair<'_>, shift: V, corners: [Vertex; 3], enough: impl Fn(V, f64) -> bool) -> Nearest {
    let [a, b, c] = corners;
    let mut simplex = Simplex { vertex: [a, b, c, c], weight: [0.0; 4], count: 3 };
    let v = simplex.reduce().unwrap_or([0.0; 3]);
    search(pair, shift, simplex, v, |v, length, along| along > 0.0 && enough(scale(v, -1.0 / length), along / length))
}

/// Runs GJK from a simplex whose nearest point to the origin is `v`, until only rounding is left or until `enough` returns true.
///
/// `enough` is called with v, the length of v, and the dot product of v and w. Here w is the vertex of the Minkowski difference A - B that
/// is farthest along -v. A plane perpendicular to v separates the sets by the dot product divided by the length.
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
        // |v|^2 - v . w bounds the possible decrease. A corner of the simplex cannot decrease the distance.
        if length * length - along <= length * (rounding + 1e-15 * length) || (named && simplex.has(&vertex)) {
            break;
        }
        simplex.vertex[simplex.count] = vertex;
        simplex.count += 1;
        let Some(next) = simplex.reduce() else { return Nearest { v: [0.0; 3], simplex } };
        v = next;
        // Without descent, only rounding is left.
        if dot(v, v) >= length * length {
            break;
        }
    }
    Nearest { v, simplex }
}

impl Nearest {
    /// Simplex of a single vertex: the vertex of the Minkowski difference A - B that is farthest along `normal`.
    pub(super) fn corner(pair: &Pair<'_>, normal: V) -> Self {
        let vertex = pair.support(normal, [0.0; 3]);
        let mut simplex = Simplex { count: 1, ..Simplex::default() };
        (simplex.vertex[0], simplex.weight[0]) = (vertex, 1.0);
        Self { v: vertex.w, simplex }
    }

    /// Result for the actual position of the second shape B, from the result of a search in which B was moved by `shift`, m.
    pub(super) fn moved_back(mut self, shift: V) -> Self {
        self.v = add(self.v, shift);
        for vertex in &mut self.simplex.vertex[..self.simplex.count] {
            vertex.y = sub(vertex.y, shift);
            vertex.w = sub(vertex.x, vertex.y);
        }
        self
    }

    /// Distance of the point of A - B nearest to the origin from the outline of the triangle that contains it, m.
    ///
    /// The result is 0 if the simplex is not a triangle, or if an edge of the triangle has a component of more than `flat`, m, along the
    /// unit vector `normal`.
    pub(super) fn distance_from_outline(&self, normal: V, flat: f64) -> f64 {
        let [a, b, c] = [0, 1, 2].map(|k| self.simplex.vertex[k].w);
        let edges = [sub(c, b), sub(a, c), sub(b, a)];
        if self.simplex.count != 3 || edges.iter().any(|e| dot(*e, normal).abs() > flat) {
            return 0.0;
        }
        let twice = norm(cross(edges[0], edges[1]));
        (0..3).map(|k| self.simplex.weight[k] * twice / norm(edges[k])).fold(f64::INFINITY, f64::min)
    }

    /// Distance of the two sets, m.
    pub(super) fn length(&self) -> f64 {
        norm(self.v)
    }

    /// Unit vector from the shape A to the shape B; `None` if their distance is at most `clear`, m.
    pub(super) fn normal(&self, clear: f64) -> Option<V> {
        let length = self.length();
        (length > clear).then(|| scale(self.v, -1.0 / length))
    }

    /// Distance and closest points of the sets as a [`Separation`] with this normal.
    pub(super) fn separation(&self, normal: V) -> Separation {
        Separation { normal, separation: self.length(), points: self.points() }
    }

    /// Closest points of the two shapes A and B of the search, m.
    pub(super) fn points(&self) -> [V; 2] {
        let mix = |get: fn(&Vertex) -> V| {
            self.simplex.vertices().iter().zip(self.simplex.weight).fold([0.0; 3], |sum, (p, k)| add_scaled(sum, get(p), k))
        };
        [mix(|p| p.x), mix(|p| p.y)]
    }
}

impl Simplex {
    /// Vertices of the simplex that are in use.
    pub(super) fn vertices(&self) -> &[Vertex] {
        &self.vertex[..self.count]
    }

    /// Whether the simplex already contains a vertex that is made from the same vertices of both shapes as `vertex`.
    #[inline(always)]
    fn has(&self, vertex: &Vertex) -> bool {
        self.vertices().iter().any(|known| known.names == vertex.names)
    }

    /// Reduces the simplex to the smallest face that contains the point nearest to the origin, and returns the point, m. `None` if the
    /// origin is inside the simplex.
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

/// Point of a simplex that is nearest to the origin.
#[derive(Clone, Copy)]
struct Best {
    /// Barycentric coordinates of the point for all four vertices of the simplex.
    weight: [f64; 4],
    /// Position of the point, m.
    point: V,
    /// Squared distance of the point from the origin, m^2.
    square: f64,
}

impl Best {
    /// Start of a search for the nearest point: its distance from the origin is infinite.
    const NONE: Self = Self { weight: [0.0; 4], point: [0.0; 3], square: f64::INFINITY };

    /// The point that is nearer to the origin, of `self` and `other`; `self` if both are equally near.
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        if other.square < self.square { other } else { self }
    }
}

/// Point of the segment from `w[i]` to `w[j]` that is nearest to the origin.
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

/// Point of the triangle with the vertices `w[i]`, `w[j]` and `w[k]` that is nearest to the origin.
#[inline(always)]
fn triangle(w: &[V; 4], [i, j, k]: [usize; 3]) -> Best {
    let (u, v) = (sub(w[j], w[i]), sub(w[k], w[i]));
    let mut n = cross(u, v);
    let mut nn = dot(n, n);
    if nn < NARROW * NARROW * dot(u, u) * dot(v, v) {
        // The cross product of two long edges of a narrow triangle has a large rounding error. The cross product of the shortest edge and a
        // long edge has a small error.
        let across = sub(w[k], w[j]);
        n = if dot(u, u) < dot(v, v) { cross(u, across) } else { cross(across, neg(v)) };
        nn = dot(n, n);
    }
    let area = [dot(n, cross(w[j], w[k])), dot(n, cross(w[k], w[i])), dot(n, cross(w[i], w[j]))];
    // For a thin triangle, rounding may make an edge nearer.
    let thin = nn <= 1e-12 * dot(u, u) * dot(u, u);
    let mut best = Best::NONE;
    if nn > 0.0 && area.iter().all(|&x| x > 0.0) {
        let sum = area[0] + area[1] + area[2];
        let mut weight = [0.0; 4];
        (weight[i], weight[j], weight[k]) = (area[0] / sum, area[1] / sum, area[2] / sum);
        // The point is along the normal, whose direction is accurate at any distance from the origin.
        let point = scale(n, dot(n, w[i]) / nn);
        best = Best { weight, point, square: dot(point, point) };
        if !thin {
            return best;
        }
    }
    // The nearest edge has the origin on its outer side.
    for (beyond, edge) in area.into_iter().zip([[j, k], [k, i], [i, j]]) {
        if beyond <= 0.0 || thin {
            best = best.or(segment(w, edge));
        }
    }
    best
}

/// Point of the tetrahedron with the vertices `w` that is nearest to the origin; `None` if the origin is inside.
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
    // The nearest face has the origin on its outer side.
    let mut best = Best::NONE;
    for i in 0..4 {
        if flat || part[i] * volume <= 0.0 {
            best = best.or(triangle(w, faces[i]));
        }
    }
    Some(best)
}
