//! A simulation: a model, its settings and a batch of environments. What the bindings translate.

mod parameters;

use std::any::Any;
use std::sync::{Arc, OnceLock};

use serde::{Serialize, de::DeserializeOwned};
use stepper_real::Level;
use thiserror::Error;

use crate::actuation::{DriveTrain, Driven};
use crate::batch::{Batch, Compiled, Engine, Field, StepInputs, Watch};
use crate::model::{Keyframe, Model, ModelError};
use crate::options::Options;
use crate::plan::{LanePlan, Plan};
use crate::query::{BodyPoses, Snapshot};
use crate::rollout::{Precision, Quantity, Recording};
use crate::saved::SavedState;
use crate::sensing::errors::Transfer;
use crate::state::StoredContact;
use crate::step::Inputs;
use crate::theta::Theta;
use crate::worker::Stepped;

/// A call that cannot be carried out.
#[derive(Clone, Debug, Error)]
pub enum Error {
    /// A value out of its range or an array of the wrong shape.
    #[error("{0}")]
    Value(String),
    /// More environments than there is memory for.
    #[error("{0}")]
    Memory(String),
    /// Threads that the system refuses to start.
    #[error("{0}")]
    Threads(String),
    /// The model.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Environments of one model.
pub struct Simulation {
    model: Arc<Model>,
    options: Options,
    engine: Box<dyn Engine>,
    num_envs: usize,
    precision: Precision,
    digest: OnceLock<[u8; 32]>,
    plan: OnceLock<LanePlan<f64>>,
    theta: Theta,
    driven: Option<Driven>,
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
    options: &Options,
    num_envs: usize,
    threads: usize,
    level: Level,
    check: bool,
) -> Result<Box<dyn Engine>, Error> {
    let compiled = Compiled::<S>::new(model, options, level);
    let each = compiled.bytes_per_env();
    // Asked for at once and given back: an allocation that fails piece by piece would end the process.
    let fails = |all: usize| Vec::<u8>::new().try_reserve_exact(all).is_err();
    if check && num_envs > 1 && num_envs.checked_mul(each).is_none_or(fails) {
        return Err(Error::Memory(format!(
            "{num_envs} environments of {each} bytes each are more than the memory here; make num_envs smaller"
        )));
    }
    Ok(Box::new(Batch::new(model, compiled, num_envs, num_envs == 1, threads, level)))
}

impl Simulation {
    /// `num_envs` environments at the model's reset state; `None` is a single one. `threads` 0 means all that this process may use.
    ///
    /// # Errors
    /// [`Error::Value`] when an option is out of range, or when the CPU level asked for by `STEPPER_CPU_LEVEL` is not there;
    /// [`Error::Memory`] when there is no room for so many environments; [`Error::Model`] for a number that 32 bits cannot hold, in that precision.
    pub fn new(model: Arc<Model>, options: Options, num_envs: Option<usize>, precision: Precision, threads: usize) -> Result<Self, Error> {
        options.check().map_err(Error::Value)?;
        if num_envs == Some(0) {
            return Err(Error::Value("num_envs is 0, must be 1 or more, or None for a single environment".into()));
        }
        if precision == Precision::F32 {
            model.check_range(f64::from(f32::MAX))?;
        }
        let level = Level::best().map_err(|e| Error::Value(e.to_string()))?;
        let mut simulation = Self::make(model, options, num_envs, precision, threads, level, true)?;
        if simulation.model.actuators.iter().any(|a| a.delay > 0.0) {
            let trains = vec![None; simulation.model.nu()];
            simulation.couple(&trains)?;
        }
        Ok(simulation)
    }

    /// As [`Simulation::new`] on a CPU level that this machine has, whatever the environment variable says; options are taken as they are.
    pub fn at_level(
        model: Arc<Model>,
        options: Options,
        num_envs: Option<usize>,
        precision: Precision,
        threads: usize,
        level: Level,
    ) -> Self {
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
        let engine = match precision {
            Precision::F64 => engine::<f64>(&model, &options, n, threads, level, check)?,
            Precision::F32 => engine::<f32>(&model, &options, n, threads, level, check)?,
        };
        let (plan, theta, ctrl, truth) = (OnceLock::new(), Theta::default(), vec![0.0; n * model.nu()], Truth::default());
        let mut simulation =
            Self { model, options, engine, num_envs: n, precision, digest: OnceLock::new(), plan, theta, driven: None, ctrl, truth };
        (0..n).for_each(|env| simulation.reset(env));
        Ok(simulation)
    }

