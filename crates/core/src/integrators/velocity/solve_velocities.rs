//! Stages 4 to 6 of a step: constraint problem, impulses, and the velocity after the step.

use stepper_real::{Mask, Real, Scalar, kernel};
use stepper_solve::Outcome;

use crate::actuation::forces::ServoInput;
use crate::constraints::islands::IslandLoad;
use crate::constraints::{ConstraintProblem, VelocitySolution};
use crate::dynamics::kinematics::difference;
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::evaluate::free_motion::{FreeMotion, Scratch, compute_free_motion, has_bounded_servos};
use crate::integrators::step_input::{StepContext, StepInput};
use crate::integrators::step_resolution::{StepResolution, find_diverging};
use crate::integrators::velocity::contact_activation::SweptMotion;
use crate::integrators::velocity::velocity_loop::VelocityLoop;
use crate::probe::{Counter, Probe, span};
use crate::stages::s05_solve::{share_slipping_loads, solve};
use crate::stages::s06_integrate_velocity::integrate_velocity;
use crate::stages::s08_stabilise::has_implausible_bias;
use crate::tuning::{EARLIEST_ONLY_PASSES, MIN_NEWTON_STEPS_FOR_RETRY, ROUGH_ITERATIONS, SATURATION_PASSES};

/// State of the checks of an assembled problem's solutions, per lane: no result depends on how often other lanes are solved.
struct SolutionChecks<R: Real> {
    /// Number of solves since the assembly, or since impacts changed the problem. Collisions do not reset it.
    passes: R,
    /// Lanes that were not yet checked for a velocity change by inelastic impacts.
    unchecked: R::Mask,
    /// Lanes in which an impact became inelastic.
    inelastic: R::Mask,
}

impl<R: Real> Default for SolutionChecks<R> {
    #[inline(always)]
    fn default() -> Self {
        Self { passes: R::zero(), unchecked: R::Mask::splat(true), inelastic: R::Mask::splat(false) }
    }
}

