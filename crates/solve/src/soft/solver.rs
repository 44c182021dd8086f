//! Who solves a soft problem: all lanes together, or each by itself.

use stepper_real::Real;

use crate::soft::lane_solver::LaneSolver;
use crate::soft::newton::{Effort, NewtonSolver, SoftOutcome};
use crate::soft::noslip::{ContactVisit, SlipEffort, SlipRoom};
use crate::soft::problem::{Metric, SoftProblem};

/// Solver of a [`SoftProblem`], with its workspace.
#[derive(Clone, Debug)]
pub struct SoftSolver<R: Real> {
    order: Vec<u32>,
    together: NewtonSolver<R>,
    /// Made when it is first used.
    in_turn: Option<Box<LaneSolver<R>>>,
}

impl<R: Real> SoftSolver<R> {
    /// Room for problems of as many coordinates as `order` lists, each once. They are eliminated from the last to the first: what rows
    /// join to many others belongs in front. Coordinates of one tree stay together and in their own order.
    pub fn new(order: &[u32]) -> Self {
        Self { order: order.to_vec(), together: NewtonSolver::new(order), in_turn: None }
    }

    /// With room for [`SoftSolver::remove_slip`].
    #[must_use]
    pub fn with_noslip(mut self, room: SlipRoom) -> Self {
        self.together = self.together.with_noslip(room);
        self
    }

    /// Solves the lanes `lanes` from the acceleration `a`, which becomes the solution; `free` is a0.
    pub fn solve(
        &mut self,
        problem: &SoftProblem<R>,
        metric: &impl Metric<R>,
        free: &[R],
        effort: Effort<R>,
        lanes: R::Mask,
        a: &mut [R],
    ) -> SoftOutcome<R> {
        if LaneSolver::matters(problem) {
            let Self { order, together, in_turn } = self;
            let in_turn = in_turn.get_or_insert_with(|| Box::new(LaneSolver::new(order)));
            if in_turn.pays(problem, metric, together, lanes) {
                return in_turn.solve(problem, metric, free, effort, lanes, a, together);
            }
        }
        self.together.solve(problem, metric, free, effort, lanes, a)
    }

    /// The same lane by lane, with the same bits: sooner where each has few of the rows that there are.
    pub fn solve_in_turn(
        &mut self,
        problem: &SoftProblem<R>,
        metric: &impl Metric<R>,
        free: &[R],
        effort: Effort<R>,
        lanes: R::Mask,
        a: &mut [R],
    ) -> SoftOutcome<R> {
        let Self { order, together, in_turn } = self;
        let in_turn = in_turn.get_or_insert_with(|| Box::new(LaneSolver::new(order)));
        in_turn.solve(problem, metric, free, effort, lanes, a, together)
    }

    /// Sweeps over the forces of friction after [`SoftSolver::solve`] found the solution `a` of the same problem in the lanes `lanes`; it
    /// becomes the acceleration with the new forces; see the module of the sweeps. `visits` are the contacts in their order. Rows from
    /// `constraints` on are couplings of the metric. Returns the sweeps of each lane.
    ///
    /// With couplings the sweeps take no more of each than its diagonal, as MuJoCo's do; the acceleration at last has all of it.
    ///
    /// # Panics
    /// If it was made without [`SoftSolver::with_noslip`].
    #[allow(clippy::too_many_arguments, reason = "the arguments of a solve, and those of the sweeps")]
    pub fn remove_slip(
        &mut self,
        problem: &SoftProblem<R>,
        metric: &impl Metric<R>,
        free: &[R],
        constraints: usize,
        visits: &[ContactVisit<R::Mask>],
        effort: SlipEffort<R::Scalar>,
        lanes: R::Mask,
        a: &mut [R],
    ) -> R {
        self.together.remove_slip(problem, metric, free, constraints, visits, effort, lanes, a)
    }

    /// Keeps the factors of the Hessian at the solution `a`, for [`SoftSolver::respond`].
    pub fn settle(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, free: &[R], a: &[R]) {
        self.together.settle(problem, metric, free, a);
    }

    /// Replaces the acceleration `a`, the solution of the problem that was settled, by that of a problem near it: steps of Newton's method
    /// with the Hessian that was kept. The first is the implicit function theorem, the second takes up how cones bend between the two.
    pub fn respond(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, free: &[R], a: &mut [R]) {
        self.together.respond(problem, metric, free, a);
    }

    /// Forces of the constraints at the solution, as generalized forces.
    pub fn forces(&self) -> &[R] {
        self.together.forces()
    }

    /// Force of every scalar row at the solution.
    pub fn row_force(&self, problem: &SoftProblem<R>, i: usize) -> R {
        self.together.row_force(problem, i)
    }

    /// Force of a contact at the solution.
    #[inline(always)]
    pub fn contact_force(&self, problem: &SoftProblem<R>, i: usize) -> [R; 3] {
        self.together.contact_force(problem, i)
    }

    /// Force of a contact with six rows at the solution.
    #[inline(always)]
    pub fn rolling_contact_force(&self, problem: &SoftProblem<R>, i: usize) -> [R; 6] {
        self.together.rolling_contact_force(problem, i)
    }
}
