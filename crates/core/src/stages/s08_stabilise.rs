//! Stage 8: corrects positions after the velocity solve.
//!
//! A second solve of the same rows, without restitution, finds the velocity that just closes every gap and removes a part of every overlap.
//! Only the positions use this velocity, so it adds no kinetic energy. [`stabilise`] implements this split form. Baumgarte's method instead
//! corrects positions through a bias of the velocity solve, except in steps in which [the bias is implausible](has_implausible_bias).
//!
//! Position targets may be infeasible: contradicting overlaps, a weld out of reach, or a contact whose normal goes through the axis of a
//! hinge. The targets are therefore damped ([`stepper_solve::PositionRows::damp`]), and the correction of each island is bounded. A lane is
//! marked infeasible if the impulses of the correction prove that no motion within the bounds meets its targets (Farkas' lemma). It is also
//! marked if no impulse can move a row with a target above 1 cm/s.

use stepper_real::{Mask, Real, Scalar, kernel};
use stepper_solve::{Damping, Iterate, Reference, Settings, System};

use crate::collision::contact_set::Contacts;
use crate::compile::{LaneModel, ModelStructure};
use crate::constraints::islands::Islands;
use crate::constraints::{ConstraintProblem, ContactSlot, PositionSolution, VelocitySolution};
use crate::dynamics::inertia::MassMatrix;
use crate::dynamics::kinematics::displace;
use crate::math::lanes::each_of;
use crate::math::spatial::*;
use crate::model::JointKind;
use crate::options::{Solver, StepSettings};
use crate::tuning::{
    BAUMGARTE_LIMIT, CORRECTION_ARM, CORRECTION_ITERATIONS, CORRECTION_NEWTON_STEPS, CORRECTION_NEWTON_THRESHOLD, CORRECTION_TOLERANCE,
    DAMPING, MAX_CORRECTION_ROTATION, MAX_REBOUND_SPEED_RATIO, MAX_SPEED_RATIO, MIN_UNMET_TARGET, NEGLIGIBLE_CORRECTION,
};

/// Lanes whose position targets are proven infeasible, and the size of the contradiction.
#[derive(Clone, Copy, Debug)]
pub struct Infeasible<R: Real> {
    /// Lanes in which no motion within the bounds of a position correction meets the position targets.
    pub lanes: R::Mask,
    /// Largest velocity by which a constraint misses its position target in these lanes, m/s or rad/s; 0 in the other lanes.
    pub unmet: R,
}

impl<R: Real> Infeasible<R> {
    /// No lanes.
    #[inline(always)]
    pub fn none() -> Self {
        Self { lanes: R::Mask::splat(false), unmet: R::zero() }
    }
}

/// Bounds of the speed of a position correction (displacement divided by the time step).
#[derive(Clone, Copy, Debug)]
struct Bounds<R> {
    /// Largest speed of a translation, m/s.
    shift: R,
    /// Largest speed of a rotation, rad/s.
    turn: R,
}

impl<R: Real> Bounds<R> {
    #[inline(always)]
    fn new(options: &StepSettings, h: R) -> Self {
        let shift = R::of((MAX_SPEED_RATIO * options.max_correction_speed).max(1e-9));
        Self { shift, turn: (shift * R::of(1.0 / CORRECTION_ARM)).min(R::of(MAX_CORRECTION_ROTATION) / h) }
    }

    /// Bounds of a plausible velocity change by constraints, independent of the time step. A larger change is attributed to Baumgarte's
    /// correction.
    #[inline(always)]
    fn plausible(options: &StepSettings) -> Self {
        let shift = R::of((BAUMGARTE_LIMIT * MAX_SPEED_RATIO * options.max_correction_speed).max(1e-9));
        Self { shift, turn: shift * R::of(1.0 / CORRECTION_ARM) }
    }

    /// Bound of degree of freedom `dof` of a joint, m/s or rad/s. In a free joint, translations come first.
    #[inline(always)]
    fn of(&self, kind: JointKind, dof: usize) -> R {
        if kind == JointKind::Slide || kind == JointKind::Free && dof < 3 { self.shift } else { self.turn }
    }
}

