//! Islands: sets of kinematic trees that rows of the constraint problem connect, such as two robots in contact.

use stepper_real::Real;
use stepper_solve::System;

use crate::compile::ModelStructure;

/// Islands of one lane as disjoint sets of trees (union-find with path halving; Tarjan & van Leeuwen 1984).
///
/// Each island has a maximum of values, and two sums of penalties. Callers supply the values and the penalties.
#[derive(Clone, Debug)]
pub(crate) struct Islands {
    /// For each tree, another tree of its island with a smaller index, or the tree itself if it is the root of its island.
    above: Vec<u32>,
    /// Maximum of the values of each island, at the index of its root.
    most: Vec<f64>,
    /// Both sums of penalties of each island, at the index of its root.
    penalties: Vec<[f64; 2]>,
    /// Whether each island is excluded from penalties, at the index of its root.
    exempt: Vec<bool>,
}

impl Islands {
    /// Workspace for a model with `trees` kinematic trees.
    pub(crate) fn new(trees: usize) -> Self {
        Self { above: vec![0; trees], most: vec![0.0; trees], penalties: vec![[0.0; 2]; trees], exempt: vec![false; trees] }
    }

    /// Finds the islands of lane `lane`: trees that an active row connects are in the same island.
    pub(crate) fn find<R: Real>(&mut self, compiled: &ModelStructure<R::Scalar>, system: System<'_, R>, lane: usize) {
        for (tree, above) in self.above.iter_mut().enumerate() {
            *above = tree as u32;
        }
        self.most.fill(0.0);
        self.penalties.fill([0.0; 2]);
        self.exempt.fill(false);
        system.for_each_column_set(lane, |dofs| {
            let mut first = None;
            for d in dofs {
                let tree = self.root(compiled.dofs[d as usize].tree);
                match first {
                    None => first = Some(tree),
                    Some(other) if other != tree => {
                        self.above[tree.max(other)] = tree.min(other) as u32;
                        first = Some(tree.min(other));
                    }
                    Some(_) => {}
                }
            }
        });
    }

    /// Updates the maximum of the island of `tree` with the value `x`; NaN counts as infinite.
    pub(crate) fn raise_max(&mut self, tree: usize, x: f64) {
        let root = self.root(tree);
        self.most[root] = if x <= self.most[root] {
            self.most[root]
        } else if x.is_nan() {
            f64::INFINITY
        } else {
            x
        };
    }

    /// Maximum of the values that [`Islands::raise_max`] received for the island of `tree`.
    pub(crate) fn max_of(&mut self, tree: usize) -> f64 {
        let root = self.root(tree);
        self.most[root]
    }

    /// Adds a penalty to sum number `which` of the islands of two trees. If both trees are in the same island, it is added once.
    pub(crate) fn add_penalty(&mut self, trees: [Option<usize>; 2], which: usize, penalty: f64) {
        let [a, b] = trees.map(|tree| tree.map(|tree| self.root(tree)));
        for root in [a, if a == b { None } else { b }].into_iter().flatten() {
            self.penalties[root][which] += penalty;
        }
    }

    /// Excludes the island of `tree` from penalties, so that [`Islands::penalties`] returns `None`.
    pub(crate) fn exempt(&mut self, tree: usize) {
        let root = self.root(tree);
        self.exempt[root] = true;
    }

    /// Both sums of penalties of the island of `tree`; `None` if the island is excluded.
    pub(crate) fn penalties(&mut self, tree: usize) -> Option<[f64; 2]> {
        let root = self.root(tree);
        (!self.exempt[root]).then_some(self.penalties[root])
    }

    fn root(&mut self, mut tree: usize) -> usize {
        while self.above[tree] as usize != tree {
            let next = self.above[self.above[tree] as usize];
            self.above[tree] = next;
            tree = next as usize;
        }
        tree
    }
}
