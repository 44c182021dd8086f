//! Functions of `Model` on arrays of configurations: `integrate_pos` and `differentiate_pos`.

use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use stepper_core::analysis::configurations::{differentiate, integrate, joint_without_orientation};
use stepper_core::model::Model as Core;
use stepper_core::{Error, Precision};

use crate::array::{array, float64_array, shape_text};
use crate::error::value_error;
use crate::model::Model;

/// Array argument whose last axis is one configuration or displacement: a single row, (width,), or several rows, (..., width).
struct Rows<'py> {
    name: &'static str,
    numbers: PyReadonlyArrayDyn<'py, f64>,
    width: usize,
}

impl<'py> Rows<'py> {
    fn new(given: &Bound<'py, PyAny>, name: &'static str, width: usize) -> PyResult<Self> {
        let numbers = float64_array(given, name)?;
        if numbers.shape().last() != Some(&width) {
            let shape = shape_text(numbers.shape());
            return Err(PyValueError::new_err(format!("{name} has shape {shape}, must be ({width},) or (..., {width})")));
        }
        let rows = Self { name, numbers, width };
        match rows.numbers.as_slice()?.iter().position(|x| !x.is_finite()) {
            Some(at) => Err(PyValueError::new_err(format!("{name} has {} at number {at}, must be finite", rows.numbers.as_slice()?[at]))),
            None => Ok(rows),
        }
    }

    /// Rows of the array argument `name`, each a configuration of the model. A joint with a zero quaternion is an error.
    fn of_configurations(given: &Bound<'py, PyAny>, name: &'static str, model: &Core) -> PyResult<Self> {
        let rows = Self::new(given, name, model.nq())?;
        for (row, q) in rows.numbers.as_slice()?.chunks_exact(model.nq().max(1)).enumerate() {
            if let Some(joint) = joint_without_orientation(model, q).map_err(value_error)? {
                let joint = model.joint_label(joint);
                return Err(PyValueError::new_err(format!(
                    "the orientation of joint \"{joint}\" in row {row} of {name} is a quaternion of length 0; give one of length 1, such as (1, 0, 0, 0)"
                )));
            }
        }
        Ok(rows)
    }

    /// Shape of the leading axes, which is the shape of the argument without its last axis.
    fn lead(&self) -> &[usize] {
        &self.numbers.shape()[..self.numbers.shape().len() - 1]
    }

    /// Row with the index `k`, counted over all leading axes of the array. An array with a single row has this row for every `k`.
    fn row(&self, k: usize) -> PyResult<&[f64]> {
        let all = self.numbers.as_slice()?;
        Ok(if self.lead().is_empty() { all } else { &all[k * self.width..(k + 1) * self.width] })
    }
}

/// NumPy array of the results of `combine`, (..., width). `combine` gets the rows of `a` and `b` with the same index, and returns a row of
/// length `width`. If one of the arguments has a single row, all rows of the other are combined with this row.
fn each_row<'py>(
    py: Python<'py>,
    [a, b]: [Rows<'py>; 2],
    width: usize,
    combine: impl Fn(&[f64], &[f64]) -> Result<Vec<f64>, Error>,
) -> PyResult<Bound<'py, PyAny>> {
    let lead = if a.lead().is_empty() { b.lead() } else { a.lead() };
    if !b.lead().is_empty() && b.lead() != lead {
        let (found, other) = (shape_text(b.numbers.shape()), shape_text(a.numbers.shape()));
        return Err(PyValueError::new_err(format!(
            "{} has shape {found} and {} {other}: the axes before the last must be the same, or those of one of them absent",
            b.name, a.name
        )));
    }
    let mut out = Vec::new();
    for k in 0..lead.iter().product() {
        out.extend(combine(a.row(k)?, b.row(k)?).map_err(value_error)?);
    }
    let shape: Vec<usize> = lead.iter().copied().chain([width]).collect();
    array(py, &shape, out, Precision::F64)
}

#[pymethods]
impl Model {
    /// Configurations after displacements, with unit quaternions, as MuJoCo's mj_integratePos with dt = 1.
    ///
    /// Args:
    ///     q: Configurations, (..., nq).
    ///     dv: Displacements on the tangent space, in the coordinates of qvel, (..., nv). Rotations of ball and free joints are rotation
    ///         vectors in the body's frame. The leading axes equal the leading axes of `q`, or one of the arguments has no leading axes.
    ///
    /// Returns:
    ///     Configurations, (..., nq) float64.
    ///
    /// Raises:
    ///     ValueError: Shapes do not match, a number is not finite, or a quaternion is zero.
    fn integrate_pos<'py>(&self, q: &Bound<'py, PyAny>, dv: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let model = &*self.core;
        let rows = [Rows::of_configurations(q, "q", model)?, Rows::new(dv, "dv", model.nv())?];
        each_row(q.py(), rows, model.nq(), |q, dv| integrate(model, q, dv))
    }

    /// Shortest displacements from one configuration to another, as MuJoCo's mj_differentiatePos with dt = 1.
    ///
    /// This is the inverse of `integrate_pos`.
    ///
    /// Args:
    ///     q1: Initial configurations, (..., nq).
    ///     q2: Final configurations, (..., nq). The leading axes equal the leading axes of `q1`, or one of the arguments has no leading
    ///         axes.
    ///
    /// Returns:
    ///     Displacements, (..., nv) float64.
    ///
    /// Raises:
    ///     ValueError: Shapes do not match, a number is not finite, or a quaternion is zero.
    fn differentiate_pos<'py>(&self, q1: &Bound<'py, PyAny>, q2: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let model = &*self.core;
        let rows = [Rows::of_configurations(q1, "q1", model)?, Rows::of_configurations(q2, "q2", model)?];
        each_row(q1.py(), rows, model.nv(), |q1, q2| differentiate(model, q1, q2))
    }
}
