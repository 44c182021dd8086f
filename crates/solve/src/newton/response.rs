//! Response of the impulses of a solved problem to its rows while no mode changes, by the implicit function theorem. It works lane by lane
//! in scalar f64.
//!
//! The impulses are a zero of the natural map, with v = G lambda + g and De Saxce's terms s:
//!
//! ```text
//! lambda - P_K(lambda - rho (v + s)) = 0
//! (I - DP + rho DP (I + S) G) dlambda = -rho DP (I + S) dv
//! ```
//!
//! Here dv is the change of the rows' velocities at constant impulses, by the free velocity, the targets or the Jacobians. The matrix is
//! computed once; each change is then a product (Le Lidec et al. 2024).

use crate::admissible_set::{AdmissibleSet, Piece, Product};
use crate::constraints::constraint_set::{ConstraintSet, Impulse, number_of};
use crate::constraints::each_kind;
use crate::iterate::{Iterate, rows_of};
use crate::newton::lane::{Lane, LaneBlock};
use crate::problem::System;
use crate::vectors::{TILE, add_scaled, inner, inner_of_tiles, norm};
use stepper_real::{Mask, Real, Scalar};

/// Pivot relative to the largest, below which a row depends on those before. Independent directions of a robot's rows have far larger
/// pivots.
const DEPENDENT: f64 = 1e-10;

/// Ratio of the motion by all impulses to that by each alone, below which it counts as no motion.
const IDLE: f64 = 1e-7;

/// Ratio of a compliance to the previous one, below which it belongs to another mode: a row has none, or at least a thousandth of its
/// mobility.
const SAME_COMPLIANCE: f64 = 0.5;

/// Largest number of rows of one constraint, and an array with a number for each.
const MAX_ROWS: usize = 6;
type Rows = [f64; MAX_ROWS];

/// Number of kinds of constraints.
const KINDS: usize = 3;

/// Mode of a constraint that changes, at which a derivative ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switch {
    /// A contact begins or ceases to push.
    Contact,
    /// A contact begins or ceases to slip.
    Slip,
    /// A row with one bound reaches or leaves its bound.
    Limit,
    /// A row with two bounds reaches or leaves a bound.
    DryFriction,
    /// A row of the position solve begins or ceases to correct, and thereby to be damped.
    Gap,
}

/// Distance of a constraint from its next mode under a change.
#[derive(Clone, Copy, Debug)]
pub struct Followed {
    /// Lane of the constraint.
    pub lane: usize,
    /// Mode that would change next.
    pub switch: Switch,
    /// Distance to the switch, as a multiple of the change: at most 1 if it has happened, infinite if the change leads away from it.
    pub distance: f64,
}

/// Response of the impulses of a group of lanes.
#[derive(Clone, Debug)]
pub struct Response<R: Real> {
    lanes: Vec<LaneResponse>,
    /// Number of eliminated rows, which are solved exactly each time.
    eliminated: usize,
    /// First row of each kind, in the order of the kinds, and numbers of rows of one constraint.
    kinds: Vec<[usize; 2]>,
    /// Impulses and velocities of all rows.
    impulses: Vec<R>,
    velocities: Vec<R>,
    /// Compliance of all rows of a position solve; none of other rows.
    compliances: Vec<R>,
    lane: Lane,
    system: Linear,
}

/// Solution of one lane, and the derivative of its impulses with respect to the rows' velocities while no constraint changes its mode.
#[derive(Clone, Debug, Default)]
struct LaneResponse {
    blocks: Vec<Block>,
    /// Impulses and velocities of all rows at the solution.
    lambda: Vec<f64>,
    velocity: Vec<f64>,
    /// Indices of the rows that are not open.
    active: Vec<usize>,
    /// Derivative of the impulses with respect to the velocities, row by row, each filled up to whole tiles.
    matrix: Vec<f64>,
    /// Changes of the active rows' impulses that cause no motion, so that the rows do not determine them. They are concatenated.
    open: Vec<f64>,
    /// First row of every block in the current problem, `None` if the problem does not have its constraint.
    found: Vec<Option<usize>>,
    change: Vec<f64>,
}

