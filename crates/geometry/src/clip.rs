//! Intersection of two flat features (polygons, discs, segments, points) that are projected along the contact normal.
//!
//! One feature is called the reference. Each corner of the intersection has the height of both features above the projection plane.

use crate::projected_feature::{Corner, EDGES, Kind, ProjectedFeature};

/// Corner of the intersection of two projected features. It becomes a contact point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shared {
    /// Position along the first axis of the projection plane, m.
    pub(super) x: f64,
    /// Position along the second axis of the projection plane, m.
    pub(super) y: f64,
    /// Heights of the reference feature and of the other feature at (x, y), m.
    pub(super) h: [f64; 2],
    /// Identifier of the corner, the same from step to step, see [`crossing`].
    pub(super) id: u32,
}

/// Identifier of the crossing of two edges of projected features, from the numbers of the edges. Edges of the reference feature are
/// numbered from [`EDGES`] on.
fn crossing(a: u32, b: u32) -> u32 {
    1 << 31 | a.min(b) << 15 | a.max(b)
}

/// The two edges (0 to 2) of a triangle that meet at the corner `id` of its intersection with the feature `other`. The triangle is the
/// reference of [`overlay`].
///
/// If an edge of the triangle crosses `other` at the corner, both results are this edge. `None` if the corner is a corner of `other`.
pub(super) fn edges_of_triangle(other: &ProjectedFeature, id: u32) -> Option<[usize; 2]> {
    let disc = other.kind == Kind::Disc;
    if id >> 31 == 0 {
        // In the intersection of a polygon and a disc, corners of the polygon keep their identifiers.
        return (disc && id & REFERENCE == 0).then(|| [id as usize, (id as usize + 2) % 3]);
    }
    let [a, b] = [id >> 15 & 0xffff, id & 0x7fff];
    let own = |name: u32| (name >= EDGES).then(|| (name - EDGES) as usize);
    // A crossing with a disc's rim has the triangle's edge first. A crossing with a polygon or segment has the triangle's edge among the
    // edges of the reference, whose numbers start at [`EDGES`].
    if disc { Some([a as usize; 2]) } else { own(b).map(|edge| [own(a).unwrap_or(edge), edge]) }
}

/// Adds corners of the feature `other` that are behind the plane of the feature `reference`, which is a triangle.
///
/// A corner may be outside an edge of the triangle, by at most the corner's depth behind the plane times the entry of that edge in
/// `rises`.
pub(super) fn behind(reference: &ProjectedFeature, other: &ProjectedFeature, rises: &[f64; 3], out: &mut Vec<Shared>) {
    for c in &other.corners {
        let depth = reference.height(c.x, c.y) - c.h;
        if depth > 0.0 && half_planes(reference).zip(rises).all(|((outside, _), rise)| outside(c.x, c.y) <= rise * depth) {
            let id = if other.kind == Kind::Disc { c.id | REFERENCE } else { c.id };
            out.push(Shared { id, ..on_both(reference, c) });
        }
    }
}

/// Bit in the identifier of a corner of an intersection. It is set for a disc's rim points in the intersection with a polygon, and for rim
/// points of the reference disc inside another disc.
const REFERENCE: u32 = 1 << 30;

/// Buffers of [`overlay`] for the polygon before and after it is clipped by one edge.
#[derive(Clone, Debug, Default)]
pub(super) struct Work {
    /// Polygon before it is clipped by an edge.
    polygon: Vec<Corner>,
    /// Polygon after it is clipped by an edge.
    next: Vec<Corner>,
}

impl Work {
    /// Reserves memory for polygons with this number of corners.
    pub(super) fn reserve(&mut self, corners: usize) {
        self.polygon.reserve(corners);
        self.next.reserve(corners);
    }
}

/// Computes the corners of the intersection of two projected features, of which `reference` is a polygon or disc. Points outside by up to
/// `tolerance`, m, count as inside.
pub(super) fn overlay(reference: &ProjectedFeature, other: &ProjectedFeature, tolerance: f64, work: &mut Work, out: &mut Vec<Shared>) {
    out.clear();
    match (reference.kind, other.kind) {
        (Kind::Polygon, Kind::Polygon | Kind::Segment) => clip(reference, other, tolerance, work, out),
        (Kind::Disc, Kind::Disc) => discs(reference, other, tolerance, out),
        (Kind::Polygon, Kind::Disc) => polygon_disc(reference, other, tolerance, false, out),
        (Kind::Disc, Kind::Polygon) => polygon_disc(other, reference, tolerance, true, out),
        (Kind::Disc, Kind::Segment) => chord(reference, other, tolerance, out),
        (_, _) => {
            let inside = |c: &&Corner| {
                if reference.kind == Kind::Disc { in_disc(reference, c, tolerance) } else { in_polygon(reference, c, tolerance) }
            };
            out.extend(other.corners.iter().filter(inside).map(|c| on_both(reference, c)));
        }
    }
}

