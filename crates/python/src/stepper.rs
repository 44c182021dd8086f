//! `stepper.Stepper`.

use std::sync::Arc;

use numpy::{PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyIndexError, PyMemoryError, PyRuntimeError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyTuple};
use stepper_core::actuation::DriveTrain;
use stepper_core::batch::{Field, StepInputs};
use stepper_core::sensing::errors::Transfer;
use stepper_core::{Error, Precision, Simulation};

use crate::array::{array, check_shape, described, readonly, whole, with_numbers, write_detached};
use crate::contacts::structured;
use crate::model::{Model, to_py};
use crate::options::{settings, unknown};
use crate::state::State;

/// Environments of one model, stepped together.
#[pyclass(module = "stepper._stepper")]
pub(crate) struct Stepper {
    pub(crate) simulation: Simulation,
    pub(crate) model: Py<Model>,
    options: Py<PyAny>,
    batched: bool,
    pub(crate) precision: Precision,
    threads: usize,
    /// Steps of a call, at most, that end before it pays to let other threads of Python run.
    brief: usize,
    seed: u64,
    pub(crate) ctrl: Vec<f64>,
    applied: [Option<Py<PyArrayDyn<f64>>>; 4],
    recorder: Option<Py<PyAny>>,
    sensors: Option<Py<PyAny>>,
    actuators: Option<Py<PyAny>>,
}

/// A whole number as it was given; the common case costs no import.
#[derive(FromPyObject)]
enum Whole<'py> {
    Number(u64),
    Other(Bound<'py, PyAny>),
}

impl Whole<'_> {
    fn from(&self, least: u64, name: &str) -> PyResult<u64> {
        match self {
            Self::Number(number) => Ok(*number),
            Self::Other(given) => whole(given, name, least),
        }
    }
}

/// Index in `applied`, name, and the trailing axes of the arrays that the user writes and every step reads.
#[derive(Clone, Copy)]
enum Applied {
    Qfrc,
    Xfrc,
    MocapPos,
    MocapQuat,
}

pub(crate) fn value_error(error: Error) -> PyErr {
    match error {
        Error::Model(e) => to_py(e),
        Error::Value(message) => PyValueError::new_err(message),
        Error::Memory(message) => PyMemoryError::new_err(message),
    }
}

/// The arrays that the user writes and every step reads, borrowed for a call.
pub(crate) struct Held<'py>([Option<PyReadonlyArrayDyn<'py, f64>>; 4]);

impl Held<'_> {
    /// With controls, what the core reads.
    pub(crate) fn inputs<'a>(&'a self, ctrl: &'a [f64]) -> PyResult<StepInputs<'a>> {
        let slice = |which: Applied| match &self.0[which as usize] {
            Some(array) => array.as_slice().map_err(PyErr::from),
            None => Ok(&[][..]),
        };
        let (qfrc, xfrc) = (slice(Applied::Qfrc)?, slice(Applied::Xfrc)?);
        Ok(StepInputs { ctrl, qfrc, xfrc, mocap_pos: slice(Applied::MocapPos)?, mocap_quat: slice(Applied::MocapQuat)? })
    }
}

impl Stepper {
    fn n(&self) -> usize {
        self.simulation.num_envs()
    }

    /// (num_envs, ...tail), or the tail alone for a single environment.
    pub(crate) fn shape(&self, tail: &[usize]) -> Vec<usize> {
        let lead = self.batched.then(|| self.n());
        lead.into_iter().chain(tail.iter().copied()).collect()
    }

    fn env(&self, env: isize) -> PyResult<usize> {
        let n = self.n() as isize;
        let at = if env < 0 { env + n } else { env };
        if (0..n).contains(&at) { Ok(at as usize) } else { Err(PyIndexError::new_err(format!("env is {env}, must be below {n}"))) }
    }

