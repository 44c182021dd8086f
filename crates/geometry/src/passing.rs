//! Test whether two moving solids pass through each other within a step. Each solid has a constant twist in a frame that moves along a
//! straight line.
//!
//! Two convex shapes pass if they are apart at both ends of the path and collide in between. If they overlap at an end, they pass if the
//! direction between them reverses, because contact forces would then push them on instead of back. They also pass if they overlap only at
//! the end of the path, and are less deep in the direction of motion than against it. An example is an overlap near the edge of a plate:
//! contact forces would push the shape sideways around the edge.
//!
//! The thickness is the relative displacement below which neither shape can pass the other. A collision is an overlap of an eighth of the
//! thickness, because resting contacts overlap by rounding and slop.
//!
//! The search is conservative advancement (Mirtich, 1996). Let c be a bound of the speed at which the shapes approach along the direction
//! in which they are separated. The distance then falls by at most c t in a time t. A step of distance / c therefore misses no collision.
//! Steps are at least a quarter of the thickness long. Shapes that turn fast are first replaced by their solids of revolution. If these do
//! not collide on their straight paths, the shapes do not collide either.
//!
//! A shape passes a triangle surface if one of its inner points enters the surface and leaves it again. On long paths, points next to the
//! inner points are tested too. A shape that ends behind the surface does not pass if contact forces push it back in the next step. They
//! always do for a height field, which is solid down to its base. For a mesh they do if the normal of the deepest contact opposes the
//! displacement.

use std::iter;

use arrayvec::ArrayVec;

use crate::expand::Polytope;
use crate::linear_algebra::*;
use crate::narrow::Narrow;
use crate::pair::Pair;
use crate::ray::crossings;
use crate::separation;
use crate::shape::ConvexShape;
use crate::solid::Solid;
use crate::surface::Surface;
use crate::vectors::{Pose, V, from_columns, neg};

/// Smallest displacement between two collision tests along a path, relative to the thickness (see the module).
const MIN_ADVANCE: f64 = 0.25;

/// Largest number of collision tests along a path. If it is reached, the result is a collision. With [`MIN_ADVANCE`], a thousand tests
/// cover a path of 250 thicknesses.
const MAX_ADVANCES: usize = 1000;

/// Overlap above which two moving shapes collide, relative to the thickness (see the module).
const COLLISION_OVERLAP: f64 = 0.125;

/// Rotation on a path above which a shape is first replaced by its solid of revolution, rad.
const REVOLVED_ROTATION: f64 = 1.0;

/// Largest rotation along a part of a path that counts as straight, rad. The chord of 0.5 rad deviates by 1/32 of the radius.
const MAX_PART_ANGLE: f64 = 0.5;

/// Largest number of straight parts into which the path of a shape is divided.
const MAX_PARTS: usize = 64;

/// Path length above which points next to a shape's inner points are tested too. It is relative to the thickness, which is also the
/// distance of these points from the inner points.
///
/// Example: a ball whose centre passes half a radius beside the tip of a spike. Its thickness with a mesh is half its radius. The tip is
/// inside the ball along 2 sqrt(1 - 1/4) radii of the path, which is 3.5 times the thickness. A much shorter path cannot pass the tip
/// completely.
const PASS_THROUGH_RATIO: f64 = 3.0;

/// Motion of a solid in the world: its pose at time 0 and its constant twist in a frame that moves along a straight line.
#[derive(Clone, Copy, Debug)]
pub struct SolidMotion {
    /// Pose of the solid at time 0.
    pub pose: Pose,
    /// Angular velocity of the solid in world axes, rad/s.
    pub angular: V,
    /// Velocity of the moving frame, m/s. The frame of a solid of a floating tree moves with the root of the tree.
    pub root_velocity: V,
    /// Velocity of the origin of the solid in the moving frame at time 0, m/s. This vector rotates with the solid.
    pub linear: V,
}

