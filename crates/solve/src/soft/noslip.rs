//! Noslip solver: recomputes friction forces after the solution of the soft problem, without the regularisation that lets contacts creep
//! (MuJoCo's documentation, computation chapter, "Algorithms", NoSlip).
//!
//! Sweeps of projected Gauss-Seidel minimise 1/2 f^T A f + f^T b with A = J M^-1 J^T. The unknowns are the forces of dry friction and of
//! the friction rows of contacts. All other forces remain those of the soft problem's solution. The tangential forces of an elliptic
//! contact are limited to the ellipse of its normal force. The sum of the forces of two opposite edges of a pyramid remains constant. A is
//! never formed: a sweep updates the acceleration, from the stored response of the acceleration to a unit force in each row.
//!
//! Rows that share no kinematic tree, directly or through other rows, are in separate islands. An island stops when a sweep improves its
//! objective by less than the tolerance. The other islands continue.

use std::ops::Range;

use stepper_real::{Mask, Real, Scalar, kernel};

use crate::constraints::constraint_set::add_transposed;
use crate::soft::cone::Cone;
use crate::soft::contact::SoftContact;
use crate::soft::hessian::Argument;
use crate::soft::problem::{Metric, SoftContacts, SoftProblem};

/// Limits of the noslip solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlipEffort<S> {
    /// Largest number of sweeps (Gauss-Seidel iterations).
    pub sweeps: u32,
    /// Improvement of an island's objective by a sweep below which the island stops, divided by the trace of the island's mass matrix.
    pub tolerance: S,
}

/// Sizes of the buffers of the noslip solver.
#[derive(Clone, Copy, Debug)]
pub struct SlipCapacity {
    /// Largest number of scalar rows.
    pub rows: usize,
    /// Largest number of contacts.
    pub contacts: usize,
    /// Largest number of degrees of freedom of all kinematic trees that one row or contact couples, in all lanes together.
    pub columns_per_contact: usize,
    /// Whether any contact may have rolling friction, and therefore six rows.
    pub rolls: bool,
}

/// Contact that a sweep of the noslip solver visits in some lanes.
#[derive(Clone, Copy, Debug)]
pub struct ContactVisit<M> {
    /// Whether the contact has six rows, because it has rolling friction.
    pub rolling: bool,
    /// Index of the contact in the list of contacts with three rows, or with six.
    pub index: usize,
    /// Lanes in which the sweep visits the contact.
    pub lanes: M,
}

/// Normal force below which a contact has no friction forces, N.
const LEAST_FORCE: f64 = 1e-15;
/// Smallest diagonal entry of A = J M^-1 J^T, 1/kg: for dry friction, and for a tangential row of a contact. Smaller entries are replaced
/// by this value.
const LEAST_INVERSE_INERTIA: [f64; 2] = [1e-15, 1e-10];
/// Largest number of Newton steps for the multiplier of an elliptic contact.
const MULTIPLIER_STEPS: u32 = 20;
/// Tolerance of the multiplier of an elliptic contact. Newton's method stops when the squared force exceeds its bound by less than this,
/// N^2, or when a step of the multiplier, 1/kg, is smaller.
const MULTIPLIER_TOLERANCE: f64 = 1e-10;
/// Increase of the noslip objective, J, above which the update of a contact's friction is reverted. The rounding error of the objective is
/// added to this threshold.
const LEAST_RISE: f64 = 1e-10;
/// Relative size of rounding errors, in units of the last place. A change of the objective or a pivot below it counts as rounding error.
const ROUNDING: f64 = 16.0;

/// Forces of all items of one type (scalar rows, or contacts with `N` rows), and the response of the acceleration to a unit force in each
/// friction row.
#[derive(Clone, Debug)]
pub(super) struct Friction<R: Real, const N: usize> {
    /// Forces of each item (a scalar row or a contact), N or N m.
    pub(super) force: Vec<[R; N]>,
    /// Bound on each friction force. For an elliptic contact it is the normal force. For a pyramid it is the sum of the forces of the two
    /// edges, which must still be multiplied by the friction coefficient.
    bound: Vec<[R; N]>,
    /// Range of each item (a scalar row or a contact) in `dofs` and `response`.
    spans: Vec<Range<usize>>,
    /// Degrees of freedom that the forces of each item (a scalar row or a contact) accelerate.
    dofs: Vec<u32>,
    /// Accelerations of the degrees of freedom in `dofs` by a unit force in each row of an item (a scalar row or a contact).
    response: Vec<[R; N]>,
    /// Block of A = J M^-1 J^T for the friction rows of each item (a scalar row or a contact), 1/kg.
    inertia: Vec<[[R; N]; N]>,
}