    fn gather<'py>(&self, py: Python<'py>, width: usize, read: impl Fn(usize, &mut [f64])) -> PyResult<Bound<'py, PyAny>> {
        let mut data = vec![0.0; self.n() * width];
        if width > 0 {
            data.chunks_exact_mut(width).enumerate().for_each(|(env, row)| read(env, row));
        }
        array(py, &self.shape(&[width]), data, self.precision)
    }

    fn per_env<T: numpy::Element>(&self, py: Python<'_>, read: impl Fn(usize) -> T) -> PyResult<Py<PyAny>> {
        let data: Vec<T> = (0..self.n()).map(read).collect();
        let shape = self.shape(&[]);
        let out = numpy::PyArray1::from_vec(py, data).reshape(shape)?;
        // A single environment answers with a scalar, not with an array without axes.
        if self.batched { Ok(out.into_any().unbind()) } else { Ok(out.call_method0("item")?.unbind()) }
    }

    /// Environments named by a mask, all without one.
    fn chosen(&self, mask: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<usize>> {
        let Some(mask) = mask else { return Ok((0..self.n()).collect()) };
        let numpy = mask.py().import("numpy")?;
        let mask = numpy.call_method1("asarray", (mask,))?;
        if mask.getattr("dtype")?.getattr("kind")?.extract::<String>()? != "b" {
            return Err(PyValueError::new_err(format!("mask has dtype {}, must be bool", mask.getattr("dtype")?)));
        }
        let shape: Vec<usize> = mask.getattr("shape")?.extract()?;
        check_shape("mask", &shape, &[&[self.n()]])?;
        let mask: Vec<bool> = mask.call_method0("tolist")?.extract()?;
        Ok((0..self.n()).filter(|&env| mask[env]).collect())
    }

    /// Rows of a (num_envs, width) or (width,) array, one per environment.
    fn rows<'py>(&self, given: &Bound<'py, PyAny>, name: &str, width: usize) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
        let given = readonly(given, name)?;
        self.check_rows(given.shape(), name, width)?;
        Ok(given)
    }

    fn check_rows(&self, found: &[usize], name: &str, width: usize) -> PyResult<()> {
        let full = [self.n(), width];
        // A single environment has no axis of environments.
        check_shape(name, found, &[&full[..], &[width]][usize::from(!self.batched)..])
    }

    /// Rows of `given` for the environments `envs`, checked; none when nothing is given.
    fn checked(&self, field: Field, given: Option<&Bound<'_, PyAny>>, envs: &[usize]) -> PyResult<Vec<Vec<f64>>> {
        let Some(given) = given else { return Ok(Vec::new()) };
        let model = self.simulation.model();
        let (name, width) = match field {
            Field::Qpos => ("qpos", model.nq()),
            Field::Qvel => ("qvel", model.nv()),
            Field::Act => ("act", model.na()),
        };
        let given = self.rows(given, name, width)?;
        let (data, shared) = (given.as_slice()?, given.ndim() == 1);
        let row = |env: usize| if shared { data } else { &data[env * width..(env + 1) * width] };
        envs.iter().map(|&env| self.simulation.check(field, env, row(env)).map_err(value_error)).collect()
    }

    fn write(&mut self, field: Field, rows: &[Vec<f64>], envs: &[usize]) -> PyResult<()> {
        envs.iter().zip(rows).try_for_each(|(&env, row)| self.simulation.set(field, env, row).map_err(value_error))
    }

    fn nmocap(&self) -> usize {
        self.simulation.model().bodies.iter().filter(|b| b.mocap).count()
    }

    /// The writable array, made at its first use.
    fn applied<'py>(&mut self, py: Python<'py>, which: Applied) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        if self.applied[which as usize].is_none() {
            let model = self.simulation.model().clone();
            let mocap = || model.bodies.iter().filter(|b| b.mocap);
            let (tail, row): (Vec<usize>, Vec<f64>) = match which {
                Applied::Qfrc => (vec![model.nv()], vec![0.0; model.nv()]),
                Applied::Xfrc => (vec![model.bodies.len(), 6], vec![0.0; 6 * model.bodies.len()]),
                Applied::MocapPos => (vec![self.nmocap(), 3], mocap().flat_map(|b| b.pos).collect()),
                Applied::MocapQuat => (vec![self.nmocap(), 4], mocap().flat_map(|b| b.quat).collect()),
            };
            let all = row.repeat(self.n());
            let made = numpy::PyArray1::from_vec(py, all).reshape(self.shape(&tail))?;
            self.applied[which as usize] = Some(made.unbind());
        }
        Ok(self.applied[which as usize].as_ref().expect("made above").bind(py).clone())
    }

    /// Keeps the controls of all environments, given one row for each or one for all.
    pub(crate) fn hold(&mut self, rows: &[f64]) {
        if rows.len() == self.ctrl.len() {
            self.ctrl.copy_from_slice(rows);
        } else {
            self.ctrl.chunks_exact_mut(rows.len()).for_each(|row| row.copy_from_slice(rows));
        }
    }

    /// Checks controls, zero without any, and keeps them if they are `used`: those that no step is made with were never in force.
    fn take_control(&mut self, given: Option<&Bound<'_, PyAny>>, used: bool) -> PyResult<()> {
        let Some(given) = given else {
            if used {
                self.ctrl.fill(0.0);
            }
            return Ok(());
        };
        let (n, nu) = (self.n(), self.simulation.model().nu());
        let taken = with_numbers(given, |shape, numbers| {
            let fits = matches!(*shape, [row] if row == nu) || (self.batched && matches!(*shape, [rows, row] if rows == n && row == nu));
            if fits && used {
                self.hold(numbers);
            }
            fits
        });
        if taken == Some(true) { Ok(()) } else { self.convert_control(given, used) }
    }

    /// The same of what is no plain array of the right shape.
    #[cold]
    fn convert_control(&mut self, given: &Bound<'_, PyAny>, used: bool) -> PyResult<()> {
        let rows = self.rows(given, "ctrl", self.simulation.model().nu())?;
        if used {
            self.hold(rows.as_slice()?);
        }
        Ok(())
    }

    /// Makes `nstep` steps with the controls that are held and what the user applies.
    fn advance(&mut self, py: Python<'_>, nstep: usize) -> PyResult<()> {
        if self.applied.iter().any(Option::is_some) {
            return self.advance_applied(py, nstep);
        }
        let inputs = StepInputs { ctrl: &self.ctrl, ..StepInputs::default() };
        let simulation = &mut self.simulation;
        let made = if nstep <= self.brief { simulation.step(&inputs, nstep) } else { py.detach(|| simulation.step(&inputs, nstep)) };
        made.map_err(value_error)
    }

    #[cold]
    fn advance_applied(&mut self, py: Python<'_>, nstep: usize) -> PyResult<()> {
        self.complete_mocap(py)?;
        let held = self.held(py)?;
        let (inputs, simulation) = (held.inputs(&self.ctrl)?, &mut self.simulation);
        py.detach(|| simulation.step(&inputs, nstep)).map_err(value_error)
    }

    /// Positions and orientations of mocap bodies go together: whoever moves a body may leave its orientation alone.
    pub(crate) fn complete_mocap(&mut self, py: Python<'_>) -> PyResult<()> {
        let given = [Applied::MocapPos, Applied::MocapQuat].map(|which| self.applied[which as usize].is_some());
        if given[0] != given[1] {
            self.applied(py, Applied::MocapPos)?;
            self.applied(py, Applied::MocapQuat)?;
        }
        Ok(())
    }

    /// Numbers in the writable arrays that were made.
    pub(crate) fn applied_len(&self, py: Python<'_>) -> usize {
        self.applied.iter().flatten().map(|array| array.bind(py).len()).sum()
    }

    pub(crate) fn held<'py>(&self, py: Python<'py>) -> PyResult<Held<'py>> {
        let mut held = Held(Default::default());
        for (slot, array) in held.0.iter_mut().zip(&self.applied) {
            if let Some(array) = array {
                *slot = Some(array.bind(py).try_readonly().map_err(|e| PyValueError::new_err(e.to_string()))?);
            }
        }
        Ok(held)
    }

    /// Replaces the contents of a writable array.
    fn assign(&mut self, py: Python<'_>, which: Applied, value: &Bound<'_, PyAny>) -> PyResult<()> {
        self.applied(py, which)?.set_item(py.Ellipsis(), value)
    }

    /// Reads all sensors of all environments.
    fn sense(&mut self, py: Python<'_>, truth: bool, out: &mut [f64]) -> PyResult<()> {
        if self.applied[Applied::MocapPos as usize].is_some() || self.applied[Applied::MocapQuat as usize].is_some() {
            self.applied(py, Applied::MocapPos)?;
            self.applied(py, Applied::MocapQuat)?;
        }
        let mut held = Vec::with_capacity(4);
        for array in &self.applied {
            held.push(match array {
                Some(array) => Some(array.bind(py).try_readonly().map_err(|e| PyValueError::new_err(e.to_string()))?),
                None => None,
            });
        }
        let slice = |i: usize| held[i].as_ref().map_or(Ok(&[][..]), |array| array.as_slice().map_err(PyErr::from));
        let inputs = StepInputs { ctrl: &[], qfrc: slice(0)?, xfrc: slice(1)?, mocap_pos: slice(2)?, mocap_quat: slice(3)? };
        let simulation = &mut self.simulation;
        write_detached(py, || simulation.sense(&inputs, truth, out)).map_err(value_error)
    }

    fn readings<'py>(&mut self, py: Python<'py>, truth: bool) -> PyResult<Bound<'py, PyAny>> {
        let width = self.simulation.model().nsensordata();
        let mut data = vec![0.0; self.n() * width];
        self.sense(py, truth, &mut data)?;
        array(py, &self.shape(&[width]), data, self.precision)
    }

    fn snapshot(&self, py: Python<'_>, env: isize) -> PyResult<stepper_core::query::Snapshot> {
        let env = self.env(env)?;
        let model = self.simulation.model();
        let row = |which: Applied, width: usize| -> PyResult<Vec<f64>> {
            let Some(held) = &self.applied[which as usize] else { return Ok(Vec::new()) };
            let held = held.bind(py).try_readonly().map_err(|e| PyValueError::new_err(e.to_string()))?;
            Ok(held.as_slice()?[env * width..(env + 1) * width].to_vec())
        };
        let nu = model.nu();
        let (qfrc, xfrc) = (row(Applied::Qfrc, model.nv())?, row(Applied::Xfrc, 6 * model.bodies.len())?);
        let (mocap_pos, mocap_quat) = (row(Applied::MocapPos, 3 * self.nmocap())?, row(Applied::MocapQuat, 4 * self.nmocap())?);
        let given = mocap_pos.is_empty() || mocap_quat.is_empty();
        let inputs = StepInputs {
            ctrl: &self.ctrl[env * nu..(env + 1) * nu],
            qfrc: &qfrc,
            xfrc: &xfrc,
            mocap_pos: if given { &[] } else { &mocap_pos },
            mocap_quat: if given { &[] } else { &mocap_quat },
        };
        Ok(self.simulation.snapshot(env, &inputs))
    }
}

