//! Batch: many environments of one model in one scalar type, stored in groups of lanes, and the access to the state of each environment.

use stepper_real::Level;

use crate::actuation::affine_force::ActuatorDynamics;
use crate::actuation::{ActuatorPipelines, ActuatorSpec};
use crate::analysis::inverse_weights::inverse_weights;
use crate::batch::capacity::{bytes_per_env, check_memory, contact_capacity};
use crate::batch::inputs::Field;
use crate::batch::parameter_overrides::ParameterOverrides;
use crate::batch::state::{ContactOfGeoms, Group, StoredContact};
use crate::batch::worker::{LaneScalar, WorkerSpec};
use crate::batch::worker_pool::WorkerPool;
use crate::batch::worst_row::WorstRow;
use crate::compile::{CompiledModel, obstacle_count};
use crate::error::Error;
use crate::model::Model;
use crate::options::{ContactLaw, StepSettings};
use crate::sensing::errors::Errors;
use crate::stages::s10_record::Status;

/// Outcome of the last call of `step` or `rollout` in one environment. Residual and iterations are the certificate of the last step.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Outcome {
    /// Status flags of all steps of the call, combined.
    pub status: Status,
    /// Residual of the constraint problem: largest error of a contact or constraint row in the last step, as a velocity, m/s. It is 0 for
    /// the exact solution.
    pub residual: f64,
    /// Number of Gauss-Seidel iterations (sweeps) in the last step.
    pub sweeps: u32,
    /// Number of Newton iterations in the last step, summed over all islands of bodies.
    pub newton_steps: u32,
    /// Largest overlap of a contact during the call, beyond its margin, m. Each step measures it at the configuration where it evaluates
    /// contacts.
    pub depth: f64,
    /// Largest distance of a joint or tendon beyond its range, over all steps of the call, rad or m.
    pub overshoot: f64,
    /// Largest position error of an equality, over all steps of the call, m or rad; 0 without equalities.
    pub equality_violation: f64,
    /// Error estimate of the call: largest estimated error of the positions in a step, m or rad. `None` if the steps keep no error
    /// ([`Options::error`](crate::Options::error)).
    pub error: Option<f64>,
    /// Number of parts of the call into which impacts or [`Options::error`](crate::Options::error) divided steps.
    pub substeps: u32,
}

/// Batch: environments of one model in one scalar type.
#[derive(Clone)]
pub struct Batch<S: LaneScalar> {
    pub(super) compiled: CompiledModel<S>,
    pub(super) settings: StepSettings,
    /// State of the environments, in the order of their indices.
    pub(super) groups: Vec<Group<S>>,
    /// Number of lanes of a group.
    pub(super) lanes: usize,
    pub(super) num_envs: usize,
    /// Largest number of contacts of an environment.
    pub(super) max_contacts: usize,
    pub(super) sensor_errors: Option<Errors<S>>,
    pub(super) overrides: ParameterOverrides<S>,
    pub(super) pipelines: Option<ActuatorPipelines<S>>,
    pub(super) workers: WorkerPool<S>,
}

impl<S: LaneScalar> Batch<S> {
    /// Creates a batch of `num_envs` environments at the model's reset state. `threads` is the number of threads; 0 selects all that this
    /// process may use.
    ///
    /// # Errors
    /// [`Error::Memory`] when there is too little memory.
    pub fn new(model: &Model, settings: StepSettings, num_envs: usize, threads: usize, level: Level) -> Result<Self, Error> {
        let compiled = compile(model, &[], &settings);
        let max_contacts = contact_capacity(model, &compiled, &settings, level);
        check_memory(num_envs, bytes_per_env(&compiled, max_contacts))?;
        let threads = if threads == 0 { std::thread::available_parallelism().map_or(1, usize::from) } else { threads };
        let lanes = S::lanes(num_envs, level);
        let groups = make_groups(model, &compiled, num_envs, lanes, max_contacts);
        // More threads than groups would be idle.
        let workers = WorkerPool::new(threads.min(groups.len()), lanes, level);
        Ok(Self {
            compiled,
            settings,
            groups,
            lanes,
            num_envs,
            max_contacts,
            sensor_errors: None,
            overrides: ParameterOverrides::default(),
            pipelines: None,
            workers,
        })
    }

