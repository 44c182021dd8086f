//! Writable arrays of a stepper that each step reads: applied forces, poses of mocap bodies, and active equalities.
//!
//! Python owns their memory, and other Python threads may write to it during a step. So each call first copies the arrays to the core.

use std::borrow::Cow;

use numpy::{BorrowError, Element, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use stepper_core::AppliedInput;

use crate::array::shape_text;
use crate::error::value_error;
use crate::stepper::{Stepper, Writing};

/// NumPy array of one applied input (applied forces, mocap poses or active equalities) for all environments. It has f64 numbers, or
/// booleans for `eq_active`.
enum Applied<'py> {
    Numbers(Bound<'py, PyArrayDyn<f64>>),
    Truths(Bound<'py, PyArrayDyn<bool>>),
}

impl<'py> Applied<'py> {
    /// New array of an applied input with the given numbers. For `eq_active`, 0 is false.
    fn new(py: Python<'py>, input: AppliedInput, numbers: Vec<f64>, shape: Vec<usize>) -> PyResult<Self> {
        Ok(match input {
            AppliedInput::EqActive => Self::Truths(PyArray1::from_vec(py, numbers.into_iter().map(|x| x != 0.0).collect()).reshape(shape)?),
            _ => Self::Numbers(PyArray1::from_vec(py, numbers).reshape(shape)?),
        })
    }

    /// Casts an array to the type of an applied input. The result is None if the array is not C-contiguous, or has another type or shape.
    fn of(array: &Bound<'py, PyUntypedArray>, input: AppliedInput, shape: &[usize]) -> Option<Self> {
        if array.shape() != shape || !array.is_c_contiguous() {
            return None;
        }
        match input {
            AppliedInput::EqActive => array.cast::<PyArrayDyn<bool>>().ok().cloned().map(Self::Truths),
            _ => array.cast::<PyArrayDyn<f64>>().ok().cloned().map(Self::Numbers),
        }
    }

    fn untyped(&self) -> &Bound<'py, PyUntypedArray> {
        match self {
            Self::Numbers(array) => array.as_untyped(),
            Self::Truths(array) => array.as_untyped(),
        }
    }

    /// Writes `row` to the array, in the row of each of the environments `envs`. For `eq_active`, 0 is false.
    fn write_rows(&self, envs: &[usize], row: &[f64]) -> PyResult<()> {
        fn write<T: Element + Copy>(array: &Bound<'_, PyArrayDyn<T>>, envs: &[usize], row: &[T]) -> PyResult<()> {
            let mut array = array.try_readwrite()?;
            let all = array.as_slice_mut()?;
            envs.iter().for_each(|&env| all[env * row.len()..][..row.len()].copy_from_slice(row));
            Ok(())
        }
        match self {
            Self::Numbers(array) => write(array, envs, row),
            Self::Truths(array) => write(array, envs, &row.iter().map(|x| *x != 0.0).collect::<Vec<_>>()),
        }
    }

    /// Calls `read` with the numbers of the array, and returns its result. Booleans are passed as 0 and 1. `name` is the name of the array
    /// in errors.
    fn with_numbers<T>(&self, name: &str, read: impl FnOnce(&[f64]) -> PyResult<T>) -> PyResult<T> {
        let taken = |e: BorrowError| PyValueError::new_err(format!("{name}: {e}"));
        match self {
            Self::Numbers(array) => read(array.try_readonly().map_err(taken)?.as_slice()?),
            Self::Truths(array) => {
                let truths: PyReadonlyArrayDyn<'_, bool> = array.try_readonly().map_err(taken)?;
                let numbers: Cow<'_, [f64]> = truths.as_slice()?.iter().map(|&truth| f64::from(u8::from(truth))).collect();
                read(&numbers)
            }
        }
    }
}

impl Stepper {
    /// Shape of the array of an applied input: (num_envs, ...), or without the leading axis if the stepper was created without `num_envs`.
    pub(super) fn applied_shape(&self, input: AppliedInput) -> Vec<usize> {
        self.shape(&input.shape(self.simulation.model()))
    }

    /// Writes the reset values of some environments to the writable arrays: zero forces, and the mocap poses and active equalities of the
    /// model.
    pub(super) fn reset_applied(&mut self, py: Python<'_>, envs: &[usize]) -> PyResult<()> {
        for input in AppliedInput::ALL {
            let Some(array) = self.made(py, input)? else { continue };
            let row = input.at_reset(self.simulation.model());
            array.write_rows(envs, &row).map_err(|e| PyValueError::new_err(format!("{}: {e}", input.name())))?;
        }
        Ok(())
    }

    /// Array of an applied input, such as `xfrc_applied`; None if the array was not created yet. If the user has changed its type or shape,
    /// the result is an error.
    fn made<'py>(&self, py: Python<'py>, input: AppliedInput) -> PyResult<Option<Applied<'py>>> {
        let Some(array) = &self.applied[input as usize] else { return Ok(None) };
        // NumPy allows users to change the dtype and shape of an existing array.
        let shape = self.applied_shape(input);
        Applied::of(array.bind(py), input, &shape).map(Some).ok_or_else(|| {
            let (name, shape) = (input.name(), shape_text(&shape));
            let kind = if input == AppliedInput::EqActive { "bool" } else { "float64" };
            PyValueError::new_err(format!("{name} was changed in place to another type or shape, must stay a {kind} array {shape}: assign to its elements, as {name}[...] = values"))
        })
    }

    /// Writable NumPy array of an applied input, such as `xfrc_applied`. The first call creates it with the values of a reset.
    pub(super) fn applied_array<'py>(&mut self, py: Python<'py>, input: AppliedInput) -> PyResult<Bound<'py, PyUntypedArray>> {
        if self.applied[input as usize].is_none() {
            let all = input.at_reset(self.simulation.model()).repeat(self.n());
            let made = Applied::new(py, input, all, self.applied_shape(input))?;
            self.applied[input as usize] = Some(made.untyped().clone().unbind());
        }
        Ok(self.applied[input as usize].as_ref().expect("made above").bind(py).clone())
    }

    /// Copies a Python value to all elements of the array of an applied input.
    pub(super) fn assign(&mut self, py: Python<'_>, input: AppliedInput, value: &Bound<'_, PyAny>) -> PyResult<()> {
        self.applied_array(py, input)?;
        let (name, shape) = (input.name(), shape_text(&self.applied_shape(input)));
        let numbers = if input == AppliedInput::EqActive {
            let dtype = py.import("numpy")?.call_method1("asarray", (value,))?.getattr("dtype")?;
            if dtype.getattr("kind")?.extract::<String>()? != "b" {
                let message = format!("{name} is {dtype}, must be bool {shape}: compare numbers first, e.g. values > 0.5");
                return Err(PyValueError::new_err(message));
            }
            value.clone()
        } else {
            py.import("stepper._arrays")?.call_method1("array_of", (name, value))?
        };
        self.made(py, input)?.expect("made above").untyped().set_item(py.Ellipsis(), numbers).map_err(|error| {
            if error.is_instance_of::<PyValueError>(py) {
                PyValueError::new_err(format!("{name} has shape {shape}: {error}"))
            } else {
                error
            }
        })
    }

    /// Copies the active equalities of the core to their writable array, after a state was restored.
    pub(super) fn refresh_eq_active(&mut self, py: Python<'_>) -> PyResult<()> {
        let all = self.simulation.applied(AppliedInput::EqActive).to_vec();
        if all.is_empty() {
            return Ok(());
        }
        self.applied_array(py, AppliedInput::EqActive)?;
        let Some(array) = self.made(py, AppliedInput::EqActive)? else { return Ok(()) };
        let width = all.len() / self.n();
        all.chunks(width).enumerate().try_for_each(|(env, row)| array.write_rows(&[env], row))
    }

    /// Copies the writable arrays that exist to the core, before a step or an evaluation.
    pub(super) fn apply(&mut self, py: Python<'_>) -> PyResult<()> {
        if self.applied.iter().all(Option::is_none) { Ok(()) } else { self.apply_arrays(py) }
    }

    #[cold]
    fn apply_arrays(&mut self, py: Python<'_>) -> PyResult<()> {
        for input in AppliedInput::ALL {
            let Some(array) = self.made(py, input)? else { continue };
            array.with_numbers(input.name(), |numbers| self.simulation.apply(input, numbers).map_err(value_error))?;
        }
        Ok(())
    }
}