/// What a `stepper.SensorModel` says of every sensor of a model.
fn transfers(sensors: &Bound<'_, PyAny>, model: &Py<Model>, num_envs: usize) -> PyResult<Vec<Option<Transfer>>> {
    let all = resolved(sensors, (model.clone_ref(sensors.py()), num_envs), ["sensors", "transfers", "SensorModel"])?;
    pythonize::depythonize(&all).map_err(|e| PyValueError::new_err(format!("sensors: {e}")))
}

/// What a `stepper.ActuatorModel` says of every actuator of a model, in all environments or in those of `envs`.
pub(crate) fn drives(
    actuators: &Bound<'_, PyAny>,
    model: &Py<Model>,
    num_envs: usize,
    envs: Option<&[usize]>,
) -> PyResult<Vec<Option<DriveTrain>>> {
    let envs = envs.map(|envs| numpy::PyArray1::from_iter(actuators.py(), envs.iter().map(|&env| env as i64)));
    let all = resolved(actuators, (model.clone_ref(actuators.py()), num_envs, envs), ["actuators", "drives", "ActuatorModel"])?;
    pythonize::depythonize(&all).map_err(|e| PyValueError::new_err(format!("actuators: {e}")))
}

/// What an argument says of every sensor or actuator, by a method of its class.
fn resolved<'py>(
    given: &Bound<'py, PyAny>,
    arguments: impl pyo3::call::PyCallArgs<'py>,
    [argument, method, class]: [&str; 3],
) -> PyResult<Bound<'py, PyAny>> {
    let resolve = given
        .getattr(method)
        .map_err(|_| PyTypeError::new_err(format!("{argument} is {}, must be a stepper.{class}", described(given))))?;
    resolve.call1(arguments)
}

