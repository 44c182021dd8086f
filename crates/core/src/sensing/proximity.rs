//! Closest points of two shapes: of a plane and any simple shape, or of two shapes that are balls or capsules.

use stepper_geometry::pairs::{Segment, segments};
use stepper_real::{Mask, Real, kernel};

use crate::compile::sensing::{Form, Pair, Solid};
use crate::math::spatial::*;
use crate::model::ProximityReading;
use crate::sensing::SensorView;

/// Signed distance of two shapes, and their closest points.
#[derive(Clone, Copy)]
struct Nearest<R> {
    distance: R,
    points: [V3<R>; 2],
    normal: V3<R>,
}

/// Support point of a shape in the unit direction `d`: the farthest point of the shape. Both are in the shape's frame.
#[inline(always)]
fn support<R: Real>(form: Form, size: V3<R>, d: V3<R>) -> V3<R> {
    let ball = scale(d, size[0]);
    let end = size[1].copysign(d[2]);
    match form {
        Form::Plane | Form::Sphere => ball,
        Form::Capsule => [ball[0], ball[1], ball[2] + end],
        Form::Cylinder => {
            let across = (d[0] * d[0] + d[1] * d[1]).sqrt();
            let upright = across.gt(R::zero());
            let k = R::select(upright, size[0] / R::select(upright, across, R::one()), R::zero());
            [d[0] * k, d[1] * k, end]
        }
        Form::Ellipsoid => {
            let scaled: V3<R> = std::array::from_fn(|k| size[k] * d[k]);
            let k = norm(scaled).recip();
            std::array::from_fn(|i| size[i] * scaled[i] * k)
        }
        Form::Box => std::array::from_fn(|k| size[k].copysign(d[k])),
    }
}

impl<R: Real> SensorView<'_, R> {
    /// Writes the reading of a proximity sensor to `out`: distance, normal or closest points of the closest pair in `pairs`.
    ///
    /// If no pair is closer than `cutoff`, m, the distance is the cutoff.
    pub fn proximity(&self, what: ProximityReading, pairs: &[Pair<R::Scalar>], cutoff: R, out: &mut [R]) {
        kernel!(R, || {
            let mut best = Nearest { distance: R::of(f64::INFINITY), points: [zero(); 2], normal: zero() };
            for (a, b) in pairs {
                let new = self.between(a, b);
                let nearer = new.distance.lt(best.distance);
                best.distance = R::select(nearer, new.distance, best.distance);
                best.points = [select(nearer, new.points[0], best.points[0]), select(nearer, new.points[1], best.points[1])];
                best.normal = select(nearer, new.normal, best.normal);
            }
            let within = best.distance.lt(cutoff);
            match what {
                ProximityReading::Distance => out[0] = R::select(within, best.distance, cutoff),
                ProximityReading::Normal => {
                    let towards = scale(best.normal, R::one().copysign(best.distance));
                    out.copy_from_slice(&select(within, towards, zero()));
                }
                ProximityReading::FromTo => {
                    out[..3].copy_from_slice(&select(within, best.points[0], zero()));
                    out[3..].copy_from_slice(&select(within, best.points[1], zero()));
                }
            }
        })
    }

    #[inline(always)]
    fn between(&self, a: &Solid<R::Scalar>, b: &Solid<R::Scalar>) -> Nearest<R> {
        if a.form == Form::Plane {
            return self.nearest_to_plane(a, b);
        }
        if b.form == Form::Plane {
            let turned = self.nearest_to_plane(b, a);
            let [p, q] = turned.points;
            return Nearest { points: [q, p], normal: scale(turned.normal, -R::one()), ..turned };
        }
        let segment = |s: &Solid<R::Scalar>| {
            let [radius, half_length, _] = self.compiled.params.size(s.index);
            let axis = column(&self.orientation(&s.place), 2);
            Segment { centre: self.position(&s.place), axis, half_length, radius }
        };
        let ([first, second], two) = segments(&segment(a), &segment(b));
        // For parallel capsules both ends have the same distance up to rounding. The smaller one is used.
        let swap = two.and(second.distance.lt(first.distance));
        let distance = R::select(swap, second.distance, first.distance);
        let (pos, normal) = (select(swap, second.pos, first.pos), select(swap, second.normal, first.normal));
        let half = distance * R::of(0.5);
        Nearest { distance, points: [add_scaled(pos, normal, -half), add_scaled(pos, normal, half)], normal }
    }

    /// Closest points of a plane and a shape: the shape's deepest point, and its projection on the plane.
    #[inline(always)]
    fn nearest_to_plane(&self, plane: &Solid<R::Scalar>, solid: &Solid<R::Scalar>) -> Nearest<R> {
        let normal = column(&self.orientation(&plane.place), 2);
        let mat = self.orientation(&solid.place);
        let down = rotate_back(&mat, scale(normal, -R::one()));
        let deepest = support(solid.form, self.compiled.params.size(solid.index), down);
        let point = add(self.position(&solid.place), rotate(&mat, deepest));
        let distance = dot(normal, sub(point, self.position(&plane.place)));
        Nearest { distance, points: [add_scaled(point, normal, -distance), point], normal }
    }
}
