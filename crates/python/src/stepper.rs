//! `stepper.Stepper`.

use std::sync::Arc;

use numpy::{PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyTuple};
use stepper_core::batch::{Field, StepInputs};
use stepper_core::{Error, Precision, Simulation};

use crate::array::{array, check_shape, readonly};
use crate::contacts::structured;
use crate::model::{Model, to_py};
use crate::options::{settings, unknown};
use crate::state::State;

/// Environments of one model, stepped together.
#[pyclass(module = "stepper._stepper")]
pub(crate) struct Stepper {
    simulation: Simulation,
    model: Py<Model>,
    options: Py<PyAny>,
    batched: bool,
    precision: Precision,
    threads: usize,
    seed: u64,
    ctrl: Vec<f64>,
    applied: [Option<Py<PyArrayDyn<f64>>>; 4],
}

/// Index in `applied`, name, and the trailing axes of the arrays that the user writes and every step reads.
#[derive(Clone, Copy)]
enum Applied {
    Qfrc,
    Xfrc,
    MocapPos,
    MocapQuat,
}

fn value_error(error: Error) -> PyErr {
    match error {
        Error::Model(e) => to_py(e),
        Error::Value(message) => PyValueError::new_err(message),
    }
}

impl Stepper {
    fn n(&self) -> usize {
        self.simulation.num_envs()
    }

    /// (num_envs, ...tail), or the tail alone for a single environment.
    fn shape(&self, tail: &[usize]) -> Vec<usize> {
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
        let full = self.shape(&[width]);
        // For a single environment both are the same.
        check_shape(name, given.shape(), &[&full[..], &[width]][..1 + usize::from(self.batched)])?;
        Ok(given)
    }

