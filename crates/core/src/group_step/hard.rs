//! Evaluation of stages 1 to 8 with hard contact. A rule sets the impulses instead of the solver.

use stepper_real::{Mask, Real, Scalar, kernel};
use stepper_solve::Settings;
use stepper_solve::newton::Newton;

use crate::collision::contact_set::{Contacts, Slot};
use crate::compile::{ActuatorParams, LaneModel};
use crate::constraints::contact::restitution::any_elastic;
use crate::constraints::solved_overlaps::limit_gap;
use crate::constraints::{ConstraintProblem, PositionSolution, VelocitySolution};
use crate::dynamics::kinematics::{difference, displace, select_into};
use crate::group_step::rule::{ConstraintNames, ImpulseProblem, ImpulseRule, NominalEvaluation, Prediction, Solve};
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::evaluate::evaluation::Substep;
use crate::integrators::evaluate::free_motion::{FreeMotion, recompute_free_motion};
use crate::integrators::evaluate::locate::locate;
use crate::integrators::evaluate::recomputed::Recomputed;
use crate::integrators::evaluate::scheme::Scheme;
use crate::integrators::position::positions::integrate_positions;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::integrators::velocity::velocity_loop::VelocityLoop;
use crate::integrators::workspace::Workspace;
use crate::math::lanes::each_of;
use crate::options::{Stabilization, StepSettings};
use crate::probe::NoProbe;
use crate::stages::s05_solve::{fastest, is_estimated};
use crate::stages::s06_integrate_velocity::integrate_velocity;
use crate::stages::s08_stabilise::{PositionInput, damp_rows, find_correction};

/// Results of the solved step with hard contact, which evaluations of steps from nearby states use (for derivatives).
#[derive(Clone, Debug)]
pub(super) struct HardNominal<R: Real> {
    /// Contacts of the solved step.
    contacts: Contacts<R>,
    /// Gaps of the joint limits in the solved step, rad or m, negative for a joint outside its range. NaN for limits without an impulse.
    limits: Vec<R>,
    /// Predicted velocity after the step, nv, at which the solved step evaluated velocity-dependent forces.
    v_expected: Vec<R>,
    /// Lanes (bits) in which impacts divided the step.
    divided: u32,
    /// Lanes (bits) in which the step corrects positions.
    corrected: u32,
    /// Whether positions are corrected in a separate solve (split stabilisation).
    split: bool,
    /// Speed of the position correction in the last evaluation, as a fraction of its upper bound; 0 in lanes without a correction.
    correction: R,
    /// Free velocity (velocity without constraint impulses), nv, with which the offsets of the constraint rows were last computed.
    v_free: Vec<R>,
    /// Buffer for the difference of the free velocity from `v_free`, nv.
    change: Vec<R>,
    /// Integration scheme of the step.
    scheme: Scheme<R>,
}

/// Kind of evaluation of a step, which determines the source of the impulses.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Pass {
    /// Evaluation at the nominal state: the state from which the solved step started. The solver computes the impulses again.
    Nominal,
    /// Evaluation at a displaced state: the nominal state with one coordinate displaced. The caller's [`ImpulseRule`] sets the impulses.
    Displaced,
}

impl<R: Real> HardNominal<R> {
    pub(super) fn new(compiled: &LaneModel<R>, options: &StepSettings, max_contacts: usize) -> Self {
        let zeros = || vec![R::zero(); compiled.nv];
        Self {
            contacts: Contacts::new(max_contacts).with_torques(compiled.has_rolling_friction),
            limits: vec![R::of(f64::NAN); compiled.limits.len()],
            v_expected: zeros(),
            divided: 0,
            corrected: 0,
            split: options.stabilization == Stabilization::Split,
            correction: R::zero(),
            v_free: zeros(),
            change: zeros(),
            scheme: Scheme::new(options, R::of(options.timestep)),
        }
    }

    /// Stores the solution of the last step. Later evaluations compare with it.
    pub(super) fn keep(&mut self, compiled: &LaneModel<R>, s: &Workspace<R>) {
        // The step has moved its contacts to the state.
        self.contacts.clone_from(&s.state.contacts);
        self.divided = s.evaluation.divided.bits();
        self.v_expected.copy_from_slice(&s.free_motion.v_expected);
        for (i, (gap, impulse)) in self.limits.iter_mut().zip(&s.velocity.scalar_impulse).enumerate() {
            *gap = R::select(impulse.gt(R::zero()), limit_gap(compiled, i, &s.evaluation.q), R::of(f64::NAN));
        }
    }

    /// Compares the last evaluation, which started from the nominal state, with the stored solution of the step.
    pub(super) fn compare(&self, compiled: &LaneModel<R>, s: &Workspace<R>) -> NominalEvaluation<R> {
        let prediction = self.scheme.implicit_forces.then(|| Prediction {
            drives_forces: depends_on_prediction(compiled),
            solved: is_estimated(&s.state.v, self.scheme.h).bits(),
            difference: self.prediction_difference(&s.free_motion.v_expected),
            motion: self.scheme.h * fastest(&s.state.v),
        });
        NominalEvaluation { bouncing: self.divided | s.problem.impact_lanes().bits(), correction: self.correction, prediction }
    }