impl<R: Real, const N: usize> Friction<R, N> {
    /// Empty lists with memory for `items` scalar rows or contacts, each with `columns` degrees of freedom.
    fn with_capacity(items: usize, columns: usize) -> Self {
        let entries = items * columns;
        Self {
            force: Vec::with_capacity(items),
            bound: Vec::with_capacity(items),
            spans: Vec::with_capacity(items),
            dofs: Vec::with_capacity(entries),
            response: Vec::with_capacity(entries),
            inertia: Vec::with_capacity(items),
        }
    }

    /// Removes all scalar rows or contacts from the lists.
    fn clear(&mut self) {
        self.force.clear();
        self.bound.clear();
        self.spans.clear();
        self.dofs.clear();
        self.response.clear();
        self.inertia.clear();
    }

    /// Appends the responses of the acceleration to unit forces in the rows `rows` of a scalar row or contact. Its Jacobian has the entries
    /// `jacobian` at the coordinates `columns`.
    ///
    /// `respond` replaces a generalized force by the acceleration that it causes. `trees` is the kinematic tree of each degree of freedom,
    /// `work` a buffer. Smaller diagonal entries of J M^-1 J^T are replaced by `least`.
    #[inline(always)]
    fn push_responses(
        &mut self,
        respond: &mut impl FnMut(&mut [R]),
        trees: &[u32],
        (columns, jacobian): (&[u32], &[[R; N]]),
        rows: Range<usize>,
        work: &mut [R],
        least: f64,
    ) {
        let start = self.dofs.len();
        for (d, tree) in trees.iter().enumerate() {
            if columns.iter().any(|&s| trees[s as usize] == *tree) {
                self.dofs.push(d as u32);
                self.response.push([R::zero(); N]);
            }
        }
        let mut inertia = [[R::zero(); N]; N];
        for k in rows {
            work.fill(R::zero());
            for (&d, j) in columns.iter().zip(jacobian) {
                work[d as usize] = j[k];
            }
            respond(work);
            for (&d, response) in self.dofs[start..].iter().zip(&mut self.response[start..]) {
                response[k] = work[d as usize];
            }
            for (i, row) in inertia.iter_mut().enumerate() {
                let mut sum = R::zero();
                for (&d, j) in columns.iter().zip(jacobian) {
                    sum += j[i] * work[d as usize];
                }
                row[k] = if i == k { sum.max(R::of(least)) } else { sum };
            }
        }
        self.spans.push(start..self.dofs.len());
        self.inertia.push(inertia);
    }

    /// Updates the acceleration `a` after a change of the forces of scalar row or contact `i`. `change` is the change of its forces.
    #[inline(always)]
    fn accelerate(&self, i: usize, change: &[R; N], a: &mut [R]) {
        let span = self.spans[i].clone();
        add_transposed(&self.dofs[span.clone()], &self.response[span], *change, a);
    }
}

/// Noslip solver, with its workspace.
#[derive(Clone, Debug)]
pub(super) struct NoSlip<R: Real> {
    /// Forces and responses of the scalar rows.
    pub(super) rows: Friction<R, 1>,
    /// Forces and responses of the contacts with three rows.
    pub(super) contacts: Friction<R, 3>,
    /// Forces and responses of the contacts with six rows.
    pub(super) rolling: Friction<R, 6>,
    /// Kinematic tree of each degree of freedom.
    trees: Vec<u32>,
    /// Number of kinematic trees.
    count: usize,
    /// Parent of each kinematic tree in each lane, in a union-find forest. The trees of an island (set of coupled trees) have the same
    /// root: the tree of the island with the smallest number.
    parents: Vec<u32>,
    /// Improvement of the objective of each island (set of coupled trees) by the current sweep, J.
    improvement: Vec<R>,
    /// Lanes in which each island (set of coupled trees) continues to sweep, as bits.
    running: Vec<u32>,
    /// Two lists of sums of the mass matrix's diagonal: over each kinematic tree, and over each island, at the index of the island's
    /// smallest tree.
    inertia: [Vec<R>; 2],
    /// Island of each scalar row, contact with three rows and contact with six rows, in each lane. The lanes of one row or contact are
    /// consecutive.
    islands: Vec<u32>,
    /// Buffer for an acceleration.
    work: Vec<R>,
}

