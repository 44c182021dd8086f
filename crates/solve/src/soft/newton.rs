//! Newton's method with an exact line search for the soft problem, over lanes.
//!
//! The objective is strictly convex and its gradient is piecewise smooth. The method therefore converges from any start, and quadratically
//! near the solution (Boyd & Vandenberghe 2004, section 9.5, for exact line search).

use stepper_real::{Mask, Real, kernel};

use crate::constraints::constraint_set::add_transposed;
use crate::soft::hessian::{Argument, Hessian, advance};
use crate::soft::noslip::{ContactVisit, NoSlip, SlipCapacity, SlipEffort};
use crate::soft::problem::{Metric, SoftProblem};

/// Limits of a solve of the soft problem.
#[derive(Clone, Copy, Debug)]
pub struct Effort<R> {
    /// Largest number of Newton steps.
    pub steps: u32,
    /// Residual at which a lane stops, m/s^2 or rad/s^2.
    pub tolerance: R,
}

/// Result of a solve of the soft problem, in each lane.
#[derive(Clone, Copy, Debug)]
pub struct SoftOutcome<R> {
    /// Largest acceleration by the remaining imbalance M (a - a0) - J^T f of inertial and constraint forces, m/s^2 or rad/s^2. It is 0 for
    /// the exact solution.
    pub residual: R,
    /// Number of Newton steps.
    pub steps: R,
}

/// Newton's method for a [`SoftProblem`], with its workspace.
#[derive(Clone, Debug)]
pub struct SoftSolver<R: Real> {
    /// Hessian of the soft problem's objective, and its factors.
    hessian: Hessian<R>,
    /// Acceleration of each row relative to its reference, at the current acceleration.
    pub(super) argument: Argument<R>,
    /// Change of each row's relative acceleration along Newton's direction.
    change: Argument<R>,
    /// Gradient of the soft problem's objective.
    gradient: Vec<R>,
    /// Gradient of the objective as an acceleration: the product M^-1 times the gradient, with the mass matrix M.
    imbalance: Vec<R>,
    /// Newton's search direction: a change of the acceleration of every degree of freedom.
    direction: Vec<R>,
    /// Product M (a - a0) of the mass matrix and the difference between the acceleration and that without constraints.
    inertial: Vec<R>,
    /// Product of the mass matrix and Newton's direction.
    inertial_change: Vec<R>,
    /// Generalized constraint forces, N or N m.
    forces: Vec<R>,
    /// Noslip solver, which recomputes friction forces without regularisation, if there is one.
    noslip: Option<Box<NoSlip<R>>>,
    /// Whether the current forces are those of the noslip solver, and not those of the regularised problem.
    forces_without_slip: bool,
}

/// Largest number of evaluations of the slope in a line search. Newton's method on a convex piecewise quadratic takes two to four.
const LINE_SEARCH_STEPS: u32 = 16;

/// Ratio of the slope along the search direction to the initial slope, below which a line search ends.
const LINE_SEARCH_TOLERANCE: f64 = 1e-2;

/// Number of multiplications for a contact in a Newton step of the soft problem, in addition to those of the factorisation.
const CONTACT_WORK: usize = 300;

/// Number of Newton steps of [`SoftSolver::respond`].
const RESPONSE_STEPS: usize = 2;

impl<R: Real> SoftSolver<R> {
    /// Workspace for problems whose coordinates (degrees of freedom) are eliminated in the reverse of the order `order`, which has each of
    /// them once.
    ///
    /// Coordinates that rows couple to many others must come first. The coordinates of one kinematic tree must be consecutive and in their
    /// order.
    pub fn new(order: &[u32]) -> Self {
        let zeros = || vec![R::zero(); order.len()];
        Self {
            hessian: Hessian::new(order),
            argument: Argument::default(),
            change: Argument::default(),
            gradient: zeros(),
            imbalance: zeros(),
            direction: zeros(),
            inertial: zeros(),
            inertial_change: zeros(),
            forces: zeros(),
            noslip: None,
            forces_without_slip: false,
        }
    }

    /// Solver with buffers for [`SoftSolver::remove_slip`].
    #[must_use]
    pub fn with_noslip(mut self, capacity: SlipCapacity) -> Self {
        self.noslip = Some(Box::new(NoSlip::new(self.forces.len(), capacity)));
        self
    }

