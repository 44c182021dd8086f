//! Tuning constants of constraints, stages and integrators: thresholds, bounds and iteration counts, with units and, where measured, the
//! evidence.
//!
//! Users cannot change these numbers. [`crate::options`] has those that they can.

// Stage 5: the prediction of impulses before forces that depend on the velocity are computed. A rough prediction makes two Gauss-Seidel
// iterations from zero. Otherwise the prediction iterates to a tolerance.

/// Number of Gauss-Seidel iterations of a rough impulse prediction. Evidence: trajectories have the same errors as with a prediction that
/// iterates to a tolerance (docs/development/decisions/visible_state.md).
pub(crate) const ROUGH_ITERATIONS: u32 = 2;

/// Displacement per step below which models with several kinematic trees predict impulses by iterating to a tolerance, rad or m. Two
/// iterations from zero do not carry the load through a stack that hardly moves.
pub(crate) const MIN_ROUGH_MOTION_OF_SEVERAL_TREES: f64 = 1e-3;

/// Displacement per step above which impulses are predicted by iterating to a tolerance, rad or m. In such large motions, the error of a
/// rough prediction would change forces that depend on the velocity too much.
pub(crate) const MAX_ROUGH_MOTION: f64 = 0.3;

/// Largest number of Gauss-Seidel iterations of an impulse prediction that is not rough. The step multiplies it by
/// `StepSettings::accuracy_factor`, which is 1 unless the tolerance is below 1e-6 m/s.
pub(crate) const ESTIMATE_ITERATIONS: f64 = 16.0;

/// Largest error that the impulse prediction may cause in the free velocity (the velocity without constraint impulses), m/s. The step
/// divides it by `StepSettings::accuracy_factor`.
///
/// Let v be the velocity before a step of h seconds. An error d of the predicted velocity changes the velocity by inertial forces by about
/// `h |v| d`. The iterations therefore stop at `ESTIMATE_ERROR / (h |v|)`.
pub(crate) const ESTIMATE_ERROR: f64 = 1e-5;

/// Displacement within a step below which inertial forces are negligible, rad or m. Lanes with less motion count as at rest, and use the
/// impulses of the last step as prediction.
pub(crate) const REST_MOTION: f64 = 1e-6;

/// Upper bound of the change of the rows' velocities in an iteration at which an impulse prediction stops, m/s. Rough predictions make a
/// fixed number of iterations instead.
pub(crate) const MAX_ESTIMATE_TOLERANCE: f64 = 1e-2;

// Stage 5: the solve.

/// Lower bound of the residual at which the solver stops, m/s, in double precision. Single precision has larger bounds (`tolerance` in
/// `stages/s05_solve.rs`).
pub(crate) const MIN_TOLERANCE: f64 = 1e4 * f64::EPSILON;

/// Residual at which the solver stops in an impact, relative to the tolerance, in double precision. Evidence: with 1, the energy of 216
/// elastic spheres changes by 5e-3 of 34,500 J, and a touching cradle of Newton by 1e-4.
pub(crate) const IMPACT_TOLERANCE_RATIO: f64 = 1e-2;

/// Smallest limit of Newton steps at which lanes whose solve fails are solved a second time, without curvature terms.
///
/// With a smaller limit, lanes may be unsolved only because they lack iterations. They keep the residual of the problem with curvature
/// terms. The limit is the option `iterations`, by default 50; without Newton's method it is 0.
pub(crate) const MIN_NEWTON_STEPS_FOR_RETRY: u32 = 50;

/// Time by which contact detection looks ahead when finite differences compute a derivative, s. Contacts that open in a displaced state are
/// then still found. In this time, gravity alone closes gaps that are ten times as large as the displacement of the finite difference.
pub(crate) const LOOK_AHEAD: f64 = 1e-3;

// Servos whose force is at a bound.

/// Largest number of times that a step is solved again because a servo reaches or leaves a bound (force limit or torque-speed curve).
pub(crate) const SATURATION_PASSES: usize = 4;

// Contacts that approach each other within the step.

/// Approach speed below which a touching contact counts as resting, as a multiple of the solver tolerance. The speed of a solved contact at
/// rest is at most the tolerance.
pub(crate) const RESTING_SPEED_RATIO: f64 = 10.0;

/// Cosine above which two contacts of a pair of geoms count as coplanar. It is the cosine of the angle between their normals; 0.9999
/// corresponds to 0.8 degrees.
pub(crate) const COPLANAR_COSINE: f64 = 0.9999;

