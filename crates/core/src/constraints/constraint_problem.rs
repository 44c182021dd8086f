//! Constraint problem of a step. Stage 4 assembles it, and stages 5 and 8 solve it, for velocities and for positions.

use stepper_real::{Mask, Real, Scalar};
use stepper_solve::{Capacity, Problem};

use crate::compile::{LaneModel, ModelStructure};
use crate::constraints::active_equalities::ActiveEqualities;
use crate::constraints::soft::SoftSystem;
use crate::dynamics::inertia::MassMatrix;
use crate::math::spatial::*;

/// Constraint problem of a step, with the element of the model that each row belongs to.
///
/// Rows are fixed once stage 4 has assembled them. The passes of a step change two things: the offsets g, which contain the free velocity
/// ([`ConstraintProblem::shift`]), and the deferred contacts that are active ([`ConstraintProblem::activate`]).
#[derive(Clone, Debug)]
pub struct ConstraintProblem<R: Real> {
    /// Rows in the form of the solver.
    pub rows: Problem<R>,
    /// Index of the impulse of every scalar row, in [`VelocitySolution::scalar_impulse`].
    ///
    /// [`VelocitySolution::scalar_impulse`]: crate::constraints::velocity_solution::VelocitySolution::scalar_impulse
    pub owners: Vec<usize>,
    /// Slot of every contact of three rows, and the lanes in which it exists.
    pub slots: Vec<(usize, R::Mask)>,
    /// Slot and lanes of every contact of six rows, and the lengths by which its three rotation rows are scaled, m.
    pub rolling_slots: Vec<(usize, R::Mask, V3<R>)>,
    /// Lanes with at least one row.
    pub constrained: R::Mask,
    /// Lanes with position errors, which need a separate solve in stage 8. Lanes with impacts need it too.
    pub needs_position_solve: R::Mask,
    /// Lanes in which Baumgarte's bias is part of the velocities.
    pub biased: R::Mask,
    /// Lanes in which a contact bounces by Euler's rule; [`Self::midpoint_impact_lanes`] returns those of the midpoint rule. In stage 8,
    /// only the speeds of the step bound their correction.
    pub euler_impact_lanes: R::Mask,
    /// Whether the problem may have immovable rows: rows without mobility.
    pub(crate) may_have_immovable_rows: bool,
    /// Impacts of the contacts, in their order: contacts of three rows first. Empty if no contact is elastic.
    pub(crate) impacts: Vec<Impact<R>>,
    /// Whether some contact is elastic.
    pub(crate) elastic: bool,
    /// Whether the step resolves times of impacts: the scheme does, and some contact is elastic.
    pub(crate) resolves_impacts: bool,
    /// Approaching contacts, whose rows are deferred until the solved motion closes their gap.
    pub(crate) deferred: Vec<DeferredContact<R>>,
    /// Curvature terms in the offsets of friction rows.
    pub(crate) curvature_terms: Vec<CurvatureTerms<R>>,
    /// Time to the evaluation point of the next step, within which a row lets its gap close, s.
    pub(crate) closing_time: R,
    /// Lanes in which each equality of the model is active.
    pub(crate) active_equalities: ActiveEqualities<R>,
    /// Rows of MuJoCo's contact law. With that law `rows` is empty.
    pub(crate) soft: Option<Box<SoftSystem<R>>>,
}

/// Contact that bounces within the step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Impact<R: Real> {
    /// Lanes in which the contact bounces.
    pub(crate) lanes: R::Mask,
    /// Time of the impact after the beginning of the step, as a fraction of the step. 1 with Euler's rule.
    pub(crate) time_fraction: R,
    /// Factor 1 + e of the normal velocity; 1 once [`ConstraintProblem::drop_restitution`] made the impact inelastic.
    pub(crate) normal_factor: R,
    /// Rebound velocity that Euler's rule adds to the offset of the normal row, m/s. 0 with the midpoint rule, of which `normal_factor`
    /// scales the whole offset.
    pub(crate) rebound: R,
}

/// Contact whose rows are deferred in some lanes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DeferredContact<R: Real> {
    /// Index of the contact in the problem: those of three rows come first, then those of six.
    pub(crate) contact: usize,
    /// Slot of the contact in the contact set.
    pub(crate) slot: usize,
    /// Lanes in which the rows are deferred.
    pub(crate) lanes: R::Mask,
    /// Lanes in which a doubtful collision of the prediction activated the rows.
    pub(crate) doubtful: R::Mask,
    /// Lanes in which the contact bounces. The bias there is the rebound velocity.
    pub(crate) bounces: R::Mask,
    /// Bias of the normal row, m/s: its offset g minus its velocity without impulses.
    pub(crate) bias: R,
    /// Initial impulse of the rows at activation, N s and N m s.
    pub(crate) impulse: [R; 6],
}

