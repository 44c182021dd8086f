//! Contact of a ball and a triangle of a surface, in closed form. The general search finds the same contacts and takes longer.

use crate::facet::{Facet, Outline, PARALLEL};
use crate::facing::{EQUAL_SEPARATION, Facing, Separation};
use crate::linear_algebra::*;
use crate::manifold::{Manifold, Point, UNNAMED};
use crate::pair::Pair;
use crate::round::{CLOSE, nearest_of_triangle};
use crate::separation::{NEAR_FACE, SIDEWAYS};
use crate::surface::Surface;
use crate::vectors::V;

/// Ball and a triangle of a surface. All positions are in the frame of the surface, m.
pub(super) struct Ball<'a> {
    /// Triangle of the surface, with its neighbours.
    pub(super) facet: &'a Facet<'a>,
    /// Pair of shapes: the triangle first, the ball second.
    pub(super) pair: &'a Pair<'a>,
    /// Signed distance of the ball's centre above the plane of the triangle, m.
    pub(super) height: f64,
    /// Largest distance at which a contact is added, m.
    pub(super) max_distance: f64,
}

/// Result of the test of a ball against one triangle of a surface.
pub(super) enum TriangleTest {
    /// The contact of the triangle was added, or the triangle has none. No further test is necessary.
    Complete,
    /// No contact, because the closest point of the triangle belongs to a neighbour. The value is the separation of triangle and ball.
    LeftToNeighbour(Facing),
    /// The centre of the ball is too close to the triangle for the closed form. The general search must decide.
    Unclear,
}

/// Contact of a ball with the plane of a triangle.
///
/// `normal` is the unit normal of the triangle, `centre` the centre of the ball, m, and `height` the distance of the centre above the
/// plane, m.
pub(super) fn ball_over(normal: V, centre: V, height: f64, radius: f64) -> Point {
    Point::new(add_scaled(centre, normal, -0.5 * (height + radius)), normal, height - radius, 0)
}

impl Ball<'_> {
    /// Adds the contact of the ball and the triangle to `out`, if there is one.
    pub(super) fn touch(&self, out: &mut Manifold) -> TriangleTest {
        let Self { facet, pair, height, max_distance } = *self;
        let (normal, centre, radius) = (facet.normal, pair.pos, pair.b.radius());
        let beyond = self.beyond_edges();
        let behind = dot(normal, pair.apart) <= 0.0;
        if behind {
            let Surface::Grid(grid) = facet.surface else {
                return if height <= 0.0 { TriangleTest::Complete } else { TriangleTest::Unclear };
            };
            self.add_over(&beyond, out);
            if !grid.is_below(centre) {
                out.points.retain(|p| p.distance >= 0.0 || grid.is_below(add_scaled(p.pos, p.normal, 0.5 * p.distance)));
            }
            return TriangleTest::Complete;
        }
        if facet.bulges == [false; 3] || beyond.iter().all(|&x| x <= 0.0) {
            self.add_over(&beyond, out);
            return TriangleTest::Complete;
        }
        let nearest = nearest_of_triangle(&facet.corners, centre);
        let apart = sub(centre, nearest);
        let separation = norm(apart);
        if separation - radius > max_distance {
            return TriangleTest::Complete;
        }
        if separation <= CLOSE * pair.size {
            return TriangleTest::Unclear;
        }
        let own = scale(apart, 1.0 / separation);
        let cos = dot(own, normal);
        let beside = norm(add_scaled(apart, normal, -dot(apart, normal)));
        let is_face = cos > 0.0
            && 1.0 - cos < NEAR_FACE * NEAR_FACE
            && height >= separation - EQUAL_SEPARATION * pair.size
            && beside <= SIDEWAYS * pair.size;
        if is_face || 1.0 - cos <= PARALLEL {
            self.add_over(&beyond, out);
            return TriangleTest::Complete;
        }
        let own = own.map(|x| x + 0.0);
        let (at, corner) = facet.furthest(own);
        if cos > 0.0 && !matches!(at, Outline::Inside) && facet.is_nearest(&at, corner, own) {
            let distance = separation - radius;
            out.points.push(Point::new(add_scaled(nearest, own, 0.5 * distance), own, distance, UNNAMED));
            return TriangleTest::Complete;
        }
        self.add_over(&beyond, out);
        if out.points.is_empty() && cos > 0.0 {
            return TriangleTest::LeftToNeighbour(Facing::new(pair, Separation { normal: own, separation, points: [nearest, centre] }));
        }
        TriangleTest::Complete
    }

    /// Distance of the ball's centre outside each edge, in the plane of the triangle, m; negative inside.
    fn beyond_edges(&self) -> V {
        let Facet { corners, normal, .. } = self.facet;
        std::array::from_fn(|k| {
            let edge = sub(corners[(k + 1) % 3], corners[k]);
            dot(cross(edge, *normal), sub(self.pair.pos, corners[k])) / norm(edge)
        })
    }

    /// Adds the contact along the normal of the triangle, if the ball's centre is above or below the triangle.
    ///
    /// `beyond` has the distance of the centre outside each edge, m. If the centre is behind the plane, it may be outside an edge by up to
    /// its depth times the edge's number in [`Facet::rises`].
    fn add_over(&self, beyond: &V, out: &mut Manifold) {
        let Self { facet, pair, height, max_distance } = *self;
        let (depth, radius, tolerance) = (-height, pair.b.radius(), pair.tolerance);
        let is_over = beyond.iter().all(|&x| x <= tolerance);
        let is_behind = || depth > 0.0 && beyond.iter().zip(facet.rises()).all(|(&x, rise)| x <= rise * depth);
        if height - radius <= max_distance && (is_over || is_behind()) {
            out.points.push(ball_over(facet.normal, pair.pos, height, radius));
        }
    }
}
