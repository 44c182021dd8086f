//! Quantities derived from the states of all environments and from their last step.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use stepper_core::DerivedQuantity;

use crate::array::{OwnNumbers, read_only};
use crate::elements::Kind;
use crate::error::value_error;
use crate::stepper::{Stepper, Writing};

impl Stepper {
    /// Quantities, in one pass, as arrays of their own.
    pub(super) fn derive<'py>(&mut self, py: Python<'py>, quantities: &[DerivedQuantity]) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let (model, precision) = (self.simulation.model(), self.simulation.precision());
        let shapes: Vec<_> = quantities.iter().map(|q| self.shape(&q.shape(model))).collect();
        let mut data: Vec<_> = shapes.iter().map(|shape| OwnNumbers::new(shape.iter().product(), precision)).collect();
        let simulation = &mut self.simulation;
        py.detach(|| simulation.derive_together(quantities.iter().copied().zip(data.iter_mut().map(OwnNumbers::numbers)).collect()))
            .map_err(value_error)?;
        data.into_iter().zip(&shapes).map(|(data, shape)| data.into_array(py, shape)).collect()
    }

    /// The read-only array of a quantity, the same one as long as nothing has changed.
    fn derived<'py>(&mut self, py: Python<'py>, quantity: DerivedQuantity) -> PyResult<Bound<'py, PyAny>> {
        self.apply(py)?;
        if let Some(known) = self.derived.get(self.simulation.revision(), quantity) {
            return Ok(known.bind(py).clone());
        }
        let quantities = self.derived.together(quantity);
        let mut made = self.derive(py, &quantities)?.into_iter().zip(quantities).map(|(array, quantity)| {
            let array = read_only(array, quantity.name())?;
            self.derived.keep(quantity, array.clone().unbind());
            Ok(array)
        });
        let first = made.next().expect("the quantity that was asked for is the first")?;
        made.try_for_each(|array: PyResult<_>| array.map(|_| ()))?;
        Ok(first)
    }
}