impl<R: Real> NoSlip<R> {
    /// Workspace for problems with `dimension` degrees of freedom.
    pub(super) fn new(dimension: usize, capacity: SlipCapacity) -> Self {
        let SlipCapacity { rows, contacts, columns_per_contact, rolls } = capacity;
        let rolling = if rolls { contacts } else { 0 };
        Self {
            rows: Friction::with_capacity(rows, dimension.min(columns_per_contact)),
            contacts: Friction::with_capacity(contacts, columns_per_contact),
            rolling: Friction::with_capacity(rolling, columns_per_contact),
            trees: vec![0; dimension],
            count: 0,
            parents: vec![0; dimension * R::LANES],
            improvement: vec![R::zero(); dimension],
            running: vec![0; dimension],
            inertia: [vec![R::zero(); dimension], vec![R::zero(); dimension]],
            islands: Vec::with_capacity((rows + contacts + rolling) * R::LANES),
            work: vec![R::zero(); dimension],
        }
    }

    /// Stores the forces of all rows at a solution, at which their relative accelerations are `argument`.
    pub(super) fn begin(&mut self, problem: &SoftProblem<R>, metric: &impl Metric<R>, argument: &Argument<R>) {
        self.find_trees(metric);
        let Self { rows, contacts, rolling, .. } = self;
        kernel!(R, || {
            rows.clear();
            for (row, &u) in problem.rows.iter().zip(&argument.rows) {
                rows.force.push([row.force(u)]);
            }
            contacts.begin(problem.cone, &problem.contacts, &argument.contacts);
            rolling.begin(problem.cone, &problem.rolling_contacts, &argument.rolling_contacts);
        });
        self.find_islands(problem);
    }

    /// Finds the kinematic tree of each degree of freedom.
    fn find_trees(&mut self, metric: &impl Metric<R>) {
        self.count = 0;
        self.inertia[0].fill(R::zero());
        for i in 0..self.trees.len() {
            self.trees[i] = match *metric.row(i).0 {
                [_, .., root] => self.trees[root as usize],
                _ => {
                    self.count += 1;
                    self.count as u32 - 1
                }
            };
            self.inertia[0][self.trees[i] as usize] += metric.row(i).1[0];
        }
    }

    /// Finds the islands of each lane: sets of kinematic trees that rows couple, directly or through other trees.
    fn find_islands(&mut self, problem: &SoftProblem<R>) {
        let Self { trees, count, parents, islands, running, inertia, .. } = self;
        islands.clear();
        for l in 0..R::LANES {
            for tree in 0..*count {
                parents[tree * R::LANES + l] = tree as u32;
            }
        }
        let zero = <R::Scalar as Default>::default();
        for row in &problem.rows {
            let (columns, jacobian) = problem.entries(row);
            unite::<R>(trees, parents, islands, columns, |e, l| jacobian[e].lane(l) != zero);
        }
        for contact in &problem.contacts.items {
            let (columns, jacobian) = problem.contacts.entries(contact);
            unite::<R>(trees, parents, islands, columns, |e, l| jacobian[e].iter().any(|j| j.lane(l) != zero));
        }
        for contact in &problem.rolling_contacts.items {
            let (columns, jacobian) = problem.rolling_contacts.entries(contact);
            unite::<R>(trees, parents, islands, columns, |e, l| jacobian[e].iter().any(|j| j.lane(l) != zero));
        }
        let [of_trees, of_islands] = inertia;
        of_islands.fill(R::zero());
        for tree in 0..*count {
            for l in 0..R::LANES {
                let sum = &mut of_islands[find::<R>(parents, tree as u32, l) as usize];
                sum.set_lane(l, sum.lane(l) + of_trees[tree].lane(l));
            }
        }
        running.fill(0);
        for (at, island) in islands.iter_mut().enumerate() {
            let l = at % R::LANES;
            if *island == NO_TREE {
                *island = 0;
            } else {
                *island = find::<R>(parents, *island, l);
                running[*island as usize] |= 1 << l;
            }
        }
    }

