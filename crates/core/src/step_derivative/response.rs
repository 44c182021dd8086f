//! Response of a step with hard contact close to a solved one: impulses follow those of the solution to first order.

use stepper_real::{Mask, Real, Scalar};
use stepper_solve::newton::{Followed, Newton, Response, Switch};
use stepper_solve::{Iterate, Settings, System};

use crate::collision::contact_set::{Contacts, Slot};
use crate::compile::{ActuatorParams, LaneModel};
use crate::constraints::restitution::any_elastic;
use crate::constraints::solved_overlaps::limit_gap;
use crate::constraints::{ConstraintProblem, PositionSolution, VelocitySolution};
use crate::dynamics::kinematics::{advance, displace};
use crate::integrators::assemble::assemble_problem;
use crate::integrators::free_motion::recompute_free_motion;
use crate::integrators::locate::locate;
use crate::integrators::positions::integrate_positions;
use crate::integrators::predict::correct_free_velocity;
use crate::integrators::recomputed::Recomputed;
use crate::integrators::scheme;
use crate::integrators::scheme::Scheme;
use crate::integrators::step_values::{Evaluation, FreeMotion, Place, StepInput};
use crate::integrators::workspace::Workspace;
use crate::math::lanes::each_of;
use crate::options::{Stabilization, StepSettings};
use crate::probe::NoProbe;
use crate::stages::s04_assemble::shift_targets;
use crate::stages::s05_solve::{fastest, is_estimated};
use crate::stages::s06_integrate_velocity::integrate_velocity;
use crate::stages::s08_stabilise::{PositionInput, damp_rows, find_correction};
use crate::tuning::{BOUND_DISTANCE, EXPECTED_VELOCITY_WEIGHT, SOLVED_RESIDUAL};

/// Name where a lane has no constraint.
const NOBODY: u64 = u64::MAX;

/// Lanes whose residual is that of a solved step.
pub(crate) fn is_solved<R: Real>(options: &StepSettings, residual: R) -> R::Mask {
    residual.le(R::of(SOLVED_RESIDUAL.max(10.0 * options.tolerance)))
}

/// Solution with hard contact, and the response of its impulses to the rows.
#[derive(Clone, Debug)]
pub(crate) struct HardResponse<R: Real> {
    /// Impulses of the step.
    solution: Response<R>,
    /// Response of the estimated impulses, which solve the same rows before velocity-dependent forces are evaluated.
    estimate: Response<R>,
    /// Impulses of stage 8, which correct the positions.
    correction: Response<R>,
    /// Lanes (bits) with a position correction.
    corrected: u32,
    /// Whether a second solution corrects the positions.
    split: bool,
    /// Contacts of the step.
    contacts: Contacts<R>,
    /// Gaps of the step's joint limits, negative beyond the end of a range, rad or m; NaN for limits that do not push.
    limits: Vec<R>,
    /// Distances at which the target velocity of a contact or a limit has a corner, m or rad.
    edges: Vec<f64>,
    /// Velocity that the step expected.
    v_expected: Vec<R>,
    /// Free velocity of the present rows.
    v_free: Vec<R>,
    change: Vec<R>,
    /// Scheme of the step, with the evaluation time of each lane.
    scheme: Scheme<R>,
}

/// Treatment of the impulses of a system of rows, in the lanes `lanes` (bits).
enum Pass<'a> {
    /// The impulses are solved for, and their response to the rows is stored. Lanes without a response are removed.
    Solve { lanes: u32 },
    /// The impulses follow the rows. Lanes that have lost a constraint are removed. In the other lanes `near` is called with the
    /// constraints that have come closer to another mode.
    Follow { lanes: u32, near: &'a mut dyn FnMut(Followed) },
}