/// Largest time between the first touches of two pairs of geoms that still count as simultaneous. It is a fraction of the duration of the
/// motion in which the step searches for collisions.
pub(crate) const SIMULTANEOUS_FRACTION: f64 = 2e-3;

/// Ratio of a gap to the tunnelling distance of its pair above which a very fast body is allowed to close the whole gap within one step.
/// The tunnelling distance is the displacement above which two geoms may pass through each other.
///
/// A body that closes such a gap covers more than the tunnelling distance in half a step. The next step is then also evaluated at its
/// beginning, where the body is still ahead of the surface. If another contact slows the body down, that step is evaluated in its middle
/// instead. There too the body is still ahead of the surface.
pub(crate) const WIDE_GAP_RATIO: f64 = 3.0;

/// Number of solves that activate only the earliest collision of each kinematic tree. Later solves activate all pairs that collide within
/// the step. The count of a lane starts from zero again after a new assembly, after a check for impacts, and after impacts became
/// inelastic.
pub(crate) const EARLIEST_ONLY_PASSES: f64 = 6.0;

/// Largest number of times that a step repeats its impulse prediction because geoms collide in the predicted motion. The solves of stage 5
/// find the collisions that remain.
pub(crate) const MAX_PREDICTIONS: usize = 3;

/// Smallest overlap that counts as a collision in the motion with predicted impulses, as a fraction of the overlap in the linearised
/// motion. In the linearised motion, gaps change at a constant rate. Smaller overlaps may come from the error of the predicted impulses.
pub(crate) const PREDICTED_MARGIN: f64 = 0.1;

/// Ratio of an overlap in the predicted motion to the error of the predicted positions, up to which the collision counts as doubtful. The
/// overlap is the part beyond the overlap of resting contacts. The error is estimated as the residual of the prediction, m/s, times the
/// duration of the motion, s.
///
/// Evidence: of 2,500 bodies that slide over tiles without friction, 24 lose speed with 0, and none with 1 or more. With 2 the step of a
/// quadruped takes 2 % longer on boxes and 6 % on a height field, with 10 up to 15 %.
pub(crate) const PREDICTED_ERROR_RATIO: f64 = 2.0;

// Impacts, and the prediction of impulses.

/// Error of a generalized velocity above which a step with an impact is solved again, rad/s or m/s. The error comes from the jump of
/// inertial forces at the impact.
pub(crate) const MIN_VELOCITY_ERROR: f64 = 1e-5;

/// Ratio of a velocity change by impulses to the velocity change by smooth forces, above which a step counts as one with an impact.
/// Smaller ratios can be errors of the integration rule in smooth motion.
pub(crate) const MIN_IMPACT_RATIO: f64 = 10.0;

/// Largest velocity change by an impact for which the step is solved again, as a displacement per step, rad or m. After larger changes,
/// another solution would not be more accurate.
pub(crate) const MAX_RESOLVED_MOTION: f64 = 0.02;

/// Residual of the first solution, as a multiple of the tolerance, above which impacts become inelastic.
///
/// Evidence: in a corner without a solution the residual is 300 tolerances or more (`tests/laws/test_corners.py`). A heap that does not
/// converge within the iteration limit stays below 10.
pub(crate) const MAX_IMPACT_RESIDUAL: f64 = 100.0;

/// Largest number of evaluations at predicted times of the first impact. Newton's method needs several moves, because bodies
/// that pass each other obliquely approach on a curve.
pub(crate) const MAX_FLIGHT_CHANGES: usize = 4;

/// Largest time between an impact and its evaluation in the search for impacts, as a fraction of the step.
pub(crate) const PLACEMENT_TOLERANCE: f64 = 1e-3;

/// Shortest flight before an impact, as a fraction of the step; in 32 bits at least 16 roundings.
pub(crate) const SHORTEST_FLIGHT: f64 = 1e-9;

/// Duration with which the rows of an impact are computed, as a fraction of the step, so that all numbers stay finite in 32 bits. Forces do
/// not act.
pub(crate) const IMPACT_DURATION: f64 = 1.0 / 1_048_576.0;

/// Largest number of impacts that divide a step. Later ones in the same step do not divide it: Newton's law then applies as with Euler's
/// rule.
pub(crate) const MAX_IMPACTS: u32 = 512;

/// Largest speed of a position correction in a flight without an end in which a contact bounces, as a multiple of the largest speed in the
/// step. The correction replaces the rebound by the motion to the surface.
pub(crate) const MAX_REBOUND_SPEED_RATIO: f64 = 2.0;

/// Time after the end of the step until which an impact still belongs to it, as a fraction of the step.
pub(crate) const END_TOLERANCE: f64 = 1e-6;

