//! Worker: steps groups of environments on one thread. There is one type per lane type, compiled for each CPU level.

use std::any::Any;

use serde::{Serialize, de::DeserializeOwned};
use stepper_real::{Level, Mask, Real, Scalar, at_level, kernel};

use crate::analysis::derived::{Derivation, DerivedQuantity};
use crate::batch::call::Call;
use crate::batch::exchange::{load_control, load_inputs, load_state, store_mocap_poses, store_state};
use crate::batch::ray_query::RayQuery;
use crate::batch::rollout::{Numbers, Quantity, RecordingChunk};
use crate::batch::sensors::{Reader, store_sensor_inputs};
use crate::batch::state::Group;
use crate::compile::{CompiledModel, LaneModel};
use crate::group_step::{GroupFunctions, GroupStep};
use crate::integrators::devices::{ActuatorDevices, Devices, SensorDevices};
use crate::integrators::workspace::Workspace;
use crate::math::lanes::{count, each_of};
use crate::options::StepSettings;
use crate::probe::{NoProbe, Probe, span};
use crate::stages::s10_record::Status;
use crate::step::step;

/// Workspace of a thread, with the step compiled for its lanes and CPU level.
pub trait Worker<S: Scalar>: Send {
    /// Makes the steps of `call.part`, one part of the call, in the group at position `at`.
    fn run(&mut self, call: &Call<'_, S>, group: &mut Group<S>, at: GroupPosition<'_, '_, S>);
    /// Reads the sensors of one group, whose first environment is `first`, and writes one row of readings per environment to `out`. The
    /// readings are those of ideal sensors if `truth` is true, otherwise those after the error models.
    fn sense(&mut self, call: &Call<'_, S>, group: &mut Group<S>, first: usize, truth: bool, out: &mut [f64]);
    /// Computes derived quantities of one group, whose first environment is `first`. Each has an array in `out`, with one row per
    /// environment.
    fn derive(&mut self, call: &Call<'_, S>, group: &Group<S>, first: usize, quantities: &[DerivedQuantity], out: &mut [&mut [S]]);
    /// Replaces the contacts stored in `group`, a copy of a group whose first environment is `first`, in lanes whose state was set since
    /// the last step. The new contacts are those of a trial step.
    fn find_contacts(&mut self, call: &Call<'_, S>, group: &mut Group<S>, first: usize);
    /// Casts the rays of one group, whose first environment is `first`. Writes the distances, m, and the geoms of the first hits to `rows`,
    /// one row per environment.
    fn cast_rays(&mut self, call: &Call<'_, S>, group: &Group<S>, first: usize, query: &RayQuery<'_, S>, rows: (&mut [S], &mut [i32]));
    /// Constraint problem of lane `lane` at the first solve in the steps of `call`, as bytes. The function overwrites the state in `group`.
    fn problem(&mut self, call: &Call<'_, S>, group: &mut Group<S>, first: usize, lane: usize) -> Vec<u8>;
    /// Prepares the [`GroupStep`] of one group for a step with the inputs of `call`, and passes it to the callback `visit`. The argument
    /// `first` is the index of the group's first environment.
    fn lend_step(&mut self, call: &Call<'_, S>, group: &mut Group<S>, first: usize, visit: &mut dyn FnMut(&mut dyn Any));
    /// Discards the worker's copy of the last group's state. This is necessary after a change of the group's state outside the worker.
    fn forget_state(&mut self);
}

/// Inputs for the creation of a worker.
#[derive(Clone, Copy)]
pub struct WorkerSpec<'a, S: Scalar> {
    /// Compiled model.
    pub compiled: &'a CompiledModel<S>,
    /// Step settings, such as time step and solver options.
    pub settings: &'a StepSettings,
    /// Contact capacity per environment.
    pub max_contacts: usize,
}

/// Function that creates a worker. The arguments are the inputs for its creation, the number of lanes of a group, and the CPU level.
pub type MakeWorker<S> = fn(&WorkerSpec<'_, S>, usize, Level) -> Box<dyn Worker<S>>;

/// Scalar type (`f64` or `f32`) together with the SIMD lanes that step it.
pub trait LaneScalar: Scalar + Serialize + DeserializeOwned {
    /// Number of lanes of a group in saved states of several environments. It is the number of lanes of the narrowest CPU level, so that
    /// all CPU levels write the same states.
    const SAVED_LANES: usize;
    /// Number of lanes of a group in a batch of `num_envs` environments.
    fn lanes(num_envs: usize, level: Level) -> usize;
    /// Creates a worker for groups of `lanes` lanes at the CPU level `level`, which this machine must have. The worker calls `probe` during
    /// its steps.
    #[cfg(not(test))]
    fn probed_worker(spec: &WorkerSpec<'_, Self>, lanes: usize, level: Level, probe: impl Probe) -> Box<dyn Worker<Self>>;
    /// Panics: unit tests make no steps. Their build leaves the code out, because compiling it a second time takes minutes.
    #[cfg(test)]
    fn probed_worker(_: &WorkerSpec<'_, Self>, _: usize, _: Level, _: impl Probe) -> Box<dyn Worker<Self>> {
        unimplemented!("unit tests do not step")
    }
    /// Creates a worker without a probe.
    fn worker(spec: &WorkerSpec<'_, Self>, lanes: usize, level: Level) -> Box<dyn Worker<Self>> {
        Self::probed_worker(spec, lanes, level, NoProbe)
    }
    /// Functions for evaluations of a step in the lanes `R`, which `lend_step` lends to derivatives; `None` for 32-bit numbers, because
    /// derivatives are computed only in 64 bits.
    fn group_functions<R: Real<Scalar = Self>>() -> Option<GroupFunctions<R>>;
    /// Unwraps an output array whose precision is that of this scalar type.
    ///
    /// # Panics
    /// When the array has the other precision, which [`Simulation`](crate::Simulation) prevents.
    fn numbers(array: Numbers<'_>) -> &mut [Self];
}

/// Position of a group in the batch, and the output arrays of its chunk.
#[derive(Debug)]
pub struct GroupPosition<'a, 'b, S> {
    /// Index of the first environment of the group.
    pub first: usize,
    /// Index of the first environment of the group's chunk (consecutive groups that a worker takes at a time).
    pub chunk_first: usize,
    /// Output rows of the environments of this chunk; `None` without recording.
    pub recording: Option<&'a mut RecordingChunk<'b, S>>,
}

fn width<R: Real>() -> usize {
    R::LANES
}

impl LaneScalar for f64 {
    const SAVED_LANES: usize = 4;

    fn lanes(num_envs: usize, level: Level) -> usize {
        if num_envs == 1 { 1 } else { at_level!(level, F64Lanes, width()) }
    }

    #[cfg(not(test))]
    fn probed_worker(spec: &WorkerSpec<'_, f64>, lanes: usize, level: Level, probe: impl Probe) -> Box<dyn Worker<f64>> {
        match lanes {
            1 => at_level!(level, F64x1, lane_worker(spec, probe)),
            _ => at_level!(level, F64Lanes, lane_worker(spec, probe)),
        }
    }

    fn group_functions<R: Real<Scalar = f64>>() -> Option<GroupFunctions<R>> {
        Some(GroupFunctions::new())
    }

    fn numbers(array: Numbers<'_>) -> &mut [f64] {
        match array {
            Numbers::F64(x) => x,
            Numbers::F32(_) => panic!("an output array in 32 bits for a batch in 64"),
        }
    }
}

impl LaneScalar for f32 {
    const SAVED_LANES: usize = 8;

    fn lanes(_: usize, level: Level) -> usize {
        at_level!(level, F32Lanes, width())
    }

    #[cfg(not(test))]
    fn probed_worker(spec: &WorkerSpec<'_, f32>, _: usize, level: Level, probe: impl Probe) -> Box<dyn Worker<f32>> {
        at_level!(level, F32Lanes, lane_worker(spec, probe))
    }

    fn group_functions<R: Real<Scalar = f32>>() -> Option<GroupFunctions<R>> {
        None
    }

    fn numbers(array: Numbers<'_>) -> &mut [f32] {
        match array {
            Numbers::F32(x) => x,
            Numbers::F64(_) => panic!("an output array in 64 bits for a batch in 32"),
        }
    }
}

/// Creates a worker for the lane type `R`, whose steps call `probe`.
pub fn lane_worker<R: Real<Scalar: LaneScalar>>(spec: &WorkerSpec<'_, R::Scalar>, probe: impl Probe) -> Box<dyn Worker<R::Scalar>> {
    let compiled = spec.compiled.in_lanes::<R>();
    Box::new(LaneWorker {
        probe,
        step: GroupStep::new(compiled, spec.settings, spec.max_contacts, R::Scalar::group_functions()),
        flags: vec![0; R::LANES],
        derivation: Derivation::default(),
    })
}

/// Worker for one lane type: compiled model with the parameters of its lanes, and workspace.
struct LaneWorker<R: Real, P: Probe> {
    probe: P,
    /// Step of the present group: compiled model with the parameters of the group's lanes, and workspace.
    step: GroupStep<R>,
    /// Status flags of the steps with the present control, per lane.
    flags: Vec<u32>,
    /// Workspace of derived quantities, allocated when it is first used.
    derivation: Derivation<R>,
}

impl<R: Real, P: Probe> Worker<R::Scalar> for LaneWorker<R, P> {
    fn run(&mut self, call: &Call<'_, R::Scalar>, group: &mut Group<R::Scalar>, at: GroupPosition<'_, '_, R::Scalar>) {
        let GroupPosition { first, chunk_first, mut recording } = at;
        let probe = self.probe;
        span!(probe, Load, || self.load_overrides(call, group, first));
        let reader = Reader { call, compiled: &self.step.compiled, first, probe };
        span!(probe, Sense, || reader.begin_observations(group, &mut self.step.workspace));
        span!(probe, Load, || self.load(call, group, first));
        for control in call.part.controls(call.schedule) {
            span!(probe, Load, || load_control(call, control, first, &mut self.step.workspace));
            let steps = call.part.steps_of(control, call.schedule);
            let mut residual = R::zero();
            self.flags[..R::LANES].fill(0);
            // Earlier steps with this control belong to previous parts of the call, so that their flags and residual are restored.
            if let (Some(recording), true) = (&recording, steps.start > 0) {
                residual = recording.resume(control, first - chunk_first, self.step.workspace.alive, &mut self.flags);
            }
            let observed = recording.as_ref().is_some_and(|recording| recording.has(Quantity::Observation));
            let residual = kernel!(R, || self.run_control(call, group, first, (steps.len(), observed), residual));
            let Self { step: GroupStep { workspace: s, compiled, .. }, flags, .. } = self;
            if let Some(recording) = &mut recording {
                if observed {
                    // The last step with this control reads the sensors. Without a step they have not been read.
                    let unread = steps.is_empty();
                    span!(probe, Sense, || Reader { call, compiled, first, probe }.complete_readings(group, s, unread));
                }
                let readings = if observed { &s.sensors.workspace.truth[..] } else { &[] };
                span!(probe, Rollout, || recording.write(control, first - chunk_first, s, readings, flags, residual));
            }
        }
        span!(probe, Store, || self.store(call, group));
    }

    fn sense(&mut self, call: &Call<'_, R::Scalar>, group: &mut Group<R::Scalar>, first: usize, truth: bool, out: &mut [f64]) {
        self.load_overrides(call, group, first);
        let reader = Reader { call, compiled: &self.step.compiled, first, probe: self.probe };
        reader.read(group, &mut self.step.workspace, truth, out);
    }

    fn derive(
        &mut self,
        call: &Call<'_, R::Scalar>,
        group: &Group<R::Scalar>,
        first: usize,
        quantities: &[DerivedQuantity],
        out: &mut [&mut [R::Scalar]],
    ) {
        self.load_overrides(call, group, first);
        let reader = Reader { call, compiled: &self.step.compiled, first, probe: self.probe };
        // Quantities of the last step (accelerations, forces) may repeat that step, which changes the poses in the workspace. They
        // therefore come second.
        for of_last_step in [false, true] {
            if quantities.iter().all(|q| q.is_of_last_step() != of_last_step) {
                continue;
            }
            // Actuators may pull on contacts.
            let contacts = quantities.contains(&DerivedQuantity::BodyForce) || self.step.compiled.adhesion.is_some();
            reader.load_to_derive(group, &mut self.step.workspace, of_last_step, contacts);
            self.derivation.begin(&self.step.compiled, &mut self.step.workspace);
            for (&quantity, out) in quantities.iter().zip(&mut *out).filter(|(q, _)| q.is_of_last_step() == of_last_step) {
                self.derivation.derive(&self.step.compiled, call.settings, &mut self.step.workspace, quantity, out);
            }
        }
    }

    fn find_contacts(&mut self, call: &Call<'_, R::Scalar>, group: &mut Group<R::Scalar>, first: usize) {
        self.load_overrides(call, group, first);
        let reader = Reader { call, compiled: &self.step.compiled, first, probe: self.probe };
        reader.load_to_derive(group, &mut self.step.workspace, true, false);
        group.store_contacts(&self.step.workspace.state.contacts);
    }

    fn cast_rays(
        &mut self,
        call: &Call<'_, R::Scalar>,
        group: &Group<R::Scalar>,
        first: usize,
        query: &RayQuery<'_, R::Scalar>,
        (distances, geoms): (&mut [R::Scalar], &mut [i32]),
    ) {
        self.load_overrides(call, group, first);
        let Self { step: GroupStep { workspace: s, compiled, .. }, derivation, probe, .. } = self;
        Reader { call, compiled, first, probe: *probe }.load_to_derive(group, s, false, false);
        derivation.begin(compiled, s);
        s.evaluation.kinematics.update(compiled, &s.state.q);
        query.cast(compiled, &s.evaluation.kinematics, first, distances, geoms);
    }

    fn problem(&mut self, call: &Call<'_, R::Scalar>, group: &mut Group<R::Scalar>, first: usize, lane: usize) -> Vec<u8> {
        // `group` is a copy. The workspace must load this copy now, and must not use its new state in the next call.
        self.step.workspace.current = false;
        self.step.workspace.velocity.capture.lane = Some(lane);
        self.run(call, group, GroupPosition { first, chunk_first: first, recording: None });
        self.step.workspace.current = false;
        std::mem::take(&mut self.step.workspace.velocity.capture.bytes)
    }

    fn lend_step(&mut self, call: &Call<'_, R::Scalar>, group: &mut Group<R::Scalar>, first: usize, visit: &mut dyn FnMut(&mut dyn Any)) {
        self.step.workspace.current = false;
        self.load_overrides(call, group, first);
        self.load(call, group, first);
        load_control(call, 0, first, &mut self.step.workspace);
        self.step.settings = *call.settings;
        visit(&mut self.step);
        // Reset everything that the visitor may have changed, so that later steps do not depend on it.
        self.step.finish();
        self.step.workspace.evaluation.collision.swap_separation_cache(&mut group.separation_cache);
    }

    fn forget_state(&mut self) {
        self.step.workspace.current = false;
    }
}

impl<R: Real, P: Probe> LaneWorker<R, P> {
    /// Loads the per-environment parameters of the group whose first environment is `first`.
    fn load_overrides(&mut self, call: &Call<'_, R::Scalar>, group: &Group<R::Scalar>, first: usize) {
        assert_eq!(group.lanes, R::LANES, "a worker takes groups of its own width");
        if let Some(numbers) = call.overrides.numbers.get(first / R::LANES) {
            self.step.compiled.params.load_lanes(&call.overrides.indices, numbers);
            if self.step.compiled.params.has_geoms(&call.overrides.indices) {
                self.step.workspace.evaluation.collision.update_static_poses(&self.step.compiled);
            }
        }
    }

    /// Loads the state of a group and the inputs of the call into the workspace. In the first part of a call, also clears the record of the
    /// last call in the group.
    fn load(&mut self, call: &Call<'_, R::Scalar>, group: &mut Group<R::Scalar>, first: usize) {
        let s = &mut self.step.workspace;
        // In a batch of a single group (`current`), the workspace still has the state of the last call.
        if !s.current {
            load_state(group, s, true);
        }
        s.current = false;
        load_inputs(call, group, first, s);
        if call.part.from == 0 {
            clear_call_totals::<R>(group);
        }
        s.evaluation.collision.swap_separation_cache(&mut group.separation_cache);
    }

    /// Stores the results of the call in the state of the group.
    fn store(&mut self, call: &Call<'_, R::Scalar>, group: &mut Group<R::Scalar>) {
        let s = &mut self.step.workspace;
        s.evaluation.collision.swap_separation_cache(&mut group.separation_cache);
        if call.part.to > call.part.from {
            store_sensor_inputs(group, s);
            store_state(group, s);
        }
        if call.part.ends && call.part.to > 0 {
            store_mocap_poses(call, group, s);
        }
        s.current = call.num_envs <= R::LANES;
    }

    /// Makes `steps` steps with one control. Adds status flags to `flags`. Returns, for each lane, the larger of `residual` and the largest
    /// residual of these steps.
    ///
    /// If `observed` is true, the last step reads the sensors.
    #[inline(always)]
    fn run_control(
        &mut self,
        call: &Call<'_, R::Scalar>,
        group: &mut Group<R::Scalar>,
        first: usize,
        (steps, observed): (usize, bool),
        mut residual: R,
    ) -> R {
        let Self { step: GroupStep { workspace: s, compiled, .. }, flags, probe, .. } = self;
        let (flags, probe) = (&mut flags[..R::LANES], *probe);
        let (mut depth, mut overshoot) = (R::load(&group.depth), R::load(&group.overshoot));
        let mut violation = R::load(&group.equality_violation);
        for i in 0..steps {
            let Group { actuation, sensing, .. } = group;
            let mut devices = Devices {
                group: first / R::LANES,
                actuators: call.pipelines.map(|pipelines| ActuatorDevices { pipelines, memory: actuation }),
                sensors: Some(SensorDevices { errors: call.sensor_errors, memory: sensing, read: observed && i + 1 == steps }),
            };
            let record = step(compiled, call.settings, s, &mut devices, probe);
            span!(probe, Record, || {
                record.add_flags(flags);
                if !group.saturated.is_empty() {
                    count_saturated(compiled, s, &mut group.saturated);
                }
                for (number, out) in s.free_motion.switches().into_iter().flatten().zip(group.switches.chunks_exact_mut(R::LANES)) {
                    out.iter_mut().enumerate().for_each(|(l, out)| *out = number.lane(l).to_f64() as u32);
                }
                residual = residual.max(record.residual);
                (depth, overshoot) = (depth.max(record.depth), overshoot.max(record.overshoot));
                violation = violation.max(record.equality_violation);
                if call.settings.error.is_some() || s.evaluation.divided.any() {
                    record.error.max(R::load(&group.error)).store(&mut group.error);
                    (record.substeps + R::load(&group.substeps)).store(&mut group.substeps);
                }
                record.residual.store(&mut group.residual);
                record.sweeps.store(&mut group.sweeps);
                record.newton_steps.store(&mut group.newton_steps);
                for lane in each_of(record.lanes(Status::NOT_CONVERGED | Status::INFEASIBLE | Status::NON_FINITE | Status::UNRESOLVED)) {
                    group.worst[lane] = s.velocity.worst.of_lane(lane).0;
                }
            });
        }
        depth.store(&mut group.depth);
        overshoot.store(&mut group.overshoot);
        violation.store(&mut group.equality_violation);
        for (all, one) in group.status[..R::LANES].iter_mut().zip(flags) {
            *all |= *one;
        }
        residual
    }
}

/// Adds one to the count of each actuator in the lanes in which the last step clamped its force. A clamped sum of forces counts for all
/// actuators in the sum.
fn count_saturated<R: Real>(compiled: &LaneModel<R>, s: &Workspace<R>, counts: &mut [u32]) {
    kernel!(R, || {
        for (actuator, counts) in counts.chunks_exact_mut(R::LANES).enumerate() {
            count(s.saturated(compiled, actuator).and(s.alive).bits(), counts);
        }
    })
}

/// Clears the record of the last call in the group: status flags, worst rows, largest position errors, and counts of saturated actuators
/// and sensor faults.
fn clear_call_totals<R: Real>(group: &mut Group<R::Scalar>) {
    group.status[..R::LANES].fill(0);
    group.worst[..R::LANES].fill(0);
    group.depth[..R::LANES].fill(R::Scalar::default());
    group.overshoot[..R::LANES].fill(R::Scalar::default());
    group.equality_violation[..R::LANES].fill(R::Scalar::default());
    group.error[..R::LANES].fill(R::Scalar::default());
    group.substeps[..R::LANES].fill(R::Scalar::default());
    // `fill` calls `memset` of the C library, which takes a hundred times as long for an empty slice as for a short one.
    if !group.saturated.is_empty() {
        group.saturated.fill(0);
    }
    if !group.sensing.faults.is_empty() {
        group.sensing.faults.fill(0);
    }
}
