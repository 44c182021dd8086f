//! A simulation: a model, its settings and a batch of environments. What the bindings translate.

#[cfg(feature = "nalgebra")]
mod matrices;
mod parameters;
mod read;

pub use crate::batch::simulation::read::{BodyPose, Certificate, Contact};

use std::any::Any;
use std::sync::{Arc, OnceLock};

use serde::{Serialize, de::DeserializeOwned};
use stepper_real::Level;

use crate::actuation::{ActuatorModels, ActuatorSpec};
use crate::batch::randomization::Randomization;
use crate::batch::rollout::{Quantity, Recording};
use crate::batch::saved_state::SavedState;
use crate::batch::worker::Stepped;
use crate::batch::{Batch, Compiled, Engine, Field, StepInputs, Watch, check_memory};
use crate::compile::{CompiledModel, LaneModel};
use crate::error::Error;
use crate::math::precision::Precision;
use crate::model::{Keyframe, Model};
use crate::options::{Options, StepSettings};
use crate::sensing::errors::Transfer;

/// Environments of one model.
pub struct Simulation {
    model: Arc<Model>,
    options: Options,
    settings: StepSettings,
    engine: Box<dyn Engine>,
    num_envs: usize,
    precision: Precision,
    digest: OnceLock<[u8; 32]>,
    compiled: OnceLock<LaneModel<f64>>,
    randomization: Randomization,
    actuator_models: Option<ActuatorModels>,
    /// Controls in force, (num_envs, nu): those of the last step until others are given.
    ctrl: Vec<f64>,
    truth: Truth,
}

/// True readings of all sensors, as long as nothing changes that they depend on.
#[derive(Default)]
struct Truth {
    known: bool,
    readings: Vec<f64>,
    /// What the user applied then: forces on joints, wrenches, poses of mocap bodies.
    applied: [Vec<f64>; 4],
}

/// What the user applies besides controls.
fn applied<'a>(inputs: &StepInputs<'a>) -> [&'a [f64]; 4] {
    [inputs.qfrc, inputs.xfrc, inputs.mocap_pos, inputs.mocap_quat]
}

/// Environments in one scalar type; with `check`, only where there is memory for them.
fn engine<S: Stepped + Serialize + DeserializeOwned>(
    model: &Model,
    settings: &StepSettings,
    num_envs: usize,
    threads: usize,
    level: Level,
    check: bool,
) -> Result<Box<dyn Engine>, Error> {
    let compiled = Compiled::<S>::new(model, settings, level);
    if check {
        check_memory(num_envs, compiled.bytes_per_env())?;
    }
    Ok(Box::new(Batch::new(model, compiled, num_envs, num_envs == 1, threads, level)))
}

impl Simulation {
    /// `num_envs` environments at the model's reset state; `None` is a single one. `threads` 0 means all that this process may use.
    ///
    /// # Errors
    /// [`Error::Option`] for an option out of its range; [`Error::NoEnvironments`] for `Some(0)`; [`Error::Level`] when the CPU level asked for by
    /// `STEPPER_CPU_LEVEL` is not there; [`Error::Memory`] when there is no room for so many environments; [`Error::Model`] for a number that
    /// 32 bits cannot hold, in that precision; [`Error::Actuator`] for a delay of an actuator that is too long for the time step.
    pub fn new(model: Arc<Model>, options: Options, num_envs: Option<usize>, precision: Precision, threads: usize) -> Result<Self, Error> {
        options.check()?;
        if num_envs == Some(0) {
            return Err(Error::NoEnvironments);
        }
        if precision == Precision::F32 {
            model.check_range(f64::from(f32::MAX))?;
        }
        let level = Level::best()?;
        let mut simulation = Self::make(model, options, num_envs, precision, threads, level, true)?;
        if simulation.model.actuators.iter().any(|a| a.delay > 0.0) {
            let specs = vec![None; simulation.model.nu()];
            simulation.set_actuator_models(&specs)?;
        }
        Ok(simulation)
    }

