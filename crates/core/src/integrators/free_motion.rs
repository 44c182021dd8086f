//! Stages 1 to 3 at the configuration where a scheme takes the step.

use stepper_real::{Mask, Real};

use crate::actuation::forces::{ActuatorForces, Implicit};
use crate::compile::LaneModel;
use crate::dynamics::kinematics::{advance, displace};
use crate::dynamics::mocap;
use crate::integrators::scheme::Scheme;
use crate::integrators::workspace::Workspace;
use crate::probe::{Counter, Probe, Span};
use crate::stages::s01_actuate::{actuate, advance_activation, regather};
use crate::stages::s03_detect::detect;
use crate::tuning::SATURATION_PASSES;

/// Stage 3. Returns the lanes that are taken too far from the beginning of the step.
#[inline(always)]
pub(crate) fn find_contacts<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>, probe: impl Probe) -> R::Mask {
    detect(
        compiled,
        &s.evaluation.kinematics,
        [&s.state.v, &s.free_motion.v],
        [scheme.h, scheme.time_before],
        s.alive,
        &mut s.poses,
        &mut s.evaluation.contacts,
        probe,
    )
}

/// Goes to the configuration at which forces are taken, with poses and transmissions there.
#[inline(always)]
pub(crate) fn place_bodies<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>, probe: impl Probe) {
    probe.span(Span::Displace, || displace_evaluation(compiled, scheme, s));
    probe.span(Span::Kinematics, || {
        mocap::pose_bodies(compiled, &s.mocap_trajectories, R::of(s.elapsed) + scheme.time_before, &mut s.evaluation.kinematics);
        s.evaluation.kinematics.update(compiled, &s.evaluation.q);
    });
    probe.span(Span::Actuate, || s.free_motion.actuator_forces.transmit(compiled, &s.evaluation.kinematics, &s.state.v, scheme.time_ahead));
}

/// The configuration and activations at which forces are taken.
#[inline(always)]
fn displace_evaluation<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>) {
    if scheme.in_the_middle {
        displace(compiled, &s.state.q, &s.state.v, scheme.time_before, &mut s.evaluation.q);
    } else {
        s.evaluation.q.copy_from_slice(&s.state.q);
    }
    advance_evaluation(compiled, scheme, s);
    if scheme.looks_ahead {
        displace(compiled, &s.evaluation.q, &s.state.v, scheme.time_ahead, &mut s.evaluation.q_ahead);
    }
}

/// The activations at which forces are taken.
#[inline(always)]
fn advance_evaluation<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>) {
    if scheme.in_the_middle {
        advance_activation(compiled, &s.state.act, &s.state.act, &s.inputs.ctrl, scheme.time_before, &mut s.evaluation.act);
    } else {
        s.evaluation.act.copy_from_slice(&s.state.act);
    }
}

/// Stages 1 and 2: the velocity at the end of the step if nothing were in the way.
#[inline(always)]
pub(crate) fn free_motion<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>, probe: impl Probe) {
    probe.count(Counter::Evaluations, || 1.0);
    probe.span(Span::Actuate, || {
        s.free_motion.smooth.apply(compiled, &s.evaluation.kinematics, [&s.inputs.qfrc, &s.inputs.xfrc], &mut s.free_motion.applied);
        s.free_motion.actuator_forces.release();
    });
    probe.span(Span::MassMatrix, || s.free_motion.smooth.assemble_mass(compiled, &s.evaluation.kinematics, scheme.joints(compiled)));
    probe.span(Span::Actuate, || actuate_freely(compiled, scheme, s));
    probe.span(Span::MassFactors, || {
        s.free_motion.smooth.complete_mass(
            compiled,
            &s.evaluation.kinematics,
            implicit(compiled, scheme, &s.free_motion.actuator_forces, &s.state.v),
        )
    });
    probe.span(Span::Acceleration, || s.free_motion.accelerate(compiled, &s.evaluation.kinematics, &s.state.v, &s.state.v));
    if compiled.servos_are_bounded && (scheme.corrects || compiled.actuator_dynamics > 0) {
        probe.span(Span::SaturateServos, || saturate_servos(compiled, scheme, s));
    }
    if compiled.lossy {
        probe.span(Span::Actuate, || s.free_motion.actuator_forces.dissipate(compiled, &s.inputs.actuator_dynamics, true));
    }
    probe.span(Span::Acceleration, || advance(&s.state.v, &s.free_motion.smooth.acc, scheme.h, &mut s.free_motion.v));
}

/// Stages 1 and 2 again where velocities, activations or controls alone are others, and the mass matrix depends on none of them.
pub(crate) fn renew_forces<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>) {
    advance_evaluation(compiled, scheme, s);
    s.free_motion.actuator_forces.transmit(compiled, &s.evaluation.kinematics, &s.state.v, scheme.time_ahead);
    actuate_freely(compiled, scheme, s);
    s.free_motion.accelerate(compiled, &s.evaluation.kinematics, &s.state.v, &s.state.v);
    advance(&s.state.v, &s.free_motion.smooth.acc, scheme.h, &mut s.free_motion.v);
}

/// Stage 1 at the velocity before the step.
fn actuate_freely<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>) {
    if scheme.in_the_middle && !compiled.servos.is_empty() {
        s.free_motion.actuator_forces.compute_effective_inertia(compiled, &s.free_motion.smooth.inertia);
    }
    let at = scheme.forces_at([&s.evaluation.q, &s.evaluation.q_ahead], [&s.state.v, &s.state.v], &s.evaluation.act, &s.inputs);
    actuate(compiled, &at, scheme.servos(), &mut s.free_motion.actuator_forces);
}

/// What the mass matrix holds besides M.
pub(crate) fn implicit<'a, R: Real>(
    compiled: &LaneModel<R>,
    scheme: &Scheme<R>,
    actuator_forces: &'a ActuatorForces<R>,
    v: &'a [R],
) -> Implicit<'a, R> {
    let servos: &[R] = if scheme.corrects || compiled.actuator_dynamics > 0 { &actuator_forces.weight } else { &[] };
    Implicit { weights: scheme.joints(compiled), servos, arms: &actuator_forces.arms, drag_at: scheme.corrects.then_some(v) }
}

/// Takes the stiffness from servos whose force would exceed its bounds, and with it the mass matrix that they had part in.
fn saturate_servos<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>) {
    for pass in 0..SATURATION_PASSES {
        // The change of velocity to be expected: by the forces, and by constraints that push as in the last step.
        s.work.impulse_change.copy_from_slice(&s.state.impulse);
        s.free_motion.smooth.solve(compiled, &mut s.work.impulse_change);
        advance(&s.work.impulse_change, &s.free_motion.smooth.acc, scheme.h, &mut s.work.expected_change);
        // Lanes in which nothing is new do it all again and find the same bits.
        if s.free_motion
            .actuator_forces
            .saturate(compiled, &s.inputs.actuator_dynamics, scheme.weights, &s.work.expected_change, scheme.h, pass)
            .and(s.alive)
            .none()
        {
            return;
        }
        regather(compiled, scheme.springs_at(&s.evaluation.q, &s.evaluation.q_ahead), scheme.corrects, &mut s.free_motion.actuator_forces);
        s.free_motion.smooth.refactor_mass(
            compiled,
            &s.evaluation.kinematics,
            implicit(compiled, scheme, &s.free_motion.actuator_forces, &s.state.v),
        );
        s.free_motion.smooth.recompute_acceleration(compiled, [&s.free_motion.actuator_forces.tau, &s.free_motion.applied], &s.state.v);
    }
}