// Steps in which the motion is too fast for the time step.

/// Joint rotation per step above which the step checks whether the corrector has converged, rad. The corrector computes inertial forces a
/// second time, at the predicted velocity.
pub(crate) const FAST_ROTATION: f64 = 0.5;

/// Joint rotation per step to which the fastest joint is slowed down, rad. The step scales the whole velocity of a lane whose motion was
/// too fast for the time step.
pub(crate) const MAX_ROTATION: f64 = 1.0;

/// Change of the velocity by the corrector above which the corrector has not converged, as a fraction of the largest velocity. The
/// corrector computes inertial forces a second time, at the predicted velocity.
pub(crate) const MAX_RELATIVE_CHANGE: f64 = 0.25;

/// Joint rotation per step below which no energy balance of the step is computed, rad. Evidence: chains that gain energy rotate by 0.07 and
/// more.
pub(crate) const BALANCE_ROTATION: f64 = 0.05;

/// Change of the velocity by the corrector above which the step computes its energy balance, as a fraction of the largest velocity. The
/// corrector computes inertial forces a second time, at the predicted velocity.
///
/// Evidence: robots under random control exceed it in less than 1 % of their steps. Chains of 5 to 40 links exceed it in the steps in which
/// they gain most energy.
pub(crate) const BALANCE_RELATIVE_CHANGE: f64 = 0.05;

/// Relative growth rate of the kinetic energy by the error of the step above which the step counts as unresolved, 1/s. Evidence: eleven
/// chains that gain more than a tenth within 0.1 s reach 10 to 300 / s. Twelve robots under random control at 2, 5 and 10 ms stay below 8 /
/// s without impacts.
pub(crate) const MAX_GROWTH_RATE: f64 = 10.0;

/// Relative growth of the kinetic energy by the error of a step above which the step counts as unresolved, at any time step. At small time
/// steps, [`MAX_GROWTH_RATE`] is the smaller limit.
pub(crate) const MAX_GROWTH: f64 = 0.1;

/// Change of the velocity by constraint impulses, as a fraction of the largest velocity, above which the step counts as an impact. The
/// limit on the growth of the kinetic energy is then twice as large.
///
/// Impulses act at one configuration of the step, so that the computed kinetic energy may grow or decrease. Evidence: growth rates are up
/// to 15 / s at a time step of 10 ms.
pub(crate) const IMPACT_RELATIVE_CHANGE: f64 = 0.1;

/// Joint rotation per step by constraint impulses above which the step counts as unresolved, rad.
pub(crate) const MAX_IMPULSE_ROTATION: f64 = std::f64::consts::PI;

/// Residual above which the impulses of a solve are unreliable, m/s. The step then limits the kinetic energy of the lane, in the same way
/// as after a motion that is too fast for the time step.
pub(crate) const MAX_TRUSTED_RESIDUAL: f64 = 1e-2;

/// Tolerance of the repeated solve in lanes with an ambiguous kinetic energy (`ambiguous_energy.rs`). It is a fraction of the largest
/// residual at which the impulses determine the kinetic energy.
pub(crate) const TARGET_RATIO: f64 = 0.1;

/// Increase of the largest joint rate in a step that turns a joint by more than [`MAX_IMPULSE_ROTATION`], as a fraction, above which the
/// step counts as unresolved.
///
/// The test is for rules without a corrector. Explicit forces that diverge multiply the rate in every step.
pub(crate) const MAX_RATE_GROWTH: f64 = 0.1;

/// Absolute value of a position (m, rad), velocity (m/s, rad/s) or activation above which a step counts as unresolved. MuJoCo resets an
/// environment at the same value (mjMAXVAL).
pub(crate) const MAX_STATE: f64 = 1e10;

// Stage 8: the position correction.

/// Residual to which a position correction is solved, m/s, if the tolerance is at least 1e-6 m/s. In a step it causes an error of a
/// fraction of a micrometre, which the next step corrects.
pub(crate) const CORRECTION_TOLERANCE: f64 = 1e-4;

/// Target speed of a constraint row in the position correction below which the row gets no damping, m/s or rad/s. Rounding alone makes
/// equal target speeds differ by 1e-14.
///
/// Evidence: if contacts without a correction are damped, they change the step when other contacts move them (1e-8 m for a quadruped).
pub(crate) const NEGLIGIBLE_CORRECTION: f64 = 1e-12;

