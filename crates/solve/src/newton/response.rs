//! Derivative of the impulses of a solved problem with respect to its rows, while no constraint switches its mode (open, sticking,
//! slipping, at a bound). It follows from the implicit function theorem, lane by lane in scalar f64.
//!
//! The impulses are a fixed point of Alart and Curnier's map P, with v = G lambda + g:
//!
//! ```text
//! lambda - P(lambda - rho v) = 0
//! (I - DP + rho DP G) dlambda = -rho DP dv
//! ```
//!
//! Here dv is the change of the rows' velocities at constant impulses, due to changes of the free velocity, the targets or the Jacobians.
//! The matrix is computed once. The change of the impulses is then a matrix-vector product (Le Lidec et al. 2024).

use std::ops::Range;

use crate::admissible_set::{AdmissibleSet, Mode};
use crate::constraints::constraint_set::number_of;
use crate::constraints::friction::MAX_CONTACT_ROWS;
use crate::iterate::Iterate;
use crate::newton::lane::{Lane, LaneBlock};
use crate::problem::System;
use crate::vectors::{TILE, add_multiple_of_tiles, inner, inner_of_tiles, norm, with_row_count};
use stepper_real::{Mask, Real, Scalar, kernel};

/// Ratio of a pivot to the largest one below which a row depends linearly on the previous rows. Independent rows of a robot have far larger
/// pivots.
const DEPENDENT: f64 = 1e-10;

/// Ratio of two motions below which a set of impulses counts as causing no motion. It is the motion by the set, divided by that of an
/// equally large impulse in one row.
const NO_MOTION: f64 = 1e-7;

/// Ratio of the smaller to the larger compliance of a row in two problems, below which the row is damped in only one of the problems.
/// Without damping the compliance is 0; damping is at least a thousandth of the mobility.
const SAME_COMPLIANCE: f64 = 0.5;

/// One number for each row of a constraint.
type Rows = [f64; MAX_CONTACT_ROWS];

/// Mode change of a constraint, at which the impulses have a kink.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switch {
    /// A contact opens or closes.
    Contact,
    /// A contact begins or ceases to slip.
    Slip,
    /// The impulse of a row with one bound (such as a joint limit) reaches or leaves the bound.
    Limit,
    /// The impulse of a row with two bounds (dry friction) reaches or leaves a bound.
    DryFriction,
    /// A row of the position solve begins or ceases to correct a position error, and therefore to be damped.
    Gap,
}

/// Distance of a constraint from its next mode change, under a change of the problem.
#[derive(Clone, Copy, Debug)]
pub struct SwitchDistance {
    /// Lane that contains the constraint.
    pub lane: usize,
    /// Next mode change of the constraint, which a continued change of the problem would cause.
    pub switch: Switch,
    /// Distance to the mode change as a multiple of the change of the problem. It is at most 1 if the mode has changed. Constraints that
    /// the change moves away from a mode change are not reported.
    pub distance: f64,
}

/// Derivative of the impulses of all lanes of a group with respect to the rows of their problem.
#[derive(Clone, Debug)]
pub struct Response<R: Real> {
    /// Derivative of the impulses of each lane.
    lanes: Vec<LaneResponse>,
    /// Number of eliminated equality rows, which are solved exactly each time.
    eliminated: usize,
    /// Impulses of all rows, scalar rows first, N s.
    impulses: Vec<R>,
    /// Velocities of all rows, m/s.
    velocities: Vec<R>,
    /// Buffer for the rows of one lane.
    lane: Lane,
    /// Buffer for the linear system of one lane.
    system: Linear,
}

/// Solution of one lane, and the derivative of its impulses with respect to the rows' velocities while no constraint changes its mode.
#[derive(Clone, Debug, Default)]
struct LaneResponse {
    /// Constraints of the lane.
    blocks: Vec<Block>,
    /// Impulses of all rows at the solution, N s.
    lambda: Vec<f64>,
    /// Velocities of all rows at the solution, m/s.
    velocity: Vec<f64>,
    /// Indices of the rows whose impulses change with the velocities: those of contacts that stick or slip, and of rows inside their
    /// bounds.
    active: Vec<usize>,
    /// Derivative of the active rows' impulses with respect to their velocities, kg: row by row, each padded to a multiple of four.
    matrix: Vec<f64>,
    /// Sets of impulses that change no velocity, one set after the other, with a number for each active row. The equations do not determine
    /// such impulses.
    undetermined: Vec<f64>,
    /// For each stored constraint, its place in the current problem; `None` if the current problem does not have the constraint.
    found: Vec<Option<Found>>,
    /// Changes of the velocities of the active rows, m/s.
    change: Vec<f64>,
}

