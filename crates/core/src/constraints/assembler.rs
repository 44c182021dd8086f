//! Assembly of constraint rows with hard contact: rows of contacts, limits, dry friction, equalities and tendons.

use std::ops::Deref;

use stepper_real::{Mask, Real};

use crate::collision::contact_set::Contacts;
use crate::compile::LaneModel;
use crate::constraints::constraint_problem::ConstraintProblem;
use crate::constraints::equality::active_equalities::ActiveEqualities;
use crate::constraints::evaluation_times::{EvaluationTimes, SlotTimes};
use crate::constraints::row_builder::RowBuilder;
use crate::constraints::solved_overlaps::SolvedOverlaps;
use crate::constraints::velocity_solution::VelocitySolution;
use crate::dynamics::inertia::{MassMatrix, NewtonEuler};
use crate::dynamics::kinematics::Kinematics;
use crate::options::StepSettings;
use crate::tuning::WIDE_GAP_RATIO;

/// Assembler of the constraint rows of a step with hard contact. The methods for each kind of element (contacts, limits ...) are in a
/// separate file of this folder.
pub(crate) struct Assembler<'a, R: Real> {
    /// Constraint problem to which the assembler adds rows.
    pub(crate) problem: &'a mut ConstraintProblem<R>,
    /// Velocity solution, to which the assembler adds the initial impulse of every row.
    pub(crate) velocity: &'a mut VelocitySolution<R>,
    /// Workspace with the row under construction.
    pub(crate) builder: &'a mut RowBuilder<R>,
}

/// Model, and the state of its mechanisms at which constraint rows are evaluated.
#[derive(Clone, Copy)]
pub(crate) struct RowState<'a, R: Real> {
    pub compiled: &'a LaneModel<R>,
    /// Poses at `q`.
    pub kinematics: &'a Kinematics<R>,
    /// Factored mass matrix at `q`.
    pub mass: &'a MassMatrix<R>,
    /// Configuration at which the rows are evaluated.
    pub q: &'a [R],
    /// Generalized velocity before the step, or at a stage of MuJoCo's Runge-Kutta method.
    pub v: &'a [R],
    /// Velocities of the links at `v` and `q`, and their accelerations at zero joint accelerations (Coriolis, centrifugal and gravity
    /// terms).
    pub motion: &'a NewtonEuler<R>,
    /// Generalized velocity with which the velocities of rows are computed: with hard contact that after the step without constraints, with
    /// MuJoCo's law `v`.
    pub v_free: &'a [R],
    /// Friction losses of actuator dynamics for every row of dry friction, N or N m: against forward motion, and against backward motion.
    /// Empty without losses.
    pub losses: &'a [[R; 2]],
    /// Lanes in which each equality of the model is active.
    pub active_equalities: &'a ActiveEqualities<R>,
    /// Overlaps in the solved step, while derivatives evaluate the step at displaced states; `None` otherwise. These overlaps determine
    /// which rows correct an overlap, and with MuJoCo's law which rows exist, so that they are the same at all displaced states.
    pub solved_overlaps: Option<&'a SolvedOverlaps<R>>,
    /// Lanes that hold an environment.
    pub alive: R::Mask,
}

/// Inputs of the assembly of rows with hard contact. The fields of `state` are read as if they were fields of this struct.
#[derive(Clone, Copy)]
pub(crate) struct RowInput<'a, R: Real> {
    pub state: RowState<'a, R>,
    pub options: &'a StepSettings,
    /// Time step or length of the substep, s.
    pub h: R,
    /// Longest length that the flight can have, s: the whole step, or its part after the last impact.
    pub longest: R,
    /// Lanes whose substep is an impact.
    pub is_impact: R::Mask,
    /// Lanes whose flight does not end at impacts.
    pub bounces_at_end: R::Mask,
    /// Lanes whose flight ignores impacts.
    pub ignores_impacts: R::Mask,
    /// Time in the step at which the rows of each mechanism are evaluated.
    pub times: &'a EvaluationTimes<R>,
    /// Whether the step evaluates forces and contacts in its middle (midpoint rule).
    pub in_the_middle: bool,
}

impl<'a, R: Real> Deref for RowInput<'a, R> {
    type Target = RowState<'a, R>;

    #[inline(always)]
    fn deref(&self) -> &Self::Target {
        &self.state
    }
}

impl<R: Real> RowInput<'_, R> {
    /// Evaluation times of the contacts in slot `k` of the contact set, in the lanes `lanes` (bits).
    #[inline(always)]
    pub(crate) fn times_of_slot(&self, contacts: &Contacts<R>, k: usize, lanes: u32) -> SlotTimes<R> {
        self.times.of_slot(self.compiled, contacts, k, lanes)
    }

    /// Part of the gap in slot `k` of the contact set (one contact per lane) that may close in the step, m. It is usually the result of
    /// [`SlotTimes::closing_part`]. Very fast bodies without restitution may close the whole gap if it is wide.
    ///
    /// `lanes` (bits) are the lanes with a contact. A gap is wide above [`WIDE_GAP_RATIO`] times the tunnelling distance. If the body
    /// could close only a part of a wide gap in each step, it would slow down before it touches. A body that closes a wide gap is still
    /// very fast, so that the next step is also evaluated at its beginning and finds the contact there.
    #[inline(always)]
    pub(crate) fn closing_part_of_slot(&self, contacts: &Contacts<R>, k: usize, lanes: u32) -> R {
        let slot = &contacts.data[k];
        let times = self.times_of_slot(contacts, k, lanes);
        let (phi, part) = (slot.point.distance, times.closing_part(slot.point.distance));
        let fast = times.at_start.and(R::Mask::from_bits(lanes)).and(slot.restitution.le(R::zero()));
        if fast.none() {
            return part;
        }
        let wide = tunnelling_distance(self.compiled, contacts, k, fast.bits()) * R::of(WIDE_GAP_RATIO);
        R::select(fast.and(phi.gt(wide)), phi, part)
    }
}

/// Relative displacement above which the two geoms of the contact in slot `k` may pass through each other, m, in each lane. It is infinite
/// outside the lanes `lanes` (bits).
#[inline(always)]
pub(crate) fn tunnelling_distance<R: Real>(compiled: &LaneModel<R>, contacts: &Contacts<R>, k: usize, lanes: u32) -> R {
    let mut distance = R::of(f64::INFINITY);
    for (pair, same) in contacts.pairs(k, lanes) {
        let geoms = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
        distance = R::select(R::Mask::from_bits(same), compiled.tunnelling_distance(geoms), distance);
    }
    distance
}
