//! Contacts that bounce.
//!
//! Euler's rule takes Newton's law on the free velocity, which is the textbook's recursion. The midpoint rule takes it at the time t of the
//! impact (see [`crate::constraints::impact_time`]): with the velocities v- that the free motion has then, the rows demand
//!
//! ```text
//! 0 <= lambda_n, complementary to v_n+ + e v_n- >= 0     so g_n = (1 + e) v_n-(t)
//! friction against v_t+                                  so g_t = v_t-(t)
//! ```
//!
//! The impulse acts for what is left of the step, and the positions go on from where the step is taken with the velocity after it, which
//! gives every impulse the time `time_after`: what is missing, (h - t - time_after) M^-1 J^T lambda, is added where the positions are
//! solved apart, so that other contacts see it.

use stepper_real::{Mask, Real};

use crate::collision::contact_set::{Contacts, Slot};
use crate::compile::LaneModel;
use crate::constraints::constraint_set::{AssemblyInput, Constraints, Impact};
use crate::constraints::equality::RowInput;
use crate::constraints::impact_time::Flight;
use crate::dynamics::inertia::MassMatrix;
use crate::math::spatial::*;
use crate::options::StepSettings;

/// Velocities of a contact's rows: g of the step, and when positions are solved apart.
type Demands<R> = [[R; 2]; 3];

impl<R: Real> Constraints<R> {
    /// Change of the velocities of the rows in `column` by the free motion.
    #[inline(always)]
    pub(crate) fn free_change(&self, assembly: &AssemblyInput<'_, R>) -> V3<R> {
        let mut change = zero();
        for &d in &self.support {
            let d = d as usize;
            change = add_scaled(change, self.column[d], assembly.v_free[d] - assembly.v[d]);
        }
        change
    }

    /// What Euler's rule adds to the free velocity of a normal row, and the lanes that have the row.
    ///
    /// All closed contacts share an impact: 0 <= lambda, complementary to v+ + e v- >= 0, also where v- parts. A contact slower than the
    /// threshold before the step rests: it does not bounce from the velocity that gravity gives it within the step.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "one contact, every part of it named at the call")]
    pub(crate) fn bounce(
        &mut self,
        compiled: &LaneModel<R>,
        options: &StepSettings,
        slot: &Slot<R>,
        assembly: &AssemblyInput<'_, R>,
        active: R::Mask,
        [free, before]: [R; 2],
        bias: R,
    ) -> (R, R::Mask) {
        let e = slot.restitution;
        let elastic = active.and(e.gt(R::zero()));
        if assembly.in_the_middle || elastic.none() {
            return (bias, active);
        }
        let (h, phi, threshold) = (assembly.h, slot.point.distance, R::of(options.restitution_threshold));
        // What a slow contact and gravity close within the step.
        let near = phi.le(h * (threshold + h * norm(compiled.params.gravity())) + R::of(options.slop));
        let rests = before.abs().le(threshold).and(near);
        let closed = phi.le(R::of(options.slop)).or((phi + h * free).lt(R::zero()));
        let bounces = elastic.and(closed).and(free.abs().gt(threshold)).and_not(rests);
        self.needs_position_solve = self.needs_position_solve.or(bounces);
        self.rebounding = self.rebounding.or(bounces);
        let stays = active.and_not(elastic).or(bounces).or(elastic.and(rests));
        (R::select(bounces, e * free, bias), stays)
    }

