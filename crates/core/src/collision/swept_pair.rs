//! Distance of a pair of geoms along its motion in a step, to find whether that motion closes the gap.
//!
//! A contact row constrains the nearest points at one pose along one normal. Bodies that pass each other at a small distance violate such a
//! row without touching. This module therefore moves the geoms along their paths and runs the narrow phase there.
//!
//! The signed distance of two convex shapes is a convex function of their relative translation (Boyd & Vandenberghe 2004, section 3.2.5).
//! The tangent of this function at a pose is a lower bound, and the sign of the slope tells on which side the minimum is. Rotation adds
//! terms of second order. A path with a large sweeping rotation ([`JointPath::sweeping_rotation`]) is therefore divided into parts, in each
//! of which the lower bound includes these terms.

use stepper_geometry::pairs::ContactPoint;
use stepper_real::{Mask, Real};

use crate::collision::contact_set::Contacts;
use crate::collision::detection::{GeomPoses, NarrowWorkspace, Scene};
use crate::collision::joint_path::{JointPath, MAX_STRAIGHT_ROTATION};
use crate::compile::{CompiledPair, LaneModel};
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;

/// Largest number of contact points of a pair. Pairs with a surface reach it.
const MAX_PAIR_POINTS: usize = 16;

/// Largest number of poses on a part of a path at which [`find_touch`] evaluates the distance. Newton and bisection steps usually need two
/// to six.
const MAX_POSES: usize = 16;

/// Sweeping rotation on a part of a path, rad. The chord of 0.5 rad deviates by 1/32 of the radius.
const PART_ROTATION: f64 = 0.5;

/// Largest number of parts of a path. If the sweeping rotation is larger than that of so many parts, [`SweptPair::find_touch`] reports a
/// touch.
const MAX_PARTS: usize = 128;

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

/// Rotation of the two bodies of a pair on its path.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Turning<R: Real> {
    /// Lanes in which a body rotates too far for a straight path: by more than [`MAX_STRAIGHT_ROTATION`]. Bodies of revolution that rotate
    /// about the origin of their frame, which is on their axis, do not count.
    pub(crate) lanes: R::Mask,
    /// Sum of the sweeping rotations of the geoms in the lanes `lanes`, rad; 0 in others.
    sweep: R,
    /// Upper bound of the second time derivative of the distance by the sweeping rotation, m/s^2.
    curvature: R,
}

impl<R: Real> Turning<R> {
    /// No rotation in any lane.
    #[inline(always)]
    pub(crate) fn none() -> Self {
        Self { lanes: R::Mask::splat(false), sweep: R::zero(), curvature: R::zero() }
    }
}

/// Workspace for computing the distance of a pair along its path.
#[derive(Clone, Debug)]
pub(crate) struct SweptPair<R: Real> {
    /// Poses at the current time of the path, of the tested pair only. `search_velocity` has the velocities of its links at this time.
    poses: GeomPoses<R>,
    /// Generalized velocity of the motion, which determines the paths.
    v: Vec<R>,
    /// Spatial velocities of all links at the start of the paths.
    pub(super) link_velocities: Vec<V6<R>>,
    narrow_phase: NarrowWorkspace,
    contacts: Contacts<R>,
}

