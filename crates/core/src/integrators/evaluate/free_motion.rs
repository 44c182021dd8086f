//! Free motion: stages 1 and 2, which compute the velocity after the step without constraints.

use stepper_real::{Mask, Real};

use crate::actuation::forces::{ActuatorForces, Implicit};
use crate::collision::adhesion::set_adhesive_arms;
use crate::compile::{LaneModel, obstacle_count};
use crate::dynamics::kinematics::{Kinematics, advance, select_into};
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::evaluate::mechanism_motion::{Jump, MechanismMotion};
use crate::integrators::evaluate::scheme::Scheme;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::probe::{Counter, Probe, span};
use crate::stages::s01_actuate::{actuate, advance_activation};
use crate::stages::s02_smooth::Smooth;

/// Free motion of the step (the motion without constraints), the forces that cause it, and the predicted velocity after the step.
#[derive(Clone, Debug)]
pub(crate) struct FreeMotion<R: Real> {
    /// Mass matrix, bias forces and acceleration.
    pub(crate) smooth: Smooth<R>,
    /// Forces of actuators and joint springs.
    pub(crate) actuator_forces: ActuatorForces<R>,
    /// For each obstacle in the paths of tendons, 1 if the tendon touches it at the evaluation point, otherwise 0.
    pub(crate) touches: Vec<R>,
    /// Generalized forces that the user applied, nv. With MuJoCo's contact law they include those of tendon springs and dampers.
    pub(crate) applied: Vec<R>,
    /// Velocity after the step without constraints, nv.
    pub(crate) v: Vec<R>,
    /// Predicted velocity after the step, constraints included, nv. The force velocity is a mean of this velocity and the one before the
    /// step, weighted with [`Scheme::velocity_weight`].
    pub(crate) v_expected: Vec<R>,
    /// Generalized impulse of the constraints in this step, nv.
    pub(crate) constraint_impulse: Vec<R>,
    /// Lanes in which the motion of each mechanism is too fast for the time step. The step leaves out its inertial forces, or limits its
    /// velocity.
    pub(crate) unresolved: Vec<R::Mask>,
    /// Lanes whose motion is so fast that the error of the integration rule may add energy.
    pub(crate) may_gain: R::Mask,
    /// Buffers of the functions that compute the free motion.
    pub(crate) scratch: Scratch<R>,
}

/// Scratch buffers of the free motion, each named after its usual content and, unless stated otherwise, of length nv. A function fills a
/// buffer before it reads it.
#[derive(Clone, Debug)]
pub(crate) struct Scratch<R: Real> {
    /// Change of the velocity by constraint impulses.
    pub(crate) velocity_by_impulses: Vec<R>,
    /// Change of the velocity by the whole step.
    pub(crate) velocity_change: Vec<R>,
    /// Workspace for generalized impulses.
    pub(crate) impulse: Vec<R>,
    /// Force velocity: velocity at which velocity-dependent forces are evaluated. With the midpoint rule it is the mean of the velocities
    /// before and after the step, with the implicit rule the velocity after it.
    pub(crate) force_velocity: Vec<R>,
    /// Velocity at which actuator forces are recomputed if some lanes are too fast for the time step. In these lanes it is the velocity
    /// before the step, in the others the force velocity.
    pub(crate) actuator_velocity: Vec<R>,
    /// Velocity after the step without constraints, with the forces at the force velocity.
    pub(crate) v_free_corrected: Vec<R>,
    /// Change of the free velocity from `v` to `v_free_corrected`.
    pub(crate) free_change: Vec<R>,
    /// Free velocity after the first half of the step.
    pub(crate) v_half: Vec<R>,
    /// Largest velocities of each mechanism.
    pub(crate) motions: Vec<MechanismMotion<R>>,
    /// Largest velocities of each mechanism in the search for impacts.
    pub(crate) jumps: Vec<Jump<R>>,
    /// Lanes in which the inertial forces of each mechanism are recomputed, because an impact changed its velocity.
    pub(crate) impacts: Vec<R::Mask>,
}

impl<R: Real> Scratch<R> {
    /// Buffers for `nv` degrees of freedom and a number of mechanisms.
    fn new(nv: usize, mechanisms: usize) -> Self {
        let v = || vec![R::zero(); nv];
        Self {
            velocity_by_impulses: v(),
            velocity_change: v(),
            impulse: v(),
            force_velocity: v(),
            actuator_velocity: v(),
            v_free_corrected: v(),
            free_change: v(),
            v_half: v(),
            motions: vec![MechanismMotion::default(); mechanisms],
            jumps: vec![Jump::default(); mechanisms],
            impacts: vec![R::Mask::splat(false); mechanisms],
        }
    }