    /// As [`Simulation::new`] on a CPU level that this machine has, whatever the environment variable says; options are taken without a check of
    /// their ranges.
    ///
    /// # Panics
    /// When `num_envs` is 0.
    pub fn at_level(
        model: Arc<Model>,
        options: Options,
        num_envs: Option<usize>,
        precision: Precision,
        threads: usize,
        level: Level,
    ) -> Self {
        assert_ne!(num_envs, Some(0), "num_envs must be 1 or more, or None for a single environment");
        Self::make(model, options, num_envs, precision, threads, level, false).expect("nothing is checked")
    }

    fn make(
        model: Arc<Model>,
        options: Options,
        num_envs: Option<usize>,
        precision: Precision,
        threads: usize,
        level: Level,
        check: bool,
    ) -> Result<Self, Error> {
        let n = num_envs.unwrap_or(1);
        let settings = options.resolve(model.timestep, precision);
        let engine = match precision {
            Precision::F64 => engine::<f64>(&model, &settings, n, threads, level, check)?,
            Precision::F32 => engine::<f32>(&model, &settings, n, threads, level, check)?,
        };
        let (compiled, randomization, ctrl, truth) =
            (OnceLock::new(), Randomization::default(), vec![0.0; n * model.nu()], Truth::default());
        let mut simulation = Self {
            model,
            options,
            settings,
            engine,
            num_envs: n,
            precision,
            digest: OnceLock::new(),
            compiled,
            randomization,
            actuator_models: None,
            ctrl,
            truth,
        };
        (0..n).for_each(|env| simulation.reset(env));
        Ok(simulation)
    }

    /// The model.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// The settings as they were given.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// The settings in force.
    pub fn settings(&self) -> &StepSettings {
        &self.settings
    }

    /// Time step in force, s: that of the options, or the model's.
    pub fn timestep(&self) -> f64 {
        self.settings.timestep
    }

    /// Residual at which the solver stops, in force, m/s: that of the options, or [`Precision::tolerance`].
    pub fn tolerance(&self) -> f64 {
        self.settings.tolerance
    }

    /// Scalar type of the lanes.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// Number of environments.
    pub fn num_envs(&self) -> usize {
        self.num_envs
    }

    /// Panics when there is no such environment: lanes beyond the last one would answer for it.
    #[track_caller]
    fn assert_env(&self, env: usize) {
        assert!(env < self.num_envs, "env is {env}, must be below {}", self.num_envs);
    }

    fn check_env(&self, env: usize) -> Result<(), Error> {
        if env < self.num_envs { Ok(()) } else { Err(Error::Environment { env, num_envs: self.num_envs }) }
    }

    /// Checks environments to be written to: each once, ascending.
    fn check_envs(&self, envs: &[usize]) -> Result<(), Error> {
        if let Some(pair) = envs.windows(2).find(|pair| pair[0] >= pair[1]) {
            return Err(Error::Order { env: pair[1], before: pair[0] });
        }
        envs.last().map_or(Ok(()), |&env| self.check_env(env))
    }

    /// The batch, if it is in this scalar type: for those who measure its steps.
    #[doc(hidden)]
    pub fn batch_mut<S: Stepped>(&mut self) -> Option<&mut Batch<S>> {
        (self.engine_mut() as &mut dyn Any).downcast_mut()
    }

    /// The engine, to be changed: what sensors read may be something else then.
    fn engine_mut(&mut self) -> &mut dyn Engine {
        self.truth.known = false;
        &mut *self.engine
    }

