//! Stage 3: poses become contacts.
//!
//! A contact is taken up when it can touch within the step: its distance is below what the free velocity closes, with a margin of two, or
//! below what gravity covers in a step. So nothing has to overlap first in order to be felt.
//!
//! Fast bodies and thin ones: a gap that is seen at the beginning of a step is a row, however fast it closes, so a body stops before the wall.
//! Taken in the middle of the step the body may be beyond it already. Environments in which a pair gets that far in the first half of the step
//! are therefore taken at the beginning ([`detect`] returns them), and what can still slip through afterwards, because an impulse made it
//! faster than it was looked out for or because it turns too far for a straight row, is reported ([`may_have_passed`]).

mod passed;

use std::borrow::Cow;

use stepper_real::{Mask, Real, Scalar};

pub use self::passed::may_have_passed;
use crate::broad::Broad;
use crate::contacts::{ContactId, ContactPoint, Contacts};
use crate::geometry::convex::{Narrow, Pose, Reach};
use crate::geometry::{
    Cuboid, Cylinder, Ellipsoid, Segment, capsule_box, cylinder_rims, plane_box, plane_ellipsoid, plane_point, plane_sphere, segments,
    sphere_box, sphere_cylinder,
};
use crate::kinematics::Kinematics;
use crate::normals::Normals;
use crate::plan::{Kernel, LanePlan, PairPlan, Plan};
use crate::spatial::*;

/// Where the colliding geoms are and how far they can get.
#[derive(Clone, Debug)]
pub struct GeomPoses<R: Real> {
    pos: Vec<V3<R>>,
    /// Whole orientation; only its z axis is kept up where that is all that is read.
    mat: Vec<M3<R>>,
    /// Bound on the way of any point of the geom in two free steps, m.
    travel: Vec<R>,
    /// Bound on the way of any point of the geom from the beginning of the step to where it is taken, m.
    lead: Vec<R>,
    /// Which geoms went by half their thickness in any lane.
    fast: Vec<bool>,
    /// Velocities of the links on that way.
    led_by: Vec<V6<R>>,
    /// Radius of a ball about the geom's origin that holds it in two free steps, of a plane only its way, m.
    extent: Vec<R>,
    velocity: Vec<V6<R>>,
    broad: Broad,
    search: Search,
}

/// The narrow phase, and where it looks first.
#[derive(Clone, Debug, Default)]
struct Search {
    narrow: Narrow,
    normals: Normals,
}

impl<R: Real> GeomPoses<R> {
    /// Room for a plan; geoms of the world are placed where the model has them.
    pub fn new(plan: &Plan<R::Scalar>) -> Self {
        Self {
            pos: (0..plan.geoms.len()).map(|g| splat(plan.params.geom_pos(g))).collect(),
            mat: plan.geoms.iter().map(|g| splat(g.mat)).collect(),
            travel: vec![R::zero(); plan.geoms.len()],
            lead: vec![R::zero(); plan.geoms.len()],
            extent: vec![R::zero(); plan.geoms.len()],
            fast: vec![false; plan.geoms.len()],
            led_by: vec![zero(); plan.links.len()],
            velocity: vec![zero(); plan.links.len()],
            broad: Broad::default(),
            search: Search {
                narrow: Narrow::for_solids(plan.geoms.iter().filter_map(|g| g.solid.as_ref())),
                normals: Normals::new(plan, R::LANES),
            },
        }
    }

    /// Normals of hulls that are near one another.
    pub(crate) fn normals(&self) -> &Normals {
        &self.search.normals
    }

    /// Takes over the normals of the last step.
    pub(crate) fn recall(&mut self, normals: &Normals) {
        self.search.normals.copy_from(normals);
    }

    /// Places the geoms that are fixed to the world, where environments may have them elsewhere.
    pub(crate) fn settle(&mut self, plan: &LanePlan<R>) {
        for (i, _) in plan.geoms.iter().enumerate().filter(|(_, g)| g.frame == 0) {
            self.pos[i] = plan.params.geom_pos(i);
        }
    }