    /// Fills all buffers with NaN, for tests.
    pub(crate) fn poison(&mut self) {
        let Self { velocity_by_impulses, velocity_change, impulse, force_velocity, .. } = self;
        let Self { actuator_velocity, v_free_corrected, free_change, v_half, .. } = self;
        let buffers =
            [velocity_by_impulses, velocity_change, impulse, force_velocity, actuator_velocity, v_free_corrected, free_change, v_half];
        buffers.into_iter().for_each(|buffer| buffer.fill(R::of(f64::NAN)));
    }
}

impl<R: Real> FreeMotion<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>) -> Self {
        let (v, none) = (|| vec![R::zero(); compiled.nv], R::Mask::splat(false));
        let mechanisms = compiled.mechanisms.count;
        Self {
            smooth: Smooth::new(compiled),
            actuator_forces: ActuatorForces::new(compiled),
            touches: vec![R::zero(); obstacle_count(&compiled.paths)],
            applied: v(),
            v: v(),
            v_expected: v(),
            constraint_impulse: v(),
            unresolved: vec![none; mechanisms],
            may_gain: none,
            scratch: Scratch::new(compiled.nv, mechanisms),
        }
    }

    /// Fills with NaN, for tests, the vectors that a step must compute before it reads them.
    pub(crate) fn poison(&mut self) {
        let Self { applied, v, v_expected, constraint_impulse, scratch, .. } = self;
        [applied, v, v_expected, constraint_impulse].into_iter().for_each(|buffer| buffer.fill(R::of(f64::NAN)));
        scratch.poison();
    }

    /// Numbers that change where tendons and adhesion have kinks: obstacles that tendons touch, and numbers of contacts that actuators
    /// pull.
    pub(crate) fn switches(&self) -> [&[R]; 2] {
        [&self.touches, &self.actuator_forces.pulled]
    }

    /// Lanes in which the motion of any mechanism is too fast for the time step.
    #[inline(always)]
    pub(crate) fn unresolved_lanes(&self) -> R::Mask {
        self.unresolved.iter().fold(R::Mask::splat(false), |lanes, &mechanism| lanes.or(mechanism))
    }

    /// Computes the acceleration by all forces (see [`Smooth::acceleration`]). `v` is the velocity before the step, `v_inertial` the
    /// velocity at which inertial forces are evaluated.
    pub(crate) fn accelerate(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R], v_inertial: &[R]) {
        self.smooth.acceleration(compiled, kinematics, [&self.actuator_forces.tau, &self.applied], v, v_inertial);
    }
}

/// Computes stages 1 and 2 at the evaluation point: forces, mass matrix and free velocity. Velocity-dependent forces are evaluated at the
/// velocity before the step.
#[inline(always)]
pub(crate) fn compute_free_motion<R: Real>(context: StepContext<'_, R>, free: &mut FreeMotion<R>, probe: impl Probe) {
    let StepContext { input: StepInput { compiled, state, inputs, .. }, evaluation: Evaluation { scheme, kinematics, .. } } = context;
    probe.count(Counter::Evaluations, || 1.0);
    span!(probe, Actuate, || {
        free.smooth.apply(compiled, kinematics, [&inputs.qfrc, &inputs.xfrc], &mut free.applied);
    });
    // Stage 2 begins before stage 1, because servos need the diagonal of the mass matrix. It ends after stage 1, because servos add
    // inertia to the mass matrix, and their forces cause acceleration.
    span!(probe, MassMatrix, || free.smooth.assemble_mass(compiled, kinematics, scheme.joint_weights(compiled)));
    span!(probe, Actuate, || actuate_at_velocity_before(context, free));
    span!(probe, MassFactors, || {
        let FreeMotion { smooth, actuator_forces, .. } = free;
        smooth.complete_mass(compiled, kinematics, implicit(compiled, scheme, actuator_forces, &state.v));
    });
    span!(probe, Acceleration, || free.accelerate(compiled, kinematics, &state.v, &state.v));
    // Losses of gears depend on the forces of servos, which depend on the acceleration. They become bounds of dry friction rows, so that
    // the acceleration does not contain them.
    if compiled.lossy {
        let FreeMotion { smooth, actuator_forces, .. } = free;
        let expected = Some((scheme.implicit_servos(), &smooth.acc[..]));
        span!(probe, Actuate, || actuator_forces.compute_losses(compiled, &inputs.actuator_dynamics, &state.v, expected));
    }
    span!(probe, Acceleration, || {
        advance(&state.v, &free.smooth.acc, scheme.h, &mut free.v);
        stop_at_impacts(context, &mut free.v);
    });
}

