//! The constraint problem of a step with its workspace: what stage 4 makes, stage 5 solves and stage 8 solves again.

use std::ops::Range;

use stepper_real::{Mask, Real, Scalar};
use stepper_solve::newton::Newton;
use stepper_solve::{Capacity, Iterate, PositionRows, Problem, Reference, Snapshot};

use crate::compile::{LaneModel, ModelStructure};
use crate::constraints::active_equalities::ActiveEqualities;
use crate::constraints::assembled_rows::AssembledRows;
use crate::constraints::hyperstatic::Patches;
use crate::constraints::islands::Islands;
use crate::constraints::soft::SoftSystem;
use crate::constraints::solved_overlaps::SolvedOverlaps;
use crate::constraints::worst_row::WorstRows;
use crate::dynamics::inertia::{MassMatrix, NewtonEuler};
use crate::math::spatial::*;

/// The constraint problem of a step, and which of the model's elements its rows belong to.
#[derive(Clone, Debug)]
pub struct Constraints<R: Real> {
    /// The rows.
    pub problem: Problem<R>,
    /// The impulses.
    pub iterate: Iterate<R>,
    /// Impacts of the contacts, in their order: those without torsional and rolling friction first. Empty where no contact is elastic.
    pub(crate) impacts: Vec<Impact<R>>,
    /// Whether there are any elastic contacts, for a rule that looks at the times of impacts.
    pub(crate) has_impacts: bool,
    /// Newton's method, with its workspace.
    pub newton: Newton,
    /// Lanes that have any row.
    pub constrained: R::Mask,
    /// Lanes in which the velocities of the solution are not those that the positions should move with.
    pub needs_position_solve: R::Mask,
    /// Lanes in which the bias of an overlap is part of the velocities.
    pub biased: R::Mask,
    /// Equalities that act.
    pub(crate) active_equalities: ActiveEqualities<R>,
    /// Whether there may be rows along which nothing can move.
    pub(crate) may_be_held: bool,
    /// Lanes in which a contact bounces: positions and velocities differ there by any speed.
    pub rebounding: R::Mask,
    /// Worst rows of lanes that stage 5, or what restrains Baumgarte's method, has left unsolved.
    pub worst: WorstRows<R>,
    /// Problem of a lane as bytes, for whoever asks for it.
    pub(crate) capture: Capture,
    /// Rows of the position solve.
    pub(crate) positions: PositionRows<R>,
    /// Mobility of the bodies of every contact if nothing held them, 1/kg; 0 for scalar rows.
    pub(crate) floors: Vec<R>,
    /// What a correction starts from.
    pub(crate) reference: Reference<R>,
    pub(crate) islands: Islands,
    /// Patches of contacts whose loads are shared evenly.
    pub(crate) patches: Patches<R>,
    /// Impulses of lanes whose loads are shared evenly, while they are estimated or shared anew.
    pub(crate) shared: Snapshot<R>,
    /// Impulses of limits, then of dry friction, by their index in the compiled model, then of what names its owner: the warm start.
    pub scalar_impulse: Vec<R>,
    /// Index in `scalar_impulse` of every scalar row.
    pub owners: Vec<usize>,
    /// Slot of every contact with the lanes in which it is there.
    pub slots: Vec<(usize, R::Mask)>,
    /// The same of contacts with six rows, and what their rows of turning are scaled by, m.
    pub rolling_slots: Vec<(usize, R::Mask, V3<R>)>,
    /// Squared lengths of the numbers that the rows of a block of equalities are differences of.
    pub(crate) sizes: Vec<R>,
    /// Whether a block of equalities needs scales of its entries, block by block: see [`Constraints::add_equalities`].
    pub(crate) needs_scales: Vec<bool>,
    /// Squared scales of the entries of those rows: sums of the squares of their terms.
    pub(crate) entry_scales: Vec<R>,
    /// Squared scales of the velocities that rows of hard equalities demand, in the order of these rows, (m/s)^2.
    pub(crate) velocity_scales: Vec<R>,
    /// Squared scales of the coefficients of projections, of any row of a block.
    pub(crate) coefficient_scales: Vec<R>,
    /// Squared scales of a column, entry by entry.
    pub(crate) scales: Vec<V3<R>>,
    /// Squared scales of what the elimination of equalities removes from a column, entry by entry.
    pub(crate) removed_scales: Vec<V3<R>>,
    /// Coefficients of the projections that the last elimination removed from a column, or their scales, by index of the eliminated row.
    pub(crate) projections: Vec<V3<R>>,
    /// Of those rows: h/2 J' v, J v before the step, and the bias that corrects the error (minus a velocity).
    pub(crate) demands: Vec<[R; 3]>,
    pub(crate) column: Vec<V3<R>>,
    pub(crate) linear: Vec<V3<R>>,
    pub(crate) support: Vec<u32>,
    /// Entries of a column along a chain.
    pub(crate) path: Vec<R>,
    /// In which lanes (bits) each dof moves the second geom of a contact, and the first.
    pub(crate) signs: Vec<[u32; 2]>,
    pub(crate) words: Vec<u64>,
    /// Lanes (bits) in which both surfaces of the gathered contact can move.
    pub(crate) moving: u32,
    /// Lanes (bits) in which the first surface of the gathered contact is a plane.
    pub(crate) flat: u32,
    /// Approaching contacts, whose rows are deferred until the solved motion closes their gap.
    pub(crate) deferred: Vec<DeferredContact<R>>,
    /// Whether each contact of a lane is kept: workspace of [`Constraints::remove_missed`].
    pub(crate) kept: Vec<bool>,
    /// Time within which a row lets its gap close, s.
    pub(crate) closing_time: R,
    /// Eliminated equality rows that share a degree of freedom with the row under assembly.
    pub(crate) coupled: Vec<Range<usize>>,
    /// Entries of the eliminated equalities, times D^-1/2 and times D^1/2 of the mass matrix factors L^T D L.
    pub(crate) eliminated_entries: [Vec<R>; 2],
    /// Rows of MuJoCo's contact law, where it is asked for; the problem above is empty then.
    pub(crate) soft: Option<Box<SoftSystem<R>>>,
    /// Overlaps of the solution near which rows are made, while a step is differentiated.
    pub(crate) solved_overlaps: Option<Box<SolvedOverlaps<R>>>,
}

