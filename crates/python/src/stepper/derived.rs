//! Quantities derived from the states of all environments and from their last step.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use stepper_core::DerivedQuantity;

use crate::array::{array, read_only};
use crate::elements::Kind;
use crate::error::value_error;
use crate::stepper::Stepper;

impl Stepper {
    /// A quantity as an array of its own.
    fn derive<'py>(&mut self, py: Python<'py>, quantity: DerivedQuantity) -> PyResult<Bound<'py, PyAny>> {
        let shape = self.shape(&quantity.shape(self.simulation.model()));
        let mut data = vec![0.0; shape.iter().product()];
        let simulation = &mut self.simulation;
        py.detach(|| simulation.derive(quantity, &mut data)).map_err(value_error)?;
        array(py, &shape, data, self.simulation.precision())
    }

    /// The read-only array of a quantity, the same one as long as nothing has changed.
    fn derived<'py>(&mut self, py: Python<'py>, quantity: DerivedQuantity) -> PyResult<Bound<'py, PyAny>> {
        self.apply(py)?;
        if let Some(known) = self.derived.get(self.simulation.revision(), quantity) {
            return Ok(known.bind(py).clone());
        }
        let made = read_only(self.derive(py, quantity)?, quantity.name())?;
        self.derived.keep(quantity, made.clone().unbind());
        Ok(made)
    }
}

#[pymethods]
impl Stepper {
    /// Positions of the bodies at the present `qpos`: (num_envs, nbody, 3) in m, of their frames' origins. Body 0 is the world.
    /// MuJoCo's `mj_step` leaves those before the step, `mj_forward` these. Like all that is derived from the state, they are computed
    /// when asked for, of all environments at once, and the array is the same one until something changes.
    #[getter]
    fn xpos<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.derived(py, DerivedQuantity::BodyPos)
    }

    /// Orientations of the bodies at the present `qpos`: (num_envs, nbody, 4).
    #[getter]
    fn xquat<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.derived(py, DerivedQuantity::BodyQuat)
    }

    /// Velocities of the bodies' frames at the present state in world axes: (num_envs, nbody, 3) in m/s. Bodies that the user poses
    /// stand still, as in MuJoCo.
    #[getter]
    fn body_linvel<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.derived(py, DerivedQuantity::BodyLinVel)
    }

    /// Angular velocities of the bodies at the present state in world axes: (num_envs, nbody, 3) in rad/s.
    #[getter]
    fn body_angvel<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.derived(py, DerivedQuantity::BodyAngVel)
    }

    /// Positions of the sites at the present `qpos`: (num_envs, nsite, 3) in m.
    #[getter]
    fn site_xpos<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.derived(py, DerivedQuantity::SitePos)
    }

    /// Orientations of the sites at the present `qpos`: (num_envs, nsite, 4).
    #[getter]
    fn site_xquat<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.derived(py, DerivedQuantity::SiteQuat)
    }

    /// Positions of the geoms at the present `qpos`: (num_envs, ngeom, 3) in m.
    #[getter]
    fn geom_xpos<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.derived(py, DerivedQuantity::GeomPos)
    }

    /// Orientations of the geoms at the present `qpos`: (num_envs, ngeom, 4).
    #[getter]
    fn geom_xquat<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.derived(py, DerivedQuantity::GeomQuat)
    }

    /// Centres of mass of every body with all that hangs from it at the present `qpos`: (num_envs, nbody, 3) in m. Row 0 is that of the
    /// whole scene.
    #[getter]
    fn subtree_com<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.derived(py, DerivedQuantity::SubtreeCom)
    }

    /// Acceleration (v+ - v) / h of the last step, impulses of contacts and limits included: (num_envs, nv).
    ///
    /// Where no step was made since the state was set, it is that of the step that would be made from it; so are `qfrc_constraint` and
    /// `body_contact_force`.
    #[getter]
    fn qacc<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.derived(py, DerivedQuantity::Acceleration)
    }

    /// Forces of the actuators at the present state with the controls in force, before their gears: (num_envs, nu) in N or N m. As
    /// `mj_forward` leaves them.
    #[getter]
    fn actuator_force<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.derived(py, DerivedQuantity::ActuatorForce)
    }

    /// Forces of the actuators on the joints, within the joints' `actuatorfrcrange`: (num_envs, nv) in N or N m.
    #[getter]
    fn qfrc_actuator<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.derived(py, DerivedQuantity::JointActuatorForce)
    }

    /// Force of all constraints of the last step on the joints, its impulse over h: contacts, limits, dry friction, equalities and
    /// tendons: (num_envs, nv) in N or N m.
    #[getter]
    fn qfrc_constraint<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.derived(py, DerivedQuantity::JointConstraintForce)
    }

    /// Force (3) in N and torque (3) in N m of all contacts of the last step on every body, world axes: (num_envs, nbody, 6). The torque
    /// is about the body's present centre of mass.
    #[getter]
    fn body_contact_force<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.derived(py, DerivedQuantity::BodyContactForce)
    }

    /// Jacobian of the origin of a body's frame, or of a site, at the present `qpos`: its velocity is `jacobian @ qvel`.
    ///
    /// Args:
    ///     body: Name or index of a body.
    ///     site: Name or index of a site, instead.
    ///
    /// Returns:
    ///     (num_envs, 6, nv), world axes: three rows of the linear velocity, then three of the angular one.
    ///
    /// Raises:
    ///     ValueError: Both were given, or neither.
    ///     KeyError: No body or site of that name.
    ///     IndexError: No body or site of that index.
    #[pyo3(signature = (body=None, site=None))]
    fn jacobian<'py>(
        &mut self,
        py: Python<'py>,
        body: Option<Bound<'py, PyAny>>,
        site: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let model = self.simulation.model();
        let quantity = match (body, site) {
            (Some(body), None) => DerivedQuantity::BodyJacobian(Kind::Body.find(model, &body)?),
            (None, Some(site)) => DerivedQuantity::SiteJacobian(Kind::Site.find(model, &site)?),
            (Some(_), Some(_)) => return Err(PyValueError::new_err("jacobian has both body and site, must have one of them")),
            (None, None) => return Err(PyValueError::new_err("jacobian of what: give body= or site=, by name or index")),
        };
        self.apply(py)?;
        self.derive(py, quantity)
    }
}