    /// The model.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// The settings.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Number of environments.
    pub fn num_envs(&self) -> usize {
        self.num_envs
    }

    /// The engine, to be changed: what sensors read may be something else then.
    fn engine_mut(&mut self) -> &mut dyn Engine {
        self.truth.known = false;
        &mut *self.engine
    }

    /// Puts one environment back to the model's reset state, with controls of zero; nothing of the old episode remains.
    pub fn reset(&mut self, env: usize) {
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
    /// As [`Simulation::check`].
    pub fn start_from(&mut self, env: usize, keyframe: &Keyframe) -> Result<(), Error> {
        for (field, values) in [(Field::Qpos, &keyframe.qpos), (Field::Qvel, &keyframe.qvel), (Field::Act, &keyframe.act)] {
            self.set(field, env, values)?;
        }
        self.set_time(env, keyframe.time);
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
    /// [`Error::Value`] when there are more or fewer numbers.
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
    /// [`Error::Value`] for a wrong length, a number that is not finite or a quaternion of zeros, named by environment and joint.
    pub fn check(&self, field: Field, env: usize, values: &[f64]) -> Result<Vec<f64>, Error> {
        let (name, n) = match field {
            Field::Qpos => ("qpos", self.model.nq()),
            Field::Qvel => ("qvel", self.model.nv()),
            Field::Act => ("act", self.model.na()),
        };
        if values.len() != n {
            return Err(Error::Value(format!("{name} has shape ({},), must be ({n},)", values.len())));
        }
        if let Some(i) = values.iter().position(|x| !x.is_finite()) {
            return Err(Error::Value(format!("{name}[{i}] of environment {env} is {}, must be finite", values[i])));
        }
        let beyond = |x: &f64| self.precision == Precision::F32 && !(*x as f32).is_finite();
        if let Some(i) = values.iter().position(beyond) {
            let (x, most) = (values[i], f32::MAX);
            return Err(Error::Value(format!("{name}[{i}] of environment {env} is {x:e}, must be at most {most:e} in 32 bits")));
        }
        let mut values = values.to_vec();
        if field == Field::Qpos {
            self.normalize_quaternions(env, &mut values)?;
        }
        Ok(values)
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
                let (name, found) = (self.model.joint_label(j), &q[at..at + 4]);
                return Err(Error::Value(format!(
                    "qpos[{at}..{}] of environment {env}, the orientation of joint \"{name}\", is {found:?}: its length is {norm}, must be above 0; (1, 0, 0, 0) is no rotation",
                    at + 4
                )));
            }
            // A quaternion that is already of unit length to rounding keeps its bits.
            if (norm - 1.0).abs() > 1e-15 {
                q[at..at + 4].iter_mut().for_each(|x| *x /= norm);
            }
        }
        Ok(())
    }

    /// Sets the time of one environment, s.
    pub fn set_time(&mut self, env: usize, time: f64) {
        self.engine_mut().set_time(env, time);
    }

    /// Makes `nstep` steps in every environment. Slices are environment-major, empty ones say nothing: without controls those in force stay.
    ///
    /// # Errors
    /// [`Error::Value`] when a slice has the wrong length, [`Error::Threads`] when threads cannot be started.
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
        self.engine.step(&self.options, &StepInputs { ctrl: &self.ctrl, ..*inputs }, nstep, watch).map_err(Error::Threads)
    }