/// Residual of a position correction above which Newton's method continues after Gauss-Seidel iterations, m/s.
///
/// Iterations alone can leave a hundredth of a radian per step where two limbs are jammed. Below the threshold, Newton's method costs more
/// than it corrects (humanoids under random control: 4 % of the step).
pub(crate) const CORRECTION_NEWTON_THRESHOLD: f64 = 1e-2;

/// Largest number of Gauss-Seidel iterations of a position correction if the tolerance is at least 1e-6 m/s. They start from the impulses
/// of stage 5.
pub(crate) const CORRECTION_ITERATIONS: f64 = 10.0;

/// Limit of Newton iterations of an island's position correction if the tolerance is at least 1e-6 m/s; the solver makes up to six times as
/// many.
///
/// Evidence, with an earlier Newton method: with 5 a gripper that begins within its palm stays there, with 6 it opens
/// (test_energy_gain.py). Of 120 jammed pairs of arms, 8 and 50 iterations leave the same overlaps after a second, within 0.1 %.
pub(crate) const CORRECTION_NEWTON_STEPS: f64 = 8.0;

/// Largest speed of a position correction, as a multiple of `max_correction_speed`. The speed divided by [`CORRECTION_ARM`] is the largest
/// angular velocity. By default the bounds are 5 m/s and 50 rad/s.
pub(crate) const MAX_SPEED_RATIO: f64 = 5.0;

/// Largest joint rotation by the position correction of one step, rad. The position solve uses linearised constraint rows, which are
/// invalid for larger rotations.
pub(crate) const MAX_CORRECTION_ROTATION: f64 = 1.0;

/// Largest velocity change by constraints that is plausible with Baumgarte's method, as a multiple of the largest speeds of a position
/// correction. By default the limits are 20 m/s and 200 rad/s.
pub(crate) const BAUMGARTE_LIMIT: f64 = 4.0;

/// Unmet part of a target velocity above which stage 8 tries to prove that the target positions are infeasible, m/s. A part is unmet if the
/// impulses of the position correction do not reach it.
pub(crate) const MIN_UNMET_TARGET: f64 = 1e-2;

/// Compliance that damps each constraint row of the position solve, as a fraction of the inverse inertia along the row.
///
/// A row of average inverse inertia keeps 0.1 % of its error per correction. Near a singular configuration, joints must move far to
/// change a row a little. The damping bounds this motion, as in damped least squares: to 1 / (2 sqrt(DAMPING)), that is 16, times the
/// error.
pub(crate) const DAMPING: f64 = 1e-3;

/// Lever arm that converts between displacements and rotations in a position correction, m. It also increases the damping of long
/// corrections: the total damping is [`DAMPING`] plus the displacement divided by this arm.
///
/// Without this addition, an arm that is stretched towards an unreachable target oscillates. The reason is that the linearisation of Gauss
/// and Newton leaves out the product of curvature and residual (Nocedal & Wright 2006, section 10.3).
pub(crate) const CORRECTION_ARM: f64 = 0.1;

/// Largest speed at which split stabilisation moves a joint back into its range, as a multiple of the option `max_correction_speed`, which
/// bounds the correction of overlaps.
///
/// The large speed adds no energy, because split stabilisation only changes positions. With the default `max_correction_speed` of 1 m/s, a
/// return by half a radian takes 0.07 s.
pub(crate) const LIMIT_RETURN: f64 = 10.0;

/// Position error of an equality below which the step does not correct it, m or rad. A loop at rest then needs no position solve.
pub(crate) const NEGLIGIBLE_ERROR: f64 = 1e-11;

/// Smallest relative decrease of the overlap penalty at which a position correction is accepted. The penalty of an island
/// is the sum, over its overlaps, of a number that grows with the overlap (`overlap_progress.rs`).
///
/// Evidence: the base of Unitree's G1-D overlaps one of its wheels by 0.1 m, and no motion can separate them. Corrections, which should be
/// rejected, decrease the penalty by less than 1e-7 per step. Useful small corrections must be accepted. A body on a slide joint overlaps
/// the walls on both of its sides, and still comes within 0.5 % of their middle at a time step of 0.1 ms.
pub(crate) const MIN_DECREASE: f64 = 2e-7;

/// Lower bound of the smallest relative decrease of the overlap penalty, in machine epsilons of the lane type. It replaces [`MIN_DECREASE`]
/// in single precision, because overlaps contain the rounding of positions.
pub(crate) const MIN_DECREASE_ROUNDINGS: f64 = 1e3;

/// Lower bound of the option `baumgarte` in the formula of the overlap penalty (`overlap_progress.rs`). The formula divides by this option.
pub(crate) const MIN_BAUMGARTE: f64 = 2e-7;

