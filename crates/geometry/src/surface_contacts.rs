//! Contacts with surfaces of triangles: concave meshes and height fields.
//!
//! A surface is solid behind its triangles (below them, for a height field). Contact forces therefore never pull a shape through it.
//! Contacts are found triangle by triangle. The closest point p of a triangle is a contact only if no neighbour is closer to the shape.
//! With the vector d from p to the shape, this is the case if
//!
//! ```text
//! d . u <= 0
//! ```
//!
//! for every direction u along the surface that starts at p.
//!
//! Inside a triangle, only its normal is such a d. At an edge, the vectors d are between the normals of the two triangles. At a corner,
//! they are in the cone of the normals of its triangles. (This cone is the Gauss image of the corner, and the shape is in its Voronoi
//! region: Lin & Canny, 1991.) A concave edge has no such d.
//!
//! If the closest point belongs to a neighbour, the triangle has no contact there. Such a contact would be a tilted plane that is not part
//! of the surface, and would brake a shape that slides past. Corners of the shape above the triangle are still contacts, with the
//! triangle's normal. Edges without a neighbour count as convex.

use std::ops::Range;

use crate::approach::Approach;
use crate::ball::{Ball, TriangleTest, ball_over};
use crate::facet::{Facet, Outline, PARALLEL, from_segment, stays_over};
use crate::facing::Facing;
use crate::linear_algebra::*;
use crate::manifold::{LEVEL, Point, VERTICES, reduce_points};
use crate::narrow::Narrow;
use crate::pair::Pair;
use crate::round::{ends, is_over, may_touch, nearest_of_triangle};
use crate::search_limits::SearchLimits;
use crate::separation;
use crate::shape::{ConvexShape, POINT};
use crate::surface::Surface;
use crate::vectors::{Pose, V, furthest, neg, unit_or};

/// Largest number of contact points of a convex shape and a surface.
pub const MAX_SURFACE_POINTS: usize = 16;

/// Depth up to which a contact point certainly belongs to the triangle above it, relative to the size of the pair. Deeper points may be
/// closer to another triangle. Contacts at rest are at most 1e-4 deep.
const SHALLOW: f64 = 1e-3;

/// Distance of a deep contact point from another triangle, relative to the point's depth, below which the point belongs to that triangle.
///
/// Example: a peg overlaps the wall of its hole by micrometres, and is centimetres below the face around the hole.
const NEARER: f64 = 0.5;

/// Range of the cosine between the normals of two triangles, within which a contact point of one may belong to the other. Above it the
/// triangles are part of one face. Below it they are the two sides of a thin sheet.
const TURNED: Range<f64> = -0.5..0.99;

impl Narrow {
    /// Distance of a convex shape from the triangles of a surface, m; negative if the shape overlaps a triangle. A shape behind the
    /// surface has a positive distance, too. If the distance exceeds `most`, m, the result is `most`. `ground` is the pose of the
    /// surface, `body` the pose of the shape.
    pub fn clearance(&mut self, surface: &Surface, shape: &ConvexShape, [ground, body]: [Pose; 2], most: f64) -> f64 {
        let Self { triangles, polytope, .. } = self;
        let whole = Pair::new(&POINT, &ground, shape, &body);
        let [low, high] = search_box(&whole, ends(&whole).as_deref(), most + shape.radius(), None);
        surface.candidates(low, high, triangles);
        let mut least = most;
        for &t in &*triangles {
            let triangle = ConvexShape::Triangle(surface.triangle(t));
            let pair = Pair::between(&triangle, shape, whole.pos, whole.mat);
            let found = separation::nearest(&pair, &least.into(), polytope).found;
            least = least.min(found.separation - pair.rounding_radii());
            if least < 0.0 {
                break;
            }
        }
        least
    }

