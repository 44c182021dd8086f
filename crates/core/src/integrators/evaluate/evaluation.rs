//! Evaluation of a step at its evaluation point, with poses and contacts.

use stepper_real::{Mask, Real};

use crate::collision::contact_set::Contacts;
use crate::collision::detection::CollisionWorkspace;
use crate::compile::LaneModel;
use crate::constraints::evaluation_times::EvaluationTimes;
use crate::constraints::solved_overlaps::SolvedOverlaps;
use crate::dynamics::kinematics::Kinematics;
use crate::integrators::evaluate::scheme::Scheme;
use crate::math::spatial::*;
use crate::options::{Integrator, StepSettings};
use crate::tuning::IMPACT_DURATION;

/// Evaluation of a step at its evaluation point (the time in the step at which forces, contacts and rows are evaluated): the time, and the
/// poses and contacts at this time.
#[derive(Clone, Debug)]
pub(crate) struct Evaluation<R: Real> {
    /// Integration scheme of the substep.
    pub(crate) scheme: Scheme<R>,
    /// Substep that each lane makes.
    pub(crate) substep: Substep<R>,
    /// Lanes in which impacts divided the last step.
    pub(crate) divided: R::Mask,
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
    pub(crate) link_velocities: [Vec<V6<R>>; 2],
    /// Overlaps in the solution of the step that is being differentiated; `None` in a normal step.
    pub(crate) solved_overlaps: Option<Box<SolvedOverlaps<R>>>,
}

/// Substep of each lane: the whole step, or a part of it. A part is a flight of some length, or an impact: a jump of the velocity at one
/// configuration.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Substep<R: Real> {
    /// Time from the beginning of the step to that of the substep, s.
    pub(crate) offset: R,
    /// Longest length, s. A flight ends earlier where `ends_at_impact`; its length is then that of [`Evaluation::scheme`].
    pub(crate) longest: R,
    /// Expected length of the next substep, s, unless an impact follows.
    pub(crate) next: R,
    /// Lanes whose substep is an impact. Their positions and time stay.
    pub(crate) is_impact: R::Mask,
    /// Lanes whose last substep was an impact.
    pub(crate) follows_impact: R::Mask,
    /// Lanes whose flight does not end at impacts: after many impacts, and with Euler's rule. Newton's law acts at its end, as in
    /// textbooks.
    pub(crate) bounces_at_end: R::Mask,
    /// Lanes whose flight ignores impacts: colliding elastic contacts have no rows. Only mechanisms without impacts use the result.
    pub(crate) ignores_impacts: R::Mask,
    /// Lanes whose flight ends at an impact. [`locate`](crate::integrators::evaluate::locate::locate) finds them.
    pub(crate) ends_at_impact: R::Mask,
    /// Lanes that the search for impacts evaluates `search_time` s after the beginning of the flight, instead of at the point of the
    /// integration rule.
    pub(crate) is_searched: R::Mask,
    /// Time at which the search evaluates a lane, s after the beginning of the flight.
    pub(crate) search_time: R,
    /// Lanes in which the search for impacts has ended.
    pub(crate) search_ended: R::Mask,
}

impl<R: Real> Substep<R> {
    /// The whole step.
    #[inline(always)]
    pub(crate) fn whole(options: &StepSettings) -> Self {
        let (h, none) = (R::of(options.timestep), R::Mask::splat(false));
        Self {
            offset: R::zero(),
            longest: h,
            next: h,
            is_impact: none,
            follows_impact: none,
            bounces_at_end: R::Mask::splat(options.integrator == Integrator::Euler),
            ignores_impacts: none,
            ends_at_impact: none,
            is_searched: none,
            search_time: R::zero(),
            search_ended: none,
        }
    }
}

impl<R: Real> Evaluation<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>, options: &StepSettings, contacts: Contacts<R>) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        Self {
            substep: Substep::whole(options),
            divided: R::Mask::splat(false),
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

    /// Sets the length of flights to `length` s, and with it the integration scheme and the evaluation times. Impacts are evaluated at
    /// their configuration.
    #[inline(always)]
    pub(crate) fn place(&mut self, options: &StepSettings, length: R) {
        let Self { substep, scheme, times, .. } = self;
        let Substep { longest, next, is_impact, ends_at_impact, is_searched, search_time, .. } = *substep;
        let duration = R::select(is_impact, longest * R::of(IMPACT_DURATION), length);
        *scheme = Scheme::new(options, duration);
        // Time from the end of the substep to the evaluation of the next flight.
        let next = R::select(ends_at_impact, longest - length, next) * R::of(if scheme.in_the_middle { 0.5 } else { 0.0 });
        scheme.time_before = R::select(is_searched, search_time, R::select(is_impact, R::zero(), scheme.time_before));
        times.reset(scheme.h, scheme.time_before, next);
    }

    /// Fills with NaN, for tests, the vectors that a step must compute before it reads them.
    pub(crate) fn poison(&mut self) {
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
