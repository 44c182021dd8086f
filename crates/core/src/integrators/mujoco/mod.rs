//! MuJoCo's integrators, for its contact law.
//!
//! Constraint forces follow from accelerations at the state before the step, or at the stages of the Runge-Kutta method. Velocities and
//! positions advance as in `engine_forward.c`.
//!
//! * Euler (`mj_Euler`): v+ = v + h (M + h B)^-1 M a, then q+ = q (+) h v+. The acceleration a is that of the constrained motion, B the
//!   damping of the joints.
//! * implicitfast (`mj_implicit`): Euler's rule with the damping of tendons, actuators and the medium.
//! * implicit: implicitfast with the derivative of Coriolis forces.
//! * discrete: springs, dampers, servos and constraint rows at the end of the step, in one problem.
//! * Runge-Kutta of order 4 (`mj_RungeKutta`): constraints are solved at each of the four stages.

mod acceleration;
mod discrete;
mod implicit;
mod runge_kutta;
pub mod stages;
pub mod unsymmetric;
pub(crate) mod workspace;

use stepper_real::{Mask, Real, Scalar};

use crate::collision::tunnelling::{TakenStep, may_have_passed};
use crate::compile::LaneModel;
use crate::integrators::mujoco::acceleration::{accelerate, prepare};
use crate::integrators::mujoco::implicit::integrate_velocity;
use crate::integrators::mujoco::runge_kutta::runge_kutta;
use crate::integrators::recomputed::Recomputed;
use crate::integrators::step_outcome::StepOutcome;
use crate::integrators::workspace::Workspace;
use crate::options::{Integrator, StepSettings};
use crate::probe::{Counter, NoProbe, Probe, Span};
use crate::stages::s01_actuate::advance_activation;
use crate::stages::s07_integrate_position::integrate_position;

/// Stages 1 to 7 with MuJoCo's contact law. Writes the next state to `velocity.v`, `position.q` and `position.act`.
pub(crate) fn solve_step<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    probe: impl Probe,
) -> StepOutcome<R> {
    let h = R::of(options.timestep);
    let solver = match options.integrator {
        Integrator::Rk4 => runge_kutta(compiled, options, h, s, probe),
        _ => {
            let outcome = accelerate(compiled, options, h, s, true, probe);
            advance(compiled, options.integrator, h, s, probe);
            outcome
        }
    };
    [s.free_motion.unresolved, s.free_motion.gains] = [R::Mask::splat(false); 2];
    let step = TakenStep { velocity: &s.velocity.v, is_free: false, h, contacts_at_end: options.integrator == Integrator::Rk4 };
    let tunnelled =
        probe.span(Span::Tunnelling, || may_have_passed(compiled, &s.evaluation.kinematics, step, s.alive, &mut s.evaluation.poses));
    probe.count(Counter::NewtonSteps, || (0..R::LANES).map(|l| solver.newton_steps.lane(l).to_f64()).sum());
    let none = R::Mask::splat(false);
    StepOutcome { solver, impulses_act: true, ambiguous: none, limited: none, infeasible: none, tunnelled }
}

/// Stages 6 and 7 with the constrained acceleration.
fn advance<R: Real>(compiled: &LaneModel<R>, integrator: Integrator, h: R, s: &mut Workspace<R>, probe: impl Probe) {
    probe.span(Span::IntegrateVelocity, || match integrator {
        Integrator::Discrete => discrete::integrate_velocity(compiled, h, s),
        _ => integrate_velocity(compiled, h, integrator, s),
    });
    probe.span(Span::IntegratePosition, || {
        integrate_position(compiled, &s.state.q, &s.velocity.v, h, &mut s.position.q);
        advance_activation(compiled, &s.state.act, &s.state.act, &s.inputs.ctrl, h, &mut s.position.act);
    });
}

/// Stages 1 to 7 close to a solved step with the acceleration `solution`. Stage 5 follows it to first order.
pub(crate) fn respond_step<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    solution: &[R],
    recomputed: Recomputed,
) {
    let h = R::of(options.timestep);
    prepare(compiled, options, h, s, recomputed, NoProbe);
    if let Some(system) = &mut s.problem.soft {
        system.acceleration.copy_from_slice(solution);
        system.respond(compiled, &s.free_motion.smooth.mass, &s.free_motion.smooth.acc);
    }
    advance(compiled, options.integrator, h, s, NoProbe);
}
