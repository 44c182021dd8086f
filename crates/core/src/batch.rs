//! Many environments of one model: groups of lanes over threads.

use std::any::Any;
use std::sync::Mutex;

use serde::{Deserialize, Serialize, de::DeserializeOwned};
use stepper_real::Level;

use crate::actuation::{Chains, DriveTrain, memory};
use crate::contacts::ContactId;
use crate::drive::Train;
use crate::model::Model;
use crate::options::Options;
use crate::plan::Plan;
use crate::rollout::{Recording, Share};
use crate::sensing::errors::{Errors, Transfer};
use crate::state::{Group, StoredContact};
use crate::theta::{Differences, Own};
use crate::worker::{Call, Place, Query, Site, Stepped, Worker};

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

/// A batch, whatever its precision.
pub trait Engine: Send + Sync {
    /// Makes `nstep` steps.
    fn step(&mut self, options: &Options, inputs: &StepInputs<'_>, nstep: usize);
    /// Reads all sensors of all environments, environment-major: true readings, or those of the last step after the transfer functions.
    fn sense(&mut self, options: &Options, inputs: &StepInputs<'_>, truth: bool, out: &mut [f64]);
    /// Gives the sensors transfer functions, `None` to ideal ones.
    fn equip(&mut self, model: &Model, options: &Options, transfers: &[Option<Transfer>]) -> Result<(), String>;
    /// Gives environments parameters that differ from the model's; `None` takes all of them back, from all.
    fn randomize(&mut self, envs: &[usize], differences: Option<&[Differences]>);
    /// Memory of those parameters and of the numbers of drive trains, bytes.
    fn parameter_bytes(&self) -> usize;
    /// Gives the actuators drive trains, `None` to those without; the model and the trains are what [`DriveTrain::fold`] returned. All
    /// environments are new then.
    fn couple(&mut self, model: &Model, options: &Options, trains: &[Option<DriveTrain>]);
    /// Gives the environments `envs` other numbers of their trains: lists of one, or one for each of these; `None` leaves a train as it is.
    fn redraw(&mut self, options: &Options, trains: &[Option<DriveTrain>], envs: &[usize]);
    /// What the drive trains of one environment hand on: controls, and the numbers of those that act within a step.
    fn handed_on(&self, env: usize) -> Option<(Vec<f64>, Vec<Train<f64>>)>;
    /// Says as which environment one draws random numbers.
    fn set_stream(&mut self, env: usize, stream: u32);
    /// Begins a new episode of one environment, the first one under a new seed.
    fn begin(&mut self, env: usize, seed: Option<u64>);
    /// Makes `nstep` steps with each of the controls `inputs.ctrl`, (calls, num_envs, nu) or (calls, nu), and writes down what follows each.
    fn rollout(&mut self, options: &Options, inputs: &StepInputs<'_>, calls: usize, nstep: usize, recording: Recording<'_>);
    /// Copies a field of one environment out.
    fn read(&self, field: Field, env: usize, out: &mut [f64]);
    /// Writes a field of one environment.
    fn write(&mut self, field: Field, env: usize, values: &[f64]);
    /// Forgets warm starts, contacts and certificate of one environment.
    fn forget(&mut self, env: usize);
    /// s
    fn time(&self, env: usize) -> f64;
    /// Sets the time, s.
    fn set_time(&mut self, env: usize, time: f64);
    /// Flags of the last call.
    fn status(&self, env: usize) -> u32;
    /// Readings that were clipped and samples that were lost in the last call: two numbers for every sensor of the model.
    fn sensor_faults(&self, env: usize, out: &mut [[u32; 2]]);
    /// Steps of the last call in which the effort of each actuator was cut to its bounds.
    fn actuator_saturation(&self, env: usize, out: &mut [u32]);
    /// (residual in m/s, sweeps and Newton steps together) of the last step.
    fn certificate(&self, env: usize) -> (f64, f64);
    /// Contacts of the last step: geoms of the model and the numbers.
    fn contacts(&self, env: usize) -> Vec<([usize; 2], StoredContact)>;
    /// Memory of the state of all environments, bytes.
    fn bytes(&self) -> usize;
    /// Threads that step.
    fn threads(&self) -> usize;
    /// The room of a thread.
    fn worker(&self, options: &Options) -> Box<dyn Any + Send>;
    /// All that survives a step, as bytes.
    fn save(&self) -> Vec<u8>;
    /// Takes over what [`Engine::save`] wrote.
    fn restore(&mut self, bytes: &[u8]) -> Result<(), String>;
}

/// Environments in one scalar type.
pub struct Batch<S: Stepped> {
    plan: Plan<S>,
    groups: Vec<Group<S>>,
    lanes: usize,
    num_envs: usize,
    max_contacts: usize,
    level: Level,
    threads: usize,
    errors: Option<Errors<S>>,
    own: Own<S>,
    chains: Option<Chains<S>>,
    crew: Crew<S>,
}

/// Workers and the pool that runs them, made at the first step and again after a fork.
struct Crew<S> {
    idle: Mutex<Vec<Box<dyn Worker<S>>>>,
    pool: Option<(u32, rayon::ThreadPool)>,
}

/// Contacts an environment has room for when nobody says: all that can exist, up to 16 and some for each body.
///
/// A link of a robot has four. A loose body has what a heap of its like brings it: half of the twelve balls that fit around a ball, or of the
/// six faces of a box in a wall with four points each.
fn room_for_contacts<S: Stepped>(plan: &Plan<S>, options: &Options) -> usize {
    let mut links_of_tree = vec![0; plan.ntree];
    plan.links.iter().for_each(|l| links_of_tree[l.tree] += 1);
    let mut is_ball = vec![true; plan.nframe()];
    let long = |g: &usize| plan.params.lever(*g) != S::ZERO;
    (0..plan.geoms.len()).filter(long).for_each(|g| is_ball[plan.geoms[g].frame] = false);
    let room = plan.links.iter().enumerate().map(|(l, link)| match is_ball[l + 1] {
        _ if links_of_tree[link.tree] > 1 => 4,
        true => 6,
        false => 12,
    });
    let default = plan.contact_points.min(16 + room.sum::<usize>());
    options.max_contacts.map_or(default, |n| (n as usize).min(plan.contact_points))
}

/// Memory of the state of one environment among many, bytes.
pub fn bytes_per_env<S: Stepped>(model: &Model, options: &Options) -> usize {
    let plan = Plan::<S>::new(model);
    let group = Group::new(&plan, &vec![S::default(); plan.nq], S::LANES, 0, 0, room_for_contacts(&plan, options));
    group.bytes().div_ceil(S::LANES)
}

fn groups<S: Stepped>(model: &Model, plan: &Plan<S>, num_envs: usize, lanes: usize, max_contacts: usize) -> Vec<Group<S>> {
    let qpos0: Vec<S> = model.qpos0.iter().map(|&x| S::from_f64(x)).collect();
    let group = |g: usize| {
        let used = (num_envs - g * lanes).min(lanes);
        Group::new(plan, &qpos0, lanes, ((1u64 << used) - 1) as u32, g * lanes, max_contacts)
    };
    (0..num_envs.div_ceil(lanes)).map(group).collect()
}

impl<S: Stepped> Batch<S> {
    /// `num_envs` environments at the model's reset state. `threads` 0 means all that this process may use.
    pub fn new(model: &Model, options: &Options, num_envs: usize, single: bool, threads: usize, level: Level) -> Self {
        let plan = Plan::<S>::new(model);
        let threads = if threads == 0 { std::thread::available_parallelism().map_or(1, usize::from) } else { threads };
        let lanes = if single { S::SINGLE } else { S::lanes(&plan, num_envs, threads, level) };
        let max_contacts = room_for_contacts(&plan, options);
        let groups = groups(model, &plan, num_envs, lanes, max_contacts);
        let crew = Crew { idle: Mutex::new(Vec::new()), pool: None };
        Self { plan, groups, lanes, num_envs, max_contacts, level, threads, errors: None, chains: None, own: Own::default(), crew }
    }

    fn hire(&self, options: &Options) -> Box<dyn Worker<S>> {
        let idle = self.crew.idle.lock().expect("a worker panicked").pop();
        idle.unwrap_or_else(|| self.make_worker(options))
    }

    fn make_worker(&self, options: &Options) -> Box<dyn Worker<S>> {
        S::worker(&Site { plan: &self.plan, options, max_contacts: self.max_contacts }, self.lanes, self.level)
    }

    fn release(&self, worker: Box<dyn Worker<S>>) {
        self.crew.idle.lock().expect("a worker panicked").push(worker);
    }

    /// Workers that nobody else can reach meanwhile: there is nothing to lock.
    fn idle(&mut self) -> &mut Vec<Box<dyn Worker<S>>> {
        self.crew.idle.get_mut().expect("a worker panicked")
    }

    /// Makes the pool, one thread less than are to step: the one that calls is among them. It does not survive a fork: the child makes its own.
    fn make_pool(&mut self) {
        let pid = std::process::id();
        if self.crew.pool.as_ref().is_none_or(|(owner, _)| *owner != pid) {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads - 1).thread_name(|i| format!("stepper-{i}")).build();
            let stale = self.crew.pool.replace((pid, pool.expect("threads can be started")));
            // The parent's threads do not exist here; waiting for them would never end.
            std::mem::forget(stale.filter(|(owner, _)| *owner != pid));
        }
    }

    fn call<'a>(&'a self, options: &'a Options, inputs: &StepInputs<'a>, calls: usize, nstep: usize) -> Call<'a, S> {
        let StepInputs { ctrl, qfrc, xfrc, .. } = *inputs;
        let mocap = [inputs.mocap_pos, inputs.mocap_quat];
        let (errors, chains, own) = (self.errors.as_ref(), self.chains.as_ref(), &self.own);
        Call { plan: &self.plan, options, num_envs: self.num_envs, calls, nstep, ctrl, qfrc, xfrc, mocap, errors, chains, own }
    }

    fn threaded(&self) -> bool {
        self.threads > 1 && self.groups.len() > 1
    }

    /// Groups that a worker takes at a time: small pieces even out what some groups cost more than others.
    fn piece(&self) -> usize {
        if self.threaded() { self.groups.len().div_ceil(8 * self.threads) } else { self.groups.len() }
    }

    /// Sends the groups to the workers once, for all steps of a call, which `shares` write down piece by piece, if there are any.
    fn drive(&mut self, options: &Options, inputs: &StepInputs<'_>, calls: usize, nstep: usize, shares: &mut [Share<'_, S>]) {
        if self.threaded() {
            return self.drive_threads(options, inputs, calls, nstep, shares);
        }
        let worker = self.idle().pop();
        let mut worker = worker.unwrap_or_else(|| self.make_worker(options));
        let mut groups = std::mem::take(&mut self.groups);
        let call = self.call(options, inputs, calls, nstep);
        for (g, group) in groups.iter_mut().enumerate() {
            worker.run(&call, group, Place { first: g * self.lanes, share_first: 0, share: shares.first_mut() });
        }
        self.groups = groups;
        self.idle().push(worker);
    }

    #[inline(never)]
    fn drive_threads(&mut self, options: &Options, inputs: &StepInputs<'_>, calls: usize, nstep: usize, shares: &mut [Share<'_, S>]) {
        let size = self.piece();
        self.make_pool();
        let mut groups = std::mem::take(&mut self.groups);
        let call = self.call(options, inputs, calls, nstep);
        let shares = shares.iter_mut().map(Some).chain(std::iter::repeat_with(|| None));
        self.hand_out(options, groups.chunks_mut(size).zip(shares).enumerate(), |worker, (piece, (groups, mut share))| {
            let share_first = piece * size * self.lanes;
            for (g, group) in groups.iter_mut().enumerate() {
                worker.run(&call, group, Place { first: share_first + g * self.lanes, share_first, share: share.as_deref_mut() });
            }
        });
        self.groups = groups;
    }

    /// Lets this thread, and those of the pool if there is one, take pieces whenever they are ready for one, each with a worker. This thread need not
    /// be woken, and the others join it when they are awake.
    fn hand_out<P: Send>(&self, options: &Options, pieces: impl Iterator<Item = P> + Send, work: impl Fn(&mut dyn Worker<S>, P) + Sync) {
        let helpers = self.threads.min(pieces.size_hint().0) - 1;
        let pieces = Mutex::new(pieces);
        let next = || pieces.lock().expect("taking a piece does not panic").next();
        let take = || {
            let mut worker = None;
            while let Some(piece) = next() {
                work(&mut **worker.get_or_insert_with(|| self.hire(options)), piece);
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
        self.lanes.min(S::LANES)
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
    fn step(&mut self, options: &Options, inputs: &StepInputs<'_>, nstep: usize) {
        self.drive(options, inputs, 1, nstep, &mut []);
    }

    fn rollout(&mut self, options: &Options, inputs: &StepInputs<'_>, calls: usize, nstep: usize, recording: Recording<'_>) {
        let mut shares = recording.split(self.num_envs, self.piece() * self.lanes, S::numbers);
        self.drive(options, inputs, calls, nstep, &mut shares);
    }

    fn sense(&mut self, options: &Options, inputs: &StepInputs<'_>, truth: bool, out: &mut [f64]) {
        let width = self.plan.sensing.width;
        if width == 0 {
            return;
        }
        let share = self.piece();
        if self.threaded() {
            self.make_pool();
        }
        let mut groups = std::mem::take(&mut self.groups);
        let call = self.call(options, inputs, 1, 0);
        let rows = out.chunks_mut(share * self.lanes * width);
        self.hand_out(options, groups.chunks_mut(share).zip(rows).enumerate(), |worker, (piece, (groups, out))| {
            for (g, (group, out)) in groups.iter_mut().zip(out.chunks_mut(self.lanes * width)).enumerate() {
                worker.sense(&call, group, (piece * share + g) * self.lanes, Query { truth, out });
            }
        });
        self.groups = groups;
    }

    fn equip(&mut self, model: &Model, options: &Options, transfers: &[Option<Transfer>]) -> Result<(), String> {
        let errors = Errors::new(model, transfers, self.num_envs, self.lanes, options.timestep)?;
        self.crew = Crew { idle: Mutex::new(Vec::new()), pool: None };
        for group in &mut self.groups {
            group.sensing.with_errors(errors.memory, errors.lines, if errors.is_empty() { 0 } else { self.plan.sensing.width });
            group.sensing.waiting = group.alive;
        }
        self.errors = (!errors.is_empty()).then_some(errors);
        Ok(())
    }

    fn randomize(&mut self, envs: &[usize], differences: Option<&[Differences]>) {
        if let Some(differences) = differences {
            self.own.assign(&self.plan.params, self.groups.len(), self.lanes, envs, differences);
        } else {
            // Workers still have what they read last.
            (self.own, self.crew.idle) = (Own::default(), Mutex::default());
        }
    }

    fn parameter_bytes(&self) -> usize {
        self.own.bytes() + self.chains.as_ref().map_or(0, Chains::bytes)
    }

    fn couple(&mut self, model: &Model, options: &Options, trains: &[Option<DriveTrain>]) {
        self.plan = Plan::with_trains(model, trains);
        self.crew = Crew { idle: Mutex::new(Vec::new()), pool: None };
        self.groups = groups(model, &self.plan, self.num_envs, self.lanes, self.max_contacts);
        let chains = Chains::new(trains, self.num_envs, self.lanes, options.timestep);
        if !chains.is_empty() {
            for group in &mut self.groups {
                let nu = model.nu();
                group.actuation = memory::Memory::with_chains(self.lanes, group.alive, chains.memory, chains.lines, nu);
            }
            self.chains = Some(chains);
        }
    }

    fn redraw(&mut self, options: &Options, trains: &[Option<DriveTrain>], envs: &[usize]) {
        if let Some(chains) = &mut self.chains {
            chains.assign(trains, envs, options.timestep);
        }
    }

    fn handed_on(&self, env: usize) -> Option<(Vec<f64>, Vec<Train<f64>>)> {
        let chains = self.chains.as_ref()?;
        let (group, lane) = self.at(env);
        let applied = group.actuation.applied.iter().skip(lane).step_by(self.lanes).map(|x| x.to_f64()).collect();
        Some((applied, chains.read(&self.plan, env / self.lanes, lane)))
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

    fn certificate(&self, env: usize) -> (f64, f64) {
        let (group, lane) = self.at(env);
        (group.residual[lane].to_f64(), group.iterations[lane].to_f64())
    }

    fn contacts(&self, env: usize) -> Vec<([usize; 2], StoredContact)> {
        let (group, lane) = self.at(env);
        let geoms = |c: StoredContact| self.plan.pair_geoms(c.id.pair()).expect("made from this plan").map(|g| self.plan.geoms[g].index);
        group.contacts(lane).map(|c| (geoms(c), c)).collect()
    }

    fn bytes(&self) -> usize {
        self.groups.iter().map(Group::bytes).sum()
    }

    fn threads(&self) -> usize {
        self.threads.min(self.groups.len())
    }

    fn worker(&self, options: &Options) -> Box<dyn Any + Send> {
        self.make_worker(options)
    }

    fn save(&self) -> Vec<u8> {
        let n = self.saved_lanes();
        let parts = (0..self.num_envs.div_ceil(n)).map(|part| {
            let (group, lane) = self.at(part * n);
            group.part(lane, n).canonical()
        });
        postcard::to_stdvec(&Saved { num_envs: self.num_envs, groups: parts.collect() }).expect("numbers serialise")
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), String> {
        let saved: Saved<S> = postcard::from_bytes(bytes).map_err(|e| format!("not a state of this version: {e}"))?;
        if saved.num_envs != self.num_envs {
            return Err(format!("a state of {} environments, this stepper has {}", saved.num_envs, self.num_envs));
        }
        let n = self.saved_lanes();
        let fits = |(part, saved): (usize, &Group<S>)| {
            let (group, lane) = self.at(part * n);
            saved.fits(&group.part(lane, n))
        };
        if saved.groups.len() != self.num_envs.div_ceil(n) || !saved.groups.iter().enumerate().all(fits) {
            return Err("a state of another model, other sensors or actuators, another precision or max_contacts".into());
        }
        let contacts_exist = |g: &Group<S>| {
            let known = |&id: &u64| id == 0 || self.plan.pair_geoms(ContactId(id).pair()).is_some();
            g.contact_count.iter().all(|&n| n as usize <= self.max_contacts) && g.contact_ids.iter().all(known)
        };
        if !saved.groups.iter().all(contacts_exist) {
            return Err("its contacts belong to no pair of this model: the bytes are damaged".into());
        }
        for (part, saved) in saved.groups.iter().enumerate() {
            let (group, lane) = self.at_mut(part * n);
            group.set_part(lane, saved);
        }
        Ok(())
    }
}

/// All that survives a step, in groups of one width whatever steps them: 8 `f64` or 16 `f32`, or one environment alone.
#[derive(Serialize, Deserialize)]
struct Saved<S> {
    num_envs: usize,
    groups: Vec<Group<S>>,
}
