//! Shortest path of a string from one point to another around a sphere or a cylinder, over lanes.
//!
//! The cases are those of MuJoCo 4's tendons, so that lengths and moment arms are equal. The path lies in a plane:
//! the one through both points and the centre of the sphere, or the plane normal to the axis of the cylinder. There the obstacle is a
//! circle about the origin. A side point selects the side on which the string passes. If the side point is inside the obstacle, the string
//! passes through the obstacle and touches its surface from the inside.

use stepper_real::{Mask, Real, Scalar};

use crate::linear_algebra::*;

/// Length, m, below which a distance counts as zero. MuJoCo has the same number (`mjMINVAL`).
const SMALLEST: f64 = 1e-15;
/// Largest number of Newton's steps for a string inside the obstacle. From the first iterate, at most 20 are needed.
const MAX_STEPS: usize = 40;
/// Tolerance of Newton's method for a string inside the obstacle, rad. MuJoCo's is of the order of 1e-6. The tolerance here makes moment
/// arms the derivatives of lengths. In f32 it is larger, see [`tolerances`].
const TOLERANCE: f64 = 1e-12;
/// Distance of the first iterate of Newton's method from 1, as in MuJoCo. In f32 it is larger, see [`tolerances`].
const FIRST_STEP: f64 = 1e-7;

/// Obstacle around which a string wraps.
#[derive(Clone, Copy, Debug)]
pub struct Obstacle<R: Real> {
    /// Position of the centre, m.
    pub pos: V3<R>,
    /// Rotation matrix from the obstacle's axes. The axis of a cylinder is the z axis.
    pub mat: M3<R>,
    /// Radius, m.
    pub radius: R,
    /// Whether the obstacle is a cylinder of infinite length; otherwise it is a sphere.
    pub is_cylinder: bool,
}

/// Path of a string around an obstacle.
#[derive(Clone, Copy, Debug)]
pub struct Wrap<R: Real> {
    /// Lanes in which the string touches the obstacle. In the other lanes it is straight.
    pub touches: R::Mask,
    /// Points at which the string meets and leaves the obstacle, m.
    pub points: [V3<R>; 2],
    /// Length of the string between these points, m.
    pub arc: R,
}

/// Point in the plane of the path.
type V2<R> = [R; 2];

/// Candidate path in the plane: lanes in which the string touches, the two points, and the length between them.
type PlanarWrap<R> = (<R as Real>::Mask, [V2<R>; 2], R);

impl<R: Real> Obstacle<R> {
    /// Path of a string from `ends[0]` to `ends[1]` (m) around the obstacle, on the side of the point `side` if there is one.
    #[inline(always)]
    pub fn wrap(&self, ends: [V3<R>; 2], side: Option<V3<R>>) -> Wrap<R> {
        let (first, second) = (self.local(ends[0]), self.local(ends[1]));
        let apart = norm(first).ge(R::of(SMALLEST)).and(norm(second).ge(R::of(SMALLEST)));
        let (zero, one) = (R::zero(), R::one());
        // The plane of a path around a cylinder has its x and y axes.
        let axes = if self.is_cylinder { [[one, zero, zero], [zero, one, zero]] } else { axes_of_sphere(first, second) };
        let planar = [flat(&axes, first), flat(&axes, second)];
        let (mut touches, mut points, mut arc) = (R::Mask::splat(false), [[zero; 2]; 2], zero);
        let inside = match side {
            Some(side) => {
                let side = self.local(side);
                let inside = norm(side).lt(self.radius);
                if inside.not().any() {
                    (touches, points, arc) = wrap_outside(planar, Some(unit(flat(&axes, side))), self.radius);
                }
                inside
            }
            None => {
                (touches, points, arc) = wrap_outside(planar, None, self.radius);
                R::Mask::splat(false)
            }
        };
        if inside.any() {
            let (touches_inside, point) = wrap_inside(planar, self.radius, inside);
            touches = touches.and_not(inside).or(touches_inside.and(inside));
            points = [select(inside, point, points[0]), select(inside, point, points[1])];
            arc = R::select(inside, zero, arc);
        }
        // Not `map`: kernels call it for arrays of vectors.
        let mut contacts = [in_space(&axes, points[0]), in_space(&axes, points[1])];
        if self.is_cylinder {
            // Along the axis, the string advances in proportion to its length in the plane.
            let before = norm2([first[0] - contacts[0][0], first[1] - contacts[0][1]]);
            let after = norm2([second[0] - contacts[1][0], second[1] - contacts[1][1]]);
            let (rise, total) = (second[2] - first[2], before + arc + after);
            contacts[0][2] = first[2] + rise * before / total;
            contacts[1][2] = first[2] + rise * (before + arc) / total;
            arc = (arc * arc + (contacts[1][2] - contacts[0][2]).square()).sqrt();
        }
        let points = [add(rotate(&self.mat, contacts[0]), self.pos), add(rotate(&self.mat, contacts[1]), self.pos)];
        Wrap { touches: touches.and(apart), points, arc }
    }

