//! Tunnelling check: finds the lanes in which the motion of a step may have carried one geom through another.

use stepper_geometry::{Narrow, Pose, Solid, SolidMotion};
use stepper_real::{Mask, Real, Scalar, kernel};

use crate::collision::detection::{CollisionWorkspace, GeomPoses, Scene};
use crate::collision::joint_path::across_symmetry;
use crate::compile::{CompiledJoint, CompiledPair, Kernel, LaneModel};
use crate::dynamics::kinematics::Kinematics;
use crate::math::lanes::each_of;
use crate::math::spatial::*;
use crate::model::JointKind;

/// Motion that the tunnelling check tests: motion at a constant velocity, which begins or ends at the poses where stage 3 found contacts.
#[derive(Clone, Copy, Debug)]
pub struct TestedMotion<'a, R: Real> {
    /// Generalized velocity of the motion.
    pub velocity: &'a [R],
    /// Whether `velocity` is the free velocity with which stage 3 found contacts.
    pub is_free: bool,
    /// Duration of the motion, s: the time step, or a part of it.
    pub time: R,
    /// Whether the poses where stage 3 found contacts are at the end of the motion, and not at its beginning.
    pub contacts_at_end: bool,
}

/// Lanes in which one geom may have passed through another in the tested motion.
///
/// A pair may pass if its relative displacement exceeds its tunnelling distance and its gap, and if the test of its path
/// ([`Narrow::may_pass`](stepper_geometry::Narrow::may_pass)) is positive. Contact rows stop the collisions that stage 3 finds. However, an
/// impulse may make a body faster than [`detect`](crate::stages::s03_detect::detect) assumed, or deflect it, and a body on a curved path
/// may miss its contact row.
#[inline(always)]
pub fn may_have_passed<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    motion: TestedMotion<'_, R>,
    alive: R::Mask,
    collision: &mut CollisionWorkspace<R>,
) -> R::Mask {
    if !compiled.can_tunnel {
        return R::Mask::splat(false);
    }
    let slack = collision.slack;
    if motion.is_free && collision.poses.moved_little(compiled, alive) {
        return R::Mask::splat(false);
    }
    let [moved, beyond_search] =
        kernel!(R, || collision.poses.find_large_displacements(compiled, kinematics, motion.velocity, motion.time, slack));
    if moved.and(alive).none() {
        return R::Mask::splat(false);
    }
    // If no geom moves farther than stage 3 assumed, the near pairs of stage 3 suffice. Otherwise all listed pairs are tested, and the
    // dynamic pairs are searched again.
    let within_search = beyond_search.and(alive).none();
    if !within_search && compiled.dynamic_pairs.is_some() {
        collision.find_static(compiled, alive, false, |poses| &poses.passing_displacement);
        collision.find_dynamic(compiled, alive, |poses| &poses.passing_displacement);
    }
    let CollisionWorkspace { poses, near, near_count, broad, narrow_phase, .. } = collision;
    let scene = Scene { compiled, kinematics, poses, h: motion.time, slack, passing_time: motion.time, checks_passing: false };
    let paths = PathEnds { scene, contacts_at_end: motion.contacts_at_end };
    kernel!(R, || {
        let mut passed = R::Mask::splat(false);
        if within_search {
            for &(index, _) in &near[..*near_count] {
                passed = paths.test(&compiled.pairs[index as usize], alive, passed, &mut narrow_phase.narrow);
            }
        } else {
            for pair in &compiled.pairs {
                passed = paths.test(pair, alive, passed, &mut narrow_phase.narrow);
            }
        }
        if let Some(dynamic_pairs) = &compiled.dynamic_pairs {
            for pair in broad.pairs.iter().filter_map(|p| dynamic_pairs.pair(p.0 as usize)) {
                passed = paths.test(&pair, alive, passed, &mut narrow_phase.narrow);
            }
        }
        passed
    })
}

/// Relative displacement below which neither geom of a pair can pass through the other, m. It is the tunnelling distance of the pair, or
/// four times this distance for a height field.
///
/// A height field is solid. On a shorter path through a bump, the inscribed ball of the other geom is in the ground at one end of the path.
/// Contacts then push the geom out.
#[inline(always)]
fn min_displacement<R: Real>(compiled: &LaneModel<R>, pair: &CompiledPair<R::Scalar>) -> R {
    let is_field = |&g: &usize| compiled.geoms[g].solid.as_ref().is_some_and(Solid::is_field);
    let distance = compiled.tunnelling_distance(pair.geoms);
    if pair.kernel == Kernel::Surface && pair.geoms.iter().any(is_field) { distance * R::of(4.0) } else { distance }
}