    /// Adds the contact points of a surface and a convex shape. There are at most [`MAX_SURFACE_POINTS`].
    ///
    /// The distance of each point is at most `limits.max_distance`, m. Normals point from the surface to the shape. Points and normals are
    /// in the world frame.
    ///
    /// If `limits.approach` is given, points that cannot push within the step may be absent. The normal of a contact at an edge or corner
    /// is a positive combination of the normals of the triangles there. The contact's closing speed is therefore at most the same
    /// combination of the closing speeds of these triangles. The contact can push only if a contact with one of the triangles can. At a
    /// border of the surface this need not be true, so that all triangles there are tested.
    pub(super) fn collide_surface(&mut self, a: &Surface, pose_a: &Pose, b: &ConvexShape, pose_b: &Pose, limits: &SearchLimits) {
        let SearchLimits { max_distance, approach, .. } = *limits;
        let whole = Pair::new(&POINT, pose_a, b, pose_b);
        if !whole.is_finite() {
            return;
        }
        let reach = max_distance + b.radius();
        let core = ends(&whole);
        let nearer = approach.filter(|_| matches!(a, Surface::Mesh(_)));
        let [low, high] = search_box(&whole, core.as_deref(), reach, nearer);
        let mut triangles = std::mem::take(&mut self.triangles);
        a.candidates(low, high, &mut triangles);
        let mut culled = nearer.is_some();
        self.all.clear();
        self.owners.clear();
        // Triangle with the smallest separation, among the triangles whose closest point belongs to a neighbour.
        let mut left: Option<(u32, Facing)> = None;
        for &t in &triangles {
            let corners = a.triangle(t);
            let normal = a.normal(t, &corners);
            // The separation along the normal is a lower bound of the distance.
            let along = match &core {
                Some(ends) => ends.iter().map(|end| dot(normal, sub(*end, corners[0]))).reduce(f64::min).unwrap_or_default(),
                None => dot(normal, whole.support_b(neg(normal))) - dot(normal, corners[furthest(&corners, normal)]),
            };
            if along - b.radius() > max_distance {
                continue;
            }
            if let Some(approach) = &approach
                && approach.excludes_normal(normal, along - b.radius(), whole.size)
                && !a.is_at_border(t)
            {
                culled = true;
                continue;
            }
            if let Some(ends) = &core {
                // Most triangles are outside the projection of a ball or capsule. Most balls are above exactly one triangle.
                if !may_touch(&corners, normal, ends, reach) {
                    continue;
                }
                if let [centre] = ends[..] {
                    if along > 0.0 && is_over(&corners, normal, centre) {
                        let stays_over_face =
                            approach.is_some_and(|approach| stays_over(a, t, &corners, normal, centre, approach.sideways(normal)));
                        self.all.push(Point { feature: feature_id(t, 0), stays_over_face, ..ball_over(normal, centre, along, b.radius()) });
                        self.owners.push(t);
                        continue;
                    }
                    // A ball beside the triangle may be too far from its outline, or have no contact that can push. A ball behind a
                    // triangle of a mesh is on the other side of a wall.
                    let mut is_far = || {
                        let apart = sub(centre, nearest_of_triangle(&corners, centre));
                        let (distance, n) = (norm(apart), unit_or(apart, normal));
                        if distance - b.radius() > max_distance {
                            return true;
                        }
                        let cannot_push = approach.is_some_and(|a| a.excludes_normal(n, distance - b.radius(), whole.size));
                        culled |= cannot_push;
                        cannot_push
                    };
                    let is_left_out = if along > 0.0 { is_far() } else { matches!(a, Surface::Mesh(_)) };
                    if is_left_out {
                        continue;
                    }
                }
            }
            let facet = Facet::new(a, t, corners, normal);
            let triangle = ConvexShape::Triangle(facet.corners);
            let pair = Pair::between(&triangle, b, whole.pos, whole.mat);
            if let Some(facing) = self.touch(&facet, &pair, along, limits)
                && left.as_ref().is_none_or(|(_, other)| facing.found.separation < other.found.separation)
            {
                left = Some((t, facing));
            }
            self.all.extend(self.found.points.drain(..).map(|p| Point { feature: feature_id(t, p.feature), ..p }));
            self.owners.resize(self.all.len(), t);
        }
        if self.all.iter().any(|p| p.distance < -SHALLOW * whole.size) {
            self.drop_nearer_elsewhere(a, &triangles, whole.size);
        }
        self.triangles = triangles;
        if culled && left.is_some() && self.all.is_empty() {
            // The closest point may belong to a skipped triangle: one whose contacts cannot push within the step. The second search skips
            // none.
            return self.collide_surface(a, pose_a, b, pose_b, &SearchLimits { approach: None, ..*limits });
        }
        // If no triangle accepted a point, rounding caused all to reject the closest one.
        if let Some((t, facing)) = left.filter(|_| self.all.is_empty()) {
            let triangle = ConvexShape::Triangle(a.triangle(t));
            let pair = Pair::between(&triangle, b, whole.pos, whole.mat);
            self.clipper.manifold(&pair, &facing, limits, &mut self.found);
            self.all.extend(self.found.points.drain(..).map(|p| Point { feature: feature_id(t, p.feature), ..p }));
        }
        reduce_points(&mut self.all, whole.size, limits, MAX_SURFACE_POINTS, &mut self.found);
        self.found.move_to_world(pose_a);
    }

    /// Adds the contact points of a half space and the vertices of a mesh.
    ///
    /// The half space is below the xy plane of the pose `plane`. A height field gets no contact points.
    pub(super) fn collide_half_space_and_surface(&mut self, plane: &Pose, surface: &Surface, pose: &Pose, limits: &SearchLimits) {
        if let Surface::Mesh(mesh) = surface {
            self.clipper.cloud(&Pair::new(&POINT, plane, &POINT, pose), &mesh.vertices, limits, &mut self.found);
            self.found.move_to_world(plane);
        }
    }

