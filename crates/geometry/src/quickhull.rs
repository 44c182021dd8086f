//! The triangles of a convex hull.
//!
//! Quickhull (Barber, Dobkin & Huhdanpaa 1996) with exact signs of volumes (Shewchuk 1997): whether a point is outside a plane through
//! three others is never a matter of rounding, so what a point sees of the hull so far is always one piece, however thin, turned or far
//! from the origin the points are. Distances only choose which point comes next, and which are near enough to be left out.

use robust::{Coord3D, orient3d};

use crate::linear_algebra::*;
use crate::vectors::{V, unit_or};

/// Points are on a plane within this share of their largest coordinate: a few times what rounding makes of it.
const ROUNDING: f64 = 4.0 * f64::EPSILON;
/// Below this share the hull of all points would be one of rounding.
const FLAT: f64 = 64.0 * f64::EPSILON;

/// A triangle of the hull so far.
struct Triangle {
    corners: [u32; 3],
    /// Index of the neighbouring triangle across the edge that starts at each corner.
    beside: [usize; 3],
    /// Index and distance of the points outside this triangle. A point outside several triangles is listed with the first one.
    outside: Vec<(u32, f64)>,
    alive: bool,
    plane: Plane,
}

/// The plane of a triangle, and how well rounding lets it be known.
struct Plane {
    normal: V,
    /// Twice the triangle's area.
    area: f64,
    doubt: f64,
}

/// Triangles, counter-clockwise seen from outside, and the distance within which points count as inside.
struct Growing<'a> {
    points: &'a [V],
    triangles: Vec<Triangle>,
    near: f64,
    /// The triangles that leave each point and arrive there along the rim of what was seen last; anything where the rim is not.
    rim: Vec<[usize; 2]>,
}

/// The triangles of the hull of finite points, counter-clockwise seen from outside; `None` where all are on one plane up to rounding.
pub(super) fn triangles(points: &[V]) -> Option<Vec<[u32; 3]>> {
    let largest = points.iter().flatten().fold(0.0, |most: f64, x| most.max(x.abs()));
    let simplex = simplex(points, FLAT * largest)?;
    let mut hull = Growing { points, triangles: Vec::new(), near: ROUNDING * largest, rim: vec![[0; 2]; points.len()] };
    hull.begin(simplex);
    let mut next = 0;
    while next < hull.triangles.len() {
        if let Some(apex) = hull.furthest(next) {
            hull.add(next, apex);
        }
        next += 1;
    }
    Some(hull.triangles.iter().filter(|t| t.alive).map(|t| t.corners).collect())
}

/// Four points that span much of the volume, the last one inside of the first three.
fn simplex(points: &[V], flat: f64) -> Option<[u32; 4]> {
    let most = |value: &dyn Fn(V) -> f64| {
        let best = |best: (f64, usize), (i, p): (usize, &V)| {
            let x = value(*p);
            if x > best.0 { (x, i) } else { best }
        };
        points.iter().enumerate().fold((0.0, 0), best)
    };
    let from = |p: V| move |q: V| norm(sub(q, p));
    let (_, a) = most(&from(*points.first()?));
    let (_, b) = most(&from(points[a]));
    let edge = sub(points[b], points[a]);
    let (_, c) = most(&|p| norm(cross(edge, sub(p, points[a]))));
    let (a, b, c) = (a as u32, b as u32, c as u32);
    let area = norm(cross(edge, sub(points[c as usize], points[a as usize])));
    let side = |p: u32| outside(points, [a, b, c], p);
    let d = (0..points.len() as u32).reduce(|best, p| if side(p).abs() > side(best).abs() { p } else { best })?;
    let side = side(d);
    (side.abs() > flat * area).then_some(if side > 0.0 { [a, c, b, d] } else { [a, b, c, d] })
}

/// Six times the volume between a triangle and a point, positive outside; its sign is exact.
pub(super) fn outside(points: &[V], corners: [u32; 3], p: u32) -> f64 {
    volume_over(corners.map(|v| points[v as usize]), points[p as usize])
}

/// The same of places.
pub(super) fn volume_over(corners: [V; 3], p: V) -> f64 {
    let [a, b, c, p] = [corners[0], corners[1], corners[2], p].map(|[x, y, z]| Coord3D { x, y, z });
    -orient3d(a, b, c, p)
}

