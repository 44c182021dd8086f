//! Contacts that bounce: restitution by Newton's law.
//!
//! Euler's rule applies Newton's law to the free velocity (after the step, without constraints), as in textbooks. In this file, "Euler's
//! rule" includes the implicit rule. The midpoint rule applies Newton's law at the time t of the impact (see
//! [`crate::constraints::impact_time`]). With the velocities v- of the free motion at that time, the rows are
//!
//! ```text
//! 0 <= lambda_n, complementary to v_n+ + e v_n- >= 0     so g_n = (1 + e) v_n-(t)
//! friction against v_t+                                  so g_t = v_t-(t)
//! ```
//!
//! The impulse acts for the rest of the step. Positions advance from the evaluation point with the velocity after the step, which gives
//! every impulse the time `time_after`. The difference, (h - t - time_after) M^-1 J^T lambda, is added in the position solve, so that other
//! contacts take it into account.

use stepper_real::{Mask, Real, kernel};
use stepper_solve::{Iterate, PositionRows, Problem};

use crate::collision::contact_set::{Contacts, Slot};
use crate::compile::LaneModel;
use crate::constraints::assembler::{Assembler, RowInput, tunnelling_distance};
use crate::constraints::constraint_problem::{ConstraintProblem, Impact, shift_impacts};
use crate::constraints::evaluation_times::{EvaluationTimes, SlotTimes};
use crate::constraints::impact_time::Flight;
use crate::constraints::position_solution::PositionSolution;
use crate::constraints::row_builder::RowBuilder;
use crate::dynamics::inertia::MassMatrix;
use crate::math::spatial::*;
use crate::tuning::MAX_REBOUND_SPEED_RATIO;

/// Offsets g of a contact's three rows in the velocity solve and in the position solve, m/s.
type Offsets<R> = [[R; 2]; 3];

impl<R: Real> RowBuilder<R> {
    /// Change of the velocities of the three rows in `column` by the free motion: free velocity after the step minus velocity before the
    /// step, m/s.
    #[inline(always)]
    pub(crate) fn change_by_free_motion(&self, input: &RowInput<'_, R>) -> V3<R> {
        let mut change = zero();
        for &d in &self.dofs {
            let d = d as usize;
            change = add_scaled(change, self.column[d], input.v_free[d] - input.v[d]);
        }
        change
    }
}