    /// Places the geoms that are not fixed to the world.
    #[inline(always)]
    fn place(&mut self, plan: &LanePlan<R>, kinematics: &Kinematics<R>) {
        for (i, g) in plan.geoms.iter().enumerate() {
            if g.frame == 0 {
                continue;
            }
            let mat = &kinematics.mat[g.frame];
            self.pos[i] = kinematics.point(g.frame, plan.params.geom_pos(i));
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

    /// Bounds on the ways of all geoms from where they are placed, with the velocity `v` of the joints; leaves the velocities of the links.
    #[inline(always)]
    fn update_travel(&mut self, plan: &LanePlan<R>, kinematics: &Kinematics<R>, v: &[R], time: R) {
        kinematics.velocities(plan, v, &mut self.velocity);
        ways(plan, kinematics, &self.pos, &self.velocity, time, &mut self.travel);
        for (i, g) in plan.geoms.iter().enumerate() {
            self.extent[i] = if g.is_plane { self.travel[i] } else { self.travel[i] + plan.params.bound(i) };
        }
    }

    /// The same of the way from the beginning of the step.
    #[inline(always)]
    fn update_lead(&mut self, plan: &LanePlan<R>, kinematics: &Kinematics<R>, v: &[R], time: R) {
        kinematics.velocities(plan, v, &mut self.led_by);
        ways(plan, kinematics, &self.pos, &self.led_by, time, &mut self.lead);
    }
}

/// Bound on the way of any point of each geom that is not fixed to the world, at the velocities of the links.
#[inline(always)]
fn ways<R: Real>(plan: &LanePlan<R>, kinematics: &Kinematics<R>, pos: &[V3<R>], velocity: &[V6<R>], time: R, out: &mut [R]) {
    for (i, g) in plan.geoms.iter().enumerate() {
        if g.frame != 0 && g.frame <= plan.links.len() {
            let motion = velocity[g.frame - 1];
            let arm = sub(pos[i], kinematics.origin[plan.links[g.frame - 1].tree]);
            out[i] = (norm(velocity_at(&motion, arm)) + norm(angular(&motion)) * plan.params.bound(i)) * time;
        } else if g.frame > plan.links.len() {
            let motion = &kinematics.posed[g.frame - plan.links.len() - 1];
            // A plane has no bound: 0 * infinity must not become NaN.
            let spin = norm(angular(motion));
            let swing = R::select(spin.gt(R::zero()), spin * plan.params.bound(i), R::zero());
            out[i] = (norm(velocity_at(motion, sub(pos[i], kinematics.pos[g.frame]))) + swing) * time;
        }
    }
}

/// Finds the contacts of the lanes `alive` at poses that are `lead` seconds from the beginning of the step. Returns the lanes whose contacts
/// cannot be trusted so far from it.
pub fn detect<R: Real>(
    plan: &LanePlan<R>,
    kinematics: &Kinematics<R>,
    [v, v_free]: [&[R]; 2],
    [h, lead]: [R; 2],
    alive: R::Mask,
    poses: &mut GeomPoses<R>,
    contacts: &mut Contacts<R>,
) -> R::Mask {
    contacts.clear();
    if plan.geoms.is_empty() {
        return R::Mask::splat(false);
    }
    let slack = slack(plan, h);
    let leads = plan.has_thin && lead.gt(R::zero()).any();
    R::vectorize(
        #[inline(always)]
        || {
            poses.place(plan, kinematics);
            if leads {
                poses.update_lead(plan, kinematics, v, lead);
            }
            poses.update_travel(plan, kinematics, v_free, h + h);
        },
    );
    let mut broad = std::mem::take(&mut poses.broad);
    if let Some(crowd) = &plan.crowd {
        broad.find(plan, crowd, alive.bits(), &poses.pos, &poses.travel, slack);
    }
    let too_far = R::vectorize(
        #[inline(always)]
        || {
            let mut search = std::mem::take(&mut poses.search);
            let scene = Scene { plan, kinematics, poses, h, slack, lead, leads };
            let mut too_far = R::Mask::splat(false);
            for (index, pair) in plan.pairs.iter().enumerate() {
                too_far = too_far.or(scene.collide(index, pair, alive, &mut search, contacts));
            }
            if let Some(crowd) = &plan.crowd {
                for &(number, lanes) in &broad.pairs {
                    if let Some(pair) = crowd.pair(number) {
                        too_far = too_far.or(scene.collide(number, &pair, R::Mask::from_bits(lanes), &mut search, contacts));
                    }
                }
            }
            poses.search = search;
            too_far
        },
    );
    poses.broad = broad;
    too_far
}

/// What gravity covers in a step, and a micrometre for scenes without it.
fn slack<R: Real>(plan: &LanePlan<R>, h: R) -> R {
    R::vectorize(
        #[inline(always)]
        || norm(plan.params.gravity()) * h * h + R::of(1e-6),
    )
}

struct Scene<'a, R: Real> {
    plan: &'a LanePlan<R>,
    kinematics: &'a Kinematics<R>,
    poses: &'a GeomPoses<R>,
    h: R,
    slack: R,
    lead: R,
    leads: bool,
}

impl<R: Real> Scene<'_, R> {
    /// Takes up the contacts of a pair in the lanes `alive`. Returns those that are too far from the beginning of the step.
    #[inline(always)]
    fn collide(
        &self,
        index: usize,
        pair: &PairPlan<R::Scalar>,
        alive: R::Mask,
        search: &mut Search,
        contacts: &mut Contacts<R>,
    ) -> R::Mask {
        let near = alive.and(self.can_touch(pair));
        if near.none() {
            return near;
        }
        self.meet(index, pair, near, search, contacts);
        if self.leads { near.and(self.leads_too_far(pair)) } else { R::Mask::splat(false) }
    }