/// Declares a writable array attribute of `Stepper` for each applied input, with the functions that get and set it.
macro_rules! applied_inputs {
    ($($(#[$doc:meta])* $name:ident, $set:ident: $input:ident,)*) => {
        #[pymethods]
        impl Stepper {
            $(
                $(#[$doc])*
                #[getter]
                fn $name<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyUntypedArray>> {
                    slf.applied_array(py, AppliedInput::$input)
                }

                #[setter]
                fn $set(mut slf: Writing<'_>, py: Python<'_>, value: Bound<'_, PyAny>) -> PyResult<()> {
                    slf.assign(py, AppliedInput::$input, &value)
                }
            )*
        }
    };
}

applied_inputs! {
    /// Applied joint forces, (num_envs, nv), N or N m. Writable; each step applies them until they are changed or reset.
    qfrc_applied, set_qfrc_applied: QfrcApplied,
    /// Applied force (N) and torque (N m) at the centre of mass of each body in world axes, (num_envs, nbody, 6). Writable; each step
    /// applies them until they are changed or reset.
    xfrc_applied, set_xfrc_applied: XfrcApplied,
    /// Positions of the mocap bodies, (num_envs, nmocap, 3), m. Writable; each step uses them until they are changed or reset.
    mocap_pos, set_mocap_pos: MocapPos,
    /// Orientations of the mocap bodies as quaternions, (num_envs, nmocap, 4). Writable; each step uses them until they are changed or
    /// reset.
    mocap_quat, set_mocap_quat: MocapQuat,
    /// Whether each equality is active, (num_envs, neq) bool, as MuJoCo's `eq_active`. Writable; each step uses it until it is changed.
    /// Part of the state of `get_state`. `reset` restores the model's `eq_active0`. States do not contain `eq_data`: after `copy_state`,
    /// `randomize` gives the targets the same numbers.
    ///
    /// The step ignores inactive equalities. If one is activated with a large position error, position correction closes it at up to
    /// `Options.max_correction_speed`. A weld pulls the bodies to the relative pose in `eq_data`. To hold them in the current pose instead,
    /// set the environment's `eq_data` first:
    ///
    ///     grasp = model.equality("grasp").id
    ///     sim.randomize({"eq_data[grasp]": sim.closed_eq_data[grasped, grasp]}, envs=grasped)
    ///     sim.eq_active[grasped, grasp] = True
    eq_active, set_eq_active: EqActive,
}
