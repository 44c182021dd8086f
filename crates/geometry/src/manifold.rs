//! Contact points of two shapes along a given normal.
//!
//! The features that face each other are projected along the normal. Contacts are at the corners of their intersection. At most
//! [`MAX_POINTS`] of the contacts are kept. They span nearly the same area and include the deepest contact. The search distance grows with
//! the speed of the shapes. A larger one adds contacts, and removes none of those that touch ([`SearchLimits::touching`]).

use arrayvec::ArrayVec;

use crate::clip::{Shared, Work, behind, edges_of_triangle, overlay};
use crate::facet::Facet;
use crate::facing::Facing;
use crate::linear_algebra::*;
use crate::pair::Pair;
use crate::projected_feature::{Kind, ProjectedFeature, View, edge};
use crate::search_limits::SearchLimits;
use crate::separating_plane::SeparatingPlane;
use crate::shape::ConvexShape;
use crate::vectors::{IDENTITY, Pose, V};

/// Largest number of contact points of two convex shapes.
pub const MAX_POINTS: usize = 8;

/// Largest number of contact points at corners of two facing polygons, and of touching points of a hull and a plane. Further points are
/// dropped.
const KEPT: usize = 4;

/// Contact point of two shapes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Point {
    /// Position of the contact, halfway between the surfaces, m.
    pub pos: V,
    /// Unit normal from the first shape to the second.
    pub normal: V,
    /// Signed distance of the surfaces along the normal, m; negative if they overlap.
    pub distance: f64,
    /// Identifier of the vertices, edges or faces that touch. It is the same from step to step.
    pub feature: u32,
    /// Whether the point belongs to a ball that meets only one plane of a surface of triangles within two steps. The centre of the ball
    /// then stays above one triangle, or above this triangle and neighbours that do not fall away from its plane.
    pub stays_over_face: bool,
}

impl Point {
    /// Contact point with this identifier that does not certainly stay over one face.
    pub(super) fn new(pos: V, normal: V, distance: f64, feature: u32) -> Self {
        Self { pos, normal, distance, feature, stays_over_face: false }
    }
}

/// Contact points of two shapes.
#[derive(Clone, Debug, Default)]
pub struct Manifold {
    /// Contact points, ascending by [`Point::feature`].
    pub points: Vec<Point>,
    /// Normal and features of a hull or box and a hull, from which the next step's search starts, and their separating plane if they are
    /// apart. `None` for other shapes, and if the bounding balls of the two shapes are farther apart than the largest distance of a
    /// contact.
    pub separating_plane: Option<SeparatingPlane>,
}

impl Manifold {
    /// Removes all contact points and the separating plane.
    pub fn clear(&mut self) {
        self.points.clear();
        self.separating_plane = None;
    }

    /// Smallest distance of a contact point, m, negative for overlap; infinite without points.
    pub fn deepest(&self) -> f64 {
        self.points.iter().map(|p| p.distance).fold(f64::INFINITY, f64::min)
    }

    /// Whether there is exactly one contact point, and its identifier is [`UNNAMED`].
    pub(super) fn is_single_unnamed(&self) -> bool {
        self.points.len() == 1 && self.points[0].feature == UNNAMED
    }

    /// Reverses the normals of all contact points, so that the two shapes change places.
    pub(super) fn flip_normals(&mut self) {
        self.points.iter_mut().for_each(|p| p.normal = p.normal.map(|x| -x));
    }

    /// Transforms all contact points from the frame of the first shape, which has this pose, to the world frame.
    pub(super) fn move_to_world(&mut self, pose: &Pose) {
        for p in &mut self.points {
            p.pos = add(pose.pos, rotate(&pose.mat, p.pos));
            p.normal = rotate(&pose.mat, p.normal);
        }
    }
}