    /// Takes up the contacts of a pair in the lanes `near`. A kernel of its own: inlined where it is called, it and what it offers would
    /// take most of the time of a build.
    #[inline(never)]
    fn meet(&self, index: usize, pair: &PairPlan<R::Scalar>, near: R::Mask, search: &mut Search, contacts: &mut Contacts<R>) {
        R::vectorize(
            #[inline(always)]
            || match pair.kernel {
                Kernel::PlaneSphere => self.plane_sphere(index, pair, near, contacts),
                Kernel::PlaneCapsule => self.plane_capsule(index, pair, near, contacts),
                Kernel::PlaneBox => self.plane_box(index, pair, near, contacts),
                Kernel::PlaneCylinder => self.plane_cylinder(index, pair, near, contacts),
                Kernel::PlaneEllipsoid => self.plane_ellipsoid(index, pair, near, contacts),
                Kernel::SphereBox => self.sphere_box(index, pair, near, contacts),
                Kernel::SphereCylinder => self.sphere_cylinder(index, pair, near, contacts),
                Kernel::CapsuleBox => self.capsule_box(index, pair, near, contacts),
                Kernel::Segments => self.segments(index, pair, near, contacts),
                Kernel::Convex | Kernel::Surface => self.convex(index, pair, near, search, contacts),
            },
        )
    }

    /// Lanes in which the bounding volumes of a pair can meet within the step.
    #[inline(always)]
    fn can_touch(&self, pair: &PairPlan<R::Scalar>) -> R::Mask {
        let [a, b] = pair.geoms;
        let apart = sub(self.poses.pos[b], self.poses.pos[a]);
        let reach = self.poses.extent[a] + self.poses.extent[b] + R::splat(pair.margin) + self.slack;
        match pair.kernel {
            _ if self.plan.geoms[a].is_plane => dot(apart, column(&self.poses.mat[a], 2)).lt(reach),
            _ => dot(apart, apart).lt(reach * reach),
        }
    }

    /// Lanes in which the way from the beginning of the step is long enough to be through: that of either geom as seen from the other.
    #[inline(always)]
    fn leads_too_far(&self, pair: &PairPlan<R::Scalar>) -> R::Mask {
        let [a, b] = pair.geoms;
        let thin = self.plan.thin(pair.geoms);
        let far = (self.poses.lead[a] + self.poses.lead[b]).gt(thin);
        if far.none() {
            return far;
        }
        // Limbs that fly along together are fast and yet do not pass one another, and what is apart again has gone the whole way through. (Where
        // that chord is shorter than this, a graze an eighth as deep as the two are thick is missed.)
        let gap = self.gap(pair);
        let through = R::select(gap.gt(R::zero()), gap + thin + thin, thin);
        far.and(self.way_past(a, b).min(self.way_past(b, a)).gt(through))
    }

    /// Lower bound on the distance of a pair that is thin, m.
    #[inline(always)]
    fn gap(&self, pair: &PairPlan<R::Scalar>) -> R {
        let [a, b] = pair.geoms;
        match pair.kernel {
            Kernel::Segments => segments(&self.segment(a), &self.segment(b)).0[0].distance,
            _ => norm(sub(self.poses.pos[b], self.poses.pos[a])) - self.plan.reach(pair.geoms),
        }
    }

    /// Bound on the way of any point of the geom `b`, as seen from `a`, from the beginning of the step, m.
    #[inline(always)]
    fn way_past(&self, a: usize, b: usize) -> R {
        let (there, here) =
            (self.motion_at(&self.poses.led_by, b, self.poses.pos[b]), self.motion_at(&self.poses.led_by, a, self.poses.pos[b]));
        let spin = norm(sub(there[0], here[0]));
        // A plane has no bound: 0 * infinity must not become NaN.
        let swing = R::select(spin.gt(R::zero()), spin * self.plan.params.bound(b), R::zero());
        (norm(sub(there[1], here[1])) + swing) * self.lead
    }