/// Corner `c` of one feature, with the height of the feature `reference` at the same place.
fn on_both(reference: &ProjectedFeature, c: &Corner) -> Shared {
    Shared { x: c.x, y: c.y, h: [reference.height(c.x, c.y), c.h], id: c.id }
}

/// Twice the area of a polygon, m^2; positive if its corners are counter-clockwise.
fn area(corners: &[Corner]) -> f64 {
    let n = corners.len();
    let o = corners[0];
    (1..n - 1).map(|k| (corners[k].x - o.x) * (corners[k + 1].y - o.y) - (corners[k].y - o.y) * (corners[k + 1].x - o.x)).sum()
}

/// Edges of a polygon. Each is a function that returns the signed distance of (x, y) outside the edge, m, and the number of the edge.
fn half_planes(polygon: &ProjectedFeature) -> impl Iterator<Item = (impl Fn(f64, f64) -> f64, u32)> + '_ {
    let c = &polygon.corners;
    let turn = if area(c) < 0.0 { -1.0 } else { 1.0 };
    (0..c.len()).map(move |k| {
        let (p, q) = (c[k], c[(k + 1) % c.len()]);
        let (dx, dy) = (q.x - p.x, q.y - p.y);
        let length = (dx * dx + dy * dy).sqrt();
        let k = if length > 0.0 { turn / length } else { 0.0 };
        let (nx, ny) = (dy * k, -dx * k);
        (move |x: f64, y: f64| (x - p.x) * nx + (y - p.y) * ny, p.edge)
    })
}

/// Whether a corner is inside a polygon or outside by at most `tolerance`, m, in the projection plane.
fn in_polygon(polygon: &ProjectedFeature, c: &Corner, tolerance: f64) -> bool {
    half_planes(polygon).all(|(outside, _)| outside(c.x, c.y) <= tolerance)
}

/// Whether a corner is inside a disc or outside by at most `tolerance`, m, in the projection plane.
fn in_disc(disc: &ProjectedFeature, c: &Corner, tolerance: f64) -> bool {
    let (x, y) = (c.x - disc.centre[0], c.y - disc.centre[1]);
    let reach = disc.radius + tolerance;
    x * x + y * y <= reach * reach
}

/// Corners of the part of a projected polygon or segment that is inside the polygon `reference` (Sutherland & Hodgman, 1974).
fn clip(reference: &ProjectedFeature, other: &ProjectedFeature, tolerance: f64, work: &mut Work, out: &mut Vec<Shared>) {
    let closed = other.kind == Kind::Polygon;
    work.polygon.clear();
    work.polygon.extend(&other.corners);
    for (outside, name) in half_planes(reference) {
        let name = EDGES + name;
        work.next.clear();
        let n = work.polygon.len();
        for k in 0..n {
            let p = work.polygon[k];
            let op = outside(p.x, p.y);
            if op <= tolerance {
                work.next.push(p);
            }
            if !closed && k + 1 == n {
                break;
            }
            let q = work.polygon[(k + 1) % n];
            let oq = outside(q.x, q.y);
            if (op <= tolerance) != (oq <= tolerance) {
                // An end within the tolerance is on the line.
                let t = (op / (op - oq)).clamp(0.0, 1.0);
                // Where the polygon leaves the half plane, the next edge is an edge of the reference. Where it enters, the next edge is an
                // edge of the polygon.
                let edge = if op <= tolerance { name } else { p.edge };
                work.next.push(between(&p, &q, t, crossing(p.edge, name), edge));
            }
        }
        std::mem::swap(&mut work.polygon, &mut work.next);
        if work.polygon.is_empty() {
            return;
        }
    }
    out.extend(work.polygon.iter().map(|c| on_both(reference, c)));
}