/// Inputs of the position solve.
pub struct PositionInput<'a, R: Real> {
    /// Compiled model.
    pub compiled: &'a LaneModel<R>,
    /// Settings of the step.
    pub options: &'a StepSettings,
    /// Constraint problem of the step.
    pub problem: &'a ConstraintProblem<R>,
    /// Factors of the mass matrix.
    pub mass: &'a MassMatrix<R>,
    /// Contacts of the step.
    pub contacts: &'a Contacts<R>,
    /// Lanes whose positions are corrected.
    pub lanes: R::Mask,
    /// Lanes in which a contact bounces. Their corrected position is the one without the rebound. [`MAX_REBOUND_SPEED_RATIO`] bounds their
    /// correction, instead of `Bounds`.
    pub rebounding: R::Mask,
    /// Time step, s.
    pub h: R,
}

/// Corrects the configuration `position.q`, which has advanced with `velocity.v`, and writes the result to `position.q_corrected`. Returns
/// the lanes whose position errors provably cannot be removed, and stores the worst constraint of these lanes in `velocity.worst`.
///
/// The caller, `correct_positions`, has copied the rows of the velocity solve and the free velocity. The solve starts from the impulses of
/// the velocity solution and overwrites them. It finds the velocity that, added to `velocity.v`, removes position errors. The function
/// limits the speed of this correction and writes it to `position.correction`.
#[inline(always)]
pub fn stabilise<R: Real>(
    input: &PositionInput<'_, R>,
    velocity: &mut VelocitySolution<R>,
    position: &mut PositionSolution<R>,
) -> Infeasible<R> {
    let PositionInput { compiled, options, lanes, .. } = *input;
    damp_rows(input, &velocity.impulses, position);
    let [sweeps, newton] = options.iteration_limits();
    let accuracy_factor = options.accuracy_factor();
    let tolerance = (CORRECTION_TOLERANCE / accuracy_factor).max(options.tolerance);
    let sweeps = sweeps.min((CORRECTION_ITERATIONS * accuracy_factor) as u32);
    let newton = newton.min((CORRECTION_NEWTON_STEPS * accuracy_factor) as u32);
    let rough = CORRECTION_NEWTON_THRESHOLD / accuracy_factor.powi(2);
    let newton = if options.solver == Solver::Newton { options.iterations } else { newton };
    let threshold = if options.solver == Solver::Newton { tolerance } else { tolerance.max(rough) };
    let settings = Settings { newton_threshold: R::of(threshold), ..Settings::new(sweeps, newton, R::of(tolerance)) };
    let VelocitySolution { impulses, v: v_next, newton, worst, islands, .. } = velocity;
    let PositionSolution { rows, reference, v_free, correction: out, scratch, q, q_corrected, .. } = position;
    let system = rows.system(&input.problem.rows);
    // The residual of a correction is not reported. The solve need not end with its evaluation, unless the tolerance is smaller than the
    // default.
    let system = if tolerance < CORRECTION_TOLERANCE { system } else { system.without_final_residual() };
    stepper_solve::solve(system, impulses, settings, lanes, newton);
    let bounds = Bounds::new(options, input.h);
    let (fast, lacking, unmet) = kernel!(R, || {
        find_motion(input, impulses, [v_free, v_next], out);
        let rebounding = lanes.and(input.rebounding);
        if rebounding.any() {
            bound_rebound(input, [v_free, v_next], out, scratch, rebounding);
        }
        let unmet = system.shortfall(impulses, reference).max(system.immovable_target());
        let fast = lanes.and_not(input.rebounding).and(excess(compiled, out, bounds).gt(R::one()));
        (fast, lanes.and(unmet.gt(R::of(MIN_UNMET_TARGET))), unmet)
    });
    let mut infeasible = Infeasible::none();
    if lacking.any() {
        infeasible.lanes = prove_infeasible(input, system, impulses, reference, lacking, bounds);
        infeasible.unmet = R::select(infeasible.lanes, unmet, R::zero());
        worst.find(input.problem, input.contacts, infeasible.lanes, |lane| system.worst_position_target(impulses, reference, lane));
    }
    if fast.any() {
        bound_islands(compiled, system, islands, fast, bounds, out);
    }
    displace(compiled, q, out, input.h, q_corrected);
    infeasible
}

