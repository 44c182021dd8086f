//! `stepper.Stepper`.

use std::path::PathBuf;

use numpy::{PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::PyTypeInfo;
use pyo3::exceptions::{PyIndexError, PyKeyboardInterrupt, PyOverflowError, PyRuntimeError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyTuple};
use stepper_core::actuation::ActuatorSpec;
use stepper_core::sensing::errors::Transfer;
use stepper_core::{Error, Field, Precision, SavedState, Simulation, StepInputs};

use crate::array::{array, assign_attribute, check_shape, described, hint, read_only, readonly, shape_text, whole, with_numbers};
use crate::contacts::structured;
use crate::error::value_error;
use crate::model::Model;
use crate::options::{settings, unknown};
use crate::state::State;

/// Environments of one model, stepped together. The GIL is released while stepping. Pickles with its state.
///
/// Args:
///     model: The scene.
///     num_envs: Number of environments; None is a single one, without the leading axis.
///     options: Settings of the step; None is `Options()`.
///     precision: "f64" or "f32".
///     threads: Threads that step; 0 is all that this process may use. The bits are the same for any number.
///     seed: For what is random: the errors of sensors.
///     sensors: What sensors make of the truth; None is ideal ones.
///     actuators: What becomes of controls before they are forces; None is ideal actuators.
///
/// Raises:
///     ValueError: A setting out of its range.
///     TypeError: A setting of the wrong type.
///     MemoryError: More environments than there is memory for.
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
    applied: [Option<Py<PyArrayDyn<f64>>>; 4],
    pub(crate) copies: Copies,
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

/// An environment as it was given: negative from the end, and never too large to say so.
#[derive(Clone, Copy)]
struct Env(isize);

impl<'a, 'py> FromPyObject<'a, 'py> for Env {
    type Error = PyErr;

    fn extract(given: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        match given.extract::<isize>() {
            Err(error) if error.is_instance_of::<PyOverflowError>(given.py()) => Ok(Self(isize::MAX)),
            found => found.map(Self),
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

impl Applied {
    const ALL: [Self; 4] = [Self::Qfrc, Self::Xfrc, Self::MocapPos, Self::MocapQuat];

    fn name(self) -> &'static str {
        ["qfrc_applied", "xfrc_applied", "mocap_pos", "mocap_quat"][self as usize]
    }
}

/// Arrays that Python has too, copied while no other thread of Python runs: what the core reads while others may write to them.
#[derive(Default)]
pub(crate) struct Copies {
    applied: [Vec<f64>; 4],
}

impl Copies {
    /// With controls, what the core reads.
    pub(crate) fn inputs<'a>(&'a self, ctrl: &'a [f64]) -> StepInputs<'a> {
        let [qfrc, xfrc, mocap_pos, mocap_quat] = &self.applied;
        StepInputs { ctrl, qfrc, xfrc, mocap_pos, mocap_quat }
    }

    fn len(&self) -> usize {
        self.applied.iter().map(Vec::len).sum()
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

    fn env(&self, Env(env): Env) -> PyResult<usize> {
        let n = self.n() as isize;
        let at = if env < 0 { env.saturating_add(n) } else { env };
        if (0..n).contains(&at) { Ok(at as usize) } else { Err(PyIndexError::new_err(format!("env is {env}, must be below {n}"))) }
    }

    fn gather<'py>(&self, py: Python<'py>, field: Field, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let width = self.width(field);
        let mut data = vec![0.0; self.n() * width];
        if width > 0 {
            data.chunks_exact_mut(width)
                .enumerate()
                .for_each(|(env, row)| self.simulation.get(field, env, row).expect("a row of an environment"));
        }
        read_only(array(py, &self.shape(&[width]), data, self.precision)?, name)
    }

    fn per_env<'py, T: numpy::Element>(&self, py: Python<'py>, name: &str, read: impl Fn(usize) -> T) -> PyResult<Bound<'py, PyAny>> {
        let data: Vec<T> = (0..self.n()).map(read).collect();
        let shape = self.shape(&[]);
        let out = numpy::PyArray1::from_vec(py, data).reshape(shape)?;
        // A single environment answers with a scalar, not with an array without axes.
        if self.batched { read_only(out.into_any(), name) } else { out.call_method0("item") }
    }

    /// Numbers per environment of a field of the state.
    fn width(&self, field: Field) -> usize {
        let model = self.simulation.model();
        match field {
            Field::Qpos => model.nq(),
            Field::Qvel => model.nv(),
            Field::Act => model.na(),
        }
    }

    /// Environments named by a mask, all without one.
    fn chosen(&self, mask: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<usize>> {
        let Some(mask) = mask else { return Ok((0..self.n()).collect()) };
        let numpy = mask.py().import("numpy")?;
        let mask = numpy.call_method1("asarray", (mask,))?;
        if mask.getattr("dtype")?.getattr("kind")?.extract::<String>()? != "b" {
            let (dtype, n) = (mask.getattr("dtype")?, self.n());
            return Err(PyValueError::new_err(format!(
                "mask has dtype {dtype}, must be bool, a truth for every environment: for indices, mask = np.isin(np.arange({n}), indices)"
            )));
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
        let width = self.width(field);
        let name = match field {
            Field::Qpos => "qpos",
            Field::Qvel => "qvel",
            Field::Act => "act",
        };
        let given = self.rows(given, name, width)?;
        let (data, shared) = (given.as_slice()?, given.ndim() == 1);
        let row = |env: usize| if shared { data } else { &data[env * width..(env + 1) * width] };
        envs.iter().map(|&env| self.simulation.check(field, env, row(env)).map_err(value_error)).collect()
    }

    fn write(&mut self, field: Field, rows: &[Vec<f64>], envs: &[usize], cold: bool) -> PyResult<()> {
        let set = if cold { Simulation::set } else { Simulation::correct };
        envs.iter().zip(rows).try_for_each(|(&env, row)| set(&mut self.simulation, field, env, row).map_err(value_error))
    }

    /// A time for each of the environments `envs`, s, checked; none when nothing is given.
    fn times(&self, given: Option<&Bound<'_, PyAny>>, envs: &[usize]) -> PyResult<Vec<f64>> {
        let Some(given) = given else { return Ok(Vec::new()) };
        let given = readonly(given, "time")?;
        if given.len() != 1 {
            check_shape("time", given.shape(), &[&[self.n()], &[]])?;
        }
        let times = given.as_slice()?;
        let time = |&env: &usize| match times[if times.len() == 1 { 0 } else { env }] {
            time if time.is_finite() => Ok(time),
            time => Err(PyValueError::new_err(format!("time of environment {env} is {time}, must be finite"))),
        };
        envs.iter().map(time).collect()
    }

    fn nmocap(&self) -> usize {
        self.simulation.model().bodies.iter().filter(|b| b.mocap).count()
    }

    /// Trailing axes and contents at reset of a writable array: no forces, and mocap bodies where the model has them.
    fn unapplied(&self, which: Applied) -> (Vec<usize>, Vec<f64>) {
        let model = self.simulation.model();
        let mocap = || model.bodies.iter().filter(|b| b.mocap);
        match which {
            Applied::Qfrc => (vec![model.nv()], vec![0.0; model.nv()]),
            Applied::Xfrc => (vec![model.bodies.len(), 6], vec![0.0; 6 * model.bodies.len()]),
            Applied::MocapPos => (vec![self.nmocap(), 3], mocap().flat_map(|b| b.pos).collect()),
            Applied::MocapQuat => (vec![self.nmocap(), 4], mocap().flat_map(|b| b.quat).collect()),
        }
    }

    /// Puts the rows of some environments in the writable arrays back to what they are at reset.
    fn reset_applied(&mut self, py: Python<'_>, envs: &[usize]) -> PyResult<()> {
        for which in Applied::ALL {
            let Some(array) = self.made(py, which)? else { continue };
            let (_, row) = self.unapplied(which);
            let mut array = array.try_readwrite().map_err(|e| PyValueError::new_err(format!("{}: {e}", which.name())))?;
            let numbers = array.as_slice_mut()?;
            envs.iter().for_each(|&env| numbers[env * row.len()..][..row.len()].copy_from_slice(&row));
        }
        Ok(())
    }

    /// The writable array, if it was made; an error if the user has made something else of it.
    fn made<'py>(&self, py: Python<'py>, which: Applied) -> PyResult<Option<Bound<'py, PyArrayDyn<f64>>>> {
        let Some(array) = &self.applied[which as usize] else { return Ok(None) };
        let (array, shape) = (array.bind(py), self.shape(&self.unapplied(which).0));
        // It was of this type, but NumPy lets whoever has an array give it another.
        match array.as_any().cast::<PyArrayDyn<f64>>() {
            Ok(array) if array.shape() == shape && array.is_c_contiguous() => Ok(Some(array.clone())),
            _ => {
                let (name, shape) = (which.name(), shape_text(&shape));
                Err(PyValueError::new_err(format!("{name} is no longer a plain float64 array {shape}: assign to its elements instead")))
            }
        }
    }

    /// The writable array, made at its first use.
    fn applied<'py>(&mut self, py: Python<'py>, which: Applied) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        if self.applied[which as usize].is_none() {
            let (tail, row) = self.unapplied(which);
            let all = row.repeat(self.n());
            let made = numpy::PyArray1::from_vec(py, all).reshape(self.shape(&tail))?;
            self.applied[which as usize] = Some(made.unbind());
        }
        Ok(self.applied[which as usize].as_ref().expect("made above").bind(py).clone())
    }

    /// Checks controls and keeps them if they are `used`: those that no step is made with were never in force. Without any, those
    /// before stay.
    fn take_control(&mut self, given: Option<&Bound<'_, PyAny>>, used: bool) -> PyResult<()> {
        let Some(given) = given else { return Ok(()) };
        let (n, nu) = (self.n(), self.simulation.model().nu());
        let taken = with_numbers(given, |shape, numbers| {
            let fits = matches!(*shape, [row] if row == nu) || (self.batched && matches!(*shape, [rows, row] if rows == n && row == nu));
            if fits && used {
                self.simulation.hold(numbers).expect("checked above");
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
            self.simulation.hold(rows.as_slice()?).map_err(value_error)?;
        }
        Ok(())
    }

    /// Makes `nstep` steps with the controls that are held and what the user applies, fewer when a signal ends them: then the number
    /// is in it.
    fn advance(&mut self, py: Python<'_>, nstep: usize) -> PyResult<Option<Interrupted>> {
        if self.applied.iter().any(Option::is_some) {
            return self.advance_applied(py, nstep);
        }
        let inputs = StepInputs::default();
        let simulation = &mut self.simulation;
        if nstep <= self.brief {
            return simulation.step(&inputs, nstep).map(|()| None).map_err(value_error);
        }
        py.detach(|| watched(|watch| simulation.step_watched(&inputs, nstep, watch))).map_err(value_error)
    }

    #[cold]
    fn advance_applied(&mut self, py: Python<'_>, nstep: usize) -> PyResult<Option<Interrupted>> {
        self.copy_applied(py)?;
        let (inputs, simulation) = (self.copies.inputs(&[]), &mut self.simulation);
        py.detach(|| watched(|watch| simulation.step_watched(&inputs, nstep, watch))).map_err(value_error)
    }

    /// Positions and orientations of mocap bodies go together: whoever moves a body may leave its orientation alone.
    fn complete_mocap(&mut self, py: Python<'_>) -> PyResult<()> {
        let given = [Applied::MocapPos, Applied::MocapQuat].map(|which| self.applied[which as usize].is_some());
        if given[0] != given[1] {
            self.applied(py, Applied::MocapPos)?;
            self.applied(py, Applied::MocapQuat)?;
        }
        Ok(())
    }

    /// Numbers in the writable arrays that were made, and in their copies.
    pub(crate) fn applied_len(&self, py: Python<'_>) -> usize {
        self.applied.iter().flatten().map(|array| array.bind(py).len()).sum::<usize>() + self.copies.len()
    }

    /// Copies the writable arrays that were made, for the core to read.
    pub(crate) fn copy_applied(&mut self, py: Python<'_>) -> PyResult<()> {
        self.complete_mocap(py)?;
        for which in Applied::ALL {
            let Some(array) = self.made(py, which)? else { continue };
            let array = array.try_readonly().map_err(|e| PyValueError::new_err(format!("{}: {e}", which.name())))?;
            let copy = &mut self.copies.applied[which as usize];
            copy.clear();
            copy.extend_from_slice(array.as_slice()?);
        }
        Ok(())
    }

    /// Replaces the contents of a writable array.
    fn assign(&mut self, py: Python<'_>, which: Applied, value: &Bound<'_, PyAny>) -> PyResult<()> {
        self.applied(py, which)?;
        self.made(py, which)?.expect("made above").set_item(py.Ellipsis(), value)
    }

    /// Readings of all sensors of all environments.
    fn sense(&mut self, py: Python<'_>, truth: bool) -> PyResult<Vec<f64>> {
        self.copy_applied(py)?;
        let mut out = vec![0.0; self.n() * self.simulation.model().nsensordata()];
        let (inputs, simulation) = (self.copies.inputs(&[]), &mut self.simulation);
        py.detach(|| simulation.sense(&inputs, truth, &mut out)).map_err(value_error)?;
        Ok(out)
    }

    fn readings<'py>(&mut self, py: Python<'py>, truth: bool) -> PyResult<Bound<'py, PyAny>> {
        let data = self.sense(py, truth)?;
        array(py, &self.shape(&[self.simulation.model().nsensordata()]), data, self.precision)
    }

    /// Positions (0) or orientations (1) of all bodies.
    fn poses<'py>(&mut self, py: Python<'py>, which: usize, name: &str) -> PyResult<Bound<'py, PyAny>> {
        self.copy_applied(py)?;
        let mut found = self.simulation.body_poses(&self.copies.inputs(&[])).map_err(value_error)?;
        let shape = self.shape(&[self.simulation.model().bodies.len(), 3 + which]);
        read_only(array(py, &shape, std::mem::take(&mut found[which]), self.precision)?, name)
    }

    fn snapshot(&self, py: Python<'_>, env: Env) -> PyResult<stepper_core::analysis::quantities::Snapshot> {
        let env = self.env(env)?;
        let model = self.simulation.model();
        let row = |which: Applied, width: usize| -> PyResult<Vec<f64>> {
            let Some(array) = self.made(py, which)? else { return Ok(Vec::new()) };
            let array = array.try_readonly().map_err(|e| PyValueError::new_err(format!("{}: {e}", which.name())))?;
            Ok(array.as_slice()?[env * width..(env + 1) * width].to_vec())
        };
        let (qfrc, xfrc) = (row(Applied::Qfrc, model.nv())?, row(Applied::Xfrc, 6 * model.bodies.len())?);
        let (mocap_pos, mocap_quat) = (row(Applied::MocapPos, 3 * self.nmocap())?, row(Applied::MocapQuat, 4 * self.nmocap())?);
        let given = mocap_pos.is_empty() || mocap_quat.is_empty();
        let inputs = StepInputs {
            ctrl: &[],
            qfrc: &qfrc,
            xfrc: &xfrc,
            mocap_pos: if given { &[] } else { &mocap_pos },
            mocap_quat: if given { &[] } else { &mocap_quat },
        };
        self.simulation.snapshot(env, &inputs).map_err(value_error)
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
) -> PyResult<Vec<Option<ActuatorSpec>>> {
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

/// A call that a signal has ended.
#[derive(Debug)]
pub(crate) struct Interrupted {
    /// Steps that every environment has made.
    pub(crate) steps: usize,
    /// What the handler of the signal raised.
    error: PyErr,
}

impl Interrupted {
    /// The exception, which says how far the call came: `steps` is its attribute, and in its message or a note.
    pub(crate) fn raise(self, py: Python<'_>, call: &str, of: usize, also: &str) -> PyErr {
        let Self { steps, error } = self;
        let message = format!("{call} was interrupted after {steps} of {of} steps, in every environment{also}");
        let plain = error.get_type(py).is(PyKeyboardInterrupt::type_object(py))
            && error.value(py).str().is_ok_and(|text| text.is_empty().unwrap_or(false));
        let error = if plain { PyKeyboardInterrupt::new_err(message.clone()) } else { error };
        let value = error.value(py);
        if !plain {
            let _ = value.call_method1("add_note", (&message,));
        }
        // An exception of a class without attributes goes on without one.
        let _ = value.setattr("steps", steps);
        error
    }
}

/// Makes a call of the core that looks for signals from time to time, on the thread that Python called.
pub(crate) fn watched(call: impl FnOnce(&mut dyn FnMut() -> bool) -> Result<usize, Error>) -> Result<Option<Interrupted>, Error> {
    let mut error = None;
    let steps = call(&mut || match Python::attach(|py| py.check_signals()) {
        Ok(()) => true,
        Err(raised) => {
            error = Some(raised);
            false
        }
    })?;
    Ok(error.map(|error| Interrupted { steps, error }))
}

/// Degrees of freedom times steps that take so short, two or three microseconds, that letting other threads of Python run
/// meanwhile costs more than it gives.
const BRIEF: usize = 10;

/// The stepper, to be written to by one thread at a time.
fn borrow<'py>(slf: &Bound<'py, Stepper>) -> PyResult<PyRefMut<'py, Stepper>> {
    slf.try_borrow_mut().map_err(|_| PyRuntimeError::new_err(BUSY))
}

