//! Energy guard: detects and limits unphysical gains of kinetic energy in a step.

use stepper_real::{Mask, Real};

use crate::constraints::{PositionSolution, VelocitySolution};
use crate::dynamics::kinematics::displace;
use crate::integrators::evaluation::Evaluation;
use crate::integrators::free_motion::FreeMotion;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::integrators::step_resolution::StepResolution;

/// Lanes in which the error of the midpoint rule adds kinetic energy, before positions are corrected.
///
/// The lanes `excluded` are not tested, because the Runge-Kutta scheme replaces their step.
#[inline(always)]
pub(crate) fn find_energy_gain<R: Real>(
    context: StepContext<'_, R>,
    free: &FreeMotion<R>,
    velocity: &VelocitySolution<R>,
    guard: &mut StepResolution<R>,
    excluded: R::Mask,
) -> R::Mask {
    let StepContext { input: StepInput { compiled, options, state, .. }, evaluation: Evaluation { scheme, q, kinematics, .. } } = context;
    if !scheme.predicts() || !scheme.in_the_middle {
        return R::Mask::splat(false);
    }
    // A step that is evaluated at another time than its middle has an energy error of first order in its rotation, which this test would
    // report.
    let lanes = free.may_gain.and_not(free.unresolved).and_not(excluded).and(scheme.time_before.eq(scheme.time_after));
    if lanes.none() {
        return lanes;
    }
    displace(compiled, q, &velocity.v, scheme.time_after, &mut guard.q_end);
    let negligible = free.smooth.mass.energy_at(R::of(options.tolerance));
    lanes.and(guard.gains_energy(compiled, kinematics, [&state.q, &state.v, &velocity.v], free, scheme, negligible))
}

/// Limits the kinetic energy after the step in the lanes `limited`, to the kinetic energy before the step plus the work of forces.
#[inline(always)]
pub(crate) fn limit_energy<R: Real>(
    context: StepContext<'_, R>,
    free: &FreeMotion<R>,
    velocity: &mut VelocitySolution<R>,
    position: &PositionSolution<R>,
    guard: &mut StepResolution<R>,
    limited: R::Mask,
) {
    if limited.none() {
        return;
    }
    let StepContext { input: StepInput { compiled, state, .. }, evaluation } = context;
    let (before, after) = ([&state.q[..], &state.v[..]], [&position.q[..], &velocity.v[..]]);
    guard.limit_energy(compiled, &evaluation.kinematics, limited, before, after, &free.v);
    std::mem::swap(&mut velocity.v, &mut guard.v_limited);
}
