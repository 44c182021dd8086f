//! Calls of a batch: steps, rollouts and sensor readings, on one thread or several, as a whole or in parts.

use std::any::Any;
use std::time::Instant;

use stepper_real::Level;

use crate::analysis::derived::DerivedQuantity;
use crate::batch::call::{Call, Part, Schedule};
use crate::batch::environments::Batch;
use crate::batch::inputs::StepInputs;
use crate::batch::rollout::{Numbers, Recording, RecordingChunk};
use crate::batch::state::{ContactOfGeoms, Group};
use crate::batch::worker::{GroupPosition, LaneScalar, Worker};
use crate::error::Error;
use crate::math::lanes::{DestinationLanes, each_of};
use crate::options::StepSettings;

/// Optional callback that can stop a call of many steps. The batch makes the steps in parts. The calling thread runs the callback after
/// each part except the last. If the callback returns false, no further part begins.
pub(super) type Watch<'a> = Option<&'a mut dyn FnMut() -> bool>;

/// Step of one group of environments, as the callback of [`Batch::lend_steps`] receives it.
pub(super) struct LentStep<'a> {
    /// Index of the first environment of the group.
    pub first: usize,
    /// Number of lanes of the group.
    pub lanes: usize,
    /// CPU level of the lanes.
    pub level: Level,
    /// Step to evaluate: a [`GroupStep`](crate::group_step::GroupStep) of the lane type of this CPU level.
    pub step: &'a mut dyn Any,
}

/// Duration of a part of a long call, s. After each part, a callback can stop the call. A user hardly notices this delay of an interrupt,
/// and the start of the next part takes far less time.
const PART: f64 = 0.05;
/// Lower bound of the computing time of a step on one thread, divided by the numbers of environments and of degrees of freedom, s.
///
/// The bound determines the number of steps in the first part of a call. The number in a later part follows from the measured time of the
/// part before.
const LEAST_COST: f64 = 5e-8;
/// Largest product of degrees of freedom, environments and steps for which a call counts as brief.
const BRIEF: usize = 10;

impl<S: LaneScalar> Batch<S> {
    /// Makes the steps of a schedule, and records quantities after each control if there is a recording. Returns the number of steps made,
    /// the same in every selected environment.
    ///
    /// The controls `inputs.ctrl` are (controls, num_envs, nu) or (controls, nu). The call stops early if `watch` returns false.
    ///
    /// # Errors
    /// [`Error::Threads`]; no step is made then.
    pub(super) fn make_steps(
        &mut self,
        inputs: &StepInputs<'_>,
        schedule: Schedule,
        recording: Option<Recording<'_>>,
        watch: Watch<'_>,
    ) -> Result<usize, Error> {
        if !inputs.mask.is_empty() && self.has_delay_lines() {
            return self.step_all_and_restore(inputs, schedule, watch);
        }
        let size = self.chunk_size() * self.lanes;
        let mut recordings = recording.map_or(Vec::new(), |recording| recording.split(self.num_envs, size, S::numbers));
        self.workers.start_threads()?;
        let total = schedule.steps();
        Ok(match watch {
            Some(watch) if total > self.first_part() => self.run_parts(inputs, schedule, &mut recordings, watch),
            _ => {
                self.run_part(inputs, schedule, Part::whole(total), &mut recordings);
                total
            }
        })
    }

    /// Reads all sensors of all environments, environment-major. The readings are those of ideal sensors if `truth` is true, otherwise
    /// those after the error models.
    ///
    /// # Errors
    /// [`Error::Threads`].
    pub(super) fn read_sensors(&mut self, inputs: &StepInputs<'_>, truth: bool, out: &mut [f64]) -> Result<(), Error> {
        let width = self.compiled.sensing.width;
        if width == 0 {
            return Ok(());
        }
        self.workers.start_threads()?;
        let size = self.chunk_size();
        let mut groups = std::mem::take(&mut self.groups);
        let call = self.call(inputs, Schedule { controls: 1, nstep: 0 }, Part::whole(0));
        // Slices instead of lists of groups: reading sensors allocates nothing.
        let rows = out.chunks_mut(size * self.lanes * width);
        self.workers.share_chunks(&self.worker_spec(), groups.chunks_mut(size).zip(rows).enumerate(), |worker, (chunk, (groups, out))| {
            for (g, (group, out)) in groups.iter_mut().zip(out.chunks_mut(self.lanes * width)).enumerate() {
                worker.sense(&call, group, (chunk * size + g) * self.lanes, truth, out);
            }
        });
        self.groups = groups;
        Ok(())
    }

