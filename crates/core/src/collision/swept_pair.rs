//! Distance of a pair of geoms along its motion in a step, to find whether that motion closes the gap.
//!
//! A contact row constrains the nearest points at one pose along one normal. Bodies that pass each other at a small distance violate such a
//! row without touching. This module therefore moves the geoms along their paths and runs the narrow phase there.
//!
//! The signed distance of two convex shapes is a convex function of their relative translation (Boyd & Vandenberghe 2004, section 3.2.5).
//! The tangent of this function at a pose is a lower bound, and the sign of the slope tells on which side the minimum is. Rotation within a
//! step adds terms of second order.

use stepper_geometry::pairs::ContactPoint;
use stepper_real::{Mask, Real};

use crate::collision::contact_set::Contacts;
use crate::collision::detection::{GeomPoses, NarrowWorkspace, Scene};
use crate::compile::{CompiledPair, LaneModel};
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;

/// Largest number of contact points of a pair. Pairs with a surface reach it.
const MAX_PAIR_POINTS: usize = 16;

/// Largest number of poses on a path at which [`find_touch`] evaluates the distance. Newton and bisection steps usually need two to six.
const MAX_POSES: usize = 16;

/// Rotation of a body on its path above which the search is invalid, rad. [`find_touch`] then reports a touch.
pub(super) const MAX_ROTATION: f64 = 1.0;

/// Path of a pair: motion at constant velocity from the poses where contacts were found.
pub(crate) struct Path<'a, R: Real> {
    pub(crate) compiled: &'a LaneModel<R>,
    pub(crate) kinematics: &'a Kinematics<R>,
    /// Poses of the geoms at the start of the path.
    pub(crate) start: &'a GeomPoses<R>,
    /// Duration of the path, s.
    pub(crate) time: R,
    /// Distance by which the searches increase every search distance, m, see [`super::detection::CollisionWorkspace::slack`].
    pub(crate) slack: R,
    /// Index of the pair in the compiled model.
    pub(crate) index: usize,
    pub(crate) pair: CompiledPair<R::Scalar>,
}

/// Signed distance of a pair at its closest contact point, and its time derivative.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gap<R> {
    /// Signed distance, m. Infinite if the narrow phase finds no point.
    pub(crate) distance: R,
    /// Time derivative of the distance, m/s.
    pub(crate) rate: R,
}

/// Workspace for computing the distance of a pair along its path.
#[derive(Clone, Debug)]
pub(crate) struct SweptPair<R: Real> {
    /// Poses at the current time of the path, of the tested pair only. `search_velocity` has the velocities that determine the paths.
    pub(super) poses: GeomPoses<R>,
    narrow_phase: NarrowWorkspace,
    contacts: Contacts<R>,
}