    /// Point in the axes of the obstacle.
    #[inline(always)]
    fn local(&self, point: V3<R>) -> V3<R> {
        rotate_back(&self.mat, sub(point, self.pos))
    }
}

/// Point at the coordinates `x` and `y` along the axes of a plane.
#[inline(always)]
fn in_space<R: Real>(axes: &[V3<R>; 2], [x, y]: V2<R>) -> V3<R> {
    add_scaled(scale(axes[0], x), axes[1], y)
}

/// Coordinates of a point along the axes of a plane.
#[inline(always)]
fn flat<R: Real>(axes: &[V3<R>; 2], point: V3<R>) -> V2<R> {
    [dot(point, axes[0]), dot(point, axes[1])]
}

/// Axes of the plane of a path around a sphere, through the points `first` and `second`. If both are in one direction, the plane is
/// arbitrary.
#[inline(always)]
fn axes_of_sphere<R: Real>(first: V3<R>, second: V3<R>) -> [V3<R>; 2] {
    let axis = scale(first, R::one() / norm(first).max(R::of(SMALLEST)));
    let normal = cross(first, second);
    let size = norm(normal);
    let parallel = size.lt(R::of(SMALLEST));
    let mut normal = scale(normal, R::one() / size.max(R::of(SMALLEST)));
    if parallel.any() {
        // The helper vector is zero along the largest component of the axis, and one along the others.
        let [x, y, z] = [axis[0].abs(), axis[1].abs(), axis[2].abs()];
        let y_is_largest = y.gt(x).and(y.gt(z));
        let z_is_largest = z.gt(x).and(z.gt(y));
        let x_is_largest = y_is_largest.or(z_is_largest).not();
        let is_largest = [x_is_largest, y_is_largest, z_is_largest];
        let helper = array!(|k| R::select(is_largest[k], R::zero(), R::one()));
        let other = cross(axis, helper);
        normal = select(parallel, scale(other, R::one() / norm(other)), normal);
    }
    let across = cross(normal, axis);
    [axis, scale(across, R::one() / norm(across).max(R::of(SMALLEST)))]
}

#[inline(always)]
fn dot2<R: Real>(a: V2<R>, b: V2<R>) -> R {
    a[0] * b[0] + a[1] * b[1]
}

#[inline(always)]
fn norm2<R: Real>(a: V2<R>) -> R {
    dot2(a, a).sqrt()
}

/// Direction of a vector; the first axis for a vector without length, as in MuJoCo.
#[inline(always)]
fn unit<R: Real>(a: V2<R>) -> V2<R> {
    let size = norm2(a);
    let short = size.lt(R::of(SMALLEST));
    let inverse = R::one() / R::select(short, R::one(), size);
    [R::select(short, R::one(), a[0] * inverse), R::select(short, R::zero(), a[1] * inverse)]
}

/// Cross product of two vectors in the plane.
#[inline(always)]
fn cross2<R: Real>(a: V2<R>, b: V2<R>) -> R {
    a[0] * b[1] - a[1] * b[0]
}

/// Squared distance of two points, m^2, and the place on their line that is nearest to the origin. The place is 0 at the first point and 1
/// at the second.
#[inline(always)]
fn nearest_on_line<R: Real>(first: V2<R>, second: V2<R>) -> (R, R) {
    let along = sub(second, first);
    let squared_length = dot2(along, along);
    (squared_length, -dot2(along, first) / squared_length.max(R::of(SMALLEST)))
}

/// Point at which a tangent through the point `end` touches a circle about the origin. `signed_radius` is the radius of the circle; its
/// sign selects one of the two tangents.
#[inline(always)]
fn tangent_point<R: Real>(end: V2<R>, signed_radius: R) -> V2<R> {
    let (squared_length, squared_radius) = (dot2(end, end), signed_radius * signed_radius);
    let turn = signed_radius * (squared_length - squared_radius).max(R::zero()).sqrt();
    [(end[0] * squared_radius + turn * end[1]) / squared_length, (end[1] * squared_radius - turn * end[0]) / squared_length]
}

/// Path around the outside of a circle about the origin. `side` is the direction of the side point from the centre.
///
/// The string turns the shorter way around the circle. If the direction opposite to the side point is between the two ends, the string
/// turns the longer way, and touches the circle even if its straight line is clear of the circle.
#[inline(always)]
fn wrap_outside<R: Real>([first, second]: [V2<R>; 2], side: Option<V2<R>>, radius: R) -> PlanarWrap<R> {
    let squared_radius = radius * radius;
    let is_outside = dot2(first, first).ge(squared_radius).and(dot2(second, second).ge(squared_radius)).and(radius.ge(R::of(SMALLEST)));
    let (squared_length, nearest) = nearest_on_line(first, second);
    // Point of the straight path that is nearest to the centre.
    let point = add_scaled(first, sub(second, first), nearest.max(R::zero()).min(R::one()));
    let (zero, turn) = (R::zero(), cross2(first, second));
    let mut long_way = R::Mask::splat(false);
    if let Some(side) = side {
        long_way = (cross2(first, side) * turn).lt(zero).and((cross2(second, side) * turn).gt(zero));
    }
    let touches = is_outside.and(squared_length.ge(R::of(SMALLEST))).and(long_way.or(dot2(point, point).le(squared_radius)));
    let counter_clockwise = turn.gt(zero).and_not(long_way).or(long_way.and_not(turn.gt(zero)));
    // Tangents through both ends, for this sense of rotation.
    let signed_radius = R::select(counter_clockwise, -radius, radius);
    let points = [tangent_point(first, signed_radius), tangent_point(second, -signed_radius)];
    let turn = cross2(points[0], points[1]);
    let angle = turn.abs().atan2(dot2(points[0], points[1]));
    let is_reflex = turn.lt(zero).and(counter_clockwise).or(turn.gt(zero).and_not(counter_clockwise));
    let angle = R::select(is_reflex, R::of(2.0 * std::f64::consts::PI) - angle, angle);
    (touches, points, radius * angle)
}