    pub(super) fn worker_spec(&self) -> WorkerSpec<'_, S> {
        WorkerSpec { compiled: &self.compiled, settings: &self.settings, max_contacts: self.max_contacts }
    }

    /// Number of lanes of a group in a saved state.
    pub(super) fn saved_lanes(&self) -> usize {
        if self.num_envs == 1 { 1 } else { self.lanes.min(S::SAVED_LANES) }
    }

    /// Group that contains environment `env`, and the environment's lane in it.
    pub(super) fn lane(&self, env: usize) -> (&Group<S>, usize) {
        (&self.groups[env / self.lanes], env % self.lanes)
    }

    /// Mutable group that contains environment `env`, and the environment's lane in it. Idle workers discard their copy of the state, so
    /// that they load it again.
    pub(super) fn lane_mut(&mut self, env: usize) -> (&mut Group<S>, usize) {
        self.workers.idle_workers().iter_mut().for_each(|worker| worker.forget_state());
        (&mut self.groups[env / self.lanes], env % self.lanes)
    }
}

/// Compiles the model for the step settings, with the actuator models in `specs`.
pub(super) fn compile<S: LaneScalar>(model: &Model, specs: &[Option<ActuatorSpec>], settings: &StepSettings) -> CompiledModel<S> {
    let mut compiled = CompiledModel::with_actuator_specs(model, specs);
    if settings.contact == ContactLaw::Mujoco {
        let weights = model.soft.inverse_weights.clone().unwrap_or_else(|| inverse_weights(model));
        compiled.soften(model, &weights, settings.timestep);
    }
    compiled
}

/// Creates the groups of `num_envs` environments at the model's reset state, with `lanes` environments each.
pub(super) fn make_groups<S: LaneScalar>(
    model: &Model,
    compiled: &CompiledModel<S>,
    num_envs: usize,
    lanes: usize,
    max_contacts: usize,
) -> Vec<Group<S>> {
    let qpos0: Vec<S> = model.qpos0.iter().map(|&x| S::from_f64(x)).collect();
    let group = |g: usize| {
        let used = (num_envs - g * lanes).min(lanes);
        Group::new(compiled, &qpos0, lanes, ((1u64 << used) - 1) as u32, g * lanes, max_contacts)
    };
    (0..num_envs.div_ceil(lanes)).map(group).collect()
}

impl<S: LaneScalar> Batch<S> {
    /// Copies a field of the state to `out`.
    pub(super) fn read(&self, field: Field, env: usize, out: &mut [f64]) {
        let (group, lane) = self.lane(env);
        let from = match field {
            Field::Qpos => &group.q,
            Field::Qvel => &group.v,
            Field::Act => &group.act,
        };
        for (out, x) in out.iter_mut().zip(from.iter().skip(lane).step_by(self.lanes)) {
            *out = x.to_f64();
        }
    }

    /// Sets a field of the state to `values`.
    pub(super) fn write(&mut self, field: Field, env: usize, values: &[f64]) {
        let lanes = self.lanes;
        let (group, lane) = self.lane_mut(env);
        let to = match field {
            Field::Qpos => &mut group.q,
            Field::Qvel => &mut group.v,
            Field::Act => &mut group.act,
        };
        for (to, &x) in to.iter_mut().skip(lane).step_by(lanes).zip(values) {
            *to = S::from_f64(x);
        }
    }

    /// Simulated time of environment `env`, s.
    pub(super) fn time(&self, env: usize) -> f64 {
        let (group, lane) = self.lane(env);
        group.time[lane]
    }

    /// Sets the simulated time of environment `env`, s.
    pub(super) fn set_time(&mut self, env: usize, time: f64) {
        let (group, lane) = self.lane_mut(env);
        group.time[lane] = time;
    }

    /// Outcome of the last call in environment `env`.
    pub(super) fn outcome(&self, env: usize) -> Outcome {
        let (group, lane) = self.lane(env);
        Outcome {
            status: Status::from_bits_retain(group.status[lane]),
            residual: group.residual[lane].to_f64(),
            sweeps: group.sweeps[lane].to_f64() as u32,
            newton_steps: group.newton_steps[lane].to_f64() as u32,
            depth: group.depth[lane].to_f64(),
            overshoot: group.overshoot[lane].to_f64(),
            equality_violation: group.equality_violation[lane].to_f64(),
            error: self.settings.error.map(|_| group.error[lane].to_f64()),
            substeps: group.substeps[lane].to_f64() as u32,
        }
    }

    /// Cause of the last unsolved step of the last call; `None` if all steps were solved.
    pub(super) fn worst_row(&self, model: &Model, env: usize) -> Option<WorstRow> {
        let (group, lane) = self.lane(env);
        WorstRow::of_code(group.worst[lane], model, &self.compiled)
    }