/// Request for the problem of a lane as the next solve of stage 5 finds it, and the answer.
#[derive(Clone, Debug, Default)]
pub(crate) struct Capture {
    /// The lane, until it is captured.
    pub(crate) lane: Option<usize>,
    /// What was captured last: see [`stepper_solve::Problem::from_bytes`].
    pub(crate) bytes: Vec<u8>,
}

/// Unknowns of the rows of a step, and the workspace of their solves.
#[derive(Debug)]
pub struct SolverWorkspace<'a, R: Real> {
    /// Impulses.
    pub iterate: &'a mut Iterate<R>,
    /// Newton's method.
    pub newton: &'a mut Newton,
    /// See [`Constraints::scalar_impulse`].
    pub scalar_impulse: &'a mut [R],
    pub(crate) worst: &'a mut WorstRows<R>,
    pub(crate) capture: &'a mut Capture,
    pub(crate) positions: &'a mut PositionRows<R>,
    pub(crate) floors: &'a mut Vec<R>,
    pub(crate) reference: &'a mut Reference<R>,
    pub(crate) islands: &'a mut Islands,
    pub(crate) patches: &'a mut Patches<R>,
    pub(crate) shared: &'a mut Snapshot<R>,
}

/// A contact that bounces within the step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Impact<R: Real> {
    /// Lanes in which it does.
    pub(crate) lanes: R::Mask,
    /// Lanes in which it overlapped before.
    pub(crate) overlapping: R::Mask,
    /// When, from the beginning of the step, as a part of it.
    pub(crate) time_fraction: R,
    /// 1 + e.
    pub(crate) normal_factor: R,
}

/// Contact whose rows are deferred in some lanes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DeferredContact<R: Real> {
    /// Index of the contact in the problem: those of three rows come first, then those of six.
    pub(crate) contact: usize,
    /// Slot of the contact in the contact set.
    pub(crate) slot: usize,
    /// Lanes in which the rows are deferred.
    pub(crate) lanes: R::Mask,
    /// Lanes in which the contact bounces. The bias there is the rebound velocity.
    pub(crate) bounces: R::Mask,
    /// Bias of the normal row, m/s: g minus the free velocity.
    pub(crate) bias: R,
    /// Initial impulse of the rows at activation, N s and N m s.
    pub(crate) impulse: [R; 6],
}