impl SolidMotion {
    /// Pose at time `t`, s: the exponential of the twist in the moving frame.
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
        Pose { pos, mat: from_columns(axes) }
    }

    /// Upper bound of the speed at which the core of the shape `shape` moves along the unit vector `n`, m/s: the speed of its origin, and
    /// the additional speed by its rotation. The rotation of a body of revolution about its axis adds nothing.
    fn speed_along(&self, shape: &ConvexShape, n: V) -> [f64; 2] {
        let Self { pose, angular: w, root_velocity, linear } = self;
        let speed = norm(*w);
        let across = norm(cross(n, *w));
        // The part of `linear` across the axis of rotation rotates with the solid.
        let axis = if speed > 0.0 { scale(*w, 1.0 / speed) } else { n };
        let along = scale(axis, dot(axis, *linear));
        let orbit = if speed > 0.0 { norm(sub(*linear, along)) * across / speed } else { 0.0 };
        let own = match shape {
            ConvexShape::Sphere { .. } => 0.0,
            ConvexShape::Capsule { half_length, .. } => half_length * across.min(norm(cross(column(&pose.mat, 2), *w))),
            ConvexShape::Cylinder { .. } => shape.bound() * across.min(norm(cross(column(&pose.mat, 2), *w))),
            _ => (norm(shape.centre()) + shape.bound()) * across,
        };
        let steady = if speed > 0.0 { along } else { *linear };
        [dot(n, add(*root_velocity, steady)), orbit + own]
    }

    /// Angular velocity of the rotation that moves the surface of a shape, rad/s. The rotation of a body of revolution about its own axis
    /// counts only if the axis moves.
    fn sweep(&self, shape: &ConvexShape) -> f64 {
        let orbits = norm(cross(self.angular, self.linear)) > 1e-6 * dot(self.angular, self.angular) * shape.bound();
        match shape {
            _ if orbits => norm(self.angular),
            ConvexShape::Sphere { .. } => 0.0,
            ConvexShape::Capsule { .. } | ConvexShape::Cylinder { .. } => norm(cross(column(&self.pose.mat, 2), self.angular)),
            _ => norm(self.angular),
        }
    }

    /// Solid of revolution that contains the shape `shape` at all times from 0 on, with its motion, which is a translation. The solid is a
    /// cylinder.
    fn revolved(&self, shape: &ConvexShape) -> (ConvexShape, Self) {
        let Self { pose, angular: w, root_velocity, linear } = *self;
        let axis = scale(w, 1.0 / norm(w));
        let centre = add_scaled(pose.pos, cross(w, linear), 1.0 / dot(w, w));
        let (own_axis, offset) = (rotate_back(&pose.mat, axis), rotate_back(&pose.mat, sub(pose.pos, centre)));
        let top = dot(own_axis, add(shape.support(own_axis), offset)) + shape.radius();
        let bottom = dot(own_axis, add(shape.support(neg(own_axis)), offset)) - shape.radius();
        let radius = shape.radius_about(own_axis, offset);
        let [z, x, y] = contact_frame(axis);
        let middle = add_scaled(centre, axis, 0.5 * (top + bottom));
        let pose = Pose { pos: middle, mat: from_columns([x, y, z]) };
        let still = Self { pose, angular: [0.0; 3], root_velocity: add_scaled(root_velocity, axis, dot(axis, linear)), linear: [0.0; 3] };
        (ConvexShape::Cylinder { radius, half_length: 0.5 * (top - bottom) }, still)
    }

    /// Velocity of the origin of the solid at time 0, m/s.
    fn velocity(&self) -> V {
        add(self.root_velocity, self.linear)
    }
}

impl Narrow {
    /// Whether two solids may pass through each other between the times `from` and `to`, s. The result is always false for a half space.
    ///
    /// `thickness` is the relative displacement below which neither can pass the other, m.
    pub fn may_pass(&mut self, solids: [&Solid; 2], motions: [SolidMotion; 2], times: [f64; 2], thickness: f64) -> bool {
        match solids {
            [Solid::Convex(a), Solid::Convex(b)] => ConvexPair { shapes: [a, b], motions, times, thickness }.passes(&mut self.polytope),
            [Solid::Surface(surface), Solid::Convex(shape)] => self.may_pass_surface(surface, shape, &motions, times, thickness),
            [Solid::Convex(shape), Solid::Surface(surface)] => {
                self.may_pass_surface(surface, shape, &[motions[1], motions[0]], times, thickness)
            }
            _ => false,
        }
    }
}

/// Two moving convex shapes, for the test whether they pass through each other.
#[derive(Clone, Copy)]
struct ConvexPair<'a> {
    /// Shapes of the pair.
    shapes: [&'a ConvexShape; 2],
    /// Motions of the two shapes.
    motions: [SolidMotion; 2],
    /// Begin and end of the tested motion, s.
    times: [f64; 2],
    /// Relative displacement below which neither shape can pass the other, m.
    thickness: f64,
}