impl Growing<'_> {
    fn begin(&mut self, [a, b, c, d]: [u32; 4]) {
        // Each beside the others: across its edges 0, 1, 2.
        let faces = [([a, b, c], [1, 2, 3]), ([b, a, d], [0, 3, 2]), ([c, b, d], [0, 1, 3]), ([a, c, d], [0, 2, 1])];
        faces.into_iter().for_each(|(corners, beside)| self.push(corners, beside));
        for p in 0..self.points.len() as u32 {
            self.give(p, 0);
        }
    }

    fn push(&mut self, corners: [u32; 3], beside: [usize; 3]) {
        let [a, b, c] = corners.map(|i| self.points[i as usize]);
        let (u, v) = (sub(b, a), sub(c, a));
        let across = cross(u, v);
        let area = norm(across);
        let doubt = self.near * (4.0 + 8.0 * dot(u, u).max(dot(v, v)) / area);
        let plane = Plane { normal: unit_or(across, [0.0; 3]), area, doubt };
        self.triangles.push(Triangle { corners, beside, outside: Vec::new(), alive: true, plane });
    }

    fn sees(&self, p: u32, triangle: usize) -> bool {
        outside(self.points, self.triangles[triangle].corners, p) > 0.0
    }

    /// How far a point is outside of a triangle, if it is further than what counts as inside.
    fn height(&self, p: u32, triangle: usize) -> Option<f64> {
        let Triangle { corners, plane, .. } = &self.triangles[triangle];
        let nearly = dot(plane.normal, sub(self.points[p as usize], self.points[corners[0] as usize]));
        if nearly < self.near - plane.doubt {
            return None;
        }
        let height = outside(self.points, *corners, p) / plane.area;
        (height > self.near).then_some(height)
    }

    /// Gives a point to the first of the triangles from `first` on that it is outside of; to none where it is inside.
    fn give(&mut self, p: u32, first: usize) {
        for t in first..self.triangles.len() {
            if let Some(height) = self.height(p, t) {
                return self.triangles[t].outside.push((p, height));
            }
        }
    }

    /// The furthest of a triangle's points. Of those that are level the greatest by coordinates: no other is certainly a corner of the
    /// hull.
    fn furthest(&self, triangle: usize) -> Option<u32> {
        let t = &self.triangles[triangle];
        let greater = |a: (u32, f64), b: (u32, f64)| {
            let [x, y] = [a.0, b.0].map(|p| self.points[p as usize]);
            let coordinates = (0..3).map(|k| x[k].total_cmp(&y[k]));
            a.1.total_cmp(&b.1).then(coordinates.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)).is_gt()
        };
        t.outside.iter().filter(|_| t.alive).copied().reduce(|best, p| if greater(p, best) { p } else { best }).map(|(p, _)| p)
    }

    /// Replaces all that a point sees, `from` among it, by triangles between the edge of that and the point.
    fn add(&mut self, from: usize, apex: u32) {
        let (mut seen, mut next) = (vec![from], 0);
        self.triangles[from].alive = false;
        // The edges between what is seen and what is not: from corner to corner, and what is across, in what is seen.
        let mut rim = vec![];
        while next < seen.len() {
            let t = seen[next];
            next += 1;
            for k in 0..3 {
                let across = self.triangles[t].beside[k];
                if !self.triangles[across].alive {
                    continue;
                }
                if self.sees(apex, across) {
                    self.triangles[across].alive = false;
                    seen.push(across);
                } else {
                    let corners = self.triangles[t].corners;
                    rim.push((corners[k], corners[(k + 1) % 3], across));
                }
            }
        }
        let first = self.triangles.len();
        rim.sort_unstable();
        for (index, &(corner, to, _)) in (first..).zip(&rim) {
            self.rim[corner as usize][0] = index;
            self.rim[to as usize][1] = index;
        }
        for (corner, to, across) in rim {
            let index = self.triangles.len();
            self.push([corner, to, apex], [across, self.rim[to as usize][0], self.rim[corner as usize][1]]);
            let back = (0..3).find(|&k| self.triangles[across].corners[k] == to).expect("the edge is in both");
            self.triangles[across].beside[back] = index;
        }
        for t in seen {
            for (p, _) in std::mem::take(&mut self.triangles[t].outside) {
                if p != apex {
                    self.give(p, first);
                }
            }
        }
    }
}
