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
use crate::constraints::constraint_set::{Damping, ReferenceRows, Rows};
use crate::constraints::{by_kind, each_kind, make_kinds};
use crate::iterate::Iterate;
use crate::problem::{Problem, System};
use crate::reference::Reference;
use crate::residual::WorstConstraint;
use stepper_real::{Mask, Real, kernel};

by_kind! {
    /// Rows of the position solve: copies of the rows of a [`Problem`], with other offsets g and more compliance. The problem does not
    /// change.
    #[derive(Clone, Debug)]
    pub struct PositionRows[R: Real] {} each Rows[]
}

impl<R: Real> PositionRows<R> {
    /// Empty rows, with memory for a problem of this capacity.
    pub fn new(capacity: &Capacity) -> Self {
        make_kinds!(Self {} [count: capacity] => Rows::with_capacity(count))
    }

    /// Copies the rows of a problem. Their offsets are those of the velocity solve until [`PositionRows::exchange_offsets`].
    #[inline(always)]
    pub fn copy(&mut self, problem: &Problem<R>) {
        each_kind!([own: &mut self] [set: &problem] => own.copy(&set.rows));
    }

    /// System for a solver: these rows with the problem `problem`. The rows must be copies of the rows of that problem.
    #[inline(always)]
    pub fn system<'a>(&'a self, problem: &'a Problem<R>) -> System<'a, R> {
        make_kinds!(System { problem, needs_residual: true, } [own: &self] => own)
    }

    /// Exchanges, in every row, the offset of the velocity solve and that of the position solve. A solve of these rows is then a position
    /// solve.
    #[inline(always)]
    pub fn exchange_offsets(&mut self) {
        each_kind!([own: &mut self] => own.exchange_offsets(R::Mask::splat(true)));
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
        mut added_mobilities: &[R],
        reference: &mut Reference<R>,
    ) {
        let Reference { w, lambda, g, .. } = reference;
        w.clone_from(&iterate.w);
        lambda.clear();
        g.clear();
        each_kind!([own: &mut self] [set: &problem] [impulses: &iterate] => {
            let added_mobilities = take(&mut added_mobilities, own.items.len());
            set.damp(own, impulses, damping, added_mobilities, [&mut *lambda, &mut *g]);
        });
    }
}

impl<R: Real> System<'_, R> {
    /// Largest velocity by which damping prevents a row from meeting its target, m/s or rad/s. `reference` has the impulses at which
    /// damping causes no velocity.
    #[inline(always)]
    pub fn shortfall(&self, iterate: &Iterate<R>, reference: &Reference<R>) -> R {
        let (mut most, mut before) = (R::zero(), &reference.lambda[..]);
        each_kind!([set: &self.problem] [rows: self] [impulses: &iterate] => set.for_each_shortfall(
            rows,
            impulses,
            take(&mut before, rows.items.len()),
            #[inline(always)]
            |x| most = most.max(x),
        ));
        most
    }

    /// Constraint of lane `lane` that misses its position target by the largest velocity, because of damping or because no impulse can move
    /// it. The result is its index, counted over all kinds in their order; `None` if all targets are met.
    pub fn worst_position_target(&self, iterate: &Iterate<R>, reference: &Reference<R>, lane: usize) -> Option<usize> {
        kernel!(R, || {
            let (mut worst, mut before) = (WorstConstraint::new(lane), &reference.lambda[..]);
            each_kind!([set: &self.problem] [rows: self] [impulses: &iterate] => {
                set.for_each_shortfall(rows, impulses, take(&mut before, rows.items.len()), |x| worst.visit(x));
            });
            worst.restart();
            each_kind!([set: &self.problem] [rows: self] => set.for_each_immovable_target(rows, |x| worst.visit(x)));
            worst.constraint().map(|(i, _)| i)
        })
    }

    /// Largest target velocity of rows and contacts that no impulse can move, m/s or rad/s.
    #[inline(always)]
    pub fn immovable_target(&self) -> R {
        let mut most = R::zero();
        each_kind!([set: &self.problem] [rows: self] => set.for_each_immovable_target(
            rows,
            #[inline(always)]
            |x| most = most.max(x),
        ));
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
        each_kind!([set: &self.problem] [rows: self] => set.for_each_unmet_velocity(
            rows,
            #[inline(always)]
            |x| most = most.max(x),
        ));
        most
    }

    /// Constraint of lane `lane` with the largest part in [`System::unmet_velocity`]. The result is its index, counted over all kinds in
    /// their order; `None` if all parts are 0.
    pub fn worst_unmet_velocity(&self, lane: usize) -> Option<usize> {
        kernel!(R, || {
            let mut worst = WorstConstraint::new(lane);
            each_kind!([set: &self.problem] [rows: self] => set.for_each_unmet_velocity(rows, |x| worst.visit(x)));
            worst.constraint().map(|(i, _)| i)
        })
    }

    /// Proof that the targets are infeasible, from the impulses z by which `iterate` exceeds the reference solution.
    ///
    /// Writes the scaled momentum J^T z to `reference`, and returns -z . u, J. Here u are the velocities by which the rows miss their
    /// targets under the impulses of the reference. Friction and springs are excluded, and so are contacts and limits that push less than
    /// in the reference.
    #[inline(always)]
    pub fn witness(&self, iterate: &Iterate<R>, reference: &mut Reference<R>) -> R {
        let Reference { w, lambda, g, momentum } = reference;
        momentum.clear();
        momentum.resize(w.len(), R::zero());
        let (mut lambda, mut g, mut missing_work) = (&lambda[..], &g[..], R::zero());
        each_kind!([set: &self.problem] [rows: self] [impulses: &iterate] => {
            let n = rows.items.len();
            let before = ReferenceRows { lambda: take(&mut lambda, n), g: take(&mut g, n) };
            missing_work = set.witness(rows, impulses, before, w, momentum, missing_work);
        });
        missing_work
    }
}

/// Splits off the first `n` entries of a list with one entry for each constraint, and returns them. `list` keeps the other entries.
#[inline(always)]
fn take<'a, R>(list: &mut &'a [R], n: usize) -> &'a [R] {
    let (first, rest) = list.split_at(n);
    *list = rest;
    first
}