    /// Adds the contact points of a triangle and a shape. The shape is the second one of `pair`.
    ///
    /// `along` is the separation of the triangle and the shape without its rounding radius, along the normal of the triangle, m. Points
    /// beyond `limits` are left out. If there are no points because the closest point belongs to a neighbour, the result is the separation
    /// of triangle and shape; else `None`.
    fn touch(&mut self, facet: &Facet<'_>, pair: &Pair<'_>, along: f64, limits: &SearchLimits) -> Option<Facing> {
        if matches!(pair.b, ConvexShape::Sphere { .. }) {
            let ball = Ball { facet, pair, height: along, max_distance: limits.max_distance };
            match ball.touch(&mut self.found) {
                TriangleTest::Complete => return None,
                TriangleTest::LeftToNeighbour(facing) => return Some(facing),
                TriangleTest::Unclear => {}
            }
        }
        self.touch_any(facet, pair, along, limits)
    }

    /// Adds the contact points of a triangle and a shape by the general search, which works for all shapes. The arguments and the result
    /// are the same as for [`Narrow::touch`].
    fn touch_any(&mut self, facet: &Facet<'_>, pair: &Pair<'_>, along: f64, limits: &SearchLimits) -> Option<Facing> {
        let normal = facet.normal;
        let over = |narrow: &mut Self| {
            let rises = if along < 0.0 { facet.rises() } else { [0.0; 3] };
            if facet.may_be_under(pair, &rises) {
                narrow.clipper.over_facet(pair, facet, &rises, limits, &mut narrow.found);
            }
        };
        let behind = dot(normal, pair.apart) <= 0.0;
        if behind && let Surface::Grid(grid) = facet.surface {
            // The shape is inside a height field, or outside again on the other side of a sharp crest.
            over(self);
            if !grid.is_below(add(pair.apart, pair.a.centre())) {
                self.found.points.retain(|p| p.distance >= 0.0 || grid.is_below(add_scaled(p.pos, p.normal, 0.5 * p.distance)));
            }
            return None;
        }
        if behind && dot(normal, sub(pair.support_b(normal), facet.corners[0])) <= 0.0 {
            // The whole shape is on the other side of a wall of a mesh.
            return None;
        }
        // If the shape's centre is behind a triangle of a mesh, its closest point may be on the triangle's outline, at a sharp edge. The
        // shape's corners above or below the triangle are then not contacts.
        let over = |narrow: &mut Self| {
            if !behind {
                over(narrow);
            }
        };
        if facet.bulges == [false; 3] {
            // At concave edges, the neighbours are at least as close.
            over(self);
            return None;
        }
        let facing = separation::nearest(pair, &limits.max_distance.into(), &mut self.polytope);
        let found = &facing.found;
        if found.separation - pair.rounding_radii() > limits.max_distance {
            return None;
        }
        let cos = dot(found.normal, normal);
        if behind && (cos <= 0.0 || found.separation <= 0.0) {
            return None;
        }
        if 1.0 - cos <= PARALLEL {
            over(self);
            return None;
        }
        let (at, p) = facet.furthest(found.normal);
        if cos > 0.0 && !matches!(at, Outline::Inside) && facet.is_nearest(&at, p, found.normal) {
            self.clipper.manifold(pair, &facing, limits, &mut self.found);
            if self.found.is_single_unnamed() && 1.0 - cos <= LEVEL {
                // The other corners of a slightly tilted shape above the triangle are as close, or soon will be.
                over(self);
            }
            return None;
        }
        over(self);
        (self.found.points.is_empty() && cos > 0.0).then_some(facing)
    }

    /// Removes contact points that are deep below their triangle and much closer to another of the `triangles`, unless no point would
    /// remain.
    ///
    /// A point behind the other triangle is removed only if that triangle has a shallower point. Otherwise, at a sharp ridge, the deep
    /// point is the only contact there. `size` is the size of the pair, m.
    #[cold]
    fn drop_nearer_elsewhere(&mut self, surface: &Surface, triangles: &[u32], size: f64) {
        let Self { all, owners, is_own, .. } = self;
        let belongs = |p: &Point| {
            let (x, reach) = (add_scaled(p.pos, p.normal, 0.5 * p.distance), -NEARER * p.distance);
            let has_shallower = |t: &u32| owners.iter().zip(all.iter()).any(|(owner, other)| owner == t && other.distance > p.distance);
            let is_nearer = |t: &u32| {
                let corners = surface.triangle(*t);
                let normal = surface.normal(*t, &corners);
                let height = dot(normal, sub(x, corners[0]));
                // Rounding of poses in single precision.
                let touches = height.abs() <= 1e-7 * size;
                (touches || height < 0.0 && has_shallower(t))
                    && TURNED.contains(&dot(normal, p.normal))
                    && distance(&corners, normal, x) < reach
            };
            p.distance >= -SHALLOW * size || !triangles.iter().any(is_nearer)
        };
        is_own.clear();
        is_own.extend(all.iter().map(belongs));
        if is_own.contains(&true) {
            let mut own = is_own.iter();
            all.retain(|_| own.next() == Some(&true));
        }
    }
}