impl<R: Real> Assembler<'_, R> {
    /// Bias of a contact's normal row by Euler's rule, m/s, and the lanes of `exists` in which the row is needed. With the midpoint rule
    /// the function returns `bias` and `exists` unchanged.
    ///
    /// In contacts that bounce, the result is e v-, where v- is the free normal velocity; in the others it is `bias`. An elastic contact
    /// bounces if its gap is closed, or closes in the free motion, and |v-| exceeds the threshold. Its row is then `v+ + e v- >= 0`,
    /// complementary to the impulse. A closed contact that the free velocity opens bounces too. A contact rests, and does not bounce, if
    /// its speed before the step is below the threshold and its gap is small. It rests even if gravity makes it faster within the step.
    #[inline(always)]
    pub(crate) fn bounce_at_step_end(
        &mut self,
        input: &RowInput<'_, R>,
        slot: &Slot<R>,
        exists: R::Mask,
        [free, before]: [R; 2],
        bias: R,
    ) -> (R, R::Mask) {
        let e = slot.restitution;
        let elastic = exists.and(e.gt(R::zero()));
        if input.in_the_middle || !self.problem.elastic {
            return (bias, exists);
        }
        let (h, phi, threshold) = (input.h, slot.point.distance, R::of(input.options.restitution_threshold));
        // Gaps that a slow contact and gravity can close within the step.
        let near = phi.le(h * (threshold + h * norm(input.compiled.params.gravity())) + R::of(input.options.slop));
        let rests = before.abs().le(threshold).and(near);
        let closed = phi.le(R::of(input.options.slop)).or((phi + h * free).lt(R::zero()));
        let bounces = elastic.and(closed).and(free.abs().gt(threshold)).and_not(rests);
        self.problem.needs_position_solve = self.problem.needs_position_solve.or(bounces);
        self.problem.rebounding_at_step_end = self.problem.rebounding_at_step_end.or(bounces);
        let impact = Impact { lanes: bounces, time_fraction: R::one(), normal_factor: e + R::one(), rebound: e * free };
        self.problem.impacts.push(impact);
        let stays = exists.and_not(elastic).or(bounces).or(elastic.and(rests));
        (R::select(bounces, e * free, bias), stays)
    }

    /// Corrects the rebound velocity of [`Assembler::bounce_at_step_end`] after the elimination of equalities. Returns the bias of the
    /// normal row, m/s.
    ///
    /// Newton's law then uses the free normal velocity after the elimination, instead of `free`, the one before it. `offset` is g of the
    /// normal row after the elimination; the function corrects it too. With the midpoint rule the function changes nothing.
    #[inline(always)]
    pub(crate) fn bounce_at_step_end_eliminated(&mut self, slot: &Slot<R>, free: R, bias: R, offset: &mut R) -> R {
        if self.problem.resolves_impacts || !self.problem.elastic {
            return bias;
        }
        let Some(impact) = self.problem.impacts.last_mut() else { return bias };
        let free_eliminated = *offset - bias;
        let change = R::select(impact.lanes, slot.restitution * (free_eliminated - free), R::zero());
        impact.rebound += change;
        *offset += change;
        bias + change
    }

    /// Replaces the `offsets` of the velocity solve for the contact in slot `k` of `contacts`, if it bounces within the step, by the
    /// midpoint rule. Returns the lanes of `exists` in which the rows are needed.
    ///
    /// Only steps by the midpoint rule with an elastic contact call this function. `free` are the velocities of the rows without
    /// constraints, before equalities are eliminated. `change` is the change of these velocities by the free motion in the step. After the
    /// elimination, the free velocity is `offsets` minus the normal's `bias`. The function is compiled separately, as
    /// [`Assembler::add_curvature`] is.
    #[inline(never)]
    pub(crate) fn bounce_at_impact_time(
        &mut self,
        input: &RowInput<'_, R>,
        (contacts, k): (&Contacts<R>, usize),
        exists: R::Mask,
        [free, change]: [V3<R>; 2],
        bias: R,
        offsets: &mut Offsets<R>,
    ) -> R::Mask {
        kernel!(R, || {
            let RowInput { compiled, options, .. } = *input;
            let slot = &contacts.data[k];
            let e = slot.restitution;
            let elastic = exists.and(e.gt(R::zero()));
            if elastic.none() {
                let none = R::zero();
                self.problem.impacts.push(Impact { lanes: elastic, time_fraction: none, normal_factor: none, rebound: none });
                return exists;
            }
            let before = sub(free, change);
            let free_eliminated = [offsets[0][0] - bias, offsets[1][0], offsets[2][0]];
            let time_before = input.times_of_slot(contacts, k, elastic.bits()).before;
            let (gap, h) = (slot.point.distance, input.h);
            let flight = Flight { gap, before: before[0], free: free_eliminated[0], time_before, h };
            let prediction = flight.predict(options, norm(compiled.params.gravity()), e, elastic);
            let bounces = prediction.collides.or(prediction.separates);
            let (time_fraction, normal_factor) = (prediction.time / input.h, e + R::one());
            let at = add_scaled(before, sub(free_eliminated, before), time_fraction);
            for (k, offset) in offsets.iter_mut().enumerate() {
                let at_impact = if k == 0 { at[0] * normal_factor } else { at[k] };
                offset[0] = R::select(bounces, at_impact, offset[0]);
            }
            self.problem.impacts.push(Impact { lanes: bounces, time_fraction, normal_factor, rebound: R::zero() });
            exists.and_not(elastic).or(bounces).or(prediction.rests)
        })
    }

    /// Changes the velocity solve's offsets of the torsional and rolling rows to those at the time of the impact, in the last added
    /// contact. `change` is the change of the rows' velocities by the free motion.
    #[inline(always)]
    pub(crate) fn shift_rotation_to_impact(&self, change: V3<R>, rotation_offsets: &mut Offsets<R>) {
        if let Some(impact) = self.problem.impacts.last() {
            for (offset, change) in rotation_offsets.iter_mut().zip(change) {
                offset[0] = R::select(impact.lanes, offset[0] - change * (R::one() - impact.time_fraction), offset[0]);
            }
        }
    }
}