impl<R: Real> HardResponse<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>, options: &StepSettings, max_contacts: usize) -> Self {
        let zeros = || vec![R::zero(); compiled.nv];
        Self {
            solution: Response::default(),
            estimate: Response::default(),
            correction: Response::default(),
            corrected: 0,
            split: options.stabilization == Stabilization::Split,
            contacts: Contacts::new(max_contacts).with_torques(compiled.has_rolling_friction),
            limits: vec![R::of(f64::NAN); compiled.limits.len()],
            edges: edges(options),
            v_expected: zeros(),
            v_free: zeros(),
            change: zeros(),
            scheme: scheme(options),
        }
    }

    /// Stores the solution of the step that was just made.
    pub(crate) fn keep(&mut self, compiled: &LaneModel<R>, s: &Workspace<R>) {
        // The step has moved its contacts to the state.
        self.contacts.clone_from(&s.state.contacts);
        self.v_expected.copy_from_slice(&s.free_motion.v_expected);
        for (i, (gap, impulse)) in self.limits.iter_mut().zip(&s.velocity.scalar_impulse).enumerate() {
            *gap = R::select(impulse.gt(R::zero()), limit_gap(compiled, i, &s.evaluation.q), R::of(f64::NAN));
        }
    }

    /// Computes the responses of the stored step's solutions in the lanes `lanes` (bits), from the state before it. Returns the lanes with
    /// a response.
    ///
    /// In these lanes the impulses follow from the rows, and velocities and positions follow from the impulses.
    pub(crate) fn settle(&mut self, compiled: &LaneModel<R>, options: &StepSettings, s: &mut Workspace<R>, lanes: u32) -> u32 {
        let lanes = self.take(compiled, options, s, Recomputed::Configuration, Pass::Solve { lanes });
        // A bouncing contact has other impulses in the position solve, or none.
        let lanes = lanes & !s.problem.rebounding.or(s.problem.bouncing()).bits();
        if !self.scheme.corrects {
            return lanes;
        }
        // The time of an impact is found by iteration, to a fraction of the step.
        let lanes = lanes & !s.evaluation.impacts.lanes.bits();
        let matters = depends_on_estimate(compiled);
        let estimated = is_estimated(&s.state.v, self.scheme.h).bits();
        // At rest the expected velocity is that by the impulses of the last step.
        let follows = if matters { estimated & self.has_expected(options, s, R::one()).bits() } else { !estimated };
        let inertia = self.has_expected(options, s, self.scheme.h * fastest(&s.state.v) * R::of(EXPECTED_VELOCITY_WEIGHT));
        lanes & (follows | if matters { 0 } else { inertia.bits() })
    }

    /// Lanes in which the step expected the velocity that follows from the solved estimate.
    ///
    /// Otherwise the estimate is not a solution and does not respond to its rows as one. Differences of velocities are multiplied by
    /// `weight`, at most 1.
    fn has_expected(&self, options: &StepSettings, s: &Workspace<R>, weight: R) -> R::Mask {
        R::vectorize(
            #[inline(always)]
            || {
                let mut apart = R::zero();
                for (&kept, &now) in self.v_expected.iter().zip(&s.free_motion.v_expected) {
                    // This form propagates a NaN.
                    apart = R::select((kept - now).abs().le(apart), apart, (kept - now).abs());
                }
                is_solved(options, apart * weight.min(R::one()))
            },
        )
    }

    /// Stages 1 to 8 close to the solution, in the lanes `lanes` (bits). Returns the lanes in which all constraints that pushed still
    /// exist.
    ///
    /// Calls `near` with the constraints that have come closer to another mode.
    pub(crate) fn follow(
        &mut self,
        compiled: &LaneModel<R>,
        options: &StepSettings,
        s: &mut Workspace<R>,
        recomputed: Recomputed,
        lanes: u32,
        near: &mut dyn FnMut(Followed),
    ) -> u32 {
        let recomputed = self.rows_by(compiled, recomputed);
        let left = self.take(compiled, options, s, recomputed, Pass::Follow { lanes, near });
        if recomputed == Recomputed::Configuration {
            self.compare_gaps(compiled, s, left, near);
        }
        left
    }

    /// Calls `near` with contacts and limits that push and have come closer to a corner of their target velocity, in the lanes `lanes`
    /// (bits).
    fn compare_gaps(&self, compiled: &LaneModel<R>, s: &Workspace<R>, lanes: u32, near: &mut dyn FnMut(Followed)) {
        let mut compare = |lane: usize, before: R, after: R| {
            let [before, after] = [before, after].map(|gap| gap.lane(lane).to_f64());
            for edge in &self.edges {
                let [from, to] = [before - edge, after - edge];
                // A distance that does not change gives no kink.
                if from * to <= 0.0 || to.abs() < from.abs() {
                    near(Followed { lane, switch: Switch::Gap, distance: from / (from - to) });
                }
            }
        };
        let there = &s.evaluation.contacts;
        for lane in each_of(lanes) {
            for k in 0..self.contacts.count[lane] {
                let Slot { point, impulse, .. } = &self.contacts.data[k];
                let found = there.find(lane, k, self.contacts.ids[k][lane]);
                if let Some(j) = found.filter(|_| impulse[0].lane(lane).to_f64() > 0.0) {
                    compare(lane, point.distance, there.data[j].point.distance);
                }
            }
        }
        for (i, &gap) in self.limits.iter().enumerate() {
            let pushing = R::vectorize(
                #[inline(always)]
                || gap.eq(gap).bits(),
            );
            // Few limits push.
            if lanes & pushing != 0 {
                let after = limit_gap(compiled, i, &s.evaluation.q);
                each_of(lanes & pushing).for_each(|lane| compare(lane, gap, after));
            }
        }
    }

    /// Stages 1 to 8 with `pass` in place of their solves. Returns the remaining lanes.
    fn take(
        &mut self,
        compiled: &LaneModel<R>,
        options: &StepSettings,
        s: &mut Workspace<R>,
        recomputed: Recomputed,
        mut pass: Pass<'_>,
    ) -> u32 {
        let Workspace { state, inputs, evaluation, free_motion: free, problem, builder, velocity, position, alive, .. } = s;
        let input = StepInput { compiled, options, state, inputs, alive: *alive };
        match recomputed {
            Recomputed::Configuration => {
                evaluation.poses.begin();
                locate(input, evaluation, free, NoProbe);
                self.scheme = evaluation.scheme;
                evaluation.match_contacts(compiled, &mut state.contacts);
                evaluation.contacts.follow_tangents(&self.contacts);
            }
            Recomputed::Velocity | Recomputed::Forces => recompute_free_motion(input, evaluation, free),
        }
        let place = Place { input: StepInput { compiled, options, state, inputs, alive: *alive }, evaluation };
        if recomputed == Recomputed::Forces {
            advance(&free.v, &self.v_free, -R::one(), &mut self.change);
            shift_targets(compiled, &free.smooth.mass, problem, &mut self.change, None, R::Mask::splat(true));
        } else {
            // Stage 4 with the contacts of the step.
            assemble_problem(place, free, problem, velocity, builder, NoProbe);
            problem.activate_matching(velocity, &evaluation.contacts, &self.contacts);
        }
        if self.scheme.corrects {
            pass.find_step_impulses(options, &mut self.estimate, problem, velocity, &evaluation.contacts);
            correct_free_velocity(place, free, problem, velocity, NoProbe);
        }
        self.v_free.copy_from_slice(&free.v);
        pass.find_step_impulses(options, &mut self.solution, problem, velocity, &evaluation.contacts);
        integrate_velocity(compiled, &free.smooth.mass, &free.v, velocity);
        integrate_positions(place, velocity, position, NoProbe);
        if self.split {
            self.correct_positions(place, free, problem, velocity, position, &mut pass);
        }
        let (Pass::Solve { lanes } | Pass::Follow { lanes, .. }) = pass;
        lanes
    }

    /// Stage 8 with `pass` in place of its solve.
    fn correct_positions(
        &mut self,
        place: Place<'_, R>,
        free: &FreeMotion<R>,
        problem: &ConstraintProblem<R>,
        velocity: &mut VelocitySolution<R>,
        position: &mut PositionSolution<R>,
        pass: &mut Pass<'_>,
    ) {
        let Place { input: StepInput { compiled, options, .. }, evaluation: Evaluation { contacts, .. } } = place;
        if matches!(pass, Pass::Solve { .. }) {
            // Zero equality errors, which the step does not correct, are no longer zero at a displaced state.
            let ConstraintProblem { needs_position_solve, constrained, .. } = problem;
            self.corrected = if compiled.equalities.is_empty() { needs_position_solve.bits() } else { constrained.bits() };
        }
        if self.corrected == 0 {
            return;
        }
        position.copy_rows(problem);
        position.v_free.copy_from_slice(&free.v);
        let corrected = R::Mask::from_bits(self.corrected);
        let (mass, h) = (&free.smooth.mass, self.scheme.h);
        let rows = PositionInput { problem, mass, contacts, lanes: corrected, rebounding: problem.rebounding, h };
        damp_rows(compiled, &rows, &velocity.impulses, position);
        pass.find_impulses(
            options,
            &mut self.correction,
            (position.rows.system(&problem.rows), &mut velocity.impulses, &mut velocity.newton),
            [self.corrected; 2],
            names(problem, contacts),
            Some(&self.solution),
        );
        let excess = find_correction(compiled, options, &rows, velocity, position);
        if let Pass::Solve { lanes } = pass {
            // A bounded correction depends on its fastest joint alone.
            *lanes &= !self.corrected | excess.lt(R::of(1.0 - BOUND_DISTANCE)).bits();
        }
        displace(compiled, &position.q, &position.correction, h, &mut position.q_corrected);
        R::vectorize(
            #[inline(always)]
            || {
                for (q, &new) in position.q.iter_mut().zip(&position.q_corrected) {
                    *q = R::select(corrected, new, *q);
                }
            },
        );
    }

    /// Parts of the rows that must be recomputed for this displacement.
    ///
    /// All rows, if forces change the mass matrix, as implicit servos or drag do. Otherwise a change of velocities changes the free
    /// velocity alone, unless targets depend on the velocity before the step.
    fn rows_by(&self, compiled: &LaneModel<R>, recomputed: Recomputed) -> Recomputed {
        let plain = compiled.equalities.is_empty() && compiled.tendons.iter().all(|tendon| tendon.spring.is_none());
        match recomputed {
            _ if compiled.actuator_dynamics > 0 || compiled.lossy => Recomputed::Configuration,
            Recomputed::Velocity if self.scheme.corrects => Recomputed::Configuration,
            Recomputed::Forces if self.scheme.corrects && !compiled.servos.is_empty() => Recomputed::Configuration,
            Recomputed::Velocity if plain && !compiled.has_contact_springs && !any_elastic(&self.contacts) => Recomputed::Forces,
            Recomputed::Forces if any_elastic(&self.contacts) => Recomputed::Configuration,
            recomputed => recomputed,
        }
    }
}

