//! Problems of an evaluation, the rule that sets their impulses, and the results of evaluations.

use stepper_real::{Mask, Real};
use stepper_solve::{Iterate, System};

use crate::collision::contact_set::Contacts;
use crate::constraints::ConstraintProblem;
use crate::integrators::recomputed::Recomputed;
use crate::math::lanes::MAX_LANES;

/// Part of a state, or the controls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StatePart {
    /// Displacements of the configuration, nv.
    Qpos,
    /// Velocities, nv.
    Qvel,
    /// Activations, na.
    Act,
    /// Controls, nu.
    Ctrl,
}

impl StatePart {
    /// Parts of a step that change when a coordinate of this kind is displaced.
    pub fn recomputed(self) -> Recomputed {
        match self {
            Self::Qpos => Recomputed::Configuration,
            Self::Qvel => Recomputed::Velocity,
            Self::Act | Self::Ctrl => Recomputed::Forces,
        }
    }
}

/// Solved step of a group.
#[derive(Clone, Copy, Debug)]
pub struct SolvedStep<R: Real> {
    /// Residual of the constraint problem, m/s.
    pub residual: R,
    /// Flags of every lane, bits of [`Status`](crate::Status).
    pub statuses: [u32; MAX_LANES],
    /// Lanes (bits) whose step is finite, feasible and resolved, with all of its contacts.
    pub complete: u32,
}

/// Solve within a step, in the order of the step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Solve {
    /// Prediction of the velocity after the step, from which velocity-dependent forces follow.
    Prediction,
    /// Impulses of the step.
    Velocity,
    /// Impulses of the position correction.
    Position,
}

/// Problem of one solve, and the impulses that are its result.
#[derive(Debug)]
pub struct ImpulseProblem<'a, R: Real> {
    /// Solve of this problem.
    pub solve: Solve,
    /// Rows and targets.
    pub system: System<'a, R>,
    /// Impulses.
    pub impulses: &'a mut Iterate<R>,
    /// Lanes (bits) that the step solves.
    pub lanes: u32,
    /// Names of the constraints.
    pub names: ConstraintNames<'a, R>,
}

/// Names that identify the constraints of a problem in the problems of other states.
#[derive(Clone, Copy, Debug)]
pub struct ConstraintNames<'a, R: Real> {
    pub(super) problem: &'a ConstraintProblem<R>,
    pub(super) contacts: &'a Contacts<R>,
}

impl<R: Real> ConstraintNames<'_, R> {
    /// Name where a lane has no constraint.
    const NOBODY: u64 = u64::MAX;

    /// Name of constraint `i` of a kind in one lane. The kinds are scalar rows (0), sliding contacts (1), and contacts with torsional or
    /// rolling friction.
    pub fn of(&self, kind: usize, i: usize, lane: usize) -> u64 {
        let Self { problem, contacts } = self;
        let (k, lanes) = match kind {
            0 => return problem.impulse_indices[i] as u64,
            1 => problem.slots[i],
            _ => (problem.rolling_slots[i].0, problem.rolling_slots[i].1),
        };
        if lanes.bits() >> lane & 1 == 1 { contacts.ids[k][lane].0 } else { Self::NOBODY }
    }
}

/// Rule that sets the impulses of evaluations.
pub trait ImpulseRule<R: Real> {
    /// Sees a problem of the nominal state with its solution and the residual, m/s.
    fn keep(&mut self, problem: ImpulseProblem<'_, R>, residual: R);
    /// Sets the impulses of the same solve at another state.
    fn set(&mut self, problem: ImpulseProblem<'_, R>);
}

/// Conditions under which an evaluation at the nominal state is the nominal step.
#[derive(Clone, Copy, Debug)]
pub struct NominalEvaluation<R: Real> {
    /// Lanes (bits) with a contact that bounces or an impact within the step.
    pub bouncing: u32,
    /// Largest ratio of the position correction to its bounds; 0 in lanes without a correction.
    pub correction: R,
    /// Prediction, if velocity-dependent forces use one.
    pub prediction: Option<Prediction<R>>,
}

/// Prediction of the velocity after the step, in the evaluation at the nominal state.
#[derive(Clone, Copy, Debug)]
pub struct Prediction<R: Real> {
    /// Whether forces other than inertial ones depend on it, as drag and some servos do.
    pub drives_forces: bool,
    /// Lanes (bits) that solve for it. Lanes at rest predict with the impulses of the previous step.
    pub solved: u32,
    /// Largest difference from the velocity that the nominal step predicted, m/s or rad/s. NaN if any is NaN.
    pub difference: R,
    /// Largest motion of a coordinate within the step at the velocity before it, m or rad.
    pub motion: R,
}

/// Gap of a contact or a limit, at the nominal state and at a displaced one.
#[derive(Clone, Copy, Debug)]
pub struct Gap {
    /// Lane of the gap.
    pub lane: usize,
    /// Whether it is the gap of a limit.
    pub is_limit: bool,
    /// Distance at the nominal state, m or rad, negative for an overlap. Infinite for a contact that is not there.
    pub nominal: f64,
    /// Distance at the displaced state, m or rad.
    pub displaced: f64,
}
