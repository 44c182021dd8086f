//! Worst row of an unsolved step: the constraint row with the largest residual.

use stepper_real::{Mask, Real};
use stepper_solve::{Iterate, System, worst_constraint};

use crate::collision::contact_set::Contacts;
use crate::constraints::constraint_problem::ConstraintProblem;
use crate::math::lanes::{MAX_LANES, each_of};

/// Number that encodes a constraint in a saved state. 0 means none. Scalar rows have the numbers from 1 on, by the index of their impulse.
/// Contacts have the numbers from 2^32 on, by the index of their pair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ConstraintCode(pub u64);

/// Smallest code of a contact: the code of pair 0.
const CONTACTS: u64 = 1 << 32;

/// Constraint that a [`ConstraintCode`] represents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CodedConstraint {
    /// Scalar row, by the index of its impulse in [`crate::constraints::VelocitySolution::scalar_impulse`].
    Scalar(usize),
    /// Contact, by the index of its pair of geoms.
    Contact(usize),
}

impl ConstraintCode {
    fn new(constraint: CodedConstraint) -> Self {
        match constraint {
            CodedConstraint::Scalar(impulse_index) => Self(1 + impulse_index as u64),
            CodedConstraint::Contact(pair) => Self(CONTACTS + pair as u64),
        }
    }

    /// Constraint that the code represents; `None` for code 0.
    pub fn constraint(self) -> Option<CodedConstraint> {
        match self.0 {
            0 => None,
            code if code < CONTACTS => Some(CodedConstraint::Scalar(code as usize - 1)),
            code => Some(CodedConstraint::Contact((code - CONTACTS) as usize)),
        }
    }
}

/// For each lane that a solve left unsolved, the row with the largest residual.
#[derive(Clone, Debug)]
pub struct WorstRows<R: Real> {
    /// Lanes that have a stored row.
    pub lanes: R::Mask,
    codes: [ConstraintCode; MAX_LANES],
}

impl<R: Real> WorstRows<R> {
    /// Empty set, without worst rows.
    pub(crate) fn new() -> Self {
        Self { lanes: R::Mask::splat(false), codes: [ConstraintCode::default(); MAX_LANES] }
    }

    /// Code of the worst row in lane `lane`; code 0 if it has none.
    pub fn of_lane(&self, lane: usize) -> ConstraintCode {
        if self.lanes.bits() >> lane & 1 == 1 { self.codes[lane] } else { ConstraintCode::default() }
    }

    /// Updates the worst rows after a solve of the lanes `solved`: the lanes `unsolved` get their worst row, the others none.
    #[inline(always)]
    pub(crate) fn update(
        &mut self,
        problem: &ConstraintProblem<R>,
        system: System<'_, R>,
        iterate: &Iterate<R>,
        contacts: &Contacts<R>,
        [solved, unsolved]: [R::Mask; 2],
    ) {
        self.lanes = self.lanes.and_not(solved).or(unsolved);
        if unsolved.any() {
            self.find(problem, system, iterate, contacts, unsolved.bits());
        }
    }

    #[cold]
    #[inline(never)]
    fn find(&mut self, problem: &ConstraintProblem<R>, system: System<'_, R>, iterate: &Iterate<R>, contacts: &Contacts<R>, lanes: u32) {
        for lane in each_of(lanes) {
            let worst = worst_constraint(system, iterate, lane).map(|(i, _)| match i.checked_sub(problem.impulse_indices.len()) {
                None => CodedConstraint::Scalar(problem.impulse_indices[i]),
                Some(i) => CodedConstraint::Contact(contacts.ids[problem.slot_of(i)][lane].pair()),
            });
            self.codes[lane] = worst.map_or_else(ConstraintCode::default, ConstraintCode::new);
        }
    }
}
