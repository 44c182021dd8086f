//! Response of a step with hard contact near a solved step: impulses as a first-order function of its rows.

use stepper_core::Stabilization;
use stepper_core::group_step::{
    Gap, GroupStep, ImpulseProblem, ImpulseRule, NominalEvaluation, Prediction, Recomputed, Solve, StepSettings,
};
use stepper_real::{Mask, Real};
use stepper_solve::newton::{Response, Switch, SwitchDistance};

/// Largest residual at which a step counts as solved, m/s, if the tolerance is below a tenth of it. The contact modes (open, sticking,
/// slipping) are then certain, and the error of the response is of this order.
const SOLVED_RESIDUAL: f64 = 1e-9;

/// Weight of an error of the predicted velocity in the test whether the prediction is a solution.
///
/// The weight is per rad or m of displacement in the step, at most 1. Inertial forces are quadratic in velocities, so that errors of slow
/// motion have little effect.
const EXPECTED_VELOCITY_WEIGHT: f64 = 1e2;

/// Distance of a position correction from its bounds, relative to the bounds, below which its derivative is undefined.
const BOUND_DISTANCE: f64 = 1e-3;

/// Lanes whose residual is small enough that the step has a derivative.
pub(crate) fn is_solved<R: Real>(settings: &StepSettings, residual: R) -> R::Mask {
    residual.le(R::of(SOLVED_RESIDUAL.max(10.0 * settings.tolerance)))
}

/// First-order response of a step's impulses to changes of its constraint rows, for hard contact.
#[derive(Clone, Debug)]
pub(crate) struct HardResponse<R: Real> {
    impulses: Impulses<R>,
    /// Gaps at which the target velocity of a contact or a limit has a corner, m or rad.
    edges: Vec<f64>,
}

/// First-order responses of the impulses of all solves of a step.
#[derive(Clone, Debug, Default)]
struct Impulses<R: Real> {
    /// First-order response of the predicted impulses. They solve the same rows before velocity-dependent forces are evaluated.
    prediction: Response<R>,
    /// First-order response of the impulses of the velocity solve.
    velocity: Response<R>,
    /// First-order response of the impulses of the position solve in stage 8.
    position: Response<R>,
}

/// Rule that sets the impulses of an evaluation from the changed rows by their first-order response.
pub(crate) struct Rule<'a, R: Real> {
    impulses: &'a mut Impulses<R>,
    /// Settings of the step, which define when a solution counts as solved.
    settings: StepSettings,
    /// Lanes (bits) that have a response, and in which all constraints of the solved step still exist.
    lanes: u32,
    /// Callback for each constraint that has come closer to another mode (open, sticking, slipping).
    near: &'a mut dyn FnMut(SwitchDistance),
}

impl<R: Real> Impulses<R> {
    /// Response of the solve `solve`. For the position solve, the second result is the response of the velocity solve, because its impulses
    /// are relative to those.
    fn of(&mut self, solve: Solve) -> (&mut Response<R>, Option<&Response<R>>) {
        match solve {
            Solve::Prediction => (&mut self.prediction, None),
            Solve::Velocity => (&mut self.velocity, None),
            Solve::Position => (&mut self.position, Some(&self.velocity)),
        }
    }
}

impl<R: Real> ImpulseRule<R> for Rule<'_, R> {
    /// Computes and stores the response of the impulses in a solution. Lanes without a response are removed from `self.lanes`.
    fn keep(&mut self, problem: ImpulseProblem<'_, R>, residual: R) {
        let ImpulseProblem { solve, system, impulses, lanes, names } = problem;
        let (response, before) = self.impulses.of(solve);
        self.lanes &= !lanes | is_solved(&self.settings, residual).bits();
        let name = |kind: usize, i: usize, lane: usize| names.of(kind, i, lane);
        self.lanes &= !lanes | response.settle(system, impulses, self.lanes & lanes, name, before);
    }

    /// Sets the impulses by the stored response to the present rows. Lanes in which a constraint no longer exists are removed from
    /// `self.lanes`.
    fn set(&mut self, problem: ImpulseProblem<'_, R>) {
        let ImpulseProblem { solve, system, impulses, lanes, names } = problem;
        let (response, before) = self.impulses.of(solve);
        let name = |kind: usize, i: usize, lane: usize| names.of(kind, i, lane);
        self.lanes &= !response.respond(system, impulses, self.lanes & lanes, name, before);
        response.compare(system, impulses, self.lanes & lanes, &mut *self.near);
    }
}

impl<R: Real> HardResponse<R> {
    /// Workspace for the response, with these settings of the step.
    pub(crate) fn new(settings: &StepSettings) -> Self {
        Self { impulses: Impulses::default(), edges: edges(settings) }
    }

    /// Creates the rule that sets impulses in an evaluation, in the lanes `lanes` (bits). `near` receives each constraint that has come
    /// closer to another mode.
    pub(crate) fn rule<'a>(&'a mut self, settings: &StepSettings, lanes: u32, near: &'a mut dyn FnMut(SwitchDistance)) -> Rule<'a, R> {
        Rule { impulses: &mut self.impulses, settings: *settings, lanes, near }
    }

    /// Computes the responses of all solves of the solved step in the lanes `lanes` (bits). Returns the lanes with a response.
    ///
    /// In these lanes the impulses follow from the rows, and velocities and positions follow from the impulses.
    pub(crate) fn settle(&mut self, step: &mut GroupStep<R>, lanes: u32) -> u32 {
        let settings = *step.settings();
        let mut ignore = |_| {};
        let mut rule = self.rule(&settings, lanes, &mut ignore);
        let NominalEvaluation { bouncing, correction, prediction } = step.evaluate_nominal(&mut rule);
        // A correction at its bounds depends only on its fastest joint, and has no response.
        let lanes = rule.lanes & !bouncing & correction.lt(R::of(1.0 - BOUND_DISTANCE)).bits();
        let Some(Prediction { drives_forces, solved, difference, motion }) = prediction else { return lanes };
        // If the nominal step predicted another velocity, the prediction is not a solution of its rows, and has no response.
        let has_expected = |weight: R| is_solved(&settings, difference * weight.min(R::one())).bits();
        // At rest, the prediction uses the impulses of the last step.
        if drives_forces {
            return lanes & solved & has_expected(R::one());
        }
        lanes & (!solved | has_expected(motion * R::of(EXPECTED_VELOCITY_WEIGHT)))
    }

    /// Evaluates the step at the displaced state in the lanes `lanes` (bits). Returns the lanes in which all constraints that pushed still
    /// exist.
    ///
    /// The function calls `near` with each constraint that has come closer to another mode (open, sticking, slipping).
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
    let StepSettings { stabilization, baumgarte, slop, .. } = *options;
    match stabilization {
        Stabilization::Baumgarte if baumgarte == 1.0 && slop == 0.0 => vec![],
        Stabilization::None => vec![0.0],
        _ if slop == 0.0 => vec![0.0],
        _ => vec![0.0, -slop],
    }
}
