//! Quantities of all environments outside a step: poses, velocities, forces, Jacobians, mass matrix, energy, momentum.

use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use stepper_core::model::ElementKind;
use stepper_core::{DerivedQuantity, Precision, Snapshot, StepInputs};

use crate::arguments::{Env, index_of, no_others};
use crate::array::{OwnNumbers, array, read_only};
use crate::error::value_error;
use crate::getters::getters;
use crate::stepper::{Stepper, Writing};

impl Stepper {
    /// New NumPy arrays of derived quantities for all environments, computed in one pass over the environments.
    pub(super) fn derive<'py>(&mut self, py: Python<'py>, quantities: &[DerivedQuantity]) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let (model, precision) = (self.simulation.model(), self.simulation.precision());
        let shapes: Vec<_> = quantities.iter().map(|q| self.shape(&q.shape(model))).collect();
        let mut data: Vec<_> = shapes.iter().map(|shape| OwnNumbers::new(shape.iter().product(), precision)).collect();
        let simulation = &mut self.simulation;
        py.detach(|| simulation.derive_together(quantities.iter().copied().zip(data.iter_mut().map(OwnNumbers::numbers)).collect()))
            .map_err(value_error)?;
        data.into_iter().zip(&shapes).map(|(data, shape)| data.into_array(py, shape)).collect()
    }

    /// Read-only NumPy array of a derived quantity for all environments. It is cached until the state, the parameters or an input changes.
    fn derived<'py>(&mut self, py: Python<'py>, quantity: DerivedQuantity) -> PyResult<Bound<'py, PyAny>> {
        self.apply(py)?;
        if let Some(known) = self.derived.get(self.simulation.revision(), quantity) {
            return Ok(known.bind(py).clone());
        }
        let quantities = self.derived.together(quantity);
        let mut made = self.derive(py, &quantities)?.into_iter().zip(quantities).map(|(array, quantity)| {
            let array = read_only(array)?;
            self.derived.keep(quantity, array.clone().unbind());
            Ok(array)
        });
        let first = made.next().expect("the quantity that was asked for is the first")?;
        made.try_for_each(|array: PyResult<_>| array.map(|_| ()))?;
        Ok(first)
    }

    /// Concatenated results of `evaluate` for all environments. `evaluate` gets a snapshot of each environment with its current controls.
    fn of_each(&mut self, py: Python<'_>, evaluate: impl Fn(&mut Snapshot<'_>) -> Vec<f64>) -> PyResult<Vec<f64>> {
        self.apply(py)?;
        let mut values = Vec::new();
        for env in 0..self.n() {
            values.extend(evaluate(&mut self.simulation.snapshot(env, &StepInputs::default()).map_err(value_error)?));
        }
        Ok(values)
    }

    /// Splits the rows of `rows` into two arrays (num_envs, *width). Each row, one per environment, consists of two halves of shape
    /// `width`. If the stepper was created without `num_envs`, scalar halves give Python floats.
    fn halves<'py>(&self, py: Python<'py>, rows: &[f64], width: &[usize]) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let size: usize = width.iter().product();
        let half = |k: usize| {
            let values = rows.chunks_exact(2 * size).flat_map(|row| row[k * size..][..size].iter().copied()).collect();
            let values = array(py, &self.shape(width), values, Precision::F64)?;
            if self.batched || !width.is_empty() { Ok(values) } else { values.call_method0("item") }
        };
        Ok((half(0)?, half(1)?))
    }
}

