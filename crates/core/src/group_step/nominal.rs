//! Nominal step of a group (a solved step), and evaluations of steps near it.

use stepper_real::{Mask, Real, Scalar, kernel};

use crate::compile::LaneModel;
use crate::constraints::solved_overlaps::SolvedOverlaps;
use crate::dynamics::kinematics::{displace, separate};
use crate::group_step::hard::{HardNominal, Pass};
use crate::group_step::rule::{Gap, ImpulseRule, NominalEvaluation, SolvedStep, StatePart};
use crate::integrators::devices::Devices;
use crate::integrators::evaluate::evaluation::Evaluation;
use crate::integrators::evaluate::recomputed::Recomputed;
use crate::integrators::mujoco;
use crate::integrators::mujoco::workspace::MujocoWorkspace;
use crate::integrators::state::State;
use crate::integrators::workspace::Workspace;
use crate::math::lanes::{MAX_LANES, each_of};
use crate::options::{ContactLaw, StepSettings};
use crate::probe::NoProbe;
use crate::stages::s10_record::Status;
use crate::step::step;

/// Nominal step: the step at which derivatives are taken. It has the states before and after this step, and the parts of its solution that
/// steps from nearby states reuse.
#[derive(Clone, Debug)]
pub(super) struct Nominal<R: Real> {
    /// Configuration, velocity, activations and controls before the solved step.
    before: [Vec<R>; 4],
    /// Configuration, velocity and activations after the solved step.
    pub(super) after: [Vec<R>; 3],
    /// Overlaps of contacts and limits in the solved step. Evaluations at displaced states use these overlaps instead of the overlaps at
    /// the displaced configuration. `None` while the workspace has them.
    overlaps: Option<Box<SolvedOverlaps<R>>>,
    /// Buffer for the unit vector of the displaced coordinate of the configuration, nv. Zero between calls.
    direction: Vec<R>,
    law: Law<R>,
}

/// Solution of the solved step, by contact law.
#[derive(Clone, Debug)]
enum Law<R: Real> {
    Hard(Box<HardNominal<R>>),
    /// MuJoCo's contact law: the acceleration of the solution, nv.
    Mujoco(Vec<R>),
}

