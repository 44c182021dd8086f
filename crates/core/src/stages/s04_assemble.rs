//! Stage 4: contacts, equalities, limits, springs of tendons and dry friction become the constraint problem.
//!
//! Every row is carried through half a solve, y = D^-1/2 L^-T J^T, which touches only the ancestors of the bodies it joins; the Delassus
//! matrix is then Y^T Y. The bias of a row says what velocity it demands at the end of the step:
//!
//! ```text
//! apart (phi > 0):                v_n+ >= -c phi / h           it may just close (c = 1)
//! touching:                       v_n+ >= 0
//! overlapping, Baumgarte:         v_n+ >= min(beta (overlap - slop) / h, cap)
//! closed and fast, e > 0:         v_n+ >= -e v_n-              Newton's law (Moreau 1988), and no other bias
//! ```
//!
//! A contact with e > 0 that is neither closed nor about to rest has no row: to stop it at the surface would take the energy that it is to
//! bounce with.

mod columns;
mod eliminate;
mod equality;
mod hyperstatic;
mod tendon;
mod wide;

use stepper_real::{Mask, Real};

use self::eliminate::Lengths;
use self::equality::Site;
use self::wide::wide_lanes;
use crate::constraints::{Constraints, Moment};
use crate::contacts::{Contacts, Slot};
use crate::inertia::MassMatrix;
use crate::kinematics::Kinematics;
use crate::options::{Options, Stabilization};
use crate::plan::LanePlan;
use crate::spatial::*;

/// How far a joint limit is looked ahead beyond what the free velocity closes, rad or m: impulses of contacts can turn a joint towards its
/// limit in the same step.
const LIMIT_SLACK: f64 = 0.01;

impl<R: Real> Constraints<R> {
    /// Builds all rows and their warm start.
    pub fn assemble(
        &mut self,
        plan: &LanePlan<R>,
        options: &Options,
        kinematics: &Kinematics<R>,
        mass: &MassMatrix<R>,
        moment: &Moment<'_, R>,
        contacts: &mut Contacts<R>,
    ) {
        R::vectorize(
            #[inline(always)]
            || {
                self.problem.clear();
                self.iterate.clear();
                self.owners.clear();
                self.position_bias.clear();
                self.slots.clear();
                self.wide_slots.clear();
                self.constrained = R::Mask::splat(false);
                self.needs_position_solve = R::Mask::splat(false);
                let site = Site { plan, options, kinematics, mass, moment };
                if !plan.equalities.is_empty() {
                    self.add_equalities(site, true);
                    self.keep_separate(plan, mass);
                }
                self.add_frictions(plan, mass, moment);
                self.add_limits(plan, options, mass, moment);
                if !plan.ball_limits.is_empty() {
                    self.add_ball_limits(site);
                }
                if !plan.tendons.is_empty() {
                    self.add_tendons(site);
                }
                if !plan.equalities.is_empty() {
                    self.add_equalities(site, false);
                }
                for k in 0..contacts.slots() {
                    let lanes = contacts.lanes_of(k);
                    let narrow = lanes & !wide_lanes(plan, contacts, k, lanes);
                    if narrow != 0 {
                        self.gather_support(plan, contacts, k, narrow);
                        self.add_contact(site, contacts, k, narrow);
                    }
                }
                if plan.wide {
                    for k in 0..contacts.slots() {
                        let wide = wide_lanes(plan, contacts, k, contacts.lanes_of(k));
                        if wide != 0 {
                            self.add_wide(site, contacts, k, wide);
                        }
                    }
                }
                self.problem.hyperstatic = hyperstatic::lanes(plan, contacts);
                self.iterate.start(&self.problem);
            },
        )
    }

    /// The velocity change that the warm start alone would make, left in `out`.
    pub fn warm_change(&self, plan: &LanePlan<R>, mass: &MassMatrix<R>, out: &mut [R]) {
        R::vectorize(
            #[inline(always)]
            || {
                out.copy_from_slice(&self.iterate.w);
                if self.iterate.moves() {
                    mass.unscale(plan, out);
                }
            },
        )
    }

