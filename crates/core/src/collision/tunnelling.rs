//! What a step may have let through, once its velocity is known.

use stepper_real::{Mask, Real};

use crate::collision::detection::{GeomPoses, Placed};
use crate::compile::{CompiledPair, LaneModel};
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;

/// Lanes in which the step, now that its velocity `v_next` is known, may have taken something through something thin: a pair was faster
/// than [`detect`](crate::stages::s03_detect::detect) looked out for, or turned so far that its way bends by more than it is thick. `free`
/// says that this velocity is the free one that it looked out with.
#[inline(always)]
pub fn may_have_passed<R: Real>(
    compiled: &LaneModel<R>,
    kinematics: &Kinematics<R>,
    v_next: &[R],
    free: bool,
    h: R,
    alive: R::Mask,
    poses: &mut GeomPoses<R>,
) -> R::Mask {
    if !compiled.can_tunnel {
        return R::Mask::splat(false);
    }
    let GeomPoses { placed, slack, near, near_count, broad, .. } = poses;
    let slack = *slack;
    if free && placed.rested(compiled, alive) {
        return R::Mask::splat(false);
    }
    let [moved, surprising] = R::vectorize(
        #[inline(always)]
        || placed.update_ways(compiled, kinematics, v_next, h, slack),
    );
    if moved.and(alive).none() {
        return R::Mask::splat(false);
    }
    // Where nothing got further than stage 3 looked out for, what was not near then is not met now.
    let foreseen = surprising.and(alive).none();
    if let (Some(crowd), false) = (&compiled.crowd, foreseen) {
        broad.find(compiled, crowd, alive.bits(), &placed.pos, &placed.lead, slack);
    }
    R::vectorize(
        #[inline(always)]
        || {
            let mut passed = R::Mask::splat(false);
            if foreseen {
                for &(index, _) in &near[..*near_count] {
                    passed = passed.or(placed.slips_through(compiled, &compiled.pairs[index as usize], h, slack));
                }
            } else {
                for pair in &compiled.pairs {
                    passed = passed.or(placed.slips_through(compiled, pair, h, slack));
                }
            }
            if let Some(crowd) = &compiled.crowd {
                for pair in broad.pairs.iter().filter_map(|p| crowd.pair(p.0)) {
                    passed = passed.or(placed.slips_through(compiled, &pair, h, slack));
                }
            }
            passed.and(alive)
        },
    )
}

impl<R: Real> Placed<R> {
    /// Whether no geom moved by half its thickness in a free step: stage 3 has its way in two of them, twice as long to the bit.
    fn rested(&self, compiled: &LaneModel<R>, alive: R::Mask) -> bool {
        R::vectorize(
            #[inline(always)]
            || {
                let mut moved = R::Mask::splat(false);
                for (g, travel) in self.travel.iter().enumerate() {
                    moved = moved.or(travel.gt(compiled.params.inscribed_radius(g)));
                }
                moved.and(alive).none()
            },
        )
    }

    /// Bounds on the ways of the step as it was made, left in `lead`. Returns the lanes in which some geom moved by half its thickness,
    /// since no two others get past one another, and those in which some geom got further than stage 3 looked out for.
    #[inline(always)]
    fn update_ways(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v_next: &[R], h: R, slack: R) -> [R::Mask; 2] {
        self.update_lead(compiled, kinematics, v_next, h);
        let [mut any, mut surprising] = [R::Mask::splat(false); 2];
        let half = R::of(0.5);
        for (g, ((&way, &travel), fast)) in self.lead.iter().zip(&self.travel).zip(&mut self.fast).enumerate() {
            let moved = way.gt(compiled.params.inscribed_radius(g) * half);
            *fast = moved.any();
            any = any.or(moved);
            surprising = surprising.or(way.gt(travel + slack * half));
        }
        [any, surprising]
    }

    /// Lanes in which a pair could get through unseen.
    #[inline(always)]
    fn slips_through(&self, compiled: &LaneModel<R>, pair: &CompiledPair<R::Scalar>, h: R, slack: R) -> R::Mask {
        let [a, b] = pair.geoms;
        if !(self.fast[a] || self.fast[b]) {
            return R::Mask::splat(false);
        }
        let way = self.lead[a] + self.lead[b];
        let distance = compiled.tunnelling_distance(pair.geoms);
        let far = way.gt(distance);
        if far.none() {
            return far;
        }
        let reach = compiled.reach(pair.geoms) + R::splat(pair.margin) + way;
        let apart = sub(self.pos[b], self.pos[a]);
        let meets = far.and(dot(apart, apart).lt(reach * reach));
        let unseen = way.gt(self.travel[a] + self.travel[b] + slack);
        let bends = (self.bend(compiled, a, h) + self.bend(compiled, b, h)).gt(distance);
        meets.and(unseen.or(bends))
    }

    /// How far an arc leaves its tangent: half the square of the angle, times what it swings, m.
    #[inline(always)]
    fn bend(&self, compiled: &LaneModel<R>, geom: usize, h: R) -> R {
        let g = &compiled.geoms[geom];
        if g.frame == 0 || g.frame > compiled.links.len() {
            return R::zero();
        }
        let w = angular(&self.led_by[g.frame - 1]);
        dot(w, w) * h * h * R::of(0.5) * compiled.params.rotation_reach(geom)
    }
}
