//! Constraint problem of a step with hard contact. Stage 4 assembles it; stage 5 solves it for velocities, and stage 8 for positions.

use stepper_real::{Mask, Real, Scalar, kernel};
use stepper_solve::{Capacity, MAX_CONTACT_ROWS, Problem, System};

use crate::compile::{LaneModel, ModelStructure};
use crate::dynamics::inertia::MassMatrix;
use crate::math::lanes::each_of;
use crate::math::spatial::*;

/// Constraint problem of a step with hard contact, with the model element of each row.
///
/// Stage 4 assembles the rows. Afterwards the step updates their offsets g, which contain the free velocity
/// ([`ConstraintProblem::shift`]). It also activates deferred contacts, whose rows the solver leaves out at first
/// (`ConstraintProblem::activate`).
#[derive(Clone, Debug)]
pub struct ConstraintProblem<R: Real> {
    /// Rows of the problem, as input of the solver.
    pub rows: Problem<R>,
    /// Index of the impulse of every scalar row in the list of impulses [`VelocitySolution::scalar_impulse`].
    ///
    /// [`VelocitySolution::scalar_impulse`]: crate::constraints::velocity_solution::VelocitySolution::scalar_impulse
    pub impulse_indices: Vec<usize>,
    /// Slot of each contact of the problem, ascending. An elastic contact that neither bounces nor rests in this step has no rows.
    pub contact_slots: Vec<ContactSlot<R>>,
    /// Lengths, m, that scale the rotation rows (spin, roll1, roll2) of each contact with torsional or rolling friction.
    pub(crate) rotation_scales: Vec<V3<R>>,
    /// Lanes with at least one row. Rows of deferred contacts do not count, nor do those that a doubtful collision activated.
    pub constrained: R::Mask,
    /// Lanes that need the position solve of stage 8: because of position errors, or because a contact bounces in a flight without an end.
    pub needs_position_solve: R::Mask,
    /// Lanes whose velocities contain a Baumgarte position correction.
    pub biased: R::Mask,
    /// Whether some rows may be immovable: no degree of freedom changes their velocity.
    pub(crate) may_have_immovable_rows: bool,
    /// Impact of every contact. Empty if no contact is elastic.
    pub(crate) impacts: Vec<Impact<R>>,
    /// Whether some contact is elastic (restitution above zero).
    pub(crate) elastic: bool,
    /// Approaching contacts, whose rows the solver leaves out (defers) until their geoms collide in the predicted or solved motion.
    pub(crate) deferred: Vec<DeferredContact<R>>,
    /// Curvature terms that the offsets of friction rows contain.
    pub(crate) curvature_terms: Vec<CurvatureTerms<R>>,
    /// Lanes in which a link rotates too far until the next evaluation of contacts for a straight path of its surface.
    pub(crate) turning: R::Mask,
}

/// Slot of a contact of the problem.
#[derive(Clone, Copy, Debug)]
pub struct ContactSlot<R: Real> {
    /// Index of the slot in the contact set.
    pub slot: usize,
    /// Lanes of the slot with the contact.
    pub lanes: R::Mask,
}

/// Impact of a contact that bounces.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Impact<R: Real> {
    /// Lanes in which the contact bounces. They include lanes in which its surfaces touch and separate: an impact elsewhere may push them
    /// together again.
    pub(crate) lanes: R::Mask,
    /// Lanes in which the contact collides in a flight that ignores impacts. It has no rows there.
    pub(crate) ignored: R::Mask,
    /// Bias of the normal row, m/s: the coefficient of restitution times the normal velocity without the impact. 0 where
    /// [`ConstraintProblem::drop_restitution`] made the impact inelastic.
    pub(crate) rebound: R,
}

/// Deferred contact: a contact whose rows the solver leaves out in some lanes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DeferredContact<R: Real> {
    /// Index of the contact in the problem.
    pub(crate) contact: usize,
    /// Index of the contact's slot in the contact set.
    pub(crate) slot: usize,
    /// Lanes in which the solver leaves out the rows.
    pub(crate) lanes: R::Mask,
    /// Lanes in which a doubtful collision of the predicted motion activated the rows. A collision is doubtful if the error of the
    /// prediction can cause its overlap.
    pub(crate) doubtful: R::Mask,
    /// Lanes in which the contact bounces. There `bias` follows from Newton's law of restitution.
    pub(crate) bounces: R::Mask,
    /// Bias of the normal row, m/s: the row's offset g minus the normal velocity without impulses.
    pub(crate) bias: R,
    /// Initial impulse of the rows when they are activated, N s and N m s.
    pub(crate) impulse: [R; MAX_CONTACT_ROWS],
}

/// Curvature terms in the offsets of one contact's friction rows. A curvature term is the change of the row's velocity by the motion of the
/// contact point until the end of the step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CurvatureTerms<R: Real> {
    /// Index of the contact in the problem.
    pub(crate) contact: usize,
    /// Curvature term of each tangent, m/s. 0 where it was removed.
    pub(crate) terms: [R; 2],
}