/// Workspace for the computation of contact points along a normal.
#[derive(Clone, Debug, Default)]
pub(super) struct Clipper {
    /// Features (faces, edges, points) of both shapes that face each other, projected along the contact normal.
    features: [ProjectedFeature; 2],
    /// Corners of the intersection of the two projected features.
    shared: Vec<Shared>,
    /// Buffers for the clipping of polygons.
    work: Work,
}

/// Largest value of 1 - cos(angle) at which the normal of a face equals the contact normal up to rounding.
const FLAT: f64 = 1e-12;
/// Largest value of 1 - cos(angle) between the normal of a face and the contact normal at which the face counts as level, see [`ALONG`].
pub(super) const LEVEL: f64 = 0.5 * ALONG * ALONG;
/// Sine of an angle up to which two directions count as parallel, and cosine of an angle up to which they count as perpendicular.
const ALONG: f64 = 1e-2;
/// Difference of depths below which two contact points count as equally deep, relative to the size of the pair. The first of them is kept.
const EQUAL_DEPTH: f64 = 1e-6;
/// Identifier of a contact point that is not a corner of an intersection of features. Examples are contacts of edges, corners or curved
/// surfaces.
pub(super) const UNNAMED: u32 = 0x7fff_ffff;

impl Clipper {
    /// Reserves memory for features with this number of corners.
    pub(super) fn reserve(&mut self, corners: usize) {
        self.features.iter_mut().for_each(|p| p.corners.reserve(corners));
        // The largest intersections are those of two polygons, and of a polygon and a disc: corners, and two crossings on each edge.
        self.shared.reserve(4 * corners);
        self.work.reserve(2 * corners);
    }

    /// Adds the contact points of two shapes along the normal of `facing` within `limits`, in the frame of the first shape.
    ///
    /// There is at least one point if the distance of the shapes along the normal is at most `limits.max_distance`.
    pub(super) fn manifold(&mut self, pair: &Pair<'_>, facing: &Facing, limits: &SearchLimits, out: &mut Manifold) {
        let Facing { found, corners, .. } = *facing;
        let n = found.normal;
        let axes = contact_frame(n);
        let views = views(pair, &axes);
        let distance = found.separation - pair.rounding_radii();
        let tilts = pair.flats(n, corners).map(|m| m.map_or(f64::INFINITY, |m| 1.0 - dot(m, n)));
        let is_flat = tilts.iter().any(|t| *t <= FLAT);
        if is_flat {
            self.fill(pair, &views, corners);
            self.faces(pair, &axes, usize::from(tilts[0] > FLAT), limits, out);
        } else if !self.level_faces(pair, &axes, tilts, facing, limits, out) {
            self.lines(pair, &views, &axes, corners, limits, out);
        }
        // The search prefers the normal of a face to directions that are better only by rounding. The closest corner can then be just
        // beside the face. Its edge is clipped at the border of the face, at a point farther away.
        let [x, y] = found.points;
        let equal = EQUAL_DEPTH * pair.size;
        let misses_closest = is_flat && norm(sub(y, x)) <= found.separation + equal && out.deepest() > distance + equal;
        if (out.points.is_empty() || misses_closest) && distance <= limits.max_distance {
            // Halfway between the surfaces, on the line through the middle of the closest points.
            let middle = scale(add(x, y), 0.5);
            let pos = add_scaled(middle, n, dot(n, pair.a.support_at(corners[0], n)) + pair.a.radius() + 0.5 * distance - dot(n, middle));
            let at = out.points.partition_point(|p| p.feature < UNNAMED);
            out.points.insert(at, Point::new(pos, n, distance, UNNAMED));
        }
    }

    /// Adds the corners of the intersection of the two projected features as contact points, if their distance along the normal is within
    /// `limits`.
    ///
    /// `axes` are the normal and the axes of the projection plane. `reference` is the index of the feature whose plane is perpendicular to
    /// the normal, or nearly so.
    fn faces(&mut self, pair: &Pair<'_>, axes: &[V; 3], reference: usize, limits: &SearchLimits, out: &mut Manifold) {
        let (r, o) = (&self.features[reference], &self.features[1 - reference]);
        overlay(r, o, pair.tolerance, &mut self.work, &mut self.shared);
        if reference == 1 {
            self.shared.iter_mut().for_each(|s| s.h.swap(0, 1));
        }
        self.emit(pair, axes, KEPT + usize::from(self.has_rim()), KEPT, limits, out);
    }