impl<R: Real> SweptPair<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>) -> Self {
        Self {
            poses: GeomPoses::new(compiled),
            v: vec![R::zero(); compiled.nv],
            link_velocities: vec![zero(); compiled.links.len()],
            narrow_phase: NarrowWorkspace::new(compiled, R::LANES),
            contacts: Contacts::new(MAX_PAIR_POINTS),
        }
    }

    /// Sets the generalized velocity `v` of the motion. It determines the paths.
    #[inline(always)]
    pub(crate) fn set_velocity(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R]) {
        self.v.copy_from_slice(v);
        kinematics.velocities(compiled, v, &mut self.link_velocities);
    }

    /// Rotation of the two bodies on the path, in the lanes `lanes`.
    #[inline(always)]
    pub(crate) fn turning(&self, path: &Path<'_, R>, lanes: R::Mask) -> Turning<R> {
        let Path { compiled, kinematics, start, time, .. } = *path;
        let mut turning = Turning::<R>::none();
        for geom in path.pair.geoms {
            let frame = compiled.geoms[geom].frame;
            let Some([angular_velocity, _]) = self.frame_motion(path, frame) else { continue };
            let speed = norm(angular_velocity);
            let far = lanes.and((speed * time).gt(R::of(MAX_STRAIGHT_ROTATION)));
            if far.none() {
                continue;
            }
            let (sweep, is_single) = if frame > compiled.links.len() {
                (speed * time, false)
            } else {
                let joints = JointPath { compiled, kinematics, v: &self.v };
                let sweep = joints.sweeping_rotation(geom, frame - 1, start.pos[geom], &start.mat[geom], time);
                (sweep, JointPath::is_single(compiled, frame - 1))
            };
            let sweeps = far.and(sweep.gt(R::zero()));
            turning.lanes = turning.lanes.or(if is_single { sweeps } else { far });
            turning.sweep += R::select(sweeps, sweep, R::zero());
            let centre = compiled.links.get(frame - 1).map_or(kinematics.pos[frame], |link| kinematics.origin[link.tree]);
            let reach = norm(sub(start.pos[geom], centre)) + compiled.params.geom(geom).bounding_radius;
            turning.curvature += R::select(sweeps, (sweep / time).square() * reach, R::zero());
        }
        turning
    }

    /// Touch of the pair on its path in the lanes `lanes`, if there is one, see [`find_touch`]. `gap` has the distance and its rate at the
    /// start of the path. An overlap up to `tolerance`, m, is no touch.
    #[inline(always)]
    pub(crate) fn find_touch(&mut self, path: &Path<'_, R>, turning: &Turning<R>, lanes: R::Mask, gap: Gap<R>, tolerance: R) -> Touch<R> {
        let (zero, end) = (R::zero(), path.time);
        // Duration of a part.
        let divided = turning.sweep.gt(R::of(PART_ROTATION));
        let part = R::select(divided, end * (R::of(PART_ROTATION) / R::select(divided, turning.sweep, R::one())), end);
        let beyond = turning.sweep.gt(R::of(PART_ROTATION * MAX_PARTS as f64));
        let (mut touch, mut open, mut from, mut gap) = (Touch::none(end), lanes.and_not(beyond), zero, gap);
        for k in 1..=MAX_PARTS {
            let to = R::select(divided, (part * R::of(k as f64)).min(end), end);
            let (here, gap_at_end) = find_touch(
                gap,
                [from, to],
                open,
                turning.curvature,
                tolerance,
                #[inline(always)]
                |time, lanes| self.gap_at(path, turning.lanes, time, lanes),
            );
            touch.add(&here);
            open = open.and_not(here.lanes).and(to.lt(end));
            if open.none() {
                break;
            }
            (from, gap) = (to, gap_at_end);
        }
        touch.add(&Touch { lanes: lanes.and(beyond), time: end, overlap: R::of(f64::INFINITY) });
        touch
    }

    /// Distance of the two geoms of `path`, and its time derivative, in their poses at `time` seconds along the path. The distance is
    /// infinite in lanes in which the pair has no contact points, and outside the lanes `lanes`. `turning` are the lanes of
    /// [`Turning::lanes`].
    #[inline(always)]
    pub(crate) fn gap_at(&mut self, path: &Path<'_, R>, turning: R::Mask, time: R, lanes: R::Mask) -> Gap<R> {
        let Path { compiled, kinematics, slack, index, pair, .. } = *path;
        for geom in pair.geoms {
            self.place(path, geom, turning, time);
        }
        let Self { poses, narrow_phase, contacts, .. } = self;
        contacts.clear();
        let scene = Scene { compiled, kinematics, poses, h: path.time, slack, passing_time: R::zero(), checks_passing: false };
        scene.test_pair(index, &pair, lanes, narrow_phase, contacts);
        narrow_phase.new_planes.clear();
        let mut least = Gap { distance: R::of(f64::INFINITY), rate: R::zero() };
        for k in 0..self.contacts.slots() {
            let point = &self.contacts.data[k].point;
            let exists = R::Mask::from_bits(self.contacts.lanes_of(k));
            let nearer = exists.and(point.distance.lt(least.distance));
            least.distance = R::select(nearer, point.distance, least.distance);
            least.rate = R::select(nearer, self.normal_velocity(path, point, time), least.rate);
        }
        least
    }

    /// Sets the pose of a geom of the pair at `time` seconds along the path, its `search_displacement`, and the velocity of its link.
    #[inline(always)]
    fn place(&mut self, path: &Path<'_, R>, geom: usize, turning: R::Mask, time: R) {
        let Path { compiled, start, kinematics, .. } = *path;
        let frame = compiled.geoms[geom].frame;
        let Some([angular_velocity, velocity]) = self.frame_motion(path, frame) else {
            self.poses.pos[geom] = start.pos[geom];
            self.poses.mat[geom] = start.mat[geom];
            self.poses.search_displacement[geom] = R::zero();
            return;
        };
        let rotation = quat_to_mat(quat_exp(scale(angular_velocity, time)));
        let arm = rotate(&rotation, sub(start.pos[geom], kinematics.pos[frame]));
        let origin = add_scaled(kinematics.pos[frame], velocity, time);
        self.poses.pos[geom] = add(origin, arm);
        self.poses.mat[geom] = mat_mul(&rotation, &start.mat[geom]);
        if let Some(link) = compiled.links.get(frame - 1) {
            let field = velocity_field([angular_velocity, velocity], origin, kinematics.origin[link.tree]);
            self.poses.search_velocity[frame - 1] = field;
            if turning.any() {
                let moved = JointPath { compiled, kinematics, v: &self.v }.displace(frame - 1, (start.pos[geom], &start.mat[geom]), time);
                self.poses.pos[geom] = select(turning, moved.pos, self.poses.pos[geom]);
                self.poses.mat[geom] = select(turning, moved.mat, self.poses.mat[geom]);
                self.poses.search_velocity[frame - 1] = select(turning, moved.velocity, field);
            }
        }
        let reach = norm(arm) + compiled.params.geom(geom).bounding_radius;
        let swing = R::select(norm(angular_velocity).gt(R::zero()), norm(angular_velocity) * reach, R::zero());
        self.poses.search_displacement[geom] = (norm(velocity) + swing) * (path.time + path.time);
    }

    /// Angular velocity of a frame, rad/s, and linear velocity of its origin, m/s, in world axes, at the start of the path. `None` for the
    /// world.
    #[inline(always)]
    fn frame_motion(&self, path: &Path<'_, R>, frame: usize) -> Option<[V3<R>; 2]> {
        let Path { compiled, kinematics, .. } = *path;
        let (motion, origin) = match frame.checked_sub(compiled.links.len() + 1) {
            _ if frame == 0 => return None,
            Some(mocap) => (&kinematics.mocap_velocities[mocap], kinematics.pos[frame]),
            None => (&self.link_velocities[frame - 1], kinematics.origin[compiled.links[frame - 1].tree]),
        };
        Some([angular(motion), velocity_at(motion, sub(kinematics.pos[frame], origin))])
    }

    /// Time derivative of the distance at the contact point `point`, `time` seconds along the path, m/s.
    #[inline(always)]
    fn normal_velocity(&self, path: &Path<'_, R>, point: &ContactPoint<R>, time: R) -> R {
        let Path { compiled, kinematics, .. } = *path;
        let mut rate = R::zero();
        for (geom, sign) in path.pair.geoms.into_iter().zip([-R::one(), R::one()]) {
            let frame = compiled.geoms[geom].frame;
            let velocity = match compiled.links.get(frame.wrapping_sub(1)) {
                Some(link) => velocity_at(&self.poses.search_velocity[frame - 1], sub(point.pos, kinematics.origin[link.tree])),
                None => {
                    let Some([angular_velocity, velocity]) = self.frame_motion(path, frame) else { continue };
                    let origin = add_scaled(kinematics.pos[frame], velocity, time);
                    add(velocity, cross(angular_velocity, sub(point.pos, origin)))
                }
            };
            rate += dot(point.normal, velocity) * sign;
        }
        rate
    }
}

