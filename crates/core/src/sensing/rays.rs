//! Rays against simple shapes, and points within them.
//!
//! Each shape's surface is made of pieces whose intersections with the line are roots of linear or quadratic equations; of those that are
//! on their piece and not behind the ray's beginning, the nearest counts. A ray that begins inside hits where it leaves.

use stepper_real::{Mask, Real};

use crate::compile::LaneModel;
use crate::compile::sensing::{Form, SensorFrame, Solid};
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;
use crate::model::RayField;
use crate::sensing::frames::{orientation, position};

/// Distance to a shape along a unit direction, both in the shape's frame; infinite where it is not hit.
pub(super) fn ray<R: Real>(form: Form, size: V3<R>, o: V3<R>, d: V3<R>) -> R {
    R::vectorize(
        #[inline(always)]
        || match form {
            Form::Plane => plane(o, d),
            Form::Sphere => nearest_root(dot(d, d), dot(o, d), dot(o, o) - size[0].square(), |_| R::Mask::splat(true)),
            Form::Ellipsoid => {
                let inverse = size.map(R::recip);
                let (o, d): (V3<R>, V3<R>) = (std::array::from_fn(|k| o[k] * inverse[k]), std::array::from_fn(|k| d[k] * inverse[k]));
                nearest_root(dot(d, d), dot(o, d), dot(o, o) - R::one(), |_| R::Mask::splat(true))
            }
            Form::Capsule => capsule(size, o, d),
            Form::Cylinder => cylinder(size, o, d),
            Form::Box => cuboid(size, o, d),
        },
    )
}

#[inline(always)]
fn nothing<R: Real>() -> R {
    R::of(f64::INFINITY)
}

/// The smallest root t >= 0 of a t^2 + 2 b t + c on the piece.
#[inline(always)]
fn nearest_root<R: Real>(a: R, b: R, c: R, on_piece: impl Fn(R) -> R::Mask) -> R {
    let z = R::zero();
    let discriminant = b * b - a * c;
    let real = discriminant.ge(z).and(a.gt(z));
    let root = R::select(real, discriminant, z).sqrt();
    let inverse = R::one() / R::select(real, a, R::one());
    let (near, far) = ((-b - root) * inverse, (root - b) * inverse);
    let hits = |t: R| real.and(t.ge(z)).and(on_piece(t));
    R::select(hits(near), near, R::select(hits(far), far, nothing()))
}

/// Where the line meets the plane of constant coordinate k, if that is on the piece.
#[inline(always)]
fn flat<R: Real>(o: V3<R>, d: V3<R>, k: usize, level: R, on_piece: impl Fn(V3<R>) -> R::Mask) -> R {
    let z = R::zero();
    let crosses = d[k].abs().gt(z);
    let t = (level - o[k]) / R::select(crosses, d[k], R::one());
    R::select(crosses.and(t.ge(z)).and(on_piece(add_scaled(o, d, t))), t, nothing())
}

/// The front of the plane only, without end.
#[inline(always)]
fn plane<R: Real>(o: V3<R>, d: V3<R>) -> R {
    let hit = flat(o, d, 2, R::zero(), |_| R::Mask::splat(true));
    R::select(d[2].lt(R::zero()), hit, nothing())
}

#[inline(always)]
fn capsule<R: Real>(size: V3<R>, o: V3<R>, d: V3<R>) -> R {
    let [radius, half, _] = size;
    let mut t = wall(size, o, d);
    for end in [half, -half] {
        let from = [o[0], o[1], o[2] - end];
        // Beyond the end of the segment.
        let outer = |t: R| ((o[2] + d[2] * t) * R::one().copysign(end)).ge(half);
        t = t.min(nearest_root(dot(d, d), dot(from, d), dot(from, from) - radius.square(), outer));
    }
    t
}

/// The side of a cylinder.
#[inline(always)]
fn wall<R: Real>([radius, half, _]: V3<R>, o: V3<R>, d: V3<R>) -> R {
    let (a, b, c) = (d[0] * d[0] + d[1] * d[1], o[0] * d[0] + o[1] * d[1], o[0] * o[0] + o[1] * o[1] - radius.square());
    nearest_root(a, b, c, |t| (o[2] + d[2] * t).abs().le(half))
}

