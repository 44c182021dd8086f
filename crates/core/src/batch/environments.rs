//! Many environments of one model: groups of lanes over threads.

use std::any::Any;
use std::sync::Mutex;
use std::time::Instant;

use serde::{Deserialize, Serialize, de::DeserializeOwned};
use stepper_real::{Level, Scalar};

use crate::actuation::affine_force::ActuatorDynamics;
use crate::actuation::{ActuatorPipelines, ActuatorSpec, memory};
use crate::batch::call::{Call, Part};
use crate::batch::randomization::{Differences, Own};
use crate::batch::rollout::{Recording, Share};
use crate::batch::state::{Group, StoredContact};
use crate::batch::worker::{BatchSlice, Query, Stepped, Worker, WorkerSpec};
use crate::batch::worst_row::WorstRow;
use crate::collision::contact_set::ContactId;
use crate::compile::CompiledModel;
use crate::error::Error;
use crate::math::lanes::DelayLine;
use crate::model::Model;
use crate::options::{Solver, Stabilization, StepSettings};
use crate::sensing::errors::{Errors, Transfer};
use crate::stages::s10_record::Status;

/// What the user says to a call of step, environment-major; empty slices say nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepInputs<'a> {
    /// (num_envs, nu), or (nu) for all.
    pub ctrl: &'a [f64],
    /// (num_envs, nv)
    pub qfrc: &'a [f64],
    /// (num_envs, nbody, 6)
    pub xfrc: &'a [f64],
    /// (num_envs, nmocap, 3)
    pub mocap_pos: &'a [f64],
    /// (num_envs, nmocap, 4)
    pub mocap_quat: &'a [f64],
}

/// Arrays of the state that can be read and written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Field {
    /// Configuration, nq.
    Qpos,
    /// Velocity, nv.
    Qvel,
    /// Activations, na.
    Act,
}

impl Field {
    /// Name in Python and in messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Qpos => "qpos",
            Self::Qvel => "qvel",
            Self::Act => "act",
        }
    }
}

/// Asked between the parts of a long call, on the thread that calls, whether it is to go on.
pub type Watch<'a> = Option<&'a mut dyn FnMut() -> bool>;

