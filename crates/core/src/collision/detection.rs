//! Collision detection of a step: poses of the geoms, near pairs, and the contacts of a pair.

use std::ops::Range;

use stepper_geometry::Narrow;
use stepper_geometry::pairs::segments;
use stepper_real::{Mask, Real, Scalar, kernel};

use crate::collision::broad_phase::Broad;
use crate::collision::contact_reduction::ContactReduction;
use crate::collision::contact_set::Contacts;
use crate::collision::joint_path::across_symmetry;
use crate::collision::separation_cache::SeparationCache;
use crate::collision::static_search::{StaticSearch, merge};
use crate::compile::{ADHESION_REACH, CompiledPair, Kernel, LaneModel, ModelStructure};
use crate::dynamics::kinematics::Kinematics;
use crate::math::lanes::MAX_LANES;
use crate::math::spatial::*;

/// Workspace of collision detection for a group of environments: poses of the colliding geoms, pairs that can touch, and buffers of the
/// searches.
#[derive(Clone, Debug)]
pub struct CollisionWorkspace<R: Real> {
    pub(crate) poses: GeomPoses<R>,
    /// Distance by which every search distance is increased, m ([`slack`]).
    pub(crate) slack: R,
    /// Ranges of consecutive listed pairs with the same first geom and margin, as indices in the compiled model's list of pairs. Static
    /// pairs are not included.
    pub(crate) runs: Vec<Range<usize>>,
    /// Near listed pairs, ascending: index of the pair, and lanes (bits) in which its bounding volumes overlap. Only the first `near_count`
    /// entries are in use.
    pub(crate) near: Vec<(u32, u32)>,
    /// Number of used entries of `near`.
    pub(crate) near_count: usize,
    /// Broad phase of the dynamic pairs.
    pub(crate) broad: Broad,
    /// Broad phase of the static pairs, which are listed or dynamic pairs.
    pub(crate) statics: StaticSearch<R>,
    /// For each geom, whether it may have passed through the thinnest static geom since the beginning of the step, in any lane.
    may_tunnel: Vec<bool>,
    /// Lanes in which the contacts of each mechanism are unreliable, because its geoms have moved too far since the beginning of the step.
    pub(crate) unreliable: Vec<R::Mask>,
    /// Workspace of the narrow phase.
    pub(crate) narrow_phase: NarrowWorkspace,
    pub(crate) reduction: ContactReduction,
}

/// Ranges of [`CollisionWorkspace::runs`].
fn runs<S: Scalar>(compiled: &ModelStructure<S>) -> Vec<Range<usize>> {
    let key = |i: usize| (compiled.pairs[i].geoms[0], compiled.pairs[i].margin);
    let mut runs: Vec<Range<usize>> = vec![];
    for i in (0..compiled.pairs.len()).filter(|&i| !compiled.static_pairs.listed[i]) {
        match runs.last_mut().filter(|run| run.end == i && key(run.start) == key(i)) {
            Some(run) => run.end += 1,
            None => runs.push(i..i + 1),
        }
    }
    runs
}

/// Poses of the geoms in world axes, and upper bounds of their displacements.
#[derive(Clone, Debug)]
pub(crate) struct GeomPoses<R: Real> {
    pub(crate) pos: Vec<V3<R>>,
    /// Orientation matrix of each geom. If `full_orientation` of a moving geom is false, only the z axis is current.
    pub(crate) mat: Vec<M3<R>>,
    /// Upper bound of the displacement of any point of each geom during two time steps at `search_velocity`, m. The searches for contacts
    /// use it. In a test of a pair's path ([`SweptPair`](crate::collision::swept_pair::SweptPair)), the bound is for twice the duration
    /// of the path.
    pub(crate) search_displacement: Vec<R>,
    /// Upper bound of the displacement of any point of each geom during [`Scene::passing_time`], m. The tests whether geoms passed through
    /// each other use it.
    pub(crate) passing_displacement: Vec<R>,
    /// For each geom, a flag of the tunnelling check: whether the geom moves by more than half of its inscribed radius, in any lane.
    pub(crate) moved_far: Vec<bool>,
    /// Spatial velocities of the links, from which `passing_displacement` is computed.
    pub(crate) passing_velocity: Vec<V6<R>>,
    /// Ball that contains each geom during two time steps: centre in world axes and radius, m. For a plane, the radius is the bound of its
    /// displacement.
    pub(crate) balls: Vec<[R; 4]>,
    /// Spatial velocities of the links, from which `search_displacement` is computed. In stage 3 they are those of the free velocity of
    /// the step. In a test of a pair's path (`SweptPair`) they are the velocities along the path.
    pub(crate) search_velocity: Vec<V6<R>>,
}