/// Degrees of freedom times steps that take so short, two or three microseconds, that letting other threads of Python run meanwhile costs more
/// than it gives.
const BRIEF: usize = 10;

/// The stepper, to be written to by one thread at a time.
fn borrow<'py>(slf: &Bound<'py, Stepper>) -> PyResult<PyRefMut<'py, Stepper>> {
    slf.try_borrow_mut().map_err(|_| PyRuntimeError::new_err("this Stepper is at work in another thread; give every thread its own"))
}

/// Tells the recorder what was done, with the arguments that were given.
fn notify(slf: &Bound<'_, Stepper>, what: &str, given: &[(&str, Option<Bound<'_, PyAny>>)]) -> PyResult<()> {
    let recorder = slf.borrow().recorder.as_ref().map(|r| r.clone_ref(slf.py()));
    let Some(recorder) = recorder else { return Ok(()) };
    let arguments = PyDict::new(slf.py());
    for (name, value) in given {
        if let Some(value) = value {
            arguments.set_item(name, value)?;
        }
    }
    recorder.call_method(slf.py(), what, (slf,), Some(&arguments))?;
    Ok(())
}

/// Tells the recorder of a step: all that it was made with.
#[cold]
fn tell_of_step(slf: &Bound<'_, Stepper>, this: PyRefMut<'_, Stepper>, nstep: usize) -> PyResult<()> {
    let py = slf.py();
    let ctrl = array(py, &[this.n(), this.simulation.model().nu()], this.ctrl.clone(), Precision::F64)?;
    let applied = this.applied.iter().map(|a| a.as_ref().map(|a| a.clone_ref(py))).collect::<Vec<_>>().into_pyobject(py)?;
    drop(this);
    notify(slf, "step", &[("ctrl", Some(ctrl)), ("nstep", Some(nstep.into_pyobject(py)?.into_any())), ("applied", Some(applied))])
}