    /// Contacts of each of the environments `envs` in their last step: the two geoms of each, as indices in the model, and the stored
    /// contact. If a state was set since the last step, its contacts are those of a trial step with the inputs `inputs`.
    ///
    /// # Errors
    /// [`Error::Threads`].
    pub(super) fn contacts_at_state(&mut self, inputs: &StepInputs<'_>, envs: &[usize]) -> Result<Vec<Vec<ContactOfGeoms>>, Error> {
        let mut copies: Vec<Option<Group<S>>> = vec![None; self.groups.len()];
        for &env in envs {
            let (group, lane) = self.lane(env);
            if group.sensing.fresh >> lane & 1 == 1 {
                copies[env / self.lanes].get_or_insert_with(|| group.clone());
            }
        }
        if copies.iter().any(Option::is_some) {
            self.workers.start_threads()?;
            let call = self.call(inputs, Schedule { controls: 1, nstep: 0 }, Part::whole(0));
            self.share_groups(copies.iter_mut(), |worker, first, copy| {
                if let Some(group) = copy {
                    worker.find_contacts(&call, group, first);
                }
            });
        }
        let contacts = |&env: &usize| {
            let (group, lane) = self.lane(env);
            self.contacts_of((copies[env / self.lanes].as_ref().unwrap_or(group), lane))
        };
        Ok(envs.iter().map(contacts).collect())
    }

