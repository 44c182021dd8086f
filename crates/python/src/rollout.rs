//! `Stepper.rollout`: many controls in one call, without Python in between.

use numpy::{Element, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyReadwriteArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use stepper_core::Precision;
use stepper_core::batch::rollout::{Numbers, Quantity, Recording};

use crate::array::{check_shape, described, readonly, shape_text};
use crate::error::value_error;
use crate::options::unknown;
use crate::stepper::{Stepper, watched};

/// What is always written down, so that nothing that went wrong is silent.
const CERTIFICATE: [&str; 2] = ["status", "residual"];
/// What is written down when nobody chooses.
const DEFAULT: [Quantity; 3] = [Quantity::Qpos, Quantity::Qvel, Quantity::Observation];

/// An array of the result: a new one, which nobody else has while other threads of Python run, and the caller's, if there is one, which
/// takes its contents in the end.
struct Output<'py, T: Element> {
    name: &'static str,
    made: PyReadwriteArrayDyn<'py, T>,
    given: Option<PyReadwriteArrayDyn<'py, T>>,
}

impl<'py, T: Element + Copy> Output<'py, T> {
    fn new(py: Python<'py>, name: &'static str, shape: &[usize], out: Option<&Bound<'py, PyDict>>) -> PyResult<Self> {
        let given = out.map(|out| out.get_item(name)).transpose()?.flatten();
        let given = given.map(|given| destination(py, name, shape, given)).transpose()?;
        // NumPy's own, so that one that is too large is a MemoryError.
        let made = py.import("numpy")?.call_method1("zeros", (PyTuple::new(py, shape)?, T::get_dtype(py)))?;
        let made = made.cast_into::<PyArrayDyn<T>>().map_err(PyErr::from)?;
        Ok(Self { name, made: made.readwrite(), given })
    }

    fn numbers(&mut self) -> PyResult<&mut [T]> {
        Ok(self.made.as_slice_mut()?)
    }

    /// Enters the array in the result, with what was written of so many controls.
    fn enter(mut self, controls: usize, result: &Bound<'py, PyDict>) -> PyResult<()> {
        let Some(mut given) = self.given.take() else { return result.set_item(self.name, &**self.made) };
        let (all, made) = (self.made.shape()[0], self.made.as_slice()?);
        let written = made.len().checked_div(all).unwrap_or(0) * controls;
        given.as_slice_mut()?[..written].copy_from_slice(&made[..written]);
        result.set_item(self.name, &**given)
    }
}

/// Numbers in the precision of the lanes.
enum Lanes<'py> {
    F64(Output<'py, f64>),
    F32(Output<'py, f32>),
}

impl<'py> Lanes<'py> {
    fn numbers(&mut self) -> PyResult<Numbers<'_>> {
        Ok(match self {
            Self::F64(output) => Numbers::F64(output.numbers()?),
            Self::F32(output) => Numbers::F32(output.numbers()?),
        })
    }

    fn enter(self, controls: usize, result: &Bound<'py, PyDict>) -> PyResult<()> {
        match self {
            Self::F64(output) => output.enter(controls, result),
            Self::F32(output) => output.enter(controls, result),
        }
    }
}

impl Stepper {
    /// See `_stepper.pyi`.
    pub(crate) fn roll<'py>(
        &mut self,
        py: Python<'py>,
        ctrl: &Bound<'py, PyAny>,
        nstep: usize,
        fields: Option<Vec<String>>,
        out: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let ctrl = self.controls(ctrl)?;
        let calls = ctrl.shape()[0];
        let quantities = chosen(fields, out)?;
        let mut arrays = Vec::with_capacity(quantities.len());
        for quantity in quantities {
            let shape = self.rollout_shape(calls, &[self.simulation.width(quantity)]);
            let array = match self.precision {
                Precision::F64 => Lanes::F64(Output::new(py, quantity.name(), &shape, out)?),
                Precision::F32 => Lanes::F32(Output::new(py, quantity.name(), &shape, out)?),
            };
            arrays.push((quantity, array));
        }
        let shape = self.rollout_shape(calls, &[]);
        let mut status = Output::<u32>::new(py, CERTIFICATE[0], &shape, out)?;
        let mut residual = Output::<f64>::new(py, CERTIFICATE[1], &shape, out)?;
        let quantities = arrays.iter_mut().map(|(quantity, array)| Ok((*quantity, array.numbers()?))).collect::<PyResult<_>>()?;
        let recording = Recording { quantities, status: status.numbers()?, residual: residual.numbers()? };

        let controls = ctrl.as_slice()?.to_vec();
        self.copy_applied(py)?;
        let (inputs, simulation) = (self.copies.inputs(&controls), &mut self.simulation);
        let roll = || watched(|watch| simulation.rollout_watched(&inputs, [calls, nstep], recording, watch));
        let interrupted = py.detach(roll).map_err(value_error)?;
        let written = interrupted.as_ref().map_or(calls, |i| i.steps.div_ceil(nstep.max(1)));
        let result = PyDict::new(py);
        arrays.into_iter().try_for_each(|(_, array)| array.enter(written, &result))?;
        status.enter(written, &result)?;
        residual.enter(written, &result)?;
        let Some(interrupted) = interrupted else { return Ok(result) };
        let whole = interrupted.steps / nstep;
        let also = format!(": {whole} controls of {calls}; rows of `out` beyond hold nothing of them");
        Err(interrupted.raise(py, "rollout", calls.saturating_mul(nstep), &also))
    }

    /// Controls (T, num_envs, nu), or (T, nu) for all.
    fn controls<'py>(&self, given: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
        let given = readonly(given, "ctrl")?;
        let nu = self.simulation.model().nu();
        let (found, full) = (given.shape(), self.shape(&[nu]));
        let fits = !found.is_empty() && (found[1..] == full || found[1..] == [nu]);
        if fits {
            return Ok(given);
        }
        let all = format!("(T, {})", full.iter().map(usize::to_string).collect::<Vec<_>>().join(", "));
        let shared = if self.num_envs().is_some() { format!(" or (T, {nu})") } else { String::new() };
        Err(PyValueError::new_err(format!("ctrl has shape {}, must be {all}{shared} for T controls", shape_text(found))))
    }

    /// (T, num_envs, ...tail)
    fn rollout_shape(&self, calls: usize, tail: &[usize]) -> Vec<usize> {
        std::iter::once(calls).chain(self.shape(tail)).collect()
    }
}

/// The quantities that `fields` and `out` name, in a fixed order.
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

/// The caller's array, borrowed for writing.
fn destination<'py, T: Element>(
    py: Python<'py>,
    name: &str,
    shape: &[usize],
    given: Bound<'py, PyAny>,
) -> PyResult<PyReadwriteArrayDyn<'py, T>> {
    let what = format!("out[\"{name}\"]");
    let array = given.cast_into::<PyArrayDyn<T>>().map_err(|e| {
        let given = e.into_inner();
        let found = given.getattr("dtype").map_or_else(|_| described(&given), |dtype| format!("of {dtype}"));
        PyTypeError::new_err(format!("{what} is {found}, must be an array of {}", T::get_dtype(py)))
    })?;
    check_shape(&what, array.shape(), &[shape])?;
    if !array.is_c_contiguous() {
        return Err(PyValueError::new_err(format!("{what} is not C-contiguous: give a whole array, not a view of some of its columns")));
    }
    array.try_readwrite().map_err(|e| PyValueError::new_err(format!("{what}: {e}")))
}