#[pymethods]
impl Stepper {
    #[new]
    #[pyo3(signature = (model, num_envs=None, *, options=None, precision="f64", threads=Whole::Number(1), seed=Whole::Number(0), sensors=None, actuators=None), text_signature = "(model, num_envs=None, *, options=None, precision='f64', threads=1, seed=0, sensors=None, actuators=None)")]
    #[expect(clippy::too_many_arguments, reason = "Python's keywords")]
    fn new(
        py: Python<'_>,
        model: Py<Model>,
        num_envs: Option<Bound<'_, PyAny>>,
        options: Option<Bound<'_, PyAny>>,
        precision: &str,
        threads: Whole<'_>,
        seed: Whole<'_>,
        sensors: Option<Bound<'_, PyAny>>,
        actuators: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let num_envs = num_envs.map(|n| whole(&n, "num_envs", 1)).transpose()?.map(|n| n as usize);
        let (threads, seed) = (threads.from(0, "threads")? as usize, seed.from(0, "seed")?);
        let precision = match precision {
            "f64" => Precision::F64,
            "f32" => Precision::F32,
            other => return Err(unknown("precision", other, "f64, f32")),
        };
        let options = match options {
            Some(given) => given,
            None => py.import("stepper")?.getattr("Options")?.call0()?,
        };
        let core = model.get().core.clone();
        let settings = settings(&options, core.timestep, precision)?;
        let (nu, nv) = (core.nu(), core.nv());
        let mut simulation = Simulation::new(core, settings, num_envs, precision, threads).map_err(value_error)?;
        let n = simulation.num_envs();
        if let Some(actuators) = &actuators {
            simulation.couple(&drives(actuators, &model, n, None)?).map_err(value_error)?;
        }
        (0..n).for_each(|env| simulation.begin(env, Some(seed)));
        if let Some(sensors) = &sensors {
            simulation.equip(&transfers(sensors, &model, n)?).map_err(value_error)?;
        }
        let ctrl = vec![0.0; nu * n];
        let brief = BRIEF / (n * nv.max(1));
        let applied = [const { None }; 4];
        let (batched, options) = (num_envs.is_some(), options.unbind());
        Ok(Self {
            simulation,
            model,
            options,
            batched,
            precision,
            threads,
            brief,
            seed,
            ctrl,
            applied,
            recorder: None,
            sensors: sensors.map(Bound::unbind),
            actuators: actuators.map(Bound::unbind),
        })
    }

    #[pyo3(signature = (mask=None, *, qpos=None, qvel=None, seed=None, keyframe=None))]
    fn reset(
        slf: &Bound<'_, Self>,
        mask: Option<Bound<'_, PyAny>>,
        qpos: Option<Bound<'_, PyAny>>,
        qvel: Option<Bound<'_, PyAny>>,
        seed: Option<Bound<'_, PyAny>>,
        keyframe: Option<Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let mut this = borrow(slf)?;
        let envs = this.chosen(mask.as_ref())?;
        let given_seed = seed;
        let seed = given_seed.as_ref().map(|seed| whole(seed, "seed", 0)).transpose()?.unwrap_or(this.seed);
        let nu = this.simulation.model().nu();
        // Everything is checked before anything is changed.
        let q = this.checked(Field::Qpos, qpos.as_ref(), &envs)?;
        let v = this.checked(Field::Qvel, qvel.as_ref(), &envs)?;
        let key = keyframe.as_ref().map(|name| this.model.get().find_keyframe(&name.extract::<String>()?)).transpose()?;
        this.seed = seed;
        for &env in &envs {
            this.simulation.reset(env);
            if given_seed.is_some() {
                this.simulation.begin(env, Some(seed));
            }
            this.ctrl[env * nu..(env + 1) * nu].fill(0.0);
            if let Some(key) = &key {
                for (field, values) in [(Field::Qpos, &key.qpos), (Field::Qvel, &key.qvel), (Field::Act, &key.act)] {
                    this.simulation.set(field, env, values).map_err(value_error)?;
                }
                this.simulation.set_time(env, key.time);
            }
        }
        this.write(Field::Qpos, &q, &envs)?;
        this.write(Field::Qvel, &v, &envs)?;
        drop(this);
        notify(slf, "reset", &[("mask", mask), ("qpos", qpos), ("qvel", qvel), ("seed", given_seed), ("keyframe", keyframe)])
    }

    #[pyo3(signature = (ctrl=None, nstep=Whole::Number(1)), text_signature = "($self, ctrl=None, nstep=1)")]
    fn step(slf: &Bound<'_, Self>, ctrl: Option<&Bound<'_, PyAny>>, nstep: Whole<'_>) -> PyResult<()> {
        let mut this = borrow(slf)?;
        let nstep = nstep.from(0, "nstep")? as usize;
        this.take_control(ctrl, nstep > 0)?;
        this.advance(slf.py(), nstep)?;
        if this.recorder.is_none() { Ok(()) } else { tell_of_step(slf, this, nstep) }
    }

