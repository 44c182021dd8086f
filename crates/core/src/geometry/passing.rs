//! Whether two solids get past one another while both move, each along a straight line and on it with a constant twist.
//!
//! Convex shapes pass if they are apart at both ends and meet in between, or if the direction between them turns around: where they overlap
//! at an end, contact forces would push them on instead of back. They meet if they overlap by an eighth of their thickness: contacts touch,
//! up to rounding and slop. In a time t their distance falls by at most c t, with a bound c on the relative speed of their points, so that
//! nothing is missed in steps of distance / c (conservative advancement: Mirtich 1996). Steps are no shorter than a quarter of their
//! thickness.
//!
//! A shape passes a surface of triangles if a point inside the shape goes in and comes out again. What ends behind the surface is still met
//! there by the next step, and pushed back: always by a height field, which is solid down to its base, by a mesh if its deepest contact at
//! the end is against the way that the shape came.

use crate::geometry::expand::Polytope;
use crate::geometry::manifold::Manifold;
use crate::geometry::narrow::Narrow;
use crate::geometry::pair::Pair;
use crate::geometry::ray::crossings;
use crate::geometry::room::Room;
use crate::geometry::separation;
use crate::geometry::shape::ConvexShape;
use crate::geometry::solid::Solid;
use crate::geometry::surface::{Surface, collide_surface};
use crate::geometry::vectors::{Pose, V};
use crate::math::spatial::*;

/// Share of the thickness by which a search for a meeting advances at least.
const ADVANCE: f64 = 0.25;

/// Steps of a search for a meeting, after which it counts as found. Four for every thickness: a path 250 times as long as two are thick.
const MAX_ADVANCES: usize = 1000;

/// Overlap of shapes that meet, as a share of their thickness.
const MEETING: f64 = 0.125;

/// Angle of a part of a path that is taken as straight, rad: the chord leaves an arc by 1/32 of its radius.
const STRAIGHT: f64 = 0.5;

/// Parts of a path at the most.
const MAX_PARTS: usize = 64;

/// Distance, as a multiple of the thickness, that goes in and out of a surface with a point half as deep as the shape: of a ball whose path
/// is so far above a point, 2 sqrt(1 - 1/4) of its radius, which is twice the thickness.
const IN_AND_OUT: f64 = 3.0;

/// Motion of a solid: its pose at time 0, and its constant twist beside a frame that moves straight.
#[derive(Clone, Copy, Debug)]
pub struct Sweep {
    /// Pose at time 0.
    pub pose: Pose,
    /// Angular velocity, rad/s.
    pub angular: V,
    /// Velocity of the frame, m/s: of the root of a floating tree.
    pub straight: V,
    /// Velocity of its origin in that frame at time 0, m/s; it turns with the solid.
    pub linear: V,
}

impl Sweep {
    /// Pose at time `t`, s: the exponential of the twist, in a frame that moves straight.
    fn at(&self, t: f64) -> Pose {
        let Self { pose, angular: w, straight, linear: v } = self;
        let (speed, start) = (norm(*w), add_scaled(pose.pos, *straight, t));
        if speed * t.abs() < 1e-9 {
            return Pose { pos: add_scaled(start, *v, t), mat: pose.mat };
        }
        let (sin, cos) = (speed * t).sin_cos();
        let (first, second) = ((1.0 - cos) / (speed * speed), (t - sin / speed) / (speed * speed));
        let turned = |x: V| {
            let (once, twice) = (cross(*w, x), cross(*w, cross(*w, x)));
            add_scaled(add_scaled(x, once, sin / speed), twice, first)
        };
        let (once, twice) = (cross(*w, *v), cross(*w, cross(*w, *v)));
        let pos = add_scaled(add_scaled(add_scaled(start, *v, t), once, first), twice, second);
        let axes = [0, 1, 2].map(|k| turned(column(&pose.mat, k)));
        let mat = std::array::from_fn(|i| axes[i % 3][i / 3]);
        Pose { pos, mat }
    }

    /// Velocity of its origin at time 0, m/s.
    fn velocity(&self) -> V {
        add(self.straight, self.linear)
    }
}

