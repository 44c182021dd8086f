//! Step of a group, as other crates use it.

use std::any::Any;
use std::fmt;

use stepper_real::{Mask, Real};

use crate::compile::LaneModel;
use crate::group_step::nominal::Nominal;
use crate::group_step::rule::{Gap, ImpulseRule, NominalEvaluation, SolvedStep, StatePart};
use crate::integrators::recomputed::Recomputed;
use crate::integrators::workspace::Workspace;
use crate::options::StepSettings;

/// Message of the panic for an evaluation without a solved step.
const UNSOLVED: &str = "a step is solved before it is evaluated";

/// Visitor of the groups of a simulation, called by several threads at once.
pub trait GroupVisitor: Sync {
    /// Visits the group whose first environment is `first`. The visitor may change `step`: the environments keep their state.
    fn visit<R: Real<Scalar = f64>>(&self, step: &mut GroupStep<R>, first: usize);
}

/// Step of a group of environments, in the lanes of `R`, with its compiled model and workspace.
pub struct GroupStep<R: Real> {
    /// Compiled model with the parameters of the present group.
    pub(crate) compiled: LaneModel<R>,
    pub(crate) workspace: Workspace<R>,
    /// Settings of the present call.
    pub(crate) settings: StepSettings,
    max_contacts: usize,
    /// Nominal step, allocated at first use.
    nominal: Option<Box<Nominal<R>>>,
    functions: Option<GroupFunctions<R>>,
    memory: Option<Box<dyn Any + Send>>,
}

type SolveStep<R> = fn(&mut Nominal<R>, &LaneModel<R>, &StepSettings, &mut Workspace<R>) -> SolvedStep<R>;
type EvaluateNominal<R> =
    fn(&mut Nominal<R>, &LaneModel<R>, &StepSettings, &mut Workspace<R>, &mut dyn ImpulseRule<R>) -> NominalEvaluation<R>;
type Evaluate<R> = fn(&mut Nominal<R>, &LaneModel<R>, &StepSettings, &mut Workspace<R>, Recomputed, &mut dyn ImpulseRule<R>) -> bool;
type Displace<R> = fn(&mut Nominal<R>, &LaneModel<R>, &mut Workspace<R>, StatePart, usize, R);
type FindChange<R> = fn(&Nominal<R>, &LaneModel<R>, &Workspace<R>, &mut [R]);
type SeeGaps<R> = fn(&Nominal<R>, &LaneModel<R>, &Workspace<R>, u32, &mut dyn FnMut(Gap)) -> u32;

/// Functions of a [`GroupStep`], compiled once in this crate: other crates call them and compile no stage.
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
    /// Functions of the lanes `R`.
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
    /// Step of a compiled model. Without `functions` it cannot be lent.
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

    /// Lanes (bits) that are environments.
    pub fn lanes(&self) -> u32 {
        self.workspace.alive.bits()
    }

    /// Settings of the step.
    pub fn settings(&self) -> &StepSettings {
        &self.settings
    }

    /// Numbers of coordinates of a part of the state.
    pub fn width(&self, part: StatePart) -> usize {
        match part {
            StatePart::Qpos | StatePart::Qvel => self.compiled.nv,
            StatePart::Act => self.compiled.na,
            StatePart::Ctrl => self.compiled.actuators.len(),
        }
    }

    /// Makes the step from the state and the controls of the group, which are the nominal ones from now on.
    pub fn solve(&mut self) -> SolvedStep<R> {
        let functions = self.functions();
        self.finish();
        let Self { compiled, workspace, settings, max_contacts, nominal, .. } = self;
        let nominal = nominal.get_or_insert_with(|| Box::new(Nominal::new(compiled, settings, *max_contacts)));
        (functions.solve)(nominal, compiled, settings, workspace)
    }

    /// Configuration, velocity and activations after the nominal step.
    ///
    /// # Panics
    /// Before [`GroupStep::solve`].
    pub fn outcome(&self) -> [&[R]; 3] {
        self.nominal().after.each_ref().map(|part| &part[..])
    }

    /// Solves the problems of the nominal step again, from the nominal state, and shows the solutions to `rule`.
    ///
    /// With MuJoCo's contact law the soft problem responds to displacements by itself, and `rule` is not called.
    ///
    /// # Panics
    /// Before [`GroupStep::solve`].
    pub fn evaluate_nominal(&mut self, rule: &mut dyn ImpulseRule<R>) -> NominalEvaluation<R> {
        let functions = self.functions();
        let Self { compiled, workspace, settings, nominal, .. } = self;
        (functions.evaluate_nominal)(nominal.as_mut().expect(UNSOLVED), compiled, settings, workspace, rule)
    }

    /// Displaces one coordinate of the state, or one control, from its nominal value, by an `offset` per lane.
    ///
    /// # Panics
    /// Before [`GroupStep::solve`], and if there is no coordinate `i`.
    pub fn displace(&mut self, part: StatePart, i: usize, offset: R) {
        let functions = self.functions();
        let Self { compiled, workspace, nominal, .. } = self;
        (functions.displace)(nominal.as_mut().expect(UNSOLVED), compiled, workspace, part, i, offset);
    }

    /// Runs stages 1 to 8 at the present state with the impulses of `rule`, then returns to the nominal state. Returns whether contacts and
    /// rows were computed for the present configuration. Otherwise those of the last evaluation are still valid.
    ///
    /// # Panics
    /// Before [`GroupStep::solve`].
    pub fn evaluate(&mut self, recomputed: Recomputed, rule: &mut dyn ImpulseRule<R>) -> bool {
        let functions = self.functions();
        let Self { compiled, workspace, settings, nominal, .. } = self;
        (functions.evaluate)(nominal.as_mut().expect(UNSOLVED), compiled, settings, workspace, recomputed, rule)
    }

    /// Writes the displacement from the nominal outcome to that of the last evaluation: configuration and velocity (nv each), activations.
    ///
    /// # Panics
    /// Before [`GroupStep::solve`], and if `out` has fewer or more than 2 nv + na numbers.
    pub fn change(&self, out: &mut [R]) {
        (self.functions().change)(self.nominal(), &self.compiled, &self.workspace, out);
    }

    /// Calls `see` with the gaps at the last evaluation, in the lanes `lanes` (bits). Returns the lanes that have all overlaps of the
    /// solution.
    ///
    /// With hard contact these are the gaps of contacts and limits that push in the nominal step. With MuJoCo's law, they are all gaps.
    ///
    /// # Panics
    /// Before [`GroupStep::solve`].
    pub fn gaps(&self, lanes: u32, see: &mut dyn FnMut(Gap)) -> u32 {
        (self.functions().gaps)(self.nominal(), &self.compiled, &self.workspace, lanes, see)
    }

    /// Ends the evaluations: rows follow the present gaps of contacts and limits again.
    pub fn finish(&mut self) {
        if let Some(nominal) = &mut self.nominal {
            nominal.overlaps.release(&mut self.workspace);
        }
    }

    /// Memory of a visitor, which [`GroupStep::store_memory`] stored; `None` if it is of another type.
    pub fn take_memory<T: Any + Send>(&mut self) -> Option<Box<T>> {
        self.memory.take()?.downcast().ok()
    }

    /// Stores the memory of a visitor for its next visit on the same thread.
    pub fn store_memory<T: Any + Send>(&mut self, memory: Box<T>) {
        self.memory = Some(memory);
    }
}