impl ConvexPair<'_> {
    /// Separation of the shapes at time `t`, m, and the unit vector along it from the first to the second, in world axes. NaN if a pose is
    /// not finite.
    fn separation_at(&self, t: f64, polytope: &mut Polytope) -> (f64, V) {
        let ([a, b], [first, second]) = (self.shapes, self.motions.map(|motion| motion.at(t)));
        let pair = Pair::new(a, &first, b, &second);
        if !pair.is_finite() {
            return (f64::NAN, [0.0; 3]);
        }
        separation::signed_distance(&pair, &first, polytope)
    }

    /// Whether the shapes pass through each other.
    fn passes(&self, polytope: &mut Polytope) -> bool {
        let Self { shapes, motions, times: [from, to], thickness } = *self;
        let (distance, start) = self.separation_at(from, polytope);
        let (last, end) = self.separation_at(to, polytope);
        if distance.is_nan() || last.is_nan() {
            return false;
        }
        let threshold = -COLLISION_OVERLAP * thickness;
        if distance <= threshold || last <= threshold {
            // Normals in the frame of the larger shape.
            let larger = usize::from(shapes[0].bound() <= shapes[1].bound());
            let [start, end] = [(start, from), (end, to)].map(|(n, t)| rotate_back(&motions[larger].at(t).mat, n));
            return dot(start, end) < 0.0 || (distance > threshold && is_past_middle(shapes, motions.map(|m| m.at(to)), start));
        }
        let sweeps = |k: usize| motions[k].sweep(shapes[k]) * (to - from) > REVOLVED_ROTATION;
        if sweeps(0) || sweeps(1) {
            let solids = [0, 1].map(|k| if sweeps(k) { motions[k].revolved(shapes[k]) } else { (shapes[k].clone(), motions[k]) });
            let [(a, first), (b, second)] = &solids;
            if !(ConvexPair { shapes: [a, b], motions: [*first, *second], ..*self }).collides(polytope) {
                return false;
            }
        }
        self.collides(polytope)
    }

    /// Whether the shapes collide, by conservative advancement.
    fn collides(&self, polytope: &mut Polytope) -> bool {
        let Self { shapes: [a, b], motions, times: [from, to], thickness } = self;
        let threshold = -COLLISION_OVERLAP * thickness;
        let spin = norm(sub(motions[1].angular, motions[0].angular));
        let speed = norm(relative_velocity(motions)) + spin * b.bound();
        // Both shapes rotate during the motion, so that the relative velocity changes.
        let displacement = (to - from) * motions.iter().map(|s| norm(s.root_velocity) + norm(s.linear)).sum::<f64>();
        let speed = speed + 2.0 * displacement * (norm(motions[0].angular) + norm(motions[1].angular));
        let mut t = *from;
        for _ in 0..MAX_ADVANCES {
            let (distance, n) = self.separation_at(t, polytope);
            if distance <= threshold {
                return true;
            }
            let ([first, swing], [second, other_swing]) = (motions[0].speed_along(a, n), motions[1].speed_along(b, n));
            let approach = first - second + swing + other_swing;
            // NaN if nothing moves.
            let least = MIN_ADVANCE * thickness / speed;
            t += if approach > 0.0 { ((distance - threshold) / approach).max(least) } else { f64::INFINITY };
            if t >= *to || t.is_nan() {
                return false;
            }
        }
        true
    }
}

/// Whether two overlapping shapes are separated by a shorter translation of the second one against the direction `towards` than along it.
///
/// `towards` is a direction from the first shape to the second, in the frame of the larger shape. At the edge of a plate the shortest
/// translation of all is sideways, no matter on which side the shape was before.
fn is_past_middle([a, b]: [&ConvexShape; 2], [first, second]: [Pose; 2], towards: V) -> bool {
    let pair = Pair::new(a, &first, b, &second);
    let normal = rotate(if a.bound() > b.bound() { &first.mat } else { &second.mat }, towards);
    let normal = rotate_back(&first.mat, normal);
    pair.separation(neg(normal)) > pair.separation(normal)
}

/// Velocity of the origin of the second solid in the rotating frame of the first, m/s.
fn relative_velocity([a, b]: &[SolidMotion; 2]) -> V {
    sub(b.velocity(), add(a.velocity(), cross(a.angular, sub(b.pose.pos, a.pose.pos))))
}

