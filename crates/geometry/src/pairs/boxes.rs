//! Contacts of balls and capsules with a box.
//!
//! Let x(t) = p + t d be a point of a segment, and s the half sizes of the box. The closest point minimises f(t) = sum_i max(|x_i| - s_i,
//! 0)^2. The slope of this convex function is piecewise linear, with six kinks. Interpolation between two kinks therefore gives the exact
//! root of the slope.
//!
//! A segment that enters the box is moved out along the shortest translation. The candidates for its direction are the normals of the
//! Minkowski difference (separating axes; Ericson, 2005, section 5.2.1). These are normals of the box's faces, and cross products of the
//! box's edges with the segment.

use stepper_real::{Mask, Real, Scalar};

use crate::linear_algebra::*;
use crate::pairs::ContactPoint;
use crate::pairs::Segment;

/// Box in each lane.
#[derive(Clone, Copy, Debug)]
pub struct Cuboid<R> {
    /// Centre of the box, m.
    pub centre: V3<R>,
    /// Orientation of the box. The columns are its axes.
    pub mat: M3<R>,
    /// Half sizes of the box, m.
    pub half: V3<R>,
}

/// Closest points of a box and another shape without its rounding radius, in the box's frame.
struct Touch<R> {
    /// Point of the shape, without its rounding radius, that is closest to the box, m.
    x: V3<R>,
    /// Unit vector from the box to the shape.
    u: V3<R>,
    /// Signed distance along `u` of the box and the shape, without its rounding radius, m.
    gap: R,
}

impl<R: Real> Cuboid<R> {
    /// Position of the world point `point` in the frame of the box, m.
    #[inline(always)]
    fn inside(&self, point: V3<R>) -> V3<R> {
        rotate_back(&self.mat, sub(point, self.centre))
    }

    /// Vector from the closest point of the box to `x`, m; 0 if `x` is inside. The result and `x` are in the frame of the box.
    #[inline(always)]
    fn beyond(&self, x: V3<R>) -> V3<R> {
        array!(|i| x[i] - x[i].clamp(-self.half[i], self.half[i]))
    }

    /// Contact in the world frame. `touch` has the closest points without the rounding radius `radius` of the shape, m.
    #[inline(always)]
    fn contact(&self, touch: &Touch<R>, radius: R) -> ContactPoint<R> {
        let distance = touch.gap - radius;
        let pos = add_scaled(touch.x, touch.u, -(radius + distance * R::of(0.5)));
        ContactPoint { distance, pos: add(self.centre, rotate(&self.mat, pos)), normal: rotate(&self.mat, scale(touch.u, -R::one())) }
    }

    /// Point `x` and the face of the box that is closest to it. The point should be inside the box.
    #[inline(always)]
    fn nearest_face(&self, x: V3<R>) -> Touch<R> {
        let (mut gap, mut u) = (R::of(f64::NEG_INFINITY), zero());
        for i in 0..3 {
            let this = x[i].abs() - self.half[i];
            let nearer = this.gt(gap);
            gap = R::select(nearer, this, gap);
            u = select(nearer, unit(i, x[i]), u);
        }
        Touch { x, u, gap }
    }
}

/// Unit vector along axis `i` with the sign of `sign`.
#[inline(always)]
fn unit<R: Real>(i: usize, sign: R) -> V3<R> {
    let mut u = zero();
    u[i] = R::one().copysign(sign);
    u
}

/// Contact of a ball and a box. `centre` and `radius` are those of the ball, m.
#[inline(always)]
pub fn sphere_box<R: Real>(centre: V3<R>, radius: R, cuboid: &Cuboid<R>) -> ContactPoint<R> {
    let x = cuboid.inside(centre);
    let face = cuboid.nearest_face(x);
    let (u, length, outside) = direction(cuboid.beyond(x), face.u);
    cuboid.contact(&Touch { x, u, gap: R::select(outside, length, face.gap) }, radius)
}

/// Distance from a point above a face of a box to the border of the face, seen along the face's normal, m. It is 0 or negative if the point
/// is above no face.
#[inline(always)]
pub fn face_clearance<R: Real>(point: V3<R>, cuboid: &Cuboid<R>) -> R {
    let x = cuboid.inside(point);
    let [a, b, c] = [cuboid.half[0] - x[0].abs(), cuboid.half[1] - x[1].abs(), cuboid.half[2] - x[2].abs()];
    let (least, middle) = (a.min(b).min(c), a.min(b).max(a.max(b).min(c)));
    R::select(least.lt(R::zero()), middle, R::zero())
}