/// What the rows are made from.
#[derive(Clone, Copy, Debug)]
pub struct AssemblyInput<'a, R: Real> {
    /// Configuration at which the rows are taken.
    pub q: &'a [R],
    /// Velocity before the step.
    pub v: &'a [R],
    /// Velocities of the links, and their accelerations if no joint accelerates (both of `v`, at `q`).
    pub motion: &'a NewtonEuler<R>,
    /// Velocity after the step without constraints.
    pub v_free: &'a [R],
    /// What actuator dynamics lose to friction (against motion forwards, against motion backwards), N or N m, for every row of dry
    /// friction; empty without any.
    pub losses: &'a [[R; 2]],
    /// Time step, s.
    pub h: R,
    /// From the configuration before the step to that at which the rows are taken, s.
    pub time_before: R,
    /// Whether the step is taken in its middle, with impacts at their own time.
    pub in_the_middle: bool,
    /// Part of a gap that may close in the step.
    pub closing_fraction: R,
    /// Environments that step.
    pub alive: R::Mask,
}

impl<R: Real> AssemblyInput<'_, R> {
    /// What of the distance `phi` may close in the step; an overlap as it is.
    #[inline(always)]
    pub fn gap(&self, phi: R) -> R {
        R::select(phi.gt(R::zero()), phi * self.closing_fraction, phi)
    }
}

impl<R: Real> Constraints<R> {
    /// Workspace for a compiled model.
    pub fn new(compiled: &ModelStructure<R::Scalar>, max_contacts: usize) -> Self {
        let block = compiled.equalities.iter().map(|b| b.rows).max().unwrap_or(0);
        let rows = compiled.equalities.iter().map(|b| b.rows).sum();
        // With MuJoCo's law a slot is a contact for the lanes that touch the same trees: where there are several, at the most one for each
        // lane, of that lane's own coordinates.
        let parts = if compiled.softness.is_some() && compiled.ntree > 1 { R::LANES } else { 1 };
        let (soft_contacts, soft_support) = (max_contacts * parts, capacity_of(compiled, 0, R::LANES / parts).contact_support);
        let capacity = capacity_of(compiled, max_contacts, R::LANES);
        let rolling_contacts = capacity.rolling_contacts;
        Self {
            problem: Problem::new(&capacity),
            iterate: Iterate::new(&capacity),
            impacts: Vec::with_capacity(max_contacts + capacity.rolling_contacts),
            has_impacts: false,
            newton: Newton::default(),
            constrained: R::Mask::splat(false),
            needs_position_solve: R::Mask::splat(false),
            biased: R::Mask::splat(false),
            active_equalities: ActiveEqualities::new(compiled),
            may_be_held: false,
            rebounding: R::Mask::splat(false),
            worst: WorstRows::new(),
            capture: Capture::default(),
            positions: PositionRows::new(&capacity),
            floors: Vec::with_capacity(capacity.scalars + capacity.contacts + capacity.rolling_contacts),
            reference: Reference::new(&capacity),
            islands: Islands::new(compiled.ntree),
            patches: Patches::new(max_contacts),
            shared: Snapshot::new(&capacity),
            scalar_impulse: vec![R::zero(); compiled.scalar_impulses],
            owners: Vec::with_capacity(capacity.scalars),
            slots: Vec::with_capacity(soft_contacts),
            rolling_slots: Vec::with_capacity(if compiled.has_rolling_friction { soft_contacts } else { 0 }),
            sizes: Vec::with_capacity(block),
            entry_scales: Vec::with_capacity(compiled.equalities.iter().map(|b| b.rows * b.support.len()).max().unwrap_or(0)),
            needs_scales: vec![false; compiled.equalities.len()],
            velocity_scales: Vec::with_capacity(rows),
            coefficient_scales: vec![R::zero(); block],
            scales: vec![zero(); compiled.nv],
            removed_scales: vec![zero(); compiled.nv],
            projections: vec![zero(); rows],
            demands: Vec::with_capacity(block),
            column: vec![zero(); compiled.nv],
            linear: vec![zero(); if compiled.has_rolling_friction { compiled.nv } else { 0 }],
            support: Vec::with_capacity(compiled.nv),
            path: vec![R::zero(); compiled.nv],
            signs: vec![[0; 2]; compiled.nv],
            words: vec![0; compiled.nv.div_ceil(64)],
            moving: 0,
            flat: 0,
            deferred: Vec::with_capacity(max_contacts + rolling_contacts),
            kept: Vec::with_capacity(max_contacts),
            closing_time: R::zero(),
            coupled: Vec::with_capacity(compiled.equalities.len()),
            soft: SoftSystem::new(compiled, max_contacts, soft_contacts, soft_support),
            eliminated_entries: std::array::from_fn(|_| {
                Vec::with_capacity(compiled.equalities.iter().map(|b| b.rows * b.support.len()).sum())
            }),
            solved_overlaps: None,
        }
    }
}

