//! Narrow phase: computes the contact points of pairs of geoms, and adds them to the contacts. Pairs of simple shapes are computed in SIMD
//! lanes, others one lane after the other.

use std::borrow::Cow;

use stepper_geometry::pairs::{
    ContactPoint, Cuboid, Cylinder, Ellipsoid, Segment, capsule_box, cylinder_rims, face_clearance, plane_box, plane_ellipsoid,
    plane_sphere, segments, sphere_box, sphere_cylinder, sphere_ellipsoid,
};
use stepper_geometry::{Approach, BoundingBox, Pose, SearchLimits, SeparatingPlane, SeparatingPlanes, Solid};
use stepper_real::{Mask, Real, Scalar, kernel};

use crate::collision::contact_set::{ContactId, Contacts};
use crate::collision::detection::{NarrowWorkspace, Scene};
use crate::collision::joint_path::MAX_STRAIGHT_ROTATION;
use crate::compile::{CompiledPair, Kernel};
use crate::math::lanes::each_of;
use crate::math::spatial::*;

/// Tilt below which a steady cylinder may touch a plane with its whole end face; the sine of the angle between its axis and the normal.
/// A cylinder that stands on a plane tilts by less, except on soft surfaces, where it overlaps.
const MAX_UPRIGHT_TILT: f64 = 0.01;

/// Ratio of a cylinder's tilt to the change of the tilt in a step, below which all points of its rims may touch a plane.
///
/// Evidence: a disc that rolls on its rim (Euler's disc) gains 0.9 % of energy at 5 ms with a ratio of 2.
const MAX_TILT_RATIO: f64 = 8.0;