impl<R: Real> ConstraintProblem<R> {
    /// Sets the coefficient of restitution to 0 for impacts at which Newton's law has no plausible solution. Returns the lanes with such an
    /// impact.
    ///
    /// Newton's law prescribes the normal velocity after an impact. The friction of another contact can act against it. A ball that flies
    /// into a corner with a friction coefficient of 1 or more has no solution, and just below 1 the impulses are enormous. The friction of
    /// such impacts adds energy (Kane and Levinson, Dynamics: Theory and Applications, 1985, section 5.7). An inelastic impact always has a
    /// solution.
    ///
    /// An impact is implausible if friction at the impact adds more energy than `energy`, J. It is also implausible if the rounding error
    /// of its impulse changes a velocity by more than `max_rounding`, m/s. In the lanes `unsolved`, all impacts become inelastic. In the
    /// lanes `all_or_none`, all do so if one is implausible.
    pub(crate) fn drop_restitution(
        &mut self,
        impulses: &Iterate<R>,
        [energy, max_rounding]: [R; 2],
        [unsolved, all_or_none]: [R::Mask; 2],
    ) -> R::Mask {
        kernel!(R, || {
            let Self { rows, impacts, rebounding_at_step_end, deferred, resolves_impacts, .. } = self;
            let elastic = |impact: &Impact<R>| impact.lanes.and(impact.normal_factor.gt(R::one()));
            let implausible = |rows: &Problem<R>, i: usize| {
                kernel!(R, || impulses.friction_work(rows, i).gt(energy).or(impulses.impulse_rounding(rows, i).gt(max_rounding)))
            };
            let mut all_impacts = unsolved;
            for (i, impact) in impacts.iter().enumerate() {
                let lanes = elastic(impact).and(all_or_none);
                if lanes.any() {
                    all_impacts = all_impacts.or(lanes.and(implausible(rows, i)));
                }
            }
            let [mut changed, mut still_elastic] = [R::Mask::splat(false); 2];
            for (i, impact) in impacts.iter_mut().enumerate() {
                let elastic_lanes = elastic(impact);
                if elastic_lanes.none() {
                    continue;
                }
                let lanes = elastic_lanes.and(all_impacts.or(implausible(rows, i)));
                let offset = rows.normal_offset_mut(i);
                let inelastic = if *resolves_impacts { *offset * (R::one() / impact.normal_factor) } else { *offset - impact.rebound };
                if let Some(contact) = deferred.iter_mut().find(|contact| contact.contact == i) {
                    contact.bias = R::select(lanes, contact.bias + (inelastic - *offset), contact.bias);
                }
                *offset = R::select(lanes, inelastic, *offset);
                impact.normal_factor = R::select(lanes, R::one(), impact.normal_factor);
                (changed, still_elastic) = (changed.or(lanes), still_elastic.or(elastic_lanes.and_not(lanes)));
            }
            *rebounding_at_step_end = rebounding_at_step_end.and_not(changed.and_not(still_elastic));
            changed
        })
    }

    /// Lanes in which the midpoint rule places an impact at its time within the step, even if the impact became inelastic.
    #[inline(always)]
    pub fn midpoint_impact_lanes(&self) -> R::Mask {
        let mut lanes = R::Mask::splat(false);
        if !self.resolves_impacts {
            return lanes;
        }
        for impact in &self.impacts {
            lanes = lanes.or(impact.lanes);
        }
        lanes
    }
}

/// Data of a step with impacts, as input of the position solve.
pub(crate) struct ImpactStep<'a, R: Real> {
    /// Constraint problem of the step.
    pub(crate) problem: &'a ConstraintProblem<R>,
    /// Factors of the mass matrix.
    pub(crate) mass: &'a MassMatrix<R>,
    /// Contacts of the step.
    pub(crate) contacts: &'a Contacts<R>,
    /// Free velocity, nv.
    pub(crate) free: &'a [R],
    /// Overlap that position correction leaves, m.
    pub(crate) slop: f64,
    /// Time step, s.
    pub(crate) h: R,
    /// Evaluation time of each mechanism.
    pub(crate) times: &'a EvaluationTimes<R>,
    /// Lanes with an impact.
    pub(crate) lanes: R::Mask,
}