/// Stored constraint in the current problem.
#[derive(Clone, Copy, Debug)]
struct Found {
    /// Index of the constraint's first row among the rows of all lanes, which counts the scalar rows first.
    first: usize,
    /// Compliance of each row in a position solve, 1/kg. For a velocity solve it is that of the stored constraint.
    compliance: f64,
}

/// Rows of one constraint of a lane, at the solution.
#[derive(Clone, Debug)]
struct Block {
    /// Set of the constraint's admissible impulses.
    set: AdmissibleSet,
    /// Mode of the constraint (open, sticking, slipping, at a bound).
    mode: Mode,
    /// Distance of the map's argument from the region of the next mode, N s, see [`AdmissibleSet::margin`].
    margin: f64,
    /// Index of the constraint in the problem of all lanes, which counts the scalar rows first, then the contacts.
    source: usize,
    /// Number that identifies the constraint, the same in similar problems.
    name: u64,
    /// Range of the constraint's rows in the lists of the lane.
    rows: Range<usize>,
    /// Step rho of the constraint's natural map lambda - P_K(lambda - rho u), kg. Here lambda is the impulse, u the velocity, and P_K the
    /// projection on the admissible impulses. The map is zero at the solution.
    rho: f64,
    /// Compliance that each row of the constraint has, 1/kg. The normal row of a contact may have more, which is not included.
    compliance: f64,
}

impl Block {
    /// Whether the constraint is a contact. The names of contacts and of scalar rows may be equal.
    fn is_contact(&self) -> bool {
        matches!(self.set, AdmissibleSet::Cone { .. })
    }

    /// Whether exactly one of two constraints is damped: this one, and one with the compliance `compliance`, 1/kg.
    fn switches_damping(&self, compliance: f64) -> bool {
        self.compliance.min(compliance) < SAME_COMPLIANCE * self.compliance.max(compliance)
    }
}

/// Linear system for the derivative of one lane, with its workspace.
#[derive(Clone, Debug, Default)]
struct Linear {
    /// Rows of the scaled Jacobian of all constraints that are neither open nor at a bound, over all coordinates.
    dense: Vec<f64>,
    /// Delassus matrix of the rows in `dense`, 1/kg.
    delassus: Vec<f64>,
    /// Derivative of the map of one constraint, times a matrix.
    product: Vec<f64>,
    /// Matrix on the left side of the linear equations, which multiplies the change of the impulses.
    left: Vec<f64>,
    /// Matrix on the right side of the linear equations, which multiplies the change of the velocities.
    right: Vec<f64>,
    /// Order in which the equations were eliminated.
    rows: Vec<usize>,
    /// Order in which the unknowns were eliminated.
    columns: Vec<usize>,
}

impl<R: Real> Default for Response<R> {
    fn default() -> Self {
        Self {
            lanes: vec![LaneResponse::default(); R::LANES],
            eliminated: 0,
            impulses: vec![],
            velocities: vec![],
            lane: Lane::default(),
            system: Linear::default(),
        }
    }
}