    /// Sweeps in the lanes `lanes` until all islands have stopped. `a` is the acceleration by the current forces; the function updates it.
    ///
    /// `visits` are the contacts in the order in which each sweep visits them. Returns the number of sweeps of each lane.
    pub(super) fn sweep(
        &mut self,
        problem: &SoftProblem<R>,
        visits: &[ContactVisit<R::Mask>],
        effort: SlipEffort<R::Scalar>,
        lanes: R::Mask,
        a: &mut [R],
    ) -> R {
        self.running.iter_mut().for_each(|running| *running &= lanes.bits());
        self.improvement[..self.count].fill(R::zero());
        let mut sweeps = R::zero();
        kernel!(R, || self.add_regularisation(problem));
        for _ in 0..effort.sweeps {
            let any = self.running[..self.count].iter().fold(0, |all, &bits| all | bits);
            if any == 0 {
                break;
            }
            kernel!(R, || {
                sweeps += R::select(R::Mask::from_bits(any), R::one(), R::zero());
                self.visit_rows(problem, a);
                self.visit_contacts(problem, visits, a);
            });
            kernel!(R, || {
                let tolerance = R::splat(effort.tolerance);
                let Self { running, improvement, inertia, count, .. } = self;
                for ((running, improvement), &inertia) in running[..*count].iter_mut().zip(improvement).zip(&inertia[1]) {
                    // A NaN improvement ends the island.
                    *running &= improvement.ge(tolerance * inertia).bits();
                    *improvement = R::zero();
                }
            });
        }
        sweeps
    }

    /// Computes the response of the acceleration to a unit force in each friction row. It is called once, before [`NoSlip::sweep`].
    /// `respond` replaces a force by the acceleration that it causes.
    #[inline(always)]
    pub(super) fn find_responses(&mut self, problem: &SoftProblem<R>, mut respond: impl FnMut(&mut [R])) {
        let Self { rows, contacts, rolling, trees, work, .. } = self;
        for row in &problem.rows {
            let (columns, jacobian) = problem.entries(row);
            if is_dry_friction(row.bounds) {
                let least = LEAST_INVERSE_INERTIA[0];
                rows.push_responses(&mut respond, trees, (columns, jacobian.as_chunks().0), 0..1, work, least);
            } else {
                rows.spans.push(0..0);
                rows.inertia.push([[R::zero()]]);
            }
        }
        for contact in &problem.contacts.items {
            contacts.push_responses(&mut respond, trees, problem.contacts.entries(contact), 1..3, work, LEAST_INVERSE_INERTIA[1]);
        }
        for contact in &problem.rolling_contacts.items {
            rolling.push_responses(&mut respond, trees, problem.rolling_contacts.entries(contact), 1..6, work, LEAST_INVERSE_INERTIA[1]);
        }
    }

    /// Adds the regularisation energy of all rows to the improvement of the objective by the first sweep, as MuJoCo does. This energy is
    /// not part of the noslip solver's objective.
    #[inline(always)]
    fn add_regularisation(&mut self, problem: &SoftProblem<R>) {
        let half = R::of(0.5);
        for (i, row) in problem.rows.iter().enumerate() {
            let force = self.rows.force[i][0];
            self.add_improvement(i, half * force * force * inverse(row.weight));
        }
        let [first, sliding] = [problem.rows.len(), problem.rows.len() + problem.contacts.items.len()];
        for (i, contact) in problem.contacts.items.iter().enumerate() {
            let energy = regularisation(problem.cone, contact, &self.contacts.force[i], &self.contacts.bound[i]);
            self.add_improvement(first + i, half * energy);
        }
        for (i, contact) in problem.rolling_contacts.items.iter().enumerate() {
            let energy = regularisation(problem.cone, contact, &self.rolling.force[i], &self.rolling.bound[i]);
            self.add_improvement(sliding + i, half * energy);
        }
    }