impl<R: Real> ImpactStep<'_, R> {
    /// Sets the offset of the normal row of contact `i` in the position solve to (gap at the end of the step) / h, in the lanes `lanes`.
    ///
    /// After the evaluation of contacts, positions move by time_after v+ + h correction. With the normal velocity v_position = v_n+ +
    /// correction of the position solve, the end gap is gap + h v_position - (h - time_after) v_n+. For a contact that overlaps by more
    /// than the slop, the offset does not change. `impulses` are the impulses of the velocity solution.
    #[inline(always)]
    fn set_end_gap_offset(&self, i: usize, times: &SlotTimes<R>, lanes: R::Mask, impulses: &Iterate<R>, positions: &mut PositionRows<R>) {
        let Self { problem, contacts, slop, h, .. } = *self;
        let rows = &problem.rows;
        let slot = problem.slot_of(i);
        let g = i.checked_sub(rows.contacts.len()).map_or_else(|| rows.contacts[i].g[0], |k| rows.rolling_contacts[k].g[0]);
        let change = rows.normal_velocity_above_target(i, &impulses.w) - g;
        let distance = contacts.data[slot].point.distance;
        let gap = distance.max(R::zero());
        positions.replace_normal_offset(
            i,
            lanes.and(distance.ge(-R::of(slop))),
            #[inline(always)]
            |offset| {
                let free_normal = offset - gap / times.closing;
                free_normal + (gap - (free_normal + change) * (h - times.after)) / h
            },
        );
    }

    /// Excludes contacts that bounce from the position solve, except those that another impact pushes too deep.
    ///
    /// A small overlap at the end of a step is harmless if the surfaces separate: the next step still finds the impact that caused it. The
    /// correction of such an overlap would change the energy. An overlap is too deep if it exceeds half the tunnelling distance, which is a
    /// quarter of the sum of the inscribed radii. The correction of a still deeper overlap could push the geoms apart on the far side.
    pub(crate) fn leave_out_impacts(&self, compiled: &LaneModel<R>, positions: &mut PositionRows<R>) {
        let Self { problem, contacts, slop, h, .. } = *self;
        kernel!(R, || {
            for (i, impact) in problem.impacts.iter().enumerate() {
                let impact_lanes = self.lanes.and(impact.lanes);
                if impact_lanes.none() {
                    continue;
                }
                let slot = problem.slot_of(i);
                let tunnelling_distance = tunnelling_distance(compiled, contacts, slot, impact_lanes.bits());
                let end = positions.normal_offset(i) * h;
                let harmless = end.ge(tunnelling_distance * R::of(-0.5)).and(contacts.data[slot].point.distance.ge(-R::of(slop)));
                positions.leave_out_contact(i, impact_lanes.and(harmless));
            }
        })
    }
}

