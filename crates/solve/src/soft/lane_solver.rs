//! Solver of soft problems that solves one lane after the other, in scalar numbers.
//!
//! The problem of all lanes has every row that exists in any lane, and its Hessian has the entries of all of them. In heaps, different
//! bodies touch in every environment, and all lanes together have many times the rows of one lane. Solving each lane alone is then faster.
//! The bits are the same, because a row that a lane lacks is zero in that lane.

use std::cell::RefCell;

use stepper_real::{Mask, Real, kernel};

use crate::soft::cone::Cone;
use crate::soft::newton::{Effort, SoftOutcome, SoftSolver};
use crate::soft::problem::{Metric, SoftProblem};

/// Number of scalar multiplications, for one lane, that take the time of one multiplication of SIMD registers. The number exceeds 1,
/// because the compiler vectorises the loop over the entries of a row.
const SPEED: f64 = 1.6;

/// Number of bytes of a SIMD register.
const REGISTER: usize = 64;

/// Number of contacts of a problem below which all lanes are solved together: solving each lane separately would cost more than it saves.
const FEWEST: usize = 8;

/// Number of problems after which the solver estimates the work again, to choose between solving each lane separately and solving all lanes
/// together.
const PERIOD: u32 = 32;
/// Largest number of lanes whose work is estimated, to choose between solving each lane separately and solving all lanes together.
const SAMPLES: usize = 4;

/// Solver of soft problems that solves one lane after the other.
#[derive(Clone, Debug)]
pub struct LaneSolver<R: Real> {
    /// Solver of the soft problem of one lane.
    solver: SoftSolver<R::Single>,
    /// Soft problem of one lane.
    problem: SoftProblem<R::Single>,
    /// Indices of the lane's scalar rows, contacts and rolling contacts in the problem of all lanes.
    places: [Vec<u32>; 3],
    /// Entries of the lower triangle of the lane's mass matrix, row by row.
    metric: Vec<R::Single>,
    /// Start of each row of the lane's mass matrix in `metric`.
    starts: Vec<usize>,
    /// Acceleration of the lane without constraints.
    free: Vec<R::Single>,
    /// Acceleration of the lane.
    acceleration: Vec<R::Single>,
    /// Buffer for a vector in all lanes.
    buffer: RefCell<Vec<R>>,
    /// Whether solving each lane separately is faster than solving all together, according to the last estimate.
    is_faster: bool,
    /// Number of further problems for which the last estimate is used.
    valid_for: u32,
}

/// Mass matrix of one lane.
struct LaneMetric<'a, R: Real, M> {
    /// Mass matrix of all lanes.
    all: &'a M,
    lane: usize,
    /// Entries of the lower triangle of the lane's mass matrix, row by row.
    entries: &'a [R::Single],
    /// Start of each row of the mass matrix in `entries`.
    starts: &'a [usize],
    /// Buffer for a vector in all lanes.
    buffer: &'a RefCell<Vec<R>>,
}

impl<R: Real, M: Metric<R>> Metric<R::Single> for LaneMetric<'_, R, M> {
    #[inline(always)]
    fn dimension(&self) -> usize {
        self.all.dimension()
    }

    #[inline(always)]
    fn row(&self, i: usize) -> (&[u32], &[R::Single]) {
        (self.all.row(i).0, &self.entries[self.starts[i]..self.starts[i + 1]])
    }

    fn solve(&self, x: &mut [R::Single]) {
        let mut buffer = self.buffer.borrow_mut();
        buffer.clear();
        buffer.extend(x.iter().map(|x| R::splat(x.lane(0))));
        kernel!(R, || self.all.solve(&mut buffer));
        copy_lane(&buffer, self.lane, x);
    }
}

impl<R: Real> LaneSolver<R> {
    /// Workspace for problems whose coordinates are eliminated in the reverse of the order `order`, as in [`SoftSolver::new`].
    pub fn new(order: &[u32]) -> Self {
        let zeros = || vec![R::Single::zero(); order.len()];
        Self {
            solver: SoftSolver::new(order),
            problem: SoftProblem::new(Cone::Elliptic, 0, 0, 0, 0, false),
            places: [vec![], vec![], vec![]],
            metric: vec![],
            starts: vec![],
            free: zeros(),
            acceleration: zeros(),
            buffer: RefCell::new(Vec::with_capacity(order.len())),
            is_faster: false,
            valid_for: 0,
        }
    }

