//! Rows of equalities: J v = 0 along the whole step, so that closed loops stay closed.
//!
//! Let e(q) be the position error and J its Jacobian. The curvature term kappa = J' v is the acceleration along the rows at zero joint
//! acceleration (J' is the time derivative of J). Up to terms of third order in h, a step changes the error as follows:
//!
//! ```text
//! Euler (q+ = q + h v+, rows at q):                             e+ = e + h J v+ + h^2/2 kappa
//! midpoint (q+ = q_m + h/2 v+, rows at q_m = q + h/2 v):         e+ = (e_m - h^2/8 kappa) + h/2 (J v+ + h/2 kappa)
//! ```
//!
//! The target velocity is therefore `J v+ = -h/2 kappa - beta/h (e - c h^2 kappa)` with c = 0 (Euler) or 1/8 (midpoint). The velocity
//! before the step has J v = +h/2 kappa. The work of the impulses, lambda J (v + v+) / 2, is then zero except for the correction, so that a
//! moving loop keeps its energy. Without kappa every step would remove the energy (h kappa)^2 / 2 G, where G is the row's entry of the
//! Delassus matrix.

pub(crate) mod active_equalities;
pub mod elimination;
pub mod equality_violation;

use stepper_real::{Mask, Real, Scalar, kernel};
use stepper_solve::{EntryScales, RowScales, velocity_rounding};

use crate::compile::{Combination, CompiledEquality, EqualityBlock, EqualityRows, LaneModel, ModelStructure, Spring, coupling_error};
use crate::constraints::assembler::{Assembler, RowInput, RowState};
use crate::constraints::row_builder::RowBuilder;
use crate::constraints::rows::{RowLaw, unbounded};
use crate::constraints::target_velocities::stabilized;
use crate::dynamics::inertia::MassMatrix;
use crate::math::spatial::*;
use crate::options::Stabilization;
use crate::tuning::{CORRECTION_ARM, DAMPING, NEGLIGIBLE_ERROR};

/// Jacobian and error of an equality, before its rows are added to the problem. Two coincident points have three rows, and so do two
/// aligned orientations. A coupling of joints has one row, in the first component of all vectors.
pub(crate) struct EqualityJacobian<R: Real> {
    pub(crate) error: V3<R>,
    /// Velocity-dependent acceleration J' v of the rows.
    pub(crate) kappa: V3<R>,
    /// Sum of the squared terms of a row, each times its entry of D^-1, where L^T D L is the mass matrix. The entries of a row are
    /// differences of these terms. Entries far smaller than the terms are rounding errors.
    size: R,
    /// For rows of points, inverse inertia of the two bodies along the rows if no other constraint acted, 1/kg. 0 for other rows.
    bodies: R,
}

impl<R: Real> RowBuilder<R> {
    /// Sets the row builder's `dofs` to the degrees of freedom `dofs`, ascending.
    #[inline(always)]
    pub(crate) fn use_dofs(&mut self, dofs: &[u32]) {
        self.dofs.clear();
        self.dofs.extend_from_slice(dofs);
    }

    /// Sets the row builder's `dofs` to the degrees of freedom of the equality's block. Sets `column` to zero at those on which the
    /// equality does not act.
    #[inline(always)]
    fn use_block_dofs(&mut self, block: &EqualityBlock<R::Scalar>, equality: &CompiledEquality<R::Scalar>) {
        let mut own = equality.dofs.iter().peekable();
        for &d in &block.dofs {
            if own.next_if_eq(&&d).is_none() {
                self.column[d as usize] = zero();
                self.scales[d as usize] = zero();
            }
        }
        self.use_dofs(&block.dofs);
    }