    /// The law of the midpoint rule, in place of the `demands` of a contact that does not bounce. `free` are the rows' velocities without
    /// constraints before the elimination of equalities, `change` what the free motion changed of them in the step; after the
    /// elimination the free velocity is `demands` less the normal's `bias`. Returns the lanes that have the rows. A kernel of its own, as
    /// [`Constraints::add_curve`].
    #[inline(never)]
    pub(crate) fn bounce_within(
        &mut self,
        input: RowInput<'_, R>,
        slot: &Slot<R>,
        active: R::Mask,
        [free, change]: [V3<R>; 2],
        bias: R,
        demands: &mut Demands<R>,
    ) -> R::Mask {
        R::vectorize(
            #[inline(always)]
            || {
                let RowInput { compiled, options, assembly, .. } = input;
                let e = slot.restitution;
                let elastic = active.and(e.gt(R::zero()));
                if elastic.none() {
                    self.impacts.push(Impact { lanes: elastic, overlapping: elastic, time_fraction: R::zero(), normal_factor: R::zero() });
                    return active;
                }
                let before = sub(free, change);
                let held = [demands[0][0] - bias, demands[1][0], demands[2][0]];
                let flight =
                    Flight { gap: slot.point.distance, before: before[0], free: held[0], time_before: assembly.time_before, h: assembly.h };
                let meeting = flight.predict(options, norm(compiled.params.gravity()), e, elastic);
                let bounces = meeting.strikes.or(meeting.parts);
                let (time_fraction, normal_factor) = (meeting.time / assembly.h, e + R::one());
                let at = add_scaled(before, sub(held, before), time_fraction);
                for (k, demand) in demands.iter_mut().enumerate() {
                    let law = if k == 0 { at[0] * normal_factor } else { at[k] };
                    demand[0] = R::select(bounces, law, demand[0]);
                }
                let overlapping = slot.point.distance.lt(-R::of(options.slop));
                self.impacts.push(Impact { lanes: bounces, overlapping, time_fraction, normal_factor });
                active.and_not(elastic).or(bounces).or(meeting.rests)
            },
        )
    }

    /// The velocity of rows of turning at the time of the impact that was added last, where it bounces: from that without constraints and
    /// its `change` by the free motion, as the demands are.
    #[inline(always)]
    pub(crate) fn turn_at_impact(&self, change: V3<R>, turns: &mut Demands<R>) {
        if let Some(impact) = self.impacts.last() {
            for (turn, change) in turns.iter_mut().zip(change) {
                turn[0] = R::select(impact.lanes, turn[0] - change * (R::one() - impact.time_fraction), turn[0]);
            }
        }
    }

    /// Takes back, of a `change` (scaled) of the velocity after the step, what came after the impacts.
    #[inline(always)]
    pub(crate) fn undo_change_after_impacts(&mut self, change: &[R], lanes: R::Mask) {
        let Self { problem, impacts, .. } = self;
        shift_impacts(
            impacts,
            lanes,
            after_impact,
            #[inline(always)]
            |i, there, weights| problem.shift_contact(i, change, there, weights),
        );
    }

    /// Adds a change of the velocity before the impacts, given as that of the velocity after the step if they were not; `change` is used
    /// up.
    pub fn shift_before_impacts(&mut self, compiled: &LaneModel<R>, mass: &MassMatrix<R>, change: &mut [R], lanes: R::Mask) {
        if self.impacts.is_empty() {
            return;
        }
        R::vectorize(
            #[inline(always)]
            || {
                mass.scale(compiled, change);
                let Self { problem, impacts, .. } = self;
                shift_impacts(
                    impacts,
                    lanes,
                    before_impact,
                    #[inline(always)]
                    |i, there, weights| problem.shift_contact(i, change, there, weights),
                );
            },
        )
    }

    /// Lanes in which a contact bounces.
    #[inline(always)]
    pub fn bouncing(&self) -> R::Mask {
        let mut lanes = R::Mask::splat(false);
        for impact in &self.impacts {
            lanes = lanes.or(impact.lanes);
        }
        lanes
    }

