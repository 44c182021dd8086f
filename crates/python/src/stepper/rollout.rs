//! `Stepper.rollout`: sequences of controls in one call.

use numpy::{Element, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyReadwriteArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyRuntimeError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use stepper_core::rollout::{Numbers, Quantity, Recording};
use stepper_core::{Precision, StepInputs};

use crate::arguments::{Whole, no_others, required};
use crate::array::{check_shape, described, float64_array, shape_text};
use crate::error::value_error;
use crate::options::unknown;
use crate::stepper::interruption::watched;
use crate::stepper::state::states_of;
use crate::stepper::{Stepper, Writing};

/// Names of the arrays that the result of every rollout contains, so that unsolved steps are visible.
const CERTIFICATE: [&str; 2] = ["status", "residual"];
/// Quantities in the result if the caller gives neither `fields` nor `out`.
const DEFAULT: [Quantity; 3] = [Quantity::Qpos, Quantity::Qvel, Quantity::Observation];

/// Result array of a rollout. The computation writes to the private array `made` without the GIL. At the end the result is copied to
/// `given`, the caller's array in `out`, if there is one.
struct Output<'py, T: Element> {
    name: &'static str,
    made: PyReadwriteArrayDyn<'py, T>,
    given: Option<PyReadwriteArrayDyn<'py, T>>,
}

impl<'py, T: Element + Copy> Output<'py, T> {
    fn new(py: Python<'py>, name: &'static str, shape: &[usize], out: Option<&Bound<'py, PyDict>>) -> PyResult<Self> {
        let given = out.map(|out| out.get_item(name)).transpose()?.flatten();
        let given = given.map(|given| destination(name, shape, given)).transpose()?;
        // Allocated by NumPy, so that an oversized array raises MemoryError.
        let made = py.import("numpy")?.call_method1("zeros", (PyTuple::new(py, shape)?, T::get_dtype(py)))?;
        let made = made.cast_into::<PyArrayDyn<T>>().map_err(PyErr::from)?;
        Ok(Self { name, made: made.readwrite(), given })
    }

    /// Adds the array to the dictionary `result`. If the caller gave an array in `out`, the results of the first `controls` controls are
    /// copied to the caller's array, and the dictionary gets that array.
    fn enter(mut self, controls: usize, result: &Bound<'py, PyDict>) -> PyResult<()> {
        let Some(mut given) = self.given.take() else { return result.set_item(self.name, &**self.made) };
        let (all, made) = (self.made.shape()[0], self.made.as_slice()?);
        let written = made.len().checked_div(all).unwrap_or(0) * controls;
        given.as_slice_mut()?[..written].copy_from_slice(&made[..written]);
        result.set_item(self.name, &**given)
    }
}