/// Geoms at the poses where contacts were found, which are at the beginning or at the end of the tested motion.
struct PathEnds<'a, R: Real> {
    scene: Scene<'a, R>,
    /// Whether the poses are at the end of the tested motion, see [`TestedMotion::contacts_at_end`].
    contacts_at_end: bool,
}

impl<R: Real> PathEnds<'_, R> {
    /// Union of the lanes `passed`, and the lanes of `alive` in which one geom of the pair may pass through the other.
    #[inline(always)]
    fn test(&self, pair: &CompiledPair<R::Scalar>, alive: R::Mask, passed: R::Mask, narrow: &mut Narrow) -> R::Mask {
        let suspected = self.scene.poses.may_get_past(self.scene.compiled, pair).and(alive).and_not(passed);
        if suspected.none() {
            return passed;
        }
        let suspected = suspected.and(self.exceed_gap(pair, suspected, narrow));
        if suspected.any() { passed.or(self.test_path(pair.geoms, suspected, narrow)) } else { passed }
    }

    /// Lanes of `lanes` in which the relative displacement of the pair exceeds its gap and the displacement that it needs to pass
    /// ([`min_displacement`]).
    ///
    /// This excludes limbs that move together, which have a small relative displacement.
    #[inline(always)]
    fn exceed_gap(&self, pair: &CompiledPair<R::Scalar>, lanes: R::Mask, narrow: &mut Narrow) -> R::Mask {
        let (scene, [a, b]) = (&self.scene, pair.geoms);
        let needed = min_displacement(scene.compiled, pair);
        let deviations = scene.poses.arc_deviation(scene.compiled, a, scene.h) + scene.poses.arc_deviation(scene.compiled, b, scene.h);
        let (far, displacement) = scene.exceeding_displacement(pair.geoms, lanes, needed - deviations);
        if far.none() {
            return far;
        }
        let displacement = displacement + deviations;
        far.and(displacement.gt(scene.gap(pair, far, displacement, narrow)))
    }

    /// Lanes of `suspected` in which the geoms `a` and `b` may pass through each other on their paths. The function tests lane after lane,
    /// in f64.
    #[inline(never)]
    fn test_path(&self, [a, b]: [usize; 2], suspected: R::Mask, narrow: &mut Narrow) -> R::Mask {
        let mut passed = R::Mask::splat(false);
        if [a, b].iter().any(|&g| self.scene.compiled.geoms[g].solid.is_none()) {
            return passed;
        }
        let distance = self.scene.compiled.tunnelling_distance([a, b]);
        for lane in each_of(suspected.bits()) {
            let (first, second) = (self.scene.solid_in(a, lane), self.scene.solid_in(b, lane));
            let motions = [self.motion_of(a, lane), self.motion_of(b, lane)];
            let h = self.scene.h.lane(lane).to_f64();
            let times = if self.contacts_at_end { [-h, 0.0] } else { [0.0, h] };
            let thickness = (distance.lane(lane).to_f64()).max(self.scene.slack.lane(lane).to_f64());
            if narrow.may_pass([&first, &second], motions, times, thickness) {
                passed = passed.or(R::Mask::from_bits(1 << lane));
            }
        }
        passed
    }

    /// Tested motion of a geom in lane `lane`.
    fn motion_of(&self, geom: usize, lane: usize) -> SolidMotion {
        let Scene { compiled, kinematics, poses, .. } = self.scene;
        let own = &compiled.geoms[geom];
        let (pos, mut mat) = (of_lane(&poses.pos[geom], lane), of_lane(&poses.mat[geom], lane));
        if !own.full_orientation {
            // Of the matrix, only the z axis is current. The geom is round, so that any two perpendicular axes complete it.
            let [z, x, y] = contact_frame(column(&mat, 2));
            mat = [x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]];
        }
        let pos_of_geom = poses.pos[geom];
        let [angular, root_velocity, linear] = kernel!(R, || match own.frame.checked_sub(compiled.links.len() + 1) {
            _ if own.frame == 0 => [zero(); 3],
            Some(mocap) => {
                let motion = &kinematics.mocap_velocities[mocap];
                [angular(motion), linear(motion), cross(angular(motion), sub(pos_of_geom, kinematics.pos[own.frame]))]
            }
            None => {
                let (motion, tree) = (&poses.passing_velocity[own.frame - 1], compiled.links[own.frame - 1].tree);
                let root_velocity = self.velocity_of_root(tree);
                [angular(motion), root_velocity, sub(velocity_at(motion, sub(pos_of_geom, kinematics.origin[tree])), root_velocity)]
            }
        });
        let [angular, root_velocity, linear] = [angular, root_velocity, linear].map(|x: V3<R>| of_lane(&x, lane));
        let pose = Pose::of_scalar::<R::Scalar>(pos, mat);
        SolidMotion { pose, angular, root_velocity, linear }
    }

    /// Linear velocity of the root link of a kinematic tree, m/s. Zero if the first joint of the root link is neither free nor a slide.
    fn velocity_of_root(&self, tree: usize) -> V3<R> {
        let root = self.scene.compiled.links.iter().position(|link| link.is_root && link.tree == tree);
        let floats = |link: &usize| {
            let first = self.scene.compiled.links[*link].joints.start;
            matches!(self.scene.compiled.joints.get(first), Some(CompiledJoint { kind: JointKind::Free | JointKind::Slide, .. }))
        };
        root.filter(floats).map_or_else(zero, |link| linear(&self.scene.poses.passing_velocity[link]))
    }
}

