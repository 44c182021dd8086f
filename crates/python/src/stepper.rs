//! `stepper.Stepper`: construction, attributes, and shared functions. The other methods are in modules by topic.

mod applied;
mod derivatives;
mod in_python;
mod interruption;
mod memory;
mod outcome;
mod pickling;
mod quantities;
mod randomize;
mod rays;
mod recording;
mod rollout;
mod sensing;
mod state;
mod stepping;

use std::ops::{Deref, DerefMut};

use numpy::{PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::{PyIndexError, PyRuntimeError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use stepper_core::{Precision, Simulation};

use crate::arguments::{Env, Whole, no_others};
use crate::array::{assign_attribute, check_shape_of, described, float64_array, hint, read_only, shaped, whole};
use crate::derived_arrays::DerivedArrays;
use crate::device_models::{drives, transfers};
use crate::error::value_error;
use crate::getters::getters;
use crate::model::Model;
use crate::options::settings;
use crate::selection::{Numbers, Selection};

/// Batch of environments of one model.
///
/// Calls release the GIL while they step, unless they take only a few microseconds. A pickle includes the state.
///
/// Args:
///     model: Model of the scene.
///     num_envs: Number of environments. None makes a single environment, whose arrays do not have the leading axis.
///     options: Settings of the step. None uses `Options()`.
///     precision: Floating-point precision: "f64", "f32", or a NumPy type such as `np.float32`.
///     threads: Number of threads; 0 uses all processors of this process. Results do not depend on the number of threads.
///     seed: Seed of the random sensor errors.
///     sensors: Sensor model. None simulates ideal sensors.
///     actuators: Actuator model between controls and forces. None simulates ideal actuators.
///
/// Raises:
///     ValueError: A setting is out of range.
///     TypeError: A setting has the wrong type.
///     MemoryError: The memory is too small for the environments.
#[pyclass(module = "stepper._stepper", weakref)]
pub(crate) struct Stepper {
    simulation: Simulation,
    model: Py<Model>,
    options: Py<PyAny>,
    batched: bool,
    threads: usize,
    seed: u64,
    /// Writable arrays that each step reads, in the order of [`AppliedInput::ALL`](stepper_core::AppliedInput::ALL).
    applied: [Option<Py<PyUntypedArray>>; 5],
    derived: DerivedArrays,
    recorder: Option<Py<PyAny>>,
    sensors: Option<Py<PyAny>>,
    actuators: Option<Py<PyAny>>,
}

impl Stepper {
    fn n(&self) -> usize {
        self.simulation.num_envs()
    }

    /// Shape of an array with a value of shape `tail` per environment: (num_envs, *tail), or `tail` alone if the stepper was created
    /// without `num_envs`.
    pub(crate) fn shape(&self, tail: &[usize]) -> Vec<usize> {
        let lead = self.batched.then(|| self.n());
        lead.into_iter().chain(tail.iter().copied()).collect()
    }

    fn env(&self, Env(env): Env) -> PyResult<usize> {
        let n = self.n() as isize;
        if (0..n).contains(&env) {
            return Ok(env as usize);
        }
        let floor = if env < 0 { ", and at least 0" } else { "" };
        Err(PyIndexError::new_err(format!("env is {env}, must be below {n}{floor}")))
    }

    fn per_env<'py, T: numpy::Element>(&self, py: Python<'py>, read: impl Fn(usize) -> T) -> PyResult<Bound<'py, PyAny>> {
        let values = shaped(py, &self.shape(&[]), (0..self.n()).map(read).collect())?;
        // A single environment gives a scalar instead of an array without axes.
        if self.batched { read_only(values) } else { values.call_method0("item") }
    }

    /// Read-only array of numbers of the environments, one environment after the other: (num_envs, *tail).
    fn counts<'py>(&self, py: Python<'py>, tail: &[usize], counts: impl Iterator<Item = u32>) -> PyResult<Bound<'py, PyAny>> {
        read_only(shaped(py, &self.shape(tail), counts.collect())?)
    }

    /// Selection of environments by an argument `envs`. None selects all environments.
    fn selection(&self, envs: Option<&Bound<'_, PyAny>>) -> PyResult<Selection> {
        Selection::of(envs, self.n())
    }

    /// Numbers of the array argument `name`, with a row for each environment of the batch, or a single row for all if `is_shared` allows
    /// it.
    ///
    /// The argument has the shape (k, *tail) if k environments were selected by indices, otherwise (num_envs, *tail). Without an axis of
    /// environments it has the shape `tail`, and so has a single row for all. Rows of unselected environments have no meaning.
    fn selected_rows<'py>(
        &self,
        given: &Bound<'py, PyAny>,
        name: &str,
        tail: &[usize],
        is_shared: bool,
        selection: &Selection,
    ) -> PyResult<Numbers<'py>> {
        if !self.batched && !selection.by_index {
            let numbers = float64_array(given, name)?;
            check_shape_of(given, name, numbers.shape(), &[tail])?;
            return Ok(Numbers::Given(numbers));
        }
        selection.numbers(given, name, &[&[self.n()], tail].concat(), is_shared.then_some(tail))
    }

    /// Controls from the argument `ctrl`: rows (num_envs, nu), or a single row (nu,) for all environments.
    fn control_rows<'py>(&self, given: &Bound<'py, PyAny>, selection: &Selection) -> PyResult<Numbers<'py>> {
        self.selected_rows(given, "ctrl", &[self.simulation.model().nu()], true, selection)
    }
}