    /// Adds the contact points of two edges that cross, if a face next to one of the edges is nearly perpendicular to the contact normal.
    /// Returns whether points were added.
    ///
    /// Such a face is nearly level: other points of it are about as close to the other shape as the crossing. Points of the whole face
    /// within `limits` are therefore added. `tilts` is 1 - cos(angle) between each shape's face normal and the
    /// contact normal. Triangles of a surface get no points, because their neighbours have these points.
    fn level_faces(
        &mut self,
        pair: &Pair<'_>,
        axes: &[V; 3],
        tilts: [f64; 2],
        facing: &Facing,
        limits: &SearchLimits,
        out: &mut Manifold,
    ) -> bool {
        let Some(reference) = tilts.iter().position(|t| *t <= LEVEL) else { return false };
        if matches!(pair.a, ConvexShape::Triangle(_)) {
            return false;
        }
        self.fill(pair, &views(pair, axes), facing.corners);
        let [r, o] = [reference, 1 - reference].map(|k| &self.features[k]);
        if !matches!(r.kind, Kind::Polygon | Kind::Disc) || o.corners.len() == 1 || !o.is_level(ALONG) {
            return false;
        }
        self.faces(pair, axes, reference, limits, out);
        // The closest points, or points of equal depth, must be among the added points. They are not if the edge does not belong to the
        // face.
        if out.deepest() > facing.found.separation - pair.rounding_radii() + EQUAL_DEPTH * pair.size {
            out.points.clear();
        }
        !out.points.is_empty()
    }