impl<R: Real> VelocityLoop<'_, R> {
    /// Solves for the velocity after the step. Assembles and solves the problem again, at most [`SATURATION_PASSES`] times, until the
    /// assumed bounds of stiff servos (with Euler's rule, of all servos with actuator dynamics) are active in the solution. A bound changes
    /// the mass matrix. [`VelocityLoop`] lists the files of the methods.
    ///
    /// The second result has the lanes whose energy may be wrong. There, active bounds of servos still differ from the assumed ones after
    /// the last solve, or an impact became inelastic. A shorter time step helps.
    #[inline(always)]
    pub(crate) fn solve_velocities(&mut self, probe: impl Probe) -> (Outcome<R>, R::Mask) {
        let mut assemblies = 0;
        let (mut outcome, doubtful) = loop {
            self.assemble_problem(probe);
            span!(probe, CorrectForces, || self.predict(probe));
            let (outcome, inelastic) = self.solve_assembled(probe);
            let changed = self.assume_bounds_of_solution(assemblies < SATURATION_PASSES);
            if changed.none() || assemblies == SATURATION_PASSES {
                break (outcome, inelastic.or(changed));
            }
            // All lanes are assembled and solved again. Lanes without a changed bound get the same bits as before.
            compute_free_motion(self.context, self.free, probe);
            assemblies += 1;
        };
        // Contacts that are still deferred and whose gap stays open become active with zero impulse: stage 8 needs their rows, and the
        // state keeps them.
        self.problem.activate_not_closing(self.velocity);
        span!(probe, Solve, || self.resolve_ambiguous(&mut outcome));
        count_iterations(&outcome, self.problem, probe);
        (outcome, doubtful)
    }

    /// Solves the assembled problem, and again the lanes in which the solution contradicts an assumption ([`Self::find_contradictions`]).
    /// The second result has the lanes in which an impact became inelastic.
    ///
    /// The number of solves is bounded. Each activates a deferred contact, recomputes inertial forces (once), makes impacts inelastic
    /// (some, then all), or leaves out Baumgarte's bias (once).
    #[inline(always)]
    fn solve_assembled(&mut self, probe: impl Probe) -> (Outcome<R>, R::Mask) {
        let compiled = self.context.input.compiled;
        let mut checks = SolutionChecks::default();
        let mut lanes = self.problem.constrained;
        let mut outcome = span!(probe, Solve, || self.solve_lanes(lanes, true));
        loop {
            let (free, VelocitySolution { impulses, v, .. }) = (&*self.free, &mut *self.velocity);
            span!(probe, IntegrateVelocity, || integrate_velocity(compiled, &free.smooth.mass, &free.v, impulses, v));
            checks.passes = R::select(lanes, checks.passes + R::one(), checks.passes);
            lanes = self.find_contradictions(outcome.residual, &mut checks, probe);
            if lanes.none() {
                return (outcome, checks.inelastic);
            }
            let solved = span!(probe, Solve, || self.solve_lanes(lanes, false));
            outcome.replace(&solved, lanes);
        }
    }

    /// Finds the lanes whose solution contradicts an assumption of the assembled problem, and changes the problem there. It checks
    /// four assumptions in this order, and ends at the first that fails in any lane. The other lanes are checked after the next solve, with
    /// the same results:
    ///
    /// 1. Deferred contacts, which the solver leaves out, do not collide in the solved motion. A deferred contact that collides becomes
    ///    active.
    /// 2. The velocity after the step is the predicted velocity, with which inertial forces were evaluated. With the midpoint rule, if an
    ///    inelastic impact changed the velocity, inertial forces are recomputed once.
    /// 3. Newton's law of impact has a plausible solution. It is implausible if friction at an impact adds more energy than the free motion
    ///    has, as in a corner with much friction (see `restitution.rs`). The impact then becomes inelastic.
    /// 4. Baumgarte's bias makes no velocity implausible. Otherwise the lane is solved without it, and stage 8 corrects its positions.
    ///
    /// `residual` is the residual of the solution.
    #[inline(always)]
    fn find_contradictions(&mut self, residual: R, checks: &mut SolutionChecks<R>, probe: impl Probe) -> R::Mask {
        // The first solves activate only the earliest collision of each kinematic tree.
        let motion = SweptMotion::Solved { finds_all: checks.passes.ge(R::of(EARLIEST_ONLY_PASSES)) };
        let collide = span!(probe, Solve, || self.activate_colliding(motion));
        if collide.any() {
            return collide;
        }
        let mut lanes = R::Mask::splat(false);
        let Evaluation { scheme, substep, .. } = self.context.evaluation;
        if scheme.in_the_middle {
            let unchecked = std::mem::replace(&mut checks.unchecked, R::Mask::splat(false)).and_not(substep.is_impact);
            lanes = span!(probe, SolveImpacts, || self.correct_impact_forces(unchecked));
        }
        if lanes.none() {
            lanes = self.drop_restitution(residual, checks.inelastic);
            checks.inelastic = checks.inelastic.or(lanes);
        }
        if lanes.none() && self.problem.biased.any() {
            lanes = self.replace_implausible_bias();
        }
        checks.passes = R::select(lanes, R::zero(), checks.passes);
        lanes
    }

    /// Replaces Baumgarte's method by split stabilisation for this step in lanes where its bias makes velocities implausible. Returns these
    /// lanes, which must be solved again.
    #[inline(never)]
    fn replace_implausible_bias(&mut self) -> R::Mask {
        let StepInput { compiled, options, .. } = self.context.input;
        let Self { free, problem, velocity, .. } = self;
        let FreeMotion { v, scratch: Scratch { velocity_change, .. }, .. } = &mut **free;
        difference(&velocity.v, v, velocity_change);
        // An impact at the end of Euler's step changes the velocity too. Its rebound is in the offsets of the velocity solve alone.
        let lanes = has_implausible_bias(compiled, options, problem, velocity_change).and_not(problem.impact_lanes());
        kernel!(R, || problem.rows.exchange_offsets(lanes));
        problem.needs_position_solve = problem.needs_position_solve.or(lanes);
        problem.biased = problem.biased.and_not(lanes);
        lanes
    }

    /// Updates the assumed active bounds of servos (none, a force limit, or the torque-speed curve) to the bounds that are active in the
    /// solution. Returns the lanes in which any of them changed, apart from impacts, in which forces have no time to act. If all servos are
    /// implicit, only the bounds of stiff servos are updated.
    ///
    /// If `may_change` is false, nothing is updated, and the result has the lanes in which a bound would change.
    #[inline(always)]
    fn assume_bounds_of_solution(&mut self, may_change: bool) -> R::Mask {
        let StepContext { input: StepInput { compiled, state, inputs, alive, .. }, evaluation: Evaluation { scheme, substep, .. } } =
            self.context;
        if !has_bounded_servos(compiled, scheme) {
            return R::Mask::splat(false);
        }
        let FreeMotion { actuator_forces, scratch: Scratch { velocity_change, .. }, .. } = &mut *self.free;
        difference(&self.velocity.v, &state.v, velocity_change);
        let servos = ServoInput { compiled, actuator_dynamics: &inputs.actuator_dynamics, implicit: scheme.implicit_servos() };
        actuator_forces.set_bounds_at_velocity_change(servos, velocity_change, may_change).and(alive).and_not(substep.is_impact)
    }

    /// Solves the constraint problem in the lanes `lanes`. Lanes that Newton's method leaves unsolved are solved again without the
    /// curvature terms of their unsolved islands, if the iteration limit is at least [`MIN_NEWTON_STEPS_FOR_RETRY`].
    ///
    /// Curvature terms shift the target velocities of friction rows. If contacts hold a body from several sides (a jam), the body may not
    /// be able to reach these velocities, and the impulses of the first solve diverge. The second solve therefore does not start from these
    /// impulses, but from the result of [`ROUGH_ITERATIONS`] Gauss-Seidel iterations from zero.
    ///
    /// If `share` is true, slipping contact groups share their loads evenly afterwards.
    #[inline(always)]
    fn solve_lanes(&mut self, lanes: R::Mask, share: bool) -> Outcome<R> {
        let StepContext { input: StepInput { compiled, options, state, .. }, evaluation: Evaluation { contacts, .. } } = self.context;
        let Self { problem, velocity, .. } = self;
        let mut outcome = solve(options, &state.v, lanes, problem, velocity, contacts);
        let unsolved = lanes.and_not(outcome.residual.le(R::of(options.tolerance)));
        let [_, newton_steps] = options.iteration_limits();
        if newton_steps >= MIN_NEWTON_STEPS_FOR_RETRY && unsolved.any() && !problem.curvature_terms.is_empty() {
            let changed = problem.remove_unsolved_curvature(compiled, contacts, velocity, unsolved, options.tolerance);
            if changed.any() {
                stepper_solve::gauss_seidel::sweep_from_zero(&problem.rows, &mut velocity.impulses, ROUGH_ITERATIONS, changed);
                outcome.replace(&solve(options, &state.v, changed, problem, velocity, contacts), changed);
            }
        }
        if share {
            share_slipping_loads(options, &state.v, lanes, problem, velocity, contacts, &mut outcome);
        }
        outcome
    }

    /// Limits joint speeds of islands whose motion is too fast for the time step or whose energy is ambiguous. Returns the lanes with
    /// ambiguous energy, and all limited lanes.
    ///
    /// [`limit_energy`](crate::integrators::step_resolution::StepResolution::limit_energy) limits the energy of these islands after stage
    /// 8.
    #[inline(always)]
    pub(crate) fn limit_speed(&mut self, resolution: &mut StepResolution<R>, residual: R) -> [R::Mask; 2] {
        let StepContext { input: StepInput { compiled, options, state, alive, .. }, evaluation: Evaluation { scheme, .. } } = self.context;
        let ambiguous = self.ambiguous(residual);
        let Self { free, problem, velocity, .. } = self;
        if scheme.implicit_forces && problem.constrained.any() {
            let FreeMotion { v, unresolved, scratch, .. } = &mut **free;
            find_diverging(compiled, alive, [&state.v, v, &velocity.v], scheme.h, (&mut scratch.motions, unresolved));
        }
        let limited = free.unresolved_lanes().or(ambiguous);
        if limited.any() {
            let (tolerance, negligible) = (options.tolerance, free.smooth.mass.energy_at(R::of(options.tolerance)));
            let is_ambiguous = |lane: usize, load: IslandLoad| load.is_ambiguous(tolerance, negligible.lane(lane).to_f64());
            let masks = [limited, ambiguous];
            resolution.find_limited(compiled, problem, velocity, &free.unresolved, masks, is_ambiguous);
            resolution.limit_joint_rates(compiled, problem, velocity, limited, scheme.h);
        }
        [ambiguous, limited]
    }
}

/// Reports the numbers of scalar rows, contacts and solver iterations to the probe.
#[inline(always)]
fn count_iterations<R: Real>(outcome: &Outcome<R>, problem: &ConstraintProblem<R>, probe: impl Probe) {
    probe.count(Counter::ScalarRows, || problem.impulse_indices.len() as f64);
    probe.count(Counter::ContactSlots, || problem.contact_slots.len() as f64);
    let lanes = |x: R| (0..R::LANES).map(move |l| x.lane(l).to_f64());
    probe.count(Counter::Sweeps, || lanes(outcome.sweeps).sum());
    probe.count(Counter::SlowestSweeps, || lanes(outcome.sweeps).fold(0.0, f64::max));
    probe.count(Counter::NewtonSteps, || lanes(outcome.newton_steps).sum());
}