    #[pyo3(signature = (ctrl, nstep=Whole::Number(1), *, fields=None, out=None), text_signature = "($self, ctrl, nstep=1, *, fields=None, out=None)")]
    fn rollout<'py>(
        &mut self,
        py: Python<'py>,
        ctrl: Bound<'py, PyAny>,
        nstep: Whole<'_>,
        fields: Option<Vec<String>>,
        out: Option<Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let nstep = nstep.from(0, "nstep")? as usize;
        if self.recorder.is_some() {
            return Err(PyRuntimeError::new_err(
                "this stepper is recorded, and a rollout is not: call step for every control, or close the recording",
            ));
        }
        self.roll(py, &ctrl, nstep, fields, out.as_ref())
    }

    #[pyo3(signature = (qpos=None, qvel=None, mask=None, *, act=None))]
    fn set_state(
        slf: &Bound<'_, Self>,
        qpos: Option<Bound<'_, PyAny>>,
        qvel: Option<Bound<'_, PyAny>>,
        mask: Option<Bound<'_, PyAny>>,
        act: Option<Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        if let Some(state) = qpos.as_ref().and_then(|q| q.cast::<State>().ok()) {
            if qvel.is_some() || mask.is_some() || act.is_some() {
                return Err(PyValueError::new_err("set_state(state) takes nothing else"));
            }
            let (state, mut this) = (state.get(), borrow(slf)?);
            if state.digest != this.model.get().core.digest() {
                return Err(PyValueError::new_err("this state belongs to another model"));
            }
            this.simulation.restore_state(&state.bytes).map_err(value_error)?;
            drop(this);
            return notify(slf, "set_state", &[("state", qpos)]);
        }
        let mut this = borrow(slf)?;
        let envs = this.chosen(mask.as_ref())?;
        let fields = [(Field::Qpos, &qpos), (Field::Qvel, &qvel), (Field::Act, &act)];
        let rows = fields.map(|(field, given)| this.checked(field, given.as_ref(), &envs));
        let rows = rows.into_iter().collect::<PyResult<Vec<_>>>()?;
        for ((field, _), rows) in fields.iter().zip(&rows) {
            this.write(*field, rows, &envs)?;
        }
        drop(this);
        notify(slf, "set_state", &[("mask", mask), ("qpos", qpos), ("qvel", qvel), ("act", act)])
    }

    #[pyo3(signature = (mask=None, **fields))]
    fn randomize(slf: &Bound<'_, Self>, mask: Option<Bound<'_, PyAny>>, fields: Option<Bound<'_, PyDict>>) -> PyResult<()> {
        let mut this = borrow(slf)?;
        let envs = this.chosen(mask.as_ref())?;
        this.assign_parameters(fields.as_ref(), &envs)?;
        drop(this);
        notify(slf, "randomize", &[("mask", mask), ("fields", fields.map(Bound::into_any))])
    }

    #[getter]
    fn randomized<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.parameters(py)
    }

    /// Keeps everything that happens from now on; see `stepper._record`.
    #[pyo3(signature = (path, **settings))]
    fn record<'py>(slf: &Bound<'py, Self>, path: Bound<'py, PyAny>, settings: Option<&Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
        let recorder = slf.py().import("stepper._record")?.getattr("Recorder")?.call((slf, path), settings)?;
        borrow(slf)?.recorder = Some(recorder.clone().unbind());
        Ok(recorder)
    }

    /// Whom `step`, `reset` and `set_state` tell what they did; None is nobody.
    #[getter]
    fn recorder(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.recorder.as_ref().map(|r| r.clone_ref(py))
    }

    #[setter]
    fn set_recorder(&mut self, recorder: Option<Py<PyAny>>) {
        self.recorder = recorder;
    }

    fn get_state(&self) -> State {
        State { bytes: self.simulation.save_state(), digest: self.model.get().core.digest() }
    }

    #[getter]
    fn model(&self, py: Python<'_>) -> Py<Model> {
        self.model.clone_ref(py)
    }

    #[getter]
    fn options(&self, py: Python<'_>) -> Py<PyAny> {
        self.options.clone_ref(py)
    }

    #[getter]
    pub(crate) fn num_envs(&self) -> Option<usize> {
        self.batched.then(|| self.n())
    }

    #[getter]
    fn timestep(&self) -> f64 {
        self.simulation.options().timestep
    }

    #[getter]
    fn precision(&self) -> &'static str {
        if self.precision == Precision::F64 { "f64" } else { "f32" }
    }

    #[getter]
    fn threads(&self) -> usize {
        self.threads
    }

    #[getter]
    fn seed(&self) -> u64 {
        self.seed
    }

    #[getter]
    fn qpos<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.gather(py, self.simulation.model().nq(), |env, row| self.simulation.get(Field::Qpos, env, row))
    }

    #[getter]
    fn qvel<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.gather(py, self.simulation.model().nv(), |env, row| self.simulation.get(Field::Qvel, env, row))
    }

    #[getter]
    fn act<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.gather(py, self.simulation.model().na(), |env, row| self.simulation.get(Field::Act, env, row))
    }

    #[getter]
    fn ctrl<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        array(py, &self.shape(&[self.simulation.model().nu()]), self.ctrl.clone(), self.precision)
    }

    #[getter]
    fn time(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.per_env(py, |env| self.simulation.time(env))
    }

    #[getter]
    fn status(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.per_env(py, |env| self.simulation.status(env))
    }

    #[getter]
    fn residual(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.per_env(py, |env| self.simulation.certificate(env).0)
    }

    #[getter]
    fn iterations(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.per_env(py, |env| self.simulation.certificate(env).1 as u32)
    }

    #[getter]
    fn penetration(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.per_env(py, |env| self.simulation.contacts(env).iter().fold(0.0, |deepest: f64, (_, c)| deepest.max(-c.distance)))
    }

    #[getter]
    fn observation<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.readings(py, false)
    }

    #[getter]
    fn sensor_truth<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.readings(py, true)
    }

    #[getter]
    fn sensor_faults<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let counts: Vec<u32> = (0..self.n()).flat_map(|env| self.simulation.sensor_faults(env)).flatten().collect();
        let shape = self.shape(&[self.simulation.model().sensors.len(), 2]);
        Ok(numpy::PyArray1::from_vec(py, counts).reshape(shape)?.into_any())
    }

    #[getter]
    fn actuator_saturation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let counts: Vec<u32> = (0..self.n()).flat_map(|env| self.simulation.actuator_saturation(env)).collect();
        let shape = self.shape(&[self.simulation.model().nu()]);
        Ok(numpy::PyArray1::from_vec(py, counts).reshape(shape)?.into_any())
    }

    #[getter]
    fn sensors(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.sensors.as_ref().map(|s| s.clone_ref(py))
    }

    #[getter]
    fn actuators(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.actuators.as_ref().map(|a| a.clone_ref(py))
    }

    #[pyo3(signature = (out=None))]
    fn observe<'py>(&mut self, py: Python<'py>, out: Option<Bound<'py, PyAny>>) -> PyResult<Bound<'py, PyAny>> {
        let Some(out) = out else { return self.readings(py, false) };
        let must = self.shape(&[self.simulation.model().nsensordata()]);
        let Ok(given) = out.cast::<numpy::PyUntypedArray>() else {
            return Err(PyTypeError::new_err(format!("out is {}, must be an array to be filled", described(&out))));
        };
        let dtype = given.dtype();
        if dtype.kind() != b'f' {
            return Err(PyTypeError::new_err(format!("out has dtype {dtype}, must be one of real numbers")));
        }
        check_shape("out", given.shape(), &[&must])?;
        match out.cast::<PyArrayDyn<f64>>() {
            Ok(exact) if exact.is_c_contiguous() => {
                let mut held = exact.try_readwrite().map_err(|e| PyValueError::new_err(format!("out: {e}")))?;
                self.sense(py, false, held.as_slice_mut()?)?;
            }
            _ => out.set_item(py.Ellipsis(), self.readings(py, false)?)?,
        }
        Ok(out)
    }

    #[getter]
    fn qfrc_applied<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.applied(py, Applied::Qfrc)
    }

    #[setter]
    fn set_qfrc_applied(&mut self, py: Python<'_>, value: Bound<'_, PyAny>) -> PyResult<()> {
        self.assign(py, Applied::Qfrc, &value)
    }

    #[getter]
    fn xfrc_applied<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.applied(py, Applied::Xfrc)
    }

    #[setter]
    fn set_xfrc_applied(&mut self, py: Python<'_>, value: Bound<'_, PyAny>) -> PyResult<()> {
        self.assign(py, Applied::Xfrc, &value)
    }

    #[getter]
    fn mocap_pos<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.applied(py, Applied::MocapPos)
    }

    #[setter]
    fn set_mocap_pos(&mut self, py: Python<'_>, value: Bound<'_, PyAny>) -> PyResult<()> {
        self.assign(py, Applied::MocapPos, &value)
    }

    #[getter]
    fn mocap_quat<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.applied(py, Applied::MocapQuat)
    }

    #[setter]
    fn set_mocap_quat(&mut self, py: Python<'_>, value: Bound<'_, PyAny>) -> PyResult<()> {
        self.assign(py, Applied::MocapQuat, &value)
    }

    fn memory<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.memory_report(py)
    }

    #[pyo3(signature = (env=0))]
    fn contacts<'py>(&self, py: Python<'py>, env: isize) -> PyResult<Bound<'py, PyAny>> {
        structured(py, self.simulation.model(), &self.simulation.contacts(self.env(env)?))
    }

    #[pyo3(signature = (env=0))]
    fn mass_matrix<'py>(&self, py: Python<'py>, env: isize) -> PyResult<Bound<'py, PyAny>> {
        let nv = self.simulation.model().nv();
        array(py, &[nv, nv], self.snapshot(py, env)?.mass_matrix(&self.simulation.plan_of(self.env(env)?)), Precision::F64)
    }

    #[pyo3(signature = (env=0))]
    fn bias_force<'py>(&self, py: Python<'py>, env: isize) -> PyResult<Bound<'py, PyAny>> {
        let out = self.snapshot(py, env)?.bias_force(&self.simulation.plan_of(self.env(env)?));
        array(py, &[out.len()], out, Precision::F64)
    }

    #[pyo3(signature = (env=0, *, ctrl=None))]
    fn smooth_acceleration<'py>(&self, py: Python<'py>, env: isize, ctrl: Option<Bound<'py, PyAny>>) -> PyResult<Bound<'py, PyAny>> {
        let mut snapshot = self.snapshot(py, env)?;
        if let Some(ctrl) = ctrl {
            let ctrl = readonly(&ctrl, "ctrl")?;
            check_shape("ctrl", ctrl.shape(), &[&[self.simulation.model().nu()]])?;
            snapshot.inputs.ctrl.copy_from_slice(ctrl.as_slice()?);
        }
        let out = snapshot.smooth_acceleration(&self.simulation.plan_of(self.env(env)?));
        array(py, &[out.len()], out, Precision::F64)
    }

    #[pyo3(signature = (env=0))]
    fn energy(&self, py: Python<'_>, env: isize) -> PyResult<(f64, f64)> {
        Ok(self.snapshot(py, env)?.energy(&self.simulation.plan_of(self.env(env)?)))
    }

    #[pyo3(signature = (env=0))]
    fn momentum<'py>(&self, py: Python<'py>, env: isize) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let (linear, angular) = self.snapshot(py, env)?.momentum(&self.simulation.plan_of(self.env(env)?));
        Ok((array(py, &[3], linear.to_vec(), Precision::F64)?, array(py, &[3], angular.to_vec(), Precision::F64)?))
    }

    fn __getstate__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let state = PyDict::new(py);
        state.set_item("state", PyBytes::new(py, &self.simulation.save_state()))?;
        state.set_item("randomized", self.parameters(py)?)?;
        state.set_item("ctrl", self.ctrl.clone())?;
        state.set_item("applied", self.applied.iter().map(|a| a.as_ref().map(|a| a.clone_ref(py))).collect::<Vec<_>>())?;
        Ok(state)
    }

    fn __setstate__(&mut self, state: &Bound<'_, PyDict>) -> PyResult<()> {
        let item = |name: &str| state.get_item(name)?.ok_or_else(|| PyValueError::new_err(format!("pickled Stepper lacks {name}")));
        self.simulation.restore_state(&item("state")?.extract::<Vec<u8>>()?).map_err(value_error)?;
        let all: Vec<usize> = (0..self.n()).collect();
        self.assign_parameters(Some(item("randomized")?.cast::<PyDict>()?), &all)?;
        self.ctrl = item("ctrl")?.extract()?;
        let applied: Vec<Option<Py<PyArrayDyn<f64>>>> = item("applied")?.extract()?;
        for (slot, array) in self.applied.iter_mut().zip(applied) {
            *slot = array;
        }
        Ok(())
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let py = slf.py();
        let this = slf.borrow();
        let keywords = PyDict::new(py);
        keywords.set_item("options", this.options.clone_ref(py))?;
        keywords.set_item("precision", this.precision())?;
        keywords.set_item("threads", this.threads)?;
        keywords.set_item("seed", this.seed)?;
        keywords.set_item("sensors", this.sensors(py))?;
        keywords.set_item("actuators", this.actuators(py))?;
        let make = py.import("functools")?.getattr("partial")?.call((slf.get_type(),), Some(&keywords))?;
        let args = (this.model.clone_ref(py), this.num_envs()).into_pyobject(py)?;
        (make, args, this.__getstate__(py)?).into_pyobject(py)
    }

    fn __repr__(&self) -> String {
        let envs = if self.batched { format!("{} environments", self.n()) } else { "one environment".into() };
        format!("<stepper.Stepper: {envs} of \"{}\", {} s>", self.simulation.model().name, self.timestep())
    }
}

/// The core's model, shared.
pub(crate) type SharedModel = Arc<stepper_core::Model>;