impl<R: Real> Response<R> {
    /// Stores the solution of a problem and the derivative of its impulses, in the lanes `lanes` (bits). Returns the lanes in which the
    /// rows determine the motion.
    ///
    /// The rows do not determine the motion if, for example, contacts share loads while they slip about a point. `name` returns a number
    /// that identifies a constraint in other problems. The arguments of `name` are the index of the constraint, which counts the scalar
    /// rows first, and the lane.
    ///
    /// For a position solve, `before` is the response of the velocity solve, at whose impulses damping causes no velocity. The function
    /// also leaves out lanes in which loads that the velocity solve does not determine cause motion in the position solve.
    pub fn settle<'a>(
        &mut self,
        system: impl Into<System<'a, R>>,
        iterate: &Iterate<R>,
        lanes: u32,
        name: impl Fn(usize, usize) -> u64,
        before: Option<&Self>,
    ) -> u32 {
        let rows = system.into();
        self.eliminated = rows.problem.scalars.eliminated;
        self.compute_velocities(rows, iterate);
        let mut sound = lanes;
        for l in (0..R::LANES).filter(|l| lanes >> l & 1 == 1) {
            self.lane.gather(rows, iterate, l);
            let Self { lanes: all, velocities, lane, system, .. } = self;
            let own = &mut all[l];
            own.store_constraints(lane, |source| name(source, l));
            for block in &lane.blocks {
                own.velocity.extend(velocities[block.source_row..][..block.rows.len()].iter().map(|&v| number_of(v, l)));
            }
            own.find_modes();
            let determined = system.solve(lane, own, iterate.w.len());
            if !determined || before.is_some_and(|before| system.moves_with_loads(own, &before.lanes[l])) {
                sound &= !(1 << l);
            }
        }
        sound
    }

    /// Replaces the impulses in the lanes `lanes` (bits) by a first-order solution. The problem must be close to that of the last
    /// [`Response::settle`].
    ///
    /// Returns the lanes (bits) in which a constraint that pushed in the stored problem does not exist in this one. If the number of
    /// eliminated rows differs, these are all lanes. `name` returns the number that identifies a constraint in both problems. The arguments
    /// of `name` are as in [`Response::settle`]. For a position solve, `before` is the response of the velocity solve, for which the
    /// caller called this function first. The function damps the rows that were damped in the stored problem, and no others.
    pub fn respond<'a>(
        &mut self,
        system: impl Into<System<'a, R>>,
        iterate: &mut Iterate<R>,
        lanes: u32,
        name: impl Fn(usize, usize) -> u64,
        before: Option<&Self>,
    ) -> u32 {
        let system = system.into();
        let mut lost = if system.problem.scalars.eliminated == self.eliminated { 0 } else { lanes };
        self.collect_impulses(iterate);
        let (scalars, count) = (iterate.scalars.len(), iterate.scalars.len() + system.problem.contacts.len());
        let row_of = |source: usize| source.checked_sub(scalars).map_or(source, |i| scalars + system.problem.contacts[i].rows().start);
        // Eliminated rows keep their impulses until `write_impulses` solves these rows.
        self.impulses[self.eliminated.min(scalars)..].fill(R::zero());
        for l in (0..R::LANES).filter(|l| lanes >> l & 1 == 1) {
            let Self { lanes: all, impulses, .. } = self;
            let LaneResponse { blocks, lambda, found, .. } = &mut all[l];
            found.clear();
            for block in blocks.iter() {
                let kind = if block.is_contact() { scalars..count } else { 0..scalars };
                let is_it = |source: &usize| name(*source, l) == block.name;
                let source = Some(block.source).filter(|s| kind.contains(s)).filter(is_it);
                let has_rows =
                    |&source: &usize| !block.is_contact() || system.problem.contacts[source - scalars].rows().len() == block.rows.len();
                let source = source.or_else(|| kind.clone().find(is_it)).filter(has_rows);
                found.push(source.map(|source| Found {
                    first: row_of(source),
                    compliance: if before.is_some() { system.lane_constraint(source, l).compliance } else { block.compliance },
                }));
                let own = &lambda[block.rows.clone()];
                match source.map(row_of) {
                    Some(first) => set_lanes(&mut impulses[first..first + block.rows.len()], l, own.iter().copied()),
                    None if own.iter().any(|&x| x != 0.0) => lost |= 1 << l,
                    None => {}
                }
            }
        }
        self.write_impulses(system, iterate);
        self.compute_velocities(system, iterate);
        for l in (0..R::LANES).filter(|l| lanes >> l & 1 == 1) {
            let Self { lanes: all, velocities, impulses, .. } = self;
            if let Some(before) = before {
                all[l].keep_damping(velocities, &before.impulses, l);
            }
            all[l].update_impulses(velocities, impulses, l);
        }
        self.write_impulses(system, iterate);
        lost
    }

    /// Calls `f` for each constraint that the last [`Response::respond`] has brought closer to another mode (open, sticking, slipping, at a
    /// bound), in the lanes `lanes` (bits). `iterate` is the result of that call.
    pub fn compare<'a>(&mut self, system: impl Into<System<'a, R>>, iterate: &Iterate<R>, lanes: u32, mut f: impl FnMut(SwitchDistance)) {
        let system = system.into();
        self.compute_velocities(system, iterate);
        let (mut lambda, mut v) = ([0.0; MAX_CONTACT_ROWS], [0.0; MAX_CONTACT_ROWS]);
        for lane in (0..R::LANES).filter(|l| lanes >> l & 1 == 1) {
            let own = &self.lanes[lane];
            for (block, found) in own.blocks.iter().zip(&own.found) {
                let Some(Found { first, compliance }) = *found else { continue };
                if block.switches_damping(compliance) {
                    f(SwitchDistance { lane, switch: Switch::Gap, distance: 1.0 });
                }
                for i in 0..block.rows.len() {
                    lambda[i] = number_of(self.impulses[first + i], lane);
                    v[i] = number_of(self.velocities[first + i], lane);
                }
                let (lambda, v) = (&lambda[..block.rows.len()], &v[..block.rows.len()]);
                let (margin, slips) = block.set.margin(block.mode, &moved(block, lambda, v)[..block.rows.len()]);
                if margin >= block.margin || margin.is_nan() {
                    continue;
                }
                let switch = match block.set {
                    AdmissibleSet::Cone { .. } if slips => Switch::Slip,
                    AdmissibleSet::Cone { .. } => Switch::Contact,
                    AdmissibleSet::Interval { lo, hi } if lo.is_finite() && hi.is_finite() => Switch::DryFriction,
                    AdmissibleSet::Interval { .. } => Switch::Limit,
                };
                f(SwitchDistance { lane, switch, distance: block.margin / (block.margin - margin) });
            }
        }
    }

    /// Copies the impulses of an iterate into one list, the scalar rows first.
    fn collect_impulses(&mut self, iterate: &Iterate<R>) {
        self.impulses.clone_from(&iterate.scalars);
        self.impulses.extend_from_slice(&iterate.contacts);
    }

    /// Copies the impulses from the list of all rows back to the iterate, and solves the eliminated rows (equalities that
    /// no other row influences).
    fn write_impulses(&self, system: System<'_, R>, iterate: &mut Iterate<R>) {
        let (scalars, contacts) = self.impulses.split_at(iterate.scalars.len());
        iterate.scalars.copy_from_slice(scalars);
        iterate.contacts.copy_from_slice(contacts);
        kernel!(R, || {
            iterate.compute_w(system.problem);
            iterate.solve_eliminated(system, R::Mask::splat(true));
        });
    }

    /// Computes the velocities of all rows at the impulses of an iterate.
    fn compute_velocities(&mut self, system: System<'_, R>, iterate: &Iterate<R>) {
        self.collect_impulses(iterate);
        self.velocities.clear();
        let velocities = &mut self.velocities;
        kernel!(R, || {
            system.problem.scalars.velocities(system.scalars, &iterate.scalars, &iterate.w, velocities);
            system.problem.contacts.velocities(system.contacts, &iterate.contacts, &iterate.w, velocities);
        });
    }
}

