//! `Stepper.rollout`: many controls in one call, without Python in between.

use numpy::{Element, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyReadwriteArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use stepper_core::Precision;
use stepper_core::rollout::{Numbers, Quantity, Recording};

use crate::array::{check_shape, described, readonly, shape_text, write_detached};
use crate::options::unknown;
use crate::stepper::{Stepper, value_error};

/// What is always written down, so that nothing that went wrong is silent.
const CERTIFICATE: [&str; 2] = ["status", "residual"];
/// What is written down when nobody chooses.
const DEFAULT: [Quantity; 3] = [Quantity::Qpos, Quantity::Qvel, Quantity::Observation];

/// An array of the result, borrowed for writing.
enum Output<'py> {
    F64(PyReadwriteArrayDyn<'py, f64>),
    F32(PyReadwriteArrayDyn<'py, f32>),
}

impl<'py> Output<'py> {
    fn numbers(&mut self) -> PyResult<Numbers<'_>> {
        Ok(match self {
            Self::F64(array) => Numbers::F64(array.as_slice_mut()?),
            Self::F32(array) => Numbers::F32(array.as_slice_mut()?),
        })
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
        let result = PyDict::new(py);
        let mut arrays = Vec::with_capacity(quantities.len());
        for quantity in quantities {
            let shape = self.rollout_shape(calls, &[self.simulation.width(quantity)]);
            let (name, out) = (quantity.name(), out);
            let array = match self.precision {
                Precision::F64 => Output::F64(destination(py, name, &shape, out, &result)?),
                Precision::F32 => Output::F32(destination(py, name, &shape, out, &result)?),
            };
            arrays.push((quantity, array));
        }
        let shape = self.rollout_shape(calls, &[]);
        let mut status = destination::<u32>(py, CERTIFICATE[0], &shape, out, &result)?;
        let mut residual = destination::<f64>(py, CERTIFICATE[1], &shape, out, &result)?;
        let quantities = arrays.iter_mut().map(|(quantity, array)| Ok((*quantity, array.numbers()?))).collect::<PyResult<_>>()?;
        let recording = Recording { quantities, status: status.as_slice_mut()?, residual: residual.as_slice_mut()? };

        let controls = ctrl.as_slice()?;
        if calls > 0 && nstep > 0 {
            self.hold(&controls[(calls - 1) * (controls.len() / calls)..]);
        }
        self.complete_mocap(py)?;
        let held = self.held(py)?;
        let inputs = held.inputs(controls)?;
        let simulation = &mut self.simulation;
        write_detached(py, || simulation.rollout(&inputs, calls, nstep, recording)).map_err(value_error)?;
        Ok(result)
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

/// The caller's array, or a new one, borrowed for writing and entered in `result`.
fn destination<'py, T: Element>(
    py: Python<'py>,
    name: &str,
    shape: &[usize],
    out: Option<&Bound<'py, PyDict>>,
    result: &Bound<'py, PyDict>,
) -> PyResult<PyReadwriteArrayDyn<'py, T>> {
    let given = out.map(|out| out.get_item(name)).transpose()?.flatten();
    let array = match given {
        None => PyArrayDyn::<T>::zeros(py, shape, false),
        Some(given) => {
            let what = format!("out[\"{name}\"]");
            let array = given.cast_into::<PyArrayDyn<T>>().map_err(|e| {
                let given = e.into_inner();
                let found = given.getattr("dtype").map_or_else(|_| described(&given), |dtype| format!("of {dtype}"));
                PyTypeError::new_err(format!("{what} is {found}, must be an array of {}", T::get_dtype(py)))
            })?;
            check_shape(&what, array.shape(), &[shape])?;
            if !array.is_c_contiguous() {
                return Err(PyValueError::new_err(format!(
                    "{what} is not C-contiguous: give a whole array, not a view of some of its columns"
                )));
            }
            array
        }
    };
    result.set_item(name, &array)?;
    array.try_readwrite().map_err(|e| PyValueError::new_err(format!("out[\"{name}\"]: {e}")))
}