impl Narrow {
    /// Whether two solids may get past one another from the time `from` to the time `to`, s. `thickness` is the relative displacement that
    /// never takes one through the other, m. A half space lets nothing pass.
    pub fn may_pass(&mut self, solids: [&Solid; 2], sweeps: [Sweep; 2], [from, to]: [f64; 2], thickness: f64) -> bool {
        match solids {
            [Solid::Convex(a), Solid::Convex(b)] => pass([a, b], &sweeps, [from, to], thickness, &mut self.room.polytope),
            [Solid::Surface(surface), Solid::Convex(shape)] => self.may_pass_surface(surface, shape, &sweeps, [from, to], thickness),
            [Solid::Convex(shape), Solid::Surface(surface)] => {
                self.may_pass_surface(surface, shape, &[sweeps[1], sweeps[0]], [from, to], thickness)
            }
            _ => false,
        }
    }
}

/// Whether two convex shapes pass one another.
fn pass([a, b]: [&ConvexShape; 2], sweeps: &[Sweep; 2], [from, to]: [f64; 2], thickness: f64, polytope: &mut Polytope) -> bool {
    let mut apart = |t: f64| {
        let [first, second] = [sweeps[0].at(t), sweeps[1].at(t)];
        let pair = Pair::new(a, &first, b, &second);
        if !pair.is_finite() {
            return (f64::NAN, [0.0; 3]);
        }
        let found = separation::nearest(&pair, &f64::INFINITY.into(), polytope).found;
        let normal = rotate(&first.mat, found.normal);
        // As the larger of the two sees it.
        let seen = rotate_back(if a.bound() > b.bound() { &first.mat } else { &second.mat }, normal);
        (found.separation - pair.thickness(), seen)
    };
    let ((mut distance, start), (last, end)) = (apart(from), apart(to));
    if distance.is_nan() || last.is_nan() {
        return false;
    }
    let meeting = -MEETING * thickness;
    if distance <= meeting || last <= meeting {
        return dot(start, end) < 0.0;
    }
    let spin = norm(sub(sweeps[1].angular, sweeps[0].angular));
    let speed = norm(relative_velocity(sweeps)) + spin * b.bound();
    // Both turn on while they move.
    let way = (to - from) * sweeps.iter().map(|s| norm(s.straight) + norm(s.linear)).sum::<f64>();
    let speed = speed + 2.0 * way * (norm(sweeps[0].angular) + norm(sweeps[1].angular));
    let mut t = from;
    for _ in 0..MAX_ADVANCES {
        t += (distance - meeting).max(ADVANCE * thickness) / speed;
        // Not a number where nothing moves.
        if t >= to || t.is_nan() {
            return false;
        }
        distance = apart(t).0;
        if distance <= meeting {
            return true;
        }
    }
    true
}

/// Velocity of the second's origin as the first sees it, m/s.
fn relative_velocity([a, b]: &[Sweep; 2]) -> V {
    sub(b.velocity(), add(a.velocity(), cross(a.angular, sub(b.pose.pos, a.pose.pos))))
}

/// How a point goes along a path past a surface.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Course {
    /// Path that stays on its side.
    Stays,
    /// Path that ends on the other side.
    Enters,
    /// Path that goes in and comes out.
    Passes,
}

/// Poses of a shape in the frame of a surface, where its path is cut into straight parts.
struct Stations {
    poses: [Pose; MAX_PARTS + 1],
    parts: usize,
}

impl Stations {
    fn new(sweeps: &[Sweep; 2], [from, to]: [f64; 2], angle: f64) -> Self {
        let parts = ((angle / STRAIGHT).ceil().max(1.0) as usize).min(MAX_PARTS);
        let mut poses = [sweeps[1].pose; MAX_PARTS + 1];
        for (k, pose) in poses[..=parts].iter_mut().enumerate() {
            let t = from + (to - from) * k as f64 / parts as f64;
            let [ground, body] = [sweeps[0].at(t), sweeps[1].at(t)];
            let axes = [0, 1, 2].map(|k| rotate_back(&ground.mat, column(&body.mat, k)));
            let mat = std::array::from_fn(|i| axes[i % 3][i / 3]);
            *pose = Pose { pos: rotate_back(&ground.mat, sub(body.pos, ground.pos)), mat };
        }
        Self { poses, parts }
    }