/// Workspace of the narrow phase, with the separating planes of the last step and of this one.
#[derive(Clone, Debug)]
pub(crate) struct NarrowWorkspace {
    pub(crate) narrow: Narrow,
    /// Separating planes that the last step stored. The searches of this step start from them.
    pub(crate) last_planes: SeparationCache,
    /// Separating planes that this step stores for the next step.
    pub(crate) new_planes: SeparationCache,
    /// Entry of `last_planes` that was used last, in each lane.
    pub(crate) last_entries: [usize; MAX_LANES],
}

impl NarrowWorkspace {
    /// Workspace for a compiled model and `lanes` lanes.
    pub(crate) fn new<S: Scalar>(compiled: &ModelStructure<S>, lanes: usize) -> Self {
        Self {
            narrow: Narrow::for_solids(compiled.geoms.iter().filter_map(|g| g.solid.as_ref())),
            last_planes: SeparationCache::new(compiled, lanes),
            new_planes: SeparationCache::new(compiled, lanes),
            last_entries: [0; MAX_LANES],
        }
    }

    /// Begins a step: exchanges `last_planes` and `new_planes`. The planes that the last step stored are then in `last_planes`.
    pub(crate) fn begin_step(&mut self) {
        std::mem::swap(&mut self.last_planes, &mut self.new_planes);
    }
}

impl<R: Real> CollisionWorkspace<R> {
    /// Workspace for a compiled model. Geoms that are fixed to the world get the poses of the model.
    pub fn new(compiled: &LaneModel<R>) -> Self {
        let mut workspace = Self {
            poses: GeomPoses::new(compiled),
            statics: StaticSearch::new(compiled),
            may_tunnel: vec![false; compiled.geoms.len()],
            slack: R::zero(),
            runs: runs(compiled),
            near: vec![(0, 0); compiled.pairs.len() + 1],
            near_count: 0,
            broad: Broad::default(),
            unreliable: vec![R::Mask::splat(false); compiled.mechanisms.count],
            reduction: ContactReduction::default(),
            narrow_phase: NarrowWorkspace::new(compiled, R::LANES),
        };
        workspace.update_static_poses(compiled);
        workspace
    }

    /// Swaps the separating planes of the workspace with those in the state of a group, before and after the group's steps.
    pub(crate) fn swap_separation_cache(&mut self, separation_cache: &mut SeparationCache) {
        if !separation_cache.is_unused() {
            std::mem::swap(&mut self.narrow_phase.new_planes, separation_cache);
        }
    }

    /// Removes all separating planes, so that no search depends on an earlier one.
    pub(crate) fn forget_planes(&mut self) {
        let NarrowWorkspace { last_planes, new_planes, .. } = &mut self.narrow_phase;
        [last_planes, new_planes].into_iter().for_each(SeparationCache::clear);
    }

    /// Updates the positions of geoms that are fixed to the world, which may differ between environments. Also updates their bounding
    /// balls, and the tree over the static geoms.
    pub(crate) fn update_static_poses(&mut self, compiled: &LaneModel<R>) {
        for (i, _) in compiled.geoms.iter().enumerate().filter(|(_, g)| g.frame == 0) {
            self.poses.pos[i] = compiled.params.geom(i).pos;
            self.poses.update_ball(compiled, i);
        }
        self.statics.update_tree(compiled, &self.poses.pos, &self.poses.mat);
    }