// Constraint rows.

/// Additional distance from a joint or tendon limit within which the limit has a constraint row, rad or m. The whole distance is this
/// number plus the motion towards the limit in two steps at the velocity without constraints. The reason is that impulses of contacts can
/// rotate a joint towards its limit in the same step.
pub(crate) const LIMIT_LOOK_AHEAD: f64 = 0.01;

/// Coefficient of friction above which a hard contact acts as with this one. For torsional and rolling friction it is in m.
///
/// A cone of the coefficient 30 has a half-angle of 88.1 degrees. Evidence: stacked cubes sink through each other with coefficients above
/// 100, because the smallest slip opens their contacts by mu times as much.
pub const MAX_FRICTION: f64 = 30.0;

/// Ratio of a constraint row's squared lengths after and before the elimination of the equalities, below which the equalities may block the
/// row. Each entry of such a row is then tested with the same ratio.
///
/// Without the test, impulses would be a million times too large and would depend on rounding. The ratio alone does not show that a row is
/// blocked: a light body that is coupled to a heavy one has the same ratio.
pub(crate) const MIN_REMAINING_LENGTH: f64 = 1e-6;

/// Overlap of a contact above which the curvature of its surfaces is neglected, m: the depth of [`Status::DEEP`](crate::Status::DEEP).
///
/// Bodies with such overlaps are jammed and do not roll. Curvature adds target velocities to friction rows, which impulses usually cannot
/// reach in a jam. Evidence: of 16 unsolved constraint problems of jammed arms, 14 are solved at once without curvature.
pub(crate) const MAX_CURVED_OVERLAP: f64 = 1e-3;

// Steps that keep an error.

/// Largest number of halvings of a step: the shortest substep is 2^-8 of the step.
pub(crate) const MAX_HALVINGS: usize = 8;

/// Smallest share of the error of a step that a substep may make. Without it, substeps with an impact would never be accurate enough: their
/// error is proportional to their length.
pub(crate) const MIN_ERROR_SHARE: f64 = 0.25;

// Redundant supports, whose loads are shared.

/// Smallest number of contacts whose forces statics does not determine: of a contact group, or of a floating body with groups of two.
pub(crate) const MIN_SHARED_CONTACTS: usize = 3;

/// Sliding speed above which a loaded contact of a redundant support counts as slipping, m/s; the tolerance of the solve replaces it where
/// it is larger. The torque of friction then depends on how the contacts share the load.
pub(crate) const SLIP_SPEED: f64 = 1e-6;

/// Fraction of the options' tolerance at which the tolerance of a lane means rest. There sticking contacts keep their loads.
///
/// In 32 bits the smallest tolerance of a lane is 1.2e-2 of the default.
pub(crate) const MAX_REST_TOLERANCE: f64 = 3e-2;

/// Length of a row after the elimination of other rows, below which the row counts as linearly dependent on them, relative to the longest
/// row. The two values are for double and for single precision.
pub(crate) const DEPENDENT_LENGTH: [f64; 2] = [1e-7, 1e-6];

/// Smallest change of a contact's normal impulse for which redundant supports redistribute their load, relative to the largest normal
/// impulse. The two values are for double and for single precision.
pub(crate) const MIN_SHARE_CHANGE: [f64; 2] = [1e-12, 1e-5];

/// Largest number of contacts in a cluster of redundant supports that share their loads. The work grows with the cube of the number.
pub(crate) const MAX_SHARED_CONTACTS: usize = 64;

/// Largest number of operations of load sharing in a cluster that sticks: number of impulses times the square of the number of coordinates.
///
/// A hand of seven coordinates that holds a box at sixteen points needs 8,000.
pub(crate) const MAX_STICKING_WORK: usize = 20_000;

/// Mean number of steps between two times at which a cluster that sticks shares its loads. Evidence: a cube that two fingers shake for 30 s
/// does not slip with 1 or 10, and by up to 4 um with 50. Meshes, cylinders and three fingers hold with 8.
pub(crate) const STEPS_PER_SHARE: u64 = 8;

/// Largest number of rounds of load sharing. Each takes one contact to its friction cone.
pub(crate) const MAX_SHARE_ROUNDS: usize = 4;

/// Largest number of contacts in an environment for which Newton's method computes the first impulses of a contact group, and two contacts
/// can form a group (see `constraints/contact/redundant_supports.rs`).
///
/// Evidence: in a heap of ten boxes with 45 contacts, Newton's method would take half of the time of the step.
pub(crate) const MAX_NEW_CONTACTS: usize = 24;