    /// Reduces the weights of almost rigid rows so much that rounding spoils neither the Hessian nor the forces. A force changes by at most
    /// 1e-8 of itself; by 1e-7 with elliptic cones, and by 1e-5 in single precision.
    #[inline(always)]
    pub fn limit_weights(&mut self, problem: &mut SoftProblem<R>, metric: &impl Metric<R>) {
        problem.limit_weights(metric, &mut self.direction);
    }

    /// Solves the lanes `lanes`. The start is the acceleration `a`, which is replaced by the solution. `free` is the acceleration without
    /// constraints.
    pub fn solve(
        &mut self,
        problem: &SoftProblem<R>,
        metric: &impl Metric<R>,
        free: &[R],
        effort: Effort<R>,
        lanes: R::Mask,
        a: &mut [R],
    ) -> SoftOutcome<R> {
        self.forces_without_slip = false;
        self.hessian.find_pattern(problem, metric);
        kernel!(R, || self.begin(problem, metric, free, a));
        kernel!(R, || {
            let (mut outcome, mut running) = (SoftOutcome { residual: R::zero(), steps: R::zero() }, lanes);
            for step in 0..=effort.steps {
                let residual = kernel!(R, || self.find_gradient(problem, metric));
                outcome.residual = R::select(running, residual, outcome.residual);
                running = running.and_not(residual.le(effort.tolerance));
                if running.none() || step == effort.steps {
                    break;
                }
                outcome.steps += R::select(running, R::one(), R::zero());
                kernel!(R, || self.hessian.assemble(problem, metric, &self.argument));
                kernel!(R, || self.hessian.factor());
                kernel!(R, || self.descend(problem, metric, running, a));
            }
            outcome
        })
    }

    /// Recomputes the friction forces without regularisation, after [`SoftSolver::solve`] has found the solution `a` of the same problem in
    /// the lanes `lanes`.
    ///
    /// `a` is replaced by the acceleration with the new forces (see the module `noslip`). `visits` are the contacts in the order in which
    /// each sweep visits them. Returns the number of sweeps of each lane.
    ///
    /// # Panics
    /// If the solver was made without [`SoftSolver::with_noslip`].
    #[allow(clippy::too_many_arguments, reason = "the arguments of a solve, and those of the sweeps")]
    pub fn remove_slip(
        &mut self,
        problem: &SoftProblem<R>,
        metric: &impl Metric<R>,
        free: &[R],
        visits: &[ContactVisit<R::Mask>],
        effort: SlipEffort<R::Scalar>,
        lanes: R::Mask,
        a: &mut [R],
    ) -> R {
        let mut noslip = self.noslip.take().expect("made with capacity for it");
        noslip.begin(problem, metric, &self.argument);
        // In this function, the buffer `direction` holds the acceleration.
        kernel!(R, || self.accelerate(&noslip, problem, metric, free));
        kernel!(R, || {
            noslip.find_responses(
                problem,
                #[inline(always)]
                |x| metric.solve(x),
            )
        });
        let sweeps = noslip.sweep(problem, visits, effort, lanes, &mut self.direction);
        kernel!(R, || {
            self.accelerate(&noslip, problem, metric, free);
            for (a, &next) in a.iter_mut().zip(&self.direction) {
                *a = R::select(lanes, next, *a);
            }
        });
        self.noslip = Some(noslip);
        self.forces_without_slip = true;
        sweeps
    }

    /// Computes the acceleration by the forces of the noslip solver into `direction`. `free` is the acceleration without constraints.
    #[inline(always)]
    fn accelerate(&mut self, noslip: &NoSlip<R>, problem: &SoftProblem<R>, metric: &impl Metric<R>, free: &[R]) {
        noslip.add_forces(problem, &mut self.forces);
        self.direction.copy_from_slice(&self.forces);
        metric.solve(&mut self.direction);
        advance(&mut self.direction, free, R::one());
    }

    /// Noslip solver, if it has computed the current forces; `None` if they are those of the regularised problem.
    fn noslip_forces(&self) -> Option<&NoSlip<R>> {
        self.noslip.as_deref().filter(|_| self.forces_without_slip)
    }