impl<R: Real> Nominal<R> {
    pub(super) fn new(compiled: &LaneModel<R>, options: &StepSettings, max_contacts: usize) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        let [nq, nv, na] = [compiled.nq, compiled.nv, compiled.na];
        Self {
            before: [nq, nv, na, compiled.actuators.len()].map(zeros),
            after: [nq, nv, na].map(zeros),
            overlaps: Some(Box::new(SolvedOverlaps::new(compiled, max_contacts))),
            direction: zeros(nv),
            law: match options.contact {
                ContactLaw::Hard => Law::Hard(Box::new(HardNominal::new(compiled, options, max_contacts))),
                ContactLaw::Mujoco => Law::Mujoco(zeros(nv)),
            },
        }
    }

    /// Copies the state and the controls in the workspace to the nominal step, as its state and controls before the step.
    fn store_beginning(&mut self, s: &Workspace<R>) {
        for (kept, now) in self.before.iter_mut().zip([&s.state.q, &s.state.v, &s.state.act, &s.inputs.ctrl]) {
            kept.copy_from_slice(now);
        }
    }

    /// Restores in the workspace the state and the controls before the solved step.
    fn return_to_beginning(&self, s: &mut Workspace<R>) {
        let State { q, v, act, .. } = &mut s.state;
        for (to, kept) in [q, v, act, &mut s.inputs.ctrl].into_iter().zip(&self.before) {
            to.copy_from_slice(kept);
        }
    }

    /// Stores the solution of the last step, and prepares the workspace for evaluations near it.
    fn keep(&mut self, compiled: &LaneModel<R>, s: &mut Workspace<R>) {
        for (kept, now) in self.after.iter_mut().zip([&s.state.q, &s.state.v, &s.state.act]) {
            kept.copy_from_slice(now);
        }
        match &mut self.law {
            Law::Hard(hard) => hard.keep(compiled, s),
            Law::Mujoco(solution) => {
                if let Some(MujocoWorkspace { system, .. }) = s.mujoco.as_deref_mut() {
                    solution.copy_from_slice(&system.acceleration);
                    system.settle(compiled, &s.free_motion.smooth.mass, &s.free_motion.smooth.acc);
                }
            }
        }
        self.return_to_beginning(s);
        // Until `release_overlaps`, constraint rows use the overlaps of the solved step. The step has moved its contacts to the state.
        if let Some(mut overlaps) = self.overlaps.take() {
            overlaps.keep(compiled, &s.state.contacts, &s.evaluation.q);
            s.evaluation.solved_overlaps = Some(overlaps);
        }
    }

    /// Moves the overlaps of the solved step from the workspace back to `self`. Constraint rows then use the overlaps at the configuration
    /// of each step.
    pub(super) fn release_overlaps(&mut self, s: &mut Workspace<R>) {
        self.overlaps = s.evaluation.solved_overlaps.take().or_else(|| self.overlaps.take());
    }

    /// Makes the step and stores its solution as the nominal solution.
    pub(super) fn solve(&mut self, compiled: &LaneModel<R>, settings: &StepSettings, s: &mut Workspace<R>) -> SolvedStep<R> {
        self.store_beginning(s);
        let elapsed = s.state.elapsed;
        let record = step(compiled, settings, s, &mut Devices::default(), NoProbe);
        s.state.elapsed = elapsed;
        self.keep(compiled, s);
        let mut statuses = [0; MAX_LANES];
        record.add_flags(&mut statuses);
        let broken = record.lanes(Status::NON_FINITE | Status::INFEASIBLE | Status::UNRESOLVED | Status::CONTACTS_FULL);
        SolvedStep { residual: record.residual, statuses, complete: s.alive.bits() & !broken }
    }

    /// Evaluates the solved step again from the same state, with impulses from the solver. Passes the constraint problems to `rule`.
    pub(super) fn evaluate_nominal(
        &mut self,
        compiled: &LaneModel<R>,
        settings: &StepSettings,
        s: &mut Workspace<R>,
        rule: &mut dyn ImpulseRule<R>,
    ) -> NominalEvaluation<R> {
        match &mut self.law {
            Law::Hard(hard) => {
                hard.evaluate(compiled, settings, s, Recomputed::Configuration, Pass::Nominal, rule);
                hard.compare(compiled, s)
            }
            Law::Mujoco(_) => NominalEvaluation { bouncing: 0, correction: R::zero(), prediction: None },
        }
    }

    /// Evaluates the step at the displaced state in the workspace. Returns whether contacts and all rows were recomputed.
    pub(super) fn evaluate(
        &mut self,
        compiled: &LaneModel<R>,
        settings: &StepSettings,
        s: &mut Workspace<R>,
        recomputed: Recomputed,
        rule: &mut dyn ImpulseRule<R>,
    ) -> bool {
        let recomputed = match &mut self.law {
            Law::Hard(hard) => {
                let recomputed = hard.rows_by(compiled, recomputed);
                hard.evaluate(compiled, settings, s, recomputed, Pass::Displaced, rule);
                recomputed
            }
            Law::Mujoco(solution) => {
                if recomputed == Recomputed::Configuration {
                    s.evaluation.collision.narrow_phase.begin_step();
                }
                mujoco::respond_step(compiled, settings, s, solution, recomputed);
                recomputed
            }
        };
        self.return_to_beginning(s);
        recomputed == Recomputed::Configuration
    }

    /// Displaces coordinate `i` of a part of the state by `offset`, one number per lane.
    pub(super) fn displace(&mut self, compiled: &LaneModel<R>, s: &mut Workspace<R>, part: StatePart, i: usize, offset: R) {
        let Self { before, direction, .. } = self;
        match part {
            StatePart::Qpos => {
                direction[i] = R::one();
                displace(compiled, &before[0], direction, offset, &mut s.state.q);
                direction[i] = R::zero();
            }
            StatePart::Qvel => s.state.v[i] = before[1][i] + offset,
            StatePart::Act => s.state.act[i] = before[2][i] + offset,
            StatePart::Ctrl => s.inputs.ctrl[i] = before[3][i] + offset,
        }
    }

    /// Computes the result of the last evaluation minus the result of the solved step into `out`: configuration (nv), velocity (nv),
    /// activations (na).
    pub(super) fn change(&self, compiled: &LaneModel<R>, s: &Workspace<R>, out: &mut [R]) {
        let after = &self.after;
        assert_eq!(out.len(), 2 * compiled.nv + compiled.na, "a change has the coordinates of the state");
        kernel!(R, || {
            let (moved, rates) = out.split_at_mut(compiled.nv);
            separate(compiled, [&after[0], &s.position.q], moved);
            let pairs = s.velocity.v.iter().chain(&s.position.act).zip(after[1].iter().chain(&after[2]));
            for (rate, (&next, &after)) in rates.iter_mut().zip(pairs) {
                *rate = next - after;
            }
        })
    }

    /// Calls `see` with the gaps (distances) of contacts and limits in the last evaluation, in the lanes `lanes` (bits).
    ///
    /// With hard contact, the result is `lanes`. With MuJoCo's contact law, a lane is in the result only if the evaluation has every
    /// contact that overlaps in the solved step.
    pub(super) fn gaps(&self, compiled: &LaneModel<R>, s: &Workspace<R>, lanes: u32, see: &mut dyn FnMut(Gap)) -> u32 {
        let mut pair = |is_limit: bool, nominal: R, displaced: R, lanes: u32| {
            for lane in each_of(lanes) {
                let [nominal, displaced] = [nominal, displaced].map(|gap| gap.lane(lane).to_f64());
                see(Gap { lane, is_limit, nominal, displaced });
            }
        };
        match &self.law {
            Law::Hard(hard) => {
                hard.each_gap(compiled, s, lanes, &mut pair);
                lanes
            }
            Law::Mujoco(_) => {
                let Some(overlaps) = &s.evaluation.solved_overlaps else { return lanes };
                let Evaluation { contacts, q, .. } = &s.evaluation;
                overlaps.each_gap(compiled, contacts, q, |is_limit, nominal, displaced, there| {
                    pair(is_limit, nominal, displaced, lanes & there)
                });
                overlaps.found(contacts, lanes)
            }
        }
    }
}