/// Lanes in which Baumgarte's bias, a target velocity in proportion to the position error, makes velocities implausible.
///
/// There, constraints change a velocity by more than four times the bound of a position correction, or a row that no motion can change has
/// a target above 1 cm/s. `change` is the velocity change by all constraints, nv.
pub(crate) fn has_implausible_bias<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    problem: &ConstraintProblem<R>,
    change: &[R],
) -> R::Mask {
    kernel!(R, || {
        let unmet = System::from(&problem.rows).immovable_target().gt(R::of(MIN_UNMET_TARGET));
        problem.biased.and(excess(compiled, change, Bounds::plausible(options)).gt(R::one()).or(unmet))
    })
}

/// Converts the rows in `position`, copies of those of the velocity solve, to the rows of the position solve.
///
/// Position rows are damped, and have position errors as targets. The damping acts on the difference from the impulses of the velocity
/// solution.
#[inline(always)]
pub(crate) fn damp_rows<R: Real>(input: &PositionInput<'_, R>, impulses: &Iterate<R>, position: &mut PositionSolution<R>) {
    let damping =
        Damping { ratio: R::of(DAMPING), bending: input.h * R::of(1.0 / CORRECTION_ARM), negligible: R::of(NEGLIGIBLE_CORRECTION) };
    let PositionSolution { rows, unconstrained_mobility, reference, .. } = position;
    kernel!(R, || {
        rows.exchange_offsets();
        find_unconstrained_mobility(input, unconstrained_mobility);
        rows.damp(&input.problem.rows, impulses, damping, unconstrained_mobility, reference);
    });
}

/// Computes the velocity that the position solve adds to that of the velocity solution, into `position.correction`. Returns the largest
/// ratio of a joint's velocity to its bound; above 1, [`stabilise`] slows the correction down.
pub(crate) fn find_correction<R: Real>(
    input: &PositionInput<'_, R>,
    velocity: &VelocitySolution<R>,
    position: &mut PositionSolution<R>,
) -> R {
    let bounds = Bounds::new(input.options, input.h);
    let PositionSolution { v_free, correction, .. } = position;
    kernel!(R, || {
        find_motion(input, &velocity.impulses, [v_free, &velocity.v], correction);
        excess(input.compiled, correction, bounds)
    })
}

/// Computes the velocity that the impulses of the position solve add to `v_next`, without bounds, into `out`.
#[inline(always)]
fn find_motion<R: Real>(input: &PositionInput<'_, R>, impulses: &Iterate<R>, [v_free, v_next]: [&[R]; 2], out: &mut [R]) {
    out.copy_from_slice(&impulses.w);
    input.mass.unscale(input.compiled, out);
    for i in 0..input.compiled.nv {
        out[i] = (v_free[i] + out[i]) - v_next[i];
    }
}

/// Limits the correction `v` in the lanes `lanes` to [`MAX_REBOUND_SPEED_RATIO`] times the larger of the two `velocities`. Velocities are
/// compared by the square root of the kinetic energy.
///
/// Friction in a corner can make the correction enormous. The function overwrites `scratch`.
#[inline(always)]
fn bound_rebound<R: Real>(input: &PositionInput<'_, R>, velocities: [&[R]; 2], v: &mut [R], scratch: &mut [R], lanes: R::Mask) {
    let mut energy = |v: &[R]| input.mass.kinetic_energy(input.compiled, v, scratch);
    let most = energy(velocities[0]).max(energy(velocities[1])) * R::of(MAX_REBOUND_SPEED_RATIO.powi(2));
    let square = energy(v);
    let lanes = lanes.and(square.gt(most));
    let factor = (most / R::select(lanes, square, R::one())).sqrt();
    for v in v {
        *v = R::select(lanes, *v * factor, *v);
    }
}

/// Largest ratio of a joint's velocity in `v` to its bound.
#[inline(always)]
fn excess<R: Real>(compiled: &ModelStructure<R::Scalar>, v: &[R], bounds: Bounds<R>) -> R {
    let mut most = R::zero();
    for joint in &compiled.joints {
        most = most.max(excess_of(joint.kind, &v[joint.v..joint.v + joint.kind.nv()], bounds));
    }
    most
}

