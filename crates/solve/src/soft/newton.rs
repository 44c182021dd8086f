//! Newton's method with an exact line search, over lanes.
//!
//! The objective is strictly convex and its gradient is piecewise smooth. The method therefore converges from any start, and at last
//! quadratically (Boyd & Vandenberghe 2004, section 9.5, for exact line search).

use stepper_real::{Mask, Real};

use crate::soft::hessian::{Argument, Hessian, advance};
use crate::soft::noslip::{ContactVisit, NoSlip, Responds, SlipCapacity, SlipEffort};
use crate::soft::problem::{Metric, SoftProblem};

/// Limit of the effort and tolerance of a solve.
#[derive(Clone, Copy, Debug)]
pub struct Effort<R> {
    /// Largest number of steps.
    pub steps: u32,
    /// Residual at which a lane stops, in units of acceleration.
    pub tolerance: R,
}

/// Outcome of a solve.
#[derive(Clone, Copy, Debug)]
pub struct SoftOutcome<R> {
    /// Acceleration by the remaining imbalance M (a - a0) - J^T f, largest component: 0 for the exact solution.
    pub residual: R,
    /// Number of steps.
    pub steps: R,
}

/// Newton's method for [`SoftProblem`], with its workspace.
#[derive(Clone, Debug)]
pub struct SoftSolver<R: Real> {
    hessian: Hessian<R>,
    argument: Argument<R>,
    change: Argument<R>,
    /// Gradient, and the acceleration by it.
    gradient: Vec<R>,
    imbalance: Vec<R>,
    direction: Vec<R>,
    /// Products M (a - a0), and M times the direction.
    inertial: Vec<R>,
    inertial_change: Vec<R>,
    forces: Vec<R>,
    /// Sweeps after the solution, if friction must not slip, and whether the present forces are theirs.
    noslip: Option<Box<NoSlip<R>>>,
    without_slip: bool,
}

/// Largest number of evaluations of the slope in a line search. Newton's method on a convex piecewise quadratic takes two to four.
const LINE_SEARCH_STEPS: u32 = 16;

/// Ratio of the slope along the direction to the initial one at which a line search ends.
const LINE_SEARCH_TOLERANCE: f64 = 1e-2;

/// Multiplications of a contact in a step, in addition to those of the factors.
const CONTACT_WORK: usize = 300;

/// Number of Newton steps of [`SoftSolver::respond`].
const RESPONSE_STEPS: usize = 2;

