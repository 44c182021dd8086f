//! Balls and capsules against a box.
//!
//! The closest point of a segment x(t) = p + t d to a box is the least of f(t) = sum_i (|x_i| - s_i)+^2, which is convex with a piecewise
//! linear slope: between two neighbours of its six corners the root of the slope is exact. A segment that enters the box leaves it by the
//! shortest way among the directions of faces and of edges crossed with the segment: these are the faces of the Minkowski difference
//! (separating axes; Ericson 2005, section 5.2.1).

use stepper_real::{Mask, Real, Scalar};

use crate::linear_algebra::*;
use crate::pairs::ContactPoint;
use crate::pairs::Segment;

/// A box.
#[derive(Clone, Copy, Debug)]
pub struct Cuboid<R> {
    /// Centre, m.
    pub centre: V3<R>,
    /// Its axes are the columns.
    pub mat: M3<R>,
    /// Half sizes, m.
    pub half: V3<R>,
}

/// Where a body with a core and a radius about it touches the box, in the box's frame: `x` on the core, the direction `u` out of the box,
/// and the gap between core and box along it.
struct Touch<R> {
    x: V3<R>,
    u: V3<R>,
    gap: R,
}

impl<R: Real> Cuboid<R> {
    #[inline(always)]
    fn inside(&self, point: V3<R>) -> V3<R> {
        rotate_back(&self.mat, sub(point, self.centre))
    }

    /// From the nearest point of the box to `x`: zero inside.
    #[inline(always)]
    fn beyond(&self, x: V3<R>) -> V3<R> {
        array_of(
            #[inline(always)]
            |i| x[i] - x[i].clamp(-self.half[i], self.half[i]),
        )
    }

    #[inline(always)]
    fn contact(&self, touch: &Touch<R>, radius: R) -> ContactPoint<R> {
        let distance = touch.gap - radius;
        let pos = add_scaled(touch.x, touch.u, -(radius + distance * R::of(0.5)));
        ContactPoint { distance, pos: add(self.centre, rotate(&self.mat, pos)), normal: rotate(&self.mat, scale(touch.u, -R::one())) }
    }