    /// Takes the impulses of impacts away in the lanes `lanes`, and their contacts out of the position solve, but that what overlapped
    /// before is pushed out where it does not leave fast enough by itself. Leaves in `moved` the velocity that would carry the positions as
    /// far in a step as the impulses do, from where the step is taken, `time_before` seconds after its beginning: beyond the velocity after
    /// the step, for the rest of it.
    pub fn remove_impacts(
        &mut self,
        compiled: &LaneModel<R>,
        mass: &MassMatrix<R>,
        [h, time_before]: [R; 2],
        lanes: R::Mask,
        moved: &mut [R],
    ) {
        R::vectorize(
            #[inline(always)]
            || {
                let Self { problem, positions, iterate, impacts, path: removed, .. } = self;
                let narrow = problem.contacts.len();
                moved.fill(R::zero());
                removed.fill(R::zero());
                for (i, impact) in impacts.iter().enumerate() {
                    let there = lanes.and(impact.lanes);
                    if there.none() {
                        continue;
                    }
                    let weight = R::one() + (time_before / h - impact.time_fraction);
                    if i < narrow {
                        let lambda = select(there, iterate.contacts[i], zero());
                        problem.contacts.add(&problem.contacts[i], lambda, removed);
                        problem.contacts.add(&problem.contacts[i], scale(lambda, weight), moved);
                        iterate.contacts[i] = select(there, zero(), iterate.contacts[i]);
                    } else {
                        let k = i - narrow;
                        let lambda = select(there, iterate.rolling_contacts[k], zero());
                        problem.rolling_contacts.add(&problem.rolling_contacts[k], lambda, removed);
                        problem.rolling_contacts.add(&problem.rolling_contacts[k], scale(lambda, weight), moved);
                        iterate.rolling_contacts[k] = select(there, zero(), iterate.rolling_contacts[k]);
                    }
                    positions.leave_out_contact(i, there.and_not(impact.overlapping));
                }
                for (w, &removed) in iterate.w.iter_mut().zip(&*removed) {
                    *w = R::select(lanes, *w - removed, *w);
                }
                mass.unscale(compiled, moved);
            },
        );
        self.needs_position_solve = self.needs_position_solve.or(lanes);
        self.rebounding = self.rebounding.or(lanes);
    }

    /// Takes up a change of the free velocity of the lanes `lanes` in the rows of the position solve. `change` is used up.
    pub fn shift_positions(&mut self, compiled: &LaneModel<R>, mass: &MassMatrix<R>, change: &mut [R], lanes: R::Mask) {
        R::vectorize(
            #[inline(always)]
            || {
                mass.scale(compiled, change);
                let Self { problem, positions, impacts, .. } = self;
                positions.shift(problem, change, lanes);
                shift_impacts(
                    impacts,
                    lanes,
                    after_impact,
                    #[inline(always)]
                    |i, there, weights| positions.shift_contact(problem, i, change, there, weights),
                );
            },
        )
    }
}

/// Weight of a change of the velocity after the step that the rows of an impact take back: what came after it. Of 1 + e (or 1 for friction)
/// and the fraction of the step before the impact.
#[inline(always)]
fn after_impact<R: Real>(normal_factor: R, time_fraction: R) -> R {
    normal_factor * time_fraction - R::one()
}

/// Weight of a change before the impact, given as that of the velocity after the step.
#[inline(always)]
fn before_impact<R: Real>(normal_factor: R, time_fraction: R) -> R {
    normal_factor * time_fraction
}

/// Calls `shift` with the contacts that bounce in the lanes `lanes`, those lanes, and the weights of the normal row and of friction.
#[inline(always)]
fn shift_impacts<R: Real>(
    impacts: &[Impact<R>],
    lanes: R::Mask,
    weight: impl Fn(R, R) -> R,
    mut shift: impl FnMut(usize, R::Mask, [R; 2]),
) {
    for (i, impact) in impacts.iter().enumerate() {
        let there = lanes.and(impact.lanes);
        if there.any() {
            shift(i, there, [weight(impact.normal_factor, impact.time_fraction), weight(R::one(), impact.time_fraction)]);
        }
    }
}

/// Whether any contact is elastic.
#[inline(always)]
pub(crate) fn any_elastic<R: Real>(contacts: &Contacts<R>) -> bool {
    (0..contacts.slots()).any(|k| contacts.elastic(k).any())
}
