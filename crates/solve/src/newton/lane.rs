//! Rows of one lane, gathered from the lanes' problem, and its impulses scattered back.
//!
//! Exact zeros are dropped, so that a lane does not see what the other lanes touch.

use std::ops::Range;

use crate::admissible_set::AdmissibleSet;
use crate::constraints::friction::{FrictionContacts, LocalSolver};
use crate::iterate::Iterate;
use crate::problem::Problem;
use stepper_real::{Mask, Real, Scalar};

/// Rows of one constraint of the lane.
#[derive(Clone, Debug)]
pub(super) struct LaneBlock {
    pub(super) set: AdmissibleSet,
    /// Index of the constraint among its kind in the lanes' problem.
    source: usize,
    support: Range<usize>,
    y: usize,
    /// Its rows, as places in [`Lane::g`] and [`Lane::lambda`].
    pub(super) rows: Range<usize>,
    /// Compliance R >= 0 on the diagonal of G, the same for all of its rows.
    pub(super) compliance: f64,
    /// Ratio of trace(G_ii) before elimination of separate rows to that after it, at least 1.
    pub(super) trace_ratio: f64,
}

/// Rows of one lane, sparse.
#[derive(Clone, Debug, Default)]
pub(super) struct Lane {
    pub(super) blocks: Vec<LaneBlock>,
    support: Vec<u32>,
    /// Entries; the rows of a coordinate lie side by side.
    y: Vec<f64>,
    /// Velocity of every row before any impulse, with its bias, m/s.
    pub(super) g: Vec<f64>,
    /// Impulse of every row, N s.
    pub(super) lambda: Vec<f64>,
    /// w = sum_i y_i lambda_i, all coordinates, without the separate rows.
    pub(super) w: Vec<f64>,
    /// Part of w that the separate rows make: they are solved, and no other row sees it.
    separate: Vec<f64>,
}

impl Lane {
    /// Gathers the rows of lane `lane` but for the separate ones: scalar rows first, then contacts.
    pub(super) fn gather<R: Real>(&mut self, problem: &Problem<R>, iterate: &Iterate<R>, lane: usize) {
        let exists = |mask: R::Mask| mask.bits() >> lane & 1 == 1;
        let number = |x: R| x.lane(lane).to_f64();
        self.blocks.clear();
        self.support.clear();
        self.y.clear();
        self.g.clear();
        self.lambda.clear();
        self.w.clear();
        self.separate.clear();
        self.separate.resize(iterate.w.len(), 0.0);
        for (row, &lambda) in problem.scalars.iter().zip(&iterate.scalars).take(problem.scalars.separate()) {
            let (support, y) = problem.scalars.entries(row);
            support.iter().zip(y).for_each(|(&c, &y)| self.separate[c as usize] += number(y) * number(lambda));
        }
        self.w.extend(iterate.w.iter().zip(&self.separate).map(|(&x, part)| number(x) - part));
        for (i, (row, &lambda)) in problem.scalars.iter().zip(&iterate.scalars).enumerate().skip(problem.scalars.separate()) {
            if exists(row.active) {
                let (support, y) = problem.scalars.entries(row);
                let set = AdmissibleSet::Interval { lo: number(row.lo), hi: number(row.hi) };
                if self.add(support, y.iter().map(|&y| [number(y)]), set, i, [number(row.g)], [number(lambda)]) {
                    self.set_compliance(number(row.compliance), number(row.trace_ratio));
                }
            }
        }
        self.gather_contacts(&problem.contacts, &iterate.contacts, lane);
        self.gather_contacts(&problem.rolling_contacts, &iterate.rolling_contacts, lane);
    }

    /// Gathers the contacts of one kind that exist in lane `lane`.
    fn gather_contacts<R: Real, const N: usize, L: LocalSolver<R, N>>(
        &mut self,
        contacts: &FrictionContacts<R, N, L>,
        impulses: &[[R; N]],
        lane: usize,
    ) {
        let number = |x: R| x.lane(lane).to_f64();
        for (i, (contact, lambda)) in contacts.iter().zip(impulses).enumerate() {
            if contact.active.bits() >> lane & 1 == 1 {
                let (support, y) = contacts.entries(contact);
                let set = AdmissibleSet::Cone { mu: number(contact.mu) };
                if self.add(support, y.iter().map(|y| y.map(number)), set, i, contact.g.map(number), lambda.map(number)) {
                    self.set_compliance(number(contact.compliance), number(contact.trace_ratio()));
                }
            }
        }
    }

    /// Sets the compliance and the trace ratio of the block added last.
    fn set_compliance(&mut self, compliance: f64, trace_ratio: f64) {
        if let Some(block) = self.blocks.last_mut() {
            (block.compliance, block.trace_ratio) = (compliance, trace_ratio);
        }
    }

    /// Adds a block of `N` rows with their entries at `support`. One that cannot move is left out: its impulses do nothing. Returns whether
    /// it was added.
    pub(super) fn add<const N: usize>(
        &mut self,
        support: &[u32],
        entries: impl Iterator<Item = [f64; N]>,
        set: AdmissibleSet,
        source: usize,
        g: [f64; N],
        lambda: [f64; N],
    ) -> bool {
        let (s0, y0, row) = (self.support.len(), self.y.len(), self.g.len());
        for (&c, y) in support.iter().zip(entries) {
            if y.iter().any(|&y| y != 0.0) {
                self.support.push(c);
                self.y.extend_from_slice(&y);
            }
        }
        let moves = self.support.len() > s0;
        if moves {
            self.g.extend_from_slice(&g);
            self.lambda.extend_from_slice(&lambda);
            let support = s0..self.support.len();
            self.blocks.push(LaneBlock { set, source, support, y: y0, rows: row..row + N, compliance: 0.0, trace_ratio: 1.0 });
        }
        moves
    }

    /// Coordinates and entries of a block.
    pub(super) fn entries(&self, block: &LaneBlock) -> (&[u32], &[f64]) {
        let support = self.support(block);
        (support, &self.y[block.y..block.y + support.len() * block.rows.len()])
    }

    /// Coordinates of a block, ascending; there is at least one.
    pub(super) fn support(&self, block: &LaneBlock) -> &[u32] {
        &self.support[block.support.clone()]
    }

    /// Coordinates of all blocks, one after the other.
    pub(super) fn supports(&self) -> &[u32] {
        &self.support
    }

    /// Scatters impulses and w into lane `lane`.
    pub(super) fn scatter<R: Real>(&self, lane: usize, iterate: &mut Iterate<R>) {
        for block in &self.blocks {
            let lambda = &self.lambda[block.rows.clone()];
            match block.set {
                AdmissibleSet::Interval { .. } => iterate.scalars[block.source].set_lane(lane, Scalar::from_f64(lambda[0])),
                AdmissibleSet::Cone { .. } if lambda.len() == 6 => set_lanes(&mut iterate.rolling_contacts[block.source], lane, lambda),
                AdmissibleSet::Cone { .. } => set_lanes(&mut iterate.contacts[block.source], lane, lambda),
            }
        }
        for ((to, &x), part) in iterate.w.iter_mut().zip(&self.w).zip(&self.separate) {
            to.set_lane(lane, Scalar::from_f64(x + part));
        }
    }
}

/// Sets one lane of a contact's impulses.
fn set_lanes<R: Real>(to: &mut [R], lane: usize, from: &[f64]) {
    for (to, &x) in to.iter_mut().zip(from) {
        to.set_lane(lane, Scalar::from_f64(x));
    }
}