    /// Finds the static pairs (a moving geom and one fixed to the world, both bounded and convex) whose bounding boxes overlap in any of
    /// the lanes `alive`. The boxes of moving geoms are enlarged by their displacements.
    ///
    /// `displacements` returns the upper bound of the displacement of every geom, m. If `checks_passing` is true, for moving geoms that
    /// may have passed through a static geom, the function also finds the pairs with all static geoms whose bounding balls overlap
    /// theirs. Such a moving geom may be on the other side of the static geom now, so that their boxes need not overlap.
    pub(crate) fn find_static(
        &mut self,
        compiled: &LaneModel<R>,
        alive: R::Mask,
        checks_passing: bool,
        displacements: impl Fn(&GeomPoses<R>) -> &[R],
    ) {
        if !compiled.static_pairs.is_empty() {
            let Self { poses, statics, slack, may_tunnel, .. } = self;
            may_tunnel.fill(false);
            if checks_passing {
                kernel!(R, || {
                    for m in &compiled.static_pairs.moving {
                        may_tunnel[m.geom] = statics.may_tunnel(compiled, m.geom, poses.passing_displacement[m.geom]).and(alive).any();
                    }
                });
            }
            statics.find(compiled, alive.bits(), (&poses.pos, &poses.mat), |g| (displacements(poses)[g] + *slack, may_tunnel[g]));
            // For geoms that may tunnel, the search has used larger boxes. It has also found pairs whose bounding balls do not overlap.
            // Such pairs are removed here if they are listed, and in `find_contacts` of stage 3 if they are dynamic.
            if checks_passing {
                statics.pairs.retain_mut(|(index, lanes)| {
                    let pair = compiled.pairs.get(*index as usize).filter(|pair| pair.geoms.iter().any(|&g| may_tunnel[g]));
                    *lanes &= pair.map_or(u32::MAX, |pair| kernel!(R, || poses.balls_touch(pair, *slack).bits()));
                    *lanes != 0
                });
            }
        }
    }

    /// Merges the listed pairs that the search for static pairs ([`CollisionWorkspace::find_static`]) found into `near`.
    pub(crate) fn add_static(&mut self, compiled: &LaneModel<R>) {
        let [listed, _] = self.statics.listed_and_dynamic(compiled.pairs.len());
        merge(listed, &mut self.near, self.near_count);
        self.near_count += listed.len();
    }

    /// Finds the dynamic pairs that can touch in any of the lanes `alive`, and stores them in `broad`. [`CollisionWorkspace::find_static`]
    /// must be called before: the dynamic pairs among the static pairs that it found are added.
    ///
    /// `displacements` returns the upper bound of the displacement of every geom, m.
    pub(crate) fn find_dynamic(&mut self, compiled: &LaneModel<R>, alive: R::Mask, displacements: impl Fn(&GeomPoses<R>) -> &[R]) {
        if let Some(dynamic_pairs) = &compiled.dynamic_pairs {
            let Self { poses, slack, broad, statics, .. } = self;
            broad.find(compiled, dynamic_pairs, alive.bits(), &poses.pos, displacements(poses), *slack);
            broad.add(statics.listed_and_dynamic(compiled.pairs.len())[1]);
        }
    }

    /// Finds the listed pairs whose bounding balls overlap in any of the lanes `alive`, and writes them to `near` in ascending order. For a
    /// plane, the half space replaces its ball. Static pairs are not tested here, see [`CollisionWorkspace::add_static`].
    ///
    /// A robot has hundreds of listed pairs. To be fast, the loop over pairs has no branches, and values that the pairs of a geom share
    /// stay in registers.
    #[inline(always)]
    pub(crate) fn find_near(&mut self, compiled: &LaneModel<R>, alive: R::Mask) {
        let Self { poses: GeomPoses { balls, mat, .. }, slack, runs, near, .. } = self;
        let mut count = 0;
        for run in &*runs {
            let CompiledPair { geoms: [a, _], margin, .. } = compiled.pairs[run.start];
            let ([x, y, z, radius], is_plane, normal) = (balls[a], compiled.geoms[a].is_plane, column(&mat[a], 2));
            let (centre, reach) = ([x, y, z], radius + *slack + R::splat(margin));
            for (index, pair) in (run.start as u32..).zip(&compiled.pairs[run.clone()]) {
                let [x, y, z, radius] = balls[pair.geoms[1]];
                let (apart, reach) = (sub([x, y, z], centre), reach + radius);
                let touch = if is_plane { dot(apart, normal).lt(reach) } else { dot(apart, apart).lt(reach * reach) };
                let lanes = alive.and(touch).bits();
                // If no lane is near, the next pair overwrites the entry.
                near[count] = (index, lanes);
                count += usize::from(lanes != 0);
            }
        }
        self.near_count = count;
    }
}