/// Replaces the numbers `to` in lane `lane` by the numbers `from`. The other lanes remain.
fn set_lanes<R: Real>(to: &mut [R], lane: usize, from: impl Iterator<Item = f64>) {
    for (to, x) in to.iter_mut().zip(from) {
        to.set_lane(lane, Scalar::from_f64(x));
    }
}

/// Argument lambda - rho v of the map of a constraint.
fn moved(block: &Block, lambda: &[f64], v: &[f64]) -> Rows {
    let mut z = [0.0; MAX_CONTACT_ROWS];
    for (z, (l, v)) in z.iter_mut().zip(lambda.iter().zip(v)) {
        *z = l - block.rho * v;
    }
    z
}

impl LaneResponse {
    /// Stores the constraints of a lane, with the number `name` that identifies each.
    fn store_constraints(&mut self, lane: &Lane, name: impl Fn(usize) -> u64) {
        self.blocks.clear();
        self.lambda.clear();
        self.velocity.clear();
        self.lambda.extend_from_slice(&lane.lambda);
        for block in &lane.blocks {
            self.blocks.push(Block {
                set: block.constraint.set,
                mode: Mode::Open,
                margin: 0.0,
                source: block.source,
                name: name(block.source),
                rows: block.rows.clone(),
                rho: natural_step(lane, block),
                compliance: block.constraint.compliance,
            });
        }
    }

    /// Finds the mode of each constraint: open, at a bound, sticking or slipping.
    fn find_modes(&mut self) {
        self.active.clear();
        for block in &mut self.blocks {
            let rows = block.rows.clone();
            let z = moved(block, &self.lambda[rows.clone()], &self.velocity[rows.clone()]);
            block.mode = with_row_count!(block.rows.len(), N => block.set.map::<N>(std::array::from_fn(|k| z[k])).1);
            block.margin = block.set.margin(block.mode, &z[..block.rows.len()]).0;
            if block.mode.is_active() {
                self.active.extend(rows);
            }
        }
    }