impl<R: Real> Scene<'_, R> {
    /// Finds the contacts of the pair `index` in the lanes `near`, and adds them to the contacts.
    ///
    /// The function is compiled separately. Inlined at each call, its many cases would take most of the build time.
    #[inline(never)]
    pub(crate) fn test_pair(
        &self,
        index: usize,
        pair: &CompiledPair<R::Scalar>,
        near: R::Mask,
        workspace: &mut NarrowWorkspace,
        contacts: &mut Contacts<R>,
    ) {
        kernel!(R, || {
            let ([a, b], poses, params) = (pair.geoms, self.poses, &self.compiled.params);
            let mut test = PairTest { scene: self, index, pair, contacts };
            let point = match pair.kernel {
                Kernel::PlaneSphere => plane_sphere(poses.pos[a], column(&poses.mat[a], 2), poses.pos[b], params.geom(b).size[0]),
                Kernel::PlaneEllipsoid => plane_ellipsoid(poses.pos[a], column(&poses.mat[a], 2), &self.ellipsoid(b)),
                Kernel::SphereCylinder => sphere_cylinder(poses.pos[a], params.geom(a).size[0], &self.cylinder(b)),
                Kernel::SphereEllipsoid => sphere_ellipsoid(poses.pos[a], params.geom(a).size[0], &self.ellipsoid(b)),
                Kernel::PlaneCapsule => return test.plane_capsule(near),
                Kernel::PlaneBox => return test.plane_box(near),
                Kernel::PlaneCylinder => return test.plane_cylinder(near),
                Kernel::SphereBox => return test.sphere_box(near),
                Kernel::CapsuleBox => return test.capsule_box(near),
                Kernel::Segments => return test.segments(near),
                Kernel::Convex | Kernel::Surface => return test.convex(near, workspace),
            };
            test.add(0, near, point);
        })
    }

    #[inline(always)]
    fn cuboid(&self, geom: usize) -> Cuboid<R> {
        Cuboid { centre: self.poses.pos[geom], mat: self.poses.mat[geom], half: self.compiled.params.geom(geom).size }
    }

    #[inline(always)]
    fn ellipsoid(&self, geom: usize) -> Ellipsoid<R> {
        Ellipsoid { centre: self.poses.pos[geom], mat: self.poses.mat[geom], radii: self.compiled.params.geom(geom).size }
    }

    #[inline(always)]
    fn cylinder(&self, geom: usize) -> Cylinder<R> {
        let [radius, half_length, _] = self.compiled.params.geom(geom).size;
        Cylinder { centre: self.poses.pos[geom], mat: self.poses.mat[geom], radius, half_length }
    }

    /// Solid (collision shape) of a geom, with the geom's size in the model. [`Scene::solid_in`] has the geom's size in one lane.
    #[inline(always)]
    fn solid(&self, geom: usize) -> &Solid {
        self.compiled.geoms[geom].solid.as_ref().expect("a solid for every geom of this kernel")
    }

    /// Solid (collision shape) of a geom, with its size in lane `lane`.
    #[inline(always)]
    pub(crate) fn solid_in(&self, geom: usize, lane: usize) -> Cow<'_, Solid> {
        let solid = self.solid(geom);
        solid.sized(of_lane(&self.compiled.params.geom(geom).size, lane)).map_or(Cow::Borrowed(solid), Cow::Owned)
    }

    /// Pose of a geom in lane `lane`, world axes.
    #[inline(always)]
    pub(crate) fn pose(&self, geom: usize, lane: usize) -> Pose {
        let (pos, mat) = (of_lane(&self.poses.pos[geom], lane), of_lane(&self.poses.mat[geom], lane));
        Pose::of_scalar::<R::Scalar>(pos, mat)
    }

    /// Lanes in which the bounding boxes of the two geoms of a pair are farther apart than `reach`, m.
    #[inline(always)]
    fn boxes_are_beyond(&self, pair: &CompiledPair<R::Scalar>, reach: R) -> R::Mask {
        let [a, b] = pair.geoms;
        let first = BoundingBox::new(self.solid(a), self.compiled.params.geom(a).size);
        let second = BoundingBox::new(self.solid(b), self.compiled.params.geom(b).size);
        let (Some(first), Some(second)) = (first, second) else { return R::Mask::splat(false) };
        let apart = sub(self.poses.pos[b], self.poses.pos[a]);
        first.is_beyond(&second, apart, [&self.poses.mat[a], &self.poses.mat[b]], reach)
    }

    /// Relative motion of the second geom of a pair in the first geom's frame during a step: displacement and rotation. The result is valid
    /// at all points where the geoms can have a contact with a gap of at most `reach`, m.
    #[inline(always)]
    fn approach(&self, pair: &CompiledPair<R::Scalar>, reach: R) -> Approach<R> {
        let [a, b] = pair.geoms;
        // A contact is halfway between the two geoms, at most half of `reach` from either. It is thus in both bounding balls, enlarged by
        // half of `reach`. The ball below contains the intersection of these two balls.
        let half = R::of(0.5) * reach;
        let (ra, rb) = (self.compiled.params.geom(a).bounding_radius + half, self.compiled.params.geom(b).bounding_radius + half);
        let apart = sub(self.poses.pos[b], self.poses.pos[a]);
        let length = norm(apart).max(R::of(1e-9));
        let from_a = (R::of(0.5) * (length + (ra * ra - rb * rb) / length)).max(R::zero()).min(length);
        let from_b = length - from_a;
        let radius = (ra * ra - from_a * from_a).min(rb * rb - from_b * from_b).max(R::zero()).sqrt();
        let centre = add_scaled(self.poses.pos[a], apart, from_a / length);
        self.approach_at(pair.geoms, centre, radius, R::splat(pair.margin))
    }

    /// Relative motion of the second geom in the first geom's frame during a step. The result is valid for contacts in the ball with the
    /// centre `centre` (world axes) and the radius `radius`, m. `margin` is the margin of the pair, m.
    #[inline(always)]
    pub(crate) fn approach_at(&self, geoms: [usize; 2], centre: V3<R>, radius: R, margin: R) -> Approach<R> {
        let mat = &self.poses.mat[geoms[0]];
        // The two values are computed one by one, because `map` of an array would not be inlined.
        let [angular_velocity, velocity] = self.relative_motion(&self.poses.search_velocity, geoms, centre);
        let [rotation, displacement] = [scale(rotate_back(mat, angular_velocity), self.h), scale(rotate_back(mat, velocity), self.h)];
        Approach { displacement, rotation, radius, slack: margin.max(R::zero()) + self.slack }
    }

    /// Segment and radius of a geom that is a ball or a capsule.
    #[inline(always)]
    pub(crate) fn segment(&self, geom: usize) -> Segment<R> {
        let [radius, half_length, _] = self.compiled.params.geom(geom).size;
        Segment { centre: self.poses.pos[geom], axis: column(&self.poses.mat[geom], 2), half_length, radius }
    }

    /// Speed at which the gap of a contact decreases at the velocity of the searches (`poses.search_velocity`), m/s. It is zero where the
    /// gap grows.
    #[inline(always)]
    pub(crate) fn closing_speed(&self, geoms: [usize; 2], point: &ContactPoint<R>) -> R {
        let [_, velocity] = self.relative_motion(&self.poses.search_velocity, geoms, point.pos);
        (-dot(point.normal, velocity)).max(R::zero())
    }
}

