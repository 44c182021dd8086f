//! Many environments of one model: groups of lanes over threads.

use std::sync::Mutex;

use rayon::prelude::*;
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use stepper_real::Level;

use crate::contacts::ContactId;
use crate::model::Model;
use crate::options::Options;
use crate::plan::Plan;
use crate::state::{Group, StoredContact};
use crate::worker::{Call, Site, Stepped, Worker};

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
    /// (residual in m/s, sweeps) of the last step.
    fn certificate(&self, env: usize) -> (f64, f64);
    /// Contacts of the last step: geoms of the model and the numbers.
    fn contacts(&self, env: usize) -> Vec<([usize; 2], StoredContact)>;
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
    crew: Crew,
}

/// Workers and the pool that runs them, made at the first step and again after a fork.
struct Crew {
    idle: Mutex<Vec<Worker>>,
    pool: Option<(u32, rayon::ThreadPool)>,
}

/// Contacts an environment has room for when nobody says: all that can exist, up to 16 and 4 more per body.
fn room_for_contacts<S: Stepped>(plan: &Plan<S>, options: &Options) -> usize {
    let default = plan.contact_points.min(16 + 4 * plan.links.len());
    options.max_contacts.map_or(default, |n| (n as usize).min(plan.contact_points))
}

impl<S: Stepped> Batch<S> {
    /// `num_envs` environments at the model's reset state. `threads` 0 means all that this process may use.
    pub fn new(model: &Model, options: &Options, num_envs: usize, single: bool, threads: usize, level: Level) -> Self {
        let plan = Plan::<S>::new(model);
        let lanes = if single { S::SINGLE } else { S::LANES };
        let max_contacts = room_for_contacts(&plan, options);
        let qpos0: Vec<S> = model.qpos0.iter().map(|&x| S::from_f64(x)).collect();
        let group = |g: usize| {
            let used = (num_envs - g * lanes).min(lanes);
            Group::new(&plan, &qpos0, lanes, ((1u64 << used) - 1) as u32, max_contacts)
        };
        let groups = (0..num_envs.div_ceil(lanes)).map(group).collect();
        let threads = if threads == 0 { std::thread::available_parallelism().map_or(1, usize::from) } else { threads };
        let crew = Crew { idle: Mutex::new(Vec::new()), pool: None };
        Self { plan, groups, lanes, num_envs, max_contacts, level, threads, crew }
    }

    fn hire(&self, options: &Options) -> Worker {
        let idle = self.crew.idle.lock().expect("a worker panicked").pop();
        let site = Site { plan: &self.plan, options, max_contacts: self.max_contacts };
        idle.unwrap_or_else(|| Worker::new(&site, self.lanes, self.level))
    }

    fn release(&self, worker: Worker) {
        self.crew.idle.lock().expect("a worker panicked").push(worker);
    }

    /// A pool does not survive a fork: the child makes its own.
    fn pool(&mut self) -> &rayon::ThreadPool {
        let pid = std::process::id();
        if self.crew.pool.as_ref().is_none_or(|(owner, _)| *owner != pid) {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads).thread_name(|i| format!("stepper-{i}")).build();
            let stale = self.crew.pool.replace((pid, pool.expect("threads can be started")));
            // The parent's threads do not exist here; waiting for them would never end.
            std::mem::forget(stale.filter(|(owner, _)| *owner != pid));
        }
        &self.crew.pool.as_ref().expect("made above").1
    }

    fn at(&self, env: usize) -> (&Group<S>, usize) {
        (&self.groups[env / self.lanes], env % self.lanes)
    }

    fn at_mut(&mut self, env: usize) -> (&mut Group<S>, usize) {
        (&mut self.groups[env / self.lanes], env % self.lanes)
    }
}

impl<S: Stepped + Serialize + DeserializeOwned> Engine for Batch<S> {
    fn step(&mut self, options: &Options, inputs: &StepInputs<'_>, nstep: usize) {
        let threaded = self.threads > 1 && self.groups.len() > 1;
        if threaded {
            self.pool();
        }
        let mut groups = std::mem::take(&mut self.groups);
        let call = Call {
            plan: &self.plan,
            options,
            num_envs: self.num_envs,
            nstep,
            ctrl: inputs.ctrl,
            qfrc: inputs.qfrc,
            xfrc: inputs.xfrc,
            mocap: [inputs.mocap_pos, inputs.mocap_quat],
        };
        let work = |first: usize, groups: &mut [Group<S>]| {
            let mut worker = self.hire(options);
            for (g, group) in groups.iter_mut().enumerate() {
                worker.run(&call, group, (first + g) * self.lanes);
            }
            self.release(worker);
        };
        match &self.crew.pool {
            Some((_, pool)) if threaded => {
                // Small shares even out what some groups cost more than others.
                let share = groups.len().div_ceil(8 * self.threads);
                pool.install(|| groups.par_chunks_mut(share).enumerate().for_each(|(i, chunk)| work(i * share, chunk)));
            }
            _ => work(0, &mut groups),
        }
        self.groups = groups;
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

    fn certificate(&self, env: usize) -> (f64, f64) {
        let (group, lane) = self.at(env);
        (group.residual[lane].to_f64(), group.iterations[lane].to_f64())
    }

    fn contacts(&self, env: usize) -> Vec<([usize; 2], StoredContact)> {
        let (group, lane) = self.at(env);
        let geoms = |c: StoredContact| self.plan.pairs[c.id.pair()].geoms.map(|g| self.plan.geoms[g].index);
        group.contacts(lane).map(|c| (geoms(c), c)).collect()
    }

    fn save(&self) -> Vec<u8> {
        postcard::to_stdvec(&Saved { num_envs: self.num_envs, groups: self.groups.iter().map(Group::canonical).collect() })
            .expect("numbers serialise")
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), String> {
        let saved: Saved<S> = postcard::from_bytes(bytes).map_err(|e| format!("not a state of this version: {e}"))?;
        if saved.num_envs != self.num_envs {
            return Err(format!("a state of {} environments, this stepper has {}", saved.num_envs, self.num_envs));
        }
        if saved.groups.len() != self.groups.len() || !saved.groups.iter().zip(&self.groups).all(|(a, b)| a.fits(b)) {
            return Err("a state of another model, precision or max_contacts".into());
        }
        let contacts_exist = |g: &Group<S>| {
            let known = |&id: &u32| ContactId(id).pair() < self.plan.pairs.len().max(1);
            g.contact_count.iter().all(|&n| n as usize <= self.max_contacts) && g.contact_ids.iter().all(known)
        };
        if !saved.groups.iter().all(contacts_exist) {
            return Err("its contacts belong to no pair of this model: the bytes are damaged".into());
        }
        self.groups = saved.groups;
        Ok(())
    }
}

#[derive(Serialize, Deserialize)]
struct Saved<S> {
    num_envs: usize,
    groups: Vec<Group<S>>,
}