    /// Motion of a geom (angular, linear where it passes the point `p`) if the links have the velocities `links`.
    #[inline(always)]
    fn motion_at(&self, links: &[V6<R>], geom: usize, p: V3<R>) -> [V3<R>; 2] {
        let frame = self.plan.geoms[geom].frame;
        let (motion, origin) = match frame.checked_sub(self.plan.links.len() + 1) {
            _ if frame == 0 => return [zero(); 2],
            Some(mocap) => (&self.kinematics.posed[mocap], self.kinematics.pos[frame]),
            None => (&links[frame - 1], self.kinematics.origin[self.plan.links[frame - 1].tree]),
        };
        [angular(motion), velocity_at(motion, sub(p, origin))]
    }

    #[inline(always)]
    fn plane_sphere(&self, index: usize, pair: &PairPlan<R::Scalar>, near: R::Mask, contacts: &mut Contacts<R>) {
        let [a, b] = pair.geoms;
        let radius = self.plan.params.geom_size(b)[0];
        let point = plane_sphere(self.poses.pos[a], column(&self.poses.mat[a], 2), self.poses.pos[b], radius);
        self.offer(index, 0, pair, near, point, contacts);
    }

    #[inline(always)]
    fn plane_capsule(&self, index: usize, pair: &PairPlan<R::Scalar>, near: R::Mask, contacts: &mut Contacts<R>) {
        let [a, b] = pair.geoms;
        let capsule = self.segment(b);
        let normal = column(&self.poses.mat[a], 2);
        for end in 0..2 {
            let x = if end == 0 { capsule.half_length } else { -capsule.half_length };
            let centre = add_scaled(capsule.centre, capsule.axis, x);
            let point = plane_sphere(self.poses.pos[a], normal, centre, capsule.radius);
            self.offer(index, end, pair, near, point, contacts);
        }
    }

    #[inline(always)]
    fn plane_box(&self, index: usize, pair: &PairPlan<R::Scalar>, near: R::Mask, contacts: &mut Contacts<R>) {
        let [a, b] = pair.geoms;
        let half = self.plan.params.geom_size(b);
        let normal = column(&self.poses.mat[a], 2);
        for corner in 0..8 {
            let point = plane_box(self.poses.pos[a], normal, self.poses.pos[b], &self.poses.mat[b], half, corner);
            self.offer(index, corner as u32, pair, near, point, contacts);
        }
    }

    #[inline(always)]
    fn plane_cylinder(&self, index: usize, pair: &PairPlan<R::Scalar>, near: R::Mask, contacts: &mut Contacts<R>) {
        let [a, b] = pair.geoms;
        let normal = column(&self.poses.mat[a], 2);
        let frame = self.plan.geoms[b].frame;
        let links = 1..=self.plan.links.len();
        let tip = if links.contains(&frame) { scale(cross(normal, angular(&self.poses.velocity[frame - 1])), self.h) } else { zero() };
        for (k, &rim) in cylinder_rims(normal, tip, &self.cylinder(b)).iter().enumerate() {
            let point = plane_point(self.poses.pos[a], normal, rim);
            self.offer(index, k as u32, pair, near, point, contacts);
        }
    }

    #[inline(always)]
    fn plane_ellipsoid(&self, index: usize, pair: &PairPlan<R::Scalar>, near: R::Mask, contacts: &mut Contacts<R>) {
        let [a, b] = pair.geoms;
        let radii = self.plan.params.geom_size(b);
        let ellipsoid = Ellipsoid { centre: self.poses.pos[b], mat: self.poses.mat[b], radii };
        let point = plane_ellipsoid(self.poses.pos[a], column(&self.poses.mat[a], 2), &ellipsoid);
        self.offer(index, 0, pair, near, point, contacts);
    }

    #[inline(always)]
    fn sphere_box(&self, index: usize, pair: &PairPlan<R::Scalar>, near: R::Mask, contacts: &mut Contacts<R>) {
        let [a, b] = pair.geoms;
        let point = sphere_box(self.poses.pos[a], self.plan.params.geom_size(a)[0], &self.cuboid(b));
        self.offer(index, 0, pair, near, point, contacts);
    }

    #[inline(always)]
    fn sphere_cylinder(&self, index: usize, pair: &PairPlan<R::Scalar>, near: R::Mask, contacts: &mut Contacts<R>) {
        let [a, b] = pair.geoms;
        let point = sphere_cylinder(self.poses.pos[a], self.plan.params.geom_size(a)[0], &self.cylinder(b));
        self.offer(index, 0, pair, near, point, contacts);
    }

