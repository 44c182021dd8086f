//! Cause of an unsolved step: the constraint row with the largest residual, or the number that is not finite.

use stepper_real::{Mask, Real};
use stepper_solve::{Iterate, System, worst_constraint};

use crate::collision::contact_set::Contacts;
use crate::constraints::constraint_problem::ConstraintProblem;
use crate::math::lanes::{MAX_LANES, each_of};

/// Number that encodes the cause of an unsolved step in a saved state. 0 means none. Scalar rows have the numbers from 1 on, by the index
/// of their impulse. Contacts have the numbers from 2^32 on, by the index of their pair. Numbers that are not finite have those from 2^40,
/// 2^41 ... on, in the order of [`NotFinite`]. Joints that are too fast have those from 2^44 on, by a degree of freedom.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ConstraintCode(pub u64);

/// Smallest code of a contact: the code of pair 0.
const CONTACTS: u64 = 1 << 32;

/// Smallest code of each kind of number in [`NotFinite`].
const NOT_FINITE: [u64; 4] = [1 << 40, 1 << 41, 1 << 42, 1 << 43];

/// Smallest code of a joint that is too fast for the time step.
const TOO_FAST: u64 = 1 << 44;

/// Number that is not finite in a rejected step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotFinite {
    /// Control or activation of an actuator, by the index of the actuator.
    Actuator(usize),
    /// Applied force or torque on a body, by the index of the body.
    AppliedForce(usize),
    /// Pose of a mocap body, by its index among the mocap bodies.
    Mocap(usize),
    /// Position, velocity or applied force of a degree of freedom.
    Dof(usize),
}

/// Cause that a [`ConstraintCode`] represents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CodedConstraint {
    /// Scalar row, by the index of its impulse in [`crate::constraints::VelocitySolution::scalar_impulse`].
    Scalar(usize),
    /// Contact, by the index of its pair of geoms.
    Contact(usize),
    /// Number that is not finite.
    NotFinite(NotFinite),
    /// Joint that is too fast for the time step, by one of its degrees of freedom.
    TooFast(usize),
}

impl ConstraintCode {
    fn new(constraint: CodedConstraint) -> Self {
        match constraint {
            CodedConstraint::Scalar(impulse_index) => Self(1 + impulse_index as u64),
            CodedConstraint::Contact(pair) => Self(CONTACTS + pair as u64),
            CodedConstraint::TooFast(dof) => Self(TOO_FAST + dof as u64),
            CodedConstraint::NotFinite(number) => {
                let (kind, index) = match number {
                    NotFinite::Actuator(index) => (0, index),
                    NotFinite::AppliedForce(index) => (1, index),
                    NotFinite::Mocap(index) => (2, index),
                    NotFinite::Dof(index) => (3, index),
                };
                Self(NOT_FINITE[kind] + index as u64)
            }
        }
    }

    /// Constraint or number that the code represents; `None` for code 0.
    pub fn constraint(self) -> Option<CodedConstraint> {
        let code = self.0;
        if code >= TOO_FAST {
            return Some(CodedConstraint::TooFast((code - TOO_FAST) as usize));
        }
        if let Some(kind) = NOT_FINITE.iter().rposition(|first| code >= *first) {
            let index = (code - NOT_FINITE[kind]) as usize;
            let number = [NotFinite::Actuator, NotFinite::AppliedForce, NotFinite::Mocap, NotFinite::Dof][kind](index);
            return Some(CodedConstraint::NotFinite(number));
        }
        match code {
            0 => None,
            code if code < CONTACTS => Some(CodedConstraint::Scalar(code as usize - 1)),
            code => Some(CodedConstraint::Contact((code - CONTACTS) as usize)),
        }
    }
}

/// For each lane with an unsolved step, its cause: the row with the largest residual, or the number that is not finite.
#[derive(Clone, Debug)]
pub struct WorstRows<R: Real> {
    /// Lanes that have a stored cause.
    pub lanes: R::Mask,
    codes: [ConstraintCode; MAX_LANES],
}

impl<R: Real> WorstRows<R> {
    /// Empty set, without causes.
    pub(crate) fn new() -> Self {
        Self { lanes: R::Mask::splat(false), codes: [ConstraintCode::default(); MAX_LANES] }
    }

    /// Code of the cause in lane `lane`; code 0 if it has none.
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
            self.find(problem, contacts, unsolved, |lane| worst_constraint(system, iterate, lane).map(|(i, _)| i));
        }
    }

    /// Stores, in each of the lanes `lanes`, the constraint with the index `worst(lane)` in the problem; the index counts the scalar rows
    /// first, then the contacts.
    #[cold]
    #[inline(never)]
    pub(crate) fn find(
        &mut self,
        problem: &ConstraintProblem<R>,
        contacts: &Contacts<R>,
        lanes: R::Mask,
        worst: impl Fn(usize) -> Option<usize>,
    ) {
        for lane in each_of(lanes.bits()) {
            let constraint = worst(lane).map(|i| match i.checked_sub(problem.impulse_indices.len()) {
                None => CodedConstraint::Scalar(problem.impulse_indices[i]),
                Some(i) => CodedConstraint::Contact(contacts.ids[problem.contact_slots[i].slot][lane].pair()),
            });
            self.store(lane, constraint);
        }
    }

    /// Copies the causes of the lanes `lanes`.
    pub(crate) fn copy_lanes(&mut self, from: &Self, lanes: R::Mask) {
        self.lanes = self.lanes.and_not(lanes).or(from.lanes.and(lanes));
        each_of(lanes.bits() & u32::MAX >> (u32::BITS as usize - R::LANES)).for_each(|lane| self.codes[lane] = from.codes[lane]);
    }

    /// Stores the cause of an unsolved step in lane `lane`; `None` if no single constraint is responsible.
    pub(crate) fn store(&mut self, lane: usize, cause: Option<CodedConstraint>) {
        self.lanes = self.lanes.or(R::Mask::from_bits(1 << lane));
        self.codes[lane] = cause.map_or_else(ConstraintCode::default, ConstraintCode::new);
    }
}
