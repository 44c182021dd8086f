//! First-order response of the impulses of a solved step, with hard contact, to small changes of its constraint rows.

use stepper_core::group_step::{
    Gap, GroupStep, ImpulseProblem, ImpulseRule, NominalEvaluation, Prediction, Recomputed, Solve, StepSettings,
};
use stepper_core::{Options, Stabilization};
use stepper_real::{Mask, Real};
use stepper_solve::newton::{Response, Switch, SwitchDistance};

/// Largest residual at which a step counts as solved, m/s; ten times the solver's tolerance if that is larger.
///
/// At such a residual the contact modes (open, sticking, slipping) are certain, and the error of the response is of the order of the
/// residual.
const SOLVED_RESIDUAL: f64 = 1e-9;

/// Weight of the prediction error in the test whether a step has a response, per rad or m of motion within the step. A step has no response
/// if the weighted error is above the residual at which a step counts as solved. The weight of any motion is at most 1.
///
/// The prediction error is the difference between the velocity that the solved step predicted and the velocity of a second prediction at
/// the same state. Errors of slow motion count less, because inertial forces are quadratic in velocities.
const EXPECTED_VELOCITY_WEIGHT: f64 = 1e2;

/// Smallest distance of a position correction's speed from its upper bound at which the correction counts as differentiable, as a fraction
/// of the bound.
const BOUND_DISTANCE: f64 = 1e-3;

/// Lanes whose residual is small enough that the step has a derivative.
pub(crate) fn is_solved<R: Real>(settings: &StepSettings, residual: R) -> R::Mask {
    residual.le(R::of(SOLVED_RESIDUAL.max(10.0 * settings.tolerance)))
}

/// First-order response of a step's impulses to changes of its constraint rows, for hard contact.
#[derive(Clone, Debug)]
pub(crate) struct HardResponse<R: Real> {
    /// First-order response of the impulses of the prediction solve, which predicts the velocity for velocity-dependent forces.
    prediction: Response<R>,
    /// First-order response of the impulses of the velocity solve.
    velocity: Response<R>,
    /// First-order response of the impulses of the position solve in stage 8.
    position: Response<R>,
    /// Gaps at which the target velocity of a contact or a limit has a corner, m or rad.
    edges: Vec<f64>,
}

/// Rule that sets the impulses of a step at a displaced state, by the first-order response of the solved step's impulses.
pub(crate) struct Rule<'a, R: Real> {
    response: &'a mut HardResponse<R>,
    /// Settings of the step, which define when a solution counts as solved.
    settings: StepSettings,
    /// Lanes (bits) that have a response, and in which all constraints of the solved step also exist at the displaced state.
    lanes: u32,
    /// Callback for each constraint that has come closer to another mode (open, sticking, slipping).
    near: &'a mut dyn FnMut(SwitchDistance),
}

impl<R: Real> HardResponse<R> {
    /// Response of one solve of the step: prediction, velocity or position.
    ///
    /// For the position solve, the second result is the response of the velocity solve. Damping in the position solve acts on the
    /// difference between the impulses of the position solve and of the velocity solve.
    fn of(&mut self, solve: Solve) -> (&mut Response<R>, Option<&Response<R>>) {
        match solve {
            Solve::Prediction => (&mut self.prediction, None),
            Solve::Velocity => (&mut self.velocity, None),
            Solve::Position => (&mut self.position, Some(&self.velocity)),
        }
    }
}

impl<R: Real> ImpulseRule<R> for Rule<'_, R> {
    /// Computes and stores the response of the impulses of a solved constraint problem. Lanes without a response are removed from
    /// `self.lanes`.
    fn keep(&mut self, problem: ImpulseProblem<'_, R>, residual: R) {
        let ImpulseProblem { solve, system, impulses, lanes, names } = problem;
        let (response, before) = self.response.of(solve);
        self.lanes &= !lanes | is_solved(&self.settings, residual).bits();
        let name = |i: usize, lane: usize| names.of(i, lane);
        self.lanes &= !lanes | response.settle(system, impulses, self.lanes & lanes, name, before);
    }

    /// Sets the impulses of the constraint problem at a displaced state, from the stored first-order response to the changes of the
    /// constraint rows. Lanes in which a constraint of the solved step no longer exists are removed from `self.lanes`.
    fn set(&mut self, problem: ImpulseProblem<'_, R>) {
        let ImpulseProblem { solve, system, impulses, lanes, names } = problem;
        let (response, before) = self.response.of(solve);
        let name = |i: usize, lane: usize| names.of(i, lane);
        self.lanes &= !response.respond(system, impulses, self.lanes & lanes, name, before);
        response.compare(system, impulses, self.lanes & lanes, &mut *self.near);
    }
}