    /// Contacts that are stored in a lane of a group: the two geoms of each, as indices in the model, and the stored contact.
    pub(super) fn contacts_of(&self, (group, lane): (&Group<S>, usize)) -> Vec<ContactOfGeoms> {
        let geoms = |c: StoredContact| {
            self.compiled.pair_geoms(c.id.pair()).expect("a pair index of this compiled model").map(|g| self.compiled.geoms[g].index)
        };
        group.contacts(lane).map(|c| (geoms(c), c)).collect()
    }

    /// Number of clipped readings and number of lost samples in the last call, for every sensor of the model.
    pub(super) fn sensor_faults(&self, env: usize) -> Vec<[u32; 2]> {
        let mut out = vec![[0; 2]; self.compiled.sensing.sensors.len()];
        let (group, lane) = self.lane(env);
        let counts = group.sensing.faults.chunks_exact(2 * self.lanes);
        for (sensor, counts) in self.sensor_errors.iter().flat_map(Errors::sensors).zip(counts) {
            out[sensor] = [counts[lane], counts[self.lanes + lane]];
        }
        out
    }

    /// Number of steps of the last call that clamped the force of each actuator.
    pub(super) fn actuator_saturation(&self, env: usize) -> Vec<u32> {
        let (group, lane) = self.lane(env);
        (0..self.compiled.actuators.len()).map(|a| group.saturated.get(a * self.lanes + lane).copied().unwrap_or(0)).collect()
    }

    /// Obstacles that tendons touch in the last step, 1 or 0, and number of contacts that each actuator on contacts pulls.
    pub(super) fn switches(&self, env: usize) -> [Vec<u32>; 2] {
        let (group, lane) = self.lane(env);
        let mut touches: Vec<u32> = group.switches.iter().skip(lane).step_by(self.lanes).copied().collect();
        let pulled = touches.split_off(obstacle_count(&self.compiled.paths));
        [touches, pulled]
    }

    /// Controls after the actuator pipelines, and parameters of the actuator dynamics. `None` if no actuator has an actuator model.
    pub(super) fn actuator_outputs(&self, env: usize) -> Option<(Vec<f64>, Vec<ActuatorDynamics<f64>>)> {
        let pipelines = self.pipelines.as_ref()?;
        let (group, lane) = self.lane(env);
        let applied = group.actuation.applied.iter().skip(lane).step_by(self.lanes).map(|x| x.to_f64()).collect();
        Some((applied, pipelines.read(&self.compiled, env / self.lanes, lane)))
    }

    /// Begins a new episode: the next one of the present seed, or the first one of the seed `seed`.
    ///
    /// Random numbers differ from episode to episode. The function clears the memory of sensors and actuator pipelines.
    pub(super) fn begin_episode(&mut self, env: usize, seed: Option<u64>) {
        let (group, lane) = self.lane_mut(env);
        group.sensing.begin(lane, seed);
        group.actuation.begin(lane, group.lanes);
    }

    /// Sets the index of the random stream from which the environment draws its random numbers.
    pub(super) fn set_random_stream(&mut self, env: usize, stream: u32) {
        let (group, lane) = self.lane_mut(env);
        group.sensing.stream[lane] = stream;
    }

    /// Clears the results of earlier steps: warm starts, contacts and outcome, and the memory of sensors and of actuator pipelines.
    pub(super) fn clear_memory(&mut self, env: usize) {
        let (group, lane) = self.lane_mut(env);
        group.clear_memory(lane);
    }

    /// Marks the state as set by the user: sensors of accelerations and forces then ignore the results of the last step. No memory is
    /// cleared.
    pub(super) fn discard_last_step(&mut self, env: usize) {
        let (group, lane) = self.lane_mut(env);
        group.sensing.refresh(lane);
    }

    /// Sets the controls that sensors of actuator forces read before the first step. With actuator pipelines the function does nothing,
    /// because the first step determines these controls.
    pub(super) fn set_initial_ctrl(&mut self, env: usize, ctrl: &[f64]) {
        // With actuator pipelines, the first step determines the controls that sensors read.
        if self.pipelines.is_none() {
            let (group, lane) = self.lane_mut(env);
            let lanes = group.lanes;
            let to = group.sensing.ctrl.iter_mut().skip(lane).step_by(lanes);
            to.zip(ctrl).for_each(|(to, &x)| *to = S::from_f64(x));
        }
    }

    /// Memory of the state of all environments, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.groups.iter().map(Group::bytes).sum()
    }
}