    /// Stores the factors of the Hessian at the solution `a`, for later calls of [`SoftSolver::respond`]. `free` is the acceleration
    /// without constraints.
    pub fn settle(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, free: &[R], a: &[R]) {
        self.hessian.find_pattern(problem, metric);
        kernel!(R, || {
            self.begin(problem, metric, free, a);
            self.hessian.assemble(problem, metric, &self.argument);
        });
        kernel!(R, || self.hessian.factor());
    }

    /// Approximates the solution of a problem that is similar to that of the last [`SoftSolver::settle`]. `a` must be the acceleration of
    /// that call, and becomes the approximate solution. `free` is the new acceleration without constraints.
    ///
    /// The function makes two Newton steps with the stored Hessian. The first step gives the change by the implicit function theorem. The
    /// second adds the effect of the cones' curvature between the two problems.
    pub fn respond(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, free: &[R], a: &mut [R]) {
        kernel!(R, || {
            for _ in 0..RESPONSE_STEPS {
                self.begin(problem, metric, free, a);
                self.find_gradient(problem, metric);
                self.hessian.solve(&mut self.gradient);
                for (a, &change) in a.iter_mut().zip(&self.gradient) {
                    *a -= change;
                }
            }
        });
    }

    /// Generalized constraint forces at the solution, N or N m.
    pub fn forces(&self) -> &[R] {
        &self.forces
    }

    /// Estimated number of multiplications of a Newton step for a problem.
    pub(super) fn estimate_work(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>) -> usize {
        self.hessian.find_pattern(problem, metric);
        self.hessian.work + CONTACT_WORK * (problem.contacts.items.len() + problem.rolling_contacts.items.len())
    }

    /// Generalized forces and relative accelerations of the rows, both set to zero, into which another solver writes its solution.
    pub(super) fn reset_results(&mut self, problem: &SoftProblem<R>) -> (&mut [R], &mut Argument<R>) {
        self.forces_without_slip = false;
        self.forces.fill(R::zero());
        self.argument.clear_for(problem);
        (&mut self.forces, &mut self.argument)
    }

    /// Force of scalar row `i` at the solution, N or N m.
    #[inline(always)]
    pub fn row_force(&self, problem: &SoftProblem<R>, i: usize) -> R {
        self.noslip_forces().map_or_else(|| problem.rows[i].force(self.argument.rows[i]), |noslip| noslip.rows.force[i][0])
    }

    /// Force of contact `i` with three rows at the solution, N.
    #[inline(always)]
    pub fn contact_force(&self, problem: &SoftProblem<R>, i: usize) -> [R; 3] {
        match self.noslip_forces() {
            Some(noslip) => noslip.contacts.force[i],
            None => problem.cone.force(&problem.contacts.items[i], &self.argument.contacts[i]),
        }
    }

    /// Force of contact `i` with six rows at the solution, N or N m.
    #[inline(always)]
    pub fn rolling_contact_force(&self, problem: &SoftProblem<R>, i: usize) -> [R; 6] {
        match self.noslip_forces() {
            Some(noslip) => noslip.rolling.force[i],
            None => problem.cone.force(&problem.rolling_contacts.items[i], &self.argument.rolling_contacts[i]),
        }
    }

    /// Computes the starting values of Newton's method at the acceleration `a`: the relative accelerations of all rows, and M (a - a0) with
    /// the mass matrix M. The free acceleration a0 is `free`.
    #[inline(always)]
    fn begin(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, free: &[R], a: &[R]) {
        self.argument.multiply(problem, a, true);
        for ((x, &a), &free) in self.direction.iter_mut().zip(a).zip(free) {
            *x = a - free;
        }
        metric.multiply(&self.direction, &mut self.inertial);
    }

    /// Computes the gradient M (a - a0) - J^T f of the objective, where f are the row forces and a0 the free acceleration. Returns the
    /// residual: the largest acceleration that the gradient causes.
    #[inline(always)]
    fn find_gradient(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>) -> R {
        self.forces.fill(R::zero());
        for (row, &u) in problem.rows.iter().zip(&self.argument.rows) {
            let ((columns, jacobian), force) = (problem.entries(row), row.force(u));
            add_transposed(columns, jacobian.as_chunks().0, [force], &mut self.forces);
        }
        problem.contacts.add_forces(problem.cone, &self.argument.contacts, &mut self.forces);
        problem.rolling_contacts.add_forces(problem.cone, &self.argument.rolling_contacts, &mut self.forces);
        for (((gradient, imbalance), &inertial), &force) in
            self.gradient.iter_mut().zip(&mut self.imbalance).zip(&self.inertial).zip(&self.forces)
        {
            *gradient = inertial - force;
            *imbalance = *gradient;
        }
        metric.solve(&mut self.imbalance);
        let mut largest = R::zero();
        for &x in &self.imbalance {
            largest = largest.max_or_nan(x.abs());
        }
        largest
    }