    /// Adds `by`, J, to the improvement of the objective of an island. In each lane it is the island that contains the scalar row or
    /// contact with the index `item`.
    #[inline(always)]
    fn add_improvement(&mut self, item: usize, by: R) {
        let islands = &self.islands[item * R::LANES..][..R::LANES];
        if islands.iter().all(|&island| island == islands[0]) {
            self.improvement[islands[0] as usize] += by;
            return;
        }
        for (l, &island) in islands.iter().enumerate() {
            let sum = &mut self.improvement[island as usize];
            sum.set_lane(l, sum.lane(l) + by.lane(l));
        }
    }

    /// Lanes in which the island of the scalar row or contact with the index `item` continues to sweep.
    #[inline(always)]
    fn running_lanes(&self, item: usize) -> R::Mask {
        let islands = &self.islands[item * R::LANES..][..R::LANES];
        if islands.iter().all(|&island| island == islands[0]) {
            return R::Mask::from_bits(self.running[islands[0] as usize]);
        }
        R::Mask::from_bits(islands.iter().enumerate().fold(0, |bits, (l, &island)| bits | (self.running[island as usize] & 1 << l)))
    }

    /// Updates the forces of all dry-friction rows, one after the other.
    #[inline(always)]
    fn visit_rows(&mut self, problem: &SoftProblem<R>, a: &mut [R]) {
        for (i, row) in problem.rows.iter().enumerate() {
            if !is_dry_friction(row.bounds) {
                continue;
            }
            let lanes = self.running_lanes(i).and(row.weight.gt(R::zero()));
            if lanes.none() {
                continue;
            }
            let (columns, jacobian) = problem.entries(row);
            let increase = self.rows.visit_row((columns, jacobian.as_chunks().0), [i, 0], row.reference, row.bounds, lanes, a);
            self.add_improvement(i, -increase);
        }
    }

    /// Updates the friction forces of all contacts, one after the other.
    #[inline(always)]
    fn visit_contacts(&mut self, problem: &SoftProblem<R>, visits: &[ContactVisit<R::Mask>], a: &mut [R]) {
        for visit in visits {
            let before = if visit.rolling { problem.contacts.items.len() } else { 0 };
            let item = problem.rows.len() + before + visit.index;
            let lanes = self.running_lanes(item).and(visit.lanes);
            if lanes.none() {
                continue;
            }
            let improvement = if visit.rolling {
                self.rolling.visit(problem.cone, &problem.rolling_contacts, visit.index, lanes, a)
            } else {
                self.contacts.visit(problem.cone, &problem.contacts, visit.index, lanes, a)
            };
            self.add_improvement(item, improvement);
        }
    }

    /// Writes the generalized forces of all rows to `out`, N or N m.
    #[inline(always)]
    pub(super) fn add_forces(&self, problem: &SoftProblem<R>, out: &mut [R]) {
        out.fill(R::zero());
        for (row, force) in problem.rows.iter().zip(&self.rows.force) {
            let (columns, jacobian) = problem.entries(row);
            add_transposed(columns, jacobian.as_chunks().0, *force, out);
        }
        problem.contacts.add(&self.contacts.force, out);
        problem.rolling_contacts.add(&self.rolling.force, out);
    }
}

impl<R: Real, const N: usize> Friction<R, N> {
    /// Stores the forces of all contacts with `N` rows, from their relative accelerations `argument`.
    #[inline(always)]
    fn begin(&mut self, cone: Cone, contacts: &SoftContacts<R, N>, argument: &[[R; N]]) {
        self.clear();
        for (contact, u) in contacts.items.iter().zip(argument) {
            let force = cone.force(contact, u);
            self.force.push(force);
            self.bound.push(match cone {
                Cone::Elliptic => [force[0]; N],
                Cone::Pyramidal => cone.edges(contact, u),
            });
        }
    }

    /// Updates the friction forces of contact `i` in the lanes `lanes`, and the acceleration `a`. Returns the decrease of the objective, J.
    #[inline(always)]
    fn visit(&mut self, cone: Cone, contacts: &SoftContacts<R, N>, i: usize, lanes: R::Mask, a: &mut [R]) -> R {
        let contact = &contacts.items[i];
        let entries = contacts.entries(contact);
        match cone {
            Cone::Pyramidal => self.visit_pyramid(contact, entries, i, lanes, a),
            Cone::Elliptic => self.visit_ellipse(contact, entries, i, lanes, a),
        }
    }