/// Curvature terms in the offsets of one contact.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CurvatureTerms<R: Real> {
    /// Index of the contact in the problem: those of three rows come first, then those of six.
    pub(crate) contact: usize,
    /// Term in the offset of each tangent, m/s. 0 where it is removed.
    pub(crate) terms: [R; 2],
}

impl<R: Real> ConstraintProblem<R> {
    /// Problem for a compiled model with at most `max_contacts` contacts per environment.
    pub fn new(compiled: &ModelStructure<R::Scalar>, max_contacts: usize) -> Self {
        // With MuJoCo's law a slot is one contact for the lanes that touch the same trees. With several trees there is at most one contact
        // per lane, with that lane's coordinates.
        let parts = if compiled.softness.is_some() && compiled.ntree > 1 { R::LANES } else { 1 };
        let (soft_contacts, soft_support) = (max_contacts * parts, capacity_of(compiled, 0, R::LANES / parts).contact_support);
        let capacity = capacity_of(compiled, max_contacts, R::LANES);
        let rolling_contacts = capacity.rolling_contacts;
        let none = R::Mask::splat(false);
        Self {
            rows: Problem::new(&capacity),
            owners: Vec::with_capacity(capacity.scalars),
            slots: Vec::with_capacity(soft_contacts),
            rolling_slots: Vec::with_capacity(if compiled.has_rolling_friction { soft_contacts } else { 0 }),
            constrained: none,
            needs_position_solve: none,
            biased: none,
            euler_impact_lanes: none,
            may_have_immovable_rows: false,
            impacts: Vec::with_capacity(max_contacts + rolling_contacts),
            elastic: false,
            resolves_impacts: false,
            deferred: Vec::with_capacity(max_contacts + rolling_contacts),
            curvature_terms: Vec::with_capacity(max_contacts + rolling_contacts),
            closing_time: R::zero(),
            active_equalities: ActiveEqualities::new(compiled),
            soft: SoftSystem::new(compiled, max_contacts, soft_contacts, soft_support),
        }
    }

    /// Slot of contact `i` of the problem in the contact set. The index counts contacts of three rows, then of six.
    pub(crate) fn slot_of(&self, i: usize) -> usize {
        i.checked_sub(self.slots.len()).map_or_else(|| self.slots[i].0, |k| self.rolling_slots[k].0)
    }

    /// Adds a change of the free velocity, in the lanes `lanes`, to the offsets g of the rows. Overwrites `change`.
    pub fn shift(&mut self, compiled: &LaneModel<R>, mass: &MassMatrix<R>, change: &mut [R], lanes: R::Mask) {
        if self.rows.is_empty() {
            return;
        }
        R::vectorize(
            #[inline(always)]
            || {
                mass.scale(compiled, change);
                self.rows.shift(change, lanes);
                self.undo_change_after_impacts(change, lanes);
            },
        )
    }
}

/// Capacity for all rows of a compiled model.
///
/// A contact touches the ancestors of two frames in each of its lanes, and every row the degrees of freedom that equalities couple to it.
pub(crate) fn capacity_of<S: Scalar>(compiled: &ModelStructure<S>, contacts: usize, lanes: usize) -> Capacity {
    let coupled = compiled.equalities.iter().filter(|b| b.eliminated).map(|b| b.support.len()).sum::<usize>();
    let with_coupled = |entries: usize| (entries + coupled).min(compiled.nv);
    let depth = |dof: usize| with_coupled(compiled.dofs[dof].depth);
    let single = compiled.limits.iter().map(|l| depth(l.dof)).chain(compiled.frictions.iter().map(|f| depth(f.dof))).sum::<usize>();
    let balls = compiled.ball_limits.iter().map(|b| depth(b.dof + 2)).sum::<usize>();
    let equalities = compiled.equalities.iter().map(|b| b.rows * with_coupled(b.support.len())).sum::<usize>();
    let tendons = compiled.tendons.iter().map(|t| 3 * with_coupled(t.support.len())).sum::<usize>();
    let mut moved: Vec<usize> = compiled.moved_dofs.iter().map(|m| m.iter().map(|w| w.count_ones() as usize).sum()).collect();
    moved.sort_unstable();
    let deepest: usize = moved.iter().rev().take(2).sum();
    let mut capacity = Capacity::of_coordinates(compiled.nv);
    capacity.scalars = compiled.scalar_impulses;
    capacity.scalar_entries = single + balls + equalities + tendons;
    capacity.contacts = contacts;
    capacity.rolling_contacts = if compiled.has_rolling_friction { contacts } else { 0 };
    capacity.contact_support = with_coupled(deepest * lanes);
    capacity
}