const BUSY: &str = "this Stepper is at work in another thread; give every thread its own, or wait for it";

/// Whom to tell what is done, taken while the stepper is borrowed: another thread may have it next.
fn recorder_of(py: Python<'_>, this: PyRefMut<'_, Stepper>) -> Option<Py<PyAny>> {
    this.recorder.as_ref().map(|r| r.clone_ref(py))
}

/// Tells the recorder, if there is one, what was done, with the arguments that were given.
fn notify(slf: &Bound<'_, Stepper>, recorder: Option<Py<PyAny>>, what: &str, given: &[(&str, Option<Bound<'_, PyAny>>)]) -> PyResult<()> {
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
    let ctrl = array(py, &[this.n(), this.simulation.model().nu()], this.simulation.ctrl().to_vec(), Precision::F64)?;
    let applied = this.applied.iter().map(|a| a.as_ref().map(|a| a.clone_ref(py))).collect::<Vec<_>>().into_pyobject(py)?;
    let recorder = recorder_of(py, this);
    notify(slf, recorder, "step", &[("ctrl", Some(ctrl)), ("nstep", Some(nstep.into_pyobject(py)?.into_any())), ("applied", Some(applied))])
}

/// What becomes of a step that a signal has ended: the recorder is told of the steps that were made.
#[cold]
fn end_early(slf: &Bound<'_, Stepper>, this: PyRefMut<'_, Stepper>, interrupted: Interrupted, nstep: usize) -> PyErr {
    let (py, made) = (slf.py(), interrupted.steps);
    let mut also = "";
    if this.recorder.is_some() {
        if this.applied[Applied::MocapPos as usize].is_some() {
            also =
                "; mocap bodies that were on their way had not arrived, and the recording has them arrive: it replays up to this call only";
        }
        if let Err(error) = tell_of_step(slf, this, made) {
            return error;
        }
    }
    interrupted.raise(py, "step", nstep, also)
}

