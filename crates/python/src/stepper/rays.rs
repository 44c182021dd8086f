//! Ray casting in all environments.

use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use stepper_core::RayCast;
use stepper_core::model::ElementKind;

use crate::arguments::{index_of, no_others, required};
use crate::array::{OwnNumbers, check_shape, float64_array, shape_text, shaped};
use crate::error::value_error;
use crate::stepper::{Stepper, Writing};

#[pymethods]
impl Stepper {
    /// Distances and geoms that rays hit at the current states: MuJoCo's `mj_ray` for many rays of all environments in one pass.
    ///
    /// Rays hit planes from the front only; planes are infinite. Rays hit the triangles of meshes, also of those that collide as a hull,
    /// and the top, sides and base of height fields. A ray that starts inside a geom hits its surface from inside. Visual geoms with
    /// primitive shapes are hit; visual meshes are not part of the model.
    ///
    /// Args:
    ///     points: Origins of n rays per environment, (num_envs, n, 3), or (n, 3) for all environments, m. With `body`, they are relative
    ///         to the origin of the body's frame.
    ///     directions: Directions of the n rays, of any positive length, (num_envs, n, 3) or (n, 3).
    ///     body: Name or index of the body that carries the rays, such as a lidar. Its geoms are not hit. None fixes the rays to the world.
    ///     axes: Axes of points and directions if `body` is given. "body" selects the axes of the body, "heading" the world axes rotated by
    ///         the heading of the body, and "world" the world axes.
    ///     geoms: Names or indices of the geoms that rays can hit. None selects all geoms.
    ///     exclude: Name or index of a body whose geoms are not hit. None excludes the geoms of `body`.
    ///
    /// Returns:
    ///     Distances, (num_envs, n), m, in the precision of the stepper, and indices of the hit geoms, (num_envs, n) int32. Both are -1 for
    ///     rays without a hit.
    ///
    /// Raises:
    ///     ValueError: A shape is wrong, `axes` is unknown, a point is not finite, a direction is zero, or a mesh is not part of the model.
    ///     KeyError, IndexError: The model has no geom or body of that name or index.
    #[expect(clippy::too_many_arguments, reason = "Python's keywords")]
    #[pyo3(
        signature = (points=None, directions=None, *, body=None, axes="body", geoms=None, exclude=None, **others),
        text_signature = "($self, points, directions, *, body=None, axes='body', geoms=None, exclude=None)"
    )]
    fn rays<'py>(
        slf: &Bound<'py, Self>,
        py: Python<'py>,
        points: Option<Bound<'py, PyAny>>,
        directions: Option<Bound<'py, PyAny>>,
        body: Option<Bound<'py, PyAny>>,
        axes: &str,
        geoms: Option<Vec<Bound<'py, PyAny>>>,
        exclude: Option<Bound<'py, PyAny>>,
        others: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        no_others("Stepper.rays", others, &["points", "directions", "body", "axes", "geoms", "exclude"])?;
        let mut points = required("Stepper.rays", "points", points)?;
        let mut directions = required("Stepper.rays", "directions", directions)?;
        if let Some(body) = &body {
            let placed = py.import("stepper._quantities")?.call_method1("around_body", (slf, points, directions, body, axes))?;
            (points, directions) = placed.extract()?;
        }
        let mut slf = Writing::try_from(slf)?;
        let model = slf.simulation.model().clone();
        let except = exclude.or(body).map(|body| index_of(&model, ElementKind::Body, &body)).transpose()?;
        let geoms = match geoms {
            None => model.geoms_met_by_rays(except),
            Some(given) => {
                let found: Vec<usize> = given.iter().map(|geom| index_of(&model, ElementKind::Geom, geom)).collect::<PyResult<_>>()?;
                found.into_iter().filter(|&g| Some(model.geoms[g].body) != except).collect()
            }
        };
        let (points, directions) = (float64_array(&points, "points")?, float64_array(&directions, "directions")?);
        let &[.., count, _] = points.shape() else {
            let shape = shape_text(points.shape());
            return Err(PyValueError::new_err(format!("points has shape {shape}, must be (n, 3) for n rays, as [[0, 0, 1]] for one")));
        };
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
        Ok((distances.into_array(py, &shape)?, shaped(py, &shape, met)?))
    }
}