#[pymethods]
impl Stepper {
    /// Jacobian of a body frame or a site at the current `qpos`, with velocity = `jacobian @ qvel`.
    ///
    /// Args:
    ///     body: Name or index of a body.
    ///     site: Name or index of a site, instead of a body.
    ///
    /// Returns:
    ///     Jacobian in world axes, (num_envs, 6, nv): three rows for the linear velocity, then three for the angular velocity.
    ///
    /// Raises:
    ///     ValueError: Both or none of body and site are given.
    ///     KeyError: The model has no body or site of that name.
    ///     IndexError: The model has no body or site of that index.
    #[pyo3(signature = (body=None, site=None, **others), text_signature = "($self, body=None, site=None)")]
    fn jacobian<'py>(
        mut slf: Writing<'_>,
        py: Python<'py>,
        body: Option<Bound<'py, PyAny>>,
        site: Option<Bound<'py, PyAny>>,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        no_others("Stepper.jacobian", others, &["body", "site"])?;
        let model = slf.simulation.model();
        let quantity = match (body, site) {
            (Some(body), None) => DerivedQuantity::BodyJacobian(index_of(model, ElementKind::Body, &body).map_err(|error| {
                if body.is_instance_of::<PyString>() && index_of(model, ElementKind::Site, &body).is_ok() {
                    let name = body.repr().map_or_else(|_| body.to_string(), |name| name.to_string());
                    return PyKeyError::new_err(format!("no body is named {name}, but a site is: jacobian(site={name})"));
                }
                error
            })?),
            (None, Some(site)) => DerivedQuantity::SiteJacobian(index_of(model, ElementKind::Site, &site)?),
            (Some(_), Some(_)) => return Err(PyValueError::new_err("jacobian has both body and site: give one of them")),
            (None, None) => return Err(PyValueError::new_err("jacobian has neither body nor site: give body= or site=, by name or index")),
        };
        slf.apply(py)?;
        Ok(slf.derive(py, &[quantity])?.remove(0))
    }

    /// Mass matrices at the current configurations, including armature, without terms that depend on the time step.
    ///
    /// Returns:
    ///     Mass matrices, (num_envs, nv, nv), in the precision of the stepper.
    #[pyo3(signature = (**others), text_signature = "($self)")]
    fn mass_matrix<'py>(mut slf: Writing<'_>, py: Python<'py>, others: Option<&Bound<'_, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
        no_others("Stepper.mass_matrix", others, &[])?;
        slf.apply(py)?;
        Ok(slf.derive(py, &[DerivedQuantity::MassMatrix])?.remove(0))
    }

    /// Mass matrix, bias force, smooth acceleration, energies and momenta of an environment, for the tests' reference trajectories.
    ///
    /// The list has these quantities in this order. They are computed in 64 bits, also for a stepper with precision "f32".
    fn _in_64_bits<'py>(mut slf: Writing<'_>, py: Python<'py>, env: Env) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let env = slf.env(env)?;
        slf.apply(py)?;
        let snapshot = slf.simulation.snapshot(env, &StepInputs::default()).map_err(value_error)?;
        let (mass, bias, smooth) = (snapshot.mass_matrix(), snapshot.bias_force(), snapshot.smooth_acceleration());
        let ((potential, kinetic), (linear, angular)) = (snapshot.energy(), snapshot.momentum());
        let nv = bias.len();
        let arrays = [
            (vec![nv, nv], mass),
            (vec![nv], bias),
            (vec![nv], smooth),
            (vec![2], vec![potential, kinetic]),
            (vec![2, 3], linear.into_iter().chain(angular).collect()),
        ];
        arrays.into_iter().map(|(shape, values)| array(py, &shape, values, Precision::F64)).collect()
    }

    /// Potential energy (gravity, springs of joints and tendons) and kinetic energy (including armature) at the current states.
    ///
    /// Bodies that are fixed to the world do not count. MuJoCo's `energy` adds their constant potential energy.
    ///
    /// Returns:
    ///     Potential and kinetic energies: two arrays (num_envs,) float64, J.
    fn energy<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let rows = slf.of_each(py, |snapshot| <[f64; 2]>::from(snapshot.energy()).to_vec())?;
        slf.halves(py, &rows, &[])
    }

    /// Linear momentum, and angular momentum about the centre of mass, at the current states.
    ///
    /// Returns:
    ///     Linear and angular momenta in world axes: two arrays (num_envs, 3) float64, kg m/s and kg m^2/s.
    fn momentum<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let rows = slf.of_each(py, |snapshot| <[[f64; 3]; 2]>::from(snapshot.momentum()).concat())?;
        slf.halves(py, &rows, &[3])
    }
}