/// Corners of the intersection of a projected polygon and disc: corners of the polygon inside the disc, rim points inside the polygon, and
/// crossings.
///
/// If `swapped`, the disc is the reference feature, else the polygon.
fn polygon_disc(polygon: &ProjectedFeature, disc: &ProjectedFeature, tolerance: f64, swapped: bool, out: &mut Vec<Shared>) {
    let order = |on_polygon: f64, on_disc: f64| if swapped { [on_disc, on_polygon] } else { [on_polygon, on_disc] };
    for c in disc.corners.iter().filter(|c| in_polygon(polygon, c, tolerance)) {
        out.push(Shared { x: c.x, y: c.y, h: order(polygon.height(c.x, c.y), c.h), id: c.id | REFERENCE });
    }
    let n = polygon.corners.len();
    let inside = polygon.corners.iter().copied().filter(|c| in_disc(disc, c, -tolerance));
    let on_rim = (0..n).flat_map(|k| rim_crossings(polygon.corners[k], polygon.corners[(k + 1) % n], disc));
    for c in inside.chain(on_rim) {
        out.push(Shared { x: c.x, y: c.y, h: order(c.h, disc.height(c.x, c.y)), id: c.id });
    }
}

/// Corner at the fraction `t` of the edge from `p` to `q`, with this identifier and this edge to the next corner.
fn between(p: &Corner, q: &Corner, t: f64, id: u32, edge: u32) -> Corner {
    let at = |a: f64, b: f64| a + (b - a) * t;
    Corner { x: at(p.x, q.x), y: at(p.y, q.y), h: at(p.h, q.h), id, edge }
}

/// Corners where the edge from `p` to `q` enters and leaves a disc.
fn rim_crossings(p: Corner, q: Corner, disc: &ProjectedFeature) -> impl Iterator<Item = Corner> {
    let (dx, dy) = (q.x - p.x, q.y - p.y);
    let (x, y) = (p.x - disc.centre[0], p.y - disc.centre[1]);
    let (a, b, c) = (dx * dx + dy * dy, x * dx + y * dy, x * x + y * y - disc.radius * disc.radius);
    // The root is NaN without a crossing.
    let root = (b * b - a * c).sqrt();
    let within = [(-b - root) / a, (-b + root) / a].into_iter().zip(EDGES..).filter(|(t, _)| *t > 0.0 && *t < 1.0);
    within.map(move |(t, name)| between(&p, &q, t, crossing(p.edge, name), 0))
}

/// Ends of the part of a projected segment that is inside a disc, which is the reference feature.
fn chord(disc: &ProjectedFeature, segment: &ProjectedFeature, tolerance: f64, out: &mut Vec<Shared>) {
    out.extend(segment.corners.iter().filter(|c| in_disc(disc, c, tolerance)).map(|c| on_both(disc, c)));
    out.extend(rim_crossings(segment.corners[0], segment.corners[1], disc).map(|c| on_both(disc, &c)));
}

/// Corners of the intersection of two discs.
///
/// If one disc is inside the other, the corners are the rim points of the inner disc. Otherwise the corners are the two crossings of the
/// rims and, on each rim, the point that is deepest inside the other disc.
fn discs(reference: &ProjectedFeature, other: &ProjectedFeature, tolerance: f64, out: &mut Vec<Shared>) {
    let mut add = |x: f64, y: f64, id: u32| out.push(Shared { x, y, h: [reference.height(x, y), other.height(x, y)], id });
    let d = [other.centre[0] - reference.centre[0], other.centre[1] - reference.centre[1]];
    let apart = (d[0] * d[0] + d[1] * d[1]).sqrt();
    let (r, s) = (reference.radius, other.radius);
    if apart <= (r - s).abs() + tolerance {
        // One disc is inside the other: the rim points of the smaller one.
        let (inner, flag) = if s <= r { (other, 0) } else { (reference, REFERENCE) };
        inner.corners.iter().for_each(|c| add(c.x, c.y, c.id | flag));
    } else if apart < r + s {
        let (ux, uy) = (d[0] / apart, d[1] / apart);
        let along = (apart * apart + r * r - s * s) / (2.0 * apart);
        let across = (r * r - along * along).max(0.0).sqrt();
        let [cx, cy] = reference.centre;
        add(cx + along * ux - across * uy, cy + along * uy + across * ux, crossing(EDGES, 0));
        add(cx + along * ux + across * uy, cy + along * uy - across * ux, crossing(EDGES, 1));
        add(cx + r * ux, cy + r * uy, crossing(EDGES, 2));
        add(cx + (apart - s) * ux, cy + (apart - s) * uy, crossing(EDGES, 3));
    }
}
