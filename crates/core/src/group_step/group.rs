//! Step of a group of environments, as other crates use it.

use std::any::Any;
use std::fmt;

use stepper_real::{Mask, Real};

use crate::compile::LaneModel;
use crate::group_step::nominal::Nominal;
use crate::group_step::rule::{Gap, ImpulseRule, NominalEvaluation, SolvedStep, StatePart};
use crate::integrators::evaluate::recomputed::Recomputed;
use crate::integrators::workspace::Workspace;
use crate::options::StepSettings;

/// Panic message if a step is evaluated before it was solved.
const UNSOLVED: &str = "a step is solved before it is evaluated";

/// Visitor of the groups of environments of a simulation. Several threads call it at once.
pub trait GroupVisitor: Sync {
    /// Visits the group whose first environment is `first`. The visitor may change `step`; the states of the environments do not change.
    fn visit<R: Real<Scalar = f64>>(&self, step: &mut GroupStep<R>, first: usize);
}

/// Step of a group of environments, in the lane type `R`: compiled model, settings and workspace.
pub struct GroupStep<R: Real> {
    /// Compiled model with the parameters of the current group.
    pub(crate) compiled: LaneModel<R>,
    pub(crate) workspace: Workspace<R>,
    /// Step settings, such as time step and solver options.
    pub(crate) settings: StepSettings,
    /// Largest number of contacts of an environment.
    max_contacts: usize,
    /// Nominal step: the solved step near which others are evaluated. It is allocated when it is first used.
    nominal: Option<Box<Nominal<R>>>,
    /// Functions of the lane type `R`. `None` if visitors cannot use the step.
    functions: Option<GroupFunctions<R>>,
    /// Data that a visitor stored with [`GroupStep::store_memory`].
    memory: Option<Box<dyn Any + Send>>,
}

type SolveStep<R> = fn(&mut Nominal<R>, &LaneModel<R>, &StepSettings, &mut Workspace<R>) -> SolvedStep<R>;
type EvaluateNominal<R> =
    fn(&mut Nominal<R>, &LaneModel<R>, &StepSettings, &mut Workspace<R>, &mut dyn ImpulseRule<R>) -> NominalEvaluation<R>;
type Evaluate<R> = fn(&mut Nominal<R>, &LaneModel<R>, &StepSettings, &mut Workspace<R>, Recomputed, &mut dyn ImpulseRule<R>) -> bool;
type Displace<R> = fn(&mut Nominal<R>, &LaneModel<R>, &mut Workspace<R>, StatePart, usize, R);
type FindChange<R> = fn(&Nominal<R>, &LaneModel<R>, &Workspace<R>, &mut [R]);
type SeeGaps<R> = fn(&Nominal<R>, &LaneModel<R>, &Workspace<R>, u32, &mut dyn FnMut(Gap)) -> u32;

/// Functions that a [`GroupStep`] calls, for one lane type. They are compiled in this crate, so that other crates need not compile the
/// stages of a step.
#[derive(Clone, Copy)]
pub struct GroupFunctions<R: Real> {
    solve: SolveStep<R>,
    evaluate_nominal: EvaluateNominal<R>,
    evaluate: Evaluate<R>,
    displace: Displace<R>,
    change: FindChange<R>,
    gaps: SeeGaps<R>,
}

impl<R: Real> GroupFunctions<R> {
    /// Functions of a [`GroupStep`] for the lane type `R`.
    pub(crate) fn new() -> Self {
        Self {
            solve: Nominal::solve,
            evaluate_nominal: Nominal::evaluate_nominal,
            evaluate: Nominal::evaluate,
            displace: Nominal::displace,
            change: Nominal::change,
            gaps: Nominal::gaps,
        }
    }
}

impl<R: Real> fmt::Debug for GroupStep<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("GroupStep").field("lanes", &R::LANES).field("settings", &self.settings).finish_non_exhaustive()
    }
}

impl<R: Real> GroupStep<R> {
    /// Creates the step of a compiled model. If `functions` is `None`, visitors cannot use the step.
    pub(crate) fn new(compiled: LaneModel<R>, settings: &StepSettings, max_contacts: usize, functions: Option<GroupFunctions<R>>) -> Self {
        let workspace = Workspace::new(&compiled, settings, max_contacts);
        Self { compiled, workspace, settings: *settings, max_contacts, nominal: None, functions, memory: None }
    }

    fn functions(&self) -> GroupFunctions<R> {
        self.functions.expect("a simulation lends steps in 64 bits alone")
    }

    fn nominal(&self) -> &Nominal<R> {
        self.nominal.as_ref().expect(UNSOLVED)
    }

    /// Lanes (bits) that have an environment.
    pub fn lanes(&self) -> u32 {
        self.workspace.alive.bits()
    }

    /// Settings of the step.
    pub fn settings(&self) -> &StepSettings {
        &self.settings
    }