    /// Computes derived quantities of all environments in one pass over the groups. Each quantity has an output array in the precision of
    /// the lanes, (num_envs, ...). `inputs` are the inputs in force.
    ///
    /// # Errors
    /// [`Error::Threads`].
    pub(super) fn derive(&mut self, inputs: &StepInputs<'_>, quantities: Vec<(DerivedQuantity, Numbers<'_>)>) -> Result<(), Error> {
        let (quantities, outs): (Vec<_>, Vec<_>) = quantities.into_iter().filter(|(_, out)| !out.is_empty()).unzip();
        if quantities.is_empty() {
            return Ok(());
        }
        self.workers.start_threads()?;
        let call = self.call(inputs, Schedule { controls: 1, nstep: 0 }, Part::whole(0));
        let mut outs: Vec<_> =
            outs.into_iter().map(S::numbers).map(|out| out.chunks_mut(self.lanes * (out.len() / self.num_envs))).collect();
        let rows = |group| (group, outs.iter_mut().filter_map(Iterator::next).collect::<Vec<_>>());
        self.share_groups(self.groups.iter().map(rows), |worker, first, (group, mut rows)| {
            worker.derive(&call, group, first, &quantities, &mut rows);
        });
        Ok(())
    }

    /// Calls `visit` with the step of each group of environments from the present state. The solver converges to a residual of `tolerance`,
    /// m/s. The state does not change.
    ///
    /// # Errors
    /// [`Error::Threads`].
    pub(super) fn lend_steps(
        &mut self,
        inputs: &StepInputs<'_>,
        tolerance: f64,
        visit: &(dyn Fn(LentStep<'_>) + Sync),
    ) -> Result<(), Error> {
        self.workers.start_threads()?;
        let settings = StepSettings { tolerance, ..self.settings };
        let call = Call { settings: &settings, ..self.call(inputs, Schedule { controls: 1, nstep: 1 }, Part::whole(1)) };
        let (lanes, level) = (self.lanes, self.workers.level);
        // One group per chunk, because a visit costs as much as some tens of steps.
        self.workers.share_chunks(&self.worker_spec(), self.groups.iter().enumerate(), |worker, (g, group)| {
            let first = g * lanes;
            worker.lend_step(&call, &mut group.clone(), first, &mut |step| visit(LentStep { first, lanes, level, step }));
        });
        Ok(())
    }

    /// Constraint problem of a step of environment `env` from the present state, as bytes for [`stepper_solve::Problem::from_bytes`].
    pub(super) fn problem(&self, inputs: &StepInputs<'_>, env: usize) -> Vec<u8> {
        // A new worker steps a copy of the group, so that neither the group nor an idle worker changes.
        let (group, lane) = self.lane(env);
        let call = self.call(inputs, Schedule { controls: 1, nstep: 1 }, Part::whole(1));
        self.workers.make_worker(&self.worker_spec()).problem(&call, &mut group.clone(), env - lane, lane)
    }

    /// Whether `nstep` steps take at most two or three microseconds, so that releasing Python's interpreter lock costs more than it gains.
    pub(super) fn is_brief(&self, nstep: usize) -> bool {
        nstep.saturating_mul(self.num_envs * self.compiled.nv.max(1)) <= BRIEF
    }

    pub(super) fn call<'a>(&'a self, inputs: &StepInputs<'a>, schedule: Schedule, part: Part) -> Call<'a, S> {
        Call {
            compiled: &self.compiled,
            settings: &self.settings,
            num_envs: self.num_envs,
            schedule,
            inputs: *inputs,
            part,
            sensor_errors: self.sensor_errors.as_ref(),
            overrides: &self.overrides,
            pipelines: self.pipelines.as_ref(),
        }
    }

    fn has_delay_lines(&self) -> bool {
        let Group { sensing, actuation, .. } = &self.groups[0];
        !(sensing.cursors.is_empty() && actuation.cursors.is_empty())
    }

    /// Makes steps of all environments, and then restores the state of those outside the mask `inputs.mask`. Batches with delay lines need
    /// this function, because a step advances the ring buffers of all environments together.
    #[cold]
    fn step_all_and_restore(&mut self, inputs: &StepInputs<'_>, schedule: Schedule, watch: Watch<'_>) -> Result<usize, Error> {
        let before = self.save(None, inputs.ctrl, &[]);
        let steps = self.make_steps(&StepInputs { mask: &[], ..*inputs }, schedule, None, watch)?;
        let others: Vec<usize> = (0..self.num_envs).filter(|&env| !inputs.mask[env]).collect();
        self.restore(&before, &others).expect("a state of this batch fits it");
        Ok(steps)
    }

    fn num_groups(&self) -> usize {
        self.num_envs.div_ceil(self.lanes)
    }

    /// Calls `work` for each group on one of the threads. Its arguments are a worker, the index of the group's first environment, and the
    /// group's item of `items`.
    pub(super) fn share_groups<T: Send>(&self, items: impl Iterator<Item = T> + Send, work: impl Fn(&mut dyn Worker<S>, usize, T) + Sync) {
        let size = self.chunk_size();
        let mut items = (0..).step_by(self.lanes).zip(items);
        let chunks = (0..self.num_groups().div_ceil(size)).map(|_| items.by_ref().take(size).collect::<Vec<_>>());
        self.workers.share_chunks(&self.worker_spec(), chunks, |worker, chunk| {
            chunk.into_iter().for_each(|(first, item)| work(worker, first, item));
        });
    }

    /// Number of groups in a chunk, the unit of work of a thread. Small chunks balance groups of different cost.
    pub(super) fn chunk_size(&self) -> usize {
        match self.workers.threads {
            1 => self.num_groups(),
            threads => self.num_groups().div_ceil(8 * threads),
        }
    }

    /// Number of steps in the first part of a call that is made in parts.
    fn first_part(&self) -> usize {
        ((PART / LEAST_COST) as usize / (self.num_envs * self.compiled.nv.max(1))).max(1)
    }

    /// Makes the steps of a call in parts, and calls `watch` after each part except the last. Returns the number of steps made.
    ///
    /// Every group finishes a part before any group begins the next part. If `watch` returns false, all groups therefore stop after the
    /// same step.
    #[inline(never)]
    fn run_parts(
        &mut self,
        inputs: &StepInputs<'_>,
        schedule: Schedule,
        recordings: &mut [RecordingChunk<'_, S>],
        watch: &mut dyn FnMut() -> bool,
    ) -> usize {
        let total = schedule.steps();
        let mut part = Part { from: 0, to: self.first_part().min(total), elapsed: 0.0, ends: false };
        loop {
            let (began, steps) = (Instant::now(), part.to - part.from);
            self.run_part(inputs, schedule, part, recordings);
            if part.ends {
                return total;
            }
            if !self.compiled.mocap.is_empty() {
                // The workers also add the time steps one by one, so that both sums have the same bits.
                (0..steps).for_each(|_| part.elapsed += self.settings.timestep);
            }
            part.from = part.to;
            if !watch() {
                // A last part without steps stores the poses that the mocap bodies have reached.
                if !self.compiled.mocap.is_empty() {
                    part.ends = true;
                    self.run_part(inputs, schedule, part, &mut []);
                }
                return part.to;
            }
            // The next part should take `PART` seconds. A single measured time is uncertain, so that the number of steps changes by at most
            // a factor of 8.
            let rate = PART / began.elapsed().as_secs_f64().max(1e-9);
            let next = (steps as f64 * rate.clamp(0.125, 8.0)).max(1.0) as usize;
            part.to = part.from.saturating_add(next).min(total);
            part.ends = part.to == total;
        }
    }

    /// Makes the steps of one part of a call in all groups. The workers record into `recordings`, unless it is empty.
    fn run_part(&mut self, inputs: &StepInputs<'_>, schedule: Schedule, part: Part, recordings: &mut [RecordingChunk<'_, S>]) {
        if self.workers.threads > 1 {
            return self.run_part_on_threads(inputs, schedule, part, recordings);
        }
        let worker = self.workers.idle_workers().pop();
        let mut worker = worker.unwrap_or_else(|| self.workers.make_worker(&self.worker_spec()));
        let mut groups = std::mem::take(&mut self.groups);
        let call = self.call(inputs, schedule, part);
        run_chunk(&mut *worker, &call, &mut groups, 0, recordings.first_mut());
        self.groups = groups;
        self.workers.idle_workers().push(worker);
    }

    /// Makes the steps of one part of a call on several threads, each of which takes chunks of groups until none are left.
    #[inline(never)]
    fn run_part_on_threads(&mut self, inputs: &StepInputs<'_>, schedule: Schedule, part: Part, recordings: &mut [RecordingChunk<'_, S>]) {
        let size = self.chunk_size();
        let mut groups = std::mem::take(&mut self.groups);
        let call = self.call(inputs, schedule, part);
        let recordings = recordings.iter_mut().map(Some).chain(std::iter::repeat_with(|| None));
        let chunks = groups.chunks_mut(size).zip(recordings).zip((0..).step_by(size * self.lanes));
        self.workers.share_chunks(&self.worker_spec(), chunks, |worker, ((groups, recording), first)| {
            run_chunk(worker, &call, groups, first, recording);
        });
        self.groups = groups;
    }
}