    /// Makes `nstep` steps with each of `calls` controls, (calls, num_envs, nu) or (calls, nu), and writes down what follows each: the same
    /// bits as that many calls of [`Simulation::step`], in one. Flags are kept over all steps.
    ///
    /// # Errors
    /// [`Error::Value`] when a slice has the wrong length, or an array of the recording the wrong precision.
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
            return self.engine.rollout(&self.options, &inputs, calls, recording, watch).map_err(Error::Threads);
        }
        let steps = self.engine.rollout(&self.options, inputs, calls, recording, watch).map_err(Error::Threads)?;
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
        let n = self.num_envs;
        let (nv, nu, nbody) = (self.model.nv(), self.model.nu(), self.model.bodies.len());
        let poses = !(inputs.mocap_pos.is_empty() && inputs.mocap_quat.is_empty());
        let nmocap = if poses { self.model.bodies.iter().filter(|b| b.mocap).count() } else { 0 };
        let check = |name: &str, given: &[f64], calls: usize, row: usize, shared: bool| {
            let fits = given.is_empty() || given.len() == calls * n * row || (shared && given.len() == calls * row);
            let times = if calls == 1 { String::new() } else { format!("{calls} controls x ") };
            let must = calls * n * row;
            let message =
                || Error::Value(format!("{name} has {} numbers, must have {must} ({times}{n} environments x {row})", given.len()));
            if fits { Ok(()) } else { Err(message()) }
        };
        check("ctrl", inputs.ctrl, calls, nu, true)?;
        check("qfrc_applied", inputs.qfrc, 1, nv, false)?;
        check("xfrc_applied", inputs.xfrc, 1, 6 * nbody, false)?;
        check("mocap_pos", inputs.mocap_pos, 1, 3 * nmocap, false)?;
        check("mocap_quat", inputs.mocap_quat, 1, 4 * nmocap, false)?;
        if inputs.mocap_pos.is_empty() != inputs.mocap_quat.is_empty() {
            return Err(Error::Value("mocap_pos and mocap_quat go together: give both or none".into()));
        }
        Ok(())
    }

    fn check_recording(&self, recording: &Recording<'_>, calls: usize) -> Result<(), Error> {
        let rows = calls * self.num_envs;
        let check = |name: &str, found: usize, must: usize| {
            let message = || Error::Value(format!("the array for {name} has {found} numbers, must have {must}"));
            if found == must { Ok(()) } else { Err(message()) }
        };
        check("status", recording.status.len(), rows)?;
        check("residual", recording.residual.len(), rows)?;
        for (quantity, numbers) in &recording.quantities {
            check(quantity.name(), numbers.len(), rows * self.width(*quantity))?;
            if numbers.precision() != self.precision {
                let message = format!("the array for {} is {:?}, must be {:?}", quantity.name(), numbers.precision(), self.precision);
                return Err(Error::Value(message));
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

    /// A field of one environment.
    pub fn get(&self, field: Field, env: usize, out: &mut [f64]) {
        self.engine.read(field, env, out);
    }

    /// s
    pub fn time(&self, env: usize) -> f64 {
        self.engine.time(env)
    }

    /// Flags of the last call, see [`Status`](crate::Status).
    pub fn status(&self, env: usize) -> u32 {
        self.engine.status(env)
    }

    /// Deepest overlap of a contact beyond its margin in the last call, m. Where a step is taken: in its middle by the rules that are.
    pub fn depth(&self, env: usize) -> f64 {
        self.engine.overlaps(env)[0]
    }

    /// Farthest that a joint or tendon was beyond its range after a step of the last call, rad or m.
    pub fn limit_overshoot(&self, env: usize) -> f64 {
        self.engine.overlaps(env)[1]
    }

    /// Readings that were clipped and samples that were lost in the last call, for every sensor of the model.
    pub fn sensor_faults(&self, env: usize) -> Vec<[u32; 2]> {
        let mut out = vec![[0; 2]; self.model.sensors.len()];
        self.engine.sensor_faults(env, &mut out);
        out
    }

    /// Steps of the last call in which the effort of each actuator was cut to its bounds.
    pub fn actuator_saturation(&self, env: usize) -> Vec<u32> {
        let mut out = vec![0; self.model.nu()];
        self.engine.actuator_saturation(env, &mut out);
        out
    }

    /// (residual in m/s, sweeps and Newton steps together) of the last step.
    pub fn certificate(&self, env: usize) -> (f64, f64) {
        self.engine.certificate(env)
    }

    /// Contacts of the last step with their forces in N: geoms of the model, and the numbers with forces in place of impulses.
    pub fn contacts(&self, env: usize) -> Vec<([usize; 2], StoredContact)> {
        let mut contacts = self.engine.contacts(env);
        for (_, c) in &mut contacts {
            c.impulse.iter_mut().chain(&mut c.torque).for_each(|x| *x /= self.options.timestep);
        }
        contacts
    }

    /// Gives the sensors transfer functions, one entry for every sensor, `None` for ideal ones.
    ///
    /// # Errors
    /// [`Error::Value`] for a number out of its range, with the sensor's name.
    pub fn equip(&mut self, transfers: &[Option<Transfer>]) -> Result<(), Error> {
        let (found, must) = (transfers.len(), self.model.sensors.len());
        if found != must {
            return Err(Error::Value(format!("there are {found} transfers, must be {must}, one for every sensor")));
        }
        self.truth.known = false;
        self.engine.equip(&self.model, &self.options, transfers).map_err(Error::Value)
    }

    /// Gives the actuators drive trains, one entry for every actuator, `None` to those without. All environments are reset.
    ///
    /// # Errors
    /// [`Error::Value`] for a number out of its range, or what an actuator cannot have, with the actuator's name.
    pub fn couple(&mut self, trains: &[Option<DriveTrain>]) -> Result<(), Error> {
        let (found, must) = (trains.len(), self.model.nu());
        if found != must {
            return Err(Error::Value(format!("there are {found} drives, must be {must}, one for every actuator")));
        }
        if !self.theta.is_empty() {
            return Err(Error::Value("environments have parameters of their own: give drives first, or take the parameters back".into()));
        }
        let driven = Driven::new(&self.model, trains, self.num_envs, self.options.timestep).map_err(Error::Value)?;
        self.engine.couple(&driven.model, &self.options, &driven.trains);
        (self.plan, self.driven) = (OnceLock::new(), Some(driven));
        (0..self.num_envs).for_each(|env| self.reset(env));
        Ok(())
    }

    /// Says as which environment one draws random numbers: its place in the batch unless told otherwise.
    pub fn set_stream(&mut self, env: usize, stream: u32) {
        self.engine_mut().set_stream(env, stream);
    }

    /// Begins a new episode of one environment as far as random numbers are concerned: the next under its seed, or the first under a new one.
    pub fn begin(&mut self, env: usize, seed: Option<u64>) {
        self.engine_mut().begin(env, seed);
    }

    /// Readings of all sensors of all environments, (num_envs, nsensordata): those of ideal ones, or those of the last step after the
    /// transfer functions, which are the same however often they are read.
    ///
    /// Of the inputs, controls are not read: they are those in force.
    ///
    /// # Errors
    /// [`Error::Value`] when a slice has the wrong length.
    pub fn sense(&mut self, inputs: &StepInputs<'_>, truth: bool, out: &mut [f64]) -> Result<(), Error> {
        self.check_inputs(inputs, 1)?;
        let must = self.num_envs * self.model.nsensordata();
        if out.len() != must {
            return Err(Error::Value(format!("out has {} numbers, must have {must}", out.len())));
        }
        if !truth {
            return self.engine.sense(&self.options, inputs, false, out).map_err(Error::Threads);
        }
        let same = self.truth.known && self.truth.applied.iter().zip(applied(inputs)).all(|(then, now)| then == now);
        if !same {
            self.truth.readings.resize(must, 0.0);
            self.engine.sense(&self.options, inputs, true, &mut self.truth.readings).map_err(Error::Threads)?;
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
    pub fn plan(&self) -> &LanePlan<f64> {
        self.plan.get_or_init(|| {
            LanePlan::new(&match &self.driven {
                Some(driven) => Plan::with_trains(&driven.model, &driven.trains),
                None => Plan::new(&self.model),
            })
        })
    }

    /// One environment, to ask about its mass matrix, energy and the like; inputs of that environment alone.
    pub fn snapshot(&self, env: usize, inputs: &StepInputs<'_>) -> Snapshot {
        let plan = self.plan();
        let read = |field: Field, n: usize| {
            let mut x = vec![0.0; n];
            self.get(field, env, &mut x);
            x
        };
        let nu = plan.actuators.len();
        let given = || if inputs.ctrl.is_empty() { self.ctrl[env * nu..(env + 1) * nu].to_vec() } else { inputs.ctrl.to_vec() };
        let (ctrl, trains) = self.engine.handed_on(env).unwrap_or_else(|| (given(), vec![]));
        Snapshot {
            q: read(Field::Qpos, plan.nq),
            v: read(Field::Qvel, plan.nv),
            act: read(Field::Act, plan.na),
            inputs: Inputs { ctrl, trains, qfrc: inputs.qfrc.to_vec(), xfrc: inputs.xfrc.to_vec() },
            mocap: self.mocap_poses(inputs.mocap_pos, inputs.mocap_quat).collect(),
        }
    }

    /// Poses of the mocap bodies of one environment, the model's where `pos` is empty.
    fn mocap_poses<'a>(&'a self, pos: &'a [f64], quat: &'a [f64]) -> impl Iterator<Item = ([f64; 3], [f64; 4])> + 'a {
        let (pos, quat) = (pos.as_chunks::<3>().0, quat.as_chunks::<4>().0);
        self.plan().mocap.iter().enumerate().map(|(k, m)| if pos.is_empty() { (m.pos, m.quat) } else { (pos[k], quat[k]) })
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
        self.engine.worker(&self.options)
    }

    /// All that survives a step, of all environments, the controls in force included. What the user applies is no part of it.
    pub fn save_state(&self) -> SavedState {
        self.saved(self.engine.save(None, &self.ctrl))
    }

    /// The same of one environment, as a simulation of that one would save it.
    ///
    /// # Panics
    /// When there is no such environment.
    pub fn save_state_of(&self, env: usize) -> SavedState {
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
    /// [`Error::Value`] when the state does not fit this simulation. Nothing is changed then.
    pub fn restore_state(&mut self, state: &SavedState) -> Result<(), Error> {
        self.restore_state_in(state, &(0..self.num_envs).collect::<Vec<_>>())
    }

    /// The same in the environments `envs`. Where the state of one environment is given to several, each goes on to draw random numbers of
    /// its own.
    ///
    /// # Errors
    /// As [`Simulation::restore_state`].
    pub fn restore_state_in(&mut self, state: &SavedState, envs: &[usize]) -> Result<(), Error> {
        if state.model() != self.digest() {
            let name = |digest: [u8; 32]| digest[..6].iter().map(|b| format!("{b:02x}")).collect::<String>();
            let (found, own, model) = (name(state.model()), name(self.digest()), &self.model.name);
            let message =
                format!("this state belongs to another model, {found}; this one is \"{model}\", {own}: give a state of the same model");
            return Err(Error::Value(message));
        }
        if state.precision() != self.precision {
            let (found, own) = (state.precision(), self.precision);
            return Err(Error::Value(format!("this state does not fit: it has numbers in {found:?}, this stepper in {own:?}")));
        }
        let ctrl = self.engine_mut().restore(state.payload(), envs).map_err(|e| Error::Value(format!("this state does not fit: {e}")))?;
        let nu = self.model.nu();
        for &env in envs {
            let from = if ctrl.len() == nu { 0 } else { env };
            self.ctrl_mut(env).copy_from_slice(&ctrl[from * nu..(from + 1) * nu]);
        }
        Ok(())
    }

    /// Positions (m) and orientations of all bodies at the present configurations: (num_envs, nbody, 3) and (num_envs, nbody, 4).
    ///
    /// # Errors
    /// [`Error::Value`] when a slice of the inputs has the wrong length; of them, poses of mocap bodies are read.
    pub fn body_poses<'a>(&'a self, inputs: &StepInputs<'a>) -> Result<[Vec<f64>; 2], Error> {
        self.check_inputs(inputs, 1)?;
        let plan = self.plan();
        let (mut poses, mut q) = (BodyPoses::new(plan), vec![0.0; plan.nq]);
        let rows = self.num_envs * self.model.bodies.len();
        let (mut positions, mut orientations) = (Vec::with_capacity(3 * rows), Vec::with_capacity(4 * rows));
        let mocap = plan.mocap.len();
        for env in 0..self.num_envs {
            let row = |all: &'a [f64], width: usize| if all.is_empty() { all } else { &all[env * mocap * width..][..mocap * width] };
            self.get(Field::Qpos, env, &mut q);
            for (pos, quat) in poses.at(&q, self.mocap_poses(row(inputs.mocap_pos, 3), row(inputs.mocap_quat, 4))) {
                positions.extend(pos);
                orientations.extend(quat);
            }
        }
        Ok([positions, orientations])
    }
}