    /// Projects the features of both shapes that face each other along the normal. `corners` are the corners that are farthest towards the
    /// other shape; each feature contains its corner.
    fn fill(&mut self, pair: &Pair<'_>, views: &[View<'_>; 2], corners: [u32; 2]) {
        self.features[0].fill(pair.a, &views[0], corners[0]);
        self.features[1].fill(pair.b, &views[1], corners[1]);
    }

    /// Whether either projected feature of the pair is the end face of a cylinder.
    fn has_rim(&self) -> bool {
        self.features.iter().any(|p| p.kind == Kind::Disc)
    }

    /// Adds the contact points of a triangle of a surface with a shape that is above or below it, along the triangle's normal. The
    /// triangle is the first shape of `pair`. Points beyond `limits` are left out.
    ///
    /// Corners of the second shape count if they are above or below the triangle. In the valley between two triangles they also count if
    /// they are behind both planes; `rises` are the tangents of [`Facet::rises`]. Crossings of edges count only at convex edges, and if the
    /// feature of the second shape is parallel to the triangle. Otherwise a corner is deeper, or another triangle is closer.
    pub(super) fn over_facet(&mut self, pair: &Pair<'_>, facet: &Facet<'_>, rises: &[f64; 3], limits: &SearchLimits, out: &mut Manifold) {
        let axes = contact_frame(facet.normal);
        let views = views(pair, &axes);
        self.fill(pair, &views, pair.corners(facet.normal));
        let [triangle, other] = &self.features;
        overlay(triangle, other, pair.tolerance, &mut self.work, &mut self.shared);
        let is_level = other.is_level(ALONG);
        self.shared.retain(|s| edges_of_triangle(other, s.id).is_none_or(|edges| is_level && edges.into_iter().any(|k| facet.bulges[k])));
        if rises.iter().any(|&x| x > 0.0) {
            behind(triangle, other, rises, &mut self.shared);
        }
        self.emit(pair, &axes, KEPT + usize::from(self.has_rim()), KEPT, limits, out);
    }

    /// Adds the contact points of the second shape of `pair` with a half space within `limits`. The half space is
    /// below the xy plane of the first shape's frame.
    pub(super) fn half_space(&mut self, pair: &Pair<'_>, limits: &SearchLimits, out: &mut Manifold) {
        let axes = contact_frame([0.0, 0.0, 1.0]);
        let view = views(pair, &axes)[1];
        let feature = &mut self.features[1];
        let corner = pair.b.corner(view.towards()).1;
        feature.fill(pair.b, &view, corner);
        feature.add_neighbours(pair.b, &view, corner);
        self.shared.clear();
        self.shared.extend(feature.corners.iter().map(|c| Shared { x: c.x, y: c.y, h: [0.0, c.h], id: c.id }));
        // The half space has no feature: `features[0]` belongs to an earlier pair.
        let rim = feature.kind == Kind::Disc;
        self.emit(pair, &axes, KEPT + usize::from(rim), MAX_POINTS, limits, out);
    }

    /// Adds the contact points of a half space with those `points` that are within `limits`. The points are in the frame of the second
    /// shape, m.
    ///
    /// The half space is below the xy plane of the first shape's frame.
    pub(super) fn cloud(&mut self, pair: &Pair<'_>, points: &[V], limits: &SearchLimits, out: &mut Manifold) {
        let axes = contact_frame([0.0, 0.0, 1.0]);
        let view = views(pair, &axes)[1];
        self.shared.clear();
        let seen = points.iter().map(|p| view.project(*p)).enumerate();
        let shared = seen.map(|(i, [x, y, h])| Shared { x, y, h: [0.0, h], id: i as u32 });
        self.shared.extend(shared.filter(|s| s.h[1] <= limits.max_distance));
        self.emit(pair, &axes, KEPT, MAX_POINTS, limits, out);
    }

    /// Adds the contact points of two parallel edges or straight lines: both ends of the part in which they overlap. No points are added
    /// for edges that are not parallel. Points beyond `limits` are left out.
    ///
    /// `axes` are the normal and the axes of the projection plane. `corners` are the corners of the shapes that are farthest towards the
    /// other shape.
    fn lines(
        &mut self,
        pair: &Pair<'_>,
        views: &[View<'_>; 2],
        axes: &[V; 3],
        corners: [u32; 2],
        limits: &SearchLimits,
        out: &mut Manifold,
    ) {
        let edges = [edge(pair.a, views[0].towards(), corners[0], ALONG), edge(pair.b, views[1].towards(), corners[1], ALONG)];
        let [Some(p), Some(q)] = edges else { return };
        let (u, v) = (sub(p[1], p[0]), rotate(views[1].mat, sub(q[1], q[0])));
        let sine = norm(cross(u, v));
        if sine > ALONG * norm(u) * norm(v) {
            return;
        }
        let [p, q] = [p.map(|x| views[0].project(x)), q.map(|x| views[1].project(x))];
        let (u, v) = ([p[1][0] - p[0][0], p[1][1] - p[0][1]], [q[1][0] - q[0][0], q[1][1] - q[0][1]]);
        let (uu, vv) = (u[0] * u[0] + u[1] * u[1], v[0] * v[0] + v[1] * v[1]);
        if uu == 0.0 || vv == 0.0 {
            return;
        }
        // Ends of the second line as fractions along the first line.
        let share = |e: [f64; 3]| ((e[0] - p[0][0]) * u[0] + (e[1] - p[0][1]) * u[1]) / uu;
        let (s, t) = (share(q[0]), share(q[1]));
        if s == t || s.max(t) <= 0.0 || s.min(t) >= 1.0 {
            return;
        }
        self.shared.clear();
        // Identifiers: 0 and 1 for ends of the first line, 2 and 3 for ends of the second.
        let ends = [(0.0, 0), (1.0, 1), (s, 2), (t, 3)];
        for (x, id) in ends {
            let within = if id < 2 { (x - s) * (x - t) <= 0.0 } else { x > 0.0 && x < 1.0 };
            if within {
                let y = (x - s) / (t - s);
                let at = |e: &[[f64; 3]; 2], w: f64, k: usize| e[0][k] + (e[1][k] - e[0][k]) * w;
                let (a, b) = (std::array::from_fn::<f64, 3, _>(|k| at(&p, x, k)), std::array::from_fn::<f64, 3, _>(|k| at(&q, y, k)));
                if (a[0] - b[0]).hypot(a[1] - b[1]) > ALONG * uu.max(vv).sqrt() {
                    // The lines are too far apart sideways. Other points are closest.
                    return;
                }
                self.shared.push(Shared { x: 0.5 * (a[0] + b[0]), y: 0.5 * (a[1] + b[1]), h: [a[2], b[2]], id });
            }
        }
        self.emit(pair, axes, KEPT, KEPT, limits, out);
    }

    /// Adds the corners of the intersection of the two projected features as contact points, if their distance is within `limits`.
    ///
    /// If more than `all` points touch, the function adds four of them that span nearly the same area. `all` is five instead of four if one
    /// feature is the end face of a cylinder: four fixed points of the rim and its lowest point. Farther points are added up to `most`
    /// points in all. `axes` are the normal and the axes of the projection plane.
    fn emit(&mut self, pair: &Pair<'_>, axes: &[V; 3], all: usize, most: usize, limits: &SearchLimits, out: &mut Manifold) {
        let (ra, rb) = (pair.a.radius(), pair.b.radius());
        let distance = |s: &Shared| (s.h[1] - rb) - (s.h[0] + ra);
        self.shared.retain(|s| distance(s) <= limits.max_distance);
        self.shared.sort_unstable_by_key(|s| s.id);
        self.shared.dedup_by_key(|s| s.id);
        if self.shared.len() > all {
            // Only the distance of the surfaces matters here. It becomes the second height, and the first is 0.
            let see = |s: &Shared| Shared { h: [0.0, distance(s)], ..*s };
            reduce(&mut self.shared, 0, see, [all, most], limits, pair.size);
        }
        for s in &self.shared {
            let h = 0.5 * (s.h[0] + ra + s.h[1] - rb);
            let pos = add_scaled(add_scaled(scale(axes[0], h), axes[1], s.x), axes[2], s.y);
            out.points.push(Point::new(pos, axes[0], distance(s), s.id));
        }
    }
}