/// Spatial velocity, at the point `reference`, of a body with an angular velocity and the velocity of its point `origin`.
#[inline(always)]
pub(super) fn velocity_field<R: Real>([angular_velocity, velocity]: [V3<R>; 2], origin: V3<R>, reference: V3<R>) -> V6<R> {
    spatial(angular_velocity, add(velocity, cross(angular_velocity, sub(reference, origin))))
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

impl<R: Real> Touch<R> {
    /// No touch on a path of `time` seconds.
    #[inline(always)]
    fn none(time: R) -> Self {
        Self { lanes: R::Mask::splat(false), time, overlap: R::zero() }
    }

    /// Adds the lanes of `other`, with their times and overlaps.
    #[inline(always)]
    fn add(&mut self, other: &Self) {
        self.time = R::select(other.lanes, other.time, self.time);
        self.overlap = R::select(other.lanes, other.overlap, self.overlap);
        self.lanes = self.lanes.or(other.lanes);
    }
}

/// Searches the part `[from, to]` of a path, s, in the lanes `lanes`, for a time at which the geoms overlap by more than `tolerance`, m.
/// Returns the touch, and the distance and its rate at the end of the part.
///
/// `gap` has the distance and its rate at the start of the part; `gap_at` returns them at any time. `curvature` is an upper bound of the
/// second time derivative of the distance by rotation, m/s^2.
#[inline(always)]
pub(crate) fn find_touch<R: Real>(
    gap: Gap<R>,
    [from, to]: [R; 2],
    lanes: R::Mask,
    curvature: R,
    tolerance: R,
    mut gap_at: impl FnMut(R, R::Mask) -> Gap<R>,
) -> (Touch<R>, Gap<R>) {
    let end = gap_at(to, lanes);
    let (mut low, mut high, mut tangent) = (from, to, gap);
    let mut hits = lanes.and(end.distance.lt(-tolerance));
    // A distance that still decreases at the end of the path has its minimum there.
    let shrinks = end.distance.lt(R::of(f64::INFINITY)).and(end.rate.le(R::zero()));
    let mut open = lanes.and_not(hits).and_not(shrinks);
    let (mut at, mut overlap) = (high, -end.distance);
    for _ in 0..MAX_POSES {
        let rest = high - low;
        open = open.and_not((tangent.distance + rest * (tangent.rate - curvature * (rest * R::of(0.5)))).ge(-tolerance));
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
    (Touch { lanes: hits, time: at, overlap }, end)
}
