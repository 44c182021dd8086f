//! Stages 1 to 3 at the configuration where a scheme takes the step.

use stepper_real::{Mask, Real};

use crate::actuation::forces::{Drive, Implicit};
use crate::compile::LanePlan;
use crate::dynamics::kinematics::{advance, displace};
use crate::dynamics::mocap;
use crate::integrators::scheme::Rule;
use crate::integrators::workspace::Scratch;
use crate::options::Integrator;
use crate::stages::s01_actuate::{actuate, advance_activation, regather};
use crate::stages::s03_detect::detect;

/// Stage 3. Returns the lanes that are taken too far from the beginning of the step.
pub(crate) fn find_contacts<R: Real>(plan: &LanePlan<R>, rule: &Rule<R>, s: &mut Scratch<R>) -> R::Mask {
    detect(plan, &s.kinematics, [&s.v, &s.v_free], [rule.h, rule.lead], s.alive, &mut s.poses, &mut s.new_contacts)
}

/// The configuration and activations at which forces are taken.
pub(crate) fn place<R: Real>(plan: &LanePlan<R>, rule: &Rule<R>, s: &mut Scratch<R>) {
    if rule.integrator.in_the_middle() {
        displace(plan, &s.q, &s.v, rule.lead, &mut s.q_eval);
        advance_activation(plan, &s.act, &s.act, &s.inputs.ctrl, rule.lead, &mut s.act_eval);
    } else {
        s.q_eval.copy_from_slice(&s.q);
        s.act_eval.copy_from_slice(&s.act);
    }
    if rule.integrator == Integrator::Implicit {
        displace(plan, &s.q_eval, &s.v, rule.reach, &mut s.q_ahead);
    }
    mocap::place(plan, &s.ways, R::of(s.elapsed) + rule.lead, &mut s.kinematics);
    s.kinematics.update(plan, &s.q_eval);
    s.drive.transmit(plan, &s.kinematics, &s.v, rule.reach);
}

/// Stages 1 and 2: the velocity at the end of the step if nothing were in the way.
pub(crate) fn free_motion<R: Real>(plan: &LanePlan<R>, rule: &Rule<R>, s: &mut Scratch<R>) {
    s.smooth.apply(plan, &s.kinematics, [&s.inputs.qfrc, &s.inputs.xfrc], &mut s.applied);
    s.drive.release();
    s.smooth.assemble_mass(plan, &s.kinematics, rule.joints(plan));
    if rule.integrator.in_the_middle() && !plan.servos.is_empty() {
        s.drive.gauge(plan, &s.smooth.inertia);
    }
    let at = rule.forces_at([&s.q_eval, &s.q_ahead], [&s.v, &s.v], &s.act_eval, &s.inputs);
    actuate(plan, &at, rule.servos(), &mut s.drive);
    s.smooth.complete_mass(plan, &s.kinematics, implicit(plan, rule, &s.drive, &s.v));
    s.smooth.acceleration(plan, &s.kinematics, [&s.drive.tau, &s.applied], &s.v, &s.v);
    if plan.servos_are_bounded && (rule.corrects || plan.trains > 0) {
        saturate_servos(plan, rule, s);
    }
    if plan.lossy {
        s.drive.lose(plan, &s.inputs.trains, true);
    }
    advance(&s.v, &s.smooth.acc, rule.h, &mut s.v_free);
}

/// What the mass matrix holds besides M.
pub(crate) fn implicit<'a, R: Real>(plan: &LanePlan<R>, rule: &Rule<R>, drive: &'a Drive<R>, v: &'a [R]) -> Implicit<'a, R> {
    let servos: &[R] = if rule.corrects || plan.trains > 0 { &drive.weight } else { &[] };
    Implicit { theta: rule.joints(plan), servos, arms: &drive.arms, drag_at: rule.corrects.then_some(v) }
}

/// How often servos are looked at again after others have reached their bounds.
const SATURATION_PASSES: usize = 4;

/// Takes the stiffness from servos whose force would exceed its bounds, and with it the mass matrix that they had part in.
fn saturate_servos<R: Real>(plan: &LanePlan<R>, rule: &Rule<R>, s: &mut Scratch<R>) {
    for pass in 0..SATURATION_PASSES {
        // The change of velocity to be expected: by the forces, and by constraints that push as in the last step.
        s.v_next.copy_from_slice(&s.impulse);
        s.smooth.solve(plan, &mut s.v_next);
        advance(&s.v_next, &s.smooth.acc, rule.h, &mut s.v_mean);
        // Lanes in which nothing is new do it all again and find the same bits.
        if s.drive.saturate(plan, &s.inputs.trains, rule.theta, &s.v_mean, rule.h, pass).and(s.alive).none() {
            return;
        }
        regather(plan, rule.springs_at(&s.q_eval, &s.q_ahead), rule.corrects, &mut s.drive);
        s.smooth.factor_mass_again(plan, &s.kinematics, implicit(plan, rule, &s.drive, &s.v));
        s.smooth.acceleration_again(plan, [&s.drive.tau, &s.applied], &s.v);
    }
}