/// Views of both shapes of a pair for projection along the contact normal, `axes[0]`.
fn views<'a>(pair: &'a Pair<'_>, axes: &'a [V; 3]) -> [View<'a>; 2] {
    [View { pos: [0.0; 3], mat: &IDENTITY, axes, side: 1.0 }, View { pos: pair.pos, mat: &pair.mat, axes, side: -1.0 }]
}

/// Upper bound of the identifiers of contact points at a vertex of a shape.
pub(super) const VERTICES: u32 = 1 << 30;

/// Identifier of a contact with a part of a shape, such as a triangle of a mesh. It is a hash of the part and of the feature's identifier
/// there.
pub(super) fn mix(part: u32, feature: u32) -> u32 {
    1 << 31 | (part.wrapping_mul(0x9E37_79B1) ^ feature.wrapping_mul(0x85EB_CA6B)) >> 1
}

/// Moves contact points of several triangles from `all` to `out`, and reduces their number.
///
/// Points at the same place with the same normal are merged. Of those with the same normal, at most four remain, see [`reduce`]. At
/// most `most` points remain in all, the deepest. `size` is the size of the pair, m.
pub(super) fn reduce_points(all: &mut Vec<Point>, size: f64, limits: &SearchLimits, most: usize, out: &mut Manifold) {
    let alike = |a: &Point, b: &Point| dot(a.normal, b.normal) > 1.0 - 1e-6;
    all.sort_unstable_by(|a, b| a.feature.cmp(&b.feature).then(a.distance.total_cmp(&b.distance)));
    while let Some(&first) = all.first() {
        let start = out.points.len();
        let axes = contact_frame(first.normal);
        // A normal that is not a unit vector is not parallel to itself. The first point is therefore always removed, so that the loop ends.
        let mut is_first = true;
        all.retain(|p| {
            let same = std::mem::take(&mut is_first) || alike(&first, p);
            let known = |q: &Point| norm(sub(p.pos, q.pos)) < 1e-6 * size;
            if same && !out.points[start..].iter().any(known) {
                out.points.push(*p);
            }
            !same
        });
        if out.points.len() > start + 2 {
            let see = |p: &Point| Shared { x: dot(p.pos, axes[1]), y: dot(p.pos, axes[2]), h: [0.0, p.distance], id: p.feature };
            reduce(&mut out.points, start, see, [2, KEPT], limits, size);
        }
    }
    if out.points.len() > most {
        out.points.sort_unstable_by(|a, b| a.distance.total_cmp(&b.distance).then(a.feature.cmp(&b.feature)));
        out.points.truncate(most);
    }
    out.points.sort_unstable_by(|a, b| a.feature.cmp(&b.feature).then(a.distance.total_cmp(&b.distance)));
    // One vertex may touch several triangles.
    let (mut last, mut copies) = (None, 0);
    for p in &mut out.points {
        copies = if last == Some(p.feature) { copies + 1 } else { 0 };
        last = Some(p.feature);
        if copies > 0 {
            p.feature = mix(copies, p.feature);
        }
    }
    out.points.sort_unstable_by_key(|p| p.feature);
}

