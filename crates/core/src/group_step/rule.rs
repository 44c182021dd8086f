//! Types for evaluations of a step near its solution: the rule that sets the impulses, the constraint problems that the rule gets, and the
//! results.

use stepper_real::{Mask, Real};
use stepper_solve::{Iterate, System};

use crate::collision::contact_set::Contacts;
use crate::constraints::{ConstraintProblem, ContactSlot};
use crate::integrators::evaluate::recomputed::Recomputed;
use crate::math::lanes::MAX_LANES;

stepper_model::named! {
    /// Part of the state, or the controls, that can be displaced.
    pub enum StatePart {
        /// Configuration. Displacements have the coordinates of velocities, nv.
        Qpos = "qpos",
        /// Velocities, nv.
        Qvel = "qvel",
        /// Activations, na.
        Act = "act",
        /// Controls, nu.
        Ctrl = "ctrl",
    }
}

impl StatePart {
    /// Parts of a step that must be recomputed after a coordinate of this kind is displaced.
    pub fn recomputed(self) -> Recomputed {
        match self {
            Self::Qpos => Recomputed::Configuration,
            Self::Qvel => Recomputed::Velocity,
            Self::Act | Self::Ctrl => Recomputed::Forces,
        }
    }
}

/// Result of the solved step of a group, per lane.
#[derive(Clone, Copy, Debug)]
pub struct SolvedStep<R: Real> {
    /// Residual of the constraint problem, m/s.
    pub residual: R,
    /// Flags of every lane, as bits of [`Status`](crate::Status).
    pub statuses: [u32; MAX_LANES],
    /// Lanes (bits) without a failure of the step: the result is finite, the constraints are feasible, the time step resolves the motion,
    /// and the contact capacity suffices.
    pub complete: u32,
}

/// Kind of a solve for impulses within a step. A step makes up to three solves, in this order: prediction, velocity, position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Solve {
    /// Solve for the impulses of the predicted velocity after the step. Velocity-dependent forces are evaluated at this prediction.
    Prediction,
    /// Solve for the impulses of the step.
    Velocity,
    /// Solve for the position correction.
    Position,
}

/// Constraint problem of one solve within a step, and its impulses.
#[derive(Debug)]
pub struct ImpulseProblem<'a, R: Real> {
    /// Kind of the solve: prediction, velocity or position.
    pub solve: Solve,
    /// Constraint rows and target velocities.
    pub system: System<'a, R>,
    /// Impulses of the problem. The solver computes them in the nominal evaluation, and [`ImpulseRule::set`] sets them at displaced states.
    pub impulses: &'a mut Iterate<R>,
    /// Lanes (bits) in which the step solves the problem.
    pub lanes: u32,
    /// Names of the constraints, which identify the same constraints in the problems of other states.
    pub names: ConstraintNames<'a, R>,
}

/// Names of the constraints of a problem: numbers that identify the same constraints in the problems of other states.
#[derive(Clone, Copy, Debug)]
pub struct ConstraintNames<'a, R: Real> {
    pub(super) problem: &'a ConstraintProblem<R>,
    pub(super) contacts: &'a Contacts<R>,
}

impl<R: Real> ConstraintNames<'_, R> {
    /// Name that stands for no constraint, in lanes that do not have constraint `i`.
    const NO_CONSTRAINT: u64 = u64::MAX;

    /// Name of constraint `i` in one lane. The index counts the scalar rows first, then the contacts.
    pub fn of(&self, i: usize, lane: usize) -> u64 {
        let Self { problem, contacts } = self;
        let Some(contact) = i.checked_sub(problem.impulse_indices.len()) else { return problem.impulse_indices[i] as u64 };
        let ContactSlot { slot, lanes } = problem.contact_slots[contact];
        if lanes.bits() >> lane & 1 == 1 { contacts.ids[slot][lane].0 } else { Self::NO_CONSTRAINT }
    }
}

/// Rule that sets the impulses of evaluations at displaced states.
pub trait ImpulseRule<R: Real> {
    /// Receives the constraint problem of one solve at the nominal state, with the solver's impulses. `residual` is the residual of the
    /// solution, m/s.
    fn keep(&mut self, problem: ImpulseProblem<'_, R>, residual: R);
    /// Sets the impulses of the constraint problem of one solve at a displaced state. The field `solve` of the problem gives the kind of
    /// the solve.
    fn set(&mut self, problem: ImpulseProblem<'_, R>);
}

/// Comparison between the solved step and its evaluation from the same state. The fields show where the two may differ.
#[derive(Clone, Copy, Debug)]
pub struct NominalEvaluation<R: Real> {
    /// Lanes (bits) with a bouncing contact or an impact within the step.
    pub bouncing: u32,
    /// Speed of the position correction as a fraction of its upper bound; 0 in lanes without a correction.
    pub correction: R,
    /// Comparison of the predicted velocities after the step: in the solved step, and in its evaluation. `None` if no force of the step
    /// depends on a predicted velocity.
    pub prediction: Option<Prediction<R>>,
}

/// Comparison of two predictions of the velocity after the step. One was made in the solved step, the other when the step
/// was evaluated again from the same state.
#[derive(Clone, Copy, Debug)]
pub struct Prediction<R: Real> {
    /// Whether forces other than inertial ones depend on the predicted velocity, such as drag and some servos.
    pub drives_forces: bool,
    /// Lanes (bits) that solve for the predicted velocity. The other lanes are at rest, and predict it with the impulses of the previous
    /// step.
    pub solved: u32,
    /// Largest difference between the velocity predicted in the solved step and in its evaluation, m/s or rad/s. NaN if any difference is
    /// NaN.
    pub difference: R,
    /// Largest displacement of a coordinate in a step at the velocity before the step, m or rad.
    pub motion: R,
}

/// Gap (distance) of a contact or limit, in the solved step and at a displaced state.
#[derive(Clone, Copy, Debug)]
pub struct Gap {
    /// Index of the lane to which the gap belongs.
    pub lane: usize,
    /// Whether the gap belongs to a limit; otherwise to a contact.
    pub is_limit: bool,
    /// Distance in the solved step, m or rad, negative for an overlap. Infinite for a contact that the solved step does not have.
    pub nominal: f64,
    /// Distance at the displaced state, m or rad, negative for an overlap.
    pub displaced: f64,
}
