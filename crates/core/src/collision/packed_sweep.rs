//! Distances of balls and capsules to static boxes along the motion of a step, for pairs that are tested in few lanes.
//!
//! Several such pairs share a register, as in [`PackedPairs`](crate::collision::packed_pairs::PackedPairs). The numbers equal those of
//! [`SweptPair`].

use stepper_geometry::pairs::{ContactPoint, Cuboid, Segment, capsule_box, sphere_box};
use stepper_real::{Mask, Real};

use crate::collision::packed_pairs::{Item, gather, gather_boxes, gather_scalars};
use crate::collision::swept_pair::{Gap, Path, SweptPair, Touch, find_touch, velocity_field};
use crate::compile::{CompiledPair, Kernel, LaneModel};
use crate::math::spatial::*;

/// Motion of several packed pairs (items) along the path of a step. Each item is a ball or capsule and a static box, in one lane of the
/// step; item k is in lane k of the registers. All items have the same kernel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PackedSweep<R> {
    kernel: Kernel,
    /// Origin of the ball or capsule at the start of the path, world axes, m.
    pos: V3<R>,
    /// Axis of the capsule at the start of the path, world axes. Not used for a ball.
    axis: V3<R>,
    radius: R,
    half_length: R,
    bounding_radius: R,
    cuboid: Cuboid<R>,
    /// Origin of the frame of the ball or capsule, world axes, m.
    origin: V3<R>,
    /// Angular velocity of the frame, rad/s.
    angular_velocity: V3<R>,
    /// Linear velocity of `origin`, m/s.
    velocity: V3<R>,
    /// Reference point of the kinematic tree of the ball or capsule, world axes, m.
    reference: V3<R>,
    /// Margin of each pair, m.
    margin: R,
    /// Slack of the path, see [`Path::slack`].
    slack: R,
    /// Duration of the path, s.
    time: R,
}

/// Whether a pair that is tested in the lanes `lanes` (bits) can be packed. It must be a pair of a moving ball or capsule and a static box,
/// and tested in at most half of the lanes.
pub(crate) fn can_be_packed<R: Real>(compiled: &LaneModel<R>, pair: &CompiledPair<R::Scalar>, lanes: u32) -> bool {
    let [first, second] = pair.geoms.map(|g| compiled.geoms[g].frame);
    matches!(pair.kernel, Kernel::SphereBox | Kernel::CapsuleBox)
        && 2 * lanes.count_ones() as usize <= R::LANES
        && (1..=compiled.links.len()).contains(&first)
        && second == 0
}

impl<R: Real> PackedSweep<R> {
    /// Packs the first `LANES` of `items` for the motion of `swept`. All items have the kernel `kernel`. Pair and time of `path` are not
    /// used: `time_of` returns the duration of the path of each pair, s.
    #[inline(always)]
    pub(crate) fn new(
        swept: &SweptPair<R>,
        path: &Path<'_, R>,
        time_of: impl Fn(usize) -> R,
        kernel: Kernel,
        items: &[Item<R::Scalar>],
    ) -> Self {
        let Path { compiled, kinematics, start, .. } = *path;
        let frame = |item: &Item<R::Scalar>| compiled.geoms[item.geoms[0]].frame;
        let of_ball = |item: &Item<R::Scalar>| item.geoms[0];
        let motion = gather!(items, |item| swept.link_velocities[frame(item) - 1]);
        let origin = gather!(items, |item| kinematics.pos[frame(item)]);
        let reference = gather!(items, |item| kinematics.origin[compiled.links[frame(item) - 1].tree]);
        let [radius, half_length, bounding_radius] = gather!(items, |item| {
            let [radius, half_length, _] = compiled.params.geom_size(of_ball(item));
            [radius, half_length, compiled.params.bounding_radius(of_ball(item))]
        });
        let [slack, time] = gather!(items, |item| [path.slack, time_of(item.index)]);
        Self {
            kernel,
            pos: gather!(items, |item| start.pos[of_ball(item)]),
            axis: gather!(items, |item| column(&start.mat[of_ball(item)], 2)),
            radius,
            half_length,
            bounding_radius,
            cuboid: gather_boxes(compiled, &start.pos, &start.mat, items),
            origin,
            angular_velocity: angular(&motion),
            velocity: velocity_at(&motion, sub(origin, reference)),
            reference,
            margin: gather_scalars(
                items,
                #[inline(always)]
                |item| item.margin,
            ),
            slack,
            time,
        }
    }