/// Sets the free velocity in lanes whose substep is an impact to the velocity before it: forces have no time to act.
#[inline(always)]
pub(crate) fn stop_at_impacts<R: Real>(context: StepContext<'_, R>, v_free: &mut [R]) {
    let impacts = context.evaluation.substep.is_impact;
    if impacts.any() {
        select_into(v_free, &context.input.state.v, impacts);
    }
}

/// Recomputes actuator forces and the free velocity (stages 1 and 2) after a change of velocities, activations or controls. Derivatives use
/// this function. It keeps the mass matrix, applied forces, and losses of gears.
pub(crate) fn recompute_free_motion<R: Real>(input: StepInput<'_, R>, evaluation: &mut Evaluation<R>, free: &mut FreeMotion<R>) {
    let StepInput { compiled, state, .. } = input;
    advance_activations(input, evaluation);
    let scheme = evaluation.scheme;
    transmit(input, evaluation, free, true);
    actuate_at_velocity_before(StepContext { input, evaluation }, free);
    free.accelerate(compiled, &evaluation.kinematics, &state.v, &state.v);
    advance(&state.v, &free.smooth.acc, scheme.h, &mut free.v);
}

/// Computes moment arms and lengths of actuators at the evaluation points, and notes the obstacles that tendons touch. `pulls` is whether
/// actuators on contacts pull.
#[inline(always)]
pub(crate) fn transmit<R: Real>(input: StepInput<'_, R>, evaluation: &Evaluation<R>, free: &mut FreeMotion<R>, pulls: bool) {
    let Evaluation { scheme, kinematics, q, contacts, .. } = evaluation;
    free.touches.copy_from_slice(&kinematics.paths.touches);
    free.actuator_forces.transmit(input.compiled, (kinematics, q), (&input.state.v, scheme.time_ahead));
    if pulls {
        set_adhesive_arms(input.compiled, kinematics, contacts, free.actuator_forces.adhesive_arms());
    }
}

/// Advances the activations from the beginning of the step to its evaluation point (the time at which forces are computed).
#[inline(always)]
pub(crate) fn advance_activations<R: Real>(input: StepInput<'_, R>, evaluation: &mut Evaluation<R>) {
    let StepInput { compiled, state, inputs, .. } = input;
    if evaluation.scheme.in_the_middle {
        advance_activation(compiled, &state.act, &state.act, &inputs.ctrl, evaluation.scheme.time_before, &mut evaluation.act);
    } else {
        evaluation.act.copy_from_slice(&state.act);
    }
}

/// Whether the model may have servos with implicit and bounded forces, whose added inertia depends on the active bound.
pub(crate) fn has_bounded_servos<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>) -> bool {
    compiled.servos_are_bounded && (scheme.implicit_forces || compiled.num_actuator_dynamics > 0)
}

/// Computes the actuator and spring forces (stage 1), with all velocity-dependent forces at the velocity before the step.
fn actuate_at_velocity_before<R: Real>(context: StepContext<'_, R>, free: &mut FreeMotion<R>) {
    let StepContext { input: StepInput { compiled, state, .. }, evaluation: Evaluation { scheme, .. } } = context;
    // The inertia that each servo moves. The midpoint rule needs it for the damping of servos (`actuation/forces.rs`), and bounded servos
    // need it for the guess of their active bounds.
    if (scheme.in_the_middle || compiled.servos_are_bounded) && !compiled.servos.is_empty() {
        free.actuator_forces.compute_effective_inertia(compiled, &free.smooth.inertia, &state.impulse);
    }
    actuate(compiled, &context.forces_at(&state.v), Some(scheme.implicit_servos()), &mut free.actuator_forces);
}

/// Implicit terms that the scheme adds to the mass matrix: those of joints and implicit servos. With `implicit_forces`, also the drag of
/// the surrounding fluid.
pub(crate) fn implicit<'a, R: Real>(
    compiled: &LaneModel<R>,
    scheme: &Scheme<R>,
    actuator_forces: &'a ActuatorForces<R>,
    v: &'a [R],
) -> Implicit<'a, R> {
    let servos: &[R] = if scheme.implicit_forces || compiled.num_actuator_dynamics > 0 { &actuator_forces.added_inertia } else { &[] };
    Implicit { weights: scheme.joint_weights(compiled), servos, arms: &actuator_forces.arms, drag_at: scheme.implicit_forces.then_some(v) }
}