/// What the rows of a compiled model can take at the most: a contact touches the ancestors of two frames in each of its lanes, and any row
/// what equalities tie to it.
fn capacity_of<S: Scalar>(compiled: &ModelStructure<S>, contacts: usize, lanes: usize) -> Capacity {
    let coupled = compiled.equalities.iter().filter(|b| b.eliminated).map(|b| b.support.len()).sum::<usize>();
    let with_coupled = |entries: usize| (entries + coupled).min(compiled.nv);
    let depth = |dof: usize| with_coupled(compiled.dofs[dof].depth);
    let single = compiled.limits.iter().map(|l| depth(l.dof)).chain(compiled.frictions.iter().map(|f| depth(f.dof))).sum::<usize>();
    let balls = compiled.ball_limits.iter().map(|b| depth(b.dof + 2)).sum::<usize>();
    let equalities = compiled.equalities.iter().map(|b| b.rows * with_coupled(b.support.len())).sum::<usize>();
    let tendons = compiled.tendons.iter().map(|t| 3 * with_coupled(t.support.len())).sum::<usize>();
    let mut moved: Vec<usize> = compiled.moved_dofs.iter().map(|m| m.iter().map(|w| w.count_ones() as usize).sum()).collect();
    moved.sort_unstable();
    let deepest: usize = moved.iter().rev().take(2).sum();
    let mut capacity = Capacity::of_coordinates(compiled.nv);
    capacity.scalars = compiled.scalar_impulses;
    capacity.scalar_entries = single + balls + equalities + tendons;
    capacity.contacts = contacts;
    capacity.rolling_contacts = if compiled.has_rolling_friction { contacts } else { 0 };
    capacity.contact_support = with_coupled(deepest * lanes);
    capacity
}

impl<R: Real> Constraints<R> {
    /// What stage 4 has made, for stages that only read it, and what they work on.
    #[inline(always)]
    pub fn split(&mut self) -> (AssembledRows<'_, R>, SolverWorkspace<'_, R>) {
        let Self { problem, owners, slots, rolling_slots, needs_position_solve, biased, rebounding, .. } = self;
        let rows = AssembledRows {
            problem,
            owners,
            slots,
            rolling_slots,
            needs_position_solve: *needs_position_solve,
            biased: *biased,
            rebounding: *rebounding,
        };
        let Self { iterate, newton, scalar_impulse, worst, capture, positions, floors, reference, islands, patches, shared, .. } = self;
        let capacity =
            SolverWorkspace { iterate, newton, scalar_impulse, worst, capture, positions, floors, reference, islands, patches, shared };
        (rows, capacity)
    }

    /// Copies the rows for the position solve.
    pub fn copy_positions(&mut self) {
        let Self { problem, positions, .. } = self;
        R::vectorize(
            #[inline(always)]
            || positions.copy(problem),
        )
    }

    /// The velocity change that the present impulses alone make, left in `out`.
    pub fn impulse_change(&self, compiled: &LaneModel<R>, mass: &MassMatrix<R>, out: &mut [R]) {
        R::vectorize(
            #[inline(always)]
            || {
                out.copy_from_slice(&self.iterate.w);
                if self.iterate.changes_velocity() {
                    mass.unscale(compiled, out);
                }
            },
        )
    }

    /// Takes up a change of the free velocity of the lanes `lanes` after the rows were made. `change` is used up.
    pub fn shift(&mut self, compiled: &LaneModel<R>, mass: &MassMatrix<R>, change: &mut [R], lanes: R::Mask) {
        if self.problem.is_empty() {
            return;
        }
        R::vectorize(
            #[inline(always)]
            || {
                mass.scale(compiled, change);
                self.problem.shift(change, lanes);
                self.undo_change_after_impacts(change, lanes);
            },
        )
    }
}
