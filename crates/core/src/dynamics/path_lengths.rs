//! Lengths and moment arms of the paths of spatial tendons.
//!
//! To the first order, the length of a shortest path does not depend on the tangent points of its arcs. Therefore only the straight parts
//! contribute to the moment arms: the derivatives of the length with respect to the coordinates. They are the generalized forces of unit
//! forces along each straight part, which push its ends apart.

use std::f64::consts::PI;

use stepper_geometry::{Obstacle, Wrap};
use stepper_real::{Mask, Real};

use crate::compile::{Combination, CompiledObstacle, CompiledPath, CompiledSegment, CompiledTendon, LaneModel, PathTerm, SMALLEST};
use crate::dynamics::inertia::NewtonEuler;
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;

/// Number of points on the obstacle of a segment that are drawn.
pub(crate) const ARC_POINTS: usize = 8;

impl<R: Real> Kinematics<R> {
    /// Computes the lengths and moment arms of all paths from the poses.
    #[inline(always)]
    pub(super) fn measure_paths(&mut self, compiled: &LaneModel<R>) {
        let mut paths = std::mem::take(&mut self.paths);
        for (path, length) in compiled.paths.iter().zip(&mut paths.lengths) {
            *length = self.measure_path(compiled, path, &mut paths.arms, &mut paths.touches);
        }
        self.paths = paths;
    }

    /// Computes the moment arms of one path into its part of `arms`, and whether it touches its obstacles into its part of `touches`.
    /// Returns its length.
    #[inline(always)]
    fn measure_path(&self, compiled: &LaneModel<R>, path: &CompiledPath<R::Scalar>, arms: &mut [R], touches: &mut [R]) -> R {
        arms[path.arms..path.arms + path.dofs.len()].fill(R::zero());
        let mut length = R::zero();
        for segment in &path.segments {
            length += self.measure_segment(compiled, segment, arms, touches);
        }
        length
    }

    /// Adds the moment arms of one segment to `arms`, and returns its length, both times the segment's weight. Sets the entry of the
    /// segment's obstacle in `touches`.
    #[inline(always)]
    fn measure_segment(&self, compiled: &LaneModel<R>, segment: &CompiledSegment<R::Scalar>, arms: &mut [R], touches: &mut [R]) -> R {
        let weight = R::splat(segment.weight);
        let ends =
            [self.point(segment.ends[0].frame, splat(segment.ends[0].pos)), self.point(segment.ends[1].frame, splat(segment.ends[1].pos))];
        let (direct, straight) = direction(ends);
        let Some(obstacle) = &segment.obstacle else {
            self.pull(compiled, &segment.moved[0], ends[0], scale(direct, -weight), arms);
            self.pull(compiled, &segment.moved[1], ends[1], scale(direct, weight), arms);
            return weight * straight;
        };
        let (_, wrap) = self.wrap(obstacle, ends);
        touches[obstacle.index] = R::select(wrap.touches, R::one(), R::zero());
        let (mut first, mut last, mut length) = (direct, direct, straight);
        if wrap.touches.any() {
            let ((before, to), (after, from)) = (direction([ends[0], wrap.points[0]]), direction([wrap.points[1], ends[1]]));
            first = select(wrap.touches, before, direct);
            last = select(wrap.touches, after, direct);
            length = R::select(wrap.touches, to + wrap.arc + from, straight);
            // A string that does not touch pulls by zero, so that rounding of its arms does not depend on other lanes.
            let points = [select(wrap.touches, wrap.points[0], ends[0]), select(wrap.touches, wrap.points[1], ends[0])];
            let pulls = R::select(wrap.touches, weight, R::zero());
            self.pull(compiled, &segment.moved[2], points[0], scale(first, pulls), arms);
            self.pull(compiled, &segment.moved[2], points[1], scale(last, -pulls), arms);
        }
        self.pull(compiled, &segment.moved[0], ends[0], scale(first, -weight), arms);
        self.pull(compiled, &segment.moved[1], ends[1], scale(last, weight), arms);
        weight * length
    }

    /// Second time derivative of the length of a straight segment if no joint accelerates, m/s^2.
    ///
    /// For the vector r between its ends, with the length L and the direction n, it is n . r'' + (r' . r' - (n . r')^2) / L.
    #[inline(always)]
    fn acceleration_of_segment(&self, compiled: &LaneModel<R>, segment: &CompiledSegment<R::Scalar>, motion: &NewtonEuler<R>) -> R {
        let [first, last] = &segment.ends;
        let points = [self.point(first.frame, splat(first.pos)), self.point(last.frame, splat(last.pos))];
        let [from, to] = [motion.of_point(compiled, self, first.frame, points[0]), motion.of_point(compiled, self, last.frame, points[1])];
        let (velocity, acceleration) = (sub(to[0], from[0]), sub(to[1], from[1]));
        let (direct, length) = direction(points);
        let across = dot(velocity, velocity) - dot(direct, velocity).square();
        let short = length.lt(R::of(SMALLEST));
        dot(direct, acceleration) + R::select(short, R::zero(), across / R::select(short, R::one(), length))
    }