impl<R: Real> GeomPoses<R> {
    pub(crate) fn new(compiled: &LaneModel<R>) -> Self {
        let zeros = || vec![R::zero(); compiled.geoms.len()];
        Self {
            pos: (0..compiled.geoms.len()).map(|g| compiled.params.geom(g).pos).collect(),
            mat: compiled.geoms.iter().map(|g| splat(g.mat)).collect(),
            search_displacement: zeros(),
            passing_displacement: zeros(),
            moved_far: vec![false; compiled.geoms.len()],
            passing_velocity: vec![zero(); compiled.links.len()],
            balls: vec![zero(); compiled.geoms.len()],
            search_velocity: vec![zero(); compiled.links.len()],
        }
    }

    /// Updates the poses of geoms that are not fixed to the world.
    #[inline(always)]
    pub(crate) fn update_poses(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>) {
        for &i in &compiled.moving_geoms {
            let g = &compiled.geoms[i];
            let mat = &kinematics.mat[g.frame];
            self.pos[i] = kinematics.point(g.frame, compiled.params.geom(i).pos);
            if g.full_orientation {
                self.mat[i] = mat_mul(mat, &splat(g.mat));
            } else {
                let z = rotate(mat, splat([g.mat[2], g.mat[5], g.mat[8]]));
                for k in 0..3 {
                    self.mat[i][3 * k + 2] = z[k];
                }
            }
        }
    }

    /// Updates the bounding balls for motion at the generalized velocity `v` during `time` seconds. Also updates `search_displacement` and
    /// `search_velocity`.
    #[inline(always)]
    pub(crate) fn update_search_displacement(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R], time: R) {
        kinematics.velocities(compiled, v, &mut self.search_velocity);
        displacement_bounds(compiled, kinematics, &self.pos, &self.search_velocity, time, &mut self.search_displacement);
        for &i in &compiled.moving_geoms {
            self.update_ball(compiled, i);
        }
    }

    /// Updates the bounding ball of geom `i` from its position and the bound of its displacement.
    #[inline(always)]
    fn update_ball(&mut self, compiled: &LaneModel<R>, i: usize) {
        let displacement = self.search_displacement[i];
        let radius = if compiled.geoms[i].is_plane { displacement } else { displacement + compiled.params.geom(i).bounding_radius };
        let [x, y, z] = self.pos[i];
        self.balls[i] = [x, y, z, radius];
    }

    /// Lanes in which the bounding balls of a pair overlap, when they are enlarged by the pair's margin and `slack`, m.
    #[inline(always)]
    pub(crate) fn balls_touch(&self, pair: &CompiledPair<R::Scalar>, slack: R) -> R::Mask {
        let [a, b] = pair.geoms;
        let apart = sub(self.pos[b], self.pos[a]);
        let reach = self.balls[a][3] + self.balls[b][3] + R::splat(pair.margin) + slack;
        dot(apart, apart).lt(reach * reach)
    }

    /// Updates `passing_displacement` and `passing_velocity`, for motion at the generalized velocity `v` during `time` seconds. The motion
    /// begins or ends at the stored poses.
    #[inline(always)]
    pub(crate) fn update_passing_displacement(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R], time: R) {
        kinematics.velocities(compiled, v, &mut self.passing_velocity);
        displacement_bounds(compiled, kinematics, &self.pos, &self.passing_velocity, time, &mut self.passing_displacement);
    }
}

