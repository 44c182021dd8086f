//! MuJoCo's integrators, for its contact law.
//!
//! Constraint forces follow from accelerations at the state before the step, or at the stages of the Runge-Kutta method. Velocities and
//! positions advance as in `engine_forward.c`.
//!
//! * Euler (`mj_Euler`): v+ = v + h (M + h B)^-1 M a, then q+ = q (+) h v+. Here a is the acceleration of the constrained motion, and B is
//!   the damping of the joints.
//! * implicitfast (`mj_implicit`): Euler's rule, in which B also has the damping of tendons, actuators and the medium.
//! * implicit: implicitfast with the derivative of Coriolis forces.
//! * Runge-Kutta of order 4 (`mj_RungeKutta`): constraints are solved at each of the four stages.

pub(crate) mod acceleration;
mod implicit;
mod runge_kutta;
pub mod unsymmetric;
pub(crate) mod workspace;

use stepper_real::{Mask, Real, Scalar};

use crate::collision::tunnelling::{TestedMotion, may_have_passed};
use crate::compile::LaneModel;
use crate::constraints::PositionSolution;
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::evaluate::recomputed::Recomputed;
use crate::integrators::mujoco::acceleration::Acceleration;
use crate::integrators::mujoco::implicit::integrate_velocity;
use crate::integrators::mujoco::runge_kutta::runge_kutta;
use crate::integrators::mujoco::unsymmetric::Unsymmetric;
use crate::integrators::mujoco::workspace::MujocoWorkspace;
use crate::integrators::step_input::StepInput;
use crate::integrators::step_outcome::StepOutcome;
use crate::integrators::workspace::Workspace;
use crate::options::{Integrator, StepSettings};
use crate::probe::{Counter, NoProbe, Probe, span};
use crate::stages::s01_actuate::advance_activation;
use crate::stages::s07_integrate_position::integrate_position;
use crate::stages::s08_stabilise::Infeasible;
use crate::tuning::{FAST_ROTATION, MAX_IMPULSE_ROTATION};

/// Workspace of MuJoCo's law, which a model that is compiled with this law has.
fn mujoco_workspace<R: Real>(mujoco: &mut Option<Box<MujocoWorkspace<R>>>) -> &mut MujocoWorkspace<R> {
    mujoco.as_deref_mut().expect("a workspace of this contact law")
}

/// Makes stages 1 to 7 of a step with MuJoCo's contact law: from forces to positions. Writes the next state to the velocity and position
/// solutions.
#[inline(always)]
pub(crate) fn solve_step<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    probe: impl Probe,
) -> StepOutcome<R> {
    let Workspace { state, inputs, evaluation, free_motion: free, mujoco, velocity, builder, position, alive, .. } = s;
    let MujocoWorkspace { system, stage, runge_kutta: stages, unsymmetric } = mujoco_workspace(mujoco);
    let input = StepInput { compiled, options, state, inputs, alive: *alive };
    stage.copy_from(state);
    evaluation.times.reset(R::of(options.timestep), R::zero(), R::zero());
    let mut acceleration = Acceleration { evaluation, free, system, velocity, builder };
    let solver = if let Some(stages) = stages {
        runge_kutta(input, (stage, stages), &mut acceleration, position, probe)
    } else {
        let solver = acceleration.compute(input, stage, true, probe);
        advance(input, &mut acceleration, unsymmetric, position, probe);
        solver
    };
    let none = R::Mask::splat(false);
    let contacts_at_end = options.integrator == Integrator::Rk4;
    // The Runge-Kutta method resolves larger rotations.
    let rotation = if contacts_at_end { MAX_IMPULSE_ROTATION } else { FAST_ROTATION };
    let (inertia, h) = ((&evaluation.kinematics, &free.smooth.mass), R::of(options.timestep));
    let (velocities, outputs) = ([&state.v[..], &velocity.v[..]], (&mut free.scratch.motions[..], &mut free.unresolved[..]));
    span!(probe, GuardEnergy, || s.step_resolution.assess_explicit_step(compiled, *alive, inertia, velocities, (rotation, h), outputs));
    let motion = TestedMotion { velocity: &velocity.v, is_free: false, time: R::of(options.timestep), contacts_at_end };
    let Evaluation { kinematics, collision, .. } = evaluation;
    let tunnelled = span!(probe, Tunnelling, || may_have_passed(compiled, kinematics, motion, *alive, collision));
    probe.count(Counter::NewtonSteps, || (0..R::LANES).map(|l| solver.newton_steps.lane(l).to_f64()).sum());
    std::mem::swap(&mut state.impulse, &mut free.constraint_impulse);
    StepOutcome { solver, ambiguous: none, infeasible: Infeasible::none(), tunnelled, energy_unresolved: none }
}

/// Makes stages 6 and 7 of a step: advances velocity and positions with the constrained acceleration.
#[inline(always)]
fn advance<R: Real>(
    input: StepInput<'_, R>,
    acceleration: &mut Acceleration<'_, R>,
    unsymmetric: &mut Option<Unsymmetric<R>>,
    position: &mut PositionSolution<R>,
    probe: impl Probe,
) {
    let StepInput { compiled, options, state, inputs, .. } = input;
    let Acceleration { evaluation, free, system, velocity, .. } = acceleration;
    let h = R::of(options.timestep);
    let (kinematics, v_next) = (&evaluation.kinematics, &mut velocity.v);
    span!(probe, IntegrateVelocity, || integrate_velocity(input, kinematics, free, system, unsymmetric, v_next));
    span!(probe, IntegratePosition, || {
        integrate_position(compiled, &state.q, &velocity.v, &evaluation.times, &mut position.q);
        advance_activation(compiled, &state.act, &state.act, &inputs.ctrl, h, &mut position.act);
    });
}

/// Makes stages 1 to 7 of a step from a slightly displaced state, for derivatives. The workspace `s` has the displaced state, and gets the
/// result.
///
/// `solution` is the acceleration of the solved step, which starts from the state without displacement. Stage 5 does not solve again, but
/// adds the first-order change of the acceleration that the displacement causes. `recomputed` selects the quantities that the displacement
/// changes.
pub(crate) fn respond_step<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    s: &mut Workspace<R>,
    solution: &[R],
    recomputed: Recomputed,
) {
    let Workspace { state, inputs, evaluation, free_motion: free, mujoco, velocity, builder, position, alive, .. } = s;
    let MujocoWorkspace { system, stage, unsymmetric, .. } = mujoco_workspace(mujoco);
    let input = StepInput { compiled, options, state, inputs, alive: *alive };
    stage.copy_from(state);
    evaluation.times.reset(R::of(options.timestep), R::zero(), R::zero());
    let mut acceleration = Acceleration { evaluation, free, system, velocity, builder };
    acceleration.prepare(input, stage, recomputed, NoProbe);
    acceleration.system.acceleration.copy_from_slice(solution);
    acceleration.system.respond(compiled, &acceleration.free.smooth.mass, &acceleration.free.smooth.acc);
    advance(input, &mut acceleration, unsymmetric, position, NoProbe);
}
