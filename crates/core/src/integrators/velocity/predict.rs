//! Prediction of the velocity after the step, and of the forces that depend on it.
//!
//! The solver leaves out the rows of contacts that seem not to touch in this step: they are deferred (`contact_activation.rs`). The
//! prediction activates those whose geoms collide in the predicted motion. Such a collision is doubtful if the error of the prediction can
//! cause it; its contact is deferred again after the prediction.

use stepper_real::{Mask, Real, kernel};

use crate::dynamics::gyroscopic;
use crate::dynamics::kinematics::{advance, blend, difference};
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::evaluate::free_motion::{FreeMotion, Scratch, stop_at_impacts};
use crate::integrators::step_input::{StepContext, StepInput};
use crate::integrators::step_resolution::assess_corrector;
use crate::integrators::velocity::velocity_loop::VelocityLoop;
use crate::probe::{Probe, span};
use crate::stages::s01_actuate::actuate;
use crate::stages::s05_solve::ImpulsePredictor;
use crate::stages::s06_integrate_velocity::find_velocity_change;

impl<R: Real> VelocityLoop<'_, R> {
    /// Predicts the velocity after the step with approximate constraint impulses, and recomputes the forces that depend on this velocity.
    /// With Euler's rule the function does nothing.
    ///
    /// The prediction includes impulses, because a robot that stands would fall without them, and its forces would be those of a fall.
    /// Lanes whose bodies move predict new impulses, from zero or from the impulses of the last step (`ImpulsePredictor` in stage 5). In
    /// lanes at rest, the impulses of the last step are the prediction. Only the impulses of eliminated equalities are recomputed there.
    #[inline(always)]
    pub(crate) fn predict(&mut self, probe: impl Probe) {
        let StepContext { input: StepInput { compiled, options, state, alive, .. }, evaluation: Evaluation { scheme, .. } } = self.context;
        if !scheme.implicit_forces {
            return;
        }
        let constrained = self.problem.constrained.or(self.problem.deferred_lanes(alive));
        let predictor = ImpulsePredictor::new(compiled, options, &state.v, scheme.h, self.velocity);
        if constrained.any() {
            span!(probe, EstimateImpulses, || {
                // First the impulses without deferred contacts, then those with the deferred contacts that collide in the predicted motion.
                predictor.make(options, constrained, self.problem, self.velocity);
                self.predict_collisions(&predictor, constrained);
            });
        }
        self.correct_free_velocity(probe);
        if constrained.any() {
            // The prediction has served its purpose. From here on, its impulses are only a possible start of the solve.
            span!(probe, EstimateImpulses, || predictor.choose_start(constrained, self.problem, self.velocity));
            if self.problem.has_doubtful_contacts() {
                self.problem.defer_doubtful(self.velocity);
            }
        }
    }

    /// Recomputes the free velocity, with velocity-dependent forces at the force velocity. The force velocity follows from the current
    /// impulses. With the midpoint rule it is the mean of the velocities before and after the step, with the implicit rule the velocity
    /// after the step.
    ///
    /// One such correction suffices for the second order of the midpoint rule. The function also shifts the offsets g of the rows of
    /// `problem`, because they contain the free velocity.
    #[inline(always)]
    pub(crate) fn correct_free_velocity(&mut self, probe: impl Probe) {
        let Self { context, free, problem, velocity, .. } = self;
        let StepContext {
            input: StepInput { compiled, state, alive, .. },
            evaluation: Evaluation { scheme, substep, times, kinematics, .. },
        } = *context;
        let FreeMotion { smooth, actuator_forces, applied, v, v_expected, unresolved, scratch, .. } = &mut **free;
        let Scratch { velocity_by_impulses, force_velocity, v_free_corrected, free_change, motions, .. } = scratch;
        find_velocity_change(compiled, &smooth.mass, &velocity.impulses, velocity_by_impulses);
        advance(v, velocity_by_impulses, R::one(), v_expected);
        unresolved.fill(R::Mask::splat(false));
        let flights = alive.and_not(substep.is_impact);
        if flights.none() {
            // Impacts take no time, in which forces could act.
            free.may_gain = flights;
            return;
        }
        blend(&state.v, v_expected, scheme.velocity_weight, force_velocity);
        // In stage 1 only forces of servos depend on the velocity.
        if !compiled.servos.is_empty() {
            span!(probe, Actuate, || actuate(
                compiled,
                &context.forces_at(force_velocity),
                Some(scheme.implicit_servos_at_prediction()),
                actuator_forces
            ));
        }
        span!(probe, Acceleration, || smooth.acceleration(compiled, kinematics, [&actuator_forces.tau, applied], &state.v, force_velocity));
        advance(&state.v, &smooth.acc, scheme.h, v_free_corrected);
        // `correct` replaces the gyroscopic torque of single bodies by one that keeps angular momentum.
        if !compiled.single_bodies.is_empty() && scheme.in_the_middle {
            let times_of = |dof: usize| times.around(compiled.mechanism_of(dof));
            let velocities = [&state.v[..], force_velocity];
            gyroscopic::correct(compiled, kinematics, &smooth.mass, times_of, velocities, v_free_corrected, (flights, unresolved));
        }
        stop_at_impacts(*context, v_free_corrected);
        difference(v_free_corrected, v, free_change);
        // This function is the corrector of the free velocity. If it changes the velocity too much, the time step is too long for the
        // motion.
        let (velocities, outputs) = ([&state.v[..], v_free_corrected, free_change], (&mut motions[..], &mut unresolved[..]));
        free.may_gain = assess_corrector(compiled, alive, velocities, scheme.h, outputs);
        if free.unresolved_lanes().any() {
            leave_out_inertial_forces(*context, free);
        }
        std::mem::swap(&mut free.v, &mut free.scratch.v_free_corrected);
        problem.shift(compiled, &free.smooth.mass, &mut free.scratch.free_change);
    }
}