#[pymethods]
impl Stepper {
    #[new]
    #[pyo3(signature = (model, num_envs=None, *, options=None, precision="f64", threads=Whole::Number(1), seed=Whole::Number(0), sensors=None, actuators=None), text_signature = "(model, num_envs=None, *, options=None, precision='f64', threads=1, seed=0, sensors=None, actuators=None)")]
    #[expect(clippy::too_many_arguments, reason = "Python's keywords")]
    fn new(
        py: Python<'_>,
        model: Bound<'_, PyAny>,
        num_envs: Option<Bound<'_, PyAny>>,
        options: Option<Bound<'_, PyAny>>,
        precision: &str,
        threads: Whole<'_>,
        seed: Whole<'_>,
        sensors: Option<Bound<'_, PyAny>>,
        actuators: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let Ok(model) = model.cast::<Model>().map(|model| model.clone().unbind()) else {
            let message = format!("model is {}, must be a stepper.Model: stepper.load(...) makes one of it", described(&model));
            return Err(PyTypeError::new_err(message));
        };
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
        let settings = settings(&options)?;
        let nv = core.nv();
        let mut simulation = Simulation::new(core, settings, num_envs, precision, threads).map_err(value_error)?;
        let n = simulation.num_envs();
        if let Some(actuators) = &actuators {
            simulation.set_actuator_models(&drives(actuators, &model, n, None)?).map_err(value_error)?;
        }
        (0..n).for_each(|env| simulation.begin(env, Some(seed)));
        if let Some(sensors) = &sensors {
            simulation.set_sensor_models(&transfers(sensors, &model, n)?).map_err(value_error)?;
        }
        let brief = BRIEF / (n * nv.max(1));
        let (applied, copies) = ([const { None }; 4], Copies::default());
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
            applied,
            copies,
            recorder: None,
            sensors: sensors.map(Bound::unbind),
            actuators: actuators.map(Bound::unbind),
        })
    }

    /// Starts a new episode in all environments, or in those of a boolean mask (num_envs,). Nothing of the old one remains.
    ///
    /// Forces that are applied end, mocap bodies go back to where the model has them, and controls in force are zero, or the
    /// keyframe's, until `step` takes others. Parameters of `randomize` stay.
    ///
    /// Args:
    ///     mask: Which environments; None is all.
    ///     qpos: Where they start, (num_envs, nq) or (nq,); None is the model's reference. Quaternions are normalised.
    ///     qvel: How fast, (num_envs, nv) or (nv,); None is at rest.
    ///     seed: A new seed; None keeps the old one.
    ///     keyframe: Name or index of a keyframe to start from: its qpos, qvel, act, ctrl and time.
    ///
    /// Raises:
    ///     ValueError: A wrong shape, a number that is not finite, a quaternion of zeros. Nothing is changed then.
    ///     KeyError: No such keyframe.
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
        // Everything is checked before anything is changed.
        let q = this.checked(Field::Qpos, qpos.as_ref(), &envs)?;
        let v = this.checked(Field::Qvel, qvel.as_ref(), &envs)?;
        let key = keyframe.as_ref().map(|name| this.model.get().find_keyframe(name)).transpose()?;
        this.seed = seed;
        for &env in &envs {
            this.simulation.reset(env);
            if given_seed.is_some() {
                this.simulation.begin(env, Some(seed));
            }
            if let Some(key) = &key {
                this.simulation.start_from(env, key).map_err(value_error)?;
            }
        }
        this.write(Field::Qpos, &q, &envs, true)?;
        this.write(Field::Qvel, &v, &envs, true)?;
        this.reset_applied(slf.py(), &envs)?;
        let recorder = recorder_of(slf.py(), this);
        notify(slf, recorder, "reset", &[("mask", mask), ("qpos", qpos), ("qvel", qvel), ("seed", given_seed), ("keyframe", keyframe)])
    }

    /// Makes `nstep` steps in every environment.
    ///
    /// Args:
    ///     ctrl: Controls, (num_envs, nu) or (nu,) for all, held until others are given; None holds those in force (`Stepper.ctrl`),
    ///         as MuJoCo does.
    ///     nstep: Number of steps.
    ///
    /// Raises:
    ///     ValueError: A wrong shape; the message has both. A control that is NaN is no error: its environment keeps its state and
    ///         says NON_FINITE in `status`.
    ///     KeyboardInterrupt: Ctrl-C in a long call, which looks for signals some twenty times a second. Every environment has then
    ///         made the same number of steps, the exception's `steps`, and all is as a call with that `nstep` leaves it; but mocap
    ///         bodies are where their way has brought them, and a recording in which they were under way replays up to this call
    ///         only. What another signal's handler raises ends the call alike.
    #[pyo3(signature = (ctrl=None, nstep=Whole::Number(1)), text_signature = "($self, ctrl=None, nstep=1)")]
    fn step(slf: &Bound<'_, Self>, ctrl: Option<&Bound<'_, PyAny>>, nstep: Whole<'_>) -> PyResult<()> {
        let mut this = borrow(slf)?;
        let nstep = nstep.from(0, "nstep")? as usize;
        this.take_control(ctrl, nstep > 0)?;
        let interrupted = this.advance(slf.py(), nstep)?;
        if let Some(interrupted) = interrupted {
            return Err(end_early(slf, this, interrupted, nstep));
        }
        if this.recorder.is_none() { Ok(()) } else { tell_of_step(slf, this, nstep) }
    }

    /// Makes `nstep` steps with each of T controls, without Python in between: the bits of T calls of `step`.
    ///
    /// A thread keeps its environments for all T controls. `qfrc_applied`, `xfrc_applied` and mocap poses stay as they are
    /// throughout.
    ///
    /// Args:
    ///     ctrl: Controls, (T, num_envs, nu), or (T, nu) for all environments.
    ///     nstep: Steps that each control is held.
    ///     fields: What to write down after every control: "qpos" (T, num_envs, nq), "qvel" (T, num_envs, nv), "act" (T, num_envs,
    ///         na), "observation" (T, num_envs, nsensordata). None is what `out` names, and without `out` all but "act".
    ///     out: Arrays to write into, by field: of those shapes, C-contiguous, float64, or float32 with `precision="f32"`.
    ///
    /// Returns:
    ///     The arrays by field; and always "status" (T, num_envs) uint32, the flags of all steps of a control, and "residual"
    ///     (T, num_envs) float64, the largest residual among them in m/s. Both can be named in `out` too. Afterwards `status` has the
    ///     flags of all steps of the call, `residual` and `iterations` are those of the last step.
    ///
    /// Raises:
    ///     ValueError: A wrong shape, an unknown field, an array of `out` that cannot be written or is given twice.
    ///     TypeError: An array of `out` of the wrong dtype.
    ///     KeyboardInterrupt: As in `step`; `steps` counts those of all controls. Rows of `out` have what followed each control, of
    ///         the last one what followed the steps that were made; the rows beyond are as they were.
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

    /// Sets configuration, velocity, activations or time; or, given a `State`, everything that survives a step.
    ///
    /// The next state is a function of `qpos`, `qvel`, `act` and the controls; what the solver starts from moves it by some 1e-7 of a
    /// velocity (docs/decisions/visible_state.md). The other memory of an environment is that of its drives (delay lines, lags,
    /// integrals) and sensors (bias, drift, delay lines, samples held).
    ///
    /// Args:
    ///     qpos: (num_envs, nq) or (nq,). Or what `get_state` returned: of a batch of the same size each environment takes its own
    ///         part, of a single environment all take the same. Continuing from a `State` repeats the same bits; where a state of one
    ///         is given to a batch, each environment's sensors draw random numbers of their own from then on.
    ///     qvel: (num_envs, nv) or (nv,).
    ///     mask: Which environments, (num_envs,) bool; None is all. `set_state(get_state(env=3), mask=...)` copies environment 3 to
    ///         others.
    ///     act: (num_envs, na) or (na,).
    ///     time: s, (num_envs,) or one for all.
    ///     cold: Whether the memory is forgotten where qpos, qvel or act are set: impulses that the solver starts from, contacts,
    ///         flags, delay lines (which the next control and reading fill) and errors of sensors, so that what follows depends on
    ///         the new state alone. False keeps it, for whoever corrects the state of an environment that goes on: an observer beside
    ///         its plant. That also saves the time of a start from nothing.
    ///
    /// Raises:
    ///     ValueError: A wrong shape, a number that is not finite, a quaternion of zeros, a state of another model. Nothing is
    ///         changed then.
    #[pyo3(signature = (qpos=None, qvel=None, mask=None, *, act=None, time=None, cold=true), text_signature = "($self, qpos=None, qvel=None, mask=None, *, act=None, time=None, cold=True)")]
    fn set_state(
        slf: &Bound<'_, Self>,
        qpos: Option<Bound<'_, PyAny>>,
        qvel: Option<Bound<'_, PyAny>>,
        mask: Option<Bound<'_, PyAny>>,
        act: Option<Bound<'_, PyAny>>,
        time: Option<Bound<'_, PyAny>>,
        cold: bool,
    ) -> PyResult<()> {
        let mut this = borrow(slf)?;
        let envs = this.chosen(mask.as_ref())?;
        if let Some(state) = qpos.as_ref().and_then(|q| q.cast::<State>().ok()) {
            if qvel.is_some() || act.is_some() || time.is_some() || !cold {
                return Err(PyValueError::new_err("set_state(state) takes a mask and nothing else: a State has all the rest"));
            }
            this.simulation.restore_state_in(&state.get().saved, &envs).map_err(value_error)?;
            let recorder = recorder_of(slf.py(), this);
            return notify(slf, recorder, "set_state", &[("state", qpos)]);
        }
        let fields = [(Field::Qpos, &qpos), (Field::Qvel, &qvel), (Field::Act, &act)];
        let rows = fields.map(|(field, given)| this.checked(field, given.as_ref(), &envs));
        let rows = rows.into_iter().collect::<PyResult<Vec<_>>>()?;
        let times = this.times(time.as_ref(), &envs)?;
        for ((field, _), rows) in fields.iter().zip(&rows) {
            this.write(*field, rows, &envs, cold)?;
        }
        envs.iter().zip(times).try_for_each(|(&env, time)| this.simulation.set_time(env, time)).map_err(value_error)?;
        let recorder = recorder_of(slf.py(), this);
        let cold = (!cold).then(|| pyo3::types::PyBool::new(slf.py(), false).to_owned().into_any());
        notify(slf, recorder, "set_state", &[("mask", mask), ("qpos", qpos), ("qvel", qvel), ("act", act), ("time", time), ("cold", cold)])
    }

    /// Gives environments parameters of their own, as `Model.replace` would give them to a model; what derives from them follows.
    ///
    /// Every environment then moves as one of a `Stepper` of its own model, bit for bit. Parameters are not part of the state:
    /// `reset` and `set_state` leave them, pickles and recordings have them. Other fields stay as they are, whether the model's or
    /// randomized before. What no environment has of its own costs neither time nor memory.
    ///
    /// Args:
    ///     mask: (num_envs,) bool: the environments that change; None is all. Rows of the others are not read.
    ///     **fields: Arrays with num_envs in front of the shape that the field has in the model; None gives the model's own numbers
    ///         back, and so do all fields when none is named: gravity (num_envs, 3) m/s^2; body_mass (num_envs, nbody) kg, body_ipos
    ///         (num_envs, nbody, 3) m, the centre of mass, and body_inertia (num_envs, nbody, 3) kg m^2, principal moments, each by
    ///         itself: a body of twice the mass keeps its inertia unless it is given too; geom_friction (num_envs, ngeom, 3) sliding,
    ///         torsional (m), rolling (m); geom_restitution (num_envs, ngeom); geom_size, geom_pos (num_envs, ngeom, 3) m, which
    ///         leave masses alone; jnt_stiffness (num_envs, njnt) N/m or N m/rad; jnt_range (num_envs, njnt, 2) m or rad;
    ///         dof_damping, dof_armature, dof_frictionloss (num_envs, nv); actuator_gain, actuator_bias (num_envs, nu, 3), whose
    ///         force is gain . (1, length, velocity) times the input plus bias . (1, length, velocity). actuators, a
    ///         `stepper.ActuatorModel`: its drives take the place of those of the actuators it fits, with all their numbers (what a
    ///         `Drive` does not say is its default); other actuators keep theirs, and None gives back what the stepper was made with.
    ///         Stages are compiled: a servo, motor, lag, limits or friction must have been given to `Stepper(..., actuators=)`, to
    ///         one environment at least, and delays may be as long as the longest there. Delay lines, lags and integrals are state:
    ///         they stay as they are until `reset`.
    ///
    /// Raises:
    ///     ValueError: A wrong shape; both are named. A number that a drive may not have, or a stage or delay that it was not made
    ///         for, with the actuator. Nothing is changed then.
    ///     ModelError: A field that all environments share, numbers that no model may have, or that ask for something that the model
    ///         has none of, such as dry friction where it has 0; with field, element and environment. Nothing is changed then.
    #[pyo3(signature = (mask=None, **fields))]
    fn randomize(slf: &Bound<'_, Self>, mask: Option<Bound<'_, PyAny>>, fields: Option<Bound<'_, PyDict>>) -> PyResult<()> {
        let mut this = borrow(slf)?;
        let envs = this.chosen(mask.as_ref())?;
        this.assign_parameters(fields.as_ref(), &envs)?;
        let recorder = recorder_of(slf.py(), this);
        notify(slf, recorder, "randomize", &[("mask", mask), ("fields", fields.map(Bound::into_any))])
    }

    /// What environments have of their own, as `randomize` takes it: arrays by field, and under "actuators" an `ActuatorModel`.
    #[getter]
    fn randomized<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.parameters(py)
    }

    /// Writes everything that happens from now on into a new folder, until the `Recorder` is closed; `stepper.replay` repeats it.
    ///
    /// Args:
    ///     path: A folder that does not exist yet, or is empty.
    ///     **settings: See `stepper.Recorder`.
    #[pyo3(signature = (path, **settings))]
    fn record<'py>(slf: &Bound<'py, Self>, path: Bound<'py, PyAny>, settings: Option<&Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
        let recorder = slf.py().import("stepper")?.getattr("Recorder")?.call((slf, path), settings)?;
        borrow(slf)?.recorder = Some(recorder.clone().unbind());
        Ok(recorder)
    }

    /// Whom `step`, `reset` and `set_state` tell what they did (see `stepper.Recorder`); None is nobody.
    #[getter]
    fn recorder(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.recorder.as_ref().map(|r| r.clone_ref(py))
    }

    #[setter]
    fn set_recorder(&mut self, recorder: Option<Bound<'_, PyAny>>) -> PyResult<()> {
        let told = ["step", "reset", "set_state", "randomize"];
        if let Some(other) = recorder.as_ref().filter(|r| !told.iter().all(|name| r.hasattr(*name).unwrap_or(false))) {
            let message = format!("recorder is {}, must be None or have the methods {}", described(other), told.join(", "));
            return Err(PyTypeError::new_err(message));
        }
        self.recorder = recorder.map(Bound::unbind);
        Ok(())
    }

    /// Everything that survives a step, the controls in force included.
    ///
    /// What is applied (`qfrc_applied` and the like) and parameters of `randomize` are not part of it.
    ///
    /// Args:
    ///     env: An environment; None is all of them.
    #[pyo3(signature = (env=None))]
    fn get_state(&self, env: Option<Env>) -> PyResult<State> {
        let saved = match env {
            Some(env) => self.simulation.save_state_of(self.env(env)?),
            None => self.simulation.save_state(),
        };
        Ok(State { saved })
    }

    /// The scene.
    #[getter]
    fn model(&self, py: Python<'_>) -> Py<Model> {
        self.model.clone_ref(py)
    }

    /// Settings of the step, as they were given.
    #[getter]
    fn options(&self, py: Python<'_>) -> Py<PyAny> {
        self.options.clone_ref(py)
    }

    /// Number of environments; None is a single one, without the leading axis.
    #[getter]
    pub(crate) fn num_envs(&self) -> Option<usize> {
        self.batched.then(|| self.n())
    }

    /// Time step in force, s.
    #[getter]
    fn timestep(&self) -> f64 {
        self.simulation.timestep()
    }

    /// Residual at which the solver stops, in force, m/s.
    #[getter]
    fn tolerance(&self) -> f64 {
        self.simulation.tolerance()
    }

    /// Scalar type of the lanes: "f64" or "f32".
    #[getter]
    fn precision(&self) -> &'static str {
        if self.precision == Precision::F64 { "f64" } else { "f32" }
    }

    /// Threads that step; 0 is all that this process may use.
    #[getter]
    fn threads(&self) -> usize {
        self.threads
    }

    /// Seed of the errors of sensors.
    #[getter]
    fn seed(&self) -> u64 {
        self.seed
    }

    /// Configuration: (num_envs, nq), m and quaternions and rad. `set_state(qpos=...)` sets it.
    #[getter]
    fn qpos<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.gather(py, Field::Qpos, "qpos")
    }

    /// Velocity: (num_envs, nv), m/s and rad/s. `set_state(qvel=...)` sets it.
    #[getter]
    fn qvel<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.gather(py, Field::Qvel, "qvel")
    }

    /// Activations of actuators: (num_envs, na). `set_state(act=...)` sets them.
    #[getter]
    fn act<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.gather(py, Field::Act, "act")
    }

    /// Controls in force: (num_envs, nu). Those of the last step or the keyframe that an episode began with, zero after any other
    /// reset.
    #[getter]
    fn ctrl<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let held = array(py, &self.shape(&[self.simulation.model().nu()]), self.simulation.ctrl().to_vec(), self.precision)?;
        read_only(held, "ctrl")
    }

    /// Simulated time in s: (num_envs,). `set_state(time=...)` sets it.
    #[getter]
    fn time<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.per_env(py, "time", |env| self.simulation.time(env))
    }

    /// Flags of the last call of `step`, see `stepper.Status`: (num_envs,) uint32.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.per_env(py, "status", |env| self.simulation.status(env).bits())
    }

    /// Natural-map residual of the last step in m/s: (num_envs,).
    #[getter]
    fn residual<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.per_env(py, "residual", |env| self.simulation.certificate(env).residual)
    }

    /// Sweeps and Newton steps of the solver in the last step, together: (num_envs,) uint32.
    #[getter]
    fn iterations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let both = |env| self.simulation.certificate(env).sweeps + self.simulation.certificate(env).newton_steps;
        self.per_env(py, "iterations", both)
    }

    /// Sweeps of the solver in the last step: (num_envs,) uint32.
    #[getter]
    fn sweeps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.per_env(py, "sweeps", |env| self.simulation.certificate(env).sweeps)
    }

    /// Newton steps of the solver in the last step, over all islands of bodies: (num_envs,) uint32.
    #[getter]
    fn newton_steps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.per_env(py, "newton_steps", |env| self.simulation.certificate(env).newton_steps)
    }

    /// Deepest overlap of a contact beyond its margin in the last call of `step`, of all its steps, in m: (num_envs,) float64. It is
    /// seen where a step is taken, by "midpoint" and "rk4" in its middle. Above 1 mm `status` says DEEP.
    #[getter]
    fn depth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.per_env(py, "depth", |env| self.simulation.depth(env))
    }

    /// Farthest that a joint or tendon was beyond its range after a step of the last call of `step`, in rad or m: (num_envs,)
    /// float64. Above 0.01 `status` says OVER_LIMIT.
    #[getter]
    fn limit_overshoot<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.per_env(py, "limit_overshoot", |env| self.simulation.limit_overshoot(env))
    }

    /// Positions of the bodies at the present `qpos`: (num_envs, nbody, 3) in m, of their frames' origins. Body 0 is the world.
    /// MuJoCo's `mj_step` leaves those before the step, `mj_forward` these.
    #[getter]
    fn xpos<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.poses(py, 0, "xpos")
    }

    /// Orientations of the bodies at the present `qpos`: (num_envs, nbody, 4).
    #[getter]
    fn xquat<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.poses(py, 1, "xquat")
    }

    /// Sensor readings of the last step, the same however often they are read: (num_envs, nsensordata). `observe()` gives an array to
    /// write to.
    #[getter]
    fn observation<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        read_only(self.readings(py, false)?, "observation")
    }

    /// The readings of ideal sensors: (num_envs, nsensordata).
    ///
    /// Positions and velocities are those after the last step; accelerations are (v+ - v) / h of that step, impulses of contacts and
    /// limits included, and forces are impulses over h. Where no step was made since the state was set, accelerations and forces are
    /// those of the step that would be made from it.
    #[getter]
    fn sensor_truth<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        read_only(self.readings(py, true)?, "sensor_truth")
    }

    /// Of each sensor, readings that were clipped to its limits and samples that were lost in the last call of `step`:
    /// (num_envs, nsensor, 2) uint32.
    #[getter]
    fn sensor_faults<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let counts: Vec<u32> = (0..self.n()).flat_map(|env| self.simulation.sensor_faults(env)).flatten().collect();
        let shape = self.shape(&[self.simulation.model().sensors.len(), 2]);
        read_only(numpy::PyArray1::from_vec(py, counts).reshape(shape)?.into_any(), "sensor_faults")
    }

    /// Steps of the last call of `step` in which the effort of each actuator was cut to its bounds: its `forcerange`, its joint's
    /// `actuatorfrcrange`, or the limits and torque-speed curve of its drive: (num_envs, nu) uint32.
    #[getter]
    fn actuator_saturation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let counts: Vec<u32> = (0..self.n()).flat_map(|env| self.simulation.actuator_saturation(env)).collect();
        let shape = self.shape(&[self.simulation.model().nu()]);
        read_only(numpy::PyArray1::from_vec(py, counts).reshape(shape)?.into_any(), "actuator_saturation")
    }

    /// What sensors make of the truth.
    #[getter]
    fn sensors(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.sensors.as_ref().map(|s| s.clone_ref(py))
    }

    /// What becomes of controls before they are forces, as the stepper was made; what `randomize` drew since is in `randomized`.
    #[getter]
    fn actuators(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.actuators.as_ref().map(|a| a.clone_ref(py))
    }

    /// `observation`, written into `out` if there is one: (num_envs, nsensordata).
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
                let readings = self.sense(py, false)?;
                let mut out = exact.try_readwrite().map_err(|e| PyValueError::new_err(format!("out: {e}")))?;
                out.as_slice_mut()?.copy_from_slice(&readings);
            }
            _ => out.set_item(py.Ellipsis(), self.readings(py, false)?)?,
        }
        Ok(out)
    }

    /// Writable, read by every step until changed or reset: forces on the joints in N or N m, (num_envs, nv).
    #[getter]
    fn qfrc_applied<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.applied(py, Applied::Qfrc)
    }

    #[setter]
    fn set_qfrc_applied(&mut self, py: Python<'_>, value: Bound<'_, PyAny>) -> PyResult<()> {
        self.assign(py, Applied::Qfrc, &value)
    }

    /// Writable, read by every step until changed or reset: force (N) and torque (N m) at every body's centre of mass, world axes,
    /// (num_envs, nbody, 6).
    #[getter]
    fn xfrc_applied<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.applied(py, Applied::Xfrc)
    }

    #[setter]
    fn set_xfrc_applied(&mut self, py: Python<'_>, value: Bound<'_, PyAny>) -> PyResult<()> {
        self.assign(py, Applied::Xfrc, &value)
    }

    /// Writable, read by every step until changed or reset: positions of the mocap bodies in m, (num_envs, nmocap, 3).
    #[getter]
    fn mocap_pos<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.applied(py, Applied::MocapPos)
    }

    #[setter]
    fn set_mocap_pos(&mut self, py: Python<'_>, value: Bound<'_, PyAny>) -> PyResult<()> {
        self.assign(py, Applied::MocapPos, &value)
    }

    /// Writable, read by every step until changed or reset: orientations of the mocap bodies, (num_envs, nmocap, 4).
    #[getter]
    fn mocap_quat<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.applied(py, Applied::MocapQuat)
    }

    #[setter]
    fn set_mocap_quat(&mut self, py: Python<'_>, value: Bound<'_, PyAny>) -> PyResult<()> {
        self.assign(py, Applied::MocapQuat, &value)
    }

    /// Memory that the environments take, in bytes, without NumPy arrays that were handed out.
    ///
    /// Returns:
    ///     "per_env": of each environment; "per_thread": working room of each thread that steps, none of which is per environment;
    ///     "state", "parameters" and "inputs": what all environments hold, what they have of their own by `randomize` and as numbers
    ///     of drives, and what waits for the next step (controls, applied forces, mocap poses); "threads": how many have room;
    ///     "total": "state" + "parameters" + "inputs" + "threads" x "per_thread".
    fn memory<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.memory_report(py)
    }

    /// Contacts of the last step: those that were given a row.
    ///
    /// That is every one that the motion can close within the step, also contacts that do not touch (distance > 0), mostly without
    /// force. Distances are measured from the margin, at which contacts begin to push. A gap, which in MuJoCo 4 reports contacts
    /// beyond the margin that do not push, has no effect here: what is farther than a step away is not listed.
    ///
    /// Args:
    ///     env: An environment; None is all of them, one after the other.
    ///
    /// Returns:
    ///     A structured array: env, geom (2,), body (2,), pos (3,) in m, normal (3,) from the first geom to the second, distance in m
    ///     from the margin, force (3,) in N on the second geom along normal, t1, t2, torque (3,) in N m on it about the same
    ///     directions, of torsional and rolling friction (condim 4 and 6), and frame (3, 3), whose rows are these directions. The
    ///     second geom's torque acts at pos, and |(force_t / mu_slide, torque_n / mu_spin, torque_t / mu_roll)| <= force_n.
    #[pyo3(signature = (env=None))]
    fn contacts<'py>(&self, py: Python<'py>, env: Option<Env>) -> PyResult<Bound<'py, PyAny>> {
        let envs = match env {
            Some(env) => self.env(env)?..self.env(env)? + 1,
            None => 0..self.n(),
        };
        structured(py, &self.simulation, envs)
    }

    /// The row that the last call of `step` could not solve: where `status` says NOT_CONVERGED, the one with the largest residual in
    /// the last step that was not solved.
    ///
    /// Args:
    ///     env: The environment.
    ///
    /// Returns:
    ///     For example 'contact of geom "floor" and geom "foot"', 'limit of joint "knee"' or 'equality "loop"'; None where every step
    ///     was solved, or no single row is to blame.
    #[pyo3(signature = (env=Env(0)), text_signature = "($self, env=0)")]
    fn worst_row(&self, env: Env) -> PyResult<Option<String>> {
        let row = self.simulation.worst_row(self.env(env)?);
        Ok(row.map(|row| row.describe(self.simulation.model()).to_string()))
    }

    /// Writes the constraint problem of the next step to a file, with the impulses that its solve starts from, so that a hard one becomes
    /// a test of the solver: in Rust, `stepper_solve::Problem::load(path)` reads it.
    ///
    /// The problem is that of a step from the present state, which does not change. For a step that was not solved (NOT_CONVERGED), go
    /// back to the state before it: `before = sim.get_state()` before the step, and then `sim.set_state(before)`.
    ///
    /// Args:
    ///     path: The file; what is there is replaced.
    ///     env: The environment.
    ///     ctrl: Controls of the step, as `step` takes them; None is those in force.
    ///
    /// Raises:
    ///     OSError: The file cannot be written.
    #[pyo3(signature = (path, env=Env(0), *, ctrl=None), text_signature = "($self, path, env=0, *, ctrl=None)")]
    fn save_problem(&mut self, py: Python<'_>, path: PathBuf, env: Env, ctrl: Option<Bound<'_, PyAny>>) -> PyResult<()> {
        let env = self.env(env)?;
        let ctrl = match ctrl {
            Some(ctrl) => self.rows(&ctrl, "ctrl", self.simulation.model().nu())?.as_slice()?.to_vec(),
            None => Vec::new(),
        };
        self.copy_applied(py)?;
        self.simulation.save_problem(env, &self.copies.inputs(&ctrl), path).map_err(value_error)
    }

    /// Mass matrix of the present configuration, (nv, nv), armature included, without terms that depend on the time step.
    #[pyo3(signature = (env=Env(0)), text_signature = "($self, env=0)")]
    fn mass_matrix<'py>(&self, py: Python<'py>, env: Env) -> PyResult<Bound<'py, PyAny>> {
        let nv = self.simulation.model().nv();
        array(py, &[nv, nv], self.snapshot(py, env)?.mass_matrix(&self.simulation.plan_of(self.env(env)?)), Precision::F64)
    }

    /// Coriolis, centrifugal and gravitational forces of the present state, (nv,): MuJoCo's qfrc_bias.
    #[pyo3(signature = (env=Env(0)), text_signature = "($self, env=0)")]
    fn bias_force<'py>(&self, py: Python<'py>, env: Env) -> PyResult<Bound<'py, PyAny>> {
        let out = self.snapshot(py, env)?.bias_force(&self.simulation.plan_of(self.env(env)?));
        array(py, &[out.len()], out, Precision::F64)
    }

    /// Acceleration without constraints in the present state, (nv,): MuJoCo's qacc_smooth.
    ///
    /// Args:
    ///     env: The environment.
    ///     ctrl: Controls, (nu,); None is those in force. With `actuators=`, what the drives hand on to the
    ///         actuators' law (None is what they did last).
    #[pyo3(signature = (env=Env(0), *, ctrl=None), text_signature = "($self, env=0, *, ctrl=None)")]
    fn smooth_acceleration<'py>(&self, py: Python<'py>, env: Env, ctrl: Option<Bound<'py, PyAny>>) -> PyResult<Bound<'py, PyAny>> {
        let mut snapshot = self.snapshot(py, env)?;
        if let Some(ctrl) = ctrl {
            let ctrl = readonly(&ctrl, "ctrl")?;
            check_shape("ctrl", ctrl.shape(), &[&[self.simulation.model().nu()]])?;
            snapshot.inputs.ctrl.copy_from_slice(ctrl.as_slice()?);
        }
        let out = snapshot.smooth_acceleration(&self.simulation.plan_of(self.env(env)?));
        array(py, &[out.len()], out, Precision::F64)
    }

    /// Potential energy (gravity, joint springs) and kinetic energy (armature included), in J.
    #[pyo3(signature = (env=Env(0)), text_signature = "($self, env=0)")]
    fn energy(&self, py: Python<'_>, env: Env) -> PyResult<(f64, f64)> {
        Ok(self.snapshot(py, env)?.energy(&self.simulation.plan_of(self.env(env)?)))
    }

    /// Linear momentum in kg m/s (3,), and angular momentum about the centre of mass in kg m^2/s (3,).
    #[pyo3(signature = (env=Env(0)), text_signature = "($self, env=0)")]
    fn momentum<'py>(&self, py: Python<'py>, env: Env) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let (linear, angular) = self.snapshot(py, env)?.momentum(&self.simulation.plan_of(self.env(env)?));
        Ok((array(py, &[3], linear.to_vec(), Precision::F64)?, array(py, &[3], angular.to_vec(), Precision::F64)?))
    }

    fn __getattr__(slf: &Bound<'_, Self>, name: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
        Err(hint(slf, "no_attribute", name)?)
    }

    fn __setattr__(slf: &Bound<'_, Self>, name: &Bound<'_, PyAny>, value: &Bound<'_, PyAny>) -> PyResult<()> {
        assign_attribute(slf, name, value)
    }

    fn __getstate__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let state = PyDict::new(py);
        state.set_item("state", PyBytes::new(py, &self.simulation.save_state().to_bytes()))?;
        state.set_item("randomized", self.parameters(py)?)?;
        state.set_item("applied", self.applied.iter().map(|a| a.as_ref().map(|a| a.clone_ref(py))).collect::<Vec<_>>())?;
        Ok(state)
    }

    /// Takes copies: `copy.copy` hands on what the original has.
    fn __setstate__(&mut self, py: Python<'_>, state: &Bound<'_, PyDict>) -> PyResult<()> {
        let wrong = |name: &str, what: &str| PyValueError::new_err(format!("pickled Stepper: {name} {what}; pickle it again"));
        let item = |name: &str| state.get_item(name)?.ok_or_else(|| wrong(name, "is missing"));
        let (saved, randomized, applied) = (item("state")?, item("randomized")?, item("applied")?);
        let saved = saved.cast::<PyBytes>().map_err(|_| wrong("state", "is not bytes"))?;
        let saved = SavedState::from_bytes(saved.as_bytes()).map_err(value_error)?;
        let randomized = randomized.cast::<PyDict>().map_err(|_| wrong("randomized", "is not a dict"))?;
        let applied: Vec<Option<Bound<'_, PyAny>>> = applied.extract().map_err(|_| wrong("applied", "is not a list"))?;
        if applied.len() != Applied::ALL.len() {
            return Err(wrong("applied", &format!("has {} arrays, must have {}", applied.len(), Applied::ALL.len())));
        }
        self.simulation.restore_state(&saved).map_err(value_error)?;
        if !randomized.is_empty() {
            let all: Vec<usize> = (0..self.n()).collect();
            self.assign_parameters(Some(randomized), &all)?;
        }
        for (which, given) in Applied::ALL.into_iter().zip(&applied) {
            self.applied[which as usize] = None;
            let Some(given) = given else { continue };
            let given = readonly(given, which.name())?;
            check_shape(which.name(), given.shape(), &[&self.shape(&self.unapplied(which).0)])?;
            let own = self.applied(py, which)?;
            own.try_readwrite().map_err(|e| PyValueError::new_err(e.to_string()))?.as_slice_mut()?.copy_from_slice(given.as_slice()?);
        }
        Ok(())
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let py = slf.py();
        let this = slf.try_borrow().map_err(|_| PyRuntimeError::new_err(BUSY))?;
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