    /// Computes, into `column`, the Jacobian of two points that must coincide. The error is p0 - p1 (MuJoCo's `mjEQ_CONNECT`).
    ///
    /// A joint that moves both frames rotates the error and keeps its length. If `relative` is true, the entries of such a joint are zero.
    /// If it is false, they describe this rotation, as in MuJoCo. Hard equalities need `relative`. Otherwise, an open planar loop on an arm
    /// would hold the arm. The row normal to the loop's plane would have entries at the joints of the arm alone. The forces at the two
    /// points would also exert a torque on the arm.
    #[inline(always)]
    pub(crate) fn connect_points(
        &mut self,
        input: &RowState<'_, R>,
        frames: [usize; 2],
        anchors: [V3<R>; 2],
        relative: bool,
    ) -> EqualityJacobian<R> {
        let RowState { compiled, kinematics, .. } = *input;
        let points = [kinematics.point(frames[0], anchors[0]), kinematics.point(frames[1], anchors[1])];
        let mut size = R::zero();
        for &d in &self.dofs {
            let d = d as usize;
            let (origin, axis) = (kinematics.origin[compiled.dofs[d].tree], &kinematics.axes[d]);
            let (mut j, mut scale) = (zero(), R::zero());
            let shared = relative && frames.iter().all(|&frame| moves(compiled, frame, d));
            for side in 0..2 {
                if moves(compiled, frames[side], d) {
                    let arm = sub(points[side], origin);
                    let motion = velocity_at(axis, arm);
                    j = if side == 0 { add(j, motion) } else { sub(j, motion) };
                    let (w, v) = (angular(axis), linear(axis));
                    let square = dot(v, v) + dot(w, w) * dot(arm, arm);
                    size += square * input.mass.inv_d[d];
                    scale += square;
                }
            }
            self.column[d] = if shared { zero() } else { j };
            self.scales[d] = [scale; 3];
        }
        let [[_, first], [_, second]] = [
            input.motion.of_point(compiled, kinematics, frames[0], points[0]),
            input.motion.of_point(compiled, kinematics, frames[1], points[1]),
        ];
        let kappa = sub(first, second);
        let bodies = compiled.mobility(frames[0]) + compiled.mobility(frames[1]);
        EqualityJacobian { error: sub(points[0], points[1]), kappa, size, bodies }
    }

    /// Computes, into `column`, the Jacobian of two orientations that must agree.
    ///
    /// The error is the rotation vector from the second to the first orientation in world axes, times `weight` (m/rad). MuJoCo's
    /// `mjEQ_WELD` uses the sine of half its length; both are zero at the same configurations.
    #[inline(always)]
    fn align(&mut self, input: &RowState<'_, R>, frames: [usize; 2], mats: &[M3<R>; 2], weight: R) -> EqualityJacobian<R> {
        let RowState { compiled, kinematics, .. } = *input;
        let mut size = R::zero();
        for &d in &self.dofs {
            let d = d as usize;
            let (mut j, mut square) = (zero(), R::zero());
            let axis = angular(&kinematics.axes[d]);
            for side in 0..2 {
                if moves(compiled, frames[side], d) {
                    j = if side == 0 { add(j, axis) } else { sub(j, axis) };
                    let own = dot(axis, axis);
                    size += own * input.mass.inv_d[d];
                    square += own;
                }
            }
            self.column[d] = scale(j, weight);
            self.scales[d] = [square * weight * weight; 3];
        }
        let first = mat_mul(&kinematics.mat[frames[0]], &mats[0]);
        let second = mat_mul(&kinematics.mat[frames[1]], &mats[1]);
        let turn = quat_log(mat_to_quat(&mat_mul_transposed(&first, &second)));
        let change = &input.motion.acceleration;
        let kappa = sub(angular_of_frame(change, frames[0]), angular_of_frame(change, frames[1]));
        EqualityJacobian { error: scale(turn, weight), kappa: scale(kappa, weight), size: size * weight * weight, bodies: R::zero() }
    }

    /// Computes, into `column`, the Jacobian of x - x_ref = polynomial(y - y_ref) (MuJoCo's `mjEQ_JOINT` and `mjEQ_TENDON`).
    #[inline(always)]
    pub(crate) fn couple_joints(
        &mut self,
        input: &RowState<'_, R>,
        first: &Combination<R::Scalar>,
        second: Option<&Combination<R::Scalar>>,
        c: [R; 5],
    ) -> EqualityJacobian<R> {
        for &d in &self.dofs {
            self.column[d as usize] = zero();
            self.scales[d as usize] = zero();
        }
        let paths = &input.kinematics.paths;
        let mut size = self.add_terms(input, first, R::one());
        self.add_term_scales(input, first, R::one());
        let (error, mut kappa) = (coupling_error(first, second, c, (input.q, paths)), R::zero());
        if let Some(second) = second {
            let x = second.value(input.q, paths) - R::splat(second.reference);
            let of = |k: f64| R::of(k);
            let slope = c[1] + x * (of(2.0) * c[2] + x * (of(3.0) * c[3] + x * (of(4.0) * c[4])));
            let bend = of(2.0) * c[2] + x * (of(6.0) * c[3] + x * (of(12.0) * c[4]));
            kappa = -(bend * second.rate(input.v, paths).square());
            size += self.add_terms(input, second, -slope);
            self.add_term_scales(input, second, slope);
        }
        EqualityJacobian { error: [error, R::zero(), R::zero()], kappa: [kappa, R::zero(), R::zero()], size, bodies: R::zero() }
    }

