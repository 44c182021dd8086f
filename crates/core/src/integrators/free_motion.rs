//! Free motion: stages 1 and 2, which compute the velocity after the step without constraints.

use stepper_real::Real;

use crate::actuation::forces::{ActuatorForces, Implicit};
use crate::compile::LaneModel;
use crate::dynamics::kinematics::advance;
use crate::integrators::scheme::Scheme;
use crate::integrators::step_values::{Evaluation, FreeMotion, Place, StepInput};
use crate::probe::{Counter, Probe, Span};
use crate::stages::s01_actuate::{actuate, advance_activation};

/// Computes stages 1 and 2: forces, mass matrix and free velocity at the evaluation point. The forces use the velocity before the step.
#[inline(always)]
pub(crate) fn compute_free_motion<R: Real>(place: Place<'_, R>, free: &mut FreeMotion<R>, probe: impl Probe) {
    let Place { input: StepInput { compiled, state, inputs, .. }, evaluation: Evaluation { scheme, kinematics, .. } } = place;
    probe.count(Counter::Evaluations, || 1.0);
    probe.span(Span::Actuate, || {
        free.smooth.apply(compiled, kinematics, [&inputs.qfrc, &inputs.xfrc], &mut free.applied);
    });
    probe.span(Span::MassMatrix, || free.smooth.assemble_mass(compiled, kinematics, scheme.joint_weights(compiled)));
    probe.span(Span::Actuate, || actuate_at_velocity_before(place, free));
    probe.span(Span::MassFactors, || {
        let FreeMotion { smooth, actuator_forces, .. } = free;
        smooth.complete_mass(compiled, kinematics, implicit(compiled, scheme, actuator_forces, &state.v));
    });
    probe.span(Span::Acceleration, || free.accelerate(compiled, kinematics, &state.v, &state.v));
    if compiled.lossy {
        let FreeMotion { smooth, actuator_forces, .. } = free;
        let expected = Some((scheme.implicit_servos(), &smooth.acc[..]));
        probe.span(Span::Actuate, || actuator_forces.dissipate(compiled, &inputs.actuator_dynamics, expected));
    }
    probe.span(Span::Acceleration, || advance(&state.v, &free.smooth.acc, scheme.h, &mut free.v));
}

/// Recomputes stages 1 and 2 after a change of velocities, activations or controls. The mass matrix does not change.
pub(crate) fn recompute_free_motion<R: Real>(input: StepInput<'_, R>, evaluation: &mut Evaluation<R>, free: &mut FreeMotion<R>) {
    let StepInput { compiled, state, .. } = input;
    advance_activations(input, evaluation);
    let scheme = evaluation.scheme;
    free.actuator_forces.transmit(compiled, &evaluation.kinematics, &state.v, scheme.time_ahead);
    actuate_at_velocity_before(Place { input, evaluation }, free);
    free.accelerate(compiled, &evaluation.kinematics, &state.v, &state.v);
    advance(&state.v, &free.smooth.acc, scheme.h, &mut free.v);
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

/// Whether the model has servos with bounds whose forces are implicit. Their active bounds then change the mass matrix.
pub(crate) fn has_bounded_servos<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>) -> bool {
    compiled.servos_are_bounded && (scheme.implicit_forces || compiled.num_actuator_dynamics > 0)
}

/// Computes the actuator and spring forces (stage 1), with all velocity-dependent forces at the velocity before the step.
fn actuate_at_velocity_before<R: Real>(place: Place<'_, R>, free: &mut FreeMotion<R>) {
    let Place { input: StepInput { compiled, state, .. }, evaluation: Evaluation { scheme, .. } } = place;
    if (scheme.in_the_middle || compiled.servos_are_bounded) && !compiled.servos.is_empty() {
        free.actuator_forces.compute_effective_inertia(compiled, &free.smooth.inertia, &state.impulse);
    }
    actuate(compiled, &place.forces_at(&state.v), Some(scheme.implicit_servos()), &mut free.actuator_forces);
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
