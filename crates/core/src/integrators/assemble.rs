//! Assembly of the constraint problem (stage 4) at the evaluation point, the time in the step at which contacts are found.

use crate::constraints::assembler::{Assembler, RowInput};
use crate::constraints::row_builder::RowBuilder;
use crate::constraints::{ConstraintProblem, VelocitySolution};
use crate::integrators::evaluation::Evaluation;
use crate::integrators::free_motion::FreeMotion;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::probe::{Probe, Span};
use crate::stages::s04_assemble::assemble;
use stepper_real::{Mask, Real};

/// Assembles the constraint problem at the evaluation point of the step (the time at which contacts are found). Also sets the impulses from
/// which the solver starts.
#[inline(always)]
pub(crate) fn assemble_problem<R: Real>(
    context: StepContext<'_, R>,
    free: &FreeMotion<R>,
    problem: &mut ConstraintProblem<R>,
    velocity: &mut VelocitySolution<R>,
    builder: &mut RowBuilder<R>,
    probe: impl Probe,
) {
    let StepContext { input: StepInput { compiled, options, state, alive, .. }, evaluation } = context;
    let Evaluation { scheme, at_start, q, kinematics, contacts, impact_lanes, solved_overlaps, .. } = evaluation;
    let at_start = at_start.and_not(*impact_lanes);
    let input = RowInput {
        compiled,
        options,
        kinematics,
        mass: &free.smooth.mass,
        q,
        v: &state.v,
        motion: &free.smooth.newton_euler,
        v_free: &free.v,
        losses: &free.actuator_forces.losses,
        h: scheme.h,
        time_before: scheme.time_before,
        in_the_middle: scheme.in_the_middle,
        closing_fraction: scheme.closing_fraction(at_start, *impact_lanes),
        at_start,
        solved_overlaps: solved_overlaps.as_deref(),
        alive,
    };
    probe.span(Span::Assemble, || assemble(&input, contacts, Assembler { problem, velocity, builder }));
}
