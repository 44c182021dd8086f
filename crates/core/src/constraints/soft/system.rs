//! Constraint problem of MuJoCo's contact law in a step, and its solver.

use std::ops::Range;

use stepper_real::{Mask, Real, kernel};
use stepper_solve::soft::{ContactVisit, Effort, LaneSolver, Metric, SlipCapacity, SoftOutcome, SoftProblem, SoftSolver};

use crate::compile::{CompiledSoftness, LaneModel, ModelStructure};
use crate::constraints::constraint_problem::capacity_of;
use crate::dynamics::inertia::MassMatrix;

/// Constraint problem of MuJoCo's contact law, its solver, and the unknown acceleration.
#[derive(Clone, Debug)]
pub struct SoftSystem<R: Real> {
    /// Rows of the constraint problem.
    pub problem: SoftProblem<R>,
    /// Index of the impulse of every scalar row in the list of impulses of scalar rows.
    pub(super) impulse_indices: Vec<usize>,
    /// Contacts of the problem, by ascending slot of the contact set: this slot, and the place of the contact in the problem.
    pub(super) contacts: Vec<(usize, ContactVisit<R::Mask>)>,
    /// Lanes in which at least one row acts.
    pub(crate) constrained: R::Mask,
    /// Solver for all lanes at once (Newton's method).
    pub solver: SoftSolver<R>,
    /// Solver for one lane at a time; `Some` only for models with several trees, where contacts may connect different trees in each lane.
    in_turn: Option<Box<LaneSolver<R>>>,
    /// Acceleration, nv: initial value of the solver, and after the solve the solution.
    pub acceleration: Vec<R>,
    /// Entries of the mass matrix.
    pub mass: Vec<R>,
    /// Order in which noslip iterations visit the contacts.
    pub(super) order: VisitOrder<R>,
}

impl<R: Real> SoftSystem<R> {
    /// Workspace for a model that is compiled with MuJoCo's law, `softness`, and at most `max_contacts` contacts per environment.
    pub fn new(compiled: &ModelStructure<R::Scalar>, softness: &CompiledSoftness<R::Scalar>, max_contacts: usize) -> Self {
        // All lanes of a contact in the problem act on the same trees. A slot whose lanes have geoms of different trees becomes several
        // contacts, at most one per lane.
        let parts = if compiled.ntree > 1 { R::LANES } else { 1 };
        let (contacts, columns_per_contact) = (max_contacts * parts, capacity_of(compiled, 0, R::LANES / parts).columns_per_contact);
        let zeros = || vec![R::zero(); compiled.nv];
        let rows = compiled.scalar_impulses;
        let problem =
            SoftProblem::new(softness.cone, rows, rows * compiled.nv.min(16), contacts, columns_per_contact, compiled.has_rolling_friction);
        let mut solver = SoftSolver::new(&softness.order);
        let visited = if softness.noslip.is_some() { max_contacts } else { 0 };
        if softness.noslip.is_some() {
            // A contact connects at most two trees.
            let mut sizes: Vec<usize> = vec![0; compiled.nv];
            (0..compiled.nv).for_each(|d| sizes[*compiled.chain_of(d).last().expect("a dof is in its own chain") as usize] += 1);
            sizes.sort_unstable();
            let columns_per_contact = sizes.iter().rev().take(2).sum();
            solver = solver.with_noslip(SlipCapacity { rows, contacts, columns_per_contact, rolls: compiled.has_rolling_friction });
        }
        Self {
            problem,
            impulse_indices: Vec::with_capacity(rows),
            contacts: Vec::with_capacity(if compiled.has_rolling_friction { 2 * contacts } else { contacts }),
            constrained: R::Mask::splat(false),
            solver,
            in_turn: (R::LANES > 1 && compiled.ntree > 1).then(|| Box::new(LaneSolver::new(&softness.order))),
            order: VisitOrder {
                visits: Vec::with_capacity(visited * R::LANES),
                places: Vec::with_capacity(visited),
                keyed: Vec::with_capacity(visited),
                order: Vec::with_capacity(visited * R::LANES),
            },
            acceleration: zeros(),
            mass: vec![R::zero(); compiled.merged.chain.len()],
        }
    }

    /// Removes all rows.
    #[inline(always)]
    pub(super) fn clear(&mut self) {
        self.problem.clear();
        self.impulse_indices.clear();
        self.contacts.clear();
        self.constrained = R::Mask::splat(false);
    }