impl<R: Real> SweptPair<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>) -> Self {
        Self {
            poses: GeomPoses::new(compiled),
            narrow_phase: NarrowWorkspace::new(compiled, R::LANES),
            contacts: Contacts::new(MAX_PAIR_POINTS),
        }
    }

    /// Sets the velocities of all links from the generalized velocity `v`. These velocities determine the paths.
    #[inline(always)]
    pub(crate) fn set_velocity(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R]) {
        kinematics.velocities(compiled, v, &mut self.poses.search_velocity);
    }

    /// Touch of the pair on its path in the lanes `lanes`, if there is one, see [`find_touch`]. `gap` has the distance and its rate at the
    /// start of the path. An overlap up to `tolerance`, m, is no touch.
    #[inline(always)]
    pub(crate) fn find_touch(&mut self, path: &Path<'_, R>, lanes: R::Mask, gap: Gap<R>, tolerance: R) -> Touch<R> {
        let rotates = self.exceeds_max_rotation(path);
        find_touch(
            gap,
            path.time,
            lanes,
            rotates,
            tolerance,
            #[inline(always)]
            |time, lanes| self.gap_at(path, time, lanes),
        )
    }

    /// Lanes in which a body of the pair rotates by more than [`MAX_ROTATION`] on the path.
    #[inline(always)]
    fn exceeds_max_rotation(&self, path: &Path<'_, R>) -> R::Mask {
        let mut far = R::Mask::splat(false);
        for geom in path.pair.geoms {
            if let Some([angular_velocity, _]) = self.poses.frame_motion(path, path.compiled.geoms[geom].frame) {
                far = far.or((norm(angular_velocity) * path.time).gt(R::of(MAX_ROTATION)));
            }
        }
        far
    }

    /// Distance of the two geoms of `path`, and its time derivative, in their poses at `time` seconds along the path. The distance is
    /// infinite in lanes in which the pair has no contact points, and outside the lanes `lanes`.
    #[inline(always)]
    pub(crate) fn gap_at(&mut self, path: &Path<'_, R>, time: R, lanes: R::Mask) -> Gap<R> {
        let Path { compiled, kinematics, slack, index, pair, .. } = *path;
        for geom in pair.geoms {
            self.place(path, geom, time);
        }
        let Self { poses, narrow_phase, contacts, .. } = self;
        contacts.clear();
        let scene = Scene { compiled, kinematics, poses, h: path.time, slack, passing_time: R::zero(), checks_passing: false };
        scene.test_pair(index, &pair, lanes, narrow_phase, contacts);
        narrow_phase.new_planes.clear();
        let mut least = Gap { distance: R::of(f64::INFINITY), rate: R::zero() };
        for k in 0..contacts.slots() {
            let point = &contacts.data[k].point;
            let exists = R::Mask::from_bits(contacts.lanes_of(k));
            let nearer = exists.and(point.distance.lt(least.distance));
            least.distance = R::select(nearer, point.distance, least.distance);
            least.rate = R::select(nearer, self.poses.normal_velocity(path, point, time), least.rate);
        }
        least
    }

    /// Sets the pose of a geom of the pair at `time` seconds along the path, and its `search_displacement`.
    #[inline(always)]
    fn place(&mut self, path: &Path<'_, R>, geom: usize, time: R) {
        let (start, kinematics) = (path.start, path.kinematics);
        let frame = path.compiled.geoms[geom].frame;
        let Some([angular_velocity, velocity]) = self.poses.frame_motion(path, frame) else {
            self.poses.pos[geom] = start.pos[geom];
            self.poses.mat[geom] = start.mat[geom];
            self.poses.search_displacement[geom] = R::zero();
            return;
        };
        let rotation = quat_to_mat(quat_exp(scale(angular_velocity, time)));
        let arm = rotate(&rotation, sub(start.pos[geom], kinematics.pos[frame]));
        self.poses.pos[geom] = add(add_scaled(kinematics.pos[frame], velocity, time), arm);
        self.poses.mat[geom] = mat_mul(&rotation, &start.mat[geom]);
        let reach = norm(arm) + path.compiled.params.bounding_radius(geom);
        let swing = R::select(norm(angular_velocity).gt(R::zero()), norm(angular_velocity) * reach, R::zero());
        self.poses.search_displacement[geom] = (norm(velocity) + swing) * (path.time + path.time);
    }
}

/// Result of [`find_touch`]: a pose on the path at which the geoms overlap by more than the tolerance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Touch<R: Real> {
    /// Lanes in which the search found such a pose, or in which a body rotates too far for the search. The other fields are meaningless
    /// elsewhere.
    pub(crate) lanes: R::Mask,
    /// Time along the path at which the geoms overlap, s. They may overlap earlier too. Where a body rotates too far for the search, it is
    /// the end of the path.
    pub(crate) time: R,
    /// Overlap of the geoms at `time`, m. Infinite where a body rotates too far for the search.
    pub(crate) overlap: R,
}