    /// Updates the force of row `k` of item `i` (a scalar row or a contact) within the bounds `least` and `most`, and the acceleration `a`.
    /// Returns the increase of the objective, J.
    #[inline(always)]
    fn visit_row(
        &mut self,
        (columns, jacobian): (&[u32], &[[R; N]]),
        [i, k]: [usize; 2],
        reference: R,
        [least, most]: [R; 2],
        lanes: R::Mask,
        a: &mut [R],
    ) -> R {
        let mut slip = -reference;
        for (&d, j) in columns.iter().zip(jacobian) {
            slip += j[k] * a[d as usize];
        }
        let (inertia, force) = (self.inertia[i][k][k], self.force[i][k]);
        let next = (force - slip / inertia).max(least).min(most);
        let mut change = [R::zero(); N];
        change[k] = R::select(lanes, next - force, R::zero());
        self.force[i][k] = R::select(lanes, next, force);
        self.accelerate(i, &change, a);
        R::of(0.5) * change[k] * change[k] * inertia + change[k] * slip
    }

    /// Updates the friction forces of contact `i` with a pyramidal cone, and the acceleration `a`. Returns the decrease of the objective,
    /// J.
    #[inline(always)]
    fn visit_pyramid(&mut self, contact: &SoftContact<R, N>, entries: (&[u32], &[[R; N]]), i: usize, lanes: R::Mask, a: &mut [R]) -> R {
        let mut improvement = R::zero();
        for k in 1..N {
            let mu = contact.scale[k];
            let lanes = lanes.and(mu.gt(R::zero())).and(contact.weight[k].gt(R::zero()));
            if lanes.none() {
                continue;
            }
            // The sum of the two edges is constant. Each of them therefore moves by half of the change of their difference.
            let moves = (R::of(4.0) * mu * mu * self.inertia[i][k][k]).ge(R::of(LEAST_FORCE));
            let most = R::select(moves, self.bound[i][k] * mu, R::zero());
            improvement -= self.visit_row(entries, [i, k], contact.reference[k], [-most, most], lanes, a);
        }
        improvement
    }

    /// Updates the friction forces of contact `i` with an elliptic cone, and the acceleration `a`. Returns the decrease of the objective,
    /// J.
    #[inline(always)]
    fn visit_ellipse(
        &mut self,
        contact: &SoftContact<R, N>,
        (columns, jacobian): (&[u32], &[[R; N]]),
        i: usize,
        lanes: R::Mask,
        a: &mut [R],
    ) -> R {
        let (inertia, force, normal) = (&self.inertia[i], self.force[i], self.bound[i][0]);
        let mut slip = [R::zero(); N];
        for (&d, j) in columns.iter().zip(jacobian) {
            for k in 1..N {
                slip[k] += j[k] * a[d as usize];
            }
        }
        // The problem is scaled to the space in which the ellipse is a circle. The normal row, and rows that a lane lacks, remain zero.
        let (mut matrix, mut linear) = ([[R::zero(); N]; N], [R::zero(); N]);
        matrix[0][0] = R::one();
        for k in 1..N {
            let exists = contact.weight[k].gt(R::zero());
            slip[k] = R::select(exists, slip[k] - contact.reference[k], R::zero());
            let mut rest = slip[k];
            for m in 1..N {
                rest -= inertia[k][m] * force[m];
                matrix[k][m] = inertia[k][m] * contact.scale[k] * contact.scale[m];
            }
            linear[k] = R::select(exists, rest * contact.scale[k], R::zero());
            matrix[k][k] = R::select(exists, matrix[k][k], R::one());
        }
        let presses = normal.ge(R::of(LEAST_FORCE));
        let rolls = R::Mask::splat(N == 6).and(contact.weight[N - 1].gt(R::zero()));
        let mut next = minimise_in_ball(&matrix, &linear, normal, lanes.and(presses), rolls);
        let (mut change, mut quadratic, mut first) = ([R::zero(); N], R::zero(), R::zero());
        for k in 1..N {
            next[k] = R::select(presses, next[k] * contact.scale[k], R::zero());
            change[k] = R::select(lanes.and(contact.weight[k].gt(R::zero())), next[k] - force[k], R::zero());
            first += change[k] * slip[k];
        }
        for k in 1..N {
            let mut sum = R::zero();
            for m in 1..N {
                sum += inertia[k][m] * change[m];
            }
            quadratic += change[k] * sum;
        }
        let quadratic = R::of(0.5) * quadratic;
        let epsilon = <R::Scalar as Scalar>::EPSILON.to_f64();
        let least = R::of(LEAST_RISE) + R::of(ROUNDING * epsilon) * (quadratic.abs() + first.abs());
        let falls = (quadratic + first).le(least);
        for k in 1..N {
            change[k] = R::select(falls, change[k], R::zero());
            self.force[i][k] = R::select(lanes.and(falls).and(contact.weight[k].gt(R::zero())), next[k], force[k]);
        }
        self.accelerate(i, &change, a);
        R::select(falls, -(quadratic + first), R::zero())
    }
}

