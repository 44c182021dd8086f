//! One lane's rows out of the lanes' problem, and its impulses back.
//!
//! Exact zeros are dropped, so that what the other lanes touch is not seen.

use std::ops::Range;

use crate::{Iterate, Problem};
use stepper_real::{Mask, Real, Scalar};

/// Rows of a contact with torsional or rolling friction.
const WIDE: usize = 6;

/// What a block's impulses may be.
#[derive(Clone, Copy, Debug)]
pub(super) enum Set {
    /// One row, `lo <= lambda <= hi`; an equality has infinite bounds.
    Interval { lo: f64, hi: f64 },
    /// Rows (n, t...), `|lambda_t| <= mu lambda_n`.
    Cone { mu: f64 },
}

/// One constraint of the lane.
#[derive(Clone, Debug)]
pub(super) struct Member {
    pub(super) set: Set,
    /// Index of the constraint among its kind in the lanes' problem.
    source: usize,
    support: Range<usize>,
    y: usize,
    /// Its rows, as places in [`Lane::g`] and [`Lane::lambda`].
    pub(super) rows: Range<usize>,
    /// Compliance R >= 0 on the diagonal of G, the same for all of its rows.
    pub(super) compliance: f64,
    /// So many times what is left of trace(G) it was before separate rows were taken out.
    pub(super) whole: f64,
}

/// All rows of one lane, sparse.
#[derive(Clone, Debug, Default)]
pub(super) struct Lane {
    pub(super) blocks: Vec<Member>,
    support: Vec<u32>,
    /// Entries; the rows of a coordinate lie side by side.
    y: Vec<f64>,
    /// Velocity of every row before any impulse, with its bias, m/s.
    pub(super) g: Vec<f64>,
    /// Impulse of every row, N s.
    pub(super) lambda: Vec<f64>,
    /// w = sum_i y_i lambda_i, all coordinates, without the separate rows.
    pub(super) w: Vec<f64>,
    /// What those rows make of w: they are solved, and no other row sees it.
    separate: Vec<f64>,
}

impl Lane {
    /// Takes what lane `lane` has but for the separate rows: scalar rows first, then contacts.
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
        for (row, &lambda) in problem.scalars.iter().zip(&iterate.scalars).take(problem.separate) {
            let (support, y) = problem.scalar_entries(row);
            support.iter().zip(y).for_each(|(&c, &y)| self.separate[c as usize] += number(y) * number(lambda));
        }
        self.w.extend(iterate.w.iter().zip(&self.separate).map(|(&x, part)| number(x) - part));
        for (i, (row, &lambda)) in problem.scalars.iter().zip(&iterate.scalars).enumerate().skip(problem.separate) {
            if exists(row.active) {
                let (support, y) = problem.scalar_entries(row);
                let set = Set::Interval { lo: number(row.lo), hi: number(row.hi) };
                if self.add(support, y.iter().map(|&y| [number(y)]), set, i, [number(row.g)], [number(lambda)]) {
                    self.measure(number(row.compliance), number(row.whole));
                }
            }
        }
        for (i, (block, lambda)) in problem.contacts.iter().zip(&iterate.contacts).enumerate() {
            if exists(block.active) {
                let (support, y) = problem.contact_entries(block);
                let set = Set::Cone { mu: number(block.mu) };
                if self.add(support, y.iter().map(|y| y.map(number)), set, i, block.g.map(number), lambda.map(number)) {
                    self.measure(number(block.compliance), number(block.whole));
                }
            }
        }
        for (i, (block, lambda)) in problem.wide.iter().zip(&iterate.wide).enumerate() {
            if exists(block.active) {
                let (support, y) = problem.wide_entries(block);
                let set = Set::Cone { mu: number(block.mu) };
                if self.add(support, y.iter().map(|y| y.map(number)), set, i, block.g.map(number), lambda.map(number)) {
                    self.measure(number(block.compliance), number(block.whole));
                }
            }
        }
    }

    /// Says the compliance of the block added last, and how much longer it was with separate rows.
    fn measure(&mut self, compliance: f64, whole: f64) {
        if let Some(block) = self.blocks.last_mut() {
            (block.compliance, block.whole) = (compliance, whole);
        }
    }

    /// A block of `N` rows with their entries at `support`. One that cannot move is left out: its impulses do nothing. Returns whether it
    /// was added.
    pub(super) fn add<const N: usize>(
        &mut self,
        support: &[u32],
        entries: impl Iterator<Item = [f64; N]>,
        set: Set,
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
            self.blocks.push(Member { set, source, support, y: y0, rows: row..row + N, compliance: 0.0, whole: 1.0 });
        }
        moves
    }

    /// Coordinates and entries of a block.
    pub(super) fn entries(&self, block: &Member) -> (&[u32], &[f64]) {
        let support = self.support(block);
        (support, &self.y[block.y..block.y + support.len() * block.rows.len()])
    }

    /// Coordinates of a block, ascending; there is at least one.
    pub(super) fn support(&self, block: &Member) -> &[u32] {
        &self.support[block.support.clone()]
    }

    /// Coordinates of all blocks, one after the other.
    pub(super) fn supports(&self) -> &[u32] {
        &self.support
    }

    /// Writes impulses and w into lane `lane`.
    pub(super) fn scatter<R: Real>(&self, lane: usize, iterate: &mut Iterate<R>) {
        for block in &self.blocks {
            let lambda = &self.lambda[block.rows.clone()];
            match block.set {
                Set::Interval { .. } => iterate.scalars[block.source].set_lane(lane, Scalar::from_f64(lambda[0])),
                Set::Cone { .. } if lambda.len() == WIDE => {
                    for (to, &x) in iterate.wide[block.source].iter_mut().zip(lambda) {
                        to.set_lane(lane, Scalar::from_f64(x));
                    }
                }
                Set::Cone { .. } => {
                    for (to, &x) in iterate.contacts[block.source].iter_mut().zip(lambda) {
                        to.set_lane(lane, Scalar::from_f64(x));
                    }
                }
            }
        }
        for ((to, &x), part) in iterate.w.iter_mut().zip(&self.w).zip(&self.separate) {
            to.set_lane(lane, Scalar::from_f64(x + part));
        }
    }
}
