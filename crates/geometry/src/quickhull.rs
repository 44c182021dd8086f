//! Triangles of a convex hull.
//!
//! The method is Quickhull (Barber, Dobkin & Huhdanpaa, 1996). It starts with a tetrahedron and adds one point at a time. Triangles are
//! removed if the new point is on the outer side of their plane. New triangles connect the point with the edges of the hole.
//!
//! The test for the outer side is exact (Shewchuk, 1997). The removed part is therefore always connected, even if the points are nearly
//! flat or far from the origin. Rounded distances only determine which point comes next, and which points are close enough to the hull to
//! be ignored.

use robust::{Coord3D, orient3d};

use crate::linear_algebra::*;
use crate::vectors::{V, unit_or};

/// Distance from a plane below which a point counts as on it, relative to the largest coordinate: a few times the rounding error.
const ROUNDING: f64 = 4.0 * f64::EPSILON;
/// Thickness below which the points count as being on one plane, relative to the largest coordinate.
const FLAT: f64 = 64.0 * f64::EPSILON;

/// Triangle of the growing hull.
struct Triangle {
    /// Indices of the triangle's corners, counter-clockwise seen from outside.
    corners: [u32; 3],
    /// Index of the neighbouring triangle across the edge that starts at each corner.
    neighbours: [usize; 3],
    /// Points outside this triangle that are not in the hull yet, as index and distance from the triangle's plane, m. A point outside
    /// several triangles is listed in the first one.
    outside: Vec<(u32, f64)>,
    /// Whether the triangle is part of the hull and was not removed.
    alive: bool,
    /// Plane of the triangle.
    plane: Plane,
}

/// Plane of a triangle, with a bound of the rounding error of distances from it.
struct Plane {
    /// Outward unit normal of the triangle.
    normal: V,
    /// Twice the triangle's area, m^2.
    area: f64,
    /// Upper bound of the rounding error of a point's distance from the triangle's plane, m.
    doubt: f64,
}

/// Hull during its construction.
struct Growing<'a> {
    /// Points whose hull is computed, m.
    points: &'a [V],
    /// All triangles that were added to the hull, including removed ones.
    triangles: Vec<Triangle>,
    /// Distance from a triangle's plane up to which a point counts as inside, m.
    near: f64,
    /// For each point on the border of the last hole: the two new triangles at the border's edges that start and end at the point. Entries
    /// of other points have no meaning.
    rim: Vec<[usize; 2]>,
}

/// Triangles of the convex hull of finite points, counter-clockwise seen from outside. For each triangle, the second list has the
/// neighbouring triangles across the edges that start at its corners. `None` if all points are on one plane up to rounding.
pub(super) fn triangles(points: &[V]) -> Option<[Vec<[u32; 3]>; 2]> {
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
    let mut alive = 0;
    let number = hull.triangles.iter().map(|t| (alive, alive += u32::from(t.alive)).0).collect::<Vec<u32>>();
    let kept = || hull.triangles.iter().filter(|t| t.alive);
    Some([kept().map(|t| t.corners).collect(), kept().map(|t| t.neighbours.map(|n| number[n])).collect()])
}

/// Four points that span a large volume. The last point is on the inner side of the triangle of the first three. `None` if all points are
/// within the thickness `flat`, m.
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

/// Six times the volume of the tetrahedron between a triangle and the point `p`, m^3. It is positive if the point is on the outer side of
/// the triangle. The sign is exact.
///
/// `corners` and `p` are indices of `points`.
pub(super) fn outside(points: &[V], corners: [u32; 3], p: u32) -> f64 {
    let [a, b, c, p] = [corners[0], corners[1], corners[2], p].map(|v| points[v as usize]).map(|[x, y, z]| Coord3D { x, y, z });
    -orient3d(a, b, c, p)
}

impl Growing<'_> {
    /// Starts the hull with the tetrahedron of these points, and lists all other points with the triangle that they are outside of.
    fn begin(&mut self, [a, b, c, d]: [u32; 4]) {
        // Corners of each triangle, and its neighbours across the edges 0, 1 and 2.
        let faces = [([a, b, c], [1, 2, 3]), ([b, a, d], [0, 3, 2]), ([c, b, d], [0, 1, 3]), ([a, c, d], [0, 2, 1])];
        faces.into_iter().for_each(|(corners, neighbours)| self.push(corners, neighbours));
        for p in 0..self.points.len() as u32 {
            self.assign(p, 0);
        }
    }

    /// Adds a triangle with these corners and neighbours to the hull.
    fn push(&mut self, corners: [u32; 3], neighbours: [usize; 3]) {
        let [a, b, c] = corners.map(|i| self.points[i as usize]);
        let (u, v) = (sub(b, a), sub(c, a));
        let across = cross(u, v);
        let area = norm(across);
        let doubt = self.near * (4.0 + 8.0 * dot(u, u).max(dot(v, v)) / area);
        let plane = Plane { normal: unit_or(across, [0.0; 3]), area, doubt };
        self.triangles.push(Triangle { corners, neighbours, outside: Vec::new(), alive: true, plane });
    }

    /// Whether a point is on the outer side of a triangle.
    fn sees(&self, p: u32, triangle: usize) -> bool {
        outside(self.points, self.triangles[triangle].corners, p) > 0.0
    }

    /// Distance of a point outside a triangle's plane, m; `None` if the point counts as inside.
    fn height(&self, p: u32, triangle: usize) -> Option<f64> {
        let Triangle { corners, plane, .. } = &self.triangles[triangle];
        let nearly = dot(plane.normal, sub(self.points[p as usize], self.points[corners[0] as usize]));
        if nearly < self.near - plane.doubt {
            return None;
        }
        let height = outside(self.points, *corners, p) / plane.area;
        (height > self.near).then_some(height)
    }

    /// Lists a point with the first triangle, from index `first` on, that it is outside of. Points inside the hull are not listed.
    fn assign(&mut self, p: u32, first: usize) {
        for t in first..self.triangles.len() {
            if let Some(height) = self.height(p, t) {
                return self.triangles[t].outside.push((p, height));
            }
        }
    }

    /// Farthest point among those that are listed with a triangle. `None` if the list is empty or the triangle was removed.
    ///
    /// Of equally far points, the result is the one with the largest coordinates in lexicographic order, which is certainly a corner of the
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

    /// Adds the point `apex` to the hull.
    ///
    /// Removes all triangles that have the point on their outer side. The triangle `from` must be one of them. New triangles connect the
    /// point with the edges of the hole that remains.
    fn add(&mut self, from: usize, apex: u32) {
        let (mut seen, mut next) = (vec![from], 0);
        self.triangles[from].alive = false;
        // Edges of the hole: both corners in the order of the removed triangle, and the remaining triangle on the other side of the edge.
        let mut rim = vec![];
        while next < seen.len() {
            let t = seen[next];
            next += 1;
            for k in 0..3 {
                let across = self.triangles[t].neighbours[k];
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
            self.triangles[across].neighbours[back] = index;
        }
        for t in seen {
            for (p, _) in std::mem::take(&mut self.triangles[t].outside) {
                if p != apex {
                    self.assign(p, first);
                }
            }
        }
    }
}
