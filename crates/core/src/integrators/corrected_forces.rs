//! Forces that depend on the velocity, taken again at the velocity that an estimate of the impulses leads to.

use stepper_real::{Mask, Real};

use crate::compile::LaneModel;
use crate::dynamics::gyroscopic;
use crate::dynamics::kinematics::{advance, blend};
use crate::integrators::scheme::Scheme;
use crate::integrators::step_resolution::unresolved;
use crate::integrators::workspace::Workspace;
use crate::probe::{Probe, Span};
use crate::stages::s01_actuate::actuate;
use crate::stages::s05_solve::{estimate, forget_estimate};

/// Compares where servos are on their bounds with what an estimate of the impulses says, which takes the place of those of the last step where the two
/// differ. Returns whether they do in any lane.
pub(crate) fn reconsider_servos<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>) -> bool {
    let lanes = s.constraints.constrained;
    estimate(&s.v, scheme.h, lanes, &mut s.constraints);
    s.constraints.impulse_change(compiled, &s.smooth.mass, &mut s.v_mean);
    R::vectorize(
        #[inline(always)]
        || {
            for i in 0..compiled.nv {
                s.v_mean[i] = (s.v_free[i] - s.v[i]) + s.v_mean[i];
            }
        },
    );
    let wrong =
        s.actuator_forces.misjudged(compiled, &s.inputs.actuator_dynamics, scheme.weights, &s.v_mean, scheme.h).and(lanes).and(s.alive);
    if wrong.any() {
        R::vectorize(
            #[inline(always)]
            || {
                s.change.copy_from_slice(&s.constraints.iterate.w);
                s.smooth.mass.momentum(compiled, &mut s.change);
                for (kept, &now) in s.impulse.iter_mut().zip(&s.change) {
                    *kept = R::select(wrong, now, *kept);
                }
            },
        );
    }
    forget_estimate(lanes, &mut s.constraints);
    wrong.any()
}

/// Stages 1 and 2 again, with the forces that depend on the velocity taken at the mean of v and the velocity to be expected at the end of the
/// step (or at that velocity itself): one corrector pass, which keeps the midpoint rule's second order.
///
/// What is to be expected includes the impulses of constraints, so that a robot at rest feels no force of a motion that its contacts prevent. They are
/// those of this step, so that where it ends follows from where it begins.
pub(crate) fn correct_forces<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>, probe: impl Probe) {
    let constrained = s.constraints.constrained;
    if constrained.any() {
        probe.span(Span::EstimateImpulses, || estimate(&s.v, scheme.h, constrained, &mut s.constraints));
    }
    s.constraints.impulse_change(compiled, &s.smooth.mass, &mut s.v_mean);
    leave_out_blows(scheme, &s.v_free, &mut s.v_mean);
    advance(&s.v_free, &s.v_mean, R::one(), &mut s.expected);
    blend(&s.v, &s.v_free, scheme.share, &mut s.v_mean);
    // Without servos no force of stage 1 depends on the velocity.
    if !compiled.servos.is_empty() {
        let at = scheme.forces_at([&s.q_eval, &s.q_ahead], [&s.v, &s.v_mean], &s.act_eval, &s.inputs);
        probe.span(Span::Actuate, || actuate(compiled, &at, scheme.servos(), &mut s.actuator_forces));
    }
    probe
        .span(Span::Acceleration, || s.smooth.acceleration(compiled, &s.kinematics, [&s.actuator_forces.tau, &s.applied], &s.v, &s.v_mean));
    advance(&s.v, &s.smooth.acc, scheme.h, &mut s.v_next);
    if !compiled.spinners.is_empty() && scheme.integrator.in_the_middle() {
        gyroscopic::correct(compiled, &s.kinematics, &s.smooth.mass, [scheme.lead, scheme.rest], [&s.v, &s.v_mean], &mut s.v_next);
    }
    advance(&s.v_next, &s.v_free, -R::one(), &mut s.v_mean);
    s.unresolved = unresolved(compiled, &s.v, &s.v_next, &s.v_mean, scheme.h).and(s.alive);
    if s.unresolved.any() {
        leave_out_inertial_forces(compiled, scheme, s);
    }
    std::mem::swap(&mut s.v_free, &mut s.v_next);
    s.constraints.shift(compiled, &s.smooth.mass, &mut s.v_mean, R::Mask::splat(true));
    if constrained.any() {
        probe.span(Span::EstimateImpulses, || forget_estimate(constrained, &mut s.constraints));
    }
}

/// Turn by a blow within the step beyond which the velocity after it says nothing of the forces in it, rad.
const BLOW: f64 = 0.1;

/// Leaves the `change` by impulses out of what is to be expected in lanes in which it turns by so much that it makes the motion faster than the step
/// resolves: forces of that motion would feed it.
fn leave_out_blows<R: Real>(scheme: &Scheme<R>, v_free: &[R], change: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
            let (mut most, mut free, mut pushed) = (R::zero(), R::zero(), R::zero());
            for (&change, &v) in change.iter().zip(v_free) {
                most = most.max(change.abs());
                free = free.max(v.abs());
                pushed = pushed.max((v + change).abs());
            }
            let blow = (scheme.h * most).gt(R::of(BLOW)).and(pushed.gt(free));
            if blow.any() {
                for change in change {
                    *change = R::select(blow, R::zero(), *change);
                }
            }
        },
    )
}

/// In unresolved lanes, the free velocity without velocity-dependent inertial forces, and its change by that.
fn leave_out_inertial_forces<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>) {
    // The other lanes' forces stay those of their mean velocity, to the bit: further solutions read them.
    R::vectorize(
        #[inline(always)]
        || {
            for i in 0..compiled.nv {
                let mean = s.v[i] + (s.expected[i] - s.v[i]) * scheme.share;
                s.change[i] = R::select(s.unresolved, s.v[i], mean);
            }
        },
    );
    let at = scheme.forces_at([&s.q_eval, &s.q_ahead], [&s.v, &s.change], &s.act_eval, &s.inputs);
    actuate(compiled, &at, scheme.servos(), &mut s.actuator_forces);
    s.smooth.acceleration(compiled, &s.kinematics, [&s.actuator_forces.tau, &s.applied], &s.v, &s.step_resolution.rest);
    R::vectorize(
        #[inline(always)]
        || {
            for i in 0..compiled.nv {
                let still = s.v[i] + s.smooth.acc[i] * scheme.h;
                s.v_next[i] = R::select(s.unresolved, still, s.v_next[i]);
                s.v_mean[i] = R::select(s.unresolved, still - s.v_free[i], s.v_mean[i]);
            }
        },
    )
}