    /// Corrects the velocities of the rows of lane `l` whose damping was switched on or off since the solution was stored. The corrected
    /// velocities are those with the damping of the stored problem.
    ///
    /// `before` are the impulses at which damping causes no velocity.
    fn keep_damping<R: Real>(&self, velocities: &mut [R], before: &[R], l: usize) {
        for (block, found) in self.blocks.iter().zip(&self.found) {
            let Some(Found { first, compliance }) = *found else { continue };
            if block.switches_damping(compliance) {
                for i in 0..block.rows.len() {
                    let change = self.lambda[block.rows.start + i] - number_of(before[first + i], l);
                    let v = number_of(velocities[first + i], l) + (block.compliance - compliance) * change;
                    velocities[first + i].set_lane(l, Scalar::from_f64(v));
                }
            }
        }
    }

    /// Computes the impulses of lane `l` to first order. They are the stored impulses plus the stored derivative times the change of the
    /// rows' velocities to `velocities`.
    fn update_impulses<R: Real>(&mut self, velocities: &[R], impulses: &mut [R], l: usize) {
        let Self { blocks, lambda, velocity, matrix, found, change, .. } = self;
        change.clear();
        for (block, found) in blocks.iter().zip(found.iter()).filter(|(block, _)| block.mode.is_active()) {
            // A constraint that no longer exists has been reported already.
            change.extend(
                (0..block.rows.len())
                    .map(|i| found.map_or(0.0, |found| number_of(velocities[found.first + i], l) - velocity[block.rows.start + i])),
            );
        }
        change.resize(change.len().next_multiple_of(TILE), 0.0);
        let mut rows = matrix.chunks_exact(change.len().max(1));
        for (block, found) in blocks.iter().zip(found.iter()).filter(|(block, _)| block.mode.is_active()) {
            for (i, row) in (0..block.rows.len()).zip(&mut rows) {
                if let Some(Found { first, .. }) = found {
                    let answer = lambda[block.rows.start + i] + inner_of_tiles(row, change);
                    impulses[first + i].set_lane(l, Scalar::from_f64(answer));
                }
            }
        }
    }
}

/// Step rho of a constraint's natural map lambda - P_K(lambda - rho u), kg: number of rows divided by the trace of its block of the
/// Delassus matrix, compliance included. Here lambda is the impulse, u the velocity, and P_K the
/// projection on the admissible impulses. The map is zero at the solution.
fn natural_step(lane: &Lane, block: &LaneBlock) -> f64 {
    let (_, entries) = lane.entries(block);
    let dim = block.rows.len() as f64;
    dim / (inner(entries, entries) + block.constraint.compliance * dim)
}