    /// Reduces the weights of almost rigid rows, see [`SoftSolver::limit_weights`].
    #[inline(always)]
    pub fn limit_weights(&mut self, compiled: &LaneModel<R>, factors: &MassMatrix<R>) {
        let Self { problem, solver, mass, .. } = self;
        solver.limit_weights(problem, &TreeMass { compiled, mass, factors });
    }

    /// Solves for the acceleration in the constrained lanes. `free` is the acceleration without constraints.
    pub fn solve(&mut self, compiled: &LaneModel<R>, factors: &MassMatrix<R>, free: &[R], effort: Effort<R>) -> SoftOutcome<R> {
        let Self { problem, solver, in_turn, acceleration, mass, constrained: lanes, .. } = self;
        let lanes = *lanes;
        let metric = TreeMass { compiled, mass, factors };
        if let Some(in_turn) = in_turn
            && in_turn.is_faster(problem, &metric, solver, lanes)
        {
            return in_turn.solve(problem, &metric, free, effort, lanes, acceleration, solver);
        }
        solver.solve(problem, &metric, free, effort, lanes, acceleration)
    }

    /// Stores the derivative of the acceleration with respect to rows and forces at the present solution; see [`SoftSolver::settle`].
    pub fn settle(&mut self, compiled: &LaneModel<R>, factors: &MassMatrix<R>, free: &[R]) {
        let Self { problem, solver, acceleration, mass, .. } = self;
        solver.settle(problem, &TreeMass { compiled, mass, factors }, free, acceleration);
    }

    /// Replaces the stored solution by the first-order solution of the present rows; see [`SoftSolver::respond`].
    pub fn respond(&mut self, compiled: &LaneModel<R>, factors: &MassMatrix<R>, free: &[R]) {
        let Self { problem, solver, acceleration, mass, .. } = self;
        solver.respond(problem, &TreeMass { compiled, mass, factors }, free, acceleration);
    }

    /// Computes the product of the mass matrix and the acceleration into `out`.
    #[inline(always)]
    pub fn multiply_mass(&self, compiled: &LaneModel<R>, factors: &MassMatrix<R>, out: &mut [R]) {
        TreeMass { compiled, mass: &self.mass, factors }.multiply(&self.acceleration, out);
    }

    /// Sets the initial acceleration from `impulse`, the generalized impulse of all constraints in the last step of `h` seconds.
    pub fn start_from_impulse(&mut self, compiled: &LaneModel<R>, factors: &MassMatrix<R>, free: &[R], impulse: &[R], h: R) {
        kernel!(R, || {
            let rate = R::one() / h;
            self.acceleration.copy_from_slice(impulse);
            factors.solve(compiled, &mut self.acceleration);
            for (a, &free) in self.acceleration.iter_mut().zip(free) {
                *a = free + *a * rate;
            }
        })
    }
}

/// Mass matrix with the sparsity of the kinematic trees, as metric of both solvers: entries and factors.
pub(super) struct TreeMass<'a, R: Real> {
    pub(super) compiled: &'a LaneModel<R>,
    pub(super) mass: &'a [R],
    pub(super) factors: &'a MassMatrix<R>,
}

impl<R: Real> Metric<R> for TreeMass<'_, R> {
    #[inline(always)]
    fn dimension(&self) -> usize {
        self.compiled.nv
    }

    #[inline(always)]
    fn row(&self, i: usize) -> (&[u32], &[R]) {
        let dof = &self.compiled.dofs[i];
        (self.compiled.chain_of(i), &self.mass[dof.chain..dof.chain + dof.depth])
    }

    #[inline(always)]
    fn solve(&self, x: &mut [R]) {
        self.factors.solve(self.compiled, x);
    }
}

/// Sort key of a pair of geoms: lower body, other body, and the two geoms.
pub(super) type Key = [u32; 4];

/// Order of contacts for noslip iterations, and the workspace that computes it.
#[derive(Clone, Debug)]
pub(super) struct VisitOrder<R: Real> {
    /// Contacts in the order of the visits, with the lanes of each visit.
    pub(super) visits: Vec<ContactVisit<R::Mask>>,
    /// For every slot of the contact set, range of its contacts in the problem.
    pub(super) places: Vec<Range<usize>>,
    /// Sort key and slot of the contacts in one lane.
    pub(super) keyed: Vec<(Key, u32)>,
    /// Sorted slots of every lane, lane by lane.
    pub(super) order: Vec<u32>,
}