/// Arc sine in rad.
#[inline(always)]
fn asin<R: Real>(x: R) -> R {
    x.atan2(((R::one() - x) * (R::one() + x)).max(R::zero()).sqrt())
}

/// Square root of 1 - x, at least [`SMALLEST`].
#[inline(always)]
fn root<R: Real>(x: R) -> R {
    (R::one() - x).max(R::zero()).sqrt().max(R::of(SMALLEST))
}

/// Left side of the equation of [`wrap_inside`] at z, rad.
#[inline(always)]
fn excess_angle<R: Real>([a, b]: [R; 2], angle: R, z: R) -> R {
    asin(a * z) + asin(b * z) - R::of(2.0) * asin(z) + angle
}

/// Tolerance of Newton's method and distance of its first iterate from 1, for the precision of the lanes.
#[inline(always)]
fn tolerances<R: Real>() -> [R; 2] {
    if R::Scalar::EPSILON.to_f64() < FIRST_STEP { [R::of(TOLERANCE), R::of(FIRST_STEP)] } else { [R::of(1e-5), R::of(1e-6)] }
}

/// Path through a circle about the origin that touches the circle from the inside: the lanes in which it touches, and the point. Newton's
/// method runs in the lanes `lanes` until all of them have finished.
///
/// The point follows from asin(A z) + asin(B z) - 2 asin(z) + G = 0. Here A and B are the radius divided by the distances of the ends from
/// the centre, G is the angle between the ends, and z the cosine of the angle between the string and the tangent of the circle.
#[inline(always)]
fn wrap_inside<R: Real>([first, second]: [V2<R>; 2], radius: R, lanes: R::Mask) -> (R::Mask, V2<R>) {
    let smallest = R::of(SMALLEST);
    let lengths = [norm2(first), norm2(second)];
    let (squared_length, nearest) = nearest_on_line(first, second);
    let mut touches = lengths[0].gt(radius).and(lengths[1].gt(radius)).and(radius.ge(smallest));
    let point = add_scaled(first, sub(second, first), nearest);
    let between = squared_length.gt(smallest).and(nearest.gt(R::zero())).and(nearest.lt(R::one()));
    touches = touches.and_not(between.and(norm2(point).le(radius)));
    // Where Newton's method fails, the string touches in the middle.
    let middle = scale(unit(scale(add(first, second), R::of(0.5))), radius);
    let (a, b) = (radius / lengths[0].max(smallest), radius / lengths[1].max(smallest));
    let cosine =
        (lengths[0] * lengths[0] + lengths[1] * lengths[1] - squared_length) / (R::of(2.0) * lengths[0] * lengths[1]).max(smallest);
    touches = touches.and(cosine.ge(R::of(-1.0) + smallest));
    let mut solved = touches.and(lanes).and(cosine.le(R::one() - smallest));
    let angle = cosine.max(-R::one()).min(R::one()).acos();
    let [tolerance, first_step] = tolerances::<R>();
    let mut z = R::one() - first_step;
    let mut f = excess_angle([a, b], angle, z);
    solved = solved.and(f.le(R::zero()));
    for _ in 0..MAX_STEPS {
        let active = solved.and(f.abs().gt(tolerance));
        if active.none() {
            break;
        }
        let slope = a / root(z * z * a * a) + b / root(z * z * b * b) - R::of(2.0) / root(z * z);
        let next = z - f / slope;
        let fails = slope.gt(-smallest).or(next.gt(z));
        solved = solved.and_not(active.and(fails));
        z = R::select(active, next, z);
        f = R::select(active, excess_angle([a, b], angle, z), f);
        solved = solved.and_not(active.and(f.gt(tolerance)));
    }
    solved = solved.and(f.abs().le(tolerance));
    let counter_clockwise = cross2(first, second).gt(R::zero());
    let from = unit(select(counter_clockwise, first, second));
    let turn = asin(z) - R::select(counter_clockwise, asin(a * z), asin(b * z));
    let (sin, cos) = turn.sin_cos();
    let tangent = [radius * (cos * from[0] - sin * from[1]), radius * (sin * from[0] + cos * from[1])];
    (touches, select(solved, tangent, middle))
}