/// Recomputes the free velocity without velocity-dependent inertial forces (Coriolis, centrifugal, gyroscopic) of the mechanisms whose
/// motion is too fast for the time step. There servos use the velocity before the step.
fn leave_out_inertial_forces<R: Real>(context: StepContext<'_, R>, free: &mut FreeMotion<R>) {
    let StepContext { input: StepInput { compiled, state, .. }, evaluation: Evaluation { scheme, kinematics, .. } } = context;
    let FreeMotion { smooth, actuator_forces, applied, v, v_expected, unresolved, scratch, .. } = free;
    let Scratch { force_velocity: zero_velocity, actuator_velocity, v_free_corrected, free_change, .. } = scratch;
    // In the other mechanisms, actuator forces must keep all bits, because later solves of the step read them. There `actuate` evaluates
    // them again at the same velocity.
    kernel!(R, || {
        for i in 0..compiled.nv {
            let mean = state.v[i] + (v_expected[i] - state.v[i]) * scheme.velocity_weight;
            actuator_velocity[i] = R::select(unresolved[compiled.mechanism_of(i)], state.v[i], mean);
        }
    });
    actuate(compiled, &context.forces_at(actuator_velocity), Some(scheme.implicit_servos_at_prediction()), actuator_forces);
    zero_velocity.fill(R::zero());
    smooth.acceleration(compiled, kinematics, [&actuator_forces.tau, applied], &state.v, zero_velocity);
    kernel!(R, || {
        for i in 0..compiled.nv {
            let v_without_inertial_forces = state.v[i] + smooth.acc[i] * scheme.h;
            let lanes = unresolved[compiled.mechanism_of(i)];
            v_free_corrected[i] = R::select(lanes, v_without_inertial_forces, v_free_corrected[i]);
            free_change[i] = R::select(lanes, v_without_inertial_forces - v[i], free_change[i]);
        }
    })
}