/// Rows of one constraint of a lane.
#[derive(Clone, Copy, Debug)]
struct Block {
    set: AdmissibleSet,
    piece: Piece,
    /// Margin of the impulses, see [`AdmissibleSet::margin`].
    margin: f64,
    kind: usize,
    source: usize,
    name: u64,
    first: usize,
    dim: usize,
    rho: f64,
    /// Compliance of all rows, without the additional one of the normal row.
    compliance: f64,
}

impl Block {
    /// Whether rows of this compliance are damped and those of the solution were not, or the reverse.
    fn switches_damping(&self, compliance: f64) -> bool {
        self.compliance.min(compliance) < SAME_COMPLIANCE * self.compliance.max(compliance)
    }
}

/// Linear system of a lane, with its workspace.
#[derive(Clone, Debug, Default)]
struct Linear {
    /// Rows of the active constraints over all coordinates.
    dense: Vec<f64>,
    delassus: Vec<f64>,
    product: Product,
    left: Vec<f64>,
    right: Vec<f64>,
    /// Order of rows and of columns in which the matrix was eliminated.
    rows: Vec<usize>,
    columns: Vec<usize>,
}

impl<R: Real> Default for Response<R> {
    fn default() -> Self {
        Self {
            lanes: vec![LaneResponse::default(); R::LANES],
            eliminated: 0,
            kinds: vec![],
            impulses: vec![],
            velocities: vec![],
            compliances: vec![],
            lane: Lane::default(),
            system: Linear::default(),
        }
    }
}