    /// Takes up a change of the free velocity of the lanes `lanes` after the rows were made. `change` is used up.
    pub fn shift(&mut self, plan: &LanePlan<R>, mass: &MassMatrix<R>, change: &mut [R], lanes: R::Mask) {
        if self.problem.is_empty() {
            return;
        }
        R::vectorize(
            #[inline(always)]
            || {
                mass.scale(plan, change);
                let (scalars, contacts) = self.position_bias.split_at_mut(self.problem.scalars.len());
                for (i, position) in scalars.iter_mut().enumerate() {
                    let row = &self.problem.scalars[i];
                    let g = R::select(lanes, self.problem.scalar_velocity(row, change), row.g);
                    *position = R::select(lanes, *position + (g - row.g), *position);
                    self.problem.scalars[i].g = g;
                }
                let (contacts, wide) = contacts.split_at_mut(3 * self.problem.contacts.len());
                for (i, [position, ..]) in wide.as_chunks_mut::<6>().0.iter_mut().enumerate() {
                    let block = &self.problem.wide[i];
                    let mut g = self.problem.wide_velocity(block, change);
                    (0..6).for_each(|k| g[k] = R::select(lanes, g[k], block.g[k]));
                    *position = R::select(lanes, *position + (g[0] - block.g[0]), *position);
                    self.problem.wide[i].g = g;
                }
                for (i, [position, ..]) in contacts.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                    let block = &self.problem.contacts[i];
                    let g = select(lanes, self.problem.contact_velocity(block, change), block.g);
                    *position = R::select(lanes, *position + (g[0] - block.g[0]), *position);
                    self.problem.contacts[i].g = g;
                }
            },
        )
    }

    /// Dry friction: |lambda| <= h f, and what drive trains lose, which depends on the direction.
    #[inline(always)]
    fn add_frictions(&mut self, plan: &LanePlan<R>, mass: &MassMatrix<R>, moment: &Moment<'_, R>) {
        for (i, friction) in plan.frictions.iter().enumerate() {
            let most = plan.params.friction(i) * moment.h;
            let mut bounds = [-most, most];
            if friction.driven {
                let [forwards, backwards] = moment.losses[i];
                bounds = [bounds[0] - forwards * moment.h, bounds[1] + backwards * moment.h];
            }
            let g = moment.v_free[friction.dof];
            self.add_scalar(plan, mass, friction.dof, plan.limits.len() + i, R::one(), moment.alive, [g, g], bounds);
        }
    }

    /// Limits: the nearer end of each range, where it can be reached within the step.
    #[inline(always)]
    fn add_limits(&mut self, plan: &LanePlan<R>, options: &Options, mass: &MassMatrix<R>, moment: &Moment<'_, R>) {
        let bounds = [R::zero(), R::of(f64::INFINITY)];
        for (i, limit) in plan.limits.iter().enumerate() {
            let q = moment.q[limit.q];
            let [lowest, highest] = plan.params.limit(i);
            let (below, above) = (q - lowest, highest - q);
            let low = below.le(above);
            let sign = R::select(low, R::one(), -R::one());
            let phi = R::select(low, below, above);
            let v = moment.v_free[limit.dof] * sign;
            let closing = (-v).max(R::zero()) * (moment.h + moment.h);
            let active = moment.alive.and(phi.le(closing + R::of(LIMIT_SLACK)));
            if active.none() {
                self.scalar_impulse[i] = R::zero();
                continue;
            }
            let (bias, position) = self.biases(options, phi, moment.h, active);
            self.add_scalar(plan, mass, limit.dof, i, sign, active, [v + bias, v + position], bounds);
        }
    }

    /// The bias of a row at distance `phi`: in the velocities, and when positions are solved apart.
    #[inline(always)]
    fn biases(&mut self, options: &Options, phi: R, h: R, active: R::Mask) -> (R, R) {
        let apart = phi.ge(R::zero());
        let overlap = (-phi - R::of(options.slop)).max(R::zero());
        let correction = (overlap * R::of(options.baumgarte) / h).min(R::of(options.max_correction_speed));
        let position = R::select(apart, phi / h, -correction);
        let velocity = match options.stabilization {
            Stabilization::Baumgarte => position,
            Stabilization::Split | Stabilization::None => R::select(apart, phi / h, R::zero()),
        };
        if options.stabilization == Stabilization::Split {
            let corrected = active.and(overlap.gt(R::zero()));
            self.needs_position_solve = self.needs_position_solve.or(corrected);
        }
        let position = if options.stabilization == Stabilization::None { velocity } else { position };
        (velocity, position)
    }

    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "one row, every part of it named at the call")]
    fn add_scalar(
        &mut self,
        plan: &LanePlan<R>,
        mass: &MassMatrix<R>,
        dof: usize,
        owner: usize,
        sign: R,
        active: R::Mask,
        mut g: [R; 2],
        bounds: [R; 2],
    ) {
        self.unit_column(plan, mass, dof);
        self.tie(plan);
        let mut times = None;
        if !self.tied.is_empty() {
            let mut own = [scale(g, sign)];
            times = self.eliminate(mass, &mut own).map(Lengths::times);
            g = scale(own[0], sign);
        }
        let column = &self.column;
        self.problem.push_scalar(
            &self.support,
            #[inline(always)]
            |d| column[d][0] * mass.sqrt_inv_d[d],
            sign,
            active,
            g[0],
            bounds,
        );
        if let Some(times) = times {
            self.problem.measure_scalar(times);
        }
        self.position_bias.push(g[1]);
        self.iterate.scalars.push(R::select(active, self.scalar_impulse[owner], R::zero()));
        self.owners.push(owner);
        self.constrained = self.constrained.or(active);
    }

    /// Adds slot `k` in the lanes `lanes`, in which it has sliding friction at the most; `support` is gathered.
    #[inline(always)]
    fn add_contact(&mut self, site: Site<'_, R>, contacts: &Contacts<R>, k: usize, lanes: u32) {
        let Site { plan, options, mass, moment, .. } = site;
        let (slot, active) = (&contacts.data[k], R::Mask::from_bits(lanes));
        let [free, before] = self.contact_columns(site, contacts, k, lanes);
        self.half_solve::<3>(plan, mass);
        let (bias, position) = self.biases(options, moment.gap(slot.point.distance), moment.h, active);
        let (normal, active) = self.bounce(plan, options, slot, moment, active, [free[0], before[0]], bias);
        let mut g = [[normal, free[0] + position], [free[1]; 2], [free[2]; 2]];
        let lengths = self.eliminate(mass, &mut g);
        let column = &self.column;
        self.problem.push_contact(
            &self.support,
            #[inline(always)]
            |d| scale(column[d], mass.sqrt_inv_d[d]),
            active,
            slot.mu,
            [g[0][0], g[1][0], g[2][0]],
        );
        if let Some(lengths) = lengths {
            self.problem.measure_contact(lengths.times());
        }
        self.position_bias.extend([g[0][1], g[1][1] - g[1][0], g[2][1] - g[2][0]]);
        self.iterate.contacts.push(select(active, slot.impulse, zero()));
        self.slots.push((k, R::Mask::from_bits(lanes)));
        self.constrained = self.constrained.or(active);
    }

    /// g of a normal row, and the lanes that have the row: its free velocity with the bias, or with Newton's law where the contact bounces.
    ///
    /// All closed contacts share an impact: 0 <= lambda, complementary to v+ + e v- >= 0, also where v- parts. With e = 1 the work of the
    /// impulses, lambda (v+ + v-) / 2, is then zero contact by contact, so that energy is conserved however many strike at once. The law is
    /// taken between the velocities before and after the step by the midpoint rule, which conserves energy with it, and on the free
    /// velocity by Euler's, which is the textbook's recursion. A contact slower than the threshold before the step rests: it does not bounce
    /// from the velocity that gravity gives it within the step.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "one contact, every part of it named at the call")]
    fn bounce(
        &mut self,
        plan: &LanePlan<R>,
        options: &Options,
        slot: &Slot<R>,
        moment: &Moment<'_, R>,
        active: R::Mask,
        [free, before]: [R; 2],
        bias: R,
    ) -> (R, R::Mask) {
        let e = slot.restitution;
        let elastic = active.and(e.gt(R::zero()));
        if elastic.none() {
            return (free + bias, active);
        }
        let (h, phi, threshold) = (moment.h, slot.point.distance, R::of(options.restitution_threshold));
        let euler = !options.integrator.in_the_middle();
        let approach = if euler { free } else { before };
        // What a slow contact and gravity close within the step.
        let near = phi.le(h * (threshold + h * norm(plan.params.gravity())) + R::of(options.slop));
        let rests = before.abs().le(threshold).and(near);
        let closed = phi.le(R::of(options.slop)).or((phi + h * free).lt(R::zero()));
        let bounces = elastic.and(closed).and(approach.abs().gt(threshold)).and_not(rests);
        if euler {
            self.needs_position_solve = self.needs_position_solve.or(bounces);
        }
        let stays = active.and_not(elastic).or(bounces).or(elastic.and(rests));
        (free + R::select(bounces, e * approach, bias), stays)
    }
}