    /// Makes a Newton step with a line search in the lanes `lanes`.
    #[inline(always)]
    fn descend(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, lanes: R::Mask, a: &mut [R]) {
        for (direction, &gradient) in self.direction.iter_mut().zip(&self.gradient) {
            *direction = -gradient;
        }
        self.hessian.solve(&mut self.direction);
        self.change.multiply(problem, &self.direction, false);
        metric.multiply(&self.direction, &mut self.inertial_change);
        let step = self.search(problem, lanes);
        advance(a, &self.direction, step);
        advance(&mut self.inertial, &self.inertial_change, step);
        self.argument.advance(&self.change, step);
    }

    /// Step length along the search direction at which the slope is zero; 0 outside `lanes`.
    ///
    /// Newton's method finds the root of the slope. If it leaves the interval in which the slope changes its sign, the interval is
    /// bisected.
    #[inline(always)]
    fn search(&self, problem: &SoftProblem<R>, lanes: R::Mask) -> R {
        let mut quadratic = [R::zero(); 2];
        for ((&direction, &inertial), &change) in self.direction.iter().zip(&self.inertial).zip(&self.inertial_change) {
            quadratic[0] += direction * inertial;
            quadratic[1] += direction * change;
        }
        let mut at_zero = R::zero();
        for (&direction, &gradient) in self.direction.iter().zip(&self.gradient) {
            at_zero += direction * gradient;
        }
        let enough = at_zero.abs() * R::of(LINE_SEARCH_TOLERANCE);
        let (mut low, mut high, mut step) = (R::zero(), R::of(f64::INFINITY), R::one());
        let mut searching = lanes;
        for _ in 0..LINE_SEARCH_STEPS {
            let slope = self.slope(problem, quadratic[0] + step * quadratic[1], step);
            searching = searching.and_not(slope.abs().le(enough));
            if searching.none() {
                break;
            }
            let rises = slope.gt(R::zero());
            low = R::select(searching.and_not(rises), step, low);
            high = R::select(searching.and(rises), step, high);
            let newton = step - slope / self.curvature(problem, quadratic[1], step);
            let bounded = high.lt(R::of(f64::INFINITY));
            let halfway = R::select(bounded, (low + R::select(bounded, high, R::zero())) * R::of(0.5), low + low);
            let inside = newton.gt(low).and(newton.lt(high));
            step = R::select(searching, R::select(inside, newton, halfway), step);
        }
        R::select(lanes, step, R::zero())
    }

    /// Derivative of the objective along the search direction, after a step of length `step`. The argument `slope` is the contribution of
    /// the kinetic term.
    #[inline(always)]
    fn slope(&self, problem: &SoftProblem<R>, mut slope: R, step: R) -> R {
        let (argument, change) = (&self.argument, &self.change);
        for ((row, &u), &du) in problem.rows.iter().zip(&argument.rows).zip(&change.rows) {
            slope -= row.force(u + step * du) * du;
        }
        let slope = problem.contacts.add_slopes(problem.cone, &argument.contacts, &change.contacts, step, slope);
        problem.rolling_contacts.add_slopes(problem.cone, &argument.rolling_contacts, &change.rolling_contacts, step, slope)
    }

    /// Second derivative of the objective along the search direction after a step of length `step`. The argument `sum` is the contribution
    /// of the kinetic term.
    #[inline(always)]
    fn curvature(&self, problem: &SoftProblem<R>, mut sum: R, step: R) -> R {
        let (argument, change) = (&self.argument, &self.change);
        for ((row, &u), &du) in problem.rows.iter().zip(&argument.rows).zip(&change.rows) {
            sum += row.curvature(u + step * du) * du * du;
        }
        let sum = problem.contacts.add_curvatures(problem.cone, &argument.contacts, &change.contacts, step, sum);
        problem.rolling_contacts.add_curvatures(problem.cone, &argument.rolling_contacts, &change.rolling_contacts, step, sum)
    }
}