impl Linear {
    /// Computes the derivative of the impulses of a lane into `own`, which must have the mode of each constraint (open, sticking,
    /// slipping, at a bound). Returns false if the motion depends on impulses that the rows do not determine.
    fn solve(&mut self, lane: &Lane, own: &mut LaneResponse, dimension: usize) -> bool {
        let n = own.active.len();
        let (mut blocks, mut next) = (vec![], 0);
        for (block, from) in own.blocks.iter().zip(&lane.blocks).filter(|(block, _)| block.mode.is_active()) {
            blocks.push((next, block, from));
            next += block.rows.len();
        }
        let width = (dimension + lane.blocks.len()).next_multiple_of(TILE);
        self.dense.clear();
        self.dense.resize(n * width, 0.0);
        for &(row, block, from) in &blocks {
            let (columns, entries) = lane.entries(from);
            for (&c, entries) in columns.iter().zip(entries.chunks_exact(block.rows.len())) {
                for (i, &y) in entries.iter().enumerate() {
                    self.dense[(row + i) * width + c as usize] = y;
                }
            }
        }
        let stride = n.next_multiple_of(TILE);
        self.delassus.clear();
        self.delassus.resize(n * stride, 0.0);
        for i in 0..n {
            for j in 0..=i {
                let g = inner_of_tiles(&self.dense[i * width..][..width], &self.dense[j * width..][..width]);
                self.delassus[i * stride + j] = g;
                self.delassus[j * stride + i] = g;
            }
        }
        for (row, block, _) in &blocks {
            (*row..row + block.rows.len()).for_each(|i| self.delassus[i * stride + i] += block.compliance);
        }
        self.left.clear();
        self.left.resize(n * stride, 0.0);
        self.right.clear();
        self.right.resize(n * stride, 0.0);
        for &(row, block, _) in &blocks {
            let (dim, rows) = (block.rows.len(), block.rows.clone());
            let (lambda, v) = (&own.lambda[rows.clone()], &own.velocity[rows]);
            let z = &moved(block, lambda, v)[..dim];
            let own_width = dim.next_multiple_of(TILE);
            let mut unit = [0.0; MAX_CONTACT_ROWS * (MAX_CONTACT_ROWS + TILE)];
            let unit = &mut unit[..dim * own_width];
            (0..dim).for_each(|i| unit[i * own_width + i] = 1.0);
            self.differentiate(block, 1.0, z, unit, own_width);
            for (i, derivative) in self.product.chunks_exact(own_width).enumerate() {
                for j in 0..dim {
                    self.left[(row + i) * stride + row + j] = unit[i * own_width + j] - derivative[j];
                }
            }
            let delassus = std::mem::take(&mut self.delassus);
            self.differentiate(block, block.rho, z, &delassus[row * stride..][..dim * stride], stride);
            self.delassus = delassus;
            for (left, x) in self.left[row * stride..][..dim * stride].iter_mut().zip(&self.product) {
                *left += x;
            }
            self.differentiate(block, block.rho, z, unit, own_width);
            for (i, derivative) in self.product.chunks_exact(own_width).enumerate() {
                for j in 0..dim {
                    self.right[(row + i) * stride + row + j] = -derivative[j];
                }
            }
        }
        let rank = self.eliminate(n, stride);
        self.substitute(n, stride, rank, &mut own.matrix);
        own.undetermined.clear();
        (rank..n).all(|k| {
            let impulses = self.undetermined_impulses(stride, rank, k);
            let no_motion = self.causes_no_motion(&impulses, norm(&impulses));
            own.undetermined.extend(impulses);
            no_motion
        })
    }

    /// Computes rho DP Y of an active constraint into `product`: step times the derivative of its map at `z` times a matrix whose rows have
    /// `n` entries.
    fn differentiate(&mut self, block: &Block, rho: f64, z: &[f64], y: &[f64], n: usize) {
        self.product.clear();
        self.product.resize(y.len(), 0.0);
        with_row_count!(z.len(), N => {
            let derivative = block.set.derivative::<N>(block.mode, std::array::from_fn(|k| z[k]));
            for (product, derivative) in self.product.chunks_exact_mut(n).zip(derivative) {
                for (y, x) in y.chunks_exact(n).zip(derivative) {
                    add_multiple_of_tiles(product, rho * x, y);
                }
            }
        });
    }

    /// Impulses of the active rows that the equations do not determine. The unknown in place `k` of the elimination order is 1, where k is
    /// at least the rank of the equations. The other unknowns from the rank on are 0. Rows of the matrix are `stride` numbers apart.
    fn undetermined_impulses(&self, stride: usize, rank: usize, k: usize) -> Vec<f64> {
        let Self { left, rows, columns, .. } = self;
        let mut impulses = vec![0.0; columns.len()];
        impulses[columns[k]] = 1.0;
        for k in (0..rank).rev() {
            let row = &left[rows[k] * stride..][..stride];
            let sum: f64 = columns[k + 1..].iter().map(|&other| row[other] * impulses[other]).sum();
            impulses[columns[k]] = -sum / row[columns[k]];
        }
        impulses
    }

    /// Whether `impulses`, one for each active row, cause no motion. The scale is the motion by an impulse of `size` N s in a single row.
    ///
    /// Examples of impulses without motion are loads that are shared while all contacts stick or slip along one line, and those of
    /// immovable rows.
    fn causes_no_motion(&self, impulses: &[f64], size: f64) -> bool {
        let Self { dense, .. } = self;
        let width = dense.len() / impulses.len().max(1);
        let mut motion = vec![0.0; width];
        for (y, x) in dense.chunks_exact(width.max(1)).zip(impulses) {
            add_multiple_of_tiles(&mut motion, *x, y);
        }
        let largest = dense.chunks_exact(width.max(1)).map(|y| inner(y, y)).fold(0.0, f64::max);
        norm(&motion) <= NO_MOTION * size * largest.sqrt()
    }

