//! Rows of fixed tendons (limits, dry friction, springs with dampers and inertia) and limits of ball joints.

use stepper_real::{Mask, Real};

use super::LIMIT_SLACK;
use super::equality::{Law, Site, Stretch, law_of};
use crate::constraints::Constraints;
use crate::kinematics::quat_at;
use crate::plan::TendonPlan;
use crate::spatial::*;

impl<R: Real> Constraints<R> {
    /// Adds the rows of all tendons that have some.
    #[inline(always)]
    pub(super) fn add_tendons(&mut self, site: Site<'_, R>) {
        let moment = site.moment;
        for tendon in &site.plan.tendons {
            let (length, free) = (tendon.length.value(moment.q), tendon.length.rate(moment.v_free));
            if let Some((spring, rest)) = &tendon.spring {
                let stretch = length - length.max(R::splat(rest[0])).min(R::splat(rest[1]));
                // Between its two lengths the spring is slack; damper and inertia are not.
                let taut = stretch.abs().gt(R::zero()).or(R::splat(rest[0]).ge(R::splat(rest[1])));
                let before = tendon.length.rate(moment.v);
                self.tendon_columns(site, tendon, R::one());
                let gram = self.gram(site.mass, 0);
                let row = Stretch { error: stretch, before, free, gram, taut };
                let law = law_of(site.options, spring, row, moment.h, moment.alive);
                self.position_bias.push(law.g);
                self.push_row(site.mass, 0, tendon.owner + 2, &law);
            }
            if tendon.friction > <R::Scalar as Default>::default() {
                let most = R::splat(tendon.friction) * moment.h;
                let law = Law { g: free, compliance: R::zero(), active: moment.alive, bounds: [-most, most] };
                self.tendon_columns(site, tendon, R::one());
                self.position_bias.push(free);
                self.push_row(site.mass, 0, tendon.owner + 1, &law);
            }
            if let Some([low, high]) = tendon.range {
                self.limit_tendon(site, tendon, [length - R::splat(low), R::splat(high) - length], free);
            }
        }
    }

    /// The nearer end of a tendon's range, where it can be reached within the step.
    #[inline(always)]
    fn limit_tendon(&mut self, site: Site<'_, R>, tendon: &TendonPlan<R::Scalar>, [below, above]: [R; 2], rate: R) {
        let low = below.le(above);
        let sign = R::select(low, R::one(), -R::one());
        let phi = R::select(low, below, above);
        let free = rate * sign;
        let Some((active, velocity, position)) = self.reach(site, phi, free) else {
            self.scalar_impulse[tendon.owner] = R::zero();
            return;
        };
        let law = Law { g: free + velocity, compliance: R::zero(), active, bounds: [R::zero(), R::of(f64::INFINITY)] };
        self.tendon_columns(site, tendon, sign);
        self.position_bias.push(free + position);
        self.push_row(site.mass, 0, tendon.owner, &law);
    }

    /// Where a limit at distance `phi`, left at the free velocity `free`, can be reached within the step, and its biases: in the
    /// velocities, and when positions are solved apart.
    #[inline(always)]
    fn reach(&mut self, site: Site<'_, R>, phi: R, free: R) -> Option<(R::Mask, R, R)> {
        let h = site.moment.h;
        let closing = (-free).max(R::zero()) * (h + h);
        let active = site.moment.alive.and(phi.le(closing + R::of(LIMIT_SLACK)));
        if active.none() {
            return None;
        }
        let (velocity, position) = self.biases(site.options, phi, h, active);
        Some((active, velocity, position))
    }

    /// Half-solved row of a tendon's length, times `sign`, left in the first component of `column`.
    #[inline(always)]
    fn tendon_columns(&mut self, site: Site<'_, R>, tendon: &TendonPlan<R::Scalar>, sign: R) {
        self.support.clear();
        self.support.extend_from_slice(&tendon.support);
        for &d in &self.support {
            self.column[d as usize] = zero();
        }
        self.add_terms(site, &tendon.length, sign);
        self.half_solve::<1>(site.plan, site.mass);
    }

    /// Limits of ball joints: the rotation vector's length stays below the range (MuJoCo's `mj_instantiateLimit`).
    #[inline(always)]
    pub(super) fn add_ball_limits(&mut self, site: Site<'_, R>) {
        for (i, limit) in site.plan.ball_limits.iter().enumerate() {
            let turn = quat_log(quat_at(site.moment.q, limit.q));
            let angle = norm(turn);
            // Without a turn there is no direction to turn back to.
            let turned = angle.gt(R::zero());
            let axis = scale(turn, -(R::one() / R::select(turned, angle, R::one())));
            let phi = site.plan.params.ball_limit(i) - angle;
            let v = site.moment.v_free;
            let free = dot(axis, [v[limit.dof], v[limit.dof + 1], v[limit.dof + 2]]);
            let Some((active, velocity, position)) = self.reach(site, phi, free) else {
                self.scalar_impulse[limit.owner] = R::zero();
                continue;
            };
            self.support.clear();
            self.support.extend(site.plan.chain_of(limit.dof + 2).iter().rev());
            for &d in &self.support {
                self.column[d as usize] = zero();
            }
            for k in 0..3 {
                self.column[limit.dof + k][0] = axis[k];
            }
            self.half_solve::<1>(site.plan, site.mass);
            self.position_bias.push(free + position);
            let law = Law { g: free + velocity, compliance: R::zero(), active, bounds: [R::zero(), R::of(f64::INFINITY)] };
            self.push_row(site.mass, 0, limit.owner, &law);
        }
    }
}