    /// Adds the Jacobian of a combination, times `factor`, to the first row in `column`. Returns the sum of the squares of
    /// the added entries, each times its entry of D^-1, where L^T D L is the mass matrix.
    #[inline(always)]
    pub(crate) fn add_terms(&mut self, input: &RowState<'_, R>, combination: &Combination<R::Scalar>, factor: R) -> R {
        let mut size = R::zero();
        combination.for_each_arm(
            &input.kinematics.paths,
            #[inline(always)]
            |dof, arm| {
                let x = arm * factor;
                self.column[dof][0] += x;
                size += x * x * input.mass.inv_d[dof];
            },
        );
        size
    }

    /// Adds the squared terms of a combination, times `factor`, to the scales of the first row. A scale is the size of the
    /// terms that an entry sums.
    #[inline(always)]
    fn add_term_scales(&mut self, input: &RowState<'_, R>, combination: &Combination<R::Scalar>, factor: R) {
        combination.for_each_arm(
            &input.kinematics.paths,
            #[inline(always)]
            |dof, arm| self.scales[dof][0] += (arm * factor).square(),
        );
    }

    /// Adds to `scales`, on `dofs`, the squares of the terms that the half solve (L^-T J^T) subtracted from the first `N` components of
    /// `column`.
    #[inline(always)]
    pub(crate) fn add_fill_scales<const N: usize>(&mut self, compiled: &LaneModel<R>, mass: &MassMatrix<R>) {
        let Self { dofs, column, scales, .. } = self;
        for &d in &*dofs {
            let ((row, chain), x) = (mass.row(compiled, d as usize), column[d as usize]);
            for (&l, &a) in row[1..].iter().zip(&chain[1..]) {
                let scale = &mut scales[a as usize];
                for k in 0..N {
                    scale[k] += (x[k] * l).square();
                }
            }
        }
    }

    /// Repeats the half solve (L^-T J^T) of the first component of `column` with squared scales in place of entries. The scale of an entry
    /// is the size of the terms that it sums; an entry far below its scale is rounding error.
    ///
    /// Use this function if entries may be rounding errors before the half solve. Entries that are computed from them then have scales of
    /// the same size. [`Self::add_fill_scales`] is for rows whose entries are exact before the half solve.
    #[inline(always)]
    pub(crate) fn propagate_scales(&mut self, compiled: &LaneModel<R>, mass: &MassMatrix<R>) {
        let Self { dofs, scales, .. } = self;
        for &d in dofs.iter().rev() {
            let ((row, chain), scale) = (mass.row(compiled, d as usize), scales[d as usize][0]);
            for (&l, &a) in row[1..].iter().zip(&chain[1..]) {
                scales[a as usize][0] += scale * l.square();
            }
        }
    }

    /// Squared length of the half-solved row in component `k` of `column`, 1/kg. It is the row's diagonal entry of G, its inverse inertia.
    #[inline(always)]
    pub(crate) fn gram(&self, mass: &MassMatrix<R>, k: usize) -> R {
        let mut sum = R::zero();
        for &d in &self.dofs {
            sum += (self.column[d as usize][k] * mass.sqrt_inv_d[d as usize]).square();
        }
        sum
    }
}