impl Stepper {
    /// Implementation of the Python method `rollout`. The caller has set the initial state, and checked that the stepper is not recorded.
    ///
    /// `T` is the type of the numbers in the result arrays. `numbers` makes the destination of a recording from such numbers.
    fn roll_out<'py, T: Element + Copy>(
        &mut self,
        py: Python<'py>,
        ctrl: &Bound<'py, PyAny>,
        nstep: usize,
        fields: Option<Vec<String>>,
        out: Option<&Bound<'py, PyDict>>,
        numbers: impl for<'a> Fn(&'a mut [T]) -> Numbers<'a>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let ctrl = self.controls(ctrl)?;
        let calls = ctrl.shape()[0];
        let quantities = chosen(fields, out)?;
        let mut arrays = Vec::with_capacity(quantities.len());
        for quantity in quantities {
            let shape = self.rollout_shape(calls, &[quantity.width(self.simulation.model())]);
            arrays.push((quantity, Output::new(py, quantity.name(), &shape, out)?));
        }
        let shape = self.rollout_shape(calls, &[]);
        let mut status = Output::<u32>::new(py, CERTIFICATE[0], &shape, out)?;
        let mut residual = Output::<f64>::new(py, CERTIFICATE[1], &shape, out)?;
        let quantities =
            arrays.iter_mut().map(|(quantity, array)| Ok((*quantity, numbers(array.made.as_slice_mut()?)))).collect::<PyResult<_>>()?;
        let recording = Recording { quantities, status: status.made.as_slice_mut()?, residual: residual.made.as_slice_mut()? };

        let controls = ctrl.as_slice()?.to_vec();
        self.apply(py)?;
        let (inputs, simulation) = (StepInputs { ctrl: &controls, ..StepInputs::default() }, &mut self.simulation);
        let roll = || watched(|watch| simulation.rollout(&inputs, calls, nstep, recording, Some(watch)));
        let interrupted = py.detach(roll).map_err(value_error)?;
        let written = interrupted.as_ref().map_or(calls, |i| i.steps.div_ceil(nstep.max(1)));
        let result = PyDict::new(py);
        arrays.into_iter().try_for_each(|(_, array)| array.enter(written, &result))?;
        status.enter(written, &result)?;
        residual.enter(written, &result)?;
        let Some(interrupted) = interrupted else { return Ok(result) };
        let whole = interrupted.steps / nstep;
        let also = format!(": {whole} of {calls} controls are complete; later rows of `out` have no results");
        Err(interrupted.raise(py, "rollout", calls.saturating_mul(nstep), &also))
    }

    /// Controls from the argument `ctrl`, (T, num_envs, nu), or (T, nu) for all environments.
    fn controls<'py>(&self, given: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
        let given = float64_array(given, "ctrl")?;
        let nu = self.simulation.model().nu();
        let (found, full) = (given.shape(), self.shape(&[nu]));
        let fits = !found.is_empty() && (found[1..] == full || found[1..] == [nu]);
        if fits {
            return Ok(given);
        }
        let all = format!("(T, {})", full.iter().map(usize::to_string).collect::<Vec<_>>().join(", "));
        let shared = if self.batched { format!(" or (T, {nu})") } else { String::new() };
        Err(PyValueError::new_err(format!("ctrl has shape {}, must be {all}{shared} for T controls", shape_text(found))))
    }

    /// Shape of a result array, (T, num_envs, *tail), where T = `calls` is the number of controls.
    fn rollout_shape(&self, calls: usize, tail: &[usize]) -> Vec<usize> {
        std::iter::once(calls).chain(self.shape(tail)).collect()
    }
}

#[pymethods]
impl Stepper {
    /// Makes `nstep` steps with each of T controls in one call.
    ///
    /// If no mocap body moves, the results equal those of T calls of `step`, bit for bit.
    ///
    /// Each thread steps its environments through all T controls. `qfrc_applied` and `xfrc_applied` are constant. Mocap bodies reach the
    /// poses `mocap_pos` and `mocap_quat` at the end of the call.
    ///
    /// Args:
    ///     ctrl: Controls, (T, num_envs, nu), or (T, nu) for all environments.
    ///     nstep: Number of steps per control.
    ///     initial: Initial state, as in `set_state`: a state of one environment, a state of all environments, or a list with a state for
    ///         each environment. None starts from the current state.
    ///     fields: Quantities to store after each control: "qpos" (T, num_envs, nq), "qvel" (T, num_envs, nv), "act" (T, num_envs, na),
    ///         "sensordata" (T, num_envs, nsensordata). None stores the quantities in `out`. Without `out`, None stores all of them except
    ///         "act".
    ///     out: Arrays for the results, by quantity, with the shapes of `fields`. The arrays must be C-contiguous and float64, or float32
    ///         with `precision="f32"`. "status" and "residual" are also possible.
    ///
    /// Returns:
    ///     Arrays by quantity. They always include "status" (T, num_envs) uint32, the flags of all steps of a control, and "residual"
    ///     (T, num_envs) float64, the largest residual of these steps, m/s. After the call, the attribute `status` has the flags of all
    ///     steps of the call; `residual` and `iterations` belong to the last step.
    ///
    /// Raises:
    ///     ValueError: A shape is wrong, a quantity is unknown, or an array of `out` is read-only or given twice.
    ///     TypeError: An array of `out` has the wrong dtype.
    ///     KeyboardInterrupt: The call was interrupted, as in `step`. The exception's `steps` counts the steps of all controls. `out` has
    ///         results for each control so far; for the interrupted control, these are the results after the last step before the
    ///         interruption. Later rows of `out` are unchanged.
    #[pyo3(signature = (ctrl=None, nstep=Whole::Number(1), *, initial=None, fields=None, out=None, **others), text_signature = "($self, ctrl, nstep=1, *, initial=None, fields=None, out=None)")]
    #[expect(clippy::too_many_arguments, reason = "each has a name of its own")]
    fn rollout<'py>(
        slf: &Bound<'py, Self>,
        py: Python<'py>,
        ctrl: Option<Bound<'py, PyAny>>,
        nstep: Whole<'_>,
        initial: Option<Bound<'py, PyAny>>,
        fields: Option<Vec<String>>,
        out: Option<Bound<'py, PyDict>>,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        no_others("Stepper.rollout", others, &["ctrl", "nstep", "initial", "fields", "out"])?;
        let ctrl = required("Stepper.rollout", "ctrl", ctrl)?;
        let nstep = nstep.from(0, "nstep")? as usize;
        let mut slf = Writing::try_from(slf)?;
        if slf.recorder.is_some() {
            return Err(PyRuntimeError::new_err(
                "this stepper is being recorded, and recordings do not contain rollouts: call step for every control, or close the recording",
            ));
        }
        if let Some(initial) = initial {
            let Some(states) = states_of(&initial) else {
                let message = format!("initial is {}, must be a stepper.State or a list of stepper.State", described(&initial));
                return Err(PyTypeError::new_err(message));
            };
            let all = slf.selection(None)?;
            slf.take_states(py, &states, &all)?;
        }
        let out = out.as_ref();
        match slf.simulation.precision() {
            Precision::F64 => slf.roll_out(py, &ctrl, nstep, fields, out, |x| Numbers::F64(x)),
            Precision::F32 => slf.roll_out(py, &ctrl, nstep, fields, out, |x| Numbers::F32(x)),
        }
    }
}