    /// Touch of each of the items `items` on its path, if there is one, see [`find_touch`]. `gap` has the distances and their rates at the
    /// start of the paths. An overlap up to `tolerance`, m, is no touch.
    #[inline(always)]
    pub(crate) fn find_touch(&self, gap: Gap<R>, items: R::Mask, tolerance: R) -> Touch<R> {
        let whole = [R::zero(), self.time];
        let (touch, _) = find_touch(
            gap,
            whole,
            items,
            R::zero(),
            tolerance,
            #[inline(always)]
            |time, items| self.gap_at(time, items),
        );
        touch
    }

    /// Smallest distance between the geoms of each of the items `items`, and its time derivative, at `time` seconds along the path. The
    /// distance is infinite where no contact point can touch within two path durations, and for other items.
    #[inline(always)]
    pub(crate) fn gap_at(&self, time: R, items: R::Mask) -> Gap<R> {
        let rotation = quat_to_mat(quat_exp(scale(self.angular_velocity, time)));
        let arm = rotate(&rotation, sub(self.pos, self.origin));
        let origin = add_scaled(self.origin, self.velocity, time);
        let centre = add(origin, arm);
        let motion = velocity_field([self.angular_velocity, self.velocity], origin, self.reference);
        let spin = norm(self.angular_velocity);
        let swing = R::select(spin.gt(R::zero()), spin * (norm(arm) + self.bounding_radius), R::zero());
        let travel = (norm(self.velocity) + swing) * (self.time + self.time);
        let mut least = Gap { distance: R::of(f64::INFINITY), rate: R::zero() };
        if self.kernel == Kernel::SphereBox {
            self.update_least(&sphere_box(centre, self.radius, &self.cuboid), items, travel, &motion, &mut least);
        } else {
            let Self { half_length, radius, .. } = *self;
            let capsule = Segment { centre, axis: rotate(&rotation, self.axis), half_length, radius };
            let (points, exist) = capsule_box(&capsule, &self.cuboid);
            for (point, exist) in points.iter().zip(exist) {
                self.update_least(point, items.and(exist), travel, &motion, &mut least);
            }
        }
        least
    }

    /// Replaces `least` by the distance at `point` and its time derivative. The function does so in those of the items `items` in which the
    /// point can touch within two path durations and is closer than `least`.
    ///
    /// `travel` is an upper bound of the displacement in twice the path's duration, m. `motion` is the spatial velocity of the link of the
    /// ball or capsule at the point `reference`, rad/s and m/s.
    #[inline(always)]
    fn update_least(&self, point: &ContactPoint<R>, items: R::Mask, travel: R, motion: &V6<R>, least: &mut Gap<R>) {
        let distance = point.distance - self.margin;
        let near = items.and(distance.lt(travel + self.slack));
        if near.none() {
            return;
        }
        let velocity = velocity_at(motion, sub(point.pos, self.reference));
        let closing = (-dot(point.normal, sub(zero(), velocity))).max(R::zero());
        let nearer = near.and(distance.lt(closing * (self.time + self.time) + self.slack)).and(distance.lt(least.distance));
        let rate = R::zero() + dot(point.normal, velocity) * -R::one();
        least.distance = R::select(nearer, distance, least.distance);
        least.rate = R::select(nearer, rate, least.rate);
    }
}