impl<R: Real> GeomPoses<R> {
    /// Whether in the lanes `alive` no geom moves by more than half of its inscribed radius in a step at the free velocity.
    ///
    /// The test compares [`GeomPoses::search_displacement`], the displacement over two steps, with the whole inscribed radius.
    fn moved_little(&self, compiled: &LaneModel<R>, alive: R::Mask) -> bool {
        kernel!(R, || {
            let mut moved = R::Mask::splat(false);
            for &g in &compiled.moving_geoms {
                moved = moved.or(self.search_displacement[g].gt(compiled.params.geom(g).inscribed_radius));
            }
            moved.and(alive).none()
        })
    }

    /// Updates `passing_displacement` for `time` seconds at the velocity `v`, and `moved_far`. Returns two sets of lanes.
    ///
    /// In the first set, some geom moves by more than half of its inscribed radius; in other lanes no pair can pass. In the second set,
    /// some geom moves farther than stage 3 assumed in its search for pairs.
    #[inline(always)]
    fn find_large_displacements(
        &mut self,
        compiled: &LaneModel<R>,
        kinematics: &Kinematics<R>,
        v: &[R],
        time: R,
        slack: R,
    ) -> [R::Mask; 2] {
        self.update_passing_displacement(compiled, kinematics, v, time);
        let [mut any, mut beyond_search] = [R::Mask::splat(false); 2];
        let half = R::of(0.5);
        for &g in &compiled.moving_geoms {
            let displacement = self.passing_displacement[g];
            let moved = displacement.gt(compiled.params.geom(g).inscribed_radius * half);
            self.moved_far[g] = moved.any();
            any = any.or(moved);
            beyond_search = beyond_search.or(displacement.gt(self.search_displacement[g] + slack * half));
        }
        [any, beyond_search]
    }

    /// Lanes in which one geom of a pair may pass through the other, by upper bounds of their displacements. The function does not test
    /// their paths.
    #[inline(always)]
    fn may_get_past(&self, compiled: &LaneModel<R>, pair: &CompiledPair<R::Scalar>) -> R::Mask {
        let [a, b] = pair.geoms;
        if !(self.moved_far[a] || self.moved_far[b]) {
            return R::Mask::splat(false);
        }
        let displacement = self.passing_displacement[a] + self.passing_displacement[b];
        let far = displacement.gt(min_displacement(compiled, pair));
        if far.none() {
            return far;
        }
        let reach = compiled.reach(pair.geoms) + R::splat(pair.margin) + displacement;
        let offset = sub(self.pos[b], self.pos[a]);
        far.and(dot(offset, offset).lt(reach * reach))
    }

    /// Upper bound of the distance by which rotation about the geom's centre moves points of a geom from the tangents of their paths, m.
    /// The rotation lasts `h` seconds. The bound is half the square of the rotation angle, times the lever arm. It is zero for geoms that
    /// are fixed to the world or to a mocap body.
    #[inline(always)]
    fn arc_deviation(&self, compiled: &LaneModel<R>, geom: usize, h: R) -> R {
        let g = &compiled.geoms[geom];
        if g.frame == 0 || g.frame > compiled.links.len() {
            return R::zero();
        }
        let w = across_symmetry(compiled, geom, &self.mat[geom], angular(&self.passing_velocity[g.frame - 1]));
        w * w * h * h * R::of(0.5) * compiled.params.geom(geom).rotation_reach
    }
}