    /// The shortest way for the point `x` out of the box.
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

/// Axis `i` with the sign of `sign`.
#[inline(always)]
fn unit<R: Real>(i: usize, sign: R) -> V3<R> {
    let mut u = zero();
    u[i] = R::one().copysign(sign);
    u
}

/// `v` made a unit vector, with its length; `instead` where it has none.
#[inline(always)]
fn direction<R: Real>(v: V3<R>, instead: V3<R>) -> (V3<R>, R, R::Mask) {
    let length = norm(v);
    let some = length.gt(R::zero());
    (select(some, scale(v, R::one() / R::select(some, length, R::one())), instead), length, some)
}

/// A ball and a box.
#[inline(always)]
pub fn sphere_box<R: Real>(centre: V3<R>, radius: R, cuboid: &Cuboid<R>) -> ContactPoint<R> {
    let x = cuboid.inside(centre);
    let face = cuboid.nearest_face(x);
    let (u, length, outside) = direction(cuboid.beyond(x), face.u);
    cuboid.contact(&Touch { x, u, gap: R::select(outside, length, face.gap) }, radius)
}

/// Distance of a point from the border of the face of a box that it is over, m. Not positive if it is over none.
#[inline(always)]
pub fn face_clearance<R: Real>(point: V3<R>, cuboid: &Cuboid<R>) -> R {
    let x = cuboid.inside(point);
    let [a, b, c] = [cuboid.half[0] - x[0].abs(), cuboid.half[1] - x[1].abs(), cuboid.half[2] - x[2].abs()];
    let (least, middle) = (a.min(b).min(c), a.min(b).max(a.max(b).min(c)));
    R::select(least.lt(R::zero()), middle, R::zero())
}

/// A capsule and a box: the contact at their closest points, and where the capsule runs along a face or an edge, the contact at the other
/// end of the stretch that does. Ordered along the capsule; the masks say where each exists.
#[inline(always)]
pub fn capsule_box<R: Real>(capsule: &Segment<R>, cuboid: &Cuboid<R>) -> ([ContactPoint<R>; 2], [R::Mask; 2]) {
    let line = Line { p: cuboid.inside(capsule.centre), d: rotate_back(&cuboid.mat, capsule.axis), half: capsule.half_length };
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

/// `a` in the lanes `lanes`, elsewhere `b`.
#[inline(always)]
fn choose<R: Real>(lanes: R::Mask, a: &ContactPoint<R>, b: &ContactPoint<R>) -> ContactPoint<R> {
    ContactPoint {
        distance: R::select(lanes, a.distance, b.distance),
        pos: select(lanes, a.pos, b.pos),
        normal: select(lanes, a.normal, b.normal),
    }
}

/// The core of a capsule in the box's frame: p + t d with |t| <= half.
struct Line<R> {
    p: V3<R>,
    d: V3<R>,
    half: R,
}

impl<R: Real> Line<R> {
    #[inline(always)]
    fn at(&self, t: R) -> V3<R> {
        add_scaled(self.p, self.d, t)
    }

    /// A gap that rounding can make where the line just enters the box, m.
    #[inline(always)]
    fn rounding(&self, cuboid: &Cuboid<R>) -> R {
        let [p, half] = [self.p, cuboid.half];
        let sizes = p[0].abs() + p[1].abs() + p[2].abs() + (half[0].abs() + half[1].abs() + half[2].abs());
        (sizes + self.half) * R::splat(R::Scalar::EPSILON) * R::of(64.0)
    }

    /// Parameters at which the line enters and leaves the slab of axis `k`. A line parallel to the slab is inside for all parameters or for
    /// none.
    #[inline(always)]
    fn slab(&self, cuboid: &Cuboid<R>, k: usize) -> [R; 2] {
        let (p, d, s) = (self.p[k], self.d[k], cuboid.half[k]);
        let along = d.abs().lt(R::of(1e-12));
        let d = R::select(along, R::one(), d);
        let (a, b) = ((-s - p) / d, (s - p) / d);
        // A hair of tolerance for a line along the border of a face.
        let within = R::select(p.abs().le(s * R::of(1.0 + 1e-9)), R::of(f64::INFINITY), R::of(f64::NEG_INFINITY));
        [R::select(along, -within, a.min(b)), R::select(along, within, a.max(b))]
    }

    /// Half the slope of f at t.
    #[inline(always)]
    fn slope(&self, cuboid: &Cuboid<R>, t: R) -> R {
        dot(self.d, cuboid.beyond(self.at(t)))
    }

    /// Parameter of the point of the line that is closest to the box; where several are equally close, the parameter at an end of their
    /// interval.
    #[inline(always)]
    fn closest(&self, cuboid: &Cuboid<R>) -> R {
        let (mut lo, mut hi) = (-self.half, self.half);
        let (mut below, mut above) = (self.slope(cuboid, lo), self.slope(cuboid, hi));
        let level = -self.rounding(cuboid);
        let (falls, rises) = (below.lt(level), above.ge(level));
        for k in 0..3 {
            for t in self.slab(cuboid, k) {
                let t = t.clamp(-self.half, self.half);
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
        R::select(inner, t, R::select(falls, self.half, -self.half))
    }

    /// Where and how the line leaves the box by the shortest way, if it enters it.
    #[inline(always)]
    fn way_out(&self, cuboid: &Cuboid<R>) -> (R, Touch<R>) {
        let (mut gap, mut u, mut t) = (R::of(f64::NEG_INFINITY), zero(), R::zero());
        for i in 0..3 {
            let this = self.p[i].abs() - self.d[i].abs() * self.half - cuboid.half[i];
            let shorter = this.gt(gap);
            let out = unit(i, self.p[i]);
            let ([a, b], [c, d]) = (self.slab(cuboid, (i + 1) % 3), self.slab(cuboid, (i + 2) % 3));
            let deepest = R::select(dot(out, self.d).gt(R::zero()), a.max(c).max(-self.half), b.min(d).min(self.half));
            gap = R::select(shorter, this, gap);
            u = select(shorter, out, u);
            t = R::select(shorter, deepest, t);
        }
        for i in 0..3 {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            let mut axis = zero();
            (axis[j], axis[k]) = (self.d[k], -self.d[j]);
            let square = dot(axis, axis);
            let crossing = square.gt(R::of(1e-12));
            let square = R::select(crossing, square, R::one());
            let axis = scale(axis, R::one() / square.sqrt());
            let side = dot(self.p, axis);
            let this = side.abs() - (cuboid.half[j] * axis[j].abs() + cuboid.half[k] * axis[k].abs());
            // A face is taken rather than an edge that is no better.
            let shorter = crossing.and((gap * R::of(1.0 - 1e-9)).lt(this));
            let out = scale(axis, R::one().copysign(side));
            let corner = |m: usize| cuboid.half[m].copysign(out[m]) - self.p[m];
            let crossed = ((self.d[j] * corner(j) + self.d[k] * corner(k)) / square).clamp(-self.half, self.half);
            gap = R::select(shorter, this, gap);
            u = select(shorter, out, u);
            t = R::select(shorter, crossed, t);
        }
        (t, Touch { x: self.at(t), u, gap })
    }

    /// The far end of the stretch that runs along the face or edge of the touch at `t`, and where there is one.
    #[inline(always)]
    fn other_end(&self, cuboid: &Cuboid<R>, t: R, near: &Touch<R>, outside: R::Mask) -> (R, Touch<R>, R::Mask) {
        let u = [near.u[0].abs(), near.u[1].abs(), near.u[2].abs()];
        let most = u[0].max(u[1]).max(u[2]);
        let (mut lo, mut hi) = (-self.half, self.half);
        let mut face = zero();
        let mut chosen = R::Mask::splat(false);
        for k in 0..3 {
            let faces = u[k].ge(most).and_not(chosen);
            chosen = chosen.or(faces);
            face = select(faces, unit(k, near.u[k]), face);
            // Beside the face within six degrees, or beside the edge.
            let beside = u[k].le(R::of(0.1)).or(outside.not()).and_not(faces);
            let [a, b] = self.slab(cuboid, k);
            lo = R::select(beside, a.max(lo), lo);
            hi = R::select(beside, b.min(hi), hi);
        }
        let low = (t - lo).ge(hi - t);
        let t_far = R::select(low, lo, hi);
        let two = lo.lt(hi).and((t_far - t).abs().gt(self.half * R::of(1e-6)));
        let t_far = R::select(two, t_far, t);
        let x = self.at(t_far);
        let (out, length, _) = direction(cuboid.beyond(x), face);
        let depth = dot(face, x) - dot([face[0].abs(), face[1].abs(), face[2].abs()], cuboid.half);
        // An edge that is the shortest way out has no deeper point beside it.
        let two = two.and(outside.or(most.ge(R::one())).or(depth.ge(near.gap)));
        (t_far, Touch { x, u: select(outside, out, face), gap: R::select(outside, length, depth) }, two)
    }
}
