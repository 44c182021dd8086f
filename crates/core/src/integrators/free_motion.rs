//! Stages 1 to 3 at the configuration where a scheme takes the step.

use stepper_real::{Mask, Real};

use crate::actuation::forces::{ActuatorForces, Implicit};
use crate::compile::LaneModel;
use crate::dynamics::kinematics::{advance, displace};
use crate::dynamics::mocap;
use crate::integrators::scheme::Scheme;
use crate::integrators::workspace::Workspace;
use crate::options::Integrator;
use crate::probe::{Counter, Probe, Span};
use crate::stages::s01_actuate::{actuate, advance_activation, regather};
use crate::stages::s03_detect::detect;

/// Stage 3. Returns the lanes that are taken too far from the beginning of the step.
pub(crate) fn find_contacts<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>, probe: impl Probe) -> R::Mask {
    detect(compiled, &s.kinematics, [&s.v, &s.v_free], [scheme.h, scheme.lead], s.alive, &mut s.poses, &mut s.new_contacts, probe)
}

/// Goes to the configuration at which forces are taken, with poses and transmissions there.
pub(crate) fn place_bodies<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>, probe: impl Probe) {
    probe.span(Span::Displace, || displace_evaluation(compiled, scheme, s));
    probe.span(Span::Kinematics, || {
        mocap::pose_bodies(compiled, &s.mocap_trajectories, R::of(s.elapsed) + scheme.lead, &mut s.kinematics);
        s.kinematics.update(compiled, &s.q_eval);
    });
    probe.span(Span::Actuate, || s.actuator_forces.transmit(compiled, &s.kinematics, &s.v, scheme.reach));
}

/// The configuration and activations at which forces are taken.
fn displace_evaluation<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>) {
    if scheme.integrator.in_the_middle() {
        displace(compiled, &s.q, &s.v, scheme.lead, &mut s.q_eval);
        advance_activation(compiled, &s.act, &s.act, &s.inputs.ctrl, scheme.lead, &mut s.act_eval);
    } else {
        s.q_eval.copy_from_slice(&s.q);
        s.act_eval.copy_from_slice(&s.act);
    }
    if scheme.integrator == Integrator::Implicit {
        displace(compiled, &s.q_eval, &s.v, scheme.reach, &mut s.q_ahead);
    }
}

/// Stages 1 and 2: the velocity at the end of the step if nothing were in the way.
pub(crate) fn free_motion<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>, probe: impl Probe) {
    probe.count(Counter::Evaluations, || 1.0);
    probe.span(Span::Actuate, || {
        s.smooth.apply(compiled, &s.kinematics, [&s.inputs.qfrc, &s.inputs.xfrc], &mut s.applied);
        s.actuator_forces.release();
    });
    probe.span(Span::MassMatrix, || s.smooth.assemble_mass(compiled, &s.kinematics, scheme.joints(compiled)));
    probe.span(Span::Actuate, || actuate_freely(compiled, scheme, s));
    probe.span(Span::MassFactors, || s.smooth.complete_mass(compiled, &s.kinematics, implicit(compiled, scheme, &s.actuator_forces, &s.v)));
    probe.span(Span::Acceleration, || s.smooth.acceleration(compiled, &s.kinematics, [&s.actuator_forces.tau, &s.applied], &s.v, &s.v));
    if compiled.servos_are_bounded && (scheme.corrects || compiled.actuator_dynamics > 0) {
        probe.span(Span::SaturateServos, || saturate_servos(compiled, scheme, s));
    }
    if compiled.lossy {
        probe.span(Span::Actuate, || s.actuator_forces.lose(compiled, &s.inputs.actuator_dynamics, true));
    }
    probe.span(Span::Acceleration, || advance(&s.v, &s.smooth.acc, scheme.h, &mut s.v_free));
}

/// Stage 1 at the velocity before the step.
fn actuate_freely<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>) {
    if scheme.integrator.in_the_middle() && !compiled.servos.is_empty() {
        s.actuator_forces.gauge(compiled, &s.smooth.inertia);
    }
    let at = scheme.forces_at([&s.q_eval, &s.q_ahead], [&s.v, &s.v], &s.act_eval, &s.inputs);
    actuate(compiled, &at, scheme.servos(), &mut s.actuator_forces);
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

/// How often servos are looked at again after others have reached their bounds.
const SATURATION_PASSES: usize = 4;

/// Takes the stiffness from servos whose force would exceed its bounds, and with it the mass matrix that they had part in.
fn saturate_servos<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>) {
    for pass in 0..SATURATION_PASSES {
        // The change of velocity to be expected: by the forces, and by constraints that push as in the last step.
        s.v_next.copy_from_slice(&s.impulse);
        s.smooth.solve(compiled, &mut s.v_next);
        advance(&s.v_next, &s.smooth.acc, scheme.h, &mut s.v_mean);
        // Lanes in which nothing is new do it all again and find the same bits.
        if s.actuator_forces.saturate(compiled, &s.inputs.actuator_dynamics, scheme.weights, &s.v_mean, scheme.h, pass).and(s.alive).none()
        {
            return;
        }
        regather(compiled, scheme.springs_at(&s.q_eval, &s.q_ahead), scheme.corrects, &mut s.actuator_forces);
        s.smooth.factor_mass_again(compiled, &s.kinematics, implicit(compiled, scheme, &s.actuator_forces, &s.v));
        s.smooth.acceleration_again(compiled, [&s.actuator_forces.tau, &s.applied], &s.v);
    }
}