/// Borrow of a stepper by a method: [`Reading`] or [`Writing`].
pub(crate) struct Borrowed<B>(B);

/// Shared borrow of a stepper for reading. The borrow fails with an error while another thread has an exclusive borrow, as during a step.
pub(crate) type Reading<'py> = Borrowed<PyRef<'py, Stepper>>;

/// Exclusive borrow of a stepper for writing. The borrow fails with an error while another thread uses the stepper.
pub(crate) type Writing<'py> = Borrowed<PyRefMut<'py, Stepper>>;

impl<'py> TryFrom<&Bound<'py, Stepper>> for Reading<'py> {
    type Error = PyErr;

    fn try_from(slf: &Bound<'py, Stepper>) -> PyResult<Self> {
        slf.try_borrow().map(Self).map_err(|_| PyRuntimeError::new_err(BUSY))
    }
}

impl<'py> TryFrom<&Bound<'py, Stepper>> for Writing<'py> {
    type Error = PyErr;

    fn try_from(slf: &Bound<'py, Stepper>) -> PyResult<Self> {
        slf.try_borrow_mut().map(Self).map_err(|_| PyRuntimeError::new_err(BUSY))
    }
}

impl<B: Deref<Target = Stepper>> Deref for Borrowed<B> {
    type Target = Stepper;

    fn deref(&self) -> &Stepper {
        &self.0
    }
}

impl<B: DerefMut<Target = Stepper>> DerefMut for Borrowed<B> {
    fn deref_mut(&mut self) -> &mut Stepper {
        &mut self.0
    }
}

const BUSY: &str = "another thread uses this Stepper; wait until its call has returned, or use one Stepper per thread";