/// Reduces the points from index `start` on. They must ascend by identifier, and the remaining ones do.
///
/// If more than `all` points touch, [`KEPT`] of them remain, which span nearly the same area. Farther points are kept up to `most` points
/// in all; if there are too many, those remain that span nearly the area of the farther points. `see` returns a point with its distance as
/// second height, m, and `size` is the size of the pair, m.
fn reduce<T: Copy>(
    points: &mut Vec<T>,
    start: usize,
    see: impl Fn(&T) -> Shared,
    [all, most]: [usize; 2],
    limits: &SearchLimits,
    size: f64,
) {
    let group = &mut points[start..];
    let deepest = group.iter().map(|p| see(p).h[1]).fold(f64::INFINITY, f64::min);
    let limit = limits.touching.max(deepest + EQUAL_DEPTH * size);
    let is_far = |p: &T| see(p).h[1] > limit;
    let order = |p: &T, q: &T| see(p).id.cmp(&see(q).id).then(see(p).h[1].total_cmp(&see(q).h[1]));
    group.sort_unstable_by(|p, q| is_far(p).cmp(&is_far(q)).then_with(|| order(p, q)));
    let touching = group.partition_point(|p| !is_far(p));
    let mut count = 0;
    for (range, all) in [(0..touching, Some(all)), (touching..group.len(), None)] {
        let room = if all.is_some() { KEPT } else { most.saturating_sub(count) };
        if range.len() <= all.unwrap_or(room) {
            group.copy_within(range.clone(), count);
            count += range.len();
        } else if room > 0 {
            for i in spanning(&|k| see(&group[range.start + k]), range.len(), room, size) {
                group[count] = group[range.start + i];
                count += 1;
            }
        }
    }
    group[..count].sort_unstable_by(order);
    points.truncate(start + count);
}