/// Searches a path of `end_time` seconds, in the lanes `lanes`, for a time at which the geoms overlap by more than `tolerance`, m.
///
/// `gap` has the distance and its rate at the start of the path; `gap_at` returns them at any time. In the lanes `rotates`, a body rotates
/// too far for the search, and the result is a touch.
#[inline(always)]
pub(crate) fn find_touch<R: Real>(
    gap: Gap<R>,
    end_time: R,
    lanes: R::Mask,
    rotates: R::Mask,
    tolerance: R,
    mut gap_at: impl FnMut(R, R::Mask) -> Gap<R>,
) -> Touch<R> {
    let end = gap_at(end_time, lanes);
    let (mut low, mut high, mut tangent) = (R::zero(), end_time, gap);
    let mut hits = lanes.and(end.distance.lt(-tolerance).or(rotates));
    // A distance that still decreases at the end of the path has its minimum there.
    let shrinks = end.distance.lt(R::of(f64::INFINITY)).and(end.rate.le(R::zero()));
    let mut open = lanes.and_not(hits).and_not(shrinks);
    let (mut at, mut overlap) = (high, R::select(rotates, R::of(f64::INFINITY), -end.distance));
    for _ in 0..MAX_POSES {
        open = open.and_not((tangent.distance + (high - low) * tangent.rate).ge(-tolerance));
        if open.none() {
            break;
        }
        let approaches = open.and(tangent.rate.lt(R::zero()));
        let touch = low - tangent.distance / R::select(approaches, tangent.rate, R::of(-1.0));
        let newton = approaches.and(tangent.distance.gt(tolerance)).and(touch.lt(high));
        let time = R::select(newton, touch, (low + high) * R::of(0.5));
        let here = gap_at(time, open);
        let deep = open.and(here.distance.lt(-tolerance));
        (hits, at, overlap) = (hits.or(deep), R::select(deep, time, at), R::select(deep, -here.distance, overlap));
        open = open.and_not(deep);
        let approaching = here.distance.lt(R::of(f64::INFINITY)).and(here.rate.lt(R::zero()));
        low = R::select(approaching, time, low);
        tangent.distance = R::select(approaching, here.distance, tangent.distance);
        tangent.rate = R::select(approaching, here.rate, tangent.rate);
        high = R::select(approaching, high, time);
    }
    Touch { lanes: hits, time: at, overlap }
}

impl<R: Real> GeomPoses<R> {
    /// Angular velocity of a frame, rad/s, and linear velocity of its origin, m/s, in world axes. `None` for the world.
    #[inline(always)]
    fn frame_motion(&self, path: &Path<'_, R>, frame: usize) -> Option<[V3<R>; 2]> {
        let Path { compiled, kinematics, .. } = *path;
        let (motion, origin) = match frame.checked_sub(compiled.links.len() + 1) {
            _ if frame == 0 => return None,
            Some(mocap) => (&kinematics.mocap_velocities[mocap], kinematics.pos[frame]),
            None => (&self.search_velocity[frame - 1], kinematics.origin[compiled.links[frame - 1].tree]),
        };
        Some([angular(motion), velocity_at(motion, sub(kinematics.pos[frame], origin))])
    }

    /// Time derivative of the distance at the contact point `point`, `time` seconds along the path, m/s.
    #[inline(always)]
    fn normal_velocity(&self, path: &Path<'_, R>, point: &ContactPoint<R>, time: R) -> R {
        let mut rate = R::zero();
        for (geom, sign) in path.pair.geoms.into_iter().zip([-R::one(), R::one()]) {
            let frame = path.compiled.geoms[geom].frame;
            if let Some([angular_velocity, velocity]) = self.frame_motion(path, frame) {
                let origin = add_scaled(path.kinematics.pos[frame], velocity, time);
                rate += dot(point.normal, add(velocity, cross(angular_velocity, sub(point.pos, origin)))) * sign;
            }
        }
        rate
    }
}