/// A batch, whatever its precision.
pub trait Engine: Any + Send + Sync {
    /// Makes `nstep` steps, fewer when the watch says so: returns how many, the same in every environment. An error is that of
    /// threads that cannot be started; nothing was done then.
    fn step(&mut self, options: &StepSettings, inputs: &StepInputs<'_>, nstep: usize, watch: Watch<'_>) -> Result<usize, String>;
    /// Reads all sensors of all environments, environment-major: true readings, or those of the last step after the transfer functions. Errors as
    /// those of [`Engine::step`].
    fn sense(&mut self, options: &StepSettings, inputs: &StepInputs<'_>, truth: bool, out: &mut [f64]) -> Result<(), String>;
    /// Gives the sensors transfer functions, `None` to ideal ones.
    fn set_sensor_models(&mut self, model: &Model, options: &StepSettings, transfers: &[Option<Transfer>]) -> Result<(), Error>;
    /// Gives environments parameters that differ from the model's; `None` takes all of them back, from all.
    fn randomize(&mut self, envs: &[usize], differences: Option<&[Differences]>);
    /// Memory of those parameters and of the numbers of drive trains, bytes.
    fn parameter_bytes(&self) -> usize;
    /// Gives the actuators drive trains, `None` to those without; the model and the trains are what [`ActuatorSpec::fold`] returned. All
    /// environments are new then.
    fn set_actuator_models(&mut self, model: &Model, options: &StepSettings, specs: &[Option<ActuatorSpec>]) -> Result<(), Error>;
    /// Gives the environments `envs` other numbers of their trains: lists of one, or one for each of these; `None` leaves a train as it is.
    fn resample_actuators(&mut self, options: &StepSettings, specs: &[Option<ActuatorSpec>], envs: &[usize]);
    /// What the drive trains of one environment hand on: controls, and the numbers of those that act within a step.
    fn handed_on(&self, env: usize) -> Option<(Vec<f64>, Vec<ActuatorDynamics<f64>>)>;
    /// Says as which environment one draws random numbers.
    fn set_stream(&mut self, env: usize, stream: u32);
    /// Begins a new episode of one environment, the first one under a new seed.
    fn begin(&mut self, env: usize, seed: Option<u64>);
    /// Makes `nstep` steps with each of `calls` controls `inputs.ctrl`, (calls, num_envs, nu) or (calls, nu), and writes down what follows
    /// each. Returns how many steps were made, as [`Engine::step`] does.
    fn rollout(
        &mut self,
        options: &StepSettings,
        inputs: &StepInputs<'_>,
        calls: [usize; 2],
        recording: Recording<'_>,
        watch: Watch<'_>,
    ) -> Result<usize, String>;
    /// Copies a field of one environment out.
    fn read(&self, field: Field, env: usize, out: &mut [f64]);
    /// Writes a field of one environment.
    fn write(&mut self, field: Field, env: usize, values: &[f64]);
    /// Forgets warm starts, contacts and certificate of one environment, and what its sensors and drive trains remember.
    fn forget(&mut self, env: usize);
    /// Says that the state of one environment was set: sensors of accelerations and forces have no last step to read. All else stays.
    fn refresh(&mut self, env: usize);
    /// Says which controls are in force in one environment before its first step, for sensors that read actuators.
    fn hold(&mut self, env: usize, ctrl: &[f64]);
    /// s
    fn time(&self, env: usize) -> f64;
    /// Sets the time, s.
    fn set_time(&mut self, env: usize, time: f64);
    /// Flags of the last call.
    fn status(&self, env: usize) -> u32;
    /// Deepest overlap of a contact (m) and farthest overshoot of a limit (rad or m) in the last call.
    fn overlaps(&self, env: usize) -> [f64; 2];
    /// Readings that were clipped and samples that were lost in the last call: two numbers for every sensor of the model.
    fn sensor_faults(&self, env: usize, out: &mut [[u32; 2]]);
    /// Steps of the last call in which the effort of each actuator was cut to its bounds.
    fn actuator_saturation(&self, env: usize, out: &mut [u32]);
    /// Residual in m/s, sweeps and Newton steps of the last step.
    fn certificate(&self, env: usize) -> [f64; 3];
    /// Worst row of the last step of the last call that was not solved.
    fn worst_row(&self, model: &Model, env: usize) -> Option<WorstRow>;
    /// Problem that a step from the present state would solve, as bytes: see [`stepper_solve::Problem::from_bytes`].
    fn problem(&self, options: &StepSettings, inputs: &StepInputs<'_>, env: usize) -> Vec<u8>;
    /// Contacts of the last step: geoms of the model and the numbers.
    fn contacts(&self, env: usize) -> Vec<([usize; 2], StoredContact)>;
    /// Memory of the state of all environments, bytes.
    fn bytes(&self) -> usize;
    /// Threads that step.
    fn threads(&self) -> usize;
    /// The room of a thread.
    fn worker(&self, options: &StepSettings) -> Box<dyn Any + Send>;
    /// All that survives a step, as bytes: `ctrl`, (num_envs, nu), are the controls in force. Of one environment, or of all.
    fn save(&self, env: Option<usize>, ctrl: &[f64]) -> Vec<u8>;
    /// Takes over what [`Engine::save`] wrote, in the environments `envs`: from a state of as many environments as there are each its own, from
    /// a state of one all the same. Returns the controls in force of the state.
    fn restore(&mut self, bytes: &[u8], envs: &[usize]) -> Result<Vec<f64>, String>;
}

/// Environments in one scalar type.
pub struct Batch<S: Stepped> {
    compiled: CompiledModel<S>,
    groups: Vec<Group<S>>,
    lanes: usize,
    num_envs: usize,
    max_contacts: usize,
    level: Level,
    threads: usize,
    errors: Option<Errors<S>>,
    own: Own<S>,
    chains: Option<ActuatorPipelines<S>>,
    crew: WorkerPool<S>,
    workers: MakeWorker<S>,
}

/// Makes a worker for groups of so many lanes at a CPU level that this machine has.
pub type MakeWorker<S> = fn(&WorkerSpec<'_, S>, usize, Level) -> Box<dyn Worker<S>>;

/// Time between two looks at the watch of a long call, s: short beside the patience of somebody who wants it to end, long beside what sending the
/// groups to the workers again takes.
const PART: f64 = 0.05;
/// Least time of a step on one thread per environment and degree of freedom, s: what makes a first part short enough.
const LEAST_COST: f64 = 5e-8;

/// Workers and the pool that runs them, made at the first step and again after a fork.
struct WorkerPool<S> {
    idle: Mutex<Vec<Box<dyn Worker<S>>>>,
    pool: Option<(u32, rayon::ThreadPool)>,
}

/// A compiled model, and the contacts that an environment has room for.
pub struct Compiled<S: Scalar> {
    compiled: CompiledModel<S>,
    max_contacts: usize,
}

impl<S: Stepped> Compiled<S> {
    /// For settings on a CPU level.
    pub fn new(model: &Model, options: &StepSettings, level: Level) -> Self {
        let compiled = CompiledModel::new(model);
        let max_contacts = room_for_contacts(model, &compiled, options, level);
        Self { compiled, max_contacts }
    }

    /// Memory of the state of one environment among many, bytes.
    pub fn bytes_per_env(&self) -> usize {
        bytes_per_env(&self.compiled, self.max_contacts)
    }
}

fn bytes_per_env<S: Stepped>(compiled: &CompiledModel<S>, max_contacts: usize) -> usize {
    let group = Group::new(compiled, &vec![S::default(); compiled.nq], S::LANES, 0, 0, max_contacts);
    group.bytes().div_ceil(S::LANES)
}

/// Memory that is asked for besides what environments keep, bytes each: indices, and what a list of many parts costs.
const BESIDES: usize = 64;

/// Whether there is memory for environments that keep so many bytes each. It is asked for at once and given back: an allocation that fails piece by
/// piece would end the process.
pub(super) fn check_memory(num_envs: usize, bytes_per_env: usize) -> Result<(), Error> {
    let fails = |all: usize| Vec::<u8>::new().try_reserve_exact(all).is_err();
    match num_envs > 1 && num_envs.checked_mul(bytes_per_env + BESIDES).is_none_or(fails) {
        true => Err(Error::Memory { num_envs, bytes_per_env }),
        false => Ok(()),
    }
}

/// Contacts an environment has room for: what the options say; else all that can exist, up to 16 and some for each body, and up to twice what the
/// model's own states have.
///
/// A link of a robot has four. A loose body has what a heap of its like brings it: half of the twelve balls that fit around a ball, or of the
/// six faces of a box in a wall with four points each. Mechanisms whose parts lie on one another (a puzzle, a gripper of many meshes) have more all the
/// time, and have them in their reset state or a keyframe.
fn room_for_contacts<S: Stepped>(model: &Model, compiled: &CompiledModel<S>, options: &StepSettings, level: Level) -> usize {
    if let Some(n) = options.max_contacts {
        return (n as usize).min(compiled.contact_points);
    }
    let mut links_of_tree = vec![0; compiled.ntree];
    compiled.links.iter().for_each(|l| links_of_tree[l.tree] += 1);
    let mut is_ball = vec![true; compiled.nframe()];
    let long = |g: &usize| compiled.params.rotation_reach(*g) != S::ZERO;
    (0..compiled.geoms.len()).filter(long).for_each(|g| is_ball[compiled.geoms[g].frame] = false);
    let room = compiled.links.iter().enumerate().map(|(l, link)| match is_ball[l + 1] {
        _ if links_of_tree[link.tree] > 1 => 4,
        true => 6,
        false => 12,
    });
    let room = 16 + room.sum::<usize>();
    if compiled.contact_points <= room {
        return compiled.contact_points;
    }
    room.max(2 * contacts_at_start(model, compiled, options, room, level)).min(compiled.contact_points)
}

/// The most contacts that a step finds from the reset state or a keyframe; there may be more than `room`.
fn contacts_at_start<S: Stepped>(
    model: &Model,
    compiled: &CompiledModel<S>,
    options: &StepSettings,
    mut room: usize,
    level: Level,
) -> usize {
    let options = StepSettings { solver: Solver::Pgs, iterations: 1, stabilization: Stabilization::None, ..*options };
    let lanes = S::SINGLE;
    let make = |room: usize| S::worker(&WorkerSpec { compiled, options: &options, max_contacts: room }, lanes, level);
    let own = Own::default();
    let call = Call {
        compiled,
        options: &options,
        num_envs: 1,
        calls: 1,
        nstep: 1,
        ctrl: &[],
        qfrc: &[],
        xfrc: &[],
        mocap: [&[], &[]],
        part: Part::whole(1),
        errors: None,
        chains: None,
        own: &own,
    };
    let still = vec![0.0; compiled.nv];
    let keyframes = model.keyframes.iter().map(|k| [&k.qpos, &k.qvel]);
    let mut worker = make(room);
    let mut most = 0;
    for [q, v] in std::iter::once([&model.qpos0, &still]).chain(keyframes) {
        let q: Vec<S> = q.iter().map(|&x| S::from_f64(x)).collect();
        loop {
            let mut group = Group::new(compiled, &q, lanes, 1, 0, room);
            group.v.iter_mut().step_by(lanes).zip(v).for_each(|(to, &x)| *to = S::from_f64(x));
            worker.forget();
            worker.run(&call, &mut group, BatchSlice { first: 0, share_first: 0, share: None });
            most = most.max(group.contact_count[0] as usize);
            if group.status[0] & Status::CONTACTS_FULL.bits() == 0 || room == compiled.contact_points {
                break;
            }
            room = (2 * room).min(compiled.contact_points);
            worker = make(room);
        }
    }
    most
}

fn groups<S: Stepped>(model: &Model, compiled: &CompiledModel<S>, num_envs: usize, lanes: usize, max_contacts: usize) -> Vec<Group<S>> {
    let qpos0: Vec<S> = model.qpos0.iter().map(|&x| S::from_f64(x)).collect();
    let group = |g: usize| {
        let used = (num_envs - g * lanes).min(lanes);
        Group::new(compiled, &qpos0, lanes, ((1u64 << used) - 1) as u32, g * lanes, max_contacts)
    };
    (0..num_envs.div_ceil(lanes)).map(group).collect()
}

impl<S: Stepped> Batch<S> {
    /// `num_envs` environments at the model's reset state. `threads` 0 means all that this process may use.
    pub fn new(model: &Model, compiled: Compiled<S>, num_envs: usize, single: bool, threads: usize, level: Level) -> Self {
        let Compiled { compiled, max_contacts } = compiled;
        let threads = if threads == 0 { std::thread::available_parallelism().map_or(1, usize::from) } else { threads };
        let lanes = if single { S::SINGLE } else { S::lanes(&compiled, num_envs, threads, level) };
        let groups = groups(model, &compiled, num_envs, lanes, max_contacts);
        // More than groups would have nothing to do.
        let threads = threads.min(groups.len());
        let crew = WorkerPool { idle: Mutex::new(Vec::new()), pool: None };
        let (own, workers) = (Own::default(), S::worker as MakeWorker<S>);
        Self { compiled, groups, lanes, num_envs, max_contacts, level, threads, errors: None, chains: None, own, crew, workers }
    }

    /// Says who makes workers from now on: those with a probe in their steps.
    pub fn set_workers(&mut self, workers: MakeWorker<S>) {
        self.workers = workers;
        self.idle().clear();
    }

    fn acquire_worker(&self, options: &StepSettings) -> Box<dyn Worker<S>> {
        let idle = self.crew.idle.lock().expect("a worker panicked").pop();
        idle.unwrap_or_else(|| self.make_worker(options))
    }

    fn make_worker(&self, options: &StepSettings) -> Box<dyn Worker<S>> {
        (self.workers)(&WorkerSpec { compiled: &self.compiled, options, max_contacts: self.max_contacts }, self.lanes, self.level)
    }

    fn release(&self, worker: Box<dyn Worker<S>>) {
        self.crew.idle.lock().expect("a worker panicked").push(worker);
    }

    /// Workers that nobody else can reach meanwhile: there is nothing to lock.
    fn idle(&mut self) -> &mut Vec<Box<dyn Worker<S>>> {
        self.crew.idle.get_mut().expect("a worker panicked")
    }

    /// Makes the pool, one thread less than are to step: the one that calls is among them. It does not survive a fork: the child makes its own.
    ///
    /// # Errors
    /// When the system refuses a thread.
    fn make_pool(&mut self) -> Result<(), String> {
        let pid = std::process::id();
        if self.crew.pool.as_ref().is_none_or(|(owner, _)| *owner != pid) {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads - 1).thread_name(|i| format!("stepper-{i}")).build();
            let pool = pool.map_err(|e| format!("{} threads cannot be started ({e}); make threads smaller", self.threads))?;
            let stale = self.crew.pool.replace((pid, pool));
            // The parent's threads do not exist here; waiting for them would never end.
            std::mem::forget(stale.filter(|(owner, _)| *owner != pid));
        }
        Ok(())
    }

    fn call<'a>(&'a self, options: &'a StepSettings, inputs: &StepInputs<'a>, [calls, nstep]: [usize; 2], part: Part) -> Call<'a, S> {
        let StepInputs { ctrl, qfrc, xfrc, .. } = *inputs;
        let mocap = [inputs.mocap_pos, inputs.mocap_quat];
        let (errors, chains, own) = (self.errors.as_ref(), self.chains.as_ref(), &self.own);
        Call {
            compiled: &self.compiled,
            options,
            num_envs: self.num_envs,
            calls,
            nstep,
            part,
            ctrl,
            qfrc,
            xfrc,
            mocap,
            errors,
            chains,
            own,
        }
    }