/// Ratio of the velocity `v` of one joint to its bound, independent of the direction of its translation or the axis of its rotation.
#[inline(always)]
fn excess_of<R: Real>(kind: JointKind, v: &[R], bounds: Bounds<R>) -> R {
    match kind {
        JointKind::Free => (norm([v[0], v[1], v[2]]) / bounds.shift).max(norm([v[3], v[4], v[5]]) / bounds.turn),
        JointKind::Ball => norm([v[0], v[1], v[2]]) / bounds.turn,
        JointKind::Slide | JointKind::Hinge => v[0].abs() / bounds.of(kind, 0),
    }
}

/// Scales down the correction velocity `v` in the lanes `lanes`, in islands with a joint that exceeds its bound. An island is a set of
/// bodies that rows connect.
///
/// The whole island gets the same factor, so that loops stay closed.
#[cold]
fn bound_islands<R: Real>(
    compiled: &ModelStructure<R::Scalar>,
    system: System<'_, R>,
    islands: &mut Islands,
    lanes: R::Mask,
    bounds: Bounds<R>,
    v: &mut [R],
) {
    for lane in each_of(lanes.bits()) {
        islands.find(compiled, system, lane);
        for joint in &compiled.joints {
            let excess = excess_of(joint.kind, &v[joint.v..joint.v + joint.kind.nv()], bounds);
            islands.raise_max(compiled.dofs[joint.v].tree, excess.lane(lane).to_f64());
        }
        let mut part = |dof: usize| {
            let most = islands.of_tree(compiled.dofs[dof].tree).most;
            if most > 1.0 { 1.0 / most } else { 1.0 }
        };
        for joint in &compiled.joints {
            let factor = R::of(part(joint.v));
            for v in &mut v[joint.v..joint.v + joint.kind.nv()] {
                v.set_lane(lane, (*v * factor).lane(lane));
            }
        }
    }
}

/// Lanes of `lanes` in which the impulses of the correction prove that no motion within the bounds meets the position targets.
#[cold]
fn prove_infeasible<R: Real>(
    input: &PositionInput<'_, R>,
    system: System<'_, R>,
    impulses: &Iterate<R>,
    reference: &mut Reference<R>,
    lanes: R::Mask,
    bounds: Bounds<R>,
) -> R::Mask {
    kernel!(R, || {
        let lack = system.witness(impulses, reference);
        let momentum = &mut reference.momentum;
        input.mass.momentum(input.compiled, momentum);
        let mut most = R::zero();
        for joint in &input.compiled.joints {
            for k in 0..joint.kind.nv() {
                most += momentum[joint.v + k].abs() * bounds.of(joint.kind, k);
            }
        }
        // A contact that no degree of freedom moves along its normal cannot be corrected by any motion.
        let blocked = system.immovable_target().gt(R::of(MIN_UNMET_TARGET));
        lanes.and(blocked.or(lack.gt(most)))
    })
}

/// Computes for every contact the sum of the inverse masses of its two bodies, as if they were free, 1/kg; 0 for scalar rows. The solver
/// adds this number to the contact's mobility, which scales the damping of the contact.
#[inline(always)]
fn find_unconstrained_mobility<R: Real>(input: &PositionInput<'_, R>, unconstrained_mobility: &mut Vec<R>) {
    let compiled = input.compiled;
    unconstrained_mobility.clear();
    unconstrained_mobility.resize(input.problem.rows.scalars.len(), R::zero());
    for &ContactSlot { slot: k, lanes } in &input.problem.contact_slots {
        let mut mobility = R::zero();
        for (pair, lanes) in input.contacts.pairs(k, lanes.bits()) {
            let geoms = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
            let free = compiled.mobility(compiled.geoms[geoms[0]].frame) + compiled.mobility(compiled.geoms[geoms[1]].frame);
            mobility = R::select(R::Mask::from_bits(lanes), free, mobility);
        }
        unconstrained_mobility.push(mobility);
    }
}