/// Smallest and largest coordinates of the box in which triangles can have contacts with a shape, m, in the frame of the surface.
///
/// The shape is the second one of `whole`. `core` is the centre of a ball or the ends of a capsule's segment; `None` for other shapes.
/// Triangles count if they are within `reach` of the shape without its rounding radius, m. If `approach` is given, they count only if their
/// contacts can push within the step.
///
/// A contact joins a point x of the surface and a point y of the shape. For contacts that can push, [`Approach::max_components`] bounds y -
/// x. The box can therefore be smaller with `approach`, but is never smaller than for a shape at rest.
fn search_box(whole: &Pair<'_>, core: Option<&[V]>, reach: f64, approach: Option<Approach>) -> [V; 2] {
    let [low, high] = whole.extent_b(core);
    let [against_axes, along_axes] = approach.map_or([[f64::INFINITY; 3]; 2], |approach| approach.max_components(whole.size));
    let reach = |most: f64| reach.min(whole.b.radius() + most);
    [array_of(|k| low[k] - reach(along_axes[k])), array_of(|k| high[k] + reach(against_axes[k]))]
}

/// Identifier of a contact point of a triangle and a shape. At a vertex of the shape it is the same for all triangles. At an edge or face
/// it depends on the triangle.
fn feature_id(triangle: u32, feature: u32) -> u32 {
    if feature < VERTICES { feature } else { crate::manifold::mix(triangle, feature) }
}

/// Distance of the point `x` from a triangle with this unit normal, m.
fn distance(corners: &[V; 3], normal: V, x: V) -> f64 {
    if is_over(corners, normal, x) {
        return dot(normal, sub(x, corners[0])).abs();
    }
    (0..3).map(|k| from_segment(x, corners[k], corners[(k + 1) % 3])).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifold::Manifold;
    use crate::shape::triangle_normal;
    use crate::surface::Grid;
    use crate::vectors::IDENTITY;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]

        /// The general search finds the same contact points of a ball as the closed form, up to rounding.
        #[test]
        fn a_ball_touches_as_any_shape_does(
            heights in prop::collection::vec(0.0..0.3f64, 16), level in prop::bool::ANY, cell in 0..9u32, upper in 0..2u32,
            radius in 0.01..0.4f64, at in (-1.5..1.5f64, -1.5..1.5f64, -0.3..0.7f64),
        ) {
            let heights = if level { vec![0.1; 16] } else { heights };
            let surface = Surface::Grid(Grid::new([4, 4], [1.5; 2], heights, 1.0));
            let (t, shape) = (2 * cell + upper, ConvexShape::Sphere { radius });
            let corners = surface.triangle(t);
            let facet = Facet::new(&surface, t, corners, triangle_normal(&corners));
            let triangle = ConvexShape::Triangle(facet.corners);
            let pair = Pair::between(&triangle, &shape, [at.0, at.1, at.2], IDENTITY);
            let (height, max_distance) = (pair.separation(facet.normal), 0.1);
            if height - radius > max_distance {
                return Ok(());
            }
            let (mut own, mut any) = (Manifold::default(), Narrow::default());
            let ball = Ball { facet: &facet, pair: &pair, height, max_distance };
            let left = ball.touch(&mut own);
            let left_any = any.touch_any(&facet, &pair, height, &max_distance.into());
            match left {
                TriangleTest::Unclear => return Ok(()),
                TriangleTest::Complete => prop_assert!(left_any.is_none()),
                TriangleTest::LeftToNeighbour(facing) => {
                    prop_assert!((facing.found.separation - left_any.unwrap().found.separation).abs() < 1e-12);
                }
            }
            prop_assert_eq!(own.points.len(), any.found.points.len());
            for (a, b) in own.points.iter().zip(&any.found.points) {
                prop_assert_eq!(a.feature, b.feature);
                // The normal of the search errs by the rounding of positions over the distance.
                prop_assert!((a.distance - b.distance).abs() < 1e-12 && norm(sub(a.pos, b.pos)) < 1e-9 && norm(sub(a.normal, b.normal)) < 1e-9);
            }
        }
    }
}