    fn threaded(&self) -> bool {
        self.threads > 1 && self.groups.len() > 1
    }

    /// Groups that a worker takes at a time: small pieces even out what some groups cost more than others.
    fn chunk_size(&self) -> usize {
        if self.threaded() { self.groups.len().div_ceil(8 * self.threads) } else { self.groups.len() }
    }

    /// Makes the steps of a call, `nstep` with each of `calls` controls, in one go or, where somebody watches a long one, in parts: every group
    /// ends a part before any begins the next, so that all stop at one count. Returns the steps made.
    fn drive(
        &mut self,
        options: &StepSettings,
        inputs: &StepInputs<'_>,
        calls: [usize; 2],
        shares: &mut [Share<'_, S>],
        watch: Watch<'_>,
    ) -> Result<usize, String> {
        if self.threaded() {
            self.make_pool()?;
        }
        let total = calls[0].saturating_mul(calls[1]);
        Ok(match watch {
            Some(watch) if total > self.first_part() => self.drive_parts(options, inputs, calls, shares, watch),
            _ => {
                self.drive_part(options, inputs, calls, Part::whole(total), shares);
                total
            }
        })
    }

    /// Steps of the first part of a long call.
    fn first_part(&self) -> usize {
        ((PART / LEAST_COST) as usize / (self.num_envs * self.compiled.nv.max(1))).max(1)
    }

    #[inline(never)]
    fn drive_parts(
        &mut self,
        options: &StepSettings,
        inputs: &StepInputs<'_>,
        calls: [usize; 2],
        shares: &mut [Share<'_, S>],
        watch: &mut dyn FnMut() -> bool,
    ) -> usize {
        let total = calls[0].saturating_mul(calls[1]);
        let mut part = Part { from: 0, to: self.first_part().min(total), elapsed: 0.0, ends: false };
        loop {
            let (began, steps) = (Instant::now(), part.to - part.from);
            self.drive_part(options, inputs, calls, part, shares);
            if part.ends {
                return total;
            }
            if !self.compiled.mocap.is_empty() {
                // The sums that the workers made.
                (0..steps).for_each(|_| part.elapsed += options.timestep);
            }
            part.from = part.to;
            if !watch() {
                if !self.compiled.mocap.is_empty() {
                    part.ends = true;
                    self.drive_part(options, inputs, calls, part, &mut []);
                }
                return part.to;
            }
            let rate = PART / began.elapsed().as_secs_f64().max(1e-9);
            let next = (steps as f64 * rate.clamp(0.125, 8.0)).max(1.0) as usize;
            part.to = part.from.saturating_add(next).min(total);
            part.ends = part.to == total;
        }
    }

    /// Sends the groups to the workers once, for a part of a call, which `shares` write down piece by piece, if there are any.
    fn drive_part(&mut self, options: &StepSettings, inputs: &StepInputs<'_>, calls: [usize; 2], part: Part, shares: &mut [Share<'_, S>]) {
        if self.threaded() {
            return self.drive_threads(options, inputs, calls, part, shares);
        }
        let worker = self.idle().pop();
        let mut worker = worker.unwrap_or_else(|| self.make_worker(options));
        let mut groups = std::mem::take(&mut self.groups);
        let call = self.call(options, inputs, calls, part);
        for (g, group) in groups.iter_mut().enumerate() {
            worker.run(&call, group, BatchSlice { first: g * self.lanes, share_first: 0, share: shares.first_mut() });
        }
        self.groups = groups;
        self.idle().push(worker);
    }

    #[inline(never)]
    fn drive_threads(
        &mut self,
        options: &StepSettings,
        inputs: &StepInputs<'_>,
        calls: [usize; 2],
        part: Part,
        shares: &mut [Share<'_, S>],
    ) {
        let size = self.chunk_size();
        let mut groups = std::mem::take(&mut self.groups);
        let call = self.call(options, inputs, calls, part);
        let shares = shares.iter_mut().map(Some).chain(std::iter::repeat_with(|| None));
        self.hand_out(options, groups.chunks_mut(size).zip(shares).enumerate(), |worker, (piece, (groups, mut share))| {
            let share_first = piece * size * self.lanes;
            for (g, group) in groups.iter_mut().enumerate() {
                worker.run(&call, group, BatchSlice { first: share_first + g * self.lanes, share_first, share: share.as_deref_mut() });
            }
        });
        self.groups = groups;
    }

    /// Lets this thread, and those of the pool if there is one, take pieces whenever they are ready for one, each with a worker. This thread need not
    /// be woken, and the others join it when they are awake.
    fn hand_out<P: Send>(
        &self,
        options: &StepSettings,
        pieces: impl Iterator<Item = P> + Send,
        work: impl Fn(&mut dyn Worker<S>, P) + Sync,
    ) {
        let helpers = self.threads.min(pieces.size_hint().0) - 1;
        let pieces = Mutex::new(pieces);
        let next = || pieces.lock().expect("taking a piece does not panic").next();
        let take = || {
            let mut worker = None;
            while let Some(piece) = next() {
                work(&mut **worker.get_or_insert_with(|| self.acquire_worker(options)), piece);
            }
            worker.into_iter().for_each(|worker| self.release(worker));
        };
        match &self.crew.pool {
            Some((_, pool)) => pool.in_place_scope(|scope| {
                for _ in 0..helpers {
                    scope.spawn(|_| take());
                }
                take();
            }),
            None => take(),
        }
    }

    /// Lanes of a group in a saved state.
    fn saved_lanes(&self) -> usize {
        if self.num_envs == 1 { 1 } else { self.lanes.min(S::LANES) }
    }

    fn at(&self, env: usize) -> (&Group<S>, usize) {
        (&self.groups[env / self.lanes], env % self.lanes)
    }

    /// To write to: what workers still have of it is the state no more.
    fn at_mut(&mut self, env: usize) -> (&mut Group<S>, usize) {
        self.idle().iter_mut().for_each(|worker| worker.forget());
        (&mut self.groups[env / self.lanes], env % self.lanes)
    }
}

impl<S: Stepped + Serialize + DeserializeOwned> Engine for Batch<S> {
    fn step(&mut self, options: &StepSettings, inputs: &StepInputs<'_>, nstep: usize, watch: Watch<'_>) -> Result<usize, String> {
        self.drive(options, inputs, [1, nstep], &mut [], watch)
    }

    fn rollout(
        &mut self,
        options: &StepSettings,
        inputs: &StepInputs<'_>,
        calls: [usize; 2],
        recording: Recording<'_>,
        watch: Watch<'_>,
    ) -> Result<usize, String> {
        let mut shares = recording.split(self.num_envs, self.chunk_size() * self.lanes, S::numbers);
        self.drive(options, inputs, calls, &mut shares, watch)
    }

    fn sense(&mut self, options: &StepSettings, inputs: &StepInputs<'_>, truth: bool, out: &mut [f64]) -> Result<(), String> {
        let width = self.compiled.sensing.width;
        if width == 0 {
            return Ok(());
        }
        let share = self.chunk_size();
        if self.threaded() {
            self.make_pool()?;
        }
        let mut groups = std::mem::take(&mut self.groups);
        let call = self.call(options, inputs, [1, 0], Part::whole(0));
        let rows = out.chunks_mut(share * self.lanes * width);
        self.hand_out(options, groups.chunks_mut(share).zip(rows).enumerate(), |worker, (piece, (groups, out))| {
            for (g, (group, out)) in groups.iter_mut().zip(out.chunks_mut(self.lanes * width)).enumerate() {
                worker.sense(&call, group, (piece * share + g) * self.lanes, Query { truth, out });
            }
        });
        self.groups = groups;
        Ok(())
    }

    fn set_sensor_models(&mut self, model: &Model, options: &StepSettings, transfers: &[Option<Transfer>]) -> Result<(), Error> {
        let errors = Errors::new(model, transfers, self.num_envs, self.lanes, options.timestep).map_err(Error::Sensor)?;
        let numbers = errors.memory + if errors.is_empty() { 0 } else { self.compiled.sensing.width };
        check_memory(self.num_envs, numbers * size_of::<S>() + 3 * errors.lines * size_of::<usize>())?;
        self.crew = WorkerPool { idle: Mutex::new(Vec::new()), pool: None };
        for group in &mut self.groups {
            group.sensing.with_errors(errors.memory, errors.lines, if errors.is_empty() { 0 } else { self.compiled.sensing.width });
            group.sensing.waiting = group.alive;
        }
        self.errors = (!errors.is_empty()).then_some(errors);
        Ok(())
    }

    fn randomize(&mut self, envs: &[usize], differences: Option<&[Differences]>) {
        if let Some(differences) = differences {
            self.own.assign(&self.compiled.params, self.groups.len(), self.lanes, envs, differences);
        } else {
            // Workers still have what they read last.
            (self.own, self.crew.idle) = (Own::default(), Mutex::default());
        }
    }

    fn parameter_bytes(&self) -> usize {
        self.own.bytes() + self.chains.as_ref().map_or(0, ActuatorPipelines::bytes)
    }

    fn set_actuator_models(&mut self, model: &Model, options: &StepSettings, specs: &[Option<ActuatorSpec>]) -> Result<(), Error> {
        let compiled = CompiledModel::with_actuator_specs(model, specs);
        let some = ActuatorPipelines::<S>::new(specs, self.lanes.min(self.num_envs), self.lanes, options.timestep);
        let numbers = (some.memory + model.nu()) * size_of::<S>() + some.lines * size_of::<usize>();
        check_memory(self.num_envs, bytes_per_env(&compiled, self.max_contacts) + numbers + some.bytes().div_ceil(self.lanes))?;
        self.compiled = compiled;
        self.crew = WorkerPool { idle: Mutex::new(Vec::new()), pool: None };
        self.groups = groups(model, &self.compiled, self.num_envs, self.lanes, self.max_contacts);
        let chains = ActuatorPipelines::new(specs, self.num_envs, self.lanes, options.timestep);
        if !chains.is_empty() {
            for group in &mut self.groups {
                let nu = model.nu();
                group.actuation = memory::Memory::with_chains(self.lanes, group.alive, chains.memory, chains.lines, nu);
            }
            self.chains = Some(chains);
        }
        Ok(())
    }

    fn resample_actuators(&mut self, options: &StepSettings, specs: &[Option<ActuatorSpec>], envs: &[usize]) {
        if let Some(chains) = &mut self.chains {
            chains.assign(specs, envs, options.timestep);
        }
    }

    fn handed_on(&self, env: usize) -> Option<(Vec<f64>, Vec<ActuatorDynamics<f64>>)> {
        let chains = self.chains.as_ref()?;
        let (group, lane) = self.at(env);
        let applied = group.actuation.applied.iter().skip(lane).step_by(self.lanes).map(|x| x.to_f64()).collect();
        Some((applied, chains.read(&self.compiled, env / self.lanes, lane)))
    }

    fn set_stream(&mut self, env: usize, stream: u32) {
        let (group, lane) = self.at_mut(env);
        group.sensing.stream[lane] = stream;
    }

    fn begin(&mut self, env: usize, seed: Option<u64>) {
        let (group, lane) = self.at_mut(env);
        group.sensing.begin(lane, seed);
        group.actuation.begin(lane, group.lanes);
    }

    fn read(&self, field: Field, env: usize, out: &mut [f64]) {
        let (group, lane) = self.at(env);
        let from = match field {
            Field::Qpos => &group.q,
            Field::Qvel => &group.v,
            Field::Act => &group.act,
        };
        for (out, x) in out.iter_mut().zip(from.iter().skip(lane).step_by(self.lanes)) {
            *out = x.to_f64();
        }
    }

    fn write(&mut self, field: Field, env: usize, values: &[f64]) {
        let lanes = self.lanes;
        let (group, lane) = self.at_mut(env);
        let to = match field {
            Field::Qpos => &mut group.q,
            Field::Qvel => &mut group.v,
            Field::Act => &mut group.act,
        };
        for (to, &x) in to.iter_mut().skip(lane).step_by(lanes).zip(values) {
            *to = S::from_f64(x);
        }
    }

    fn forget(&mut self, env: usize) {
        let (group, lane) = self.at_mut(env);
        group.forget(lane);
    }

    fn refresh(&mut self, env: usize) {
        let (group, lane) = self.at_mut(env);
        group.sensing.refresh(lane);
    }

    fn hold(&mut self, env: usize, ctrl: &[f64]) {
        // What drive trains hand on of them is known when they step.
        if self.chains.is_none() {
            let (group, lane) = self.at_mut(env);
            let lanes = group.lanes;
            let to = group.sensing.ctrl.iter_mut().skip(lane).step_by(lanes);
            to.zip(ctrl).for_each(|(to, &x)| *to = S::from_f64(x));
        }
    }

    fn time(&self, env: usize) -> f64 {
        let (group, lane) = self.at(env);
        group.time[lane]
    }

    fn set_time(&mut self, env: usize, time: f64) {
        let (group, lane) = self.at_mut(env);
        group.time[lane] = time;
    }

    fn status(&self, env: usize) -> u32 {
        let (group, lane) = self.at(env);
        group.status[lane]
    }

    fn overlaps(&self, env: usize) -> [f64; 2] {
        let (group, lane) = self.at(env);
        [group.depth[lane].to_f64(), group.overshoot[lane].to_f64()]
    }

    fn sensor_faults(&self, env: usize, out: &mut [[u32; 2]]) {
        let (group, lane) = self.at(env);
        let counts = group.sensing.faults.chunks_exact(2 * self.lanes);
        for (sensor, counts) in self.errors.iter().flat_map(Errors::sensors).zip(counts) {
            out[sensor] = [counts[lane], counts[self.lanes + lane]];
        }
    }

    fn actuator_saturation(&self, env: usize, out: &mut [u32]) {
        let (group, lane) = self.at(env);
        for (out, counts) in out.iter_mut().zip(group.saturated.chunks_exact(self.lanes)) {
            *out = counts[lane];
        }
    }

    fn certificate(&self, env: usize) -> [f64; 3] {
        let (group, lane) = self.at(env);
        [group.residual[lane], group.sweeps[lane], group.newton_steps[lane]].map(S::to_f64)
    }

    fn worst_row(&self, model: &Model, env: usize) -> Option<WorstRow> {
        let (group, lane) = self.at(env);
        WorstRow::of_code(group.worst[lane], model, &self.compiled)
    }

    fn problem(&self, options: &StepSettings, inputs: &StepInputs<'_>, env: usize) -> Vec<u8> {
        // A copy of the group takes the step, in a worker of its own: what is here stays as it is.
        let (group, lane) = self.at(env);
        let call = self.call(options, inputs, [1, 1], Part::whole(1));
        self.make_worker(options).problem(&call, &mut group.clone(), env - lane, lane)
    }

    fn contacts(&self, env: usize) -> Vec<([usize; 2], StoredContact)> {
        let (group, lane) = self.at(env);
        let geoms = |c: StoredContact| {
            self.compiled.pair_geoms(c.id.pair()).expect("made from this compiled").map(|g| self.compiled.geoms[g].index)
        };
        group.contacts(lane).map(|c| (geoms(c), c)).collect()
    }

    fn bytes(&self) -> usize {
        self.groups.iter().map(Group::bytes).sum()
    }

    fn threads(&self) -> usize {
        self.threads
    }

    fn worker(&self, options: &StepSettings) -> Box<dyn Any + Send> {
        self.make_worker(options)
    }

    fn save(&self, env: Option<usize>, ctrl: &[f64]) -> Vec<u8> {
        let n = if env.is_some() { 1 } else { self.saved_lanes() };
        let first = match env {
            Some(env) => env..env + 1,
            None => 0..self.num_envs,
        };
        let parts = first.clone().step_by(n).map(|first| {
            let (group, lane) = self.at(first);
            group.part(lane, n).canonical()
        });
        let saved = Saved { num_envs: first.len(), ctrl: ctrl.to_vec(), groups: parts.collect() };
        postcard::to_stdvec(&saved).expect("numbers serialise")
    }

    fn restore(&mut self, bytes: &[u8], envs: &[usize]) -> Result<Vec<f64>, String> {
        let unreadable = |what: &str| format!("not readable by this version, though undamaged: {what}");
        let (saved, rest): (Saved<S>, _) = postcard::take_from_bytes(bytes).map_err(|e| unreadable(&e.to_string()))?;
        if !rest.is_empty() {
            return Err(unreadable(&format!("{} bytes too many", rest.len())));
        }
        self.check_saved(&saved)?;
        if saved.num_envs == self.num_envs && envs.len() == self.num_envs {
            let n = self.saved_lanes();
            for (part, saved) in saved.groups.iter().enumerate() {
                let (group, lane) = self.at_mut(part * n);
                group.set_part(lane, saved);
            }
        } else {
            self.restore_some(&saved, envs);
        }
        Ok(saved.ctrl)
    }
}

impl<S: Stepped> Batch<S> {
    /// Refuses a state that is none of this batch's, in words.
    fn check_saved(&self, saved: &Saved<S>) -> Result<(), String> {
        if saved.num_envs != self.num_envs && saved.num_envs != 1 {
            let (found, own) = (saved.num_envs, self.num_envs);
            return Err(format!("a state of {found} environments, this stepper has {own}; give one of as many, or of one for all"));
        }
        let n = if saved.num_envs == 1 { 1 } else { self.saved_lanes() };
        let fits = |(part, saved): (usize, &Group<S>)| {
            let (group, lane) = self.at(part * n);
            saved.fits(&group.part(lane, n))
        };
        let nu = self.compiled.actuators.len();
        let whole = saved.groups.len() == saved.num_envs.div_ceil(n) && saved.ctrl.len() == saved.num_envs * nu;
        if !whole || !saved.groups.iter().enumerate().all(fits) {
            return Err("a state with other sensors or actuators, or another max_contacts".into());
        }
        let finite = |x: &[S]| x.iter().all(|x| x.to_f64().is_finite());
        let moves = |g: &Group<S>| finite(&g.q) && finite(&g.v) && finite(&g.act) && g.time.iter().all(|t| t.is_finite());
        if !saved.groups.iter().all(moves) {
            return Err("a number of qpos, qvel, act or time is not finite: the bytes are damaged".into());
        }
        let contacts_exist = |g: &Group<S>| {
            let known = |&id: &u64| id == 0 || self.compiled.pair_geoms(ContactId(id).pair()).is_some();
            g.contact_count.iter().all(|&n| n as usize <= self.max_contacts) && g.contact_ids.iter().all(known)
        };
        if !saved.groups.iter().all(contacts_exist) {
            return Err("its contacts belong to no pair of this model: the bytes are damaged".into());
        }
        let lines_exist = |g: &Group<S>| {
            let fits = |(line, &cursor): (DelayLine, &u32)| (cursor as usize) < line.samples.max(1);
            let [sensors, actuators] = self.delay_lines();
            sensors.into_iter().zip(&g.sensing.cursors).all(fits) && actuators.into_iter().zip(&g.actuation.cursors).all(fits)
        };
        if !saved.groups.iter().all(lines_exist) {
            return Err("its delay lines have a sample that this model's do not: the bytes are damaged".into());
        }
        Ok(())
    }

    /// Delay lines of the sensors and of the actuators.
    fn delay_lines(&self) -> [Vec<DelayLine>; 2] {
        let sensors = self.errors.iter().flat_map(Errors::delay_lines).collect();
        [sensors, self.chains.iter().flat_map(ActuatorPipelines::delay_lines).collect()]
    }

    /// Takes over environments one by one. Delay lines turn to where those of this batch are, and what comes from one environment for all draws
    /// each environment's own random numbers.
    fn restore_some(&mut self, saved: &Saved<S>, envs: &[usize]) {
        let lines = self.delay_lines();
        // All environments step together: the lines of all are at one place.
        let places = [self.groups[0].sensing.cursors.clone(), self.groups[0].actuation.cursors.clone()];
        let turn = |mut part: Group<S>| {
            let memories =
                [(&mut part.sensing.numbers, &mut part.sensing.cursors), (&mut part.actuation.numbers, &mut part.actuation.cursors)];
            for ((lines, places), (numbers, cursors)) in lines.iter().zip(&places).zip(memories) {
                for ((line, cursor), &place) in lines.iter().zip(cursors.iter_mut()).zip(places) {
                    line.turn(numbers, *cursor, place);
                    *cursor = place;
                }
            }
            part
        };
        let shared = (saved.num_envs == 1 && self.num_envs > 1).then(|| turn(saved.groups[0].clone()));
        let n = self.saved_lanes();
        for &env in envs {
            let mut part = shared.clone().unwrap_or_else(|| turn(saved.groups[env / n].part(env % n, 1)));
            let (group, lane) = self.at_mut(env);
            if shared.is_some() {
                part.sensing.stream[0] = group.sensing.stream[lane];
            }
            group.set_part(lane, &part);
        }
    }
}

/// All that survives a step, in groups of one width whatever steps them: 8 `f64` or 16 `f32`, or one environment alone.
#[derive(Serialize, Deserialize)]
struct Saved<S> {
    num_envs: usize,
    /// Controls in force.
    ctrl: Vec<f64>,
    groups: Vec<Group<S>>,
}