    /// Course of the point `p` of the shape, and its way.
    fn course(&self, surface: &Surface, p: V) -> (Course, V) {
        let place = |k: usize| add(self.poses[k].pos, rotate(&self.poses[k].mat, p));
        let start = place(0);
        if let Surface::Grid(grid) = surface
            && grid.is_inside(start)
        {
            // It is pushed out.
            return (Course::Stays, [0.0; 3]);
        }
        let (mut here, mut count) = (start, 0);
        for k in 1..=self.parts {
            let next = place(k);
            count += crossings(surface, here, next);
            here = next;
        }
        let course = match count {
            0 => Course::Stays,
            1 => Course::Enters,
            _ => Course::Passes,
        };
        (course, sub(here, start))
    }
}

impl Narrow {
    /// Whether a convex shape passes a surface, the first of the two that move.
    fn may_pass_surface(
        &mut self,
        surface: &Surface,
        shape: &ConvexShape,
        sweeps: &[Sweep; 2],
        [from, to]: [f64; 2],
        thickness: f64,
    ) -> bool {
        let angle = (norm(sweeps[0].angular) + norm(sweeps[1].angular)) * (to - from);
        let length = norm(relative_velocity(sweeps)) * (to - from) + angle * shape.bound();
        let points_beside = if length > IN_AND_OUT * thickness { 6 } else { 0 };
        let stations = Stations::new(sweeps, [from, to], angle);
        let (cores, number) = cores(shape);
        for &core in &cores[..number] {
            match stations.course(surface, core) {
                (Course::Passes, _) => return true,
                (Course::Enters, way) if matches!(surface, Surface::Mesh(_)) => {
                    let Self { room, found } = self;
                    if !is_met_behind(surface, shape, sweeps.map(|s| s.at(to)), way, found, room) {
                        return true;
                    }
                }
                _ => {}
            }
            for k in 0..points_beside {
                let mut p = core;
                p[k / 2] += if k % 2 == 0 { thickness } else { -thickness };
                if stations.course(surface, p).0 == Course::Passes {
                    return true;
                }
            }
        }
        false
    }
}

/// Whether a shape that came the `way` (in the surface's frame) overlaps a mesh, and its deepest contact pushes it back.
fn is_met_behind(surface: &Surface, shape: &ConvexShape, [ground, body]: [Pose; 2], way: V, out: &mut Manifold, room: &mut Room) -> bool {
    collide_surface(surface, &ground, shape, &body, 0.0, out, room);
    let way = rotate(&ground.mat, way);
    let deepest = out.points.iter().min_by(|p, q| p.distance.total_cmp(&q.distance));
    deepest.is_some_and(|p| dot(p.normal, way) < 0.0)
}

/// Points deep inside a shape, in its frame, and their number: along the axis of a long one, and halfway to the corners of a box.
fn cores(shape: &ConvexShape) -> ([V; 9], usize) {
    let mut points = [[0.0; 3]; 9];
    let along = |points: &mut [V; 9], half: f64| {
        for (k, point) in points.iter_mut().take(5).enumerate() {
            point[2] = half * (k as f64 * 0.5 - 1.0);
        }
        5
    };
    let number = match *shape {
        ConvexShape::Capsule { half_length, .. } => along(&mut points, half_length),
        ConvexShape::Cylinder { radius, half_length } if half_length > radius => along(&mut points, half_length - radius),
        ConvexShape::Box { half } => {
            for (k, point) in points[1..].iter_mut().enumerate() {
                *point = std::array::from_fn(|i| half[i] * if k >> i & 1 == 0 { 0.5 } else { -0.5 });
            }
            9
        }
        _ => {
            points[0] = shape.centre();
            1
        }
    };
    (points, number)
}