/// Quantities that the arguments `fields` and `out` request, in the order of [`Quantity::ALL`].
fn chosen(fields: Option<Vec<String>>, out: Option<&Bound<'_, PyDict>>) -> PyResult<Vec<Quantity>> {
    let mut names = match (fields, out) {
        (Some(fields), _) => fields,
        (None, Some(_)) => Vec::new(),
        (None, None) => DEFAULT.iter().map(|q| q.name().to_owned()).collect(),
    };
    for key in out.into_iter().flat_map(|out| out.keys()) {
        names.push(key.extract().map_err(|_| PyTypeError::new_err(format!("a key of out is {}, must be a string", described(&key))))?);
    }
    let known = |name: &str| Quantity::ALL.iter().any(|q| q.name() == name) || CERTIFICATE.contains(&name);
    if let Some(other) = names.iter().find(|name| !known(name)) {
        let all: Vec<&str> = Quantity::ALL.iter().map(|q| q.name()).chain(CERTIFICATE).collect();
        return Err(unknown("rollout field", other, &all.join(", ")));
    }
    Ok(Quantity::ALL.into_iter().filter(|q| names.iter().any(|name| name == q.name())).collect())
}

/// Mutable borrow of the array `name` in the caller's `out`, after checks of its dtype, shape and layout.
fn destination<'py, T: Element>(name: &str, shape: &[usize], given: Bound<'py, PyAny>) -> PyResult<PyReadwriteArrayDyn<'py, T>> {
    let what = format!("out[\"{name}\"]");
    let array = given.cast_into::<PyArrayDyn<T>>().map_err(|e| {
        let given = e.into_inner();
        let found = given.getattr("dtype").map_or_else(|_| described(&given), |dtype| format!("of {dtype}"));
        PyTypeError::new_err(format!("{what} is {found}, must be an array of {}", T::get_dtype(given.py())))
    })?;
    check_shape(&what, array.shape(), &[shape])?;
    if !array.is_c_contiguous() {
        return Err(PyValueError::new_err(format!("{what} is not C-contiguous: give a whole array, not a view of some of its columns")));
    }
    array.try_readwrite().map_err(|e| PyValueError::new_err(format!("{what}: {e}")))
}
