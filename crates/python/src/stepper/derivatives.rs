//! Derivatives of a step by the implicit function theorem, and kinks between perturbed copies of environments (differences in kind, such
//! as stick and slip), for `stepper.derivatives`.

use numpy::{IntoPyArray, PyArray1, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use stepper_core::Precision;
use stepper_derivative::{Derivative, DerivativeQuery, PerturbedCopies, StatePart, differentiate, find_kinks};

use crate::array::{array, float64_array, shaped};
use crate::error::value_error;
use crate::stepper::{Reading, Stepper, Writing};

#[pymethods]
impl Stepper {
    /// Names of the actuators whose controls act on later steps too (delay, lag, sampled servo, integral), in any environment.
    fn _actuators_with_memory(&self) -> Vec<String> {
        self.simulation.actuators_with_memory()
    }

    /// Derivatives of a step by the implicit function theorem. `stepper.derivatives.implicit` documents the arguments.
    ///
    /// Returns:
    ///     Dictionary of arrays: derivatives "slopes" (num_envs, 2 nv + na, columns), with a column for each coordinate of `parts`; flags
    ///     of kinks "causes" (num_envs, columns) uint32; "distance" to the nearest kink, "sound" (uint8, 1 for a valid derivative),
    ///     "residual" and "status" (num_envs,); and "qpos", "qvel" and "act" after the step.
    #[pyo3(signature = (ctrl, parts, offsets, tolerance))]
    fn _differentiate<'py>(
        mut slf: Writing<'_>,
        py: Python<'py>,
        ctrl: Bound<'py, PyAny>,
        parts: Vec<String>,
        offsets: PyReadonlyArrayDyn<'py, f64>,
        tolerance: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let part_of = |name: &String| StatePart::ALL.into_iter().find(|part| part.name() == name);
        let missing = |name| PyValueError::new_err(format!("{name} is no part of the state"));
        let parts = parts.iter().map(|name| part_of(name).ok_or_else(|| missing(name))).collect::<PyResult<Vec<_>>>()?;
        let &[_, points, columns] = offsets.shape() else {
            return Err(PyValueError::new_err("offsets must be (num_envs, points, columns)"));
        };
        slf.apply(py)?;
        let ctrl = float64_array(&ctrl, "ctrl")?;
        let (ctrl, offsets) = (ctrl.as_slice()?, offsets.as_slice()?);
        let query = DerivativeQuery { parts: &parts, offsets, points, tolerance };
        let rows = 2 * slf.simulation.model().nv() + slf.simulation.model().na();
        let simulation = &mut slf.simulation;
        let derivatives = py.detach(|| differentiate(simulation, ctrl, &query)).map_err(value_error)?;
        let (n, out) = (derivatives.len(), PyDict::new(py));
        let numbers = |of: &dyn Fn(&Derivative) -> &[f64], shape: &[usize]| {
            array(py, shape, derivatives.iter().flat_map(of).copied().collect(), Precision::F64)
        };
        out.set_item("slopes", numbers(&|one| &one.slopes, &[n, rows, columns])?)?;
        out.set_item("causes", shaped(py, &[n, columns], derivatives.iter().flat_map(|one| &one.causes).copied().collect())?)?;
        out.set_item("distance", numbers(&|one| std::slice::from_ref(&one.distance), &[n])?)?;
        out.set_item("sound", PyArray1::from_iter(py, derivatives.iter().map(|one| u8::from(one.sound))))?;
        out.set_item("residual", numbers(&|one| std::slice::from_ref(&one.residual), &[n])?)?;
        out.set_item("status", PyArray1::from_iter(py, derivatives.iter().map(|one| one.status)))?;
        for (part, name) in ["qpos", "qvel", "act"].into_iter().enumerate() {
            out.set_item(name, numbers(&|one| &one.state[part], &[n, derivatives[0].state[part].len()])?)?;
        }
        Ok(out)
    }

    /// Kinks between copies of environments after a step, such as a contact that pushes in one copy only.
    ///
    /// `stepper.derivatives.kinks` documents the arguments.
    ///
    /// Returns:
    ///     Flags of `Kink` for each column of the derivative, (environments, columns) uint32, and the distance to the nearest kink as a
    ///     multiple of the perturbation, (environments,).
    #[pyo3(signature = (*, count, sides, one_sided, limited, ranges, limit_positions, rubbing, smooth_at_rest, tolerance))]
    #[expect(clippy::too_many_arguments, reason = "each has a name of its own")]
    fn _find_kinks<'py>(
        slf: Reading<'_>,
        py: Python<'py>,
        count: usize,
        sides: usize,
        one_sided: PyReadonlyArrayDyn<'py, bool>,
        limited: Vec<[usize; 2]>,
        ranges: Bound<'py, PyAny>,
        limit_positions: Bound<'py, PyAny>,
        rubbing: Vec<usize>,
        smooth_at_rest: bool,
        tolerance: f64,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyArray1<f64>>)> {
        let (ranges, limit_positions) = (float64_array(&ranges, "ranges")?, float64_array(&limit_positions, "limit_positions")?);
        let columns = one_sided.shape().last().copied().unwrap_or(0);
        let copies = PerturbedCopies {
            count,
            columns,
            sides,
            one_sided: one_sided.as_slice()?,
            limited: &limited,
            ranges: ranges.as_slice()?,
            limit_positions: limit_positions.as_slice()?,
            rubbing: &rubbing,
            smooth_at_rest,
            tolerance,
        };
        let kinks = find_kinks(&slf.simulation, &copies).map_err(value_error)?;
        let environments = kinks.distance.len();
        Ok((shaped(py, &[environments, columns], kinks.causes)?, kinks.distance.into_pyarray(py)))
    }
}
