//! Rows of the position solve: copies of the rows of a problem with damped targets, so that corrections are moderate.
//!
//! Position targets (gaps to close, overlaps to remove) may contradict each other, or may need an extremely large motion. Examples are a
//! contact normal that passes a hinge at a distance of a micrometre, and a stretched chain. A compliance R on the diagonal of G makes the
//! solution that of damped least squares (Levenberg 1944; for manipulators Nakamura & Hanafusa 1986 and Wampler 1986). A row of mobility G
//! then meets the fraction `G / (G + R)` of its target d. Its scaled motion is at most `d / (2 sqrt(R))`. If targets contradict each other,
//! the remaining error is least in the mean square. The compliance acts on the difference from the reference impulses, so that loads that
//! already act cause no error.
//!
//! Farkas' lemma proves that targets are infeasible. Let u be the unmet target velocity of the rows at the current motion. The proof is
//! impulses z >= 0 of the rows with `-z . u > sum_d |J^T z|_d c_d`, summed over the coordinates d. Then no change of the velocities within
//! the bounds c_d meets the targets (weak duality).

use crate::capacity::Capacity;
use crate::constraints::constraint_set::{ConstraintList, Damping};
use crate::constraints::friction::ContactList;
use crate::constraints::scalar::ScalarList;
use crate::iterate::Iterate;
use crate::problem::{Problem, System};
use crate::reference::Reference;
use crate::residual::WorstConstraint;
use stepper_real::{Mask, Real, kernel};

/// Rows of the position solve: copies of the rows of a [`Problem`], with other offsets g and more compliance. The problem does not change.
#[derive(Clone, Debug)]
pub struct PositionRows<R: Real> {
    /// Copies of the scalar rows.
    scalars: ScalarList<R>,
    /// Copies of the contacts.
    contacts: ContactList<R>,
}

impl<R: Real> PositionRows<R> {
    /// Empty rows, with memory for a problem of this capacity.
    pub fn new(capacity: &Capacity) -> Self {
        Self { scalars: ScalarList::with_capacity(capacity), contacts: ContactList::with_capacity(capacity) }
    }

    /// Copies the rows of a problem. Their offsets are those of the velocity solve until [`PositionRows::exchange_offsets`].
    #[inline(always)]
    pub fn copy(&mut self, problem: &Problem<R>) {
        self.scalars.copy(&problem.scalars.rows);
        self.contacts.copy(&problem.contacts.rows);
    }

    /// System for a solver: these rows with the problem `problem`. The rows must be copies of the rows of that problem.
    #[inline(always)]
    pub fn system<'a>(&'a self, problem: &'a Problem<R>) -> System<'a, R> {
        System { problem, needs_residual: true, scalars: &self.scalars, contacts: &self.contacts }
    }

    /// Exchanges, in every row, the offset of the velocity solve and that of the position solve. A solve of these rows is then a position
    /// solve.
    #[inline(always)]
    pub fn exchange_offsets(&mut self) {
        self.scalars.exchange_offsets(R::Mask::splat(true));
        self.contacts.exchange_offsets(R::Mask::splat(true));
    }

    /// Damps the targets of all rows by a compliance, which acts on the difference from the impulses of `iterate`. These impulses therefore
    /// cause no additional velocity. They are stored in `reference`, with the scaled velocity change that they cause.
    ///
    /// The correction of a row is the difference between its position target and its velocity target. Rows without correction remain hard.
    /// The compliance of a scalar row with a correction is the damping ratio times the row's mobility. For a contact the ratio grows with
    /// the correction, and its number in `added_mobilities`, 1/kg, is added to the mobility. This list has one number for each constraint.
    #[inline(always)]
    pub fn damp(
        &mut self,
        problem: &Problem<R>,
        iterate: &Iterate<R>,
        damping: Damping<R>,
        added_mobilities: &[R],
        reference: &mut Reference<R>,
    ) {
        let Reference { w, rows, .. } = reference;
        w.clone_from(&iterate.w);
        rows.clear();
        let (scalars, contacts) = added_mobilities.split_at(problem.scalars.len());
        problem.scalars.damp(&mut self.scalars, &iterate.scalars, damping, scalars, rows);
        problem.contacts.damp(&mut self.contacts, &iterate.contacts, damping, contacts, rows);
    }
}

