//! Loop that solves for the velocity after a step with hard contact: the values that it reads and writes, and the assembly of its
//! constraint problem (stage 4).

use stepper_real::Real;

use crate::constraints::assembler::{Assembler, RowInput, RowState};
use crate::constraints::row_builder::RowBuilder;
use crate::constraints::{ConstraintProblem, VelocitySolution};
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::evaluate::free_motion::FreeMotion;
use crate::integrators::step_input::{StepContext, StepInput};
use crate::integrators::velocity::collision_search::CollisionSearch;
use crate::probe::{Probe, span};
use crate::stages::s04_assemble::assemble;

/// Loop that solves for the velocity after a step with hard contact (stages 4 to 6). Its methods are in several files of this folder:
/// `solve_velocities.rs`, `predict.rs`, `contact_activation.rs`, `impact.rs` and `ambiguous_energy.rs`.
pub(crate) struct VelocityLoop<'a, R: Real> {
    /// Input of the step and its evaluation point.
    pub(crate) context: StepContext<'a, R>,
    /// Free motion, whose velocity-dependent forces are recomputed.
    pub(crate) free: &'a mut FreeMotion<R>,
    /// Constraint problem of the step.
    pub(crate) problem: &'a mut ConstraintProblem<R>,
    /// Impulses, and velocity after the step.
    pub(crate) velocity: &'a mut VelocitySolution<R>,
    /// Workspace with the row under construction.
    pub(crate) builder: &'a mut RowBuilder<R>,
    /// Search for deferred contacts that collide.
    pub(crate) collisions: &'a mut CollisionSearch<R>,
}

impl<R: Real> VelocityLoop<'_, R> {
    /// Assembles the constraint problem at the evaluation point of the step (the time at which contacts are found). Also sets the initial
    /// impulses to those of the last step. `predict` may replace them before the solve.
    #[inline(always)]
    pub(crate) fn assemble_problem(&mut self, probe: impl Probe) {
        let StepContext { input: StepInput { compiled, options, state, inputs, alive }, evaluation } = self.context;
        let Evaluation { scheme, substep, times, q, kinematics, contacts, solved_overlaps, .. } = evaluation;
        let Self { free, problem, velocity, builder, .. } = self;
        let input = RowInput {
            state: RowState {
                compiled,
                kinematics,
                mass: &free.smooth.mass,
                q,
                v: &state.v,
                motion: &free.smooth.newton_euler,
                v_free: &free.v,
                losses: &free.actuator_forces.losses,
                active_equalities: &inputs.active_equalities,
                solved_overlaps: solved_overlaps.as_deref(),
                alive,
            },
            options,
            h: scheme.h,
            longest: substep.longest,
            is_impact: substep.is_impact,
            bounces_at_end: substep.bounces_at_end,
            ignores_impacts: substep.ignores_impacts,
            times,
            in_the_middle: scheme.in_the_middle,
        };
        span!(probe, Assemble, || assemble(&input, contacts, Assembler { problem, velocity, builder }));
    }
}