impl<R: Real> Response<R> {
    /// Stores the solution of the lanes `lanes` (bits). Returns the lanes whose motion follows from their rows.
    ///
    /// The motion does not follow if, for example, contacts share loads while they slip about a point, because the rows leave the loads
    /// open. `name` returns a number for a constraint of a kind in a lane, which identifies it in other problems. The compliance of a
    /// position solve counts from the impulses `before`, the solution of the velocities. The loads that this solution leaves open must move
    /// nothing here either.
    pub fn settle<'a>(
        &mut self,
        system: impl Into<System<'a, R>>,
        iterate: &Iterate<R>,
        lanes: u32,
        name: impl Fn(usize, usize, usize) -> u64,
        before: Option<&Self>,
    ) -> u32 {
        let rows = system.into();
        self.eliminated = rows.problem.scalars.eliminated();
        self.find_velocities(rows, iterate);
        let mut sound = lanes;
        for l in (0..R::LANES).filter(|l| lanes >> l & 1 == 1) {
            self.lane.gather(rows, iterate, l);
            let Self { lanes: all, kinds, velocities, lane, system, .. } = self;
            let own = &mut all[l];
            own.begin(lane, |kind, source| name(kind, source, l));
            for block in &own.blocks {
                let [start, dim] = kinds[block.kind];
                own.velocity.extend(velocities[start + dim * block.source..][..dim].iter().map(|&v| number_of(v, l)));
            }
            own.find_pieces();
            let determined = system.solve(lane, own, iterate.w.len());
            if !determined || before.is_some_and(|before| system.is_moved_by_loads(own, &before.lanes[l])) {
                sound &= !(1 << l);
            }
        }
        sound
    }

    /// Replaces the impulses of a problem close to the solved one by the solution to first order, in the lanes `lanes` (bits).
    ///
    /// Returns the lanes in which a constraint that pushed no longer exists. For a position solve `before` is the solution of the
    /// velocities after its response. Rows that were damped stay damped, and no others.
    pub fn respond<'a>(
        &mut self,
        system: impl Into<System<'a, R>>,
        iterate: &mut Iterate<R>,
        lanes: u32,
        name: impl Fn(usize, usize, usize) -> u64,
        before: Option<&Self>,
    ) -> u32 {
        let system = system.into();
        let mut lost = if system.problem.scalars.eliminated() == self.eliminated { 0 } else { lanes };
        self.lay_out(iterate);
        let total = self.impulses.len();
        let end = |kind: usize| self.kinds.get(kind + 1).map_or(total, |next| next[0]);
        let counts: [usize; KINDS] = std::array::from_fn(|kind| (end(kind) - self.kinds[kind][0]) / self.kinds[kind][1]);
        // Eliminated rows keep their impulses, which are computed right below.
        self.impulses[self.eliminated.min(counts[0])..].fill(R::zero());
        for l in (0..R::LANES).filter(|l| lanes >> l & 1 == 1) {
            let Self { lanes: all, kinds, impulses, .. } = self;
            let LaneResponse { blocks, lambda, found, .. } = &mut all[l];
            found.clear();
            for block in blocks.iter() {
                let is_it = |source: &usize| name(block.kind, *source, l) == block.name;
                let source = Some(block.source).filter(|&s| s < counts[block.kind]).filter(is_it);
                let source = source.or_else(|| (0..counts[block.kind]).find(is_it));
                let first = source.map(|source| kinds[block.kind][0] + block.dim * source);
                found.push(first);
                let own = &lambda[block.first..block.first + block.dim];
                match first {
                    Some(first) => set_lanes(&mut impulses[first..first + block.dim], l, own.iter().copied()),
                    None if own.iter().any(|&x| x != 0.0) => lost |= 1 << l,
                    None => {}
                }
            }
        }
        self.take_up(system, iterate);
        self.find_velocities(system, iterate);
        self.compliances.clear();
        if before.is_some() {
            self.find_compliances(system);
        }
        for l in (0..R::LANES).filter(|l| lanes >> l & 1 == 1) {
            let Self { lanes: all, velocities, compliances, impulses, .. } = self;
            if let Some(before) = before {
                all[l].hold_damping(velocities, compliances, &before.impulses, l);
            }
            all[l].follow(velocities, impulses, l);
        }
        self.take_up(system, iterate);
        lost
    }

    /// Calls `f` for every constraint that the last [`Response::respond`] has brought closer to another mode.
    pub fn compare<'a>(&mut self, system: impl Into<System<'a, R>>, iterate: &Iterate<R>, lanes: u32, mut f: impl FnMut(Followed)) {
        let system = system.into();
        self.find_velocities(system, iterate);
        let (mut lambda, mut v) = ([0.0; MAX_ROWS], [0.0; MAX_ROWS]);
        for lane in (0..R::LANES).filter(|l| lanes >> l & 1 == 1) {
            let own = &self.lanes[lane];
            for (block, first) in own.blocks.iter().zip(&own.found) {
                let Some(first) = *first else { continue };
                if self.compliances.get(first).is_some_and(|&c| block.switches_damping(number_of(c, lane))) {
                    f(Followed { lane, switch: Switch::Gap, distance: 1.0 });
                }
                for i in 0..block.dim {
                    lambda[i] = number_of(self.impulses[first + i], lane);
                    v[i] = number_of(self.velocities[first + i], lane);
                }
                let (lambda, v) = (&lambda[..block.dim], &v[..block.dim]);
                let (margin, slips) = block.set.margin(block.piece, &moved(block, lambda, v)[..block.dim]);
                if margin >= block.margin || margin.is_nan() {
                    continue;
                }
                let switch = match block.set {
                    AdmissibleSet::Cone { .. } if slips => Switch::Slip,
                    AdmissibleSet::Cone { .. } => Switch::Contact,
                    AdmissibleSet::Interval { lo, hi } if lo.is_finite() && hi.is_finite() => Switch::DryFriction,
                    AdmissibleSet::Interval { .. } => Switch::Limit,
                };
                f(Followed { lane, switch, distance: block.margin / (block.margin - margin) });
            }
        }
    }

    /// Copies the impulses of all kinds into one list.
    fn lay_out(&mut self, iterate: &Iterate<R>) {
        let Self { kinds, impulses, .. } = self;
        impulses.clear();
        kinds.clear();
        each_kind!([own: &iterate] => {
            kinds.push([impulses.len(), rows_of::<R, _>(own)]);
            impulses.extend_from_slice(Impulse::<R>::flatten(own));
        });
    }

    /// Writes the impulses to the iterate, and solves the eliminated rows.
    fn take_up(&self, system: System<'_, R>, iterate: &mut Iterate<R>) {
        let mut rest = &self.impulses[..];
        each_kind!([own: &mut iterate] => {
            let own = Impulse::<R>::flatten_mut(own);
            let (these, others) = rest.split_at(own.len());
            own.copy_from_slice(these);
            rest = others;
        });
        let _ = rest;
        R::vectorize(
            #[inline(always)]
            || {
                iterate.compute_w(system.problem);
                iterate.solve_eliminated(system, R::Mask::splat(true));
            },
        );
    }

    /// Computes the velocities of all rows at the impulses of an iterate.
    fn find_velocities(&mut self, system: System<'_, R>, iterate: &Iterate<R>) {
        self.lay_out(iterate);
        self.velocities.clear();
        let velocities = &mut self.velocities;
        R::vectorize(
            #[inline(always)]
            || {
                each_kind!([set: &system.problem] [rows: system] [impulses: &iterate] => {
                    set.velocities(rows, impulses, &iterate.w, velocities);
                });
            },
        );
    }

    /// Appends the compliances of all rows.
    fn find_compliances(&mut self, system: System<'_, R>) {
        each_kind!([set: &system.problem] [rows: system] => set.compliances(rows, &mut self.compliances));
    }
}