getters! { Stepper, |mut slf, py| (Writing<'_>) -> PyResult<Bound<'py, PyAny>>;
    /// Positions of the body frames at the current `qpos`, (num_envs, nbody, 3), m. Body 0 is the world. The positions belong to the state
    /// after the step, as after MuJoCo's `mj_forward`, and unlike after `mj_step`. The first read of a derived quantity computes it for all
    /// environments. The result is cached until the state, the parameters or an input changes. Quantities that are read together are
    /// computed in one pass.
    xpos: slf.derived(py, DerivedQuantity::BodyPos),
    /// Orientations of the body frames at the current `qpos`, quaternions (w, x, y, z), (num_envs, nbody, 4).
    xquat: slf.derived(py, DerivedQuantity::BodyQuat),
    /// Linear velocities of the body frames at the current state in world axes, (num_envs, nbody, 3), m/s. Mocap bodies have zero velocity,
    /// as in MuJoCo.
    body_linvel: slf.derived(py, DerivedQuantity::BodyLinVel),
    /// Angular velocities of the bodies at the current state in world axes, (num_envs, nbody, 3), rad/s.
    body_angvel: slf.derived(py, DerivedQuantity::BodyAngVel),
    /// Positions of the sites at the current `qpos`, (num_envs, nsite, 3), m.
    site_xpos: slf.derived(py, DerivedQuantity::SitePos),
    /// Orientations of the sites at the current `qpos`, quaternions (w, x, y, z), (num_envs, nsite, 4).
    site_xquat: slf.derived(py, DerivedQuantity::SiteQuat),
    /// Positions of the geoms at the current `qpos`, (num_envs, ngeom, 3), m.
    geom_xpos: slf.derived(py, DerivedQuantity::GeomPos),
    /// Orientations of the geoms at the current `qpos`, quaternions (w, x, y, z), (num_envs, ngeom, 4).
    geom_xquat: slf.derived(py, DerivedQuantity::GeomQuat),
    /// Centre of mass of each body with its descendants at the current `qpos`, (num_envs, nbody, 3), m. Row 0, of the world, is the centre
    /// of mass of the whole scene.
    subtree_com: slf.derived(py, DerivedQuantity::SubtreeCom),
    /// Centres of mass of the bodies at the current `qpos`, (num_envs, nbody, 3), m.
    xipos: slf.derived(py, DerivedQuantity::BodyCom),
    /// Inertias of the bodies about the centre of mass of their tree in world axes, (num_envs, nbody, 10), as MuJoCo's `cinert`. The
    /// columns are the inertia xx, yy, zz, xy, xz, yz (kg m^2), mass times position of the centre of mass (3, kg m), and mass (kg). The row
    /// of the world is zero. A tree is a child of the world with its descendants.
    cinert: slf.derived(py, DerivedQuantity::BodyInertia),
    /// Velocities of the bodies about the centre of mass of their kinematic tree in world axes, (num_envs, nbody, 6), as MuJoCo's `cvel`.
    /// The columns are angular velocity (3, rad/s), and linear velocity (3, m/s) of the body-fixed point at that centre of mass.
    cvel: slf.derived(py, DerivedQuantity::BodyMotion),
    /// Torques (3, N m) and forces (3, N) of the contacts of the last step on the bodies, about the centre of mass of their kinematic tree
    /// in world axes, (num_envs, nbody, 6). The row of the world is zero, and all rows are zero before the first step after a reset or
    /// `set_state`. MuJoCo's `cfrc_ext` also includes `xfrc_applied` and connect and weld equalities.
    cfrc_ext: slf.derived(py, DerivedQuantity::BodyForce),
    /// Acceleration of the last step, including impulses of contacts and limits, (num_envs, nv), m/s^2 or rad/s^2. It is the change of
    /// velocity divided by the time step.
    ///
    /// Before the first step after a reset or `set_state`, it is the acceleration of a step from the current state. This also holds for
    /// `qfrc_constraint` and `body_contact_force`.
    qacc: slf.derived(py, DerivedQuantity::Acceleration),
    /// Coriolis, centrifugal and gravitational forces at the current state, (num_envs, nv), N or N m, as after `mj_forward`.
    qfrc_bias: slf.derived(py, DerivedQuantity::BiasForce),
    /// Acceleration without constraints at the current state and controls, (num_envs, nv), m/s^2 or rad/s^2, as after `mj_forward`. If the
    /// stepper has an actuator model, the forces of its drives are those of the last step.
    qacc_smooth: slf.derived(py, DerivedQuantity::SmoothAcceleration),
    /// Actuator forces before the gear at the current state and controls, (num_envs, nu), N or N m, as after `mj_forward`.
    actuator_force: slf.derived(py, DerivedQuantity::ActuatorForce),
    /// Joint forces of the actuators, clipped to `actuatorfrcrange`, (num_envs, nv), N or N m.
    qfrc_actuator: slf.derived(py, DerivedQuantity::JointActuatorForce),
    /// Joint forces of all constraints in the last step, (num_envs, nv), N or N m: impulses of contacts, limits, dry friction, equalities
    /// and tendons, divided by the time step.
    qfrc_constraint: slf.derived(py, DerivedQuantity::JointConstraintForce),
    /// Force (3, N) and torque (3, N m) of all contacts of the last step on each body in world axes, (num_envs, nbody, 6). The torque is
    /// about the body's current centre of mass.
    body_contact_force: slf.derived(py, DerivedQuantity::BodyContactForce),
    /// Paths of the spatial tendons at the current `qpos` in the world frame, (num_envs, n, 10, 3), m, with one row for each of the n parts
    /// between two sites. The points are the first site, eight points on the sphere or cylinder between the sites, or on the straight line,
    /// and the second site.
    tendon_paths: slf.derived(py, DerivedQuantity::TendonPaths),
    /// Numbers of the equalities with which each has no position error at the current `qpos`, (num_envs, neq, 11), in the layout of
    /// `eq_data`. A weld that `randomize` gives these numbers holds the bodies in their current relative pose. A connect keeps its anchor
    /// in the first body and a weld its anchor in the second. A coupling keeps its polynomial except for the constant term.
    closed_eq_data: slf.derived(py, DerivedQuantity::ClosedEqualityData),
}
