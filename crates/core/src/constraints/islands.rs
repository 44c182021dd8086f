//! Islands: sets of kinematic trees that rows of the constraint problem connect, such as two robots in contact.

use stepper_real::Real;
use stepper_solve::System;

use crate::compile::ModelStructure;

/// Islands of one lane as disjoint sets of trees (union-find with path halving; Tarjan & van Leeuwen 1984).
///
/// For each island, callers can collect the maximum of some values, and two sums of penalties. Values and penalties belong to trees.
#[derive(Clone, Debug)]
pub(crate) struct Islands {
    /// For each tree, another tree of its island with a smaller index, or the tree itself if it is the root of its island.
    above: Vec<u32>,
    /// Maximum and sums of each island, at the index of the island's root tree.
    islands: Vec<Island>,
}

/// Maximum and sums of an island.
#[derive(Clone, Copy, Debug, Default)]
struct Island {
    /// Maximum of the values that [`Islands::raise_max`] received.
    most: f64,
    /// Two sums of penalties, at the indices `which` of [`Islands::add_penalty`].
    penalties: [f64; 2],
    /// Whether the island is excluded from penalties.
    exempt: bool,
}

impl Islands {
    /// Workspace for a model with `trees` kinematic trees.
    pub(crate) fn new(trees: usize) -> Self {
        Self { above: vec![0; trees], islands: vec![Island::default(); trees] }
    }

    /// Finds the islands of lane `lane`: trees that an active row connects are in the same island.
    pub(crate) fn find<R: Real>(&mut self, compiled: &ModelStructure<R::Scalar>, system: System<'_, R>, lane: usize) {
        for (tree, above) in self.above.iter_mut().enumerate() {
            *above = tree as u32;
        }
        self.islands.fill(Island::default());
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
        let most = &mut self.island(tree).most;
        *most = if x.is_nan() { f64::INFINITY } else { most.max(x) };
    }

    /// Maximum of the values that [`Islands::raise_max`] received for the island of `tree`.
    pub(crate) fn max_of(&mut self, tree: usize) -> f64 {
        self.island(tree).most
    }

    /// Adds `penalty` to sum number `which` (0 or 1) of the islands of two trees. If both trees are in the same island, the penalty is
    /// added once.
    pub(crate) fn add_penalty(&mut self, trees: [Option<usize>; 2], which: usize, penalty: f64) {
        let [a, b] = trees.map(|tree| tree.map(|tree| self.root(tree)));
        for root in [a, if a == b { None } else { b }].into_iter().flatten() {
            self.islands[root].penalties[which] += penalty;
        }
    }

    /// Excludes the island of `tree` from penalties, so that [`Islands::penalties`] returns `None`.
    pub(crate) fn exempt(&mut self, tree: usize) {
        self.island(tree).exempt = true;
    }

    /// Both sums of penalties of the island of `tree`; `None` if the island is excluded.
    pub(crate) fn penalties(&mut self, tree: usize) -> Option<[f64; 2]> {
        let Island { penalties, exempt, .. } = *self.island(tree);
        (!exempt).then_some(penalties)
    }

    fn island(&mut self, tree: usize) -> &mut Island {
        let root = self.root(tree);
        &mut self.islands[root]
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