/// Indices, ascending, of contact points that span nearly the area of all points.
///
/// The point that is chosen first is the deepest of the `count` points (smallest `h[1]`), the second the point farthest from it. The third
/// is the point farthest from the line through these two, and the fourth adds most area to the triangle of the three. Of points that are
/// equal up to rounding, the first in the list is chosen. The choice therefore does not change from step to step. At most `most`
/// points are chosen, and `count` is at least 2. `size` is the size of the pair, m.
fn spanning(point: &dyn Fn(usize) -> Shared, count: usize, most: usize, size: f64) -> ArrayVec<usize, KEPT> {
    let (tie, tie_area) = (EQUAL_DEPTH * size, 1e-6 * size * size);
    let mut kept = ArrayVec::new();
    kept.push(pick(point, count, &kept, tie, |p| -p.h[1]));
    let a = point(kept[0]);
    kept.push(pick(point, count, &kept, tie_area, |p| (p.x - a.x) * (p.x - a.x) + (p.y - a.y) * (p.y - a.y)));
    if count >= 3 && most >= 3 {
        let b = point(kept[1]);
        let side = |p: &Shared| (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x);
        let third = pick(point, count, &kept, tie_area, |p| side(p).abs());
        let c = point(third);
        if side(&c).abs() > tie_area {
            kept.push(third);
        }
        let sign = if side(&c) < 0.0 { 1.0 } else { -1.0 };
        // Twice the area that the point adds to the triangle; negative inside.
        let beyond = |p: &Shared| {
            let across = |u: &Shared, v: &Shared| ((v.x - u.x) * (p.y - u.y) - (v.y - u.y) * (p.x - u.x)) * sign;
            across(&a, &b).max(across(&b, &c)).max(across(&c, &a))
        };
        if kept.len() == 3 && count.min(most) > 3 {
            let fourth = pick(point, count, &kept, tie_area, beyond);
            if beyond(&point(fourth)) > tie_area {
                kept.push(fourth);
            }
        }
    }
    kept.truncate(most);
    kept.sort_unstable();
    kept
}

/// Index of the point with the largest `value`, among `count` points except those with an index in `but`. Of points whose values are equal
/// up to `tie` it is the first.
fn pick(point: &dyn Fn(usize) -> Shared, count: usize, but: &[usize], tie: f64, value: impl Fn(&Shared) -> f64) -> usize {
    let (mut best, mut most) = (usize::MAX, f64::NEG_INFINITY);
    for i in (0..count).filter(|i| !but.contains(i)) {
        let x = value(&point(i));
        if best == usize::MAX || x > most + tie {
            (best, most) = (i, x);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Touching points are reduced as without farther ones, so that the search distance removes none.
        #[test]
        fn far_points_do_not_change_the_touching_ones(
            points in prop::collection::vec((-1.0..1.0f64, -1.0..1.0f64, prop_oneof![-1e-3..1e-3f64, 2e-3..1.0f64]), 1..20),
            all in 2..6usize,
            most in KEPT..=MAX_POINTS,
        ) {
            let limits = SearchLimits { touching: 1e-3, ..1.0.into() };
            let mut every: Vec<Shared> = (0..).zip(&points).map(|(id, &(x, y, h))| Shared { x, y, h: [0.0, h], id }).collect();
            let mut near: Vec<Shared> = every.iter().filter(|s| s.h[1] <= limits.touching).copied().collect();
            let ids = |points: &[Shared]| points.iter().map(|s| s.id).collect::<Vec<_>>();
            reduce(&mut every, 0, |s| *s, [all, most], &limits, 2.0);
            prop_assert!(every.len() <= most.max(all) && every.is_sorted_by_key(|s| s.id));
            if !near.is_empty() {
                reduce(&mut near, 0, |s| *s, [all, most], &limits, 2.0);
                every.retain(|s| s.h[1] <= limits.touching);
                prop_assert_eq!(ids(&every), ids(&near));
            }
        }
    }

    #[test]
    fn points_without_a_normal_are_thinned_too() {
        let point = |normal: V, feature: u32| Point { normal, feature, ..Point::default() };
        let mut all = vec![point([f64::NAN; 3], 0), point([0.0; 3], 1), point([0.0, 0.0, 1.0], 2), point([f64::INFINITY, 0.0, 0.0], 3)];
        let mut out = Manifold::default();
        reduce_points(&mut all, 1.0, &1.0.into(), 16, &mut out);
        assert!(all.is_empty());
        assert_eq!(out.points.len(), 4);
    }
}
