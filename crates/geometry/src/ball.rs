//! A ball on a triangle of a surface, in closed form: the points that the search of other shapes finds.

use crate::facet::{Facet, Outline, PARALLEL};
use crate::facing::{ALIKE, Facing, Separation};
use crate::linear_algebra::*;
use crate::manifold::{LONE, Manifold, Point};
use crate::pair::Pair;
use crate::round::{CLOSE, nearest_of_triangle};
use crate::separation::{BESIDE, NEAR_FACE};
use crate::vectors::V;

/// A ball over a triangle.
pub(super) struct Ball<'a> {
    pub(super) facet: &'a Facet,
    /// The triangle and the ball.
    pub(super) pair: &'a Pair<'a>,
    /// Distance of the ball's centre from the plane of the triangle, m.
    pub(super) height: f64,
    pub(super) radius: f64,
    /// Distance beyond which nothing is a contact, m.
    pub(super) prediction: f64,
}

/// Result of the test of a shape with a triangle.
pub(super) enum Touch {
    /// Its points, or none.
    Found,
    /// No point: the nearest one is left to a neighbour.
    Left(Facing),
    /// Unclear.
    Unknown,
}

/// Point of a ball that is over a triangle, at a height of its centre, m.
pub(super) fn ball_over(normal: V, centre: V, height: f64, radius: f64) -> Point {
    Point {
        pos: add_scaled(centre, normal, -0.5 * (height + radius)),
        normal,
        distance: height - radius,
        feature: 0,
        stays_over_face: false,
    }
}

impl Ball<'_> {
    /// Adds the point of the ball and the triangle to `out`. `holds` tells of a height field whether a point is below it; `is_nearest`
    /// whether no neighbour at a part of the triangle, which has a point, is nearer in a direction.
    pub(super) fn touch(
        &self,
        holds: Option<impl Fn(V) -> bool>,
        is_nearest: impl FnOnce(&Outline, V, V) -> bool,
        out: &mut Manifold,
    ) -> Touch {
        let Self { facet, pair, height, radius, prediction } = *self;
        let (normal, centre) = (facet.normal, pair.pos);
        let beyond = self.beyond_edges();
        let behind = dot(normal, pair.apart) <= 0.0;
        if behind {
            let Some(holds) = holds else { return if height <= 0.0 { Touch::Found } else { Touch::Unknown } };
            self.add_over(&beyond, out);
            if !holds(centre) {
                out.points.retain(|p| p.distance >= 0.0 || holds(add_scaled(p.pos, p.normal, 0.5 * p.distance)));
            }
            return Touch::Found;
        }
        if facet.bulges == [false; 3] || beyond.iter().all(|&x| x <= 0.0) {
            self.add_over(&beyond, out);
            return Touch::Found;
        }
        let nearest = nearest_of_triangle(&facet.corners, centre);
        let apart = sub(centre, nearest);
        let separation = norm(apart);
        if separation - radius > prediction {
            return Touch::Found;
        }
        if separation <= CLOSE * pair.size {
            return Touch::Unknown;
        }
        let own = scale(apart, 1.0 / separation);
        let cos = dot(own, normal);
        let beside = norm(add_scaled(apart, normal, -dot(apart, normal)));
        let is_face =
            cos > 0.0 && 1.0 - cos < NEAR_FACE * NEAR_FACE && height >= separation - ALIKE * pair.size && beside <= BESIDE * pair.size;
        if is_face || 1.0 - cos <= PARALLEL {
            self.add_over(&beyond, out);
            return Touch::Found;
        }
        let own = own.map(|x| x + 0.0);
        let (at, corner) = facet.furthest(own);
        if cos > 0.0 && !matches!(at, Outline::Inside) && is_nearest(&at, corner, own) {
            let distance = separation - radius;
            out.points.push(Point {
                pos: add_scaled(nearest, own, 0.5 * distance),
                normal: own,
                distance,
                feature: LONE,
                stays_over_face: false,
            });
            return Touch::Found;
        }
        self.add_over(&beyond, out);
        if out.points.is_empty() && cos > 0.0 {
            return Touch::Left(Facing::new(pair, Separation { normal: own, separation, points: [nearest, centre] }));
        }
        Touch::Found
    }

    /// Distance of the centre beyond each edge, along the plane of the triangle, m.
    fn beyond_edges(&self) -> V {
        let Facet { corners, normal, .. } = self.facet;
        std::array::from_fn(|k| {
            let edge = sub(corners[(k + 1) % 3], corners[k]);
            dot(cross(edge, *normal), sub(self.pair.pos, corners[k])) / norm(edge)
        })
    }

    /// Adds the point along the normal of the triangle if the centre is over the triangle.
    ///
    /// A centre behind the plane of the triangle may also be outside an edge, by at most its depth times the edge's number in
    /// [`Facet::rises`].
    fn add_over(&self, beyond: &V, out: &mut Manifold) {
        let Self { facet, pair, height, radius, prediction, .. } = *self;
        let (depth, tolerance) = (-height, pair.tolerance);
        let is_over = beyond.iter().all(|&x| x <= tolerance);
        let is_behind = || depth > 0.0 && beyond.iter().zip(facet.rises()).all(|(&x, rise)| x <= rise * depth);
        if height - radius <= prediction && (is_over || is_behind()) {
            out.points.push(ball_over(facet.normal, pair.pos, height, radius));
        }
    }
}