impl<R: Real> HardResponse<R> {
    /// Workspace for the response, with these settings of the step.
    pub(crate) fn new(settings: &StepSettings) -> Self {
        let [prediction, velocity, position] = [(); 3].map(|()| Response::default());
        Self { prediction, velocity, position, edges: edges(settings) }
    }

    /// Creates the rule that sets the impulses of a step at a displaced state, in the lanes `lanes` (bits). The rule calls `near` with each
    /// constraint that has come closer to another mode (open, sticking, slipping).
    pub(crate) fn rule<'a>(&'a mut self, settings: &StepSettings, lanes: u32, near: &'a mut dyn FnMut(SwitchDistance)) -> Rule<'a, R> {
        Rule { response: self, settings: *settings, lanes, near }
    }

    /// Computes the response in the lanes `lanes` (bits): first derivatives of the impulses with respect to displacements of the state.
    /// Returns the lanes that have a response.
    ///
    /// A lane has no response if its residual is too large, or if the constraint rows do not determine its impulses. The same holds if a
    /// contact bounces, a position correction is at its bound, or a second prediction differs from the prediction of the solved step.
    pub(crate) fn prepare(&mut self, step: &mut GroupStep<R>, lanes: u32) -> u32 {
        let settings = *step.settings();
        let mut ignore = |_| {};
        let mut rule = self.rule(&settings, lanes, &mut ignore);
        let NominalEvaluation { bouncing, correction, prediction } = step.evaluate_nominal(&mut rule);
        // A position correction at its bound depends only on its fastest joint, and has no response.
        let lanes = rule.lanes & !bouncing & correction.lt(R::of(1.0 - BOUND_DISTANCE)).bits();
        let Some(Prediction { drives_forces, solved, difference, motion }) = prediction else { return lanes };
        // If the solved step predicted another velocity, the prediction is not a solution of its rows, and has no response.
        let has_expected = |weight: R| is_solved(&settings, difference * weight.min(R::one())).bits();
        // At rest, the prediction uses the impulses of the last step.
        if drives_forces {
            return lanes & solved & has_expected(R::one());
        }
        lanes & (!solved | has_expected(motion * R::of(EXPECTED_VELOCITY_WEIGHT)))
    }

    /// Evaluates the step at the displaced state in the lanes `lanes` (bits), with impulses from the response.
    ///
    /// Of the lanes `lanes`, returns those in which all constraints with impulses in the solved step also exist at the displaced state. The
    /// function calls `near` with each constraint that has come closer to another mode (open, sticking, slipping).
    pub(crate) fn follow(
        &mut self,
        step: &mut GroupStep<R>,
        recomputed: Recomputed,
        lanes: u32,
        near: &mut dyn FnMut(SwitchDistance),
    ) -> u32 {
        let settings = *step.settings();
        let mut rule = self.rule(&settings, lanes, near);
        let moved = step.evaluate(recomputed, &mut rule);
        let left = rule.lanes;
        if !moved {
            return left;
        }
        step.gaps(left, &mut |Gap { lane, nominal, displaced, .. }| {
            for edge in &self.edges {
                let [from, to] = [nominal - edge, displaced - edge];
                // A distance that does not change gives no kink.
                if from * to <= 0.0 || to.abs() < from.abs() {
                    near(SwitchDistance { lane, switch: Switch::Gap, distance: from / (from - to) });
                }
            }
        })
    }
}

/// Gaps at which the target velocity of a contact or a limit has a corner, m or rad. The corners are where the contact closes, and where
/// the correction of an overlap begins.
fn edges(options: &StepSettings) -> Vec<f64> {
    let Options { stabilization, baumgarte, slop, .. } = **options;
    match stabilization {
        Stabilization::Baumgarte if baumgarte == 1.0 && slop == 0.0 => vec![],
        Stabilization::Baumgarte | Stabilization::Split if slop != 0.0 => vec![0.0, -slop],
        _ => vec![0.0],
    }
}