impl<R: Real> Assembler<'_, R> {
    /// Adds the rows of equalities, block by block. If `eliminated` is true, it adds the blocks of eliminated equalities, otherwise all
    /// others.
    pub(crate) fn add_equalities(&mut self, input: &RowInput<'_, R>, eliminated: bool) {
        kernel!(R, || {
            for (k, block) in input.compiled.equalities.iter().enumerate().filter(|(_, block)| block.eliminated == eliminated) {
                if !input.active_equalities.has_rows(k) {
                    block.equalities.iter().for_each(|equality| self.velocity.scalar_impulse[equality.impulses()].fill(R::zero()));
                    continue;
                }
                // The test for nearly dependent rows needs the scales of their entries, which cost as much as the rows. A block
                // computes the scales from the first step on in which it needs them. The rows are the same with and without scales.
                while !self.add_block(input, block, self.builder.needs_scales[k]) {
                    self.builder.needs_scales[k] = true;
                }
            }
        })
    }

    /// Adds the rows of a block of equalities.
    ///
    /// If `with_scales` is true, the function also computes the scales of the entries, which the test for dependent rows may need. If the
    /// test needs them and `with_scales` is false, the function adds nothing and returns false. Otherwise it returns true.
    #[inline(always)]
    fn add_block(&mut self, input: &RowInput<'_, R>, block: &EqualityBlock<R::Scalar>, with_scales: bool) -> bool {
        let start = self.problem.rows.scalars.len();
        self.builder.sizes.clear();
        self.builder.entry_scales.clear();
        self.builder.velocity_terms.clear();
        let scales = self.builder.velocity_scales.len();
        for equality in &block.equalities {
            self.add_equality(input, block, equality, with_scales);
        }
        if !block.hard {
            return true;
        }
        // The largest position correction of the block, as a distance, adds compliance to all its rows. A long correction rotates the other
        // rows. The linearised solve neglects that, and would miss their targets at the end of the step.
        let displacement = self.builder.velocity_terms.iter().fold(R::zero(), |most, terms| most.max(terms[2].abs())) * input.h;
        let split = input.options.stabilization == Stabilization::Split;
        let damping = if split { R::of(DAMPING) + displacement * R::of(1.0 / CORRECTION_ARM) } else { R::zero() };
        let entries = EntryScales { squares: &mut self.builder.entry_scales, coefficients: &mut self.builder.coefficient_scales };
        let decided = self.problem.rows.scalars.orthogonalise(
            start..start + block.rows,
            RowScales {
                lengths: &self.builder.sizes,
                velocities: &mut self.builder.velocity_scales[scales..],
                entries: with_scales.then_some(entries),
            },
            &mut self.builder.velocity_terms,
            #[inline(always)]
            |row, [_, _, correction]| {
                // Baumgarte's position correction is not damped here: see `has_implausible_bias` of stage 8.
                *correction = row.damp_correction(damping, *correction);
            },
        );
        if decided {
            self.set_equality_offsets(input, start, scales);
        } else {
            self.problem.rows.scalars.truncate(start);
            self.velocity.impulses.scalars.truncate(start);
            self.problem.impulse_indices.truncate(start);
            self.builder.velocity_scales.truncate(scales);
        }
        decided
    }

    /// Adds position corrections and curvature terms to the offsets of the rows of a block, from row `start` on. Before the call, the
    /// offsets are J v_free.
    ///
    /// The work of a row's impulse is (t^2 - (J v)^2) / 2 G for the target velocity t = J v+. The curvature term of t is therefore at most
    /// the speed |J v| before the step, and adds no energy. Without this bound, the term could be arbitrarily large where a loop
    /// straightens. The offset of an immovable (linearly dependent) row becomes zero if it is at most the rounding error of the row's
    /// velocity. A larger offset remains, and the residual contains it. `scales` is the index in `velocity_scales` of the first row's
    /// scale.
    #[inline(always)]
    fn set_equality_offsets(&mut self, input: &RowInput<'_, R>, start: usize, scales: usize) {
        let rounding = R::of(velocity_rounding::<R>().powi(2));
        for (k, &[curve, before, correction]) in self.builder.velocity_terms.iter().enumerate() {
            let row = &mut self.problem.rows.scalars[start + k];
            let most = before.abs();
            let uncorrected = row.g + curve.clamp(-most, most);
            let none = row.immovable.and(uncorrected.square().le(rounding * self.builder.velocity_scales[scales + k]));
            let uncorrected = R::select(none, R::zero(), uncorrected);
            [row.g, row.position_g] = stabilized(input, uncorrected, uncorrected + correction);
            let lambda = &mut self.velocity.impulses.scalars[start + k];
            *lambda = R::select(row.active, *lambda, R::zero());
        }
    }

    #[inline(always)]
    fn add_equality(
        &mut self,
        input: &RowInput<'_, R>,
        block: &EqualityBlock<R::Scalar>,
        equality: &CompiledEquality<R::Scalar>,
        with_scales: bool,
    ) {
        self.builder.use_dofs(&equality.dofs);
        let numbers = input.compiled.params.equality(equality.index);
        match &equality.rows {
            EqualityRows::Points { frames, turn, .. } => {
                let rows = self.builder.connect_points(input, *frames, [numbers.first, numbers.second], true);
                self.push_rows::<3>(input, block, equality, 0, &rows, with_scales);
                if let Some(turn) = turn {
                    self.builder.use_dofs(&equality.dofs);
                    let rows = self.builder.align(input, *frames, &[numbers.orientation, splat(*turn)], numbers.weight);
                    self.push_rows::<3>(input, block, equality, 3, &rows, with_scales);
                }
            }
            EqualityRows::Coupling { first, second } => {
                let rows = self.builder.couple_joints(input, first, second.as_ref(), numbers.polynomial);
                self.push_rows::<1>(input, block, equality, 0, &rows, with_scales);
            }
        }
    }

    /// Appends the first `N` components of `column` to the problem, as rows of an equality with the degrees of freedom of its block.
    /// `first` is the number of rows of the equality that the problem already has. `with_scales` is true if the scales of the entries are
    /// needed too.
    #[inline(always)]
    fn push_rows<const N: usize>(
        &mut self,
        input: &RowInput<'_, R>,
        block: &EqualityBlock<R::Scalar>,
        equality: &CompiledEquality<R::Scalar>,
        first: usize,
        rows: &EqualityJacobian<R>,
        with_scales: bool,
    ) {
        let (RowState { v_free, v, .. }, h) = (input.state, input.h);
        let acts = input.active_equalities.lanes(equality);
        let alive = input.alive.and(acts);
        let (mut free, mut before, mut speed) = ([R::zero(); 3], [R::zero(); 3], [R::zero(); 3]);
        for &d in &self.builder.dofs {
            let d = d as usize;
            free = add_scaled(free, self.builder.column[d], v_free[d]);
            before = add_scaled(before, self.builder.column[d], v[d]);
            speed = add_scaled(speed, self.builder.scales[d], v_free[d].square());
        }
        self.builder.half_solve::<N>(input.compiled, input.mass);
        if with_scales {
            self.builder.add_fill_scales::<N>(input.compiled, input.mass);
        }
        self.builder.use_block_dofs(block, equality);
        // Eliminated equalities are orthogonal to one another, so that none is eliminated from another.
        if block.eliminated {
            self.builder.coupled.clear();
        } else {
            self.builder.couple(input);
        }
        let correction = self.correct(input, rows, alive);
        let mut laws = [RowLaw { g: [R::zero(); 2], compliance: None, exists: alive, bounds: unbounded() }; N];
        let mut g = [[R::zero(); 2]; N];
        for k in 0..N {
            laws[k].g = [free[k]; 2];
            if let Some(spring) = &equality.spring {
                let (error, before, free, gram) = (rows.error[k], before[k], free[k], self.builder.gram(input.mass, k));
                laws[k] = spring_law(input, spring, SpringRow { error, before, free, gram, acts: alive });
                laws[k].exists = laws[k].exists.and(acts);
            }
            g[k] = laws[k].g;
        }
        let lengths = self.builder.eliminate(&self.problem.rows, input.mass, &mut g);
        let mut mobility = R::zero();
        for k in 0..N {
            mobility += match lengths {
                Some([before, _]) => before[k],
                None => self.builder.gram(input.mass, k),
            };
        }
        mobility = mobility * R::of(1.0 / N as f64) + rows.bodies;
        for k in 0..N {
            let lengths = lengths.map(|[before, after]| [before[k], after[k]]);
            self.push_row(input.mass, [k, equality.impulse_index + first + k], R::one(), &RowLaw { g: g[k], ..laws[k] }, lengths);
            self.problem.rows.scalars.set_mobility(mobility);
            if equality.spring.is_some() {
                self.problem.rows.scalars.set_position_offset(g[k][1]);
            }
            self.builder.sizes.push(rows.size);
            if block.hard {
                self.builder.velocity_scales.push(speed[k]);
            }
            if with_scales {
                let (scales, inv_d) = (&self.builder.scales, &input.mass.inv_d);
                for &d in &block.dofs {
                    self.builder.entry_scales.push(scales[d as usize][k] * inv_d[d as usize]);
                }
            }
            let terms = [rows.kappa[k] * h * R::of(0.5), before[k], correction[k]];
            self.builder.velocity_terms.push(array!(|i| R::select(acts, terms[i], R::zero())));
        }
    }

    /// Position correction of an equality as biases of its rows, m/s. The correction is a rate times the position error, with a bounded
    /// speed. The function also marks the lanes of `alive` that have a position error.
    #[inline(always)]
    fn correct(&mut self, input: &RowInput<'_, R>, rows: &EqualityJacobian<R>, alive: R::Mask) -> V3<R> {
        let RowInput { options, h, .. } = *input;
        let middle = if input.in_the_middle { 0.125 } else { 0.0 };
        let error = sub(rows.error, scale(rows.kappa, h * h * R::of(middle)));
        let length = norm(error);
        let wrong = length.gt(R::of(NEGLIGIBLE_ERROR));
        self.note_corrections(input, alive.and(wrong));
        let most = R::of(options.max_correction_speed) / R::select(wrong, length, R::one());
        let rate = R::of(options.baumgarte) / h;
        scale(error, R::select(wrong, rate.min(most), rate))
    }
}

