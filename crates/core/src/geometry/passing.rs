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
const MIN_ADVANCE: f64 = 0.25;

/// Steps of a search for a meeting, after which it counts as found. Four for every thickness: a path 250 times as long as two are thick.
const MAX_ADVANCES: usize = 1000;

/// Overlap of shapes that meet, as a share of their thickness.
const MEETING_OVERLAP: f64 = 0.125;

/// Angle of a part of a path that is taken as straight, rad: the chord leaves an arc by 1/32 of its radius.
const MAX_PART_ANGLE: f64 = 0.5;

/// Parts of a path at the most.
const MAX_PARTS: usize = 64;

/// Distance, as a multiple of the thickness, that goes in and out of a surface with a point half as deep as the shape: of a ball whose path
/// is so far above a point, 2 sqrt(1 - 1/4) of its radius, which is twice the thickness.
const PASS_THROUGH_RATIO: f64 = 3.0;

/// Motion of a solid: its pose at time 0, and its constant twist beside a frame that moves straight.
#[derive(Clone, Copy, Debug)]
pub struct SolidMotion {
    /// Pose at time 0.
    pub pose: Pose,
    /// Angular velocity, rad/s.
    pub angular: V,
    /// Velocity of the frame, m/s: of the root of a floating tree.
    pub root_velocity: V,
    /// Velocity of its origin in that frame at time 0, m/s; it turns with the solid.
    pub linear: V,
}

impl SolidMotion {
    /// Pose at time `t`, s: the exponential of the twist, in a frame that moves straight.
    fn at(&self, t: f64) -> Pose {
        let Self { pose, angular: w, root_velocity, linear: v } = self;
        let (speed, start) = (norm(*w), add_scaled(pose.pos, *root_velocity, t));
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
        add(self.root_velocity, self.linear)
    }
}

impl Narrow {
    /// Whether two solids may get past one another from the time `from` to the time `to`, s. `thickness` is the relative displacement that
    /// never takes one through the other, m. A half space lets nothing pass.
    pub fn may_pass(&mut self, solids: [&Solid; 2], motions: [SolidMotion; 2], [from, to]: [f64; 2], thickness: f64) -> bool {
        match solids {
            [Solid::Convex(a), Solid::Convex(b)] => convex_pass([a, b], &motions, [from, to], thickness, &mut self.room.polytope),
            [Solid::Surface(surface), Solid::Convex(shape)] => self.may_pass_surface(surface, shape, &motions, [from, to], thickness),
            [Solid::Convex(shape), Solid::Surface(surface)] => {
                self.may_pass_surface(surface, shape, &[motions[1], motions[0]], [from, to], thickness)
            }
            _ => false,
        }
    }
}

/// Whether two convex shapes pass one another.
fn convex_pass(
    [a, b]: [&ConvexShape; 2],
    motions: &[SolidMotion; 2],
    [from, to]: [f64; 2],
    thickness: f64,
    polytope: &mut Polytope,
) -> bool {
    let mut separation_at = |t: f64| {
        let [first, second] = [motions[0].at(t), motions[1].at(t)];
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
    let ((mut distance, start), (last, end)) = (separation_at(from), separation_at(to));
    if distance.is_nan() || last.is_nan() {
        return false;
    }
    let meeting = -MEETING_OVERLAP * thickness;
    if distance <= meeting || last <= meeting {
        return dot(start, end) < 0.0;
    }
    let spin = norm(sub(motions[1].angular, motions[0].angular));
    let speed = norm(relative_velocity(motions)) + spin * b.bound();
    // Both turn on while they move.
    let displacement = (to - from) * motions.iter().map(|s| norm(s.root_velocity) + norm(s.linear)).sum::<f64>();
    let speed = speed + 2.0 * displacement * (norm(motions[0].angular) + norm(motions[1].angular));
    let mut t = from;
    for _ in 0..MAX_ADVANCES {
        t += (distance - meeting).max(MIN_ADVANCE * thickness) / speed;
        // Not a number where nothing moves.
        if t >= to || t.is_nan() {
            return false;
        }
        distance = separation_at(t).0;
        if distance <= meeting {
            return true;
        }
    }
    true
}

/// Velocity of the second's origin as the first sees it, m/s.
fn relative_velocity([a, b]: &[SolidMotion; 2]) -> V {
    sub(b.velocity(), add(a.velocity(), cross(a.angular, sub(b.pose.pos, a.pose.pos))))
}

/// How a point goes along a path past a surface.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Crossing {
    /// Path that stays on its side.
    None,
    /// Path that ends on the other side.
    Enters,
    /// Path that goes in and comes out.
    PassesThrough,
}