impl<R: Real> SoftSolver<R> {
    /// Workspace for problems with the coordinates in `order`, each once.
    ///
    /// They are eliminated from the last to the first. Coordinates that rows join to many others belong in front. Those of one tree stay
    /// together and in order.
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
            without_slip: false,
        }
    }

    /// Solver with buffers for [`SoftSolver::remove_slip`].
    #[must_use]
    pub fn with_noslip(mut self, capacity: SlipCapacity) -> Self {
        self.noslip = Some(Box::new(NoSlip::new(self.forces.len(), capacity)));
        self
    }

    /// Solves the lanes `lanes` from the acceleration `a`, which becomes the solution. `free` is a0.
    pub fn solve(
        &mut self,
        problem: &SoftProblem<R>,
        metric: &impl Metric<R>,
        free: &[R],
        effort: Effort<R>,
        lanes: R::Mask,
        a: &mut [R],
    ) -> SoftOutcome<R> {
        self.without_slip = false;
        self.hessian.find_pattern(problem, metric);
        R::vectorize(
            #[inline(always)]
            || self.begin(problem, metric, free, a),
        );
        let (mut outcome, mut running) = (SoftOutcome { residual: R::zero(), steps: R::zero() }, lanes);
        for step in 0..=effort.steps {
            let residual = R::vectorize(
                #[inline(always)]
                || self.find_gradient(problem, metric),
            );
            outcome.residual = R::select(running, residual, outcome.residual);
            running = running.and_not(residual.le(effort.tolerance));
            if running.none() || step == effort.steps {
                break;
            }
            R::vectorize(
                #[inline(always)]
                || self.hessian.assemble(problem, metric, &self.argument),
            );
            R::vectorize(
                #[inline(always)]
                || self.hessian.factor(),
            );
            R::vectorize(
                #[inline(always)]
                || {
                    self.descend(problem, metric, running, a);
                    outcome.steps += R::select(running, R::one(), R::zero());
                },
            );
        }
        outcome
    }

    /// Sweeps over the friction forces after [`SoftSolver::solve`] has found the solution `a` of the same problem in the lanes `lanes`.
    ///
    /// `a` becomes the acceleration with the new forces (see the module `noslip`). `visits` are the contacts in their order. Rows from
    /// `constraints` on are couplings of the metric. Returns the sweeps of each lane. The sweeps use only the diagonal of each coupling, as
    /// MuJoCo's do. The final acceleration uses all of it.
    ///
    /// # Panics
    /// If the solver was made without [`SoftSolver::with_noslip`].
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
        let mut noslip = self.noslip.take().expect("made with capacity for it");
        let coupled = constraints < problem.rows.len();
        noslip.begin(problem, metric, constraints, &self.argument);
        if coupled {
            self.hessian.find_pattern(problem, metric);
        }
        // Here `inertial` is the acceleration without constraints, `direction` that with them.
        R::vectorize(
            #[inline(always)]
            || {
                self.inertial.copy_from_slice(free);
                if coupled {
                    multiply(metric, free, &mut self.inertial);
                    self.factor_metric(problem, metric, constraints, false);
                    self.hessian.solve(&mut self.inertial);
                    self.factor_metric(problem, metric, constraints, true);
                }
                noslip.add_forces(problem, &mut self.forces);
                self.direction.copy_from_slice(&self.forces);
                if coupled {
                    self.hessian.solve(&mut self.direction)
                } else {
                    metric.solve(&mut self.direction)
                }
                advance(&mut self.direction, &self.inertial, R::one());
            },
        );
        let running = &mut self.direction;
        R::vectorize(
            #[inline(always)]
            || {
                if coupled {
                    noslip.find_responses(problem, &mut self.hessian, constraints)
                } else {
                    noslip.find_responses(problem, &mut Uncoupled(metric), constraints)
                }
            },
        );
        let sweeps = noslip.sweep(problem, constraints, visits, effort, lanes, running);
        R::vectorize(
            #[inline(always)]
            || {
                noslip.add_forces(problem, &mut self.forces);
                self.direction.copy_from_slice(&self.forces);
                if coupled {
                    self.factor_metric(problem, metric, constraints, false);
                    self.hessian.solve(&mut self.direction);
                } else {
                    metric.solve(&mut self.direction);
                }
                for ((a, &free), &change) in a.iter_mut().zip(&self.inertial).zip(&self.direction) {
                    *a = R::select(lanes, free + change, *a);
                }
            },
        );
        self.noslip = Some(noslip);
        self.without_slip = true;
        sweeps
    }

    /// Factors the metric with the couplings; `lumped` keeps only their diagonals.
    #[inline(always)]
    fn factor_metric(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, constraints: usize, lumped: bool) {
        self.hessian.assemble_metric(problem, metric, constraints, lumped);
        self.hessian.factor();
    }

    /// Sweeps whose forces are the current ones, if any.
    fn slipless(&self) -> Option<&NoSlip<R>> {
        self.noslip.as_deref().filter(|_| self.without_slip)
    }

    /// Stores the factors of the Hessian at the solution `a`, for [`SoftSolver::respond`].
    pub fn settle(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, free: &[R], a: &[R]) {
        self.hessian.find_pattern(problem, metric);
        R::vectorize(
            #[inline(always)]
            || {
                self.begin(problem, metric, free, a);
                self.hessian.assemble(problem, metric, &self.argument);
            },
        );
        R::vectorize(
            #[inline(always)]
            || self.hessian.factor(),
        );
    }

    /// Replaces the acceleration `a`, the stored solution, by that of a problem close to it, with Newton steps and the stored Hessian.
    ///
    /// The first step is the implicit function theorem. The second adds the effect of the cones' curvature between the two problems.
    pub fn respond(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, free: &[R], a: &mut [R]) {
        R::vectorize(
            #[inline(always)]
            || {
                for _ in 0..RESPONSE_STEPS {
                    self.begin(problem, metric, free, a);
                    self.find_gradient(problem, metric);
                    self.hessian.solve(&mut self.gradient);
                    for (a, &change) in a.iter_mut().zip(&self.gradient) {
                        *a -= change;
                    }
                }
            },
        );
    }

    /// Constraint forces at the solution, as generalized forces.
    pub fn forces(&self) -> &[R] {
        &self.forces
    }

    /// Estimates the multiplications of a step for a problem.
    pub(super) fn estimate_work(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>) -> usize {
        self.hessian.find_pattern(problem, metric);
        self.hessian.work() + CONTACT_WORK * (problem.contacts.items.len() + problem.rolling_contacts.items.len())
    }

    /// Velocity-like arguments of the rows at the solution.
    pub(super) fn argument(&self) -> &Argument<R> {
        &self.argument
    }

    /// Buffers of the joint forces and of the row arguments, set to zero, for a solution that another solver computes.
    pub(super) fn take_over(&mut self, problem: &SoftProblem<R>) -> (&mut [R], &mut Argument<R>) {
        self.without_slip = false;
        self.forces.fill(R::zero());
        self.argument.clear_for(problem);
        (&mut self.forces, &mut self.argument)
    }

    /// Force of every scalar row at the solution.
    pub fn row_force(&self, problem: &SoftProblem<R>, i: usize) -> R {
        self.slipless().map_or_else(|| problem.rows[i].force(self.argument.rows[i]), |noslip| noslip.row(i))
    }

    /// Force of a contact at the solution.
    #[inline(always)]
    pub fn contact_force(&self, problem: &SoftProblem<R>, i: usize) -> [R; 3] {
        match self.slipless() {
            Some(noslip) => noslip.contact(i),
            None => problem.cone.force(&problem.contacts.items[i], &self.argument.contacts[i]),
        }
    }

    /// Force of a contact with six rows at the solution.
    #[inline(always)]
    pub fn rolling_contact_force(&self, problem: &SoftProblem<R>, i: usize) -> [R; 6] {
        match self.slipless() {
            Some(noslip) => noslip.rolling_contact(i),
            None => problem.cone.force(&problem.rolling_contacts.items[i], &self.argument.rolling_contacts[i]),
        }
    }

    #[inline(always)]
    fn begin(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, free: &[R], a: &[R]) {
        self.argument.multiply(problem, a, true);
        for ((x, &a), &free) in self.direction.iter_mut().zip(a).zip(free) {
            *x = a - free;
        }
        multiply(metric, &self.direction, &mut self.inertial);
    }

    /// Computes the gradient M (a - a0) - J^T f, and its residual.
    #[inline(always)]
    fn find_gradient(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>) -> R {
        self.forces.fill(R::zero());
        for (row, &u) in problem.rows.iter().zip(&self.argument.rows) {
            let ((support, jacobian), force) = (problem.entries(row), row.force(u));
            for (&d, &j) in support.iter().zip(jacobian) {
                self.forces[d as usize] += j * force;
            }
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
            // This form propagates a NaN.
            largest = R::select(x.abs().le(largest), largest, x.abs());
        }
        largest
    }

    /// Makes a step of Newton's method in the lanes `lanes`.
    #[inline(always)]
    fn descend(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, lanes: R::Mask, a: &mut [R]) {
        for (direction, &gradient) in self.direction.iter_mut().zip(&self.gradient) {
            *direction = -gradient;
        }
        self.hessian.solve(&mut self.direction);
        self.change.multiply(problem, &self.direction, false);
        multiply(metric, &self.direction, &mut self.inertial_change);
        let step = self.search(problem, lanes);
        advance(a, &self.direction, step);
        advance(&mut self.inertial, &self.inertial_change, step);
        self.argument.advance(&self.change, step);
    }

    /// Step along the direction at which the slope is zero, 0 outside `lanes`.
    ///
    /// Newton's method on the slope, with bisection where it leaves the interval in which the slope changes its sign.
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
}