impl<R: Real> System<'_, R> {
    /// Calls `f` with the velocity by which damping prevents each constraint from meeting its target, m/s or rad/s. `reference` has the
    /// impulses at which damping causes no velocity.
    #[inline(always)]
    fn for_each_shortfall(&self, iterate: &Iterate<R>, reference: &Reference<R>, mut f: impl FnMut(R)) {
        let (scalars, contacts) = reference.rows.split_at(self.problem.scalars.len());
        self.problem.scalars.for_each_shortfall(self.scalars, &iterate.scalars, scalars, &mut f);
        self.problem.contacts.for_each_shortfall(self.contacts, &iterate.contacts, contacts, f);
    }

    /// Calls `f` with the target of each constraint that no impulse can move, m/s or rad/s; 0 for the others.
    #[inline(always)]
    fn for_each_immovable_target(&self, mut f: impl FnMut(R)) {
        self.problem.scalars.for_each_immovable_target(self.scalars, &mut f);
        self.problem.contacts.for_each_immovable_target(self.contacts, f);
    }

    /// Calls `f` with the target velocity of each constraint that no impulse can move, without position corrections, m/s or rad/s; 0 for
    /// the others.
    #[inline(always)]
    fn for_each_unmet_velocity(&self, mut f: impl FnMut(R)) {
        self.problem.scalars.for_each_unmet_velocity(self.scalars, &mut f);
        self.problem.contacts.for_each_unmet_velocity(self.contacts, f);
    }

    /// Largest velocity by which damping prevents a row from meeting its target, m/s or rad/s. `reference` has the impulses at which
    /// damping causes no velocity.
    #[inline(always)]
    pub fn shortfall(&self, iterate: &Iterate<R>, reference: &Reference<R>) -> R {
        let mut most = R::zero();
        self.for_each_shortfall(
            iterate,
            reference,
            #[inline(always)]
            |x| most = most.max(x),
        );
        most
    }

    /// Constraint of lane `lane` that misses its position target by the largest velocity, because of damping or because no impulse can move
    /// it. The result is its index, which counts the scalar rows first; `None` if all targets are met.
    pub fn worst_position_target(&self, iterate: &Iterate<R>, reference: &Reference<R>, lane: usize) -> Option<usize> {
        kernel!(R, || {
            let mut worst = WorstConstraint::new(lane);
            self.for_each_shortfall(iterate, reference, |x| worst.visit(x));
            worst.next = 0;
            self.for_each_immovable_target(|x| worst.visit(x));
            worst.worst.map(|(i, _)| i)
        })
    }

    /// Largest target velocity of rows and contacts that no impulse can move, m/s or rad/s.
    #[inline(always)]
    pub fn immovable_target(&self) -> R {
        let mut most = R::zero();
        self.for_each_immovable_target(
            #[inline(always)]
            |x| most = most.max(x),
        );
        most
    }

    /// Largest target velocity of rows and contacts that no impulse can move, without the part that corrects a position error, m/s or
    /// rad/s.
    ///
    /// No impulse can change this part of the residual. The function must be called on the system of a problem, and not on that of its
    /// position rows.
    #[inline(always)]
    pub fn unmet_velocity(&self) -> R {
        let mut most = R::zero();
        self.for_each_unmet_velocity(
            #[inline(always)]
            |x| most = most.max(x),
        );
        most
    }

    /// Constraint of lane `lane` with the largest part in [`System::unmet_velocity`]. The result is its index, which counts the scalar rows
    /// first; `None` if all parts are 0.
    pub fn worst_unmet_velocity(&self, lane: usize) -> Option<usize> {
        kernel!(R, || {
            let mut worst = WorstConstraint::new(lane);
            self.for_each_unmet_velocity(|x| worst.visit(x));
            worst.worst.map(|(i, _)| i)
        })
    }

    /// Proof that the targets are infeasible, from the impulses z by which `iterate` exceeds the reference solution.
    ///
    /// Writes the scaled momentum J^T z to `reference`, and returns -z . u, J. Here u are the velocities by which the rows miss their
    /// targets under the impulses of the reference. Friction and springs are excluded, and so are contacts and limits that push less than
    /// in the reference.
    #[inline(always)]
    pub fn witness(&self, iterate: &Iterate<R>, reference: &mut Reference<R>) -> R {
        let Reference { w, rows, momentum } = reference;
        momentum.clear();
        momentum.resize(w.len(), R::zero());
        let (scalars, contacts) = rows.split_at(self.problem.scalars.len());
        let work = self.problem.scalars.witness(self.scalars, &iterate.scalars, scalars, w, momentum, R::zero());
        self.problem.contacts.witness(self.contacts, &iterate.contacts, contacts, w, momentum, work)
    }
}