impl Pass<'_> {
    /// Stage 5: impulses of the step.
    fn find_step_impulses<R: Real>(
        &mut self,
        options: &StepSettings,
        response: &mut Response<R>,
        problem: &ConstraintProblem<R>,
        velocity: &mut VelocitySolution<R>,
        contacts: &Contacts<R>,
    ) {
        let all = R::Mask::splat(true).bits();
        self.find_impulses(
            options,
            response,
            ((&problem.rows).into(), &mut velocity.impulses, &mut velocity.newton),
            [problem.constrained.bits(), all],
            names(problem, contacts),
            None,
        );
    }

    /// Impulses of a system of rows in the lanes `concerned` (bits), of which `constrained` have rows. Other lanes are skipped. `before` is
    /// the solution from which a position solve counts.
    fn find_impulses<R: Real>(
        &mut self,
        options: &StepSettings,
        response: &mut Response<R>,
        (system, iterate, newton): (System<'_, R>, &mut Iterate<R>, &mut Newton),
        [constrained, concerned]: [u32; 2],
        name: impl Fn(usize, usize, usize) -> u64,
        before: Option<&Response<R>>,
    ) {
        match self {
            Self::Solve { lanes } => {
                let [sweeps, newton_steps] = options.effort();
                let tolerance = R::of(options.tolerance);
                let settings = Settings { sweeps, newton_steps, tolerance, newton_threshold: tolerance };
                let outcome = stepper_solve::solve(system, iterate, settings, R::Mask::from_bits(constrained), newton);
                *lanes &= !concerned | is_solved(options, outcome.residual).bits();
                *lanes &= !concerned | response.settle(system, iterate, *lanes & concerned, name, before);
            }
            Self::Follow { lanes, near } => {
                *lanes &= !response.respond(system, iterate, *lanes & concerned, name, before);
                response.compare(system, iterate, *lanes & concerned, near);
            }
        }
    }
}