    /// Largest difference between `v_expected`, the velocity predicted in an evaluation, and the velocity predicted in the solved step, m/s
    /// or rad/s. NaN if any difference is NaN.
    fn prediction_difference(&self, v_expected: &[R]) -> R {
        kernel!(R, || {
            let mut apart = R::zero();
            for (&kept, &now) in self.v_expected.iter().zip(v_expected) {
                apart = apart.max_or_nan((kept - now).abs());
            }
            apart
        })
    }

    /// Calls `see` for each contact or limit that has an impulse in the solved step, in the lanes `lanes` (bits).
    ///
    /// The first argument of `see` is true for a limit. The next two are gaps of the contact or limit: in the solved step, and in the last
    /// evaluation. The last has the lanes (bits) to which both gaps apply.
    pub(super) fn each_gap(&self, compiled: &LaneModel<R>, s: &Workspace<R>, lanes: u32, see: &mut impl FnMut(bool, R, R, u32)) {
        let there = &s.evaluation.contacts;
        for lane in each_of(lanes) {
            for k in 0..self.contacts.count[lane] {
                let Slot { point, impulse, .. } = &self.contacts.data[k];
                let found = there.find(lane, k, self.contacts.ids[k][lane]);
                if let Some(j) = found.filter(|_| impulse[0].lane(lane).to_f64() > 0.0) {
                    see(false, point.distance, there.data[j].point.distance, 1 << lane);
                }
            }
        }
        for (i, &gap) in self.limits.iter().enumerate() {
            let pushing = kernel!(R, || gap.eq(gap).bits());
            // Usually few limits push.
            if lanes & pushing != 0 {
                see(true, gap, limit_gap(compiled, i, &s.evaluation.q), lanes & pushing);
            }
        }
    }

    /// Evaluates stages 1 to 8 of the step from the state in the workspace. `pass` selects the source of the impulses, and `recomputed` the
    /// part of the state that changed since the last evaluation.
    pub(super) fn evaluate(
        &mut self,
        compiled: &LaneModel<R>,
        options: &StepSettings,
        s: &mut Workspace<R>,
        recomputed: Recomputed,
        pass: Pass,
        rule: &mut dyn ImpulseRule<R>,
    ) {
        let Workspace { state, inputs, evaluation, free_motion: free, problem, builder, velocity, position, collisions, alive, .. } = s;
        let input = StepInput { compiled, options, state, inputs, alive: *alive };
        match recomputed {
            Recomputed::Configuration => {
                evaluation.collision.narrow_phase.begin_step();
                // The response counts only in lanes that no impact divides.
                evaluation.substep = Substep { ignores_impacts: R::Mask::splat(true), ..Substep::whole(options) };
                locate(input, evaluation, free, NoProbe);
                self.scheme = evaluation.scheme;
                evaluation.match_contacts(compiled, &mut state.contacts);
                evaluation.contacts.follow_tangents(&self.contacts);
            }
            Recomputed::Velocity | Recomputed::Forces => recompute_free_motion(input, evaluation, free),
        }
        let context = StepContext { input: StepInput { compiled, options, state, inputs, alive: *alive }, evaluation };
        if recomputed == Recomputed::Forces {
            difference(&free.v, &self.v_free, &mut self.change);
            problem.shift(compiled, &free.smooth.mass, &mut self.change);
        } else {
            // Stage 4, with those contacts active that the solved step has.
            VelocityLoop { context, free, problem, velocity, builder, collisions }.assemble_problem(NoProbe);
            problem.activate_matching(velocity, &evaluation.contacts, &self.contacts);
        }
        if self.scheme.implicit_forces {
            pass.find_step_impulses(Solve::Prediction, options, problem, velocity, &evaluation.contacts, rule);
            VelocityLoop { context, free, problem, velocity, builder, collisions }.correct_free_velocity(NoProbe);
        }
        self.v_free.copy_from_slice(&free.v);
        pass.find_step_impulses(Solve::Velocity, options, problem, velocity, &evaluation.contacts, rule);
        integrate_velocity(compiled, &free.smooth.mass, &free.v, &velocity.impulses, &mut velocity.v);
        integrate_positions(context, velocity, position, NoProbe);
        if self.split {
            self.correct_positions(context, free, problem, velocity, position, pass, rule);
        }
    }