    #[inline(always)]
    fn capsule_box(&self, index: usize, pair: &PairPlan<R::Scalar>, near: R::Mask, contacts: &mut Contacts<R>) {
        let [a, b] = pair.geoms;
        let (points, exist) = capsule_box(&self.segment(a), &self.cuboid(b));
        self.offer(index, 0, pair, near.and(exist[0]), points[0], contacts);
        self.offer(index, 1, pair, near.and(exist[1]), points[1], contacts);
    }

    #[inline(always)]
    fn cuboid(&self, geom: usize) -> Cuboid<R> {
        Cuboid { centre: self.poses.pos[geom], mat: self.poses.mat[geom], half: self.plan.params.geom_size(geom) }
    }

    #[inline(always)]
    fn cylinder(&self, geom: usize) -> Cylinder<R> {
        let [radius, half_length, _] = self.plan.params.geom_size(geom);
        Cylinder { centre: self.poses.pos[geom], mat: self.poses.mat[geom], radius, half_length }
    }

    #[inline(always)]
    fn segments(&self, index: usize, pair: &PairPlan<R::Scalar>, near: R::Mask, contacts: &mut Contacts<R>) {
        let [a, b] = pair.geoms;
        let (points, two) = segments(&self.segment(a), &self.segment(b));
        self.offer(index, 0, pair, near, points[0], contacts);
        let both = near.and(two);
        if both.any() {
            self.offer(index, 1, pair, both, points[1], contacts);
        }
    }

    /// Lane by lane, in f64: what one lane does no other sees.
    #[inline(always)]
    fn convex(&self, index: usize, pair: &PairPlan<R::Scalar>, near: R::Mask, search: &mut Search, contacts: &mut Contacts<R>) {
        let [a, b] = pair.geoms;
        let reach = R::splat(pair.margin) + self.poses.travel[a] + self.poses.travel[b] + self.slack;
        let mut rest = near.bits();
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let pose = |g: usize| Pose {
                pos: self.poses.pos[g].map(|x| x.lane(lane).to_f64()),
                mat: self.poses.mat[g].map(|x| x.lane(lane).to_f64()),
            };
            let solids = [a, b].map(|g| {
                let solid = self.plan.geoms[g].solid.as_ref().expect("made for every geom of this kernel");
                let own = solid.sized(self.plan.params.geom_size(g).map(|x| x.lane(lane).to_f64()));
                own.map_or(Cow::Borrowed(solid), Cow::Owned)
            });
            let Search { narrow, normals } = &mut *search;
            let reach = Reach { prediction: reach.lane(lane).to_f64(), known: normals.of(lane, index) };
            let (found, axis) = narrow.collide([&solids[0], &solids[1]], [pose(a), pose(b)], reach);
            if let Some(axis) = axis {
                normals.keep(lane, index, axis);
            }
            for p in found {
                let point = ContactPoint { distance: R::of(p.distance), pos: p.pos.map(R::of), normal: p.normal.map(R::of) };
                self.offer(index, p.feature, pair, near.and(R::Mask::from_bits(1 << lane)), point, contacts);
            }
        }
    }

    #[inline(always)]
    fn segment(&self, geom: usize) -> Segment<R> {
        let [radius, half_length, _] = self.plan.params.geom_size(geom);
        Segment { centre: self.poses.pos[geom], axis: column(&self.poses.mat[geom], 2), half_length, radius }
    }

    /// Takes the point up in the lanes where it can touch within the step. A kernel of its own, as [`Scene::meet`].
    #[inline(never)]
    fn offer(
        &self,
        index: usize,
        feature: u32,
        pair: &PairPlan<R::Scalar>,
        near: R::Mask,
        mut point: ContactPoint<R>,
        contacts: &mut Contacts<R>,
    ) {
        R::vectorize(
            #[inline(always)]
            || {
                point.distance -= R::splat(pair.margin);
                // Nothing moves further than the bound, so the exact test is needed only below it.
                let [a, b] = pair.geoms;
                let near = near.and(point.distance.lt(self.poses.travel[a] + self.poses.travel[b] + self.slack));
                if near.none() {
                    return;
                }
                let [_, va] = self.motion_at(&self.poses.velocity, a, point.pos);
                let [_, vb] = self.motion_at(&self.poses.velocity, b, point.pos);
                let closing = (-dot(point.normal, sub(vb, va))).max(R::zero());
                let touching = near.and(point.distance.lt(closing * (self.h + self.h) + self.slack));
                let id = ContactId::new(index, feature);
                let params = self.plan.contact(index);
                contacts.push(touching.bits(), id, &point, params.mu, params.restitution);
            },
        )
    }
}