    /// Obstacle in the world frame, and the path of a string from `ends[0]` to `ends[1]` around it.
    #[inline(always)]
    fn wrap(&self, obstacle: &CompiledObstacle<R::Scalar>, ends: [V3<R>; 2]) -> (Obstacle<R>, Wrap<R>) {
        let shape = Obstacle {
            pos: self.point(obstacle.place.frame, splat(obstacle.place.pos)),
            mat: mat_mul(&self.mat[obstacle.place.frame], &splat(obstacle.place.mat)),
            radius: R::splat(obstacle.radius),
            is_cylinder: obstacle.is_cylinder,
        };
        let side = obstacle.side.as_ref().map(
            #[inline(always)]
            |side| self.point(side.frame, splat(side.pos)),
        );
        let wrap = shape.wrap(ends, side);
        (shape, wrap)
    }

    /// Points of a segment of a path for drawing, world axes, m.
    ///
    /// They are the first site, [`ARC_POINTS`] points on the obstacle, and the second site. Where the string touches no obstacle, the
    /// points are on the straight line.
    #[inline(always)]
    pub(crate) fn points_of_segment(&self, segment: &CompiledSegment<R::Scalar>) -> [V3<R>; ARC_POINTS + 2] {
        let [first, last] =
            [self.point(segment.ends[0].frame, splat(segment.ends[0].pos)), self.point(segment.ends[1].frame, splat(segment.ends[1].pos))];
        let apart = sub(last, first);
        let mut points = [first; ARC_POINTS + 2];
        for (k, point) in points.iter_mut().enumerate().skip(1) {
            *point = add_scaled(first, apart, R::of(k as f64 / (ARC_POINTS + 1) as f64));
        }
        let Some(obstacle) = &segment.obstacle else { return points };
        let (shape, wrap) = self.wrap(obstacle, [first, last]);
        let [start, end] = [sub(wrap.points[0], shape.pos), sub(wrap.points[1], shape.pos)];
        // The arc turns about the axis of the cylinder, or about the normal of the plane of both points of a sphere.
        let normal = cross(start, end);
        let long = norm(normal).gt(R::of(SMALLEST));
        let axis =
            if shape.is_cylinder { column(&shape.mat, 2) } else { scale(normal, R::one() / R::select(long, norm(normal), R::one())) };
        let [low, high] = [dot(start, axis), dot(end, axis)];
        let (from, to) = (add_scaled(start, axis, -low), add_scaled(end, axis, -high));
        let short_turn = dot(axis, cross(from, to)).atan2(dot(from, to));
        // The length of the arc tells the short way around from the long way.
        let turn = ((wrap.arc * wrap.arc - (high - low).square()).max(R::zero())).sqrt() / shape.radius;
        let is_long = turn.gt(R::of(PI + 1e-6)).or((turn - short_turn.abs()).abs().gt(R::of(1e-3)));
        let way_back = R::select(short_turn.gt(R::zero()), short_turn - R::of(2.0 * PI), short_turn + R::of(2.0 * PI));
        let turn = R::select(is_long, way_back, short_turn);
        for k in 0..ARC_POINTS {
            let share = R::of(k as f64 / (ARC_POINTS - 1) as f64);
            let (sin, cos) = (turn * share).sin_cos();
            let around = add_scaled(scale(from, cos), cross(axis, from), sin);
            let on_arc = add(shape.pos, add_scaled(around, axis, low + share * (high - low)));
            points[k + 1] = select(wrap.touches, on_arc, points[k + 1]);
        }
        points
    }

    /// Adds the generalized force of the force `force` at the point `point` to `arms`, at the degrees of freedom `moved`.
    #[inline(always)]
    fn pull(&self, compiled: &LaneModel<R>, moved: &[(usize, usize)], point: V3<R>, force: V3<R>, arms: &mut [R]) {
        let Some(&(_, dof)) = moved.first() else { return };
        // All degrees of freedom that move one point belong to one kinematic tree.
        let wrench = spatial(cross(sub(point, self.origin[compiled.dofs[dof].tree]), force), force);
        for &(arm, dof) in moved {
            arms[arm] += dot6(self.axes[dof], wrench);
        }
    }
}

/// Adds to `bias` the forces that accelerate the inertia of spatial tendons if no joint accelerates. They are J^T m L'', with the moment
/// arms J and the inertia m. L'' is the second time derivative of the length at the velocity of `motion`.
///
/// Tendons with inertia wrap around no geoms.
#[inline(always)]
pub(crate) fn add_path_bias<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, motion: &NewtonEuler<R>, bias: &mut [R]) {
    for tendon in &compiled.tendons {
        let CompiledTendon { length: Combination { path: Some(PathTerm { path, dofs, arms }), .. }, spring: Some((spring, _)), .. } =
            tendon
        else {
            continue;
        };
        if spring.inertia <= R::Scalar::default() {
            continue;
        }
        let mut acceleration = R::zero();
        for segment in &compiled.paths[*path].segments {
            acceleration += R::splat(segment.weight) * kinematics.acceleration_of_segment(compiled, segment, motion);
        }
        let force = R::splat(spring.inertia) * acceleration;
        for (&dof, &arm) in dofs.iter().zip(&kinematics.paths.arms[*arms..]) {
            bias[dof as usize] += arm * force;
        }
    }
}

/// Direction from the first point to the second, and their distance. Without a distance the direction is the x axis, as in MuJoCo.
#[inline(always)]
fn direction<R: Real>([from, to]: [V3<R>; 2]) -> (V3<R>, R) {
    let apart = sub(to, from);
    let distance = norm(apart);
    let short = distance.lt(R::of(SMALLEST));
    let inverse = R::one() / R::select(short, R::one(), distance);
    (select(short, [R::one(), R::zero(), R::zero()], scale(apart, inverse)), distance)
}