/// Sets one lane of some numbers.
fn set_lanes<R: Real>(to: &mut [R], lane: usize, from: impl Iterator<Item = f64>) {
    for (to, x) in to.iter_mut().zip(from) {
        to.set_lane(lane, Scalar::from_f64(x));
    }
}

/// Argument lambda - rho (v + s) of the projection.
fn moved(block: &Block, lambda: &[f64], v: &[f64]) -> Rows {
    let mut z = [0.0; MAX_ROWS];
    for (z, (l, v)) in z.iter_mut().zip(lambda.iter().zip(v)) {
        *z = l - block.rho * v;
    }
    z[0] -= block.rho * block.set.slip(v);
    z
}

impl LaneResponse {
    /// Stores the constraints of a lane.
    fn begin(&mut self, lane: &Lane, name: impl Fn(usize, usize) -> u64) {
        self.blocks.clear();
        self.lambda.clear();
        self.velocity.clear();
        self.lambda.extend_from_slice(&lane.lambda);
        for block in &lane.blocks {
            self.blocks.push(Block {
                set: block.set,
                piece: Piece::Open,
                margin: 0.0,
                kind: block.kind,
                source: block.source,
                name: name(block.kind, block.source),
                first: block.rows.start,
                dim: block.rows.len(),
                rho: natural_step(lane, block),
                compliance: block.compliance,
            });
        }
    }

    /// Finds the piece of the projection that every constraint is in.
    fn find_pieces(&mut self) {
        self.active.clear();
        for block in &mut self.blocks {
            let rows = block.first..block.first + block.dim;
            let z = moved(block, &self.lambda[rows.clone()], &self.velocity[rows.clone()]);
            block.piece = block.set.piece(&z[..block.dim]);
            block.margin = block.set.margin(block.piece, &z[..block.dim]).0;
            if matches!(block.piece, Piece::Held | Piece::Sliding) {
                self.active.extend(rows);
            }
        }
    }

    /// Corrects the velocities of rows of the lane `l` whose damping differs from that at the solution: damped there and not now, or the
    /// reverse.
    ///
    /// `compliances` are the current ones, and `before` the impulses from which damping counts.
    fn hold_damping<R: Real>(&self, velocities: &mut [R], compliances: &[R], before: &[R], l: usize) {
        for (block, first) in self.blocks.iter().zip(&self.found) {
            let Some(first) = *first else { continue };
            let compliance = number_of(compliances[first], l);
            if block.switches_damping(compliance) {
                for i in 0..block.dim {
                    let change = self.lambda[block.first + i] - number_of(before[first + i], l);
                    let v = number_of(velocities[first + i], l) + (block.compliance - compliance) * change;
                    velocities[first + i].set_lane(l, Scalar::from_f64(v));
                }
            }
        }
    }