impl<R: Real> ConstraintProblem<R> {
    /// Adds the lanes of `lanes` in which a constraint acts on each kinematic tree to `trees`.
    pub(crate) fn add_constrained_trees(&self, compiled: &LaneModel<R>, lanes: R::Mask, trees: &mut [R::Mask]) {
        for lane in each_of(self.constrained.and(lanes).bits()) {
            let own = R::Mask::from_bits(1 << lane);
            System::from(&self.rows).for_each_column_set(lane, |dofs| {
                for d in dofs {
                    let tree = &mut trees[compiled.dofs[d as usize].tree];
                    *tree = tree.or(own);
                }
            });
        }
    }

    /// Index in the problem of the contact in slot `k` and lane `lane`. `None` if the problem does not have it.
    #[inline(always)]
    pub(crate) fn contact_in_slot(&self, k: usize, lane: usize) -> Option<usize> {
        let first = self.contact_slots.partition_point(|contact| contact.slot < k);
        let mut same = self.contact_slots[first..].iter().take_while(|contact| contact.slot == k);
        same.position(
            #[inline(always)]
            |contact| contact.lanes.bits() >> lane & 1 == 1,
        )
        .map(|i| first + i)
    }

    /// Workspace for a compiled model with at most `max_contacts` contacts per environment.
    pub fn new(compiled: &ModelStructure<R::Scalar>, max_contacts: usize) -> Self {
        let capacity = capacity_of(compiled, max_contacts, R::LANES);
        let none = R::Mask::splat(false);
        Self {
            rows: Problem::new(&capacity),
            impulse_indices: Vec::with_capacity(capacity.scalars),
            contact_slots: Vec::with_capacity(capacity.all_contacts()),
            rotation_scales: Vec::with_capacity(capacity.all_contacts() - max_contacts),
            constrained: none,
            needs_position_solve: none,
            biased: none,
            may_have_immovable_rows: false,
            impacts: Vec::with_capacity(capacity.all_contacts()),
            elastic: false,
            deferred: Vec::with_capacity(capacity.all_contacts()),
            curvature_terms: Vec::with_capacity(capacity.all_contacts()),
            turning: none,
        }
    }

    /// Lanes in which a contact bounces.
    #[inline(always)]
    pub(crate) fn impact_lanes(&self) -> R::Mask {
        self.impacts.iter().fold(R::Mask::splat(false), |lanes, impact| lanes.or(impact.lanes))
    }

    /// Updates the offsets g of the rows after the free velocity has changed by `change`. Overwrites `change`.
    pub fn shift(&mut self, compiled: &LaneModel<R>, mass: &MassMatrix<R>, change: &mut [R]) {
        if !self.rows.is_empty() {
            kernel!(R, || {
                mass.scale(compiled, change);
                self.rows.shift(change);
            })
        }
    }
}

/// Capacity of the solver for all rows that a compiled model can have.
///
/// A contact involves the ancestors of two frames in each of its lanes. Every row also involves the degrees of freedom that eliminated
/// equalities couple to it.
pub(crate) fn capacity_of<S: Scalar>(compiled: &ModelStructure<S>, contacts: usize, lanes: usize) -> Capacity {
    let coupled = compiled.equalities.iter().filter(|b| b.eliminated).map(|b| b.dofs.len()).sum::<usize>();
    let with_coupled = |entries: usize| (entries + coupled).min(compiled.nv);
    let depth = |dof: usize| with_coupled(compiled.dofs[dof].depth);
    let single = compiled.limits.iter().map(|l| depth(l.dof)).chain(compiled.frictions.iter().map(|f| depth(f.dof))).sum::<usize>();
    let balls = compiled.ball_limits.iter().map(|b| depth(b.dof + 2)).sum::<usize>();
    let equalities = compiled.equalities.iter().map(|b| b.rows * with_coupled(b.dofs.len())).sum::<usize>();
    let tendons = compiled.tendons.iter().map(|t| 3 * with_coupled(t.dofs.len())).sum::<usize>();
    let mut moved: Vec<usize> = compiled.moved_dofs.iter().map(|m| m.iter().map(|w| w.count_ones() as usize).sum()).collect();
    moved.sort_unstable();
    let deepest: usize = moved.iter().rev().take(2).sum();
    let mut capacity = Capacity::of_coordinates(compiled.nv);
    capacity.scalars = compiled.scalar_impulses;
    capacity.scalar_entries = single + balls + equalities + tendons;
    capacity.contacts = contacts;
    // Lanes of a slot whose contacts have different numbers of rows are separate contacts.
    let rotating = if compiled.has_rolling_friction { contacts } else { 0 };
    (capacity.torsional_contacts, capacity.rolling_contacts) = (rotating, rotating);
    capacity.columns_per_contact = with_coupled(deepest * lanes);
    capacity
}
