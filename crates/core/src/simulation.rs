//! A simulation: a model, its settings and a batch of environments. What the bindings translate.

mod parameters;

use std::any::Any;
use std::sync::{Arc, OnceLock};

use stepper_real::Level;
use thiserror::Error;

use crate::actuation::{DriveTrain, Driven};
use crate::batch::{self, Batch, Engine, Field, StepInputs};
use crate::model::{Model, ModelError};
use crate::options::Options;
use crate::plan::{LanePlan, Plan};
use crate::query::Snapshot;
use crate::rollout::{Precision, Quantity, Recording};
use crate::sensing::errors::Transfer;
use crate::state::StoredContact;
use crate::step::Inputs;
use crate::theta::Theta;

/// A call that cannot be carried out.
#[derive(Clone, Debug, Error)]
pub enum Error {
    /// A value out of its range or an array of the wrong shape.
    #[error("{0}")]
    Value(String),
    /// More environments than there is memory for.
    #[error("{0}")]
    Memory(String),
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
    plan: OnceLock<LanePlan<f64>>,
    theta: Theta,
    driven: Option<Driven>,
}

impl Simulation {
    /// `num_envs` environments at the model's reset state; `None` is a single one. `threads` 0 means all that this process may use.
    ///
    /// # Errors
    /// [`Error::Value`] when an option is out of range, or when the CPU level asked for by `STEPPER_CPU_LEVEL` is not there;
    /// [`Error::Memory`] when there is no room for so many environments.
    pub fn new(model: Arc<Model>, options: Options, num_envs: Option<usize>, precision: Precision, threads: usize) -> Result<Self, Error> {
        options.check().map_err(Error::Value)?;
        if num_envs == Some(0) {
            return Err(Error::Value("num_envs is 0, must be 1 or more, or None for a single environment".into()));
        }
        let level = Level::best().map_err(|e| Error::Value(e.to_string()))?;
        if let Some(n) = num_envs.filter(|&n| n > 1) {
            let each = match precision {
                Precision::F64 => batch::bytes_per_env::<f64>(&model, &options),
                Precision::F32 => batch::bytes_per_env::<f32>(&model, &options),
            };
            // Asked for at once and given back: an allocation that fails piece by piece would end the process.
            if n.checked_mul(each).is_none_or(|all| Vec::<u8>::new().try_reserve_exact(all).is_err()) {
                return Err(Error::Memory(format!(
                    "{n} environments of {each} bytes each are more than the memory here; make num_envs smaller"
                )));
            }
        }
        let mut simulation = Self::at_level(model, options, num_envs, precision, threads, level);
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
        let n = num_envs.unwrap_or(1);
        let single = n == 1;
        let engine: Box<dyn Engine> = match precision {
            Precision::F64 => Box::new(Batch::<f64>::new(&model, &options, n, single, threads, level)),
            Precision::F32 => Box::new(Batch::<f32>::new(&model, &options, n, single, threads, level)),
        };
        let mut simulation =
            Self { model, options, engine, num_envs: n, precision, plan: OnceLock::new(), theta: Theta::default(), driven: None };
        (0..n).for_each(|env| simulation.reset(env));
        simulation
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

    /// Puts one environment back to the model's reset state; nothing of the old episode remains.
    pub fn reset(&mut self, env: usize) {
        self.engine.write(Field::Qpos, env, &self.model.qpos0.clone());
        self.engine.write(Field::Qvel, env, &vec![0.0; self.model.nv()]);
        self.engine.write(Field::Act, env, &vec![0.0; self.model.na()]);
        self.engine.set_time(env, 0.0);
        self.engine.forget(env);
        self.engine.begin(env, None);
    }

    /// Sets a field of one environment. Warm starts are forgotten, so that what follows depends on the new state alone.
    ///
    /// # Errors
    /// As [`Simulation::check`]; nothing is changed then.
    pub fn set(&mut self, field: Field, env: usize, values: &[f64]) -> Result<(), Error> {
        let values = self.check(field, env, values)?;
        self.engine.write(field, env, &values);
        self.engine.forget(env);
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
        self.engine.set_time(env, time);
    }

    /// Makes `nstep` steps in every environment. Slices are environment-major, empty ones say nothing.
    ///
    /// # Errors
    /// [`Error::Value`] when a slice has the wrong length.
    pub fn step(&mut self, inputs: &StepInputs<'_>, nstep: usize) -> Result<(), Error> {
        self.check_inputs(inputs, 1)?;
        self.engine.step(&self.options, inputs, nstep);
        Ok(())
    }

    /// Makes `nstep` steps with each of `calls` controls, (calls, num_envs, nu) or (calls, nu), and writes down what follows each: the same
    /// bits as that many calls of [`Simulation::step`], in one. Flags are kept over all steps.
    ///
    /// # Errors
    /// [`Error::Value`] when a slice has the wrong length, or an array of the recording the wrong precision.
    pub fn rollout(&mut self, inputs: &StepInputs<'_>, calls: usize, nstep: usize, recording: Recording<'_>) -> Result<(), Error> {
        self.check_inputs(inputs, calls)?;
        self.check_recording(&recording, calls)?;
        self.engine.rollout(&self.options, inputs, calls, nstep, recording);
        Ok(())
    }

    fn check_inputs(&self, inputs: &StepInputs<'_>, calls: usize) -> Result<(), Error> {
        // A single environment asks this at every step.
        let others = [inputs.qfrc, inputs.xfrc, inputs.mocap_pos, inputs.mocap_quat];
        if inputs.ctrl.len() == calls * self.num_envs * self.model.nu() && others.iter().all(|given| given.is_empty()) {
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
        self.engine.set_stream(env, stream);
    }

    /// Begins a new episode of one environment as far as random numbers are concerned: the next under its seed, or the first under a new one.
    pub fn begin(&mut self, env: usize, seed: Option<u64>) {
        self.engine.begin(env, seed);
    }

    /// Readings of all sensors of all environments, (num_envs, nsensordata): those of ideal ones, or those of the last step after the
    /// transfer functions, which are the same however often they are read.
    ///
    /// Of the inputs, controls are not read: they are those of the last step, or zero after a reset.
    ///
    /// # Errors
    /// [`Error::Value`] when a slice has the wrong length.
    pub fn sense(&mut self, inputs: &StepInputs<'_>, truth: bool, out: &mut [f64]) -> Result<(), Error> {
        self.check_inputs(inputs, 1)?;
        let must = self.num_envs * self.model.nsensordata();
        if out.len() != must {
            return Err(Error::Value(format!("out has {} numbers, must have {must}", out.len())));
        }
        self.engine.sense(&self.options, inputs, truth, out);
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
        let three = |x: &[f64], k: usize| [x[3 * k], x[3 * k + 1], x[3 * k + 2]];
        let four = |x: &[f64], k: usize| [x[4 * k], x[4 * k + 1], x[4 * k + 2], x[4 * k + 3]];
        let posed = !inputs.mocap_pos.is_empty();
        let pose = |(k, m): (usize, &crate::plan::MocapPlan<f64>)| match posed {
            true => (three(inputs.mocap_pos, k), four(inputs.mocap_quat, k)),
            false => (m.pos, m.quat),
        };
        let given = || if inputs.ctrl.is_empty() { vec![0.0; plan.actuators.len()] } else { inputs.ctrl.to_vec() };
        let (ctrl, trains) = self.engine.handed_on(env).unwrap_or_else(|| (given(), vec![]));
        Snapshot {
            q: read(Field::Qpos, plan.nq),
            v: read(Field::Qvel, plan.nv),
            act: read(Field::Act, plan.na),
            inputs: Inputs { ctrl, trains, qfrc: inputs.qfrc.to_vec(), xfrc: inputs.xfrc.to_vec() },
            mocap: plan.mocap.iter().enumerate().map(pose).collect(),
        }
    }

    /// Memory of the state of all environments, bytes.
    pub fn bytes(&self) -> usize {
        self.engine.bytes()
    }

    /// Threads that step: never more than there are groups of lanes to step.
    pub fn threads(&self) -> usize {
        self.engine.threads()
    }

    /// The room of a thread, as the first step makes it for every thread; to be measured.
    pub fn worker(&self) -> Box<dyn Any + Send> {
        self.engine.worker(&self.options)
    }

    /// All that survives a step, of all environments.
    pub fn save_state(&self) -> Vec<u8> {
        self.engine.save()
    }

    /// Takes over what [`Simulation::save_state`] wrote; continuing from it repeats the same bits.
    ///
    /// # Errors
    /// [`Error::Value`] when the state does not fit this simulation.
    pub fn restore_state(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.engine.restore(bytes).map_err(|e| Error::Value(format!("this state does not fit: {e}")))
    }
}