#[inline(always)]
fn cylinder<R: Real>(size: V3<R>, o: V3<R>, d: V3<R>) -> R {
    let disc = |p: V3<R>| (p[0] * p[0] + p[1] * p[1]).le(size[0].square());
    wall(size, o, d).min(flat(o, d, 2, size[1], disc)).min(flat(o, d, 2, -size[1], disc))
}

#[inline(always)]
fn cuboid<R: Real>(half: V3<R>, o: V3<R>, d: V3<R>) -> R {
    let mut t = nothing();
    for k in 0..3 {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let face = |p: V3<R>| p[i].abs().le(half[i]).and(p[j].abs().le(half[j]));
        t = flat(o, d, k, half[k], face).min(flat(o, d, k, -half[k], face)).min(t);
    }
    t
}

/// Lanes in which a point, in the shape's frame, is inside.
pub(super) fn holds<R: Real>(form: Form, size: V3<R>, p: V3<R>) -> R::Mask {
    R::vectorize(
        #[inline(always)]
        || {
            let across = p[0] * p[0] + p[1] * p[1];
            match form {
                Form::Plane => p[2].le(R::zero()),
                Form::Sphere => dot(p, p).lt(size[0].square()),
                Form::Capsule => {
                    let beyond = (p[2].abs() - size[1]).max(R::zero());
                    (across + beyond.square()).lt(size[0].square())
                }
                Form::Cylinder => across.lt(size[0].square()).and(p[2].abs().lt(size[1])),
                Form::Ellipsoid => {
                    let u: V3<R> = std::array::from_fn(|k| p[k] / size[k]);
                    dot(u, u).lt(R::one())
                }
                Form::Box => p[0].abs().lt(size[0]).and(p[1].abs().lt(size[1])).and(p[2].abs().lt(size[2])),
            }
        },
    )
}

/// Whether the origin of a place is inside a volume: 1 or 0.
pub fn inside<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, place: &SensorFrame<R::Scalar>, zone: &Solid<R::Scalar>) -> R {
    R::vectorize(
        #[inline(always)]
        || {
            let offset = sub(position(compiled, kinematics, place), position(compiled, kinematics, &zone.place));
            let local = rotate_back(&orientation(kinematics, &zone.place), offset);
            R::select(holds(zone.form, compiled.params.size(zone.index), local), R::one(), R::zero())
        },
    )
}

/// Readings of a range finder.
pub fn range<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    place: &SensorFrame<R::Scalar>,
    rays: &[[R::Scalar; 3]],
    fields: &[RayField],
    solids: &[Solid<R::Scalar>],
    out: &mut [R],
) {
    R::vectorize(
        #[inline(always)]
        || {
            let (origin, axes) = (position(compiled, kinematics, place), orientation(kinematics, place));
            let mut at = 0;
            for &direction in rays {
                let direction = rotate(&axes, splat(direction));
                let mut t = nothing::<R>();
                for solid in solids {
                    let (centre, mat) = (position(compiled, kinematics, &solid.place), orientation(kinematics, &solid.place));
                    let (o, d) = (rotate_back(&mat, sub(origin, centre)), rotate_back(&mat, direction));
                    t = t.min(ray(solid.form, compiled.params.size(solid.index), o, d));
                }
                let hit = t.lt(nothing());
                let reach = R::select(hit, t, R::zero());
                for &field in fields {
                    let x = match field {
                        RayField::Distance => [R::select(hit, t, -R::one()), R::zero(), R::zero()],
                        RayField::Direction => select(hit, direction, zero()),
                        RayField::Origin => origin,
                        RayField::Point => select(hit, add_scaled(origin, direction, reach), zero()),
                    };
                    out[at..at + field.dim()].copy_from_slice(&x[..field.dim()]);
                    at += field.dim();
                }
            }
        },
    )
}
