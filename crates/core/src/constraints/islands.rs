//! Islands: sets of kinematic trees that rows of the constraint problem connect, such as two robots in contact.

use stepper_real::{Real, Scalar};
use stepper_solve::{Iterate, System, for_each_load};

use crate::compile::ModelStructure;
use crate::math::disjoint_sets::DisjointSets;
use crate::tuning::MAX_TRUSTED_RESIDUAL;

/// Islands of one lane as disjoint sets of trees.
///
/// For each island, callers can collect the maximum of some values, loads, energies, and two sums of penalties. All belong to trees.
#[derive(Clone, Debug)]
pub(crate) struct Islands {
    /// Trees of each island.
    trees: DisjointSets,
    /// Maximum and sums of each island, at the index of the island's root tree.
    islands: Vec<Island>,
}

/// Maximum and sums of an island.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Island {
    /// Maximum of the values that [`Islands::raise_max`] received.
    pub(crate) most: f64,
    /// Two sums of penalties, at the indices `which` of [`Islands::add_penalty`].
    pub(crate) penalties: [f64; 2],
    /// Whether the island is excluded from penalties.
    pub(crate) exempt: bool,
    /// Load of the island, from [`Islands::add_loads`].
    pub(crate) load: IslandLoad,
    /// Sums of the kinetic energies of its trees, J.
    pub(crate) energies: [f64; 5],
}

/// Load of the constraints of an island.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct IslandLoad {
    /// Whether the island has a constraint.
    pub(crate) is_constrained: bool,
    /// Largest residual of a constraint, m/s.
    pub(crate) residual: f64,
    /// Sum of all normal impulses, N s.
    pub(crate) impulse: f64,
    /// Kinetic energy of the velocity change by the impulses, J.
    pub(crate) energy: f64,
}

impl IslandLoad {
    /// Whether the residual may change the kinetic energy of the island noticeably: it is above [`MAX_TRUSTED_RESIDUAL`] and ten times the
    /// tolerance, or enormous impulses nearly cancel ([`stepper_solve::energy_is_ambiguous`]). `negligible` is added to the energy, J.
    pub(crate) fn is_ambiguous(&self, tolerance: f64, negligible: f64) -> bool {
        let unsolved = self.residual > MAX_TRUSTED_RESIDUAL.max(10.0 * tolerance);
        unsolved || self.residual.min(1e-6) * self.impulse > self.energy + negligible
    }
}

impl Islands {
    /// Workspace for a model with `trees` kinematic trees.
    pub(crate) fn new(trees: usize) -> Self {
        Self { trees: DisjointSets::new(trees), islands: vec![Island::default(); trees] }
    }

    /// Finds the islands of lane `lane`: trees that an active row connects are in the same island.
    pub(crate) fn find<R: Real>(&mut self, compiled: &ModelStructure<R::Scalar>, system: System<'_, R>, lane: usize) {
        self.trees.separate();
        self.islands.fill(Island::default());
        system.for_each_column_set(lane, |dofs| self.trees.join_all(dofs.map(|d| compiled.dofs[d as usize].tree)));
    }

    /// Updates the maximum of the island of `tree` with the value `x`; NaN counts as infinite.
    pub(crate) fn raise_max(&mut self, tree: usize, x: f64) {
        let most = &mut self.of_tree(tree).most;
        *most = if x.is_nan() { f64::INFINITY } else { most.max(x) };
    }

    /// Adds the loads of all constraints in lane `lane`, with the impulses `iterate`, to [`Island::load`].
    pub(crate) fn add_loads<R: Real>(
        &mut self,
        compiled: &ModelStructure<R::Scalar>,
        system: System<'_, R>,
        iterate: &Iterate<R>,
        lane: usize,
    ) {
        for_each_load(system, iterate, lane, |dofs, residual, impulse| {
            let Some(dof) = dofs.next() else { return };
            let load = &mut self.of_tree(compiled.dofs[dof as usize].tree).load;
            load.is_constrained = true;
            load.residual = if residual.is_nan() { f64::INFINITY } else { load.residual.max(residual) };
            load.impulse += impulse;
        });
        for (dof, w) in iterate.w.iter().enumerate() {
            self.of_tree(compiled.dofs[dof].tree).load.energy += 0.5 * w.lane(lane).to_f64().powi(2);
        }
    }

    /// Adds `penalty` to sum number `which` (0 or 1) of the islands of two trees. If both trees are in the same island, the penalty is
    /// added once.
    pub(crate) fn add_penalty(&mut self, trees: [Option<usize>; 2], which: usize, penalty: f64) {
        let [a, b] = trees.map(|tree| tree.map(|tree| self.trees.root(tree)));
        for root in [a, if a == b { None } else { b }].into_iter().flatten() {
            self.islands[root].penalties[which] += penalty;
        }
    }

    /// Island of `tree`.
    pub(crate) fn of_tree(&mut self, tree: usize) -> &mut Island {
        let root = self.trees.root(tree);
        &mut self.islands[root]
    }
}
