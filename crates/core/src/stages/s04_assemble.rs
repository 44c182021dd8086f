//! Stage 4: contacts, equalities, limits, springs of tendons and dry friction become the constraint problem.
//!
//! Every row is carried through half a solve, y = D^-1/2 L^-T J^T, which touches only the ancestors of the bodies it joins; the Delassus
//! matrix is then Y^T Y. The bias of a row says what velocity it demands at the end of the step:
//!
//! ```text
//! apart (phi > 0):                v_n+ >= -c phi / h           it may just close (c = 1)
//! touching:                       v_n+ >= 0
//! overlapping, Baumgarte:         v_n+ >= min(beta (overlap - slop) / h, cap)
//! closing and fast, e > 0:        v_n+ >= -e v_n-              Newton's law (Moreau 1988), and no other bias
//! ```
//!
//! The last line is taken at the time of the impact by the midpoint rule (`restitution.rs`). A contact with e > 0 that neither strikes nor is
//! about to rest has no row: to stop it at the surface would take the energy that it is to bounce with.

mod columns;
mod curve;
mod eliminate;
mod equality;
mod hyperstatic;
mod restitution;
mod tendon;
mod wide;

use stepper_real::{Mask, Real, Scalar};

use self::eliminate::Lengths;
use self::equality::Site;
use self::restitution::any_impacts;
use self::wide::wide_lanes;
use crate::constraints::{Constraints, Moment};
use crate::contacts::Contacts;
use crate::inertia::MassMatrix;
use crate::kinematics::Kinematics;
use crate::options::{Stabilization, StepSettings};
use crate::plan::LanePlan;
use crate::spatial::*;

/// Fastest return to a joint's range from outside by the split form, relative to that of an overlap: it moves positions alone. With the default
/// of 1 m/s, half a radian takes some 0.07 s.
const LIMIT_RETURN: f64 = 10.0;

/// Mobility along a normal, relative to that of all that moves as one body, below which the lever of a hinge is rounding: 1e-7 or so of its length.
fn least_mobility<R: Real>() -> f64 {
    1e-14_f64.max((256.0 * <R::Scalar as Scalar>::EPSILON.to_f64()).powi(2))
}

/// How far a joint limit is looked ahead beyond what the free velocity closes, rad or m: impulses of contacts can turn a joint towards its
/// limit in the same step.
const LIMIT_SLACK: f64 = 0.01;