/// Distances at which the target velocity of a contact or a limit has a corner: where it closes, and where the correction of an overlap
/// begins.
///
/// None with Baumgarte's method if gaps and overlaps have the same target.
fn edges(options: &StepSettings) -> Vec<f64> {
    let StepSettings { stabilization, baumgarte, slop, .. } = *options;
    match stabilization {
        Stabilization::Baumgarte if baumgarte == 1.0 && slop == 0.0 => vec![],
        Stabilization::None => vec![0.0],
        Stabilization::Baumgarte | Stabilization::Split if slop == 0.0 => vec![0.0],
        Stabilization::Baumgarte | Stabilization::Split => vec![0.0, -slop],
    }
}

/// Whether the expected velocity matters even at rest. Inertial forces are quadratic in it, but drag and driving forces are not. Dampers
/// are implicit.
fn depends_on_estimate<R: Real>(compiled: &LaneModel<R>) -> bool {
    let pushes = |k: usize| {
        let ActuatorParams { gain, bias } = compiled.params.actuator(k);
        gain[2].eq(R::zero()).and(bias[2].le(R::zero())).not().any()
    };
    !compiled.fluid.is_empty() || compiled.servos.iter().any(|servo| pushes(servo.actuator))
}

/// Number of a constraint's owner or contact, by kind, index and lane.
fn names<'a, R: Real>(problem: &'a ConstraintProblem<R>, contacts: &'a Contacts<R>) -> impl Fn(usize, usize, usize) -> u64 + 'a {
    move |kind, i, lane| {
        let (k, lanes) = match kind {
            0 => return problem.owners[i] as u64,
            1 => problem.slots[i],
            _ => (problem.rolling_slots[i].0, problem.rolling_slots[i].1),
        };
        if lanes.bits() >> lane & 1 == 1 { contacts.ids[k][lane].0 } else { NOBODY }
    }
}
