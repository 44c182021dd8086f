//! Classical Runge-Kutta method of order 4 with constraints, for MuJoCo's contact law.
//!
//! The unknowns are a displacement theta from the configuration before the step, the velocity and the activations. A displacement of a
//! rotation follows theta' = dexpinv(omega) with angular velocities in the body's frame (Munthe-Kaas 1998; MuJoCo uses it since 4.0).

use stepper_real::{Real, kernel};
use stepper_solve::Outcome;

use crate::compile::LaneModel;
use crate::constraints::PositionSolution;
use crate::dynamics::kinematics::{advance, displace};
use crate::integrators::mujoco::acceleration::Acceleration;
use crate::integrators::mujoco::workspace::{RungeKuttaStages, StageState};
use crate::integrators::step_input::StepInput;
use crate::math::spatial::*;
use crate::model::JointKind;
use crate::probe::Probe;
use crate::stages::s01_actuate::{activation_rate, clamp_activation};

/// Four stages of the Runge-Kutta method: time of each, as a fraction of the step, and its weight.
const STAGES: [[f64; 2]; 4] = [[0.0, 1.0 / 6.0], [0.5, 1.0 / 3.0], [0.5, 1.0 / 3.0], [1.0, 1.0 / 6.0]];

/// Makes stages 1 to 7 of a step by the classical Runge-Kutta method of order 4. Writes the next state to `acceleration.velocity` and
/// `position`.
#[inline(always)]
pub(super) fn runge_kutta<R: Real>(
    input: StepInput<'_, R>,
    (stage, stages): (&mut StageState<R>, &mut RungeKuttaStages<R>),
    acceleration: &mut Acceleration<'_, R>,
    position: &mut PositionSolution<R>,
    probe: impl Probe,
) -> Outcome<R> {
    let StepInput { compiled, options, state, inputs, .. } = input;
    let h = R::of(options.timestep);
    stages.sum.iter_mut().for_each(|sum| sum.fill(R::zero()));
    let mut outcome = Outcome { residual: R::zero(), sweeps: R::zero(), newton_steps: R::zero() };
    for (i, [part, weight]) in STAGES.into_iter().enumerate() {
        if i > 0 {
            let time = h * R::of(part);
            displace(compiled, &state.q, &stages.rate[0], time, &mut stage.q);
            advance(&state.v, &acceleration.system.acceleration, time, &mut stage.v);
            advance(&state.act, &stages.rate[1], time, &mut stage.act);
        }
        let now = acceleration.compute(input, stage, i == 0, probe);
        activation_rate(compiled, &stage.act, &inputs.ctrl, &mut stages.rate[1]);
        find_rates(compiled, h * R::of(part), &stage.v, &mut stages.rate[0]);
        kernel!(R, || {
            outcome.residual = outcome.residual.max(now.residual);
            outcome.sweeps += now.sweeps;
            outcome.newton_steps += now.newton_steps;
            let rates = [&stages.rate[0], &acceleration.system.acceleration, &stages.rate[1]];
            for (sum, rate) in stages.sum.iter_mut().zip(rates) {
                for (sum, &rate) in sum.iter_mut().zip(rate) {
                    *sum += R::of(weight) * rate;
                }
            }
        });
    }
    advance(&state.v, &stages.sum[1], h, &mut acceleration.velocity.v);
    advance(&state.act, &stages.sum[2], h, &mut position.act);
    kernel!(R, || clamp_activation(compiled, &mut position.act));
    displace(compiled, &state.q, &stages.sum[0], h, &mut position.q);
    outcome
}

/// Computes the displacement rates at a Runge-Kutta stage with the velocity `v`. On entry, `rates` has the rates of the previous stage,
/// which led to this stage in `time` seconds.
fn find_rates<R: Real>(compiled: &LaneModel<R>, time: R, v: &[R], rates: &mut [R]) {
    kernel!(R, || {
        for joint in &compiled.joints {
            let at = match joint.kind {
                JointKind::Free => joint.v + 3,
                JointKind::Ball => joint.v,
                JointKind::Slide | JointKind::Hinge => {
                    rates[joint.v] = v[joint.v];
                    continue;
                }
            };
            rates[joint.v..at].copy_from_slice(&v[joint.v..at]);
            // The displacement at the beginning is zero, independent of the rates.
            let moved = time.gt(R::zero());
            let rotation = select(moved, scale([rates[at], rates[at + 1], rates[at + 2]], time), zero());
            rates[at..at + 3].copy_from_slice(&rotation_rate(rotation, [v[at], v[at + 1], v[at + 2]]));
        }
    })
}
