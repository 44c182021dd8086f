//! Worst row of an unsolved step: the constraint with the largest residual.

use stepper_real::{Mask, Real};
use stepper_solve::{Iterate, System, worst_constraint};

use crate::collision::contact_set::Contacts;
use crate::constraints::constraint_problem::ConstraintProblem;
use crate::math::lanes::{MAX_LANES, each_of};

/// Code of a constraint, as a state stores it: 0 is none, then scalar rows by the index of their impulse, then contacts by their pair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ConstraintCode(pub u64);

/// First code of a contact.
const CONTACTS: u64 = 1 << 32;

/// Constraint that a code names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CodedConstraint {
    /// Scalar row, by the index of its impulse in [`crate::constraints::VelocitySolution::scalar_impulse`].
    Scalar(usize),
    /// Contact, by its pair of geoms.
    Contact(usize),
}

impl ConstraintCode {
    fn new(constraint: CodedConstraint) -> Self {
        match constraint {
            CodedConstraint::Scalar(owner) => Self(1 + owner as u64),
            CodedConstraint::Contact(pair) => Self(CONTACTS + pair as u64),
        }
    }

    /// Constraint of the code, if any.
    pub fn constraint(self) -> Option<CodedConstraint> {
        match self.0 {
            0 => None,
            code if code < CONTACTS => Some(CodedConstraint::Scalar(code as usize - 1)),
            code => Some(CodedConstraint::Contact((code - CONTACTS) as usize)),
        }
    }
}

/// Worst rows of the lanes that a solve left unsolved.
#[derive(Clone, Debug)]
pub struct WorstRows<R: Real> {
    /// Lanes with a worst row.
    pub lanes: R::Mask,
    codes: [ConstraintCode; MAX_LANES],
}

impl<R: Real> WorstRows<R> {
    /// Empty set, without worst rows.
    pub(crate) fn new() -> Self {
        Self { lanes: R::Mask::splat(false), codes: [ConstraintCode::default(); MAX_LANES] }
    }

    /// Worst row of a lane, if any.
    pub fn of_lane(&self, lane: usize) -> ConstraintCode {
        if self.lanes.bits() >> lane & 1 == 1 { self.codes[lane] } else { ConstraintCode::default() }
    }

    /// Updates the worst rows of the lanes `solved`; those in `unsolved` have one.
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
            let worst = worst_constraint(system, iterate, lane).map(|(i, _)| match i.checked_sub(problem.owners.len()) {
                None => CodedConstraint::Scalar(problem.owners[i]),
                Some(i) => {
                    let mut slots = problem.slots.iter().map(|slot| slot.0).chain(problem.rolling_slots.iter().map(|slot| slot.0));
                    CodedConstraint::Contact(contacts.ids[slots.nth(i).expect("every contact has a slot")][lane].pair())
                }
            });
            self.codes[lane] = worst.map_or_else(ConstraintCode::default, ConstraintCode::new);
        }
    }
}