/// Computes upper bounds of the displacement of any point of each moving geom during `time` seconds, m. `velocity` has the spatial
/// velocities of the links, and `out` receives the bounds.
#[inline(always)]
fn displacement_bounds<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    pos: &[V3<R>],
    velocity: &[V6<R>],
    time: R,
    out: &mut [R],
) {
    for &i in &compiled.moving_geoms {
        let g = &compiled.geoms[i];
        if g.frame <= compiled.links.len() {
            let motion = velocity[g.frame - 1];
            let arm = sub(pos[i], kinematics.origin[compiled.links[g.frame - 1].tree]);
            out[i] = (norm(velocity_at(&motion, arm)) + norm(angular(&motion)) * compiled.params.geom(i).bounding_radius) * time;
        } else {
            let motion = &kinematics.mocap_velocities[g.frame - compiled.links.len() - 1];
            // The bounding radius of a plane is infinite, and 0 * infinity must not become NaN.
            let spin = norm(angular(motion));
            let swing = R::select(spin.gt(R::zero()), spin * compiled.params.geom(i).bounding_radius, R::zero());
            out[i] = (norm(velocity_at(motion, sub(pos[i], kinematics.pos[g.frame]))) + swing) * time;
        }
    }
}

/// Distance by which every search distance is increased, m: the distance that gravity covers in a step, plus a micrometre for rounding.
///
/// With actuators that pull on contacts, the distance up to which they pull is added.
#[inline(always)]
pub(crate) fn slack<R: Real>(compiled: &LaneModel<R>, h: R) -> R {
    let slack = norm(compiled.params.gravity()) * h * h + R::of(1e-6);
    match &compiled.adhesion {
        Some(adhesion) => slack + R::splat(adhesion.largest) + R::of(ADHESION_REACH),
        None => slack,
    }
}

/// Geoms of all lanes at one time of the step, as input of the narrow phase.
pub(crate) struct Scene<'a, R: Real> {
    pub(crate) compiled: &'a LaneModel<R>,
    pub(crate) kinematics: &'a Kinematics<R>,
    pub(crate) poses: &'a GeomPoses<R>,
    /// Time step, s. In the test of a path (`SweptPair`) and in the tunnelling check, the duration of the tested motion.
    pub(crate) h: R,
    /// Distance by which every search distance is increased, m ([`slack`]).
    pub(crate) slack: R,
    /// Duration of the motion that `poses.passing_displacement` bounds, s. In stage 3 it is the time since the beginning of the step, in
    /// the tunnelling check the duration of the tested motion.
    pub(crate) passing_time: R,
    /// Whether [`Scene::collide`] finds the lanes in which geoms may have passed through each other within `passing_time`.
    pub(crate) checks_passing: bool,
}