/// Contacts of a capsule and a box, ordered along the capsule, and the lanes in which each exists.
///
/// One contact is at the closest points. If the capsule is parallel to a face or edge, another contact is at the other end of the parallel
/// part.
#[inline(always)]
pub fn capsule_box<R: Real>(capsule: &Segment<R>, cuboid: &Cuboid<R>) -> ([ContactPoint<R>; 2], [R::Mask; 2]) {
    let line = Segment { centre: cuboid.inside(capsule.centre), axis: rotate_back(&cuboid.mat, capsule.axis), ..*capsule };
    let t = line.closest(cuboid);
    let x = line.at(t);
    let (u, length, _) = direction(cuboid.beyond(x), zero());
    let outside = length.gt(line.rounding(cuboid));
    let (mut t, mut near) = (t, Touch { x, u, gap: length });
    let enters = outside.not();
    if enters.any() {
        let (t_out, out) = line.way_out(cuboid);
        t = R::select(outside, t, t_out);
        near = Touch { x: line.at(t), u: select(outside, u, out.u), gap: R::select(outside, length, out.gap) };
    }
    let (t_far, far, two) = line.other_end(cuboid, t, &near, outside);
    let (first, second) = (cuboid.contact(&near, capsule.radius), cuboid.contact(&far, capsule.radius));
    let ascending = t.le(t_far);
    ([choose(ascending, &first, &second), choose(ascending, &second, &first)], [two.or(ascending), two.or(ascending.not())])
}

/// Contact `a` in the lanes of the mask, and `b` elsewhere.
#[inline(always)]
fn choose<R: Real>(lanes: R::Mask, a: &ContactPoint<R>, b: &ContactPoint<R>) -> ContactPoint<R> {
    ContactPoint {
        distance: R::select(lanes, a.distance, b.distance),
        pos: select(lanes, a.pos, b.pos),
        normal: select(lanes, a.normal, b.normal),
    }
}

/// Functions of a capsule in the frame of a box. Its axis consists of the points p + t d with |t| <= half_length, where p is the centre and
/// d the unit vector of the axis.
impl<R: Real> Segment<R> {
    /// Largest distance from the box that rounding can give a capsule's axis that just enters it, m.
    #[inline(always)]
    fn rounding(&self, cuboid: &Cuboid<R>) -> R {
        let [p, half] = [self.centre, cuboid.half];
        let sizes = p[0].abs() + p[1].abs() + p[2].abs() + (half[0].abs() + half[1].abs() + half[2].abs());
        (sizes + self.half_length) * R::splat(R::Scalar::EPSILON) * R::of(64.0)
    }

    /// Parameters at which the capsule's axis enters and leaves the slab of axis `k`: the points whose coordinate k is within the box.
    ///
    /// An axis parallel to the slab is inside for all parameters or for none.
    #[inline(always)]
    fn slab(&self, cuboid: &Cuboid<R>, k: usize) -> [R; 2] {
        let (p, d, s) = (self.centre[k], self.axis[k], cuboid.half[k]);
        let along = d.abs().lt(R::of(1e-12));
        let d = R::select(along, R::one(), d);
        let (a, b) = ((-s - p) / d, (s - p) / d);
        // A line along the border of a face counts as inside.
        let within = R::select(p.abs().le(s * R::of(1.0 + 1e-9)), R::of(f64::INFINITY), R::of(f64::NEG_INFINITY));
        [R::select(along, -within, a.min(b)), R::select(along, within, a.max(b))]
    }

    /// Half the derivative of the squared distance between box and capsule axis with respect to the parameter `t`, m.
    #[inline(always)]
    fn slope(&self, cuboid: &Cuboid<R>, t: R) -> R {
        dot(self.axis, cuboid.beyond(self.at(t)))
    }

    /// Parameter of the point of the capsule's axis that is closest to the box. If an interval is equally close, the result is one of its
    /// ends.
    #[inline(always)]
    fn closest(&self, cuboid: &Cuboid<R>) -> R {
        let (mut lo, mut hi) = (-self.half_length, self.half_length);
        let (mut below, mut above) = (self.slope(cuboid, lo), self.slope(cuboid, hi));
        let level = -self.rounding(cuboid);
        let (falls, rises) = (below.lt(level), above.ge(level));
        for k in 0..3 {
            for t in self.slab(cuboid, k) {
                let t = t.clamp(-self.half_length, self.half_length);
                let g = self.slope(cuboid, t);
                let left = g.lt(level);
                let (nearer_lo, nearer_hi) = (left.and(t.gt(lo)), t.lt(hi).and_not(left));
                lo = R::select(nearer_lo, t, lo);
                below = R::select(nearer_lo, g, below);
                hi = R::select(nearer_hi, t, hi);
                above = R::select(nearer_hi, g, above);
            }
        }
        let inner = falls.and(rises);
        let t = (lo - (hi - lo) * below / R::select(inner, above - below, R::one())).min(hi);
        R::select(inner, t, R::select(falls, self.half_length, -self.half_length))
    }