/// Inputs of the row of a spring: position error, velocity before the step, velocity without constraints, and diagonal entry of G.
#[derive(Clone, Copy)]
pub(crate) struct SpringRow<R: Real> {
    pub(crate) error: R,
    pub(crate) before: R,
    pub(crate) free: R,
    pub(crate) gram: R,
    /// Lanes in which the spring exerts a force: a tendon's spring only while it is stretched or shortened beyond its rest lengths.
    /// Damper and inertia act in all lanes.
    pub(crate) acts: R::Mask,
}

/// Law of the compliant row of a spring, damper and inertia, implicit in the velocity of the row.
///
/// Let k, d and a be stiffness, damping and inertia, e the position error, e_m its value in the middle of the step, and v the velocity of
/// the row. With the force -k e - d v - a v' of Euler's rule or the midpoint rule, the impulse is lambda = -Q v+ - P:
///
/// ```text
/// Euler      force at e + h v+, v+:                     Q = h^2 k + h d + a          P = h k e - a v
/// midpoint   force at e_m + h/4 (v+ - v), (v + v+)/2:   Q = h^2 k/4 + h d/2 + a      P = h k e_m + (h d/2 - h^2 k/4 - a) v
/// ```
///
/// so v+ + lambda/Q + P/Q = 0: a row of compliance 1/Q. Both rules are stable for any stiffness. The mass matrix keeps the sparsity of the
/// tree; k J^T J in it would couple all joints of a tendon.
///
/// The midpoint rule does not damp oscillations that are too fast for the step. Stiff springs therefore use a mixture of both rules, with
/// the weight s = z^2 / (1 + z^2) of Euler's rule and z = G (h^2 k/4 + h d/2). This keeps the second order.
#[inline(always)]
pub(crate) fn spring_law<R: Real>(input: &RowInput<'_, R>, spring: &Spring<R::Scalar>, row: SpringRow<R>) -> RowLaw<R> {
    let RowInput { h, in_the_middle, state: RowState { alive, .. }, .. } = *input;
    let k = R::select(row.acts, R::splat(spring.stiffness) * h, R::zero());
    let (d, a) = (R::splat(spring.damping) * h, R::splat(spring.inertia));
    let (quarter, half) = (h * k * R::of(0.25), d * R::of(0.5));
    let (mut late, mut early) = (R::one(), R::zero());
    if in_the_middle {
        let z = (row.gram * (quarter + half)).square();
        late = R::select(z.is_finite(), z / (R::one() + z), R::one());
        early = R::one() - late;
    }
    let q = quarter * (R::one() + R::of(3.0) * late) + half * (R::one() + late) + a;
    let p = k * row.error + ((half - quarter) * early - a) * row.before;
    let exists = alive.and(q.gt(R::zero()));
    let compliance = R::one() / R::select(exists, q, R::one());
    RowLaw { g: [row.free + p * compliance; 2], compliance: Some(compliance), exists, bounds: unbounded() }
}

/// Whether the degree of freedom `dof` moves the frame `frame`.
#[inline(always)]
pub(crate) fn moves<S: Scalar>(compiled: &ModelStructure<S>, frame: usize, dof: usize) -> bool {
    compiled.moved_dofs[frame][dof / 64] >> (dof % 64) & 1 == 1
}

/// Angular part of the velocity or acceleration in `links`, one for every link, of the link with the frame `frame`; zero for the world and
/// mocap bodies.
#[inline(always)]
pub(crate) fn angular_of_frame<R: Real>(links: &[V6<R>], frame: usize) -> V3<R> {
    if frame == 0 || frame > links.len() { zero() } else { angular(&links[frame - 1]) }
}
