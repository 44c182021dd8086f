//! Rays of all environments.

use numpy::PyUntypedArrayMethods;
use numpy::{IntoPyArray, ndarray::ArrayD};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use stepper_core::RayCast;

use crate::array::{OwnNumbers, check_shape, readonly};
use crate::elements::Kind;
use crate::error::value_error;
use crate::stepper::{Stepper, borrow};

#[pymethods]
impl Stepper {
    /// Distances and geoms that rays meet in the present states: MuJoCo's `mj_ray`, of many rays of all environments in one pass.
    ///
    /// A plane is met from its front, without end. Of a mesh its triangles are met, whether it collides as these or as its hull; of a
    /// height field also its sides and its base. What begins inside of something meets it where it leaves. What is drawn and touches
    /// nothing is met where it has a simple shape: a mesh that is only drawn is no part of the model.
    ///
    /// Args:
    ///     points: Where the rays begin, (num_envs, n, 3) or (n, 3) for all environments, m: in the world, or from the origin of `body`.
    ///     directions: Where they go, of any length above 0: (num_envs, n, 3) or (n, 3).
    ///     body: Name or index of the body that the rays belong to, as those of its lidar do; its own geoms are not met. None is the
    ///         world.
    ///     axes: Axes of points and directions around a body: "body", its own; "heading", the world's turned by its heading; "world".
    ///     geoms: Names or indices of the geoms that the rays can meet; None is all of them.
    ///     exclude: Name or index of a body whose geoms are not met; None is `body`.
    ///
    /// Returns:
    ///     Distances in m, (num_envs, n) in the stepper's scalar type, and the indices of the geoms that are met, (num_envs, n) int32. Both
    ///     are -1 where nothing is.
    ///
    /// Raises:
    ///     ValueError: An array of another shape, unknown axes, a point that is not finite, a direction of length 0, a mesh that is no part
    ///         of the model.
    ///     KeyError, IndexError: No geom or body of that name or index.
    #[expect(clippy::too_many_arguments, reason = "Python's keywords")]
    #[pyo3(signature = (points, directions, *, body=None, axes="body", geoms=None, exclude=None))]
    fn rays<'py>(
        slf: &Bound<'py, Self>,
        py: Python<'py>,
        mut points: Bound<'py, PyAny>,
        mut directions: Bound<'py, PyAny>,
        body: Option<Bound<'py, PyAny>>,
        axes: &str,
        geoms: Option<Vec<Bound<'py, PyAny>>>,
        exclude: Option<Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        if let Some(body) = &body {
            let placed = py.import("stepper._quantities")?.call_method1("around_body", (slf, points, directions, body, axes))?;
            (points, directions) = placed.extract()?;
        }
        let mut slf = borrow(slf)?;
        let model = slf.simulation.model().clone();
        let except = exclude.or(body).map(|body| Kind::Body.find(&model, &body)).transpose()?;
        let geoms = match geoms {
            None => model.geoms_met_by_rays(except),
            Some(given) => {
                let found: Vec<usize> = given.iter().map(|geom| Kind::Geom.find(&model, geom)).collect::<PyResult<_>>()?;
                found.into_iter().filter(|&g| Some(model.geoms[g].body) != except).collect()
            }
        };
        let (points, directions) = (readonly(&points, "points")?, readonly(&directions, "directions")?);
        let count = if points.ndim() >= 2 { points.shape()[points.ndim() - 2] } else { 0 };
        for (name, shape) in [("points", points.shape()), ("directions", directions.shape())] {
            check_shape(name, shape, &[&slf.shape(&[count, 3]), &[count, 3]])?;
        }
        slf.apply(py)?;
        let (points, directions) = (points.as_slice()?.to_vec(), directions.as_slice()?.to_vec());
        let total = slf.simulation.num_envs() * count;
        let mut distances = OwnNumbers::new(total, slf.simulation.precision());
        let mut met = vec![-1; total];
        let (simulation, numbers) = (&mut slf.simulation, distances.numbers());
        py.detach(|| {
            let rays = RayCast { points: &points, directions: &directions, count, geoms: &geoms };
            simulation.cast_rays(&rays, numbers, &mut met)
        })
        .map_err(value_error)?;
        let shape = slf.shape(&[count]);
        let met = ArrayD::from_shape_vec(&shape[..], met).map_err(|e| PyValueError::new_err(e.to_string()))?;
        Ok((distances.into_array(py, &shape)?, met.into_pyarray(py).into_any()))
    }
}