impl<R: Real> Constraints<R> {
    /// Builds all rows and their warm start.
    pub fn assemble(
        &mut self,
        plan: &LanePlan<R>,
        options: &StepSettings,
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
                self.biased = R::Mask::splat(false);
                self.rebounding = R::Mask::splat(false);
                self.problem.least_mobility = R::of(least_mobility::<R>()) / plan.moving_mass();
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
                self.impacts.clear();
                self.has_impacts = any_impacts(options, contacts);
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
                self.iterate.compute_w(&self.problem);
            },
        )
    }

    /// The velocity change that the present impulses alone make, left in `out`.
    pub fn impulse_change(&self, plan: &LanePlan<R>, mass: &MassMatrix<R>, out: &mut [R]) {
        R::vectorize(
            #[inline(always)]
            || {
                out.copy_from_slice(&self.iterate.w);
                if self.iterate.changes_velocity() {
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
                    let g = R::select(lanes, self.problem.scalars.velocity(row, change), row.g);
                    *position = R::select(lanes, *position + (g - row.g), *position);
                    self.problem.scalars[i].g = g;
                }
                let (contacts, wide) = contacts.split_at_mut(3 * self.problem.contacts.len());
                for (i, [position, ..]) in wide.as_chunks_mut::<6>().0.iter_mut().enumerate() {
                    let block = &self.problem.rolling_contacts[i];
                    let mut g = self.problem.rolling_contacts.velocity(block, change);
                    (0..6).for_each(|k| g[k] = R::select(lanes, g[k], block.g[k]));
                    *position = R::select(lanes, *position + (g[0] - block.g[0]), *position);
                    self.problem.rolling_contacts[i].g = g;
                }
                for (i, [position, ..]) in contacts.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                    let block = &self.problem.contacts[i];
                    let g = select(lanes, self.problem.contacts.velocity(block, change), block.g);
                    *position = R::select(lanes, *position + (g[0] - block.g[0]), *position);
                    self.problem.contacts[i].g = g;
                }
                self.keep_impacts(change, lanes);
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
    fn add_limits(&mut self, plan: &LanePlan<R>, options: &StepSettings, mass: &MassMatrix<R>, moment: &Moment<'_, R>) {
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
            let (bias, position) = self.limit_biases(options, phi, moment.h, active);
            self.add_scalar(plan, mass, limit.dof, i, sign, active, [v + bias, v + position], bounds);
        }
    }

    /// The bias of a contact's normal at distance `phi`: in the velocities, and when positions are solved apart.
    #[inline(always)]
    fn biases(&mut self, options: &StepSettings, phi: R, h: R, active: R::Mask) -> (R, R) {
        self.biases_up_to(options, options.max_correction_speed, phi, h, active)
    }

    /// The same of a limit. Where positions alone move, it comes back faster than an overlap does: no energy can come of it.
    #[inline(always)]
    fn limit_biases(&mut self, options: &StepSettings, phi: R, h: R, active: R::Mask) -> (R, R) {
        let split = options.stabilization == Stabilization::Split;
        let fastest = options.max_correction_speed * if split { LIMIT_RETURN } else { 1.0 };
        self.biases_up_to(options, fastest, phi, h, active)
    }

    #[inline(always)]
    fn biases_up_to(&mut self, options: &StepSettings, fastest: f64, phi: R, h: R, active: R::Mask) -> (R, R) {
        let apart = phi.ge(R::zero());
        let overlap = (-phi - R::of(options.slop)).max(R::zero());
        let (wanted, fastest) = (overlap * R::of(options.baumgarte) / h, R::of(fastest));
        let mut correction = wanted.min(fastest);
        if options.stabilization == Stabilization::Split && overlap.gt(R::zero()).any() {
            // Bounded smoothly, so that of two demands that contradict one another the larger one stays the larger.
            let most = (wanted * wanted + fastest * fastest).sqrt();
            correction = wanted * fastest / most.max(R::of(f64::from(f32::MIN_POSITIVE)));
        }
        let kept = R::select(apart, phi / h, R::zero());
        let corrected = R::select(apart, phi / h, -correction);
        match options.stabilization {
            Stabilization::Baumgarte => {
                self.biased = self.biased.or(active.and(overlap.gt(R::zero())));
                (corrected, kept)
            }
            Stabilization::Split => {
                self.needs_position_solve = self.needs_position_solve.or(active.and(overlap.gt(R::zero())));
                (kept, corrected)
            }
            Stabilization::None => (kept, kept),
        }
    }

    /// Pushes the impulse that a scalar row of the lanes `active` starts from. The others forget theirs, whether the row is made again or not.
    #[inline(always)]
    fn warm_start(&mut self, owner: usize, active: R::Mask) {
        let kept = R::select(active, self.scalar_impulse[owner], R::zero());
        self.scalar_impulse[owner] = kept;
        self.iterate.scalars.push(kept);
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
        self.problem.scalars.push(
            &self.support,
            #[inline(always)]
            |d| column[d][0] * mass.sqrt_inv_d[d],
            sign,
            active,
            g[0],
            bounds,
        );
        if let Some(times) = times {
            self.problem.scalars.set_trace_ratio(times);
        }
        self.position_bias.push(g[1]);
        self.warm_start(owner, active);
        self.owners.push(owner);
        self.constrained = self.constrained.or(active);
    }

    /// Adds slot `k` in the lanes `lanes`, in which it has sliding friction at the most; `support` is gathered.
    #[inline(always)]
    fn add_contact(&mut self, site: Site<'_, R>, contacts: &Contacts<R>, k: usize, lanes: u32) {
        let Site { plan, options, mass, moment, .. } = site;
        let (slot, active) = (&contacts.data[k], R::Mask::from_bits(lanes));
        let [free, before] = self.contact_columns(site, contacts, k, lanes);
        let curves = options.integrator.in_the_middle() && self.moving != 0;
        let change = if self.has_impacts || curves { self.free_change(moment) } else { zero() };
        self.half_solve::<3>(plan, mass);
        let (bias, position) = self.biases(options, moment.gap(slot.point.distance), moment.h, active);
        let (bias, mut active) = self.bounce(plan, options, slot, moment, active, [free[0], before[0]], bias);
        let mut g = [[free[0] + bias, free[0] + position], [free[1]; 2], [free[2]; 2]];
        let lengths = self.eliminate(mass, &mut g);
        if self.has_impacts {
            active = self.bounce_within(site, slot, active, [free, change], bias, &mut g);
        }
        if curves {
            self.add_curve(site, contacts, k, active, [free, change], &mut g);
        }
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
            self.problem.contacts.set_trace_ratio(lengths.times());
        }
        self.position_bias.extend([g[0][1], g[1][1] - g[1][0], g[2][1] - g[2][0]]);
        self.iterate.contacts.push(select(active, slot.impulse, zero()));
        self.slots.push((k, R::Mask::from_bits(lanes)));
        self.constrained = self.constrained.or(active);
    }
}