/// Minimiser of 1/2 x^T A x + b^T x in the ball |x| <= r, in the lanes `lanes`. `rolls` are the lanes in which the contact has rolling
/// friction.
///
/// Newton's method searches the multiplier l, starting from 0. The equation `|(A + l)^-1 b|^2 = r^2` is convex in l, so that l increases to
/// the solution. A result outside the ball is scaled to its surface. If A is singular (see [`is_regular`]) the result is 0, as in MuJoCo.
#[inline(always)]
fn minimise_in_ball<R: Real, const N: usize>(matrix: &[[R; N]; N], b: &[R; N], r: R, lanes: R::Mask, rolls: R::Mask) -> [R; N] {
    let regular = is_regular(matrix, rolls);
    let lanes = lanes.and(regular);
    let (mut multiplier, mut x, mut square) = (R::zero(), [R::zero(); N], R::zero());
    let (mut running, enough, ball) = (lanes, R::of(MULTIPLIER_TOLERANCE), r * r);
    for _ in 0..MULTIPLIER_STEPS {
        let factors = factor(matrix, multiplier);
        x = substitute(&factors, b);
        square = R::zero();
        for x in &mut x {
            *x = -*x;
            square += *x * *x;
        }
        let excess = square - ball;
        running = running.and(excess.ge(enough));
        if running.none() {
            break;
        }
        let slope = substitute(&factors, &x);
        let mut rate = R::zero();
        for k in 0..N {
            rate += x[k] * slope[k];
        }
        let step = excess / (rate + rate);
        running = running.and(step.ge(enough));
        if running.none() {
            break;
        }
        multiplier += R::select(running, step, R::zero());
    }
    let bound = multiplier.gt(R::zero()).or((square - ball).ge(enough));
    let scale = R::select(bound, (ball / square.max(R::of(LEAST_FORCE))).sqrt(), R::one());
    for x in &mut x {
        *x = R::select(regular, *x * scale, R::zero());
    }
    x
}

/// Lanes in which the matrix can be inverted: its determinant is at least [`LEAST_DETERMINANT`]. In the lanes `rolls`, in which the contact
/// has rolling friction, the smallest pivot of the factors must be at least this number instead. No pivot may be rounding error.
#[inline(always)]
fn is_regular<R: Real, const N: usize>(matrix: &[[R; N]; N], rolls: R::Mask) -> R::Mask {
    let factors = factor(matrix, R::zero());
    let least = R::of(LEAST_DETERMINANT);
    let rounding = R::of(ROUNDING * <R::Scalar as Scalar>::EPSILON.to_f64());
    let (mut determinant, mut smallest, mut sound) = (R::one(), R::of(f64::INFINITY), R::Mask::splat(true));
    for k in 0..N {
        let pivot = R::one() / factors[k][k];
        determinant *= pivot;
        smallest = smallest.min(pivot);
        sound = sound.and(pivot.gt(rounding * matrix[k][k]));
    }
    sound.and(R::select(rolls, smallest, determinant).ge(least))
}

/// Factors L D L^T of A + l I, where A is `matrix`: L is below the diagonal, 1 / D on it.
#[inline(always)]
fn factor<R: Real, const N: usize>(matrix: &[[R; N]; N], l: R) -> [[R; N]; N] {
    let mut factors = [[R::zero(); N]; N];
    for i in 0..N {
        for j in 0..=i {
            let mut sum = if i == j { matrix[i][i] + l } else { matrix[i][j] };
            for k in 0..j {
                // Product L_ik D_k L_jk, with L_ik D_k stored above the diagonal.
                sum -= factors[k][i] * factors[j][k];
            }
            if i == j {
                factors[i][i] = R::one() / sum.max(R::of(LEAST_PIVOT));
            } else {
                factors[j][i] = sum;
                factors[i][j] = sum * factors[j][j];
            }
        }
    }
    factors
}

