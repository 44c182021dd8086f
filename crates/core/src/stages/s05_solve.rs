//! Stage 5: solves the constraint problem for impulses, and computes the residual.

use stepper_real::{Mask, Real, Scalar, kernel};
use stepper_solve::{Outcome, Settings, System, residual};

use crate::collision::contact_set::Contacts;
use crate::compile::LaneModel;
use crate::constraints::contact::redundant_supports::Clusters;
use crate::constraints::{ConstraintProblem, ContactSlot, VelocitySolution};
use crate::math::spatial::*;
use crate::options::{Solver, StepSettings};
use crate::tuning::{
    ESTIMATE_ERROR, ESTIMATE_ITERATIONS, IMPACT_TOLERANCE_RATIO, MAX_ESTIMATE_TOLERANCE, MAX_REST_TOLERANCE, MAX_ROUGH_MOTION,
    MIN_ROUGH_MOTION_OF_SEVERAL_TREES, MIN_TOLERANCE, REST_MOTION, ROUGH_ITERATIONS, SLIP_SPEED,
};

/// Solves the constraint problem in the lanes `lanes`, to the tolerance of the options or a smaller one. Afterwards, [`store_impulses`] can
/// store the impulses for the next step.
///
/// The tolerance of slow lanes is a fraction of the speed before the step, `v`. Otherwise a robot at rest would creep at the speed of the
/// tolerance.
#[inline(always)]
pub fn solve<R: Real>(
    options: &StepSettings,
    v: &[R],
    lanes: R::Mask,
    problem: &ConstraintProblem<R>,
    velocity: &mut VelocitySolution<R>,
    contacts: &Contacts<R>,
) -> Outcome<R> {
    let mut tolerance = tolerance(options, v, velocity.contact_groups.lanes());
    if !problem.impacts.is_empty() && !R::Scalar::IS_SINGLE {
        // Each impact of a step adds its error to the energy.
        let fine = R::of((IMPACT_TOLERANCE_RATIO * options.tolerance).max(MIN_TOLERANCE));
        tolerance = R::select(problem.impact_lanes(), tolerance.min(fine), tolerance);
    }
    solve_to(options, tolerance, lanes, problem, velocity, contacts)
}

/// Solves the constraint problem in the lanes `lanes` to a residual of `tolerance`, m/s.
#[inline(always)]
pub fn solve_to<R: Real>(
    options: &StepSettings,
    tolerance: R,
    lanes: R::Mask,
    problem: &ConstraintProblem<R>,
    velocity: &mut VelocitySolution<R>,
    contacts: &Contacts<R>,
) -> Outcome<R> {
    let [sweeps, newton_steps] = options.iteration_limits();
    let enough = R::of(options.tolerance);
    let settings = Settings { accepted_residual: enough, ..Settings::new(sweeps, newton_steps, tolerance) };
    let rows = &problem.rows;
    let VelocitySolution { impulses, newton, capture, .. } = velocity;
    // If the user requested the problem of a lane as bytes, it is stored with the impulses from which the solve starts.
    if let Some(lane) = capture.lane.take() {
        capture.bytes = System::from(rows).to_bytes(impulses, &settings, lane);
    }
    let outcome = stepper_solve::solve(rows, impulses, settings, lanes, newton);
    // Users can read the row with the largest residual of an unsolved lane.
    let unsolved = lanes.and_not(outcome.residual.le(enough));
    velocity.worst.update(problem, rows.into(), &velocity.impulses, contacts, [lanes, unsolved]);
    outcome
}

