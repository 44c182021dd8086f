//! Intersections of rays with shapes, and tests whether points are inside simple shapes.
//!
//! The surface of a simple shape consists of parts of planes and quadrics, whose intersections with a line are roots of linear or quadratic
//! equations. The result is the nearest root whose point is on the part of the surface, and not behind the ray's origin. A ray that begins
//! inside hits the point where it leaves. For meshes and height fields, the rays are cast lane by lane.

use stepper_geometry::{Pose, RaySurface};
use stepper_real::{Mask, Real, Scalar, kernel};

use crate::compile::LaneModel;
use crate::compile::sensing::{Form, SensorFrame, Solid, Target, TargetForm};
use crate::dynamics::kinematics::Kinematics;
use crate::math::lanes::each_of;
use crate::math::spatial::*;
use crate::model::RayField;
use crate::sensing::SensorView;

/// Distance from the origin `o` to a simple shape along the unit direction `d`, both in the shape's frame, m. Infinite without a hit.
pub(super) fn ray<R: Real>(form: Form, size: V3<R>, o: V3<R>, d: V3<R>) -> R {
    kernel!(R, || match form {
        Form::Plane => plane(o, d),
        Form::Sphere => Roots::new(dot(d, d), dot(o, d), dot(o, o) - size[0].square()).nearest([R::Mask::splat(true); 2]),
        Form::Ellipsoid => {
            let inverse = [size[0].recip(), size[1].recip(), size[2].recip()];
            let (o, d) = (times(o, inverse), times(d, inverse));
            Roots::new(dot(d, d), dot(o, d), dot(o, o) - R::one()).nearest([R::Mask::splat(true); 2])
        }
        Form::Capsule => capsule(size, o, d),
        Form::Cylinder => cylinder(size, o, d),
        Form::Box => cuboid(size, o, d),
    })
}

#[inline(always)]
fn nothing<R: Real>() -> R {
    R::of(f64::INFINITY)
}

/// Intersections of a line with a quadric: the two roots t of a t^2 + 2 b t + c, ascending.
///
/// The caller tests whether the two points are on the part of the quadric that belongs to the shape. It passes the results to
/// [`Roots::nearest`] as masks. A closure for the test would be slow, because the compiler does not inline a closure that is called twice.
struct Roots<R: Real> {
    /// Lanes in which the roots are real, and a is positive.
    real: R::Mask,
    at: [R; 2],
}

impl<R: Real> Roots<R> {
    #[inline(always)]
    fn new(a: R, b: R, c: R) -> Self {
        let z = R::zero();
        let discriminant = b * b - a * c;
        let real = discriminant.ge(z).and(a.gt(z));
        let root = R::select(real, discriminant, z).sqrt();
        let inverse = R::one() / R::select(real, a, R::one());
        Self { real, at: [(-b - root) * inverse, (root - b) * inverse] }
    }

    /// Smallest root that is on the surface and not behind the ray's origin; infinite if there is none. `on_piece` has the lanes in which
    /// each root is on the surface.
    #[inline(always)]
    fn nearest(&self, on_piece: [R::Mask; 2]) -> R {
        let ([near, far], z) = (self.at, R::zero());
        let near_hits = self.real.and(near.ge(z)).and(on_piece[0]);
        let far_hits = self.real.and(far.ge(z)).and(on_piece[1]);
        R::select(near_hits, near, R::select(far_hits, far, nothing()))
    }
}

/// Distance along the ray to the plane on which coordinate `k` equals `level`, m. Also returns the lanes in which the plane is not behind
/// the origin of the ray. `o` is this origin, and `d` the direction.
#[inline(always)]
fn crossing<R: Real>(o: V3<R>, d: V3<R>, k: usize, level: R) -> (R, R::Mask) {
    let z = R::zero();
    let crosses = d[k].abs().gt(z);
    let t = (level - o[k]) / R::select(crosses, d[k], R::one());
    (t, crosses.and(t.ge(z)))
}

