//! Cause of an unsolved step: the constraint row with the largest residual, or the number that is not finite.

use stepper_real::{Mask, Real};
use stepper_solve::{Iterate, System, worst_constraint};

use crate::collision::contact_set::Contacts;
use crate::constraints::constraint_problem::ConstraintProblem;
use crate::math::lanes::{MAX_LANES, each_of};

/// Number that encodes the cause of an unsolved step in a saved state. 0 means none. Each kind of cause has the numbers from its first one
/// in [`KINDS`] on, by the index that the cause has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ConstraintCode(pub u64);

/// Cause that a [`ConstraintCode`] represents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CodedConstraint {
    /// Scalar row, by the index of its impulse in [`crate::constraints::VelocitySolution::scalar_impulse`].
    Scalar(usize),
    /// Contact, by the index of its pair of geoms.
    Contact(usize),
    /// Control or activation of an actuator that is not finite, by the index of the actuator.
    NotFiniteActuator(usize),
    /// Applied force or torque on a body that is not finite, by the index of the body.
    NotFiniteForce(usize),
    /// Pose of a mocap body that is not finite, by its index among the mocap bodies.
    NotFiniteMocap(usize),
    /// Position, velocity or applied force of a degree of freedom that is not finite.
    NotFiniteDof(usize),
    /// Joint that is too fast for the time step, by one of its degrees of freedom.
    TooFast(usize),
}

/// Variant of [`CodedConstraint`] as a function of the index.
type Variant = fn(usize) -> CodedConstraint;

/// First code of each kind of cause, ascending, and the cause with a given index.
const KINDS: [(u64, Variant); 7] = [
    (1, CodedConstraint::Scalar),
    (1 << 32, CodedConstraint::Contact),
    (1 << 40, CodedConstraint::NotFiniteActuator),
    (1 << 41, CodedConstraint::NotFiniteForce),
    (1 << 42, CodedConstraint::NotFiniteMocap),
    (1 << 43, CodedConstraint::NotFiniteDof),
    (1 << 44, CodedConstraint::TooFast),
];

impl ConstraintCode {
    fn new(constraint: CodedConstraint) -> Self {
        use CodedConstraint::*;
        let (Scalar(index)
        | Contact(index)
        | NotFiniteActuator(index)
        | NotFiniteForce(index)
        | NotFiniteMocap(index)
        | NotFiniteDof(index)
        | TooFast(index)) = constraint;
        let (first, _) = KINDS.iter().find(|(_, make)| make(index) == constraint).expect("every kind of cause has codes");
        Self(first + index as u64)
    }

    /// Constraint or number that the code represents; `None` for code 0.
    pub fn constraint(self) -> Option<CodedConstraint> {
        let (first, make) = KINDS.iter().rfind(|(first, _)| self.0 >= *first)?;
        Some(make((self.0 - first) as usize))
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
