//! Evaluation of a step at its evaluation point, with poses and contacts.

use stepper_real::Real;

use crate::collision::contact_set::Contacts;
use crate::collision::detection::CollisionWorkspace;
use crate::compile::LaneModel;
use crate::constraints::evaluation_times::EvaluationTimes;
use crate::constraints::solved_overlaps::SolvedOverlaps;
use crate::dynamics::kinematics::Kinematics;
use crate::integrators::scheme::Scheme;
use crate::math::spatial::*;
use crate::options::StepSettings;

/// Evaluation of a step at its evaluation point (the time in the step at which forces, contacts and rows are evaluated): the time, and the
/// poses and contacts at this time.
#[derive(Clone, Debug)]
pub(crate) struct Evaluation<R: Real> {
    /// Integration scheme of the step.
    pub(crate) scheme: Scheme<R>,
    /// Part of the step that is being made in each lane.
    pub(crate) substep: Substep<R>,
    /// Evaluation time of each mechanism.
    pub(crate) times: EvaluationTimes<R>,
    /// Configuration at the evaluation point, nq.
    pub(crate) q: Vec<R>,
    /// Configuration at which springs and servos are evaluated, nq. Only the implicit rule uses it, because it evaluates springs and servos
    /// later in the step than other forces.
    pub(crate) q_ahead: Vec<R>,
    /// Activations at the evaluation point, na.
    pub(crate) act: Vec<R>,
    /// Poses at `q`.
    pub(crate) kinematics: Kinematics<R>,
    /// Workspace of collision detection, with the poses of the geoms.
    pub(crate) collision: CollisionWorkspace<R>,
    /// Contacts at `q`.
    pub(crate) contacts: Contacts<R>,
    /// Spatial velocities of the links, with which the step predicts impacts: before the step, and after it without constraints.
    pub(super) link_velocities: [Vec<V6<R>>; 2],
    /// Overlaps in the solution of the step that is being differentiated; `None` in a normal step.
    pub(crate) solved_overlaps: Option<Box<SolvedOverlaps<R>>>,
}

/// Part of a step: the whole step, unless the step keeps an error (`substeps.rs`).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Substep<R> {
    /// Time from the beginning of the step to that of its part, s.
    pub(crate) offset: R,
    /// Length, s.
    pub(crate) length: R,
}

impl<R: Real> Substep<R> {
    /// The whole step of `timestep` seconds.
    pub(crate) fn whole(timestep: f64) -> Self {
        Self { offset: R::zero(), length: R::of(timestep) }
    }
}

impl<R: Real> Evaluation<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>, options: &StepSettings, contacts: Contacts<R>) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        Self {
            substep: Substep::whole(options.timestep),
            scheme: Scheme::new(options, R::of(options.timestep)),
            times: EvaluationTimes::new(compiled),
            q: zeros(compiled.nq),
            q_ahead: zeros(compiled.nq),
            act: zeros(compiled.na),
            kinematics: Kinematics::new(compiled),
            collision: CollisionWorkspace::new(compiled),
            contacts,
            link_velocities: std::array::from_fn(|_| vec![zero(); compiled.links.len()]),
            solved_overlaps: None,
        }
    }

    /// Fills with NaN, for tests, the vectors that a step must compute before it reads them.
    pub(super) fn poison(&mut self) {
        let Self { q, q_ahead, act, .. } = self;
        [q, q_ahead, act].into_iter().for_each(|buffer| buffer.fill(R::of(f64::NAN)));
    }

    /// Prepares the contacts of a step.
    ///
    /// In single precision, the function sets gaps to zero that are smaller than the rounding error of positions. It chooses the tangents
    /// of the contacts, and copies the impulses of the same contacts from `last`, the contacts of the last step. It overwrites `last`.
    #[inline(always)]
    pub(crate) fn match_contacts(&mut self, compiled: &LaneModel<R>, last: &mut Contacts<R>) {
        self.contacts.close_rounded_gaps(norm(compiled.params.gravity()) * self.scheme.h * self.scheme.h);
        self.contacts.prepare(last);
    }
}