/// Distance along the ray to the front side of the infinite plane z = 0, m. `o` is the origin of the ray, and `d` its direction.
#[inline(always)]
fn plane<R: Real>(o: V3<R>, d: V3<R>) -> R {
    let (t, hits) = crossing(o, d, 2, R::zero());
    R::select(hits.and(d[2].lt(R::zero())), t, nothing())
}

#[inline(always)]
fn capsule<R: Real>(size: V3<R>, o: V3<R>, d: V3<R>) -> R {
    let [radius, half, _] = size;
    let mut t = wall(size, o, d);
    for end in [half, -half] {
        let from = [o[0], o[1], o[2] - end];
        let roots = Roots::new(dot(d, d), dot(from, d), dot(from, from) - radius.square());
        // Points beyond the end of the capsule's segment.
        let side = R::one().copysign(end);
        let [near, far] = roots.at;
        t = t.min(roots.nearest([((o[2] + d[2] * near) * side).ge(half), ((o[2] + d[2] * far) * side).ge(half)]));
    }
    t
}

/// Distance along the ray to the curved side of a cylinder, m. `o` is the origin of the ray and `d` its direction, both in the cylinder's
/// frame.
#[inline(always)]
fn wall<R: Real>([radius, half, _]: V3<R>, o: V3<R>, d: V3<R>) -> R {
    let (a, b, c) = (d[0] * d[0] + d[1] * d[1], o[0] * d[0] + o[1] * d[1], o[0] * o[0] + o[1] * o[1] - radius.square());
    let roots = Roots::new(a, b, c);
    let [near, far] = roots.at;
    roots.nearest([(o[2] + d[2] * near).abs().le(half), (o[2] + d[2] * far).abs().le(half)])
}

#[inline(always)]
fn cylinder<R: Real>(size: V3<R>, o: V3<R>, d: V3<R>) -> R {
    let mut t = wall(size, o, d);
    for level in [size[1], -size[1]] {
        let (end, hits) = crossing(o, d, 2, level);
        let p = add_scaled(o, d, end);
        t = t.min(R::select(hits.and((p[0] * p[0] + p[1] * p[1]).le(size[0].square())), end, nothing()));
    }
    t
}

#[inline(always)]
fn cuboid<R: Real>(half: V3<R>, o: V3<R>, d: V3<R>) -> R {
    let mut t = nothing::<R>();
    for k in 0..3 {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        for level in [half[k], -half[k]] {
            let (side, hits) = crossing(o, d, k, level);
            let p = add_scaled(o, d, side);
            t = t.min(R::select(hits.and(p[i].abs().le(half[i])).and(p[j].abs().le(half[j])), side, nothing()));
        }
    }
    t
}

/// Lanes in which the point `p`, in the shape's frame, is inside the shape.
#[inline(always)]
pub(super) fn holds<R: Real>(form: Form, size: V3<R>, p: V3<R>) -> R::Mask {
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
}

/// Geom that rays can hit, with its pose in each lane.
pub(crate) struct Placed<'a, R: Real> {
    centre: V3<R>,
    mat: M3<R>,
    form: &'a TargetForm,
}

impl<'a, R: Real> Placed<'a, R> {
    /// Places the geom `target` at its pose in `kinematics`.
    #[inline(always)]
    pub(crate) fn new(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, target: &'a Target<R::Scalar>) -> Self {
        let place = &target.place;
        let centre = kinematics.point(place.frame, compiled.params.place(place.index));
        Self { centre, mat: mat_mul(&kinematics.mat[place.frame], &splat(place.mat)), form: &target.form }
    }

    /// Distance from `origin` along the unit vector `direction` to the geom, in the lanes `lanes` (bits), m. Both are in the world frame.
    ///
    /// Infinite without a hit. Beyond `within`, the result may be infinite despite a hit.
    #[inline(always)]
    pub(crate) fn distance(&self, compiled: &LaneModel<R>, lanes: u32, origin: V3<R>, direction: V3<R>, within: R) -> R {
        match self.form {
            TargetForm::Simple(form, index) => {
                let (o, d) = (rotate_back(&self.mat, sub(origin, self.centre)), rotate_back(&self.mat, direction));
                ray(*form, compiled.params.size(*index), o, d)
            }
            TargetForm::Surface(surface) => {
                let lanes = lanes & self.may_meet(surface, origin, direction, within).bits();
                if lanes == 0 { nothing() } else { self.to_surface(surface, lanes, origin, direction) }
            }
        }
    }