    /// Evaluates stage 8, the position correction. `pass` selects the source of the impulses.
    #[expect(clippy::too_many_arguments, reason = "the values of a step, one by one")]
    fn correct_positions(
        &mut self,
        context: StepContext<'_, R>,
        free: &FreeMotion<R>,
        problem: &ConstraintProblem<R>,
        velocity: &mut VelocitySolution<R>,
        position: &mut PositionSolution<R>,
        pass: Pass,
        rule: &mut dyn ImpulseRule<R>,
    ) {
        let StepContext { input: StepInput { compiled, options, .. }, evaluation: Evaluation { contacts, .. } } = context;
        if pass == Pass::Nominal {
            // Equality errors that are zero, and not corrected in the step, are nonzero at a displaced state.
            let ConstraintProblem { needs_position_solve, constrained, .. } = problem;
            self.corrected = if compiled.equalities.is_empty() { needs_position_solve.bits() } else { constrained.bits() };
            self.correction = R::zero();
        }
        if self.corrected == 0 {
            return;
        }
        position.copy_rows(problem);
        position.v_free.copy_from_slice(&free.v);
        let corrected = R::Mask::from_bits(self.corrected);
        let (mass, h) = (&free.smooth.mass, self.scheme.h);
        let rebounding = problem.impact_lanes();
        let rows = PositionInput { compiled, options, problem, mass, contacts, lanes: corrected, rebounding, h };
        damp_rows(&rows, &velocity.impulses, position);
        let VelocitySolution { impulses, newton, .. } = velocity;
        let system = position.rows.system(&problem.rows);
        let names = ConstraintNames { problem, contacts };
        let one = ImpulseProblem { solve: Solve::Position, system, impulses, lanes: self.corrected, names };
        pass.find_impulses(options, one, newton, corrected, rule);
        let ratio = find_correction(&rows, velocity, position);
        self.correction = R::select(corrected, ratio, R::zero());
        displace(compiled, &position.q, &position.correction, h, &mut position.q_corrected);
        select_into(&mut position.q, &position.q_corrected, corrected);
    }

    /// Kind of recomputation that the constraint rows need after a displacement of the part `recomputed` of the state.
    ///
    /// All rows are recomputed if forces change the mass matrix, as implicit servos or drag do. Otherwise a change of velocities only
    /// changes the free velocity, unless target velocities depend on the velocity before the step.
    pub(super) fn rows_by(&self, compiled: &LaneModel<R>, recomputed: Recomputed) -> Recomputed {
        let plain = compiled.equalities.is_empty() && compiled.tendons.iter().all(|tendon| tendon.spring.is_none());
        match recomputed {
            _ if compiled.num_actuator_dynamics > 0 || compiled.lossy => Recomputed::Configuration,
            Recomputed::Velocity if self.scheme.implicit_forces => Recomputed::Configuration,
            Recomputed::Forces if self.scheme.implicit_forces && !compiled.servos.is_empty() => Recomputed::Configuration,
            Recomputed::Velocity if plain && !compiled.has_contact_springs && !any_elastic(&self.contacts) => Recomputed::Forces,
            Recomputed::Forces if any_elastic(&self.contacts) => Recomputed::Configuration,
            recomputed => recomputed,
        }
    }
}

impl Pass {
    /// Finds the impulses of the velocity solve (stage 5) or of the prediction before it, selected by `solve`. The solver computes them, or
    /// `rule` sets them.
    fn find_step_impulses<R: Real>(
        self,
        solve: Solve,
        options: &StepSettings,
        problem: &ConstraintProblem<R>,
        velocity: &mut VelocitySolution<R>,
        contacts: &Contacts<R>,
        rule: &mut dyn ImpulseRule<R>,
    ) {
        let VelocitySolution { impulses, newton, .. } = velocity;
        let (system, names) = ((&problem.rows).into(), ConstraintNames { problem, contacts });
        let one = ImpulseProblem { solve, system, impulses, lanes: R::Mask::splat(true).bits(), names };
        self.find_impulses(options, one, newton, problem.constrained, rule);
    }

    /// Finds the impulses of one constraint problem, which has rows in the lanes `constrained`. The solver computes them, or `rule` sets
    /// them.
    fn find_impulses<R: Real>(
        self,
        options: &StepSettings,
        problem: ImpulseProblem<'_, R>,
        newton: &mut Newton,
        constrained: R::Mask,
        rule: &mut dyn ImpulseRule<R>,
    ) {
        match self {
            Self::Nominal => {
                let [sweeps, newton_steps] = options.iteration_limits();
                let tolerance = R::of(options.tolerance);
                let settings = Settings::new(sweeps, newton_steps, tolerance);
                let outcome = stepper_solve::solve(problem.system, problem.impulses, settings, constrained, newton);
                rule.keep(problem, outcome.residual);
            }
            Self::Displaced => rule.set(problem),
        }
    }
}

/// Whether the predicted velocity has a first-order effect on forces even at rest. Fluid drag and some servos have such an effect; inertial
/// forces are quadratic in the velocity, and dampers are implicit.
fn depends_on_prediction<R: Real>(compiled: &LaneModel<R>) -> bool {
    let pushes = |k: usize| {
        let ActuatorParams { gain, bias } = compiled.params.actuator(k);
        gain[2].eq(R::zero()).and(bias[2].le(R::zero())).not().any()
    };
    !compiled.fluid.is_empty() || compiled.servos.iter().any(|servo| pushes(servo.actuator))
}