/// Makes the steps of one part of a call in a chunk of groups. `first` is the index of the chunk's first environment.
fn run_chunk<S: LaneScalar>(
    worker: &mut dyn Worker<S>,
    call: &Call<'_, S>,
    groups: &mut [Group<S>],
    first: usize,
    mut recording: Option<&mut RecordingChunk<'_, S>>,
) {
    for (g, group) in groups.iter_mut().enumerate() {
        let at = GroupPosition { first: first + g * group.lanes, chunk_first: first, recording: recording.as_deref_mut() };
        run_selected(worker, call, group, at);
    }
}

/// Makes the steps of one part of a call in one group. Environments outside the call's mask keep their state: their lanes are restored
/// after the steps.
fn run_selected<S: LaneScalar>(worker: &mut dyn Worker<S>, call: &Call<'_, S>, group: &mut Group<S>, at: GroupPosition<'_, '_, S>) {
    let mask = call.inputs.mask.get(at.first..).unwrap_or_default();
    // Lanes (bits) of environments that are not selected.
    let others = (0..group.lanes).filter(|&lane| mask.get(lane) == Some(&false)).fold(0, |set, lane| set | 1 << lane) & group.alive;
    if others == 0 {
        return worker.run(call, group, at);
    }
    if others == group.alive {
        return;
    }
    let mut before = group.clone();
    worker.run(call, group, at);
    let mut copied = others;
    if 2 * others.count_ones() > group.alive.count_ones() {
        // If more than half of the lanes must be restored, the saved group replaces the stepped one. Only the stepped lanes are then
        // copied.
        std::mem::swap(group, &mut before);
        copied = group.alive & !others;
    }
    for lane in each_of(copied) {
        group.set_part(DestinationLanes::StartingAt(lane), &before.part(lane, 1));
    }
    worker.forget_state();
}
