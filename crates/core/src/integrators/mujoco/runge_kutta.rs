//! The classical Runge-Kutta method of order 4 with constraints.
//!
//! The unknowns are a displacement theta from the configuration at the beginning, the velocity and the activations. A displacement of a
//! rotation follows theta' = dexpinv(omega) with angular velocities in the body's frame (Munthe-Kaas 1998; so MuJoCo has it since 4.0).

use stepper_real::Real;
use stepper_solve::Outcome;

use crate::compile::LaneModel;
use crate::dynamics::kinematics::displace;
use crate::integrators::mujoco::acceleration::accelerate;
use crate::integrators::mujoco::stages::RungeKuttaStages;
use crate::integrators::workspace::Workspace;
use crate::math::spatial::*;
use crate::model::JointKind;
use crate::options::StepSettings;
use crate::probe::Probe;
use crate::stages::s01_actuate::{activation_rate, clamp_activation};

/// Stages of the Runge-Kutta method: the time of each, as a fraction of the step, and its weight.
const STAGES: [[f64; 2]; 4] = [[0.0, 1.0 / 6.0], [0.5, 1.0 / 3.0], [0.5, 1.0 / 3.0], [1.0, 1.0 / 6.0]];

/// Stages 1 to 7 of the classical Runge-Kutta method of order 4.
pub(super) fn runge_kutta<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    h: R,
    s: &mut Workspace<R>,
    probe: impl Probe,
) -> Outcome<R> {
    let Some(mut stages) = s.mujoco.runge_kutta.take() else { unreachable!("made with the workspace for this integrator") };
    for (kept, now) in stages.start.iter_mut().zip([&s.state.q, &s.state.v, &s.state.act]) {
        kept.copy_from_slice(now);
    }
    stages.sum.iter_mut().for_each(|sum| sum.fill(R::zero()));
    let mut outcome: Option<Outcome<R>> = None;
    for (i, [part, weight]) in STAGES.into_iter().enumerate() {
        if i > 0 {
            move_stage(compiled, h * R::of(part), &stages, s);
        }
        let now = accelerate(compiled, options, h, s, i == 0, probe);
        outcome = Some(match outcome {
            None => now,
            Some(before) => R::vectorize(
                #[inline(always)]
                || Outcome {
                    residual: before.residual.max(now.residual),
                    sweeps: before.sweeps + now.sweeps,
                    newton_steps: before.newton_steps + now.newton_steps,
                },
            ),
        });
        activation_rate(compiled, &s.state.act, &s.inputs.ctrl, &mut stages.rate[1]);
        find_rates(compiled, h * R::of(part), &s.state.v, &mut stages.rate[0]);
        let acceleration = s.problem.soft.as_ref().map_or(&s.free_motion.smooth.acc, |system| &system.acceleration);
        R::vectorize(
            #[inline(always)]
            || {
                let rates = [&stages.rate[0], acceleration, &stages.rate[1]];
                for (sum, rate) in stages.sum.iter_mut().zip(rates) {
                    for (sum, &rate) in sum.iter_mut().zip(rate) {
                        *sum += R::of(weight) * rate;
                    }
                }
            },
        );
    }
    let [q, v, act] = &mut stages.start;
    s.state.q.copy_from_slice(q);
    s.state.v.copy_from_slice(v);
    s.state.act.copy_from_slice(act);
    R::vectorize(
        #[inline(always)]
        || {
            for ((next, &v), &a) in s.velocity.v.iter_mut().zip(&*v).zip(&stages.sum[1]) {
                *next = v + h * a;
            }
            for ((next, &act), &rate) in s.position.act.iter_mut().zip(&*act).zip(&stages.sum[2]) {
                *next = act + h * rate;
            }
            clamp_activation(compiled, &mut s.position.act);
        },
    );
    displace(compiled, q, &stages.sum[0], h, &mut s.position.q);
    s.mujoco.runge_kutta = Some(stages);
    outcome.unwrap_or(Outcome { residual: R::zero(), sweeps: R::zero(), newton_steps: R::zero() })
}

/// Computes the displacement rates at a stage, with the velocity `v`. `rates` holds those of the previous stage, which led to this one in
/// `time` seconds.
fn find_rates<R: Real>(compiled: &LaneModel<R>, time: R, v: &[R], rates: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
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
                // The displacement at the beginning is zero, whatever the rates are.
                let moved = time.gt(R::zero());
                let rotation = select(moved, scale([rates[at], rates[at + 1], rates[at + 2]], time), zero());
                rates[at..at + 3].copy_from_slice(&rotation_rate(rotation, [v[at], v[at + 1], v[at + 2]]));
            }
        },
    )
}

/// Moves `s.state` to the next stage, `time` seconds after the beginning, with the rates of the last stage.
fn move_stage<R: Real>(compiled: &LaneModel<R>, time: R, stages: &RungeKuttaStages<R>, s: &mut Workspace<R>) {
    let [q, v, act] = &stages.start;
    let acceleration = s.problem.soft.as_ref().map_or(&s.free_motion.smooth.acc, |system| &system.acceleration);
    displace(compiled, q, &stages.rate[0], time, &mut s.state.q);
    R::vectorize(
        #[inline(always)]
        || {
            for ((next, &v), &a) in s.state.v.iter_mut().zip(v).zip(acceleration) {
                *next = v + time * a;
            }
            for ((next, &act), &rate) in s.state.act.iter_mut().zip(act).zip(&stages.rate[1]) {
                *next = act + time * rate;
            }
        },
    );
}