    /// Changes the impulses of the lane `l` in response to the velocities.
    fn follow<R: Real>(&mut self, velocities: &[R], impulses: &mut [R], l: usize) {
        let Self { blocks, lambda, velocity, matrix, found, change, .. } = self;
        change.clear();
        let active = |block: &Block| matches!(block.piece, Piece::Held | Piece::Sliding);
        for (block, first) in blocks.iter().zip(found.iter()).filter(|(block, _)| active(block)) {
            // A constraint that no longer exists has been reported already.
            change
                .extend((0..block.dim).map(|i| first.map_or(0.0, |first| number_of(velocities[first + i], l) - velocity[block.first + i])));
        }
        change.resize(change.len().next_multiple_of(TILE), 0.0);
        let mut rows = matrix.chunks_exact(change.len().max(1));
        for (block, first) in blocks.iter().zip(found.iter()).filter(|(block, _)| active(block)) {
            for (i, row) in (0..block.dim).zip(&mut rows) {
                if let Some(first) = first {
                    let answer = lambda[block.first + i] + inner_of_tiles(row, change);
                    impulses[first + i].set_lane(l, Scalar::from_f64(answer));
                }
            }
        }
    }
}

/// Step of the natural map, as in the residual: `dim / trace(G_ii)`, compliance included.
fn natural_step(lane: &Lane, block: &LaneBlock) -> f64 {
    let (_, entries) = lane.entries(block);
    let dim = block.rows.len() as f64;
    dim / (inner(entries, entries) + block.compliance * dim)
}