    /// Lanes in which a ray meets the bounding ball of a surface at a distance up to `within`, m, with an allowance for rounding.
    #[inline(always)]
    fn may_meet(&self, surface: &RaySurface, origin: V3<R>, direction: V3<R>, within: R) -> R::Mask {
        let (centre, radius) = surface.ball();
        let offset = sub(add(self.centre, rotate(&self.mat, centre.map(R::of))), origin);
        let (along, square) = (dot(offset, direction), dot(offset, offset));
        // Rounding error of positions, squares and the direction's length: some units in the last place.
        let rounding = R::splat(<R::Scalar as Scalar>::EPSILON) * R::of(32.0);
        let reach = R::of(radius) + rounding * (R::of(radius) + norm(origin) + norm(self.centre));
        let beside = (square - along * along).gt(reach * reach + rounding * square);
        let behind = along.lt(-reach).or((along - reach).gt(within));
        R::Mask::splat(true).and_not(beside.or(behind))
    }

    /// Distance along the ray to a mesh or height field. It is computed lane by lane, so that no lane depends on another.
    #[inline(never)]
    fn to_surface(&self, surface: &RaySurface, lanes: u32, origin: V3<R>, direction: V3<R>) -> R {
        let mut t = nothing::<R>();
        for lane in each_of(lanes) {
            let (pos, mat) = (of_lane(&self.centre, lane), of_lane(&self.mat, lane));
            let pose = Pose::of_scalar::<R::Scalar>(pos, mat);
            t.set_lane(lane, Scalar::from_f64(surface.distance(&pose, of_lane(&origin, lane), of_lane(&direction, lane))));
        }
        t
    }
}

/// Distance along the unit vector `direction` to the nearest geom, m, and the number that `placed` pairs with this geom. Both are -1
/// without a hit. If two geoms have the same distance, the first in the list is returned.
pub(crate) fn nearest<R: Real>(
    compiled: &LaneModel<R>,
    placed: &[(usize, Placed<'_, R>)],
    lanes: u32,
    origin: V3<R>,
    direction: V3<R>,
) -> (R, R) {
    kernel!(R, || {
        let (mut nearest, mut which) = (nothing::<R>(), -R::one());
        for (geom, target) in placed {
            let t = target.distance(compiled, lanes, origin, direction, nearest);
            let nearer = t.lt(nearest);
            nearest = R::select(nearer, t, nearest);
            which = R::select(nearer, R::of(*geom as f64), which);
        }
        (R::select(nearest.lt(nothing()), nearest, -R::one()), which)
    })
}

impl<R: Real> SensorView<'_, R> {
    /// 1 in the lanes in which the origin of a sensor frame is inside a volume, otherwise 0.
    pub fn inside(&self, place: &SensorFrame<R::Scalar>, zone: &Solid<R::Scalar>) -> R {
        kernel!(R, || {
            let offset = sub(self.position(place), self.position(&zone.place));
            let local = rotate_back(&self.orientation(&zone.place), offset);
            R::select(holds(zone.form, self.compiled.params.size(zone.index), local), R::one(), R::zero())
        })
    }

    /// Writes the readings of a rangefinder to `out`: the values of `fields` for every ray.
    pub fn range(
        &self,
        place: &SensorFrame<R::Scalar>,
        rays: &[[R::Scalar; 3]],
        fields: &[RayField],
        targets: &[Target<R::Scalar>],
        out: &mut [R],
    ) {
        let every = (u64::MAX >> (64 - R::LANES)) as u32;
        kernel!(R, || {
            let (origin, axes) = (self.position(place), self.orientation(place));
            let mut at = 0;
            for &direction in rays {
                let direction = rotate(&axes, splat(direction));
                let mut t = nothing::<R>();
                for target in targets {
                    t = t.min(Placed::new(self.compiled, self.kinematics, target).distance(self.compiled, every, origin, direction, t));
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
        })
    }
}
