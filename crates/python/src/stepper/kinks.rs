//! Kinks (differences in kind, such as stick and slip) between perturbed copies of environments, for `stepper.derivatives`.

use numpy::{IntoPyArray, PyArray1, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use stepper_derivative::{PerturbedCopies, find_kinks};

use crate::array::float64_array;
use crate::error::value_error;
use crate::stepper::{Reading, Stepper};

#[pymethods]
impl Stepper {
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
        let causes = PyArray1::from_vec(py, kinks.causes).reshape([environments, columns])?;
        Ok((causes.into_any(), kinks.distance.into_pyarray(py)))
    }
}