impl Linear {
    /// Computes the response of a lane with known pieces. Returns false if the rows leave impulses open on which the motion depends.
    fn solve(&mut self, lane: &Lane, own: &mut LaneResponse, dimension: usize) -> bool {
        let n = own.active.len();
        let active = |block: &(&Block, &LaneBlock)| matches!(block.0.piece, Piece::Held | Piece::Sliding);
        let blocks: Vec<(&Block, &LaneBlock)> = own.blocks.iter().zip(&lane.blocks).filter(active).collect();
        let width = (dimension + lane.blocks.len()).next_multiple_of(TILE);
        self.dense.clear();
        self.dense.resize(n * width, 0.0);
        let mut row = 0;
        for (block, from) in &blocks {
            let (support, entries) = lane.entries(from);
            for (&c, entries) in support.iter().zip(entries.chunks_exact(block.dim)) {
                for (i, &y) in entries.iter().enumerate() {
                    self.dense[(row + i) * width + c as usize] = y;
                }
            }
            row += block.dim;
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
        let mut row = 0;
        for (block, from) in &blocks {
            (row..row + block.dim).for_each(|i| self.delassus[i * stride + i] += from.compliance);
            row += block.dim;
        }
        self.left.clear();
        self.left.resize(n * stride, 0.0);
        self.right.clear();
        self.right.resize(n * stride, 0.0);
        let mut row = 0;
        for (block, _) in &blocks {
            let (dim, rows) = (block.dim, block.first..block.first + block.dim);
            let (lambda, v) = (&own.lambda[rows.clone()], &own.velocity[rows]);
            let z = &moved(block, lambda, v)[..dim];
            // A constraint that holds has no velocity: its direction would be rounding.
            let v = Some(v).filter(|v| block.piece == Piece::Sliding && norm(&v[1..]) > 0.0);
            let own_width = dim.next_multiple_of(TILE);
            let mut unit = [0.0; MAX_ROWS * (MAX_ROWS + TILE)];
            let unit = &mut unit[..dim * own_width];
            (0..dim).for_each(|i| unit[i * own_width + i] = 1.0);
            block.set.differentiate(1.0, z, None, unit, own_width, &mut self.product);
            for (i, derivative) in self.product.rows.chunks_exact(own_width).enumerate() {
                for j in 0..dim {
                    self.left[(row + i) * stride + row + j] = unit[i * own_width + j] - derivative[j];
                }
            }
            block.set.differentiate(block.rho, z, v, &self.delassus[row * stride..][..dim * stride], stride, &mut self.product);
            for (left, x) in self.left[row * stride..][..dim * stride].iter_mut().zip(&self.product.rows) {
                *left += x;
            }
            block.set.differentiate(block.rho, z, v, unit, own_width, &mut self.product);
            for (i, derivative) in self.product.rows.chunks_exact(own_width).enumerate() {
                for j in 0..dim {
                    self.right[(row + i) * stride + row + j] = -derivative[j];
                }
            }
            row += dim;
        }
        let rank = self.eliminate(n, stride);
        self.substitute(n, stride, rank, &mut own.matrix);
        own.open.clear();
        (rank..n).all(|k| {
            let impulses = self.open_impulses(stride, rank, k);
            let idle = self.is_idle(&impulses, norm(&impulses));
            own.open.extend(impulses);
            idle
        })
    }

    /// Impulses that the equations leave open, with the unknown in place `k` beyond the rank.
    fn open_impulses(&self, stride: usize, rank: usize, k: usize) -> Vec<f64> {
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

    /// Whether the impulses of the active rows cause no motion compared with that by `size` N s alone. The motion is then determined
    /// whatever they are.
    ///
    /// Examples are loads that are shared while all contacts stick or slip along one line, and immovable rows.
    fn is_idle(&self, impulses: &[f64], size: f64) -> bool {
        let Self { dense, .. } = self;
        let width = dense.len() / impulses.len().max(1);
        let mut motion = vec![0.0; width];
        for (y, x) in dense.chunks_exact(width.max(1)).zip(impulses) {
            add_scaled(&mut motion, *x, y);
        }
        let largest = dense.chunks_exact(width.max(1)).map(|y| inner(y, y)).fold(0.0, f64::max);
        norm(&motion) <= IDLE * size * largest.sqrt()
    }

    /// Whether loads that another solution of the same rows leaves open cause motion here. The compliance of these rows counts from that
    /// solution.
    fn is_moved_by_loads(&self, own: &LaneResponse, before: &LaneResponse) -> bool {
        let [n, stride] = [own.active.len(), own.active.len().next_multiple_of(TILE)];
        let mut compliance = vec![0.0; own.lambda.len()];
        for (block, before) in own.blocks.iter().zip(&before.blocks) {
            compliance[block.first..block.first + block.dim].fill(block.compliance - before.compliance);
        }
        before.open.chunks_exact(before.active.len().max(1)).any(|load| {
            let mut yielding = vec![0.0; own.lambda.len()];
            for (&row, x) in before.active.iter().zip(load) {
                yielding[row] = -compliance[row] * x;
            }
            let mut change: Vec<f64> = own.active.iter().map(|&row| yielding[row]).collect();
            change.resize(stride, 0.0);
            let impulses: Vec<f64> = own.matrix.chunks_exact(stride.max(1)).take(n).map(|row| inner_of_tiles(row, &change)).collect();
            !self.is_idle(&impulses, norm(load))
        })
    }

    /// Gaussian elimination with complete pivoting. Returns the rank.
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

    /// Solution of the first `rank` equations in the first unknowns, with 0 for the others. If rows depend on each other while all hold,
    /// all solutions cause the same motion.
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

/// Subtracts `factor` times a row of whole tiles from the row that begins at `to`.
fn subtract_row(matrix: &mut [f64], to: usize, from: std::ops::Range<usize>, factor: f64) {
    let (to, from) = if to < from.start {
        let (before, after) = matrix.split_at_mut(from.start);
        (&mut before[to..to + from.len()], &after[..from.len()])
    } else {
        let (before, after) = matrix.split_at_mut(to);
        (&mut after[..from.len()], &before[from])
    };
    add_scaled(to, -factor, from);
}