impl<R: Real> SoftSolver<R> {
    /// Slope along the direction after a step. `slope` is the part of the accelerations.
    #[inline(always)]
    fn slope(&self, problem: &SoftProblem<R>, mut slope: R, step: R) -> R {
        let (argument, change) = (&self.argument, &self.change);
        for ((row, &u), &du) in problem.rows.iter().zip(&argument.rows).zip(&change.rows) {
            slope -= row.force(u + step * du) * du;
        }
        let slope = problem.contacts.add_slopes(problem.cone, &argument.contacts, &change.contacts, step, slope);
        problem.rolling_contacts.add_slopes(problem.cone, &argument.rolling_contacts, &change.rolling_contacts, step, slope)
    }

    /// Second derivative along the direction after a step. `sum` is the part of the accelerations.
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

/// Metric without couplings.
struct Uncoupled<'a, M>(&'a M);

impl<R: Real, M: Metric<R>> Responds<R> for Uncoupled<'_, M> {
    #[inline(always)]
    fn respond(&mut self, x: &mut [R]) {
        self.0.solve(x);
    }
}

impl<R: Real> Responds<R> for Hessian<R> {
    #[inline(always)]
    fn respond(&mut self, x: &mut [R]) {
        self.solve(x);
    }
}

/// Computes out = M x.
#[inline(always)]
fn multiply<R: Real>(metric: &impl Metric<R>, x: &[R], out: &mut [R]) {
    out.fill(R::zero());
    for i in 0..metric.dimension() {
        let (columns, entries) = metric.row(i);
        let mut sum = entries[0] * x[i];
        for (&c, &entry) in columns[1..].iter().zip(&entries[1..]) {
            sum += entry * x[c as usize];
            out[c as usize] += entry * x[i];
        }
        out[i] += sum;
    }
}
