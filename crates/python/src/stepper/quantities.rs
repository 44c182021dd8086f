//! Quantities of one environment outside a step: mass matrix, forces, energy, momentum.

use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use stepper_core::{DerivedQuantity, Precision, Snapshot, StepInputs};

use crate::arguments::Env;
use crate::array::{array, check_shape, readonly};
use crate::error::value_error;
use crate::stepper::{Stepper, Writing};

impl Stepper {
    /// One environment with these controls, those in force where there are none.
    fn snapshot(&mut self, py: Python<'_>, env: Env, ctrl: &[f64]) -> PyResult<Snapshot<'_>> {
        let env = self.env(env)?;
        self.apply(py)?;
        self.simulation.snapshot(env, &StepInputs { ctrl, ..StepInputs::default() }).map_err(value_error)
    }

    /// A quantity of all environments, in one pass.
    fn of_all<'py>(&mut self, py: Python<'py>, quantity: DerivedQuantity) -> PyResult<Bound<'py, PyAny>> {
        self.apply(py)?;
        Ok(self.derive(py, &[quantity])?.remove(0))
    }
}

#[pymethods]
impl Stepper {
    /// Mass matrix of the present configuration, armature included, without terms that depend on the time step.
    ///
    /// Args:
    ///     env: The environment; None is all of them, in one pass.
    ///
    /// Returns:
    ///     (nv, nv) float64; of all environments (num_envs, nv, nv), in the stepper's scalar type.
    #[pyo3(signature = (env=Some(Env(0))), text_signature = "($self, env=0)")]
    fn mass_matrix<'py>(mut slf: Writing<'_>, py: Python<'py>, env: Option<Env>) -> PyResult<Bound<'py, PyAny>> {
        let Some(env) = env else { return slf.of_all(py, DerivedQuantity::MassMatrix) };
        let nv = slf.simulation.model().nv();
        array(py, &[nv, nv], slf.snapshot(py, env, &[])?.mass_matrix(), Precision::F64)
    }

    /// Coriolis, centrifugal and gravitational forces of the present state: MuJoCo's qfrc_bias.
    ///
    /// Args:
    ///     env: The environment; None is all of them, in one pass.
    ///
    /// Returns:
    ///     (nv,) float64; of all environments (num_envs, nv), in the stepper's scalar type.
    #[pyo3(signature = (env=Some(Env(0))), text_signature = "($self, env=0)")]
    fn bias_force<'py>(mut slf: Writing<'_>, py: Python<'py>, env: Option<Env>) -> PyResult<Bound<'py, PyAny>> {
        let Some(env) = env else { return slf.of_all(py, DerivedQuantity::BiasForce) };
        let out = slf.snapshot(py, env, &[])?.bias_force();
        array(py, &[out.len()], out, Precision::F64)
    }

    /// Acceleration without constraints in the present state: MuJoCo's qacc_smooth.
    ///
    /// Args:
    ///     env: The environment; None is all of them, in one pass.
    ///     ctrl: Controls of one environment, (nu,); None is those in force. With `actuators=`, what the drives hand on to the
    ///         actuators' law (None is what they did last).
    ///
    /// Returns:
    ///     (nv,) float64; of all environments (num_envs, nv), in the stepper's scalar type.
    ///
    /// Raises:
    ///     ValueError: Controls of another shape, or for all environments.
    #[pyo3(signature = (env=Some(Env(0)), *, ctrl=None), text_signature = "($self, env=0, *, ctrl=None)")]
    fn smooth_acceleration<'py>(
        mut slf: Writing<'_>,
        py: Python<'py>,
        env: Option<Env>,
        ctrl: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let Some(env) = env else {
            if ctrl.is_some() {
                return Err(PyValueError::new_err("ctrl is for one environment, and env is None: leave it out for the controls in force"));
            }
            return slf.of_all(py, DerivedQuantity::SmoothAcceleration);
        };
        let ctrl = ctrl.as_ref().map(|ctrl| readonly(ctrl, "ctrl")).transpose()?;
        if let Some(ctrl) = &ctrl {
            check_shape("ctrl", ctrl.shape(), &[&[slf.simulation.model().nu()]])?;
        }
        let ctrl = ctrl.as_ref().map_or(Ok(&[][..]), |ctrl| ctrl.as_slice())?;
        let out = slf.snapshot(py, env, ctrl)?.smooth_acceleration();
        array(py, &[out.len()], out, Precision::F64)
    }

    /// Potential energy (gravity, joint springs) and kinetic energy (armature included), in J.
    #[pyo3(signature = (env=Env(0)), text_signature = "($self, env=0)")]
    fn energy(mut slf: Writing<'_>, py: Python<'_>, env: Env) -> PyResult<(f64, f64)> {
        Ok(slf.snapshot(py, env, &[])?.energy())
    }

    /// Linear momentum in kg m/s (3,), and angular momentum about the centre of mass in kg m^2/s (3,).
    #[pyo3(signature = (env=Env(0)), text_signature = "($self, env=0)")]
    fn momentum<'py>(mut slf: Writing<'_>, py: Python<'py>, env: Env) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let (linear, angular) = slf.snapshot(py, env, &[])?.momentum();
        Ok((array(py, &[3], linear.to_vec(), Precision::F64)?, array(py, &[3], angular.to_vec(), Precision::F64)?))
    }
}