/// Smallest pivot in the factors of a contact's matrix, so that its inverse is finite.
const LEAST_PIVOT: f64 = 1e-30;
/// Smallest determinant, or pivot, of a contact's matrix that counts as regular.
const LEAST_DETERMINANT: f64 = 1e-10;

/// Solution (A + l I)^-1 b, from the factors of A + l I.
#[inline(always)]
fn substitute<R: Real, const N: usize>(factors: &[[R; N]; N], b: &[R; N]) -> [R; N] {
    let mut x = *b;
    for i in 0..N {
        for k in 0..i {
            let before = x[k];
            x[i] -= factors[i][k] * before;
        }
    }
    for i in (0..N).rev() {
        x[i] *= factors[i][i];
        for k in i + 1..N {
            let after = x[k];
            x[i] -= factors[k][i] * after;
        }
    }
    x
}

/// Sum of R f^2 over the rows of an elliptic contact, or over the edges of a pyramid. Here f is the force of a row or edge, and R its
/// regularisation. `edges` has the sum of the forces of opposite edges, for each friction row of a pyramid.
#[inline(always)]
fn regularisation<R: Real, const N: usize>(cone: Cone, contact: &SoftContact<R, N>, force: &[R; N], edges: &[R; N]) -> R {
    let mut energy = R::zero();
    match cone {
        Cone::Elliptic => {
            for k in 0..N {
                energy += force[k] * force[k] * inverse(contact.weight[k]);
            }
        }
        Cone::Pyramidal => {
            for k in 1..N {
                let difference = force[k] * inverse(contact.scale[k]);
                let squares = (edges[k] * edges[k] + difference * difference) * R::of(0.5);
                energy += squares * inverse(contact.weight[k]);
            }
        }
    }
    energy
}

/// Inverse 1 / x; 0 if x is not positive.
#[inline(always)]
fn inverse<R: Real>(x: R) -> R {
    let positive = x.gt(R::zero());
    R::select(positive, R::one() / R::select(positive, x, R::one()), R::zero())
}

/// Whether a row with these bounds on its force is dry friction, the only type with two finite bounds.
#[inline(always)]
fn is_dry_friction<R: Real>(bounds: [R; 2]) -> bool {
    bounds[0].gt(R::of(f64::NEG_INFINITY)).and(bounds[1].lt(R::of(f64::INFINITY))).any()
}

/// Placeholder for the tree of a row or contact in a lane that does not have it.
const NO_TREE: u32 = u32::MAX;

/// Merges the kinematic trees that a scalar row or contact couples into one island, in each lane. For each lane, appends the number of one
/// of these trees to `islands`, or [`NO_TREE`] if the lane does not have the row or contact.
///
/// `is_there` returns whether the row or contact has a given entry in a given lane.
fn unite<R: Real>(trees: &[u32], parents: &mut [u32], islands: &mut Vec<u32>, columns: &[u32], is_there: impl Fn(usize, usize) -> bool) {
    for l in 0..R::LANES {
        let mut island = None;
        let mut last = u32::MAX;
        for (e, &d) in columns.iter().enumerate() {
            let tree = trees[d as usize];
            if tree == last || !is_there(e, l) {
                continue;
            }
            last = tree;
            let root = find::<R>(parents, tree, l);
            island = Some(match island {
                None => root,
                Some(other) => {
                    let (low, high) = (root.min(other), root.max(other));
                    parents[high as usize * R::LANES + l] = low;
                    low
                }
            });
        }
        islands.push(island.unwrap_or(NO_TREE));
    }
}

/// Number of the smallest tree of the island that contains the tree `tree`, in lane `l`.
fn find<R: Real>(parents: &[u32], mut tree: u32, l: usize) -> u32 {
    while parents[tree as usize * R::LANES + l] != tree {
        tree = parents[tree as usize * R::LANES + l];
    }
    tree
}
