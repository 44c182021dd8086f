//! Input of a step, and the same input together with the evaluation point.

use stepper_real::Real;

use crate::actuation::forces::ForceState;
use crate::compile::LaneModel;
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::inputs::Inputs;
use crate::integrators::state::State;
use crate::options::StepSettings;

/// Input of a step: model, settings, state and user inputs. After the step is accepted, `state` is the next state.
#[derive(Clone, Copy)]
pub(crate) struct StepInput<'a, R: Real> {
    pub(crate) compiled: &'a LaneModel<R>,
    pub(crate) options: &'a StepSettings,
    pub(crate) state: &'a State<R>,
    pub(crate) inputs: &'a Inputs<R>,
    /// Lanes that have an environment. The last group of a batch can have unused lanes.
    pub(crate) alive: R::Mask,
}

/// Input of a step together with its evaluation point (the time in the step at which forces and contacts are evaluated). Stages 4 to 8 read
/// it and do not change it.
#[derive(Clone, Copy)]
pub(crate) struct StepContext<'a, R: Real> {
    pub(crate) input: StepInput<'a, R>,
    pub(crate) evaluation: &'a Evaluation<R>,
}

impl<'a, R: Real> StepContext<'a, R> {
    /// Inputs of the force computation (stage 1) at the evaluation point. Explicit velocity-dependent forces are evaluated at the velocity
    /// `v_at`.
    pub(crate) fn forces_at(&self, v_at: &'a [R]) -> ForceState<'a, R> {
        let StepContext { input: StepInput { state, inputs, .. }, evaluation: Evaluation { scheme, q, q_ahead, act, .. } } = *self;
        let Inputs { ctrl, actuator_dynamics, .. } = inputs;
        ForceState {
            q: if scheme.looks_ahead() { q_ahead } else { q },
            v: &state.v,
            v_at,
            act,
            time_left: scheme.h - scheme.time_before,
            ctrl,
            actuator_dynamics,
        }
    }
}