    /// Whether loads that the velocity solve `before` leaves undetermined cause motion in this position solve of the same rows.
    ///
    /// Damping in the position solve acts on the difference from the impulses of the velocity solve. A different distribution of loads in
    /// the velocity solve therefore changes the result of the position solve.
    fn moves_with_loads(&self, own: &LaneResponse, before: &LaneResponse) -> bool {
        let [n, stride] = [own.active.len(), own.active.len().next_multiple_of(TILE)];
        let mut compliance = vec![0.0; own.lambda.len()];
        for (block, before) in own.blocks.iter().zip(&before.blocks) {
            compliance[block.rows.clone()].fill(block.compliance - before.compliance);
        }
        before.undetermined.chunks_exact(before.active.len().max(1)).any(|load| {
            let mut yielding = vec![0.0; own.lambda.len()];
            for (&row, x) in before.active.iter().zip(load) {
                yielding[row] = -compliance[row] * x;
            }
            let mut change: Vec<f64> = own.active.iter().map(|&row| yielding[row]).collect();
            change.resize(stride, 0.0);
            let impulses: Vec<f64> = own.matrix.chunks_exact(stride.max(1)).take(n).map(|row| inner_of_tiles(row, &change)).collect();
            !self.causes_no_motion(&impulses, norm(load))
        })
    }

    /// Makes the `n` equations triangular by Gaussian elimination with complete pivoting. Rows of the matrices are `stride` numbers apart.
    /// Returns the rank.
    fn eliminate(&mut self, n: usize, stride: usize) -> usize {
        let Self { left, right, rows, columns, .. } = self;
        rows.clear();
        rows.extend(0..n);
        columns.clear();
        columns.extend(0..n);
        let mut largest = 0.0;
        for k in 0..n {
            let (mut best, mut at) = (0.0, [k, k]);
            for (r, &row) in rows.iter().enumerate().skip(k) {
                for (c, &column) in columns.iter().enumerate().skip(k) {
                    let size = left[row * stride + column].abs();
                    if size > best {
                        (best, at) = (size, [r, c]);
                    }
                }
            }
            largest = if k == 0 { best } else { largest };
            if best <= DEPENDENT * largest {
                return k;
            }
            rows.swap(k, at[0]);
            columns.swap(k, at[1]);
            let pivot_column = columns[k];
            let pivot_row = rows[k] * stride..rows[k] * stride + stride;
            let inverse = 1.0 / left[pivot_row.start + pivot_column];
            for &row in &rows[k + 1..] {
                let factor = left[row * stride + pivot_column] * inverse;
                if factor != 0.0 {
                    subtract_row(left, row * stride, pivot_row.clone(), factor);
                    subtract_row(right, row * stride, pivot_row.clone(), factor);
                    left[row * stride + pivot_column] = 0.0;
                }
            }
        }
        n
    }

    /// Computes the derivative of the impulses by back substitution, into `out`. It solves the first `rank` of the `n` triangular equations
    /// for the first `rank` unknowns in the order of elimination. The other unknowns are 0. Rows of the matrices are `stride` numbers
    /// apart.
    ///
    /// If rows depend on each other while none of them slips, all solutions cause the same motion.
    fn substitute(&self, n: usize, stride: usize, rank: usize, out: &mut Vec<f64>) {
        let Self { left, right, rows, columns, .. } = self;
        out.clear();
        out.resize(n * stride, 0.0);
        for k in (0..rank).rev() {
            let (row, unknown) = (rows[k] * stride, columns[k] * stride);
            out[unknown..unknown + stride].copy_from_slice(&right[row..row + stride]);
            for &other in &columns[k + 1..rank] {
                let factor = left[row + other];
                if factor != 0.0 {
                    subtract_row(out, unknown, other * stride..(other + 1) * stride, factor);
                }
            }
            let inverse = 1.0 / left[row + columns[k]];
            out[unknown..unknown + stride].iter_mut().for_each(|x| *x *= inverse);
        }
    }
}

/// Subtracts `factor` times the row `from` of whole tiles from the row that begins at index `to`.
fn subtract_row(matrix: &mut [f64], to: usize, from: Range<usize>, factor: f64) {
    let [to, from] = matrix.get_disjoint_mut([to..to + from.len(), from]).expect("two different rows");
    add_multiple_of_tiles(to, -factor, from);
}