/// Stores the impulses of all rows, from which the solver starts in the next step. Those of contacts go to `contacts`, those of scalar rows
/// to the velocity solution.
#[inline(always)]
pub fn store_impulses<R: Real>(problem: &ConstraintProblem<R>, velocity: &mut VelocitySolution<R>, contacts: &mut Contacts<R>) {
    let ConstraintProblem { impulse_indices, contact_slots, rotation_scales, rows, .. } = problem;
    let VelocitySolution { impulses, scalar_impulse, .. } = velocity;
    kernel!(R, || {
        for (&impulse_index, &lambda) in impulse_indices.iter().zip(&impulses.scalars) {
            scalar_impulse[impulse_index] = lambda;
        }
        let mut rotation_scales = rotation_scales.iter();
        for (i, &ContactSlot { slot: k, lanes }) in contact_slots.iter().enumerate() {
            let lambda = impulses.contact_impulse(rows, i);
            contacts.data[k].impulse = select(lanes, [lambda[0], lambda[1], lambda[2]], contacts.data[k].impulse);
            if !contacts.torque.is_empty() {
                // A contact without rotation rows may have had a torque before: friction coefficients can be set between steps.
                let mut torque = zero();
                if lambda.len() > 3 {
                    let scale = rotation_scales.next().expect("lengths of every contact with rotation rows");
                    (0..lambda.len() - 3).for_each(|j| torque[j] = lambda[3 + j] * scale[j]);
                }
                contacts.torque[k] = select(lanes, torque, contacts.torque[k]);
            }
        }
    });
}

/// Distributes the load evenly over the contacts of each cluster of contact groups that sticks, in about one step in eight (see
/// [`crate::constraints::contact::redundant_supports`]). `v` is the velocity before the step. The function changes impulses, and no
/// velocity.
///
/// Lanes at rest are left out. They are solved so exactly that their loads do not drift, and the rounding of new impulses would exceed
/// their tolerance.
#[inline(always)]
pub fn share_sticking_loads<R: Real>(options: &StepSettings, v: &[R], problem: &ConstraintProblem<R>, velocity: &mut VelocitySolution<R>) {
    let VelocitySolution { impulses, contact_groups, .. } = velocity;
    let has_groups = contact_groups.lanes().and(problem.constrained);
    if has_groups.none() {
        return;
    }
    let tolerance = tolerance(options, v, has_groups);
    let moving = kernel!(R, || has_groups.and(tolerance.gt(R::of(MAX_REST_TOLERANCE * options.tolerance))));
    // Derivatives, which have a smaller tolerance, depend on which contact is nearest to slipping.
    let due = if options.accuracy_factor() > 1.0 { moving } else { contact_groups.due_lanes(problem, impulses, moving) };
    contact_groups.find_slips(problem, impulses, due, slip_speed(tolerance));
    contact_groups.share(Clusters::Sticking, problem, impulses, due, slip_speed(tolerance));
}

/// Speed above which a loaded contact of a redundant support slips after a solve to the residual `tolerance`, m/s.
#[inline(always)]
fn slip_speed<R: Real>(tolerance: R) -> R {
    kernel!(R, || tolerance.max(R::of(SLIP_SPEED)))
}

/// Distributes the load evenly over the contacts of each contact group that slips (see
/// [`crate::constraints::contact::redundant_supports`]). Lanes of `lanes` whose residual exceeds the tolerance of the options are left out.
/// `v` is the velocity before the step.
///
/// If a group rotates while it slips, the new loads change the velocity. The lanes of such groups are solved again, starting from the new
/// loads.
#[inline(always)]
pub fn share_slipping_loads<R: Real>(
    options: &StepSettings,
    v: &[R],
    lanes: R::Mask,
    problem: &ConstraintProblem<R>,
    velocity: &mut VelocitySolution<R>,
    contacts: &Contacts<R>,
    outcome: &mut Outcome<R>,
) {
    let VelocitySolution { impulses, contact_groups, saved_impulses, .. } = velocity;
    let has_groups = contact_groups.lanes();
    let solved = has_groups.and(lanes).and(outcome.residual.le(R::of(options.tolerance)));
    if solved.none() {
        return;
    }
    let tolerance = tolerance(options, v, has_groups);
    let slip_speed = slip_speed(tolerance);
    let slipping = contact_groups.find_slips(problem, impulses, solved, slip_speed);
    if slipping.none() {
        return;
    }
    saved_impulses.save(impulses, slipping);
    let redistributed = contact_groups.share(Clusters::Slipping, problem, impulses, slipping, slip_speed);
    if redistributed.none() {
        return;
    }
    let left = kernel!(R, || {
        // The sum over all impulses may differ by rounding from the scaled velocity change of the solve.
        impulses.compute_w(&problem.rows);
        saved_impulses.restore(impulses, redistributed.not());
        residual(&problem.rows, impulses)
    });
    let before = outcome.residual;
    outcome.residual = R::select(redistributed, left, before);
    let moved = redistributed.and_not(left.le(before.max(tolerance)));
    if moved.any() {
        let repeated = solve_to(options, tolerance, moved, problem, velocity, contacts);
        outcome.replace(&repeated, moved);
    }
}