impl<R: Real> PositionSolution<R> {
    /// Removes the impulses of impacts from the position solve in the lanes `lanes`.
    ///
    /// `impulses` are the impulses of the velocity solution. The function writes the displacement by the impulses, divided by h, to
    /// `impact_displacement`: (1 + (time_before - t) / h) dv for an impact at time t. The term with t can be enormous if large impulses at
    /// different times cancel. The change by this term is therefore bounded by [`MAX_REBOUND_SPEED_RATIO`] times the free velocity or the
    /// solution, whichever has more kinetic energy.
    pub(crate) fn remove_impacts(&mut self, compiled: &LaneModel<R>, impulses: &mut Iterate<R>, step: &ImpactStep<'_, R>) {
        kernel!(R, || {
            let ImpactStep { problem, contacts, mass, free, h, lanes, .. } = *step;
            let (Self { rows: positions, impact_displacement: moved, correction: removed, .. }, rows) = (self, &problem.rows);
            let sliding_contacts = rows.contacts.len();
            let twice_energy = max_twice_energy(compiled, mass, free, impulses, moved);
            moved.fill(R::zero());
            removed.fill(R::zero());
            for (i, impact) in problem.impacts.iter().enumerate() {
                let impact_lanes = lanes.and(impact.lanes);
                if impact_lanes.none() {
                    continue;
                }
                let times = step.times.of_slot(compiled, contacts, problem.slot_of(i), impact_lanes.bits());
                step.set_end_gap_offset(i, &times, impact_lanes, impulses, positions);
                let weight = R::one() + (times.before / h - impact.time_fraction);
                if i < sliding_contacts {
                    let lambda = select(impact_lanes, impulses.contacts[i], zero());
                    rows.contacts.add(&rows.contacts[i], lambda, removed);
                    rows.contacts.add(&rows.contacts[i], scale(lambda, weight), moved);
                    impulses.contacts[i] = select(impact_lanes, zero(), impulses.contacts[i]);
                } else {
                    let k = i - sliding_contacts;
                    let lambda = select(impact_lanes, impulses.rolling_contacts[k], zero());
                    rows.rolling_contacts.add(&rows.rolling_contacts[k], lambda, removed);
                    rows.rolling_contacts.add(&rows.rolling_contacts[k], scale(lambda, weight), moved);
                    impulses.rolling_contacts[k] = select(impact_lanes, zero(), impulses.rolling_contacts[k]);
                }
            }
            for (w, &removed) in impulses.w.iter_mut().zip(&*removed) {
                *w = R::select(lanes, *w - removed, *w);
            }
            bound_change(moved, removed, twice_energy * R::of(MAX_REBOUND_SPEED_RATIO.powi(2)), lanes);
            mass.unscale(compiled, moved);
        });
    }

    /// Adds `impact_displacement`, as a change of the free velocity, to the offsets of the position rows in the lanes `lanes`. Overwrites
    /// `impact_displacement`.
    pub(crate) fn shift(&mut self, compiled: &LaneModel<R>, mass: &MassMatrix<R>, problem: &ConstraintProblem<R>, lanes: R::Mask) {
        kernel!(R, || {
            let Self { rows: positions, impact_displacement: change, .. } = self;
            mass.scale(compiled, change);
            positions.shift(&problem.rows, change, lanes);
            shift_impacts(
                &problem.impacts,
                lanes,
                R::one(),
                #[inline(always)]
                |i, impact_lanes, weights| positions.shift_contact(&problem.rows, i, change, impact_lanes, weights),
            );
        })
    }
}

/// Twice the kinetic energy of the free velocity or of the solution, whichever is larger, J. Overwrites `scaled`.
#[inline(always)]
fn max_twice_energy<R: Real>(compiled: &LaneModel<R>, mass: &MassMatrix<R>, free: &[R], impulses: &Iterate<R>, scaled: &mut [R]) -> R {
    scaled.copy_from_slice(free);
    mass.scale(compiled, scaled);
    let (mut before, mut after) = (R::zero(), R::zero());
    for (&free, &change) in scaled.iter().zip(&impulses.w) {
        before += free.square();
        after += (free + change).square();
    }
    before.max(after)
}

/// Lanes of `lanes` in which the squared length `square` of a vector exceeds `most`, and the factor that shrinks the vector to the squared
/// length `most`. The factor is meaningless in other lanes.
#[inline(always)]
pub(crate) fn shrink_factor<R: Real>(square: R, most: R, lanes: R::Mask) -> (R::Mask, R) {
    let lanes = lanes.and(square.gt(most));
    (lanes, (most / R::select(lanes, square, R::one())).sqrt())
}

/// Limits the difference of two scaled velocities in the lanes `lanes`: changes `moved` so that its squared distance from `removed` is at
/// most `most`.
#[inline(always)]
fn bound_change<R: Real>(moved: &mut [R], removed: &[R], most: R, lanes: R::Mask) {
    let mut square = R::zero();
    for (&moved, &removed) in moved.iter().zip(removed) {
        square += (moved - removed).square();
    }
    let (lanes, factor) = shrink_factor(square, most, lanes);
    if lanes.none() {
        return;
    }
    for (moved, &removed) in moved.iter_mut().zip(removed) {
        *moved = R::select(lanes, removed + (*moved - removed) * factor, *moved);
    }
}

/// Whether any contact is elastic (restitution above zero).
#[inline(always)]
pub(crate) fn any_elastic<R: Real>(contacts: &Contacts<R>) -> bool {
    (0..contacts.slots()).any(|k| contacts.elastic(k).any())
}