/// Poses of a shape in the frame of a surface, where its path is cut into straight parts.
struct RelativePath {
    poses: [Pose; MAX_PARTS + 1],
    parts: usize,
}

impl RelativePath {
    fn new(motions: &[SolidMotion; 2], [from, to]: [f64; 2], angle: f64) -> Self {
        let parts = ((angle / MAX_PART_ANGLE).ceil().max(1.0) as usize).min(MAX_PARTS);
        let mut poses = [motions[1].pose; MAX_PARTS + 1];
        for (k, pose) in poses[..=parts].iter_mut().enumerate() {
            let t = from + (to - from) * k as f64 / parts as f64;
            let [ground, body] = [motions[0].at(t), motions[1].at(t)];
            let axes = [0, 1, 2].map(|k| rotate_back(&ground.mat, column(&body.mat, k)));
            let mat = std::array::from_fn(|i| axes[i % 3][i / 3]);
            *pose = Pose { pos: rotate_back(&ground.mat, sub(body.pos, ground.pos)), mat };
        }
        Self { poses, parts }
    }

    /// Crossing of the point `p` of the shape, and its way.
    fn crossing(&self, surface: &Surface, p: V) -> (Crossing, V) {
        let place = |k: usize| add(self.poses[k].pos, rotate(&self.poses[k].mat, p));
        let start = place(0);
        if let Surface::Grid(grid) = surface
            && grid.is_inside(start)
        {
            // It is pushed out.
            return (Crossing::None, [0.0; 3]);
        }
        let (mut here, mut count) = (start, 0);
        for k in 1..=self.parts {
            let next = place(k);
            count += crossings(surface, here, next);
            here = next;
        }
        let crossing = match count {
            0 => Crossing::None,
            1 => Crossing::Enters,
            _ => Crossing::PassesThrough,
        };
        (crossing, sub(here, start))
    }
}

impl Narrow {
    /// Whether a convex shape passes a surface, the first of the two that move.
    fn may_pass_surface(
        &mut self,
        surface: &Surface,
        shape: &ConvexShape,
        motions: &[SolidMotion; 2],
        [from, to]: [f64; 2],
        thickness: f64,
    ) -> bool {
        let angle = (norm(motions[0].angular) + norm(motions[1].angular)) * (to - from);
        let length = norm(relative_velocity(motions)) * (to - from) + angle * shape.bound();
        let offset_points = if length > PASS_THROUGH_RATIO * thickness { 6 } else { 0 };
        let path = RelativePath::new(motions, [from, to], angle);
        let (inner_points, number) = inner_points(shape);
        for &point in &inner_points[..number] {
            match path.crossing(surface, point) {
                (Crossing::PassesThrough, _) => return true,
                (Crossing::Enters, displacement) if matches!(surface, Surface::Mesh(_)) => {
                    let Self { room, found } = self;
                    if !is_pushed_back(surface, shape, motions.map(|s| s.at(to)), displacement, found, room) {
                        return true;
                    }
                }
                _ => {}
            }
            for k in 0..offset_points {
                let mut p = point;
                p[k / 2] += if k % 2 == 0 { thickness } else { -thickness };
                if path.crossing(surface, p).0 == Crossing::PassesThrough {
                    return true;
                }
            }
        }
        false
    }
}

/// Whether a shape that came the `displacement` (in the surface's frame) overlaps a mesh, and its deepest contact pushes it back.
fn is_pushed_back(
    surface: &Surface,
    shape: &ConvexShape,
    [ground, body]: [Pose; 2],
    displacement: V,
    out: &mut Manifold,
    room: &mut Room,
) -> bool {
    collide_surface(surface, &ground, shape, &body, 0.0, out, room);
    let displacement = rotate(&ground.mat, displacement);
    let deepest = out.points.iter().min_by(|p, q| p.distance.total_cmp(&q.distance));
    deepest.is_some_and(|p| dot(p.normal, displacement) < 0.0)
}

/// Points deep inside a shape, in its frame, and their number: along the axis of a long one, and halfway to the corners of a box.
fn inner_points(shape: &ConvexShape) -> ([V; 9], usize) {
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