/// Predictor of this step's constraint impulses, before velocity-dependent forces are evaluated.
#[derive(Clone, Copy, Debug)]
pub struct ImpulsePredictor<R: Real> {
    /// Lanes that move. Lanes at rest keep the impulses of the last step as their prediction.
    moving: R::Mask,
    /// Moving lanes in which [`ROUGH_ITERATIONS`] Gauss-Seidel iterations from zero impulses predict accurately enough. The other moving
    /// lanes iterate from the impulses of the last step to `tolerance`.
    rough: R::Mask,
    /// Change of the rows' velocities in an iteration at which moving lanes outside `rough` stop iterating, m/s.
    tolerance: R,
}

impl<R: Real> ImpulsePredictor<R> {
    /// Creates the predictor for a step of `h` seconds from the velocity `v`.
    ///
    /// Rough predictions are accurate enough unless [`StepSettings::accuracy_factor`] exceeds 1: the free velocity may have an error of
    /// [`ESTIMATE_ERROR`]. Otherwise the predictor iterates to a tolerance in all moving lanes. The option [`Solver::Newton`] has the same
    /// effect. With rough predictions, it still iterates to a tolerance in lanes that move too little or too far
    /// ([`MIN_ROUGH_MOTION_OF_SEVERAL_TREES`], [`MAX_ROUGH_MOTION`]), and in lanes with a contact group. A contact group has three or more
    /// contacts between two bodies, one of which floats freely.
    #[inline(always)]
    pub fn new(compiled: &LaneModel<R>, options: &StepSettings, v: &[R], h: R, velocity: &VelocitySolution<R>) -> Self {
        let error = ESTIMATE_ERROR / options.accuracy_factor();
        let never_rough = error < ESTIMATE_ERROR || options.solver == Solver::Newton;
        let least = if compiled.ntree > 1 { MIN_ROUGH_MOTION_OF_SEVERAL_TREES } else { REST_MOTION };
        kernel!(R, || {
            let displacement = h * fastest(v);
            let slow = (displacement * R::of(MAX_ESTIMATE_TOLERANCE)).le(R::of(error));
            let tolerance = R::select(slow, R::of(MAX_ESTIMATE_TOLERANCE), R::of(error) / R::select(slow, R::one(), displacement));
            let moving = is_moving(displacement);
            let rough =
                displacement.gt(R::of(least)).and(displacement.lt(R::of(MAX_ROUGH_MOTION))).and_not(velocity.contact_groups.lanes());
            Self { moving, rough: if never_rough { R::Mask::splat(false) } else { rough }, tolerance }
        })
    }

    /// Predicts the impulses in the lanes `lanes`, into `velocity.impulses`. Before the call, these are the impulses of the last step.
    #[inline(always)]
    pub fn make(&self, options: &StepSettings, lanes: R::Mask, problem: &ConstraintProblem<R>, velocity: &mut VelocitySolution<R>) {
        let VelocitySolution { impulses, saved_impulses, contact_groups, .. } = &mut *velocity;
        // `choose_start` may restore these impulses after the prediction.
        saved_impulses.save(impulses, lanes.and(self.rough.or(contact_groups.lanes())));
        self.repeat(options, lanes, problem, velocity);
    }