    /// Whether solving the lanes `lanes` one after the other is faster than solving all at once by the solver `together`.
    ///
    /// The function estimates the work only once in `PERIOD` problems, because problems of consecutive steps are similar. Both methods give
    /// the same bits.
    pub fn is_faster(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, together: &mut SoftSolver<R>, lanes: R::Mask) -> bool {
        if problem.contacts.items.len() + problem.rolling_contacts.items.len() < FEWEST {
            return false;
        }
        if self.valid_for == 0 {
            self.valid_for = PERIOD;
            let lanes = (0..R::LANES).filter(|lane| lanes.bits() >> lane & 1 == 1);
            let (mut work, mut count) = (0, 0);
            for (i, lane) in lanes.enumerate() {
                count = i + 1;
                if i < SAMPLES {
                    self.gather(problem, metric, lane);
                    let Self { solver, problem: own, metric: entries, starts, buffer, .. } = self;
                    work += solver.estimate_work(own, &LaneMetric { all: metric, lane, entries, starts, buffer });
                }
            }
            let registers = (R::LANES * size_of::<R::Scalar>()) as f64 / REGISTER as f64;
            let alone = (work * count) as f64 / count.clamp(1, SAMPLES) as f64;
            self.is_faster = alone < SPEED * registers * together.estimate_work(problem, metric) as f64;
        }
        self.valid_for -= 1;
        self.is_faster
    }

    /// Solves the lanes `lanes` as [`SoftSolver::solve`] does, one after the other. The forces are stored in the solver `together`.
    #[allow(clippy::too_many_arguments, reason = "the arguments of a solve, and who has its results")]
    pub fn solve(
        &mut self,
        problem: &SoftProblem<R>,
        metric: &impl Metric<R>,
        free: &[R],
        effort: Effort<R>,
        lanes: R::Mask,
        a: &mut [R],
        together: &mut SoftSolver<R>,
    ) -> SoftOutcome<R> {
        let (forces, argument) = together.reset_results(problem);
        let mut outcome = SoftOutcome { residual: R::zero(), steps: R::zero() };
        for lane in (0..R::LANES).filter(|lane| lanes.bits() >> lane & 1 == 1) {
            self.gather(problem, metric, lane);
            copy_lane(free, lane, &mut self.free);
            copy_lane(a, lane, &mut self.acceleration);
            let Self { solver, problem: own, places, metric: entries, starts, free, acceleration, buffer, .. } = self;
            let metric = LaneMetric { all: metric, lane, entries, starts, buffer };
            let effort = Effort { steps: effort.steps, tolerance: effort.tolerance.single_lane(lane) };
            let found = solver.solve(own, &metric, free, effort, <R::Single as Real>::Mask::splat(true), acceleration);
            outcome.residual.set_lane(lane, found.residual.lane(0));
            outcome.steps.set_lane(lane, found.steps.lane(0));
            scatter(acceleration, a, lane);
            scatter(solver.forces(), forces, lane);
            let at = &solver.argument;
            for (&place, u) in places[0].iter().zip(&at.rows) {
                argument.rows[place as usize].set_lane(lane, u.lane(0));
            }
            for (&place, u) in places[1].iter().zip(&at.contacts) {
                scatter(u, &mut argument.contacts[place as usize], lane);
            }
            for (&place, u) in places[2].iter().zip(&at.rolling_contacts) {
                scatter(u, &mut argument.rolling_contacts[place as usize], lane);
            }
        }
        outcome
    }

    /// Gathers the rows and the mass matrix of a lane.
    fn gather(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, lane: usize) {
        let Self { problem: own, places, metric: entries, starts, .. } = self;
        own.clear();
        own.cone = problem.cone;
        places.iter_mut().for_each(Vec::clear);
        for (i, row) in problem.rows.iter().enumerate() {
            let weight = row.weight.single_lane(lane);
            if !weight.eq(R::Single::zero()).all() {
                places[0].push(i as u32);
                let (columns, jacobian) = problem.entries(row);
                let bounds = row.bounds.map(|bound| bound.single_lane(lane));
                own.push_entries(columns, jacobian.iter().map(|&j| j.single_lane(lane)), row.reference.single_lane(lane), weight, bounds);
            }
        }
        own.contacts.gather(&problem.contacts, lane, &mut places[1]);
        own.rolling_contacts.gather(&problem.rolling_contacts, lane, &mut places[2]);
        entries.clear();
        starts.clear();
        starts.push(0);
        for i in 0..metric.dimension() {
            entries.extend(metric.row(i).1.iter().map(|&entry| entry.single_lane(lane)));
            starts.push(entries.len());
        }
    }
}

/// Copies the numbers of lane `lane` of `from` to `to`, a list of single-lane numbers.
fn copy_lane<R: Real>(from: &[R], lane: usize, to: &mut [R::Single]) {
    for (to, &from) in to.iter_mut().zip(from) {
        *to = from.single_lane(lane);
    }
}

/// Copies the single-lane numbers `from` to lane `lane` of the numbers `to`.
fn scatter<R: Real>(from: &[R::Single], to: &mut [R], lane: usize) {
    for (to, from) in to.iter_mut().zip(from) {
        to.set_lane(lane, from.lane(0));
    }
}
