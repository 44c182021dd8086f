//! Forces that depend on the velocity, taken again at the velocity that an estimate of the impulses leads to.

use stepper_real::{Mask, Real};

use crate::compile::LaneModel;
use crate::dynamics::gyroscopic;
use crate::dynamics::kinematics::{advance, blend};
use crate::integrators::scheme::Scheme;
use crate::integrators::step_resolution::assess_corrector;
use crate::integrators::struck_contacts::predict_strikes;
use crate::integrators::workspace::Workspace;
use crate::options::StepSettings;
use crate::probe::{Probe, Span};
use crate::stages::s01_actuate::actuate;
use crate::stages::s04_assemble::assemble_demands;
use crate::stages::s05_solve::Estimate;
use crate::tuning::MAX_IMPACT_ROTATION;

/// Compares where servos are on their bounds with what an estimate of the impulses says, which takes the place of those of the last step
/// where the two differ. Returns whether they do in any lane.
pub(crate) fn reconsider_servos<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    scheme: &Scheme<R>,
    s: &mut Workspace<R>,
) -> bool {
    let lanes = s.constraints.constrained;
    let estimate = Estimate::new(compiled, options, &s.state.v, scheme.h, &s.constraints);
    estimate.make(options, lanes, &mut s.constraints);
    s.constraints.impulse_change(compiled, &s.free_motion.smooth.mass, &mut s.work.expected_change);
    R::vectorize(
        #[inline(always)]
        || {
            for i in 0..compiled.nv {
                s.work.expected_change[i] = (s.free_motion.v[i] - s.state.v[i]) + s.work.expected_change[i];
            }
        },
    );
    let wrong = s
        .free_motion
        .actuator_forces
        .misjudged(compiled, &s.inputs.actuator_dynamics, scheme.weights, &s.work.expected_change, scheme.h)
        .and(lanes)
        .and(s.alive);
    if wrong.any() {
        R::vectorize(
            #[inline(always)]
            || {
                s.work.impulse.copy_from_slice(&s.constraints.iterate.w);
                s.free_motion.smooth.mass.momentum(compiled, &mut s.work.impulse);
                for (kept, &now) in s.state.impulse.iter_mut().zip(&s.work.impulse) {
                    *kept = R::select(wrong, now, *kept);
                }
            },
        );
    }
    estimate.choose_start(lanes, &mut s.constraints);
    wrong.any()
}

/// Stages 1 and 2 again, with the forces that depend on the velocity taken at the mean of v and the velocity to be expected at the end of
/// the step (or at that velocity itself): one corrector pass, which keeps the midpoint rule's second order.
///
/// What is to be expected includes the impulses of constraints, so that a robot at rest feels no force of a motion that its contacts
/// prevent. They are those of this step, so that where it ends follows from where it begins.
pub(crate) fn correct_forces<R: Real>(
    compiled: &LaneModel<R>,
    options: &StepSettings,
    scheme: &Scheme<R>,
    s: &mut Workspace<R>,
    probe: impl Probe,
) {
    let constrained = s.constraints.constrained.or(s.constraints.deferred_lanes(s.alive));
    let estimate = Estimate::new(compiled, options, &s.state.v, scheme.h, &s.constraints);
    if constrained.any() {
        probe.span(Span::EstimateImpulses, || {
            estimate.make(options, constrained, &mut s.constraints);
            predict_strikes(compiled, options, &estimate, s, constrained);
        });
    }
    recompute_forces(compiled, scheme, s, probe);
    if constrained.any() {
        probe.span(Span::EstimateImpulses, || estimate.choose_start(constrained, &mut s.constraints));
    }
}

/// The pass of [`correct_forces`], at the velocity that the present impulses lead to.
pub(crate) fn recompute_forces<R: Real>(compiled: &LaneModel<R>, scheme: &Scheme<R>, s: &mut Workspace<R>, probe: impl Probe) {
    s.constraints.impulse_change(compiled, &s.free_motion.smooth.mass, &mut s.work.impulse_change);
    leave_out_blows(scheme, &s.free_motion.v, &mut s.work.impulse_change);
    advance(&s.free_motion.v, &s.work.impulse_change, R::one(), &mut s.free_motion.v_expected);
    blend(&s.state.v, &s.free_motion.v_expected, scheme.velocity_weight, &mut s.work.v_mean);
    // Without servos no force of stage 1 depends on the velocity.
    if !compiled.servos.is_empty() {
        let at = scheme.forces_at([&s.evaluation.q, &s.evaluation.q_ahead], [&s.state.v, &s.work.v_mean], &s.evaluation.act, &s.inputs);
        probe.span(Span::Actuate, || actuate(compiled, &at, scheme.servos(), &mut s.free_motion.actuator_forces));
    }
    probe.span(Span::Acceleration, || s.free_motion.accelerate(compiled, &s.evaluation.kinematics, &s.state.v, &s.work.v_mean));
    advance(&s.state.v, &s.free_motion.smooth.acc, scheme.h, &mut s.work.v_free_corrected);
    if !compiled.spinners.is_empty() && scheme.in_the_middle {
        gyroscopic::correct(
            compiled,
            &s.evaluation.kinematics,
            &s.free_motion.smooth.mass,
            [scheme.time_before, scheme.time_after],
            [&s.state.v, &s.work.v_mean],
            &mut s.work.v_free_corrected,
        );
    }
    advance(&s.work.v_free_corrected, &s.free_motion.v, -R::one(), &mut s.work.free_change);
    let lanes = assess_corrector(compiled, &s.state.v, &s.work.v_free_corrected, &s.work.free_change, scheme.h);
    [s.free_motion.unresolved, s.free_motion.may_gain] = lanes.map(|lanes| lanes.and(s.alive));
    if s.free_motion.unresolved.any() {
        leave_out_inertial_forces(compiled, scheme, s);
    }
    std::mem::swap(&mut s.free_motion.v, &mut s.work.v_free_corrected);
    let everywhere = R::Mask::splat(true);
    assemble_demands(compiled, &s.free_motion.smooth.mass, &mut s.constraints, &mut s.work.free_change, None, everywhere);
}

/// Leaves the `change` by impulses out of what is to be expected in lanes in which it turns by so much that it makes the motion faster than
/// the step resolves: forces of that motion would feed it.
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
            let blow = (scheme.h * most).gt(R::of(MAX_IMPACT_ROTATION)).and(pushed.gt(free));
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
                let mean = s.state.v[i] + (s.free_motion.v_expected[i] - s.state.v[i]) * scheme.velocity_weight;
                s.work.v_forces[i] = R::select(s.free_motion.unresolved, s.state.v[i], mean);
            }
        },
    );
    let at = scheme.forces_at([&s.evaluation.q, &s.evaluation.q_ahead], [&s.state.v, &s.work.v_forces], &s.evaluation.act, &s.inputs);
    actuate(compiled, &at, scheme.servos(), &mut s.free_motion.actuator_forces);
    s.free_motion.accelerate(compiled, &s.evaluation.kinematics, &s.state.v, &s.step_resolution.zero_velocity);
    R::vectorize(
        #[inline(always)]
        || {
            for i in 0..compiled.nv {
                let still = s.state.v[i] + s.free_motion.smooth.acc[i] * scheme.h;
                s.work.v_free_corrected[i] = R::select(s.free_motion.unresolved, still, s.work.v_free_corrected[i]);
                s.work.free_change[i] = R::select(s.free_motion.unresolved, still - s.free_motion.v[i], s.work.free_change[i]);
            }
        },
    )
}