    /// Puts one environment back to the model's reset state, with controls of zero; nothing of the old episode remains.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn reset(&mut self, env: usize) {
        self.assert_env(env);
        let model = self.model.clone();
        let engine = self.engine_mut();
        engine.write(Field::Qpos, env, &model.qpos0);
        engine.write(Field::Qvel, env, &vec![0.0; model.nv()]);
        engine.write(Field::Act, env, &vec![0.0; model.na()]);
        engine.set_time(env, 0.0);
        engine.forget(env);
        engine.begin(env, None);
        self.ctrl_mut(env).fill(0.0);
    }

    /// Sets one environment, which was reset, to a keyframe of the model: state, time and controls in force.
    ///
    /// # Errors
    /// As [`Simulation::check`] and [`Simulation::set_time`], and [`Error::Length`] for the controls; nothing is changed then.
    pub fn start_from(&mut self, env: usize, keyframe: &Keyframe) -> Result<(), Error> {
        let fields = [(Field::Qpos, &keyframe.qpos), (Field::Qvel, &keyframe.qvel), (Field::Act, &keyframe.act)];
        fields.iter().try_for_each(|(field, values)| self.check(*field, env, values).map(|_| ()))?;
        if keyframe.ctrl.len() != self.model.nu() {
            let (found, must) = (keyframe.ctrl.len(), self.model.nu());
            return Err(Error::Length { name: "ctrl", found, must, detail: String::new() });
        }
        self.set_time(env, keyframe.time)?;
        for (field, values) in fields {
            self.set(field, env, values)?;
        }
        self.ctrl_mut(env).copy_from_slice(&keyframe.ctrl);
        self.engine_mut().hold(env, &keyframe.ctrl);
        Ok(())
    }

    /// Sets a field of one environment. What is remembered of the steps before is forgotten, so that what follows depends on the new state alone:
    /// impulses that the solver starts from, contacts, and the memory of sensors and drive trains.
    ///
    /// # Errors
    /// As [`Simulation::check`]; nothing is changed then.
    pub fn set(&mut self, field: Field, env: usize, values: &[f64]) -> Result<(), Error> {
        let values = self.check(field, env, values)?;
        let engine = self.engine_mut();
        engine.write(field, env, &values);
        engine.forget(env);
        Ok(())
    }

    /// Corrects a field of one environment, which goes on: what is remembered of the steps before stays, as an observer wants it that corrects the state
    /// of a plant.
    ///
    /// # Errors
    /// As [`Simulation::check`]; nothing is changed then.
    pub fn correct(&mut self, field: Field, env: usize, values: &[f64]) -> Result<(), Error> {
        let values = self.check(field, env, values)?;
        let engine = self.engine_mut();
        engine.write(field, env, &values);
        engine.refresh(env);
        Ok(())
    }

    /// Controls in force, (num_envs, nu): those of the last step, of the keyframe that was started from, or zero after a reset.
    pub fn ctrl(&self) -> &[f64] {
        &self.ctrl
    }

    fn ctrl_mut(&mut self, env: usize) -> &mut [f64] {
        let nu = self.model.nu();
        &mut self.ctrl[env * nu..(env + 1) * nu]
    }

    /// Takes controls for the steps to come, until others are given: a row for each environment, or one for all.
    ///
    /// # Errors
    /// [`Error::Length`] when there are more or fewer numbers.
    pub fn hold(&mut self, rows: &[f64]) -> Result<(), Error> {
        let nu = self.model.nu();
        if rows.len() == self.ctrl.len() {
            self.ctrl.copy_from_slice(rows);
        } else if rows.len() == nu {
            self.ctrl.chunks_exact_mut(nu).for_each(|row| row.copy_from_slice(rows));
        } else {
            self.check_each_input(&StepInputs { ctrl: rows, ..StepInputs::default() }, 1)?;
        }
        Ok(())
    }

    /// What [`Simulation::set`] would write: `values` with unit quaternions.
    ///
    /// # Errors
    /// [`Error::Environment`] when there is no such environment, [`Error::Length`], [`Error::NotFinite`], [`Error::TooLarge`], and
    /// [`Error::Quaternion`] for a quaternion of zeros, with its joint.
    pub fn check(&self, field: Field, env: usize, values: &[f64]) -> Result<Vec<f64>, Error> {
        self.check_env(env)?;
        self.check_length(field, values.len())?;
        let name = field.name();
        if let Some(i) = values.iter().position(|x| !x.is_finite()) {
            return Err(Error::NotFinite { place: format!("{name}[{i}]"), env, value: values[i] });
        }
        let beyond = |x: &f64| self.precision == Precision::F32 && !(*x as f32).is_finite();
        if let Some(i) = values.iter().position(beyond) {
            return Err(Error::TooLarge { place: format!("{name}[{i}]"), env, value: values[i] });
        }
        let mut values = values.to_vec();
        if field == Field::Qpos {
            self.normalize_quaternions(env, &mut values)?;
        }
        Ok(values)
    }

    fn check_length(&self, field: Field, found: usize) -> Result<(), Error> {
        let must = self.numbers(field);
        if found == must { Ok(()) } else { Err(Error::Length { name: field.name(), found, must, detail: String::new() }) }
    }

    /// Numbers per environment of a field of the state.
    fn numbers(&self, field: Field) -> usize {
        match field {
            Field::Qpos => self.model.nq(),
            Field::Qvel => self.model.nv(),
            Field::Act => self.model.na(),
        }
    }

    fn normalize_quaternions(&self, env: usize, q: &mut [f64]) -> Result<(), Error> {
        use crate::model::JointKind;
        for (j, (joint, (at, _))) in self.model.joints.iter().zip(self.model.joint_addresses()).enumerate() {
            let at = match joint.kind {
                JointKind::Free => at + 3,
                JointKind::Ball => at,
                _ => continue,
            };
            let norm = q[at..at + 4].iter().map(|x| x * x).sum::<f64>().sqrt();
            if norm < 1e-10 || !norm.is_finite() {
                let found = q[at..at + 4].try_into().expect("four numbers");
                return Err(Error::Quaternion { env, joint: self.model.joint_label(j), address: at, found, norm });
            }
            // A quaternion that is already of unit length to rounding keeps its bits.
            if (norm - 1.0).abs() > 1e-15 {
                q[at..at + 4].iter_mut().for_each(|x| *x /= norm);
            }
        }
        Ok(())
    }

    /// Sets the time of one environment, s.
    ///
    /// # Errors
    /// [`Error::Environment`] when there is no such environment, [`Error::NotFinite`] for such a time.
    pub fn set_time(&mut self, env: usize, time: f64) -> Result<(), Error> {
        self.check_env(env)?;
        if !time.is_finite() {
            return Err(Error::NotFinite { place: "time".into(), env, value: time });
        }
        self.engine_mut().set_time(env, time);
        Ok(())
    }

    /// Makes `nstep` steps in every environment. Slices are environment-major, empty ones say nothing: without controls those in force stay.
    ///
    /// # Errors
    /// [`Error::Length`] when a slice has the wrong length, [`Error::MocapPoses`] for half of the poses of mocap bodies, [`Error::Threads`] when
    /// threads cannot be started.
    pub fn step(&mut self, inputs: &StepInputs<'_>, nstep: usize) -> Result<(), Error> {
        self.make_steps(inputs, nstep, None).map(|_| ())
    }

    /// The same for as long as `watch`, which is asked now and then on the thread that calls, says true. Returns how many steps were made,
    /// in every environment the same number: what is left is what [`Simulation::step`] leaves of so many steps, but that mocap bodies are
    /// where the longer way has brought them.
    ///
    /// # Errors
    /// Those of [`Simulation::step`].
    pub fn step_watched(&mut self, inputs: &StepInputs<'_>, nstep: usize, watch: &mut dyn FnMut() -> bool) -> Result<usize, Error> {
        self.make_steps(inputs, nstep, Some(watch))
    }

    fn make_steps(&mut self, inputs: &StepInputs<'_>, nstep: usize, watch: Watch<'_>) -> Result<usize, Error> {
        self.check_inputs(inputs, 1)?;
        // Controls that no step is made with were never in force.
        if nstep > 0 && !inputs.ctrl.is_empty() {
            self.hold(inputs.ctrl)?;
        }
        self.truth.known = false;
        self.engine.step(&self.settings, &StepInputs { ctrl: &self.ctrl, ..*inputs }, nstep, watch).map_err(Error::Threads)
    }

    /// Makes `nstep` steps with each of `calls` controls, (calls, num_envs, nu) or (calls, nu), and writes down what follows each: the same
    /// bits as that many calls of [`Simulation::step`], in one. Flags are kept over all steps.
    ///
    /// # Errors
    /// Those of [`Simulation::step`], and [`Error::ArrayPrecision`] for an array of the recording in the wrong precision.
    pub fn rollout(&mut self, inputs: &StepInputs<'_>, calls: usize, nstep: usize, recording: Recording<'_>) -> Result<(), Error> {
        self.roll(inputs, [calls, nstep], recording, None).map(|_| ())
    }

    /// The same for as long as `watch` says true, see [`Simulation::step_watched`]. Returns how many steps were made, over all controls. What
    /// follows controls without any is not written; of a control that only a part of the steps was made with, what followed those.
    ///
    /// # Errors
    /// Those of [`Simulation::rollout`].
    pub fn rollout_watched(
        &mut self,
        inputs: &StepInputs<'_>,
        calls: [usize; 2],
        recording: Recording<'_>,
        watch: &mut dyn FnMut() -> bool,
    ) -> Result<usize, Error> {
        self.roll(inputs, calls, recording, Some(watch))
    }

    fn roll(&mut self, inputs: &StepInputs<'_>, calls: [usize; 2], recording: Recording<'_>, watch: Watch<'_>) -> Result<usize, Error> {
        self.check_inputs(inputs, calls[0])?;
        self.check_recording(&recording, calls[0])?;
        self.truth.known = false;
        if inputs.ctrl.is_empty() {
            let held = self.ctrl.repeat(calls[0]);
            let inputs = StepInputs { ctrl: &held, ..*inputs };
            return self.engine.rollout(&self.settings, &inputs, calls, recording, watch).map_err(Error::Threads);
        }
        let steps = self.engine.rollout(&self.settings, inputs, calls, recording, watch).map_err(Error::Threads)?;
        if let Some(last) = steps.checked_sub(1) {
            let row = inputs.ctrl.len() / calls[0];
            self.hold(&inputs.ctrl[last / calls[1] * row..][..row])?;
        }
        Ok(steps)
    }

    fn check_inputs(&self, inputs: &StepInputs<'_>, calls: usize) -> Result<(), Error> {
        // A single environment asks this at every step.
        let fits = inputs.ctrl.is_empty() || inputs.ctrl.len() == calls * self.ctrl.len();
        if fits && applied(inputs).iter().all(|given| given.is_empty()) {
            return Ok(());
        }
        self.check_each_input(inputs, calls)
    }

    #[cold]
    fn check_each_input(&self, inputs: &StepInputs<'_>, calls: usize) -> Result<(), Error> {
        self.check_rows(inputs, calls, self.num_envs)
    }

    /// Checks the lengths of inputs of `n` environments.
    fn check_rows(&self, inputs: &StepInputs<'_>, calls: usize, n: usize) -> Result<(), Error> {
        let (nv, nu, nbody) = (self.model.nv(), self.model.nu(), self.model.bodies.len());
        let poses = !(inputs.mocap_pos.is_empty() && inputs.mocap_quat.is_empty());
        let nmocap = if poses { self.model.bodies.iter().filter(|b| b.mocap).count() } else { 0 };
        let check = |name: &'static str, given: &[f64], calls: usize, row: usize, shared: bool| {
            let fits = given.is_empty() || given.len() == calls * n * row || (shared && given.len() == calls * row);
            let times = if calls == 1 { String::new() } else { format!("{calls} controls x ") };
            let must = calls * n * row;
            let detail = || format!(" ({times}{n} environments x {row})");
            if fits { Ok(()) } else { Err(Error::Length { name, found: given.len(), must, detail: detail() }) }
        };
        check("ctrl", inputs.ctrl, calls, nu, true)?;
        check("qfrc_applied", inputs.qfrc, 1, nv, false)?;
        check("xfrc_applied", inputs.xfrc, 1, 6 * nbody, false)?;
        check("mocap_pos", inputs.mocap_pos, 1, 3 * nmocap, false)?;
        check("mocap_quat", inputs.mocap_quat, 1, 4 * nmocap, false)?;
        if inputs.mocap_pos.is_empty() != inputs.mocap_quat.is_empty() {
            return Err(Error::MocapPoses);
        }
        Ok(())
    }

    fn check_recording(&self, recording: &Recording<'_>, calls: usize) -> Result<(), Error> {
        let rows = calls * self.num_envs;
        let check = |name: &'static str, found: usize, must: usize| {
            if found == must { Ok(()) } else { Err(Error::Length { name, found, must, detail: String::new() }) }
        };
        check("status", recording.status.len(), rows)?;
        check("residual", recording.residual.len(), rows)?;
        for (quantity, numbers) in &recording.quantities {
            check(quantity.name(), numbers.len(), rows * self.width(*quantity))?;
            if numbers.precision() != self.precision {
                return Err(Error::ArrayPrecision { name: quantity.name(), found: numbers.precision(), must: self.precision });
            }
        }
        Ok(())
    }

    /// Numbers per environment of what a rollout can write down.
    pub fn width(&self, quantity: Quantity) -> usize {
        match quantity {
            Quantity::Qpos => self.model.nq(),
            Quantity::Qvel => self.model.nv(),
            Quantity::Act => self.model.na(),
            Quantity::Observation => self.model.nsensordata(),
        }
    }

    /// Gives the sensors transfer functions, one entry for every sensor, `None` for ideal ones.
    ///
    /// # Errors
    /// [`Error::Count`] when there is not one for every sensor, [`Error::Sensor`] for a number out of its range, with the sensor's name;
    /// [`Error::Memory`] when there is no room for what the sensors of all environments remember.
    pub fn set_sensor_models(&mut self, transfers: &[Option<Transfer>]) -> Result<(), Error> {
        let (found, must) = (transfers.len(), self.model.sensors.len());
        if found != must {
            return Err(Error::Count { name: "transfers", found, must, element: "sensor" });
        }
        self.truth.known = false;
        self.engine.set_sensor_models(&self.model, &self.settings, transfers)
    }

    /// Gives the actuators drive trains, one entry for every actuator, `None` to those without. All environments are reset.
    ///
    /// # Errors
    /// [`Error::Count`] when there is not one for every actuator; [`Error::DrivesAfterParameters`] when environments have parameters of their own;
    /// [`Error::Actuator`] for a number out of its range, or what an actuator cannot have, with the actuator's name; [`Error::Memory`] when there
    /// is no room for what the actuators of all environments remember.
    pub fn set_actuator_models(&mut self, specs: &[Option<ActuatorSpec>]) -> Result<(), Error> {
        let (found, must) = (specs.len(), self.model.nu());
        if found != must {
            return Err(Error::Count { name: "drives", found, must, element: "actuator" });
        }
        if !self.randomization.is_empty() {
            return Err(Error::DrivesAfterParameters);
        }
        let actuator_models = ActuatorModels::new(&self.model, specs, self.num_envs, self.settings.timestep).map_err(Error::Actuator)?;
        self.engine.set_actuator_models(&actuator_models.model, &self.settings, &actuator_models.specs)?;
        (self.compiled, self.actuator_models) = (OnceLock::new(), Some(actuator_models));
        (0..self.num_envs).for_each(|env| self.reset(env));
        Ok(())
    }

    /// Says as which environment one draws random numbers: its place in the batch unless told otherwise.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn set_stream(&mut self, env: usize, stream: u32) {
        self.assert_env(env);
        self.engine_mut().set_stream(env, stream);
    }

    /// Begins a new episode of one environment as far as random numbers are concerned: the next under its seed, or the first under a new one.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn begin(&mut self, env: usize, seed: Option<u64>) {
        self.assert_env(env);
        self.engine_mut().begin(env, seed);
    }

    /// Readings of all sensors of all environments, (num_envs, nsensordata): those of ideal ones, or those of the last step after the
    /// transfer functions, which are the same however often they are read.
    ///
    /// Of the inputs, controls are not read: they are those in force.
    ///
    /// # Errors
    /// Those of [`Simulation::step`], and [`Error::Length`] for `out`.
    pub fn sense(&mut self, inputs: &StepInputs<'_>, truth: bool, out: &mut [f64]) -> Result<(), Error> {
        self.check_inputs(inputs, 1)?;
        let must = self.num_envs * self.model.nsensordata();
        if out.len() != must {
            return Err(Error::Length { name: "out", found: out.len(), must, detail: String::new() });
        }
        if !truth {
            return self.engine.sense(&self.settings, inputs, false, out).map_err(Error::Threads);
        }
        let same = self.truth.known && self.truth.applied.iter().zip(applied(inputs)).all(|(then, now)| then == now);
        if !same {
            self.truth.readings.resize(must, 0.0);
            self.engine.sense(&self.settings, inputs, true, &mut self.truth.readings).map_err(Error::Threads)?;
            for (then, now) in self.truth.applied.iter_mut().zip(applied(inputs)) {
                then.clear();
                then.extend_from_slice(now);
            }
            self.truth.known = true;
        }
        out.copy_from_slice(&self.truth.readings);
        Ok(())
    }

    /// The model as the step reads it, in f64.
    pub fn compiled(&self) -> &LaneModel<f64> {
        self.compiled.get_or_init(|| {
            LaneModel::new(&match &self.actuator_models {
                Some(actuator_models) => CompiledModel::with_actuator_specs(&actuator_models.model, &actuator_models.specs),
                None => CompiledModel::new(&self.model),
            })
        })
    }

    /// Poses of the mocap bodies of one environment, the model's where `pos` is empty.
    fn mocap_poses<'a>(&'a self, pos: &'a [f64], quat: &'a [f64]) -> impl Iterator<Item = ([f64; 3], [f64; 4])> + 'a {
        let (pos, quat) = (pos.as_chunks::<3>().0, quat.as_chunks::<4>().0);
        self.compiled().mocap.iter().enumerate().map(|(k, m)| if pos.is_empty() { (m.pos, m.quat) } else { (pos[k], quat[k]) })
    }

    /// Memory of the state of all environments and of readings that are kept, bytes.
    pub fn bytes(&self) -> usize {
        let Truth { readings, applied, .. } = &self.truth;
        let kept = readings.len() + applied.iter().map(Vec::len).sum::<usize>();
        self.engine.bytes() + kept * size_of::<f64>()
    }

    /// Threads that step: never more than there are groups of lanes to step.
    pub fn threads(&self) -> usize {
        self.engine.threads()
    }

    /// The room of a thread, as the first step makes it for every thread; to be measured.
    pub fn worker(&self) -> Box<dyn Any + Send> {
        self.engine.worker(&self.settings)
    }

    /// All that survives a step, of all environments, the controls in force included. What the user applies is no part of it.
    pub fn save_state(&self) -> SavedState {
        self.saved(self.engine.save(None, &self.ctrl))
    }

    /// The same of one environment, as a simulation of that one would save it.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn save_state_of(&self, env: usize) -> SavedState {
        self.assert_env(env);
        let nu = self.model.nu();
        self.saved(self.engine.save(Some(env), &self.ctrl[env * nu..(env + 1) * nu]))
    }

    fn saved(&self, payload: Vec<u8>) -> SavedState {
        SavedState::new(self.digest(), self.precision, payload)
    }

    /// The digest of the model, which takes a while of meshes.
    fn digest(&self) -> [u8; 32] {
        *self.digest.get_or_init(|| self.model.digest())
    }

    /// Takes over what [`Simulation::save_state`] saved, in all environments: from a state of as many, or the same in all from a state of one.
    /// Continuing from it repeats the same bits.
    ///
    /// # Errors
    /// [`Error::OtherModel`] for a state of another model, [`Error::StatePrecision`] for one of the other precision, [`Error::StateMisfit`] for one
    /// of another number of environments, of other sensors or drives, or with damaged contents. Nothing is changed then.
    pub fn restore_state(&mut self, state: &SavedState) -> Result<(), Error> {
        self.restore_state_in(state, &(0..self.num_envs).collect::<Vec<_>>())
    }

    /// The same in the environments `envs`, ascending. Where the state of one environment is given to several, each goes on to draw random
    /// numbers of its own.
    ///
    /// # Errors
    /// As [`Simulation::restore_state`], and [`Error::Environment`] or [`Error::Order`] for `envs`.
    pub fn restore_state_in(&mut self, state: &SavedState, envs: &[usize]) -> Result<(), Error> {
        self.check_envs(envs)?;
        if state.model() != self.digest() {
            return Err(Error::OtherModel { state: state.model(), model: self.digest(), name: self.model.name.clone() });
        }
        if state.precision() != self.precision {
            return Err(Error::StatePrecision { found: state.precision(), must: self.precision });
        }
        let ctrl = self.engine_mut().restore(state.payload(), envs).map_err(Error::StateMisfit)?;
        let nu = self.model.nu();
        for &env in envs {
            let from = if ctrl.len() == nu { 0 } else { env };
            self.ctrl_mut(env).copy_from_slice(&ctrl[from * nu..(from + 1) * nu]);
        }
        Ok(())
    }
}