    /// Number of coordinates of a part of the state: nv, na or nu.
    pub fn width(&self, part: StatePart) -> usize {
        match part {
            StatePart::Qpos | StatePart::Qvel => self.compiled.nv,
            StatePart::Act => self.compiled.na,
            StatePart::Ctrl => self.compiled.actuators.len(),
        }
    }

    /// Makes the step from the current state and controls of the group. This state and these controls become the nominal ones.
    pub fn solve(&mut self) -> SolvedStep<R> {
        let functions = self.functions();
        self.finish();
        let Self { compiled, workspace, settings, max_contacts, nominal, .. } = self;
        let nominal = nominal.get_or_insert_with(|| Box::new(Nominal::new(compiled, settings, *max_contacts)));
        (functions.solve)(nominal, compiled, settings, workspace)
    }

    /// Configuration, velocity and activations after the solved step.
    ///
    /// # Panics
    /// Before [`GroupStep::solve`].
    pub fn outcome(&self) -> [&[R]; 3] {
        self.nominal().after.each_ref().map(|part| &part[..])
    }

    /// Evaluates the solved step again from the same state, with impulses from the solver. Passes every constraint problem and its solution
    /// to `rule`.
    ///
    /// With MuJoCo's contact law the solver itself computes how its solution changes with displacements. `rule` is then not called.
    ///
    /// # Panics
    /// Before [`GroupStep::solve`].
    pub fn evaluate_nominal(&mut self, rule: &mut dyn ImpulseRule<R>) -> NominalEvaluation<R> {
        let functions = self.functions();
        let Self { compiled, workspace, settings, nominal, .. } = self;
        (functions.evaluate_nominal)(nominal.as_mut().expect(UNSOLVED), compiled, settings, workspace, rule)
    }

    /// Displaces coordinate `i` of a part of the state, or control `i`, from its value in the solved step by `offset`, one number per lane.
    ///
    /// # Panics
    /// Before [`GroupStep::solve`], and if there is no coordinate `i`.
    pub fn displace(&mut self, part: StatePart, i: usize, offset: R) {
        let functions = self.functions();
        let Self { compiled, workspace, nominal, .. } = self;
        (functions.displace)(nominal.as_mut().expect(UNSOLVED), compiled, workspace, part, i, offset);
    }

    /// Evaluates stages 1 to 8 at the displaced state with impulses from `rule`. Afterwards the state before the solved step is restored.
    ///
    /// Returns whether contacts and all rows were recomputed. Otherwise the contacts of the last evaluation are still valid.
    ///
    /// # Panics
    /// Before [`GroupStep::solve`].
    pub fn evaluate(&mut self, recomputed: Recomputed, rule: &mut dyn ImpulseRule<R>) -> bool {
        let functions = self.functions();
        let Self { compiled, workspace, settings, nominal, .. } = self;
        (functions.evaluate)(nominal.as_mut().expect(UNSOLVED), compiled, settings, workspace, recomputed, rule)
    }

    /// Computes the result of the last evaluation minus the result of the solved step into `out`: configuration (nv), velocity (nv),
    /// activations (na).
    ///
    /// # Panics
    /// Before [`GroupStep::solve`], and if `out` has fewer or more than 2 nv + na numbers.
    pub fn change(&self, out: &mut [R]) {
        (self.functions().change)(self.nominal(), &self.compiled, &self.workspace, out);
    }

    /// Numbers that change where tendons and adhesion have kinks, in the last evaluation. The first list has an entry for each geom in the
    /// path of a tendon: 1 if the tendon touches it, otherwise 0. The second has the number of contacts that each actuator on the contacts
    /// of a body pulls.
    pub fn switches(&self) -> [&[R]; 2] {
        self.workspace.free_motion.switches()
    }

    /// Calls `see` with the gaps (distances) of contacts and limits in the last evaluation, in the lanes `lanes` (bits).
    ///
    /// With hard contact, only contacts and limits with an impulse in the solved step count, and the result is `lanes`. With MuJoCo's
    /// contact law, a lane is in the result only if the evaluation has every contact that overlaps in the solved step.
    ///
    /// # Panics
    /// Before [`GroupStep::solve`].
    pub fn gaps(&self, lanes: u32, see: &mut dyn FnMut(Gap)) -> u32 {
        (self.functions().gaps)(self.nominal(), &self.compiled, &self.workspace, lanes, see)
    }

    /// Ends the evaluations near the solved step. Evaluations use the distances of contacts and limits in the solved step. In later steps,
    /// constraint rows use the distances at the current configuration again.
    pub fn finish(&mut self) {
        if let Some(nominal) = &mut self.nominal {
            nominal.release_overlaps(&mut self.workspace);
        }
    }

    /// Takes the data that a visitor stored with [`GroupStep::store_memory`]; `None` if there are no data, or if they are of another type.
    pub fn take_memory<T: Any + Send>(&mut self) -> Option<Box<T>> {
        self.memory.take()?.downcast().ok()
    }

    /// Stores data of a visitor until its next visit on the same thread.
    pub fn store_memory<T: Any + Send>(&mut self, memory: Box<T>) {
        self.memory = Some(memory);
    }
}