/// Pair of geoms in the narrow phase, and the contacts to which its points are added.
struct PairTest<'a, R: Real> {
    scene: &'a Scene<'a, R>,
    /// Index of the pair in the compiled model.
    index: usize,
    pair: &'a CompiledPair<R::Scalar>,
    contacts: &'a mut Contacts<R>,
}

impl<R: Real> PairTest<'_, R> {
    #[inline(always)]
    fn plane_capsule(&mut self, near: R::Mask) {
        let (scene, [a, b]) = (self.scene, self.pair.geoms);
        let capsule = scene.segment(b);
        let normal = column(&scene.poses.mat[a], 2);
        for end in 0..2 {
            let x = if end == 0 { capsule.half_length } else { -capsule.half_length };
            let centre = add_scaled(capsule.centre, capsule.axis, x);
            let point = plane_sphere(scene.poses.pos[a], normal, centre, capsule.radius);
            self.add(end, near, point);
        }
    }

    #[inline(always)]
    fn plane_box(&mut self, near: R::Mask) {
        let (scene, [a, b]) = (self.scene, self.pair.geoms);
        let half = scene.compiled.params.geom(b).size;
        let normal = column(&scene.poses.mat[a], 2);
        for corner in 0..8 {
            let point = plane_box(scene.poses.pos[a], normal, scene.poses.pos[b], &scene.poses.mat[b], half, corner);
            self.add(corner as u32, near, point);
        }
    }

    #[inline(always)]
    fn plane_cylinder(&mut self, near: R::Mask) {
        let (scene, [a, b]) = (self.scene, self.pair.geoms);
        let normal = column(&scene.poses.mat[a], 2);
        let frame = scene.compiled.geoms[b].frame;
        // Change of the plane's normal within the step, in the frame of the rotating cylinder. `cylinder_rims` finds the points of the rim
        // toward which the cylinder tips. Spin about the cylinder's axis does not tip it. A fast rotation tips it over all points.
        let (mut normal_change, mut tips) = (zero(), R::zero());
        let axis = column(&scene.poses.mat[b], 2);
        if (1..=scene.compiled.links.len()).contains(&frame) {
            let spin = angular(&scene.poses.search_velocity[frame - 1]);
            let rotation = scale(add_scaled(spin, axis, -dot(axis, spin)), scene.h);
            tips = norm(rotation);
            let is_slow = tips.le(R::of(MAX_STRAIGHT_ROTATION));
            normal_change = select(is_slow, cross(normal, rotation), normal_change);
        }
        // Only the lowest point of a rim can touch, unless an end face may soon lie on the plane. The other points of a rolling wheel move
        // towards the plane, but its surface does not.
        let upright = norm(cross(normal, axis)).le(tips * R::of(MAX_TILT_RATIO) + R::of(MAX_UPRIGHT_TILT));
        for (k, &rim) in cylinder_rims(normal, normal_change, &scene.cylinder(b)).iter().enumerate() {
            let point = plane_sphere(scene.poses.pos[a], normal, rim, R::zero());
            let near = if k % 4 == 0 { near } else { near.and(upright.or(point.distance.lt(R::zero()))) };
            self.add(k as u32, near, point);
        }
    }

    #[inline(always)]
    fn sphere_box(&mut self, near: R::Mask) {
        let (scene, [a, b]) = (self.scene, self.pair.geoms);
        let cuboid = scene.cuboid(b);
        let point = sphere_box(scene.poses.pos[a], scene.compiled.params.geom(a).size[0], &cuboid);
        let over_face = self.stays_over_face(&point, face_clearance(scene.poses.pos[a], &cuboid));
        self.store_point(0, near, over_face, point);
    }

    /// Lanes in which the ball, the first geom of the pair, stays over one face of the box, the second geom, during two steps. In these
    /// lanes the normal of the contact `point` stays that of the face.
    ///
    /// `clearance` is the distance of the ball's centre from the border of the face, m, see [`face_clearance`].
    #[inline(always)]
    fn stays_over_face(&self, point: &ContactPoint<R>, clearance: R) -> R::Mask {
        let (scene, geoms) = (self.scene, self.pair.geoms);
        let [_, velocity] = scene.relative_motion(&scene.poses.search_velocity, geoms, scene.poses.pos[geoms[0]]);
        let along = dot(velocity, point.normal);
        let displacement = (dot(velocity, velocity) - along * along).max(R::zero()).sqrt() * (scene.h + scene.h);
        displacement.lt(clearance)
    }

    #[inline(always)]
    fn capsule_box(&mut self, near: R::Mask) {
        let (scene, [a, b]) = (self.scene, self.pair.geoms);
        let (points, exist) = capsule_box(&scene.segment(a), &scene.cuboid(b));
        self.add(0, near.and(exist[0]), points[0]);
        self.add(1, near.and(exist[1]), points[1]);
    }

    #[inline(always)]
    fn segments(&mut self, near: R::Mask) {
        let (scene, [a, b]) = (self.scene, self.pair.geoms);
        let (points, two) = segments(&scene.segment(a), &scene.segment(b));
        self.add(0, near, points[0]);
        let both = near.and(two);
        if both.any() {
            self.add(1, both, points[1]);
        }
    }

    /// Finds the contacts of a pair of solids (convex shapes, surfaces, half spaces) in the lanes `near`, one lane after the other, in f64.
    #[inline(always)]
    fn convex(&mut self, mut near: R::Mask, workspace: &mut NarrowWorkspace) {
        let (scene, pair, [a, b]) = (self.scene, self.pair, self.pair.geoms);
        // Lanes are excluded by cheap tests first: height above a surface of triangles, bounding boxes, separating planes of the last step.
        let (ground, margin) = (scene.surface_and_shape(pair), R::splat(pair.margin));
        if let Some((surface, geoms)) = ground {
            near = scene.may_meet_surface(surface, geoms, margin, near);
        }
        let reach = margin + scene.poses.search_displacement[a] + scene.poses.search_displacement[b] + scene.slack;
        near = near.and_not(scene.boxes_are_beyond(pair, reach));
        if near.none() {
            return;
        }
        let mut approach = ground.map(
            #[inline(always)]
            |(_, geoms)| scene.approach_to_surface(geoms, margin, reach),
        );
        if let Some(sizes) = Solid::sizes_for_plane([scene.solid(a), scene.solid(b)], scene.compiled.params.geom(a).size) {
            let moving = scene.approach(pair, reach);
            near = near.and_not(self.are_separated(near, &moving, sizes, workspace));
            approach = Some(moving);
        }
        for lane in each_of(near.bits()) {
            let poses = [scene.pose(a, lane), scene.pose(b, lane)];
            let (first, second) = (scene.solid_in(a, lane), scene.solid_in(b, lane));
            let NarrowWorkspace { narrow, last_planes, new_planes, last_entries } = &mut *workspace;
            let mut limits = SearchLimits::from(reach.lane(lane).to_f64());
            limits.epsilon = R::Scalar::EPSILON.to_f64();
            limits.touching = (margin + scene.slack).lane(lane).to_f64();
            limits.cached = last_planes.of(lane, self.index, &mut last_entries[lane]).map(SeparatingPlane::cached_normal);
            if let Some(moving) = &approach {
                limits.approach = Some(moving.lane(lane));
            }
            let found = narrow.collide([&first, &second], poses, limits);
            if let Some(separating_plane) = &found.separating_plane {
                new_planes.keep(lane, self.index, separating_plane);
            }
            for p in &found.points {
                let point = ContactPoint { distance: R::of(p.distance), pos: p.pos.map(R::of), normal: p.normal.map(R::of) };
                let own = R::Mask::from_bits(1 << lane);
                let over_face = if p.stays_over_face { own } else { R::Mask::splat(false) };
                self.store_point(p.feature, own, over_face, point);
            }
        }
    }

    /// Lanes of `near` in which the separating plane of the last step proves that the two solids of a pair have no contact that stage 3
    /// would add. The head of `approach.rs` in the geometry crate has the criterion. The function stores the planes of these lanes for the
    /// next step.
    ///
    /// `half` are the half sizes of a box as the first geom, m, and `size` is the sum of the bounding radii, see
    /// [`Solid::sizes_for_plane`].
    #[inline(always)]
    fn are_separated(&self, near: R::Mask, approach: &Approach<R>, (half, size): (V3<R>, R), workspace: &mut NarrowWorkspace) -> R::Mask {
        let (poses, index, [a, b]) = (self.scene.poses, self.index, self.pair.geoms);
        let NarrowWorkspace { last_planes, new_planes, last_entries, .. } = workspace;
        let mut planes = SeparatingPlanes::none();
        for lane in each_of(near.bits()) {
            if let Some(separating_plane) = last_planes.of(lane, index, &mut last_entries[lane]) {
                planes.set_lane(lane, separating_plane);
            }
        }
        let apart = sub(poses.pos[b], poses.pos[a]);
        let separated = near.and(planes.separated_lanes(half, apart, [&poses.mat[a], &poses.mat[b]], approach, size));
        for lane in each_of(separated.bits()) {
            if let Some(separating_plane) = last_planes.of(lane, index, &mut last_entries[lane]) {
                new_planes.keep(lane, index, separating_plane);
            }
        }
        separated
    }

    /// Adds `point` as a contact in those lanes of `near` in which its gap can close within two steps, see [`PairTest::store_point`].
    #[inline(always)]
    fn add(&mut self, feature: u32, near: R::Mask, point: ContactPoint<R>) {
        self.store_point(feature, near, R::Mask::splat(false), point);
    }

    /// Adds `point` as a contact in those lanes of `near` in which its gap can close within two steps. `feature` is the number of the
    /// contact within the pair, which stays the same from step to step.
    ///
    /// The gap is the distance of `point` minus the margin of the pair. The contact gets the pair's sliding friction and restitution.
    ///
    /// In the lanes `over_face`, a ball stays over a face of the other geom, see
    /// [`Slot::over_face`](crate::collision::contact_set::Slot::over_face). The function is compiled separately, as [`Scene::test_pair`]
    /// is.
    #[inline(never)]
    fn store_point(&mut self, feature: u32, near: R::Mask, over_face: R::Mask, mut point: ContactPoint<R>) {
        let Self { scene, index, pair, .. } = *self;
        kernel!(R, || {
            point.distance -= R::splat(pair.margin);
            // `search_displacement` is an upper bound of a geom's displacement in two steps. A larger gap than the sum below cannot close.
            let [a, b] = pair.geoms;
            let near = near.and(point.distance.lt(scene.poses.search_displacement[a] + scene.poses.search_displacement[b] + scene.slack));
            if near.none() {
                return;
            }
            let closing = scene.closing_speed(pair.geoms, &point);
            let can_touch = near.and(point.distance.lt(closing * (scene.h + scene.h) + scene.slack));
            let id = ContactId::new(index, feature);
            let params = scene.compiled.contact(index);
            self.contacts.push([can_touch, over_face].map(Mask::bits), id, &point, params.mu, params.restitution);
        })
    }
}