    /// Shortest translation of a capsule's axis out of the box, if it enters: parameter of the deepest point, and the closest points there.
    #[inline(always)]
    fn way_out(&self, cuboid: &Cuboid<R>) -> (R, Touch<R>) {
        let (mut gap, mut u, mut t) = (R::of(f64::NEG_INFINITY), zero(), R::zero());
        for i in 0..3 {
            let this = self.centre[i].abs() - self.axis[i].abs() * self.half_length - cuboid.half[i];
            let shorter = this.gt(gap);
            let out = unit(i, self.centre[i]);
            let ([a, b], [c, d]) = (self.slab(cuboid, (i + 1) % 3), self.slab(cuboid, (i + 2) % 3));
            let deepest = R::select(dot(out, self.axis).gt(R::zero()), a.max(c).max(-self.half_length), b.min(d).min(self.half_length));
            gap = R::select(shorter, this, gap);
            u = select(shorter, out, u);
            t = R::select(shorter, deepest, t);
        }
        for i in 0..3 {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            let mut axis = zero();
            (axis[j], axis[k]) = (self.axis[k], -self.axis[j]);
            let square = dot(axis, axis);
            let crossing = square.gt(R::of(1e-12));
            let square = R::select(crossing, square, R::one());
            let axis = scale(axis, R::one() / square.sqrt());
            let side = dot(self.centre, axis);
            let this = side.abs() - (cuboid.half[j] * axis[j].abs() + cuboid.half[k] * axis[k].abs());
            // A face is preferred to an edge of equal depth.
            let shorter = crossing.and((gap * R::of(1.0 - 1e-9)).lt(this));
            let out = scale(axis, R::one().copysign(side));
            let corner = |m: usize| cuboid.half[m].copysign(out[m]) - self.centre[m];
            let crossed = ((self.axis[j] * corner(j) + self.axis[k] * corner(k)) / square).clamp(-self.half_length, self.half_length);
            gap = R::select(shorter, this, gap);
            u = select(shorter, out, u);
            t = R::select(shorter, crossed, t);
        }
        (t, Touch { x: self.at(t), u, gap })
    }

    /// Other end of the part of a capsule's axis that runs along the same face or edge as the contact `near` at the parameter `t`.
    ///
    /// Returns the parameter and closest points of this end, and the lanes in which it exists. `outside` are the lanes in which the axis
    /// does not enter the box.
    #[inline(always)]
    fn other_end(&self, cuboid: &Cuboid<R>, t: R, near: &Touch<R>, outside: R::Mask) -> (R, Touch<R>, R::Mask) {
        let u = [near.u[0].abs(), near.u[1].abs(), near.u[2].abs()];
        let most = u[0].max(u[1]).max(u[2]);
        let (mut lo, mut hi) = (-self.half_length, self.half_length);
        let mut face = zero();
        let mut chosen = R::Mask::splat(false);
        for k in 0..3 {
            let faces = u[k].ge(most).and_not(chosen);
            chosen = chosen.or(faces);
            face = select(faces, unit(k, near.u[k]), face);
            // The line runs along the face within six degrees, or along the edge.
            let beside = u[k].le(R::of(0.1)).or(outside.not()).and_not(faces);
            let [a, b] = self.slab(cuboid, k);
            lo = R::select(beside, a.max(lo), lo);
            hi = R::select(beside, b.min(hi), hi);
        }
        let low = (t - lo).ge(hi - t);
        let t_far = R::select(low, lo, hi);
        let two = lo.lt(hi).and((t_far - t).abs().gt(self.half_length * R::of(1e-6)));
        let t_far = R::select(two, t_far, t);
        let x = self.at(t_far);
        let (out, length, _) = direction(cuboid.beyond(x), face);
        let depth = dot(face, x) - dot([face[0].abs(), face[1].abs(), face[2].abs()], cuboid.half);
        // If the shortest translation out of the box is across an edge, the other end counts only if it is not deeper.
        let two = two.and(outside.or(most.ge(R::one())).or(depth.ge(near.gap)));
        (t_far, Touch { x, u: select(outside, out, face), gap: R::select(outside, length, depth) }, two)
    }
}