#[pymethods]
impl Stepper {
    #[new]
    #[pyo3(signature = (model, num_envs=None, *, options=None, precision=None, threads=Whole::Number(1), seed=Whole::Number(0), sensors=None, actuators=None, **others), text_signature = "(model, num_envs=None, *, options=None, precision='f64', threads=1, seed=0, sensors=None, actuators=None)")]
    #[expect(clippy::too_many_arguments, reason = "Python's keywords")]
    fn new(
        py: Python<'_>,
        model: Bound<'_, PyAny>,
        num_envs: Option<Bound<'_, PyAny>>,
        options: Option<Bound<'_, PyAny>>,
        precision: Option<Bound<'_, PyAny>>,
        threads: Whole<'_>,
        seed: Whole<'_>,
        sensors: Option<Bound<'_, PyAny>>,
        actuators: Option<Bound<'_, PyAny>>,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let known = ["model", "num_envs", "options", "precision", "threads", "seed", "sensors", "actuators"];
        no_others("stepper.Stepper", others, &known)?;
        let Ok(model) = model.cast::<Model>().map(|model| model.clone().unbind()) else {
            let message = format!("model is {}, must be a stepper.Model: stepper.load(...) returns one", described(&model));
            return Err(PyTypeError::new_err(message));
        };
        let num_envs = num_envs.map(|n| whole(&n, "num_envs", 1)).transpose()?.map(|n| n as usize);
        let (threads, seed) = (threads.from(0, "threads")? as usize, seed.from(0, "seed")?);
        let precision = match precision {
            Some(given) => py.import("stepper._options")?.call_method1("precision_of", (given,))?.extract::<String>()?,
            None => Precision::F64.name().into(),
        };
        let precision = if precision == Precision::F32.name() { Precision::F32 } else { Precision::F64 };
        let options = match options {
            Some(given) => given,
            None => py.import("stepper")?.getattr("Options")?.call0()?,
        };
        let core = model.get().core.clone();
        let settings = settings(&options)?;
        let mut simulation = Simulation::new(core, settings, num_envs, precision, threads).map_err(value_error)?;
        let n = simulation.num_envs();
        if let Some(actuators) = &actuators {
            simulation.set_actuator_models(&drives(actuators, &model, n, None)?).map_err(value_error)?;
        }
        (0..n).for_each(|env| simulation.begin_episode(env, Some(seed)));
        if let Some(sensors) = &sensors {
            simulation.set_sensor_models(&transfers(sensors, &model, n)?).map_err(value_error)?;
        }
        Ok(Self {
            simulation,
            model,
            options: options.unbind(),
            batched: num_envs.is_some(),
            threads,
            seed,
            applied: [const { None }; 5],
            derived: DerivedArrays::default(),
            recorder: None,
            sensors: sensors.map(Bound::unbind),
            actuators: actuators.map(Bound::unbind),
        })
    }

    fn __getattr__(slf: &Bound<'_, Self>, name: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
        Err(hint(slf, "no_attribute", name)?)
    }

    fn __setattr__(slf: &Bound<'_, Self>, name: &Bound<'_, PyAny>, value: &Bound<'_, PyAny>) -> PyResult<()> {
        assign_attribute(slf, name, value)
    }

    fn __repr__(slf: Reading<'_>) -> String {
        let envs = if slf.batched { format!("{} environments", slf.n()) } else { "one environment".into() };
        format!("<stepper.Stepper: {envs} of \"{}\", {} s>", slf.simulation.model().name, slf.simulation.timestep())
    }
}

getters! { Stepper, |slf, _py| (Reading<'_>);
    /// Number of environments. None means a single environment, whose arrays do not have the leading axis.
    num_envs -> Option<usize> { slf.batched.then(|| slf.n()) }
    /// Current time step, s.
    timestep -> f64 { slf.simulation.timestep() }
    /// Current tolerance of the solver: the largest residual at which it stops, m/s (see `Options.tolerance` and `Options.rtol`).
    tolerance -> f64 { slf.simulation.tolerance() }
    /// Floating-point precision: "f64" or "f32".
    precision -> &'static str { slf.simulation.precision().name() }
    /// Number of threads; 0 uses all processors of this process.
    threads -> usize { slf.threads }
    /// Seed of the random sensor errors.
    seed -> u64 { slf.seed }
}

getters! { Stepper, |slf, py| (Reading<'_>);
    /// Model of the scene.
    model -> Py<Model> { slf.model.clone_ref(py) }
    /// Settings of the step, as given at construction.
    options -> Py<PyAny> { slf.options.clone_ref(py) }
    /// Actuator model given at construction. None means ideal actuators. After changes by `randomize`, the attribute
    /// `randomized` has the current drives.
    actuators -> Option<Py<PyAny>> { slf.actuators.as_ref().map(|a| a.clone_ref(py)) }
    /// Sensor model given at construction. None means ideal sensors.
    sensors -> Option<Py<PyAny>> { slf.sensors.as_ref().map(|s| s.clone_ref(py)) }
    /// Recorder that is notified of `step`, `reset`, `set_state` and `randomize` (see `stepper.Recorder`). None means that no recorder is
    /// set.
    recorder -> Option<Py<PyAny>> { slf.recorder.as_ref().map(|r| r.clone_ref(py)) }
    /// Parameters per environment, as a dictionary of arguments of `randomize`: arrays by field, and an `ActuatorModel` as "actuators".
    randomized -> PyResult<Bound<'py, PyDict>> { slf.parameters(py) }
}