/// Path of a shape in the frame of a surface: poses of the shape at the ends of the path's straight parts.
struct RelativePath(ArrayVec<Pose, { MAX_PARTS + 1 }>);

impl RelativePath {
    /// Path of a shape relative to a surface between the times `from` and `to`, s. `motions` are those of the surface and of the shape, in
    /// this order. `angle` is an upper bound of the relative rotation, rad.
    fn new(motions: &[SolidMotion; 2], [from, to]: [f64; 2], angle: f64) -> Self {
        let parts = ((angle / MAX_PART_ANGLE).ceil().max(1.0) as usize).min(MAX_PARTS);
        let pose = |k: usize| {
            let t = from + (to - from) * k as f64 / parts as f64;
            let [ground, body] = [motions[0].at(t), motions[1].at(t)];
            let mat = from_columns([0, 1, 2].map(|k| rotate_back(&ground.mat, column(&body.mat, k))));
            Pose { pos: rotate_back(&ground.mat, sub(body.pos, ground.pos)), mat }
        };
        Self((0..=parts).map(pose).collect())
    }

    /// Number of times that the point `p` of the shape crosses the surface, and displacement of the point in the frame of the surface, m.
    /// After one crossing the point is behind the surface; after more it has passed through. A point that starts inside a height field
    /// has no crossings.
    fn crossings(&self, surface: &Surface, p: V) -> (usize, V) {
        let mut places = self.0.iter().map(|pose| add(pose.pos, rotate(&pose.mat, p)));
        let start = places.next().unwrap_or(p);
        if let Surface::Grid(grid) = surface
            && grid.is_inside(start)
        {
            // The height field pushes out a point that starts inside it.
            return (0, [0.0; 3]);
        }
        let (mut here, mut count) = (start, 0);
        for next in places {
            count += crossings(surface, here, next);
            here = next;
        }
        (count, sub(here, start))
    }
}

impl Narrow {
    /// Whether a convex shape passes through a surface between the times `from` and `to`, s.
    ///
    /// `motions` are those of the surface and of the shape, in this order. `thickness` is the relative displacement below which the shape
    /// cannot pass the surface, m.
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
        for point in inner_points(shape) {
            match path.crossings(surface, point) {
                (2.., _) => return true,
                (1, displacement) if !self.is_pushed_back(surface, shape, motions.map(|s| s.at(to)), displacement) => return true,
                _ => {}
            }
            for k in 0..offset_points {
                let mut p = point;
                p[k / 2] += if k % 2 == 0 { thickness } else { -thickness };
                if path.crossings(surface, p).0 >= 2 {
                    return true;
                }
            }
        }
        false
    }

    /// Whether contact forces push a shape back through a surface. They always do for a height field. For a mesh they do if the deepest
    /// contact opposes the shape's `displacement`, given in the frame of the mesh.
    fn is_pushed_back(&mut self, surface: &Surface, shape: &ConvexShape, [ground, body]: [Pose; 2], displacement: V) -> bool {
        if matches!(surface, Surface::Grid(_)) {
            return true;
        }
        self.found.clear();
        self.collide_surface(surface, &ground, shape, &body, &0.0.into());
        let displacement = rotate(&ground.mat, displacement);
        let deepest = self.found.points.iter().min_by(|p, q| p.distance.total_cmp(&q.distance));
        deepest.is_some_and(|p| dot(p.normal, displacement) < 0.0)
    }
}

/// Points deep inside a shape, in its frame, m. They are along the axis of a long shape, and halfway to the corners of a box.
fn inner_points(shape: &ConvexShape) -> ArrayVec<V, 9> {
    let along = |half: f64| (0..5).map(|k| [0.0, 0.0, half * (f64::from(k) * 0.5 - 1.0)]).collect();
    match *shape {
        ConvexShape::Capsule { half_length, .. } => along(half_length),
        ConvexShape::Cylinder { radius, half_length } if half_length > radius => along(half_length - radius),
        ConvexShape::Box { half } => {
            let towards = |corner: usize| array_of(|i| half[i] * if corner >> i & 1 == 0 { 0.5 } else { -0.5 });
            iter::once([0.0; 3]).chain((0..8).map(towards)).collect()
        }
        _ => iter::once(shape.centre()).collect(),
    }
}