impl<R: Real> Scene<'_, R> {
    /// Finds the contacts of a pair in the lanes `near`, and adds them to `contacts`.
    ///
    /// With `checks_passing`, returns the lanes in which the contacts are unreliable, because the geoms have moved too far since the
    /// beginning of the step. It adds these lanes to the entries of the two mechanisms in `unreliable`. Otherwise returns no lanes.
    #[inline(always)]
    pub(crate) fn collide(
        &self,
        index: usize,
        pair: &CompiledPair<R::Scalar>,
        near: R::Mask,
        workspace: &mut NarrowWorkspace,
        contacts: &mut Contacts<R>,
        unreliable: &mut [R::Mask],
    ) -> R::Mask {
        self.test_pair(index, pair, near, workspace, contacts);
        if !self.checks_passing {
            return R::Mask::splat(false);
        }
        let lanes = self.may_have_tunnelled(index, pair, near, &mut workspace.narrow, contacts);
        if lanes.any() {
            for mechanism in self.compiled.mechanisms_of(pair.geoms) {
                unreliable[mechanism] = unreliable[mechanism].or(lanes);
            }
        }
        lanes
    }

    /// Lanes of `near` in which the contacts of a pair are unreliable, because one geom may have passed through the other (tunnelled) since
    /// the beginning of the step.
    ///
    /// In these lanes, the geoms have moved farther relative to each other than the tunnelling distance of the pair
    /// ([`LaneModel::tunnelling_distance`]). In addition, they overlap, may have passed through each other, or one is a surface of
    /// triangles that the other hits.
    #[inline(always)]
    fn may_have_tunnelled(
        &self,
        index: usize,
        pair: &CompiledPair<R::Scalar>,
        near: R::Mask,
        narrow: &mut Narrow,
        contacts: &Contacts<R>,
    ) -> R::Mask {
        let [a, b] = pair.geoms;
        let distance = self.compiled.tunnelling_distance(pair.geoms);
        let far = near.and((self.poses.passing_displacement[a] + self.poses.passing_displacement[b]).gt(distance));
        if far.none() {
            return far;
        }
        let (far, displacement) = self.exceeding_displacement(pair.geoms, far, distance);
        if far.none() {
            return far;
        }
        // If the geoms passed through each other, their gap now is at most their displacement minus the part of it during which they
        // overlapped. The test assumes that this part is two tunnelling distances long, and misses grazing hits, for which it is shorter.
        let most = (displacement - (distance + distance)).max(R::zero());
        let passed = self.gap(pair, far, most, narrow).lt(most);
        far.and(passed.or(self.hits_surface(index, pair, far, contacts)))
    }

    /// Lower bound of the distance between the two geoms of a pair in the lanes `lanes`, m. If one geom is a surface, the result is at most
    /// `most`, because the search ends there.
    #[inline(always)]
    pub(crate) fn gap(&self, pair: &CompiledPair<R::Scalar>, lanes: R::Mask, most: R, narrow: &mut Narrow) -> R {
        let [a, b] = pair.geoms;
        match pair.kernel {
            Kernel::Segments => segments(&self.segment(a), &self.segment(b)).0[0].distance,
            Kernel::Surface => self.gap_to_surface(pair, lanes, most, narrow),
            _ => norm(sub(self.poses.pos[b], self.poses.pos[a])) - self.compiled.reach(pair.geoms),
        }
    }

    /// Lanes of `lanes` in which the relative displacement of two geoms during `passing_time` exceeds `least`, m, and the displacement
    /// there, m. Two geoms that move together, such as the limbs of a falling robot, have a small relative displacement.
    #[inline(always)]
    pub(crate) fn exceeding_displacement(&self, [a, b]: [usize; 2], lanes: R::Mask, least: R) -> (R::Mask, R) {
        let of_b = self.relative_displacement(a, b);
        let far = lanes.and(of_b.gt(least));
        if far.none() {
            return (far, of_b);
        }
        let displacement = of_b.min(self.relative_displacement(b, a));
        (far.and(displacement.gt(least)), displacement)
    }

    /// Upper bound of the displacement of the surface of geom `b` along its normal, relative to geom `a`, during `passing_time`, m. Neither
    /// geom may be a plane, whose displacement has no bound.
    #[inline(always)]
    fn relative_displacement(&self, a: usize, b: usize) -> R {
        let [angular_velocity, velocity] = self.relative_motion(&self.poses.passing_velocity, [a, b], self.poses.pos[b]);
        let spin = across_symmetry(self.compiled, b, &self.poses.mat[b], angular_velocity);
        (norm(velocity) + spin * self.compiled.params.geom(b).bounding_radius) * self.passing_time
    }

    /// Velocity of geom `b` relative to geom `a`, world axes: angular, rad/s, and linear at the point `p`, m/s. `links` has the spatial
    /// velocities of the links, such as those of the searches (`poses.search_velocity`).
    #[inline(always)]
    pub(crate) fn relative_motion(&self, links: &[V6<R>], [a, b]: [usize; 2], p: V3<R>) -> [V3<R>; 2] {
        let ([wa, va], [wb, vb]) = (self.motion_at(links, a, p), self.motion_at(links, b, p));
        [sub(wb, wa), sub(vb, va)]
    }

    /// Velocity of a geom, world axes: angular, rad/s, and linear at the point `p`, m/s. `links` has the spatial velocities of the links.
    #[inline(always)]
    pub(crate) fn motion_at(&self, links: &[V6<R>], geom: usize, p: V3<R>) -> [V3<R>; 2] {
        let frame = self.compiled.geoms[geom].frame;
        let (motion, origin) = match frame.checked_sub(self.compiled.links.len() + 1) {
            _ if frame == 0 => return [zero(); 2],
            Some(mocap) => (&self.kinematics.mocap_velocities[mocap], self.kinematics.pos[frame]),
            None => (&links[frame - 1], self.kinematics.origin[self.compiled.links[frame - 1].tree]),
        };
        [angular(motion), velocity_at(motion, sub(p, origin))]
    }
}