#[pymethods]
impl Stepper {
    /// Positions of the bodies at the present `qpos`: (num_envs, nbody, 3) in m, of their frames' origins. Body 0 is the world.
    /// MuJoCo's `mj_step` leaves those before the step, `mj_forward` these. Like all that is derived from the state, they are computed
    /// when asked for, of all environments at once, and the array is the same one until something changes; what was asked for together
    /// after the last change is computed in one pass.
    #[getter]
    fn xpos<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::BodyPos)
    }

    /// Orientations of the bodies at the present `qpos`: (num_envs, nbody, 4).
    #[getter]
    fn xquat<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::BodyQuat)
    }

    /// Velocities of the bodies' frames at the present state in world axes: (num_envs, nbody, 3) in m/s. Bodies that the user poses
    /// stand still, as in MuJoCo.
    #[getter]
    fn body_linvel<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::BodyLinVel)
    }

    /// Angular velocities of the bodies at the present state in world axes: (num_envs, nbody, 3) in rad/s.
    #[getter]
    fn body_angvel<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::BodyAngVel)
    }

    /// Positions of the sites at the present `qpos`: (num_envs, nsite, 3) in m.
    #[getter]
    fn site_xpos<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::SitePos)
    }

    /// Orientations of the sites at the present `qpos`: (num_envs, nsite, 4).
    #[getter]
    fn site_xquat<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::SiteQuat)
    }

    /// Positions of the geoms at the present `qpos`: (num_envs, ngeom, 3) in m.
    #[getter]
    fn geom_xpos<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::GeomPos)
    }

    /// Orientations of the geoms at the present `qpos`: (num_envs, ngeom, 4).
    #[getter]
    fn geom_xquat<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::GeomQuat)
    }

    /// Centres of mass of every body with all that hangs from it at the present `qpos`: (num_envs, nbody, 3) in m. Row 0 is that of the
    /// whole scene.
    #[getter]
    fn subtree_com<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::SubtreeCom)
    }

    /// Centres of mass of the bodies at the present `qpos`: (num_envs, nbody, 3) in m.
    #[getter]
    fn xipos<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::BodyCom)
    }

    /// Inertias of the bodies about the centre of mass of their tree, world axes: (num_envs, nbody, 10), the inertia's xx, yy, zz, xy, xz,
    /// yz in kg m^2, the mass times the place of the body's centre of mass in kg m, the mass in kg. The world's row is zero. A tree is a
    /// child of the world with all that hangs from it.
    #[getter]
    fn cinert<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::BodyInertia)
    }

    /// Velocities of the bodies at the present state, of the point of each that is at the centre of mass of its tree, world axes:
    /// (num_envs, nbody, 6), angular velocity (3) in rad/s, linear velocity (3) in m/s.
    #[getter]
    fn cvel<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::BodyMotion)
    }

    /// Torques (3) in N m and forces (3) in N on the bodies of the contacts that the last step left, about the centre of mass of their
    /// tree, world axes: (num_envs, nbody, 6). The world's row is zero, and where no step was made since the state was set all are.
    /// MuJoCo counts `xfrc_applied` and connect and weld equalities as well.
    #[getter]
    fn cfrc_ext<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::BodyForce)
    }

    /// Acceleration (v+ - v) / h of the last step, impulses of contacts and limits included: (num_envs, nv).
    ///
    /// Where no step was made since the state was set, it is that of the step that would be made from it; so are `qfrc_constraint` and
    /// `body_contact_force`.
    #[getter]
    fn qacc<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::Acceleration)
    }

    /// Coriolis, centrifugal and gravitational forces of the present state: (num_envs, nv) in N or N m. As `mj_forward` leaves them.
    #[getter]
    fn qfrc_bias<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::BiasForce)
    }

    /// Acceleration without constraints at the present state with the controls in force: (num_envs, nv) in m/s^2 or rad/s^2. As
    /// `mj_forward` leaves it. With `actuators=`, drives contribute what they handed on in the last step.
    #[getter]
    fn qacc_smooth<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::SmoothAcceleration)
    }

    /// Forces of the actuators at the present state with the controls in force, before their gears: (num_envs, nu) in N or N m. As
    /// `mj_forward` leaves them.
    #[getter]
    fn actuator_force<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::ActuatorForce)
    }

    /// Forces of the actuators on the joints, within the joints' `actuatorfrcrange`: (num_envs, nv) in N or N m.
    #[getter]
    fn qfrc_actuator<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::JointActuatorForce)
    }

    /// Force of all constraints of the last step on the joints, its impulse over h: contacts, limits, dry friction, equalities and
    /// tendons: (num_envs, nv) in N or N m.
    #[getter]
    fn qfrc_constraint<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::JointConstraintForce)
    }

    /// Force (3) in N and torque (3) in N m of all contacts of the last step on every body, world axes: (num_envs, nbody, 6). The torque
    /// is about the body's present centre of mass.
    #[getter]
    fn body_contact_force<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.derived(py, DerivedQuantity::BodyContactForce)
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
        mut slf: Writing<'_>,
        py: Python<'py>,
        body: Option<Bound<'py, PyAny>>,
        site: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let model = slf.simulation.model();
        let quantity = match (body, site) {
            (Some(body), None) => DerivedQuantity::BodyJacobian(Kind::Body.find(model, &body)?),
            (None, Some(site)) => DerivedQuantity::SiteJacobian(Kind::Site.find(model, &site)?),
            (Some(_), Some(_)) => return Err(PyValueError::new_err("jacobian has both body and site, must have one of them")),
            (None, None) => return Err(PyValueError::new_err("jacobian of what: give body= or site=, by name or index")),
        };
        slf.apply(py)?;
        Ok(slf.derive(py, &[quantity])?.remove(0))
    }
}