    /// Repeats the prediction in the lanes `lanes`, after more contacts have become active. It starts from the present impulses or, in
    /// rough lanes, from zero.
    #[inline(always)]
    pub fn repeat(&self, options: &StepSettings, lanes: R::Mask, problem: &ConstraintProblem<R>, velocity: &mut VelocitySolution<R>) {
        let (rows, impulses) = (&problem.rows, &mut velocity.impulses);
        let [rough, precise] = [lanes.and(self.rough), lanes.and_not(self.rough)];
        if rough.any() {
            stepper_solve::gauss_seidel::sweep_from_zero(rows, impulses, ROUGH_ITERATIONS, rough);
        }
        if precise.any() {
            // Rounding may prevent a small tolerance from being met, so that the iteration limit of the solver applies too.
            let limit = f64::from(options.iterations).max(ESTIMATE_ITERATIONS);
            let sweeps = (ESTIMATE_ITERATIONS * options.accuracy_factor()).min(limit) as u32;
            let settings = stepper_solve::gauss_seidel::SweepSettings { sweeps, tolerance: self.tolerance };
            stepper_solve::gauss_seidel::estimate(rows, impulses, settings, precise, precise.and(self.moving));
        }
    }

    /// Selects the impulses from which the solve of the lanes `lanes` starts: those of the prediction or of the last step.
    ///
    /// Lanes with a contact group start from the impulses of the last step, so that the load of the group stays distributed as then. So do
    /// lanes with a rough prediction that is no closer to the solution than the impulses of the last step.
    #[inline(always)]
    pub fn choose_start(&self, lanes: R::Mask, problem: &ConstraintProblem<R>, velocity: &mut VelocitySolution<R>) {
        let VelocitySolution { impulses, saved_impulses, contact_groups, .. } = velocity;
        let rough = lanes.and(self.rough);
        let previous_is_as_close = if rough.any() { rough.and(saved_impulses.is_as_close(&problem.rows, impulses)) } else { rough };
        saved_impulses.restore(impulses, lanes.and(contact_groups.lanes()).or(previous_is_as_close));
    }
}

/// Lanes whose impulses are predicted, because they move noticeably at the velocity `v`. The other lanes take the impulses of the last step
/// as their prediction.
pub(crate) fn is_estimated<R: Real>(v: &[R], h: R) -> R::Mask {
    kernel!(R, || is_moving(h * fastest(v)))
}

/// Lanes that are not at rest. `displacement` is the largest displacement of a degree of freedom within the step, m or rad.
#[inline(always)]
fn is_moving<R: Real>(displacement: R) -> R::Mask {
    displacement.gt(R::of(REST_MOTION))
}

/// Largest absolute velocity of a degree of freedom, rad/s or m/s.
#[inline(always)]
pub(crate) fn fastest<R: Real>(v: &[R]) -> R {
    let mut fastest = R::zero();
    for &v in v {
        fastest = fastest.max(v.abs());
    }
    fastest
}

/// Residual at which the solver stops in each lane, m/s: the option `rtol` times the speed of the lane's fastest degree of freedom.
/// The result is at least a bound for rounding errors, but never above the tolerance of the options.
///
/// An upper bound of the rounding error is 1e4 machine epsilons of a velocity of 1 m/s, in 32 bits 1e-3 m/s. With so large a residual,
/// heavy boxes would creep into light ones on which they lie. In 32 bits, lanes with a contact group (`has_groups`) therefore have a
/// smaller lower bound of 10 machine epsilons. In 64 bits their lower bound is [`MIN_TOLERANCE`], as in other lanes.
fn tolerance<R: Real>(options: &StepSettings, v: &[R], has_groups: R::Mask) -> R {
    kernel!(R, || {
        let epsilon = <R::Scalar as Scalar>::EPSILON.to_f64();
        let least = R::select(has_groups, R::of((10.0 * epsilon).max(MIN_TOLERANCE)), R::of(1e4 * epsilon));
        (fastest(v) * R::of(options.rtol)).max(least).min(R::of(options.tolerance))
    })
}