    fn write(&mut self, field: Field, name: &str, width: usize, given: Option<&Bound<'_, PyAny>>, envs: &[usize]) -> PyResult<()> {
        let Some(given) = given else { return Ok(()) };
        let given = self.rows(given, name, width)?;
        let data = given.as_slice()?;
        let shared = given.ndim() == 1;
        for &env in envs {
            let row = if shared { data } else { &data[env * width..(env + 1) * width] };
            self.simulation.set(field, env, row).map_err(value_error)?;
        }
        Ok(())
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

    /// Replaces the contents of a writable array.
    fn assign(&mut self, py: Python<'_>, which: Applied, value: &Bound<'_, PyAny>) -> PyResult<()> {
        self.applied(py, which)?.set_item(py.Ellipsis(), value)
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

#[pymethods]
impl Stepper {
    #[new]
    #[pyo3(signature = (model, num_envs=None, *, options=None, precision="f64", threads=1, seed=0))]
    fn new(
        py: Python<'_>,
        model: Py<Model>,
        num_envs: Option<usize>,
        options: Option<Bound<'_, PyAny>>,
        precision: &str,
        threads: usize,
        seed: u64,
    ) -> PyResult<Self> {
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
        let nu = core.nu();
        let simulation = Simulation::new(core, settings, num_envs, precision, threads).map_err(value_error)?;
        let ctrl = vec![0.0; nu * simulation.num_envs()];
        let applied = [const { None }; 4];
        Ok(Self { simulation, model, options: options.unbind(), batched: num_envs.is_some(), precision, threads, seed, ctrl, applied })
    }

    #[pyo3(signature = (mask=None, *, qpos=None, qvel=None, seed=None, keyframe=None))]
    fn reset(
        &mut self,
        mask: Option<Bound<'_, PyAny>>,
        qpos: Option<Bound<'_, PyAny>>,
        qvel: Option<Bound<'_, PyAny>>,
        seed: Option<u64>,
        keyframe: Option<&str>,
    ) -> PyResult<()> {
        let envs = self.chosen(mask.as_ref())?;
        self.seed = seed.unwrap_or(self.seed);
        let (nq, nv, nu) = (self.simulation.model().nq(), self.simulation.model().nv(), self.simulation.model().nu());
        // Everything is checked before anything is changed.
        for (given, name, width) in [(&qpos, "qpos", nq), (&qvel, "qvel", nv)] {
            if let Some(given) = given {
                self.rows(given, name, width)?;
            }
        }
        let key = keyframe.map(|name| self.model.get().find_keyframe(name)).transpose()?;
        for &env in &envs {
            self.simulation.reset(env);
            self.ctrl[env * nu..(env + 1) * nu].fill(0.0);
            if let Some(key) = &key {
                for (field, values) in [(Field::Qpos, &key.qpos), (Field::Qvel, &key.qvel), (Field::Act, &key.act)] {
                    self.simulation.set(field, env, values).map_err(value_error)?;
                }
                self.simulation.set_time(env, key.time);
            }
        }
        self.write(Field::Qpos, "qpos", nq, qpos.as_ref(), &envs)?;
        self.write(Field::Qvel, "qvel", nv, qvel.as_ref(), &envs)
    }

    #[pyo3(signature = (ctrl=None, nstep=1))]
    fn step(&mut self, py: Python<'_>, ctrl: Option<Bound<'_, PyAny>>, nstep: usize) -> PyResult<()> {
        let nu = self.simulation.model().nu();
        match &ctrl {
            None => self.ctrl.fill(0.0),
            Some(given) => {
                let given = self.rows(given, "ctrl", nu)?;
                let data = given.as_slice()?;
                if data.len() == self.ctrl.len() {
                    self.ctrl.copy_from_slice(data);
                } else {
                    self.ctrl.chunks_exact_mut(nu).for_each(|row| row.copy_from_slice(data));
                }
            }
        }
        let nmocap = self.nmocap();
        if nmocap > 0 && (self.applied[Applied::MocapPos as usize].is_some() || self.applied[Applied::MocapQuat as usize].is_some()) {
            // They go together: whoever moves a body may leave its orientation alone.
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
        let slice = |i: usize| match &held[i] {
            Some(array) => array.as_slice().map_err(PyErr::from),
            None => Ok(&[][..]),
        };
        let inputs = StepInputs { ctrl: &self.ctrl, qfrc: slice(0)?, xfrc: slice(1)?, mocap_pos: slice(2)?, mocap_quat: slice(3)? };
        let simulation = &mut self.simulation;
        py.detach(|| simulation.step(&inputs, nstep)).map_err(value_error)
    }

    #[pyo3(signature = (qpos=None, qvel=None, mask=None, *, act=None))]
    fn set_state(
        &mut self,
        qpos: Option<Bound<'_, PyAny>>,
        qvel: Option<Bound<'_, PyAny>>,
        mask: Option<Bound<'_, PyAny>>,
        act: Option<Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        if let Some(state) = qpos.as_ref().and_then(|q| q.cast::<State>().ok()) {
            if qvel.is_some() || mask.is_some() || act.is_some() {
                return Err(PyValueError::new_err("set_state(state) takes nothing else"));
            }
            let state = state.get();
            if state.digest != self.model.get().core.digest() {
                return Err(PyValueError::new_err("this state belongs to another model"));
            }
            return self.simulation.restore_state(&state.bytes).map_err(value_error);
        }
        let envs = self.chosen(mask.as_ref())?;
        let (nq, nv, na) = (self.simulation.model().nq(), self.simulation.model().nv(), self.simulation.model().na());
        for (given, name, width) in [(&qpos, "qpos", nq), (&qvel, "qvel", nv), (&act, "act", na)] {
            if let Some(given) = given {
                self.rows(given, name, width)?;
            }
        }
        self.write(Field::Qpos, "qpos", nq, qpos.as_ref(), &envs)?;
        self.write(Field::Qvel, "qvel", nv, qvel.as_ref(), &envs)?;
        self.write(Field::Act, "act", na, act.as_ref(), &envs)
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
    fn num_envs(&self) -> Option<usize> {
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
    fn observation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.sensor_truth(py)
    }

    #[getter]
    fn sensor_truth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.gather(py, self.simulation.model().nsensordata(), |env, row| self.simulation.sense(env, row))
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

    #[pyo3(signature = (env=0))]
    fn contacts<'py>(&self, py: Python<'py>, env: isize) -> PyResult<Bound<'py, PyAny>> {
        structured(py, self.simulation.model(), &self.simulation.contacts(self.env(env)?))
    }

    #[pyo3(signature = (env=0))]
    fn mass_matrix<'py>(&self, py: Python<'py>, env: isize) -> PyResult<Bound<'py, PyAny>> {
        let nv = self.simulation.model().nv();
        array(py, &[nv, nv], self.snapshot(py, env)?.mass_matrix(self.simulation.plan()), Precision::F64)
    }

    #[pyo3(signature = (env=0))]
    fn bias_force<'py>(&self, py: Python<'py>, env: isize) -> PyResult<Bound<'py, PyAny>> {
        let out = self.snapshot(py, env)?.bias_force(self.simulation.plan());
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
        let out = snapshot.smooth_acceleration(self.simulation.plan());
        array(py, &[out.len()], out, Precision::F64)
    }

    #[pyo3(signature = (env=0))]
    fn energy(&self, py: Python<'_>, env: isize) -> PyResult<(f64, f64)> {
        Ok(self.snapshot(py, env)?.energy(self.simulation.plan()))
    }

    #[pyo3(signature = (env=0))]
    fn momentum<'py>(&self, py: Python<'py>, env: isize) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let (linear, angular) = self.snapshot(py, env)?.momentum(self.simulation.plan());
        Ok((array(py, &[3], linear.to_vec(), Precision::F64)?, array(py, &[3], angular.to_vec(), Precision::F64)?))
    }

    fn __getstate__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let state = PyDict::new(py);
        state.set_item("state", PyBytes::new(py, &self.simulation.save_state()))?;
        state.set_item("ctrl", self.ctrl.clone())?;
        state.set_item("applied", self.applied.iter().map(|a| a.as_ref().map(|a| a.clone_ref(py))).collect::<Vec<_>>())?;
        Ok(state)
    }

    fn __setstate__(&mut self, state: &Bound<'_, PyDict>) -> PyResult<()> {
        let item = |name: &str| state.get_item(name)?.ok_or_else(|| PyValueError::new_err(format!("pickled Stepper lacks {name}")));
        self.simulation.restore_state(&item("state")?.extract::<Vec<u8>>()?).map_err(value_error)?;
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
