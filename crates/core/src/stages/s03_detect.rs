//! Stage 3: poses become contacts.
//!
//! A contact is taken up when it can touch within the step: its distance is below what the free velocity closes, with a margin of two, or
//! below what gravity covers in a step. So nothing has to overlap first in order to be felt.

use stepper_real::{Mask, Real};

use crate::contacts::{ContactId, ContactPoint, Contacts};
use crate::geometry::{Segment, plane_box, plane_sphere, segments};
use crate::kinematics::Kinematics;
use crate::plan::{Kernel, PairPlan, Plan};
use crate::spatial::*;

/// Where the colliding geoms are and how far they can get.
#[derive(Clone, Debug)]
pub struct GeomPoses<R: Real> {
    pos: Vec<V3<R>>,
    /// Whole orientation; only its z axis is kept up where that is all that is read.
    mat: Vec<M3<R>>,
    /// Bound on the way of any point of the geom in two free steps, m.
    travel: Vec<R>,
    velocity: Vec<V6<R>>,
}

impl<R: Real> GeomPoses<R> {
    /// Room for a plan; geoms of the world are placed for good.
    pub fn new(plan: &Plan<R::Scalar>) -> Self {
        Self {
            pos: plan.geoms.iter().map(|g| splat(g.pos)).collect(),
            mat: plan.geoms.iter().map(|g| splat(g.mat)).collect(),
            travel: vec![R::zero(); plan.geoms.len()],
            velocity: vec![zero(); plan.links.len()],
        }
    }

    #[inline(always)]
    fn update(&mut self, plan: &Plan<R::Scalar>, kinematics: &Kinematics<R>, v_free: &[R], h: R) {
        kinematics.velocities(plan, v_free, &mut self.velocity);
        for (i, g) in plan.geoms.iter().enumerate() {
            if g.frame == 0 {
                continue;
            }
            let mat = &kinematics.mat[g.frame];
            let pos = kinematics.point(g.frame, splat(g.pos));
            self.pos[i] = pos;
            if g.full_orientation {
                self.mat[i] = mat_mul(mat, &splat(g.mat));
            } else {
                let z = rotate(mat, splat([g.mat[2], g.mat[5], g.mat[8]]));
                for k in 0..3 {
                    self.mat[i][3 * k + 2] = z[k];
                }
            }
            if g.frame <= plan.links.len() {
                let l = g.frame - 1;
                let motion = self.velocity[l];
                let speed = norm(velocity_at(&motion, sub(pos, kinematics.origin[plan.links[l].tree])));
                self.travel[i] = (speed + norm(angular(&motion)) * R::splat(g.bound)) * (h + h);
            }
        }
    }

    /// Velocity of the point `p` of a frame.
    #[inline(always)]
    fn velocity_of(&self, plan: &Plan<R::Scalar>, kinematics: &Kinematics<R>, frame: usize, p: V3<R>) -> V3<R> {
        if frame == 0 || frame > plan.links.len() {
            return zero();
        }
        velocity_at(&self.velocity[frame - 1], sub(p, kinematics.origin[plan.links[frame - 1].tree]))
    }
}

/// Finds the contacts of the lanes `alive`.
pub fn detect<R: Real>(
    plan: &Plan<R::Scalar>,
    kinematics: &Kinematics<R>,
    v_free: &[R],
    h: R,
    alive: R::Mask,
    poses: &mut GeomPoses<R>,
    contacts: &mut Contacts<R>,
) {
    R::vectorize(
        #[inline(always)]
        || {
            contacts.clear();
            if plan.pairs.is_empty() {
                return;
            }
            poses.update(plan, kinematics, v_free, h);
            let gravity: V3<R> = splat(plan.gravity);
            // What gravity covers in a step, and a micrometre for scenes without it.
            let slack = norm(gravity) * h * h + R::of(1e-6);
            let scene = Scene { plan, kinematics, poses, h, slack };
            for (index, pair) in plan.pairs.iter().enumerate() {
                let near = alive.and(scene.can_touch(pair));
                if near.none() {
                    continue;
                }
                match pair.kernel {
                    Kernel::PlaneSphere => scene.plane_sphere(index, pair, near, contacts),
                    Kernel::PlaneCapsule => scene.plane_capsule(index, pair, near, contacts),
                    Kernel::PlaneBox => scene.plane_box(index, pair, near, contacts),
                    Kernel::Segments => scene.segments(index, pair, near, contacts),
                }
            }
        },
    )
}

struct Scene<'a, R: Real> {
    plan: &'a Plan<R::Scalar>,
    kinematics: &'a Kinematics<R>,
    poses: &'a GeomPoses<R>,
    h: R,
    slack: R,
}

impl<R: Real> Scene<'_, R> {
    /// Lanes in which the bounding volumes of a pair can meet within the step.
    #[inline(always)]
    fn can_touch(&self, pair: &PairPlan<R::Scalar>) -> R::Mask {
        let [a, b] = pair.geoms;
        let apart = sub(self.poses.pos[b], self.poses.pos[a]);
        let reach = R::splat(pair.reach) + R::splat(pair.margin) + self.poses.travel[a] + self.poses.travel[b] + self.slack;
        match pair.kernel {
            Kernel::Segments => dot(apart, apart).lt(reach * reach),
            _ => dot(apart, column(&self.poses.mat[a], 2)).lt(reach),
        }
    }

    #[inline(always)]
    fn plane_sphere(&self, index: usize, pair: &PairPlan<R::Scalar>, near: R::Mask, contacts: &mut Contacts<R>) {
        let [a, b] = pair.geoms;
        let radius = R::splat(self.plan.geoms[b].size[0]);
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
        let half = splat(self.plan.geoms[b].size);
        let normal = column(&self.poses.mat[a], 2);
        for corner in 0..8 {
            let point = plane_box(self.poses.pos[a], normal, self.poses.pos[b], &self.poses.mat[b], half, corner);
            self.offer(index, corner, pair, near, point, contacts);
        }
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

    #[inline(always)]
    fn segment(&self, geom: usize) -> Segment<R> {
        let [radius, half_length, _] = splat(self.plan.geoms[geom].size);
        Segment { centre: self.poses.pos[geom], axis: column(&self.poses.mat[geom], 2), half_length, radius }
    }

    /// Takes the point up in the lanes where it can touch within the step.
    #[inline(always)]
    fn offer(
        &self,
        index: usize,
        feature: usize,
        pair: &PairPlan<R::Scalar>,
        near: R::Mask,
        mut point: ContactPoint<R>,
        contacts: &mut Contacts<R>,
    ) {
        point.distance -= R::splat(pair.margin);
        // Nothing moves further than the bound, so the exact test is needed only below it.
        let [a, b] = pair.geoms;
        let near = near.and(point.distance.lt(self.poses.travel[a] + self.poses.travel[b] + self.slack));
        if near.none() {
            return;
        }
        let frame = |g: usize| self.plan.geoms[g].frame;
        let va = self.poses.velocity_of(self.plan, self.kinematics, frame(a), point.pos);
        let vb = self.poses.velocity_of(self.plan, self.kinematics, frame(b), point.pos);
        let closing = (-dot(point.normal, sub(vb, va))).max(R::zero());
        let touching = near.and(point.distance.lt(closing * (self.h + self.h) + self.slack));
        let id = ContactId::new(index, feature);
        contacts.push(touching.bits(), id, &point, R::splat(pair.mu), R::splat(pair.restitution));
    }
}
