//! Contacts that bounce: restitution by Newton's law.
//!
//! A flight ends where the first elastic contact of its lane collides ([`crate::constraints::contact::impact_time`]). The contact has no
//! rows in this flight. The substep that follows is the impact: a jump of the velocity at this configuration, in which all touching
//! contacts take part. With the velocities v- before it, the rows of those that bounce are (Moreau 1988)
//!
//! ```text
//! 0 <= lambda_n, complementary to v_n+ + e v_n- >= 0     so g_n = (1 + e) v_n-
//! friction against v_t+                                  so g_t = v_t-
//! ```
//!
//! The work of the impulses lambda is lambda^T G lambda (1/2 - 1/(1 + e)). Here G is the Delassus matrix and e the coefficient of
//! restitution. This work is negative, so that impacts add no energy, and zero for e = 1.
//!
//! Two kinds of flights have no end at an impact: those with Euler's rule, and those after a limited number of impacts in the same step.
//! There the law applies to the velocity after the flight without constraints, and the position solve closes the gap, as in textbooks. If
//! v- is slow and the gap small, the contact rests. A third kind ignores impacts: contacts that collide have no rows, and no law applies.

use stepper_real::{Mask, Real, kernel};
use stepper_solve::{Iterate, Problem};

use crate::collision::contact_set::Contacts;
use crate::constraints::assembler::{Assembler, RowInput, RowState};
use crate::constraints::constraint_problem::{ConstraintProblem, Impact};
use crate::constraints::contact::impact_time::{Flight, ImpactPrediction};
use crate::math::spatial::*;

impl<R: Real> Assembler<'_, R> {
    /// Applies Newton's law of restitution to the contact in slot `k` of `contacts`. Returns the lanes of `exists` in which its rows are
    /// needed.
    ///
    /// `before` is the normal velocity before the substep, m/s, and `offset` that of the normal row in the velocity solve, which the
    /// function changes in contacts that bounce. The offset minus `bias` is the normal velocity without impulses, after the elimination of
    /// equalities. Only problems with an elastic contact call this function.
    #[inline(never)]
    pub(crate) fn bounce(
        &mut self,
        input: &RowInput<'_, R>,
        (contacts, k): (&Contacts<R>, usize),
        exists: R::Mask,
        [before, bias]: [R; 2],
        offset: &mut R,
    ) -> R::Mask {
        kernel!(R, || {
            let RowInput {
                state: RowState { compiled, .. },
                options,
                h,
                longest,
                in_the_middle,
                is_impact,
                bounces_at_end,
                ignores_impacts,
                ..
            } = *input;
            let slot = &contacts.data[k];
            let (e, gap, free) = (slot.restitution, slot.point.distance, *offset - bias);
            let elastic = exists.and(e.gt(R::zero()));
            let mut impact = Impact { lanes: elastic, ignored: elastic, rebound: e * free };
            let mut needed = exists;
            if elastic.any() {
                let [slop, threshold] = [options.slop, options.restitution_threshold].map(R::of);
                let gravity = norm(compiled.params.gravity());
                let (is_fast, touching) = (free.abs().gt(threshold), elastic.and(is_impact));
                // Without an impact time: gaps that a slow contact and gravity can close within the step rest.
                let near = gap.le(h * (threshold + h * gravity) + slop);
                let slow = elastic.and(bounces_at_end).and(before.abs().le(threshold)).and(near);
                let closes = elastic.and(bounces_at_end).and(gap.le(slop).or((gap + h * free).lt(R::zero())));
                let rebounds_at_end = closes.and(is_fast).and_not(slow);
                self.problem.needs_position_solve = self.problem.needs_position_solve.or(rebounds_at_end);
                // Flights that an impact may end: contacts that collide have no rows.
                let time_before = input.times_of_slot(contacts, k, elastic.bits()).before;
                let flight = Flight { gap, before, free, time_before, h, longest, in_the_middle };
                let ImpactPrediction { rests, separates, collides, .. } =
                    flight.predict(options, gravity, e, elastic.and_not(bounces_at_end));
                impact.ignored = collides.and(ignores_impacts);
                impact.lanes = touching.and(is_fast).or(rebounds_at_end);
                needed = exists.and_not(elastic).or(touching).or(impact.lanes).or(slow).or(rests.or(separates));
                *offset = R::select(impact.lanes, free + impact.rebound, *offset);
            }
            self.problem.impacts.push(impact);
            needed
        })
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
            let Self { rows, impacts, deferred, .. } = self;
            let elastic = |impact: &Impact<R>| impact.lanes.and_not(impact.rebound.eq(R::zero()));
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
            let mut changed = R::Mask::splat(false);
            for (i, impact) in impacts.iter_mut().enumerate().filter(|(_, impact)| impact.lanes.any()) {
                let lanes = elastic(impact).and(all_impacts.or(implausible(rows, i)));
                let rebound = R::select(lanes, impact.rebound, R::zero());
                if let Some(contact) = deferred.iter_mut().find(|contact| contact.contact == i) {
                    contact.bias -= rebound;
                }
                rows.contacts.offsets_mut(i)[0] -= rebound;
                impact.rebound -= rebound;
                changed = changed.or(lanes);
            }
            changed
        })
    }
}

/// Whether any contact is elastic (restitution above zero).
#[inline(always)]
pub(crate) fn any_elastic<R: Real>(contacts: &Contacts<R>) -> bool {
    kernel!(R, || {
        let mut any = false;
        for k in 0..contacts.slots() {
            any |= contacts.elastic(k).any();
        }
        any
    })
}
