//! What became of the last call: flags, the solver's certificate, contacts.

use std::path::PathBuf;

use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use stepper_core::StepInputs;

use crate::arguments::{Env, no_others};
use crate::array::read_only;
use crate::contacts::structured;
use crate::error::value_error;
use crate::stepper::{Reading, Stepper, Writing};

#[pymethods]
impl Stepper {
    /// Flags of the last call of `step`, see `stepper.Status`: (num_envs,) uint32.
    #[getter]
    fn status<'py>(slf: Reading<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.per_env(py, "status", |env| slf.simulation.status(env).bits())
    }

    /// Natural-map residual of the last step in m/s, 0 where it was NON_FINITE: (num_envs,).
    #[getter]
    fn residual<'py>(slf: Reading<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.per_env(py, "residual", |env| slf.simulation.certificate(env).residual)
    }

    /// Iterations of the solver in the last step, Gauss-Seidel iterations and Newton steps together: (num_envs,) uint32.
    #[getter]
    fn iterations<'py>(slf: Reading<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let both = |env| slf.simulation.certificate(env).sweeps + slf.simulation.certificate(env).newton_steps;
        slf.per_env(py, "iterations", both)
    }

    /// Newton steps of the solver in the last step, over all islands of bodies: (num_envs,) uint32. The rest of `iterations` are
    /// Gauss-Seidel iterations.
    #[getter]
    fn newton_steps<'py>(slf: Reading<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.per_env(py, "newton_steps", |env| slf.simulation.certificate(env).newton_steps)
    }

    /// Largest penetration of a contact beyond its margin in any step of the last call of `step`, in m: (num_envs,) float64. A step
    /// measures it where it detects contacts, "midpoint" and "rk4" in the middle of the step. Above 1 mm `status` has DEEP.
    #[getter]
    fn max_penetration<'py>(slf: Reading<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.per_env(py, "max_penetration", |env| slf.simulation.depth(env))
    }

    /// Largest violation of the range of a joint or tendon after any step of the last call of `step`, in rad or m: (num_envs,)
    /// float64. Above 0.01 `status` has OVER_LIMIT.
    #[getter]
    fn max_limit_violation<'py>(slf: Reading<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.per_env(py, "max_limit_violation", |env| slf.simulation.limit_overshoot(env))
    }

    /// Largest position error of an equality (connect, weld, joint, tendon) after any step of the last call of `step`, in m or rad:
    /// (num_envs,) float64. Above 0.001 `status` has EQUALITY_VIOLATED. It is 0 without equalities. Equalities with a finite
    /// stiffness are springs and are not included. With contact="mujoco" all equalities are soft, and all are included.
    #[getter]
    fn max_equality_violation<'py>(slf: Reading<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        slf.per_env(py, "max_equality_violation", |env| slf.simulation.max_equality_violation(env))
    }

    /// Steps of the last call of `step` in which the effort of each actuator was cut to its bounds: its `forcerange`, its joint's
    /// `actuatorfrcrange`, or the limits and torque-speed curve of its drive: (num_envs, nu) uint32.
    #[getter]
    fn actuator_saturation<'py>(slf: Reading<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let counts: Vec<u32> = (0..slf.n()).flat_map(|env| slf.simulation.actuator_saturation(env)).collect();
        let shape = slf.shape(&[slf.simulation.model().nu()]);
        read_only(PyArray1::from_vec(py, counts).reshape(shape)?.into_any(), "actuator_saturation")
    }

    /// Contacts of the last step: those that were given a row.
    ///
    /// That is every one that the motion can close within the step, also contacts that do not touch (distance > 0), mostly without
    /// force. Distances are measured from the margin, at which contacts begin to push. A gap, which in MuJoCo 4 reports contacts
    /// beyond the margin that do not push, has no effect here: what is farther than a step away is not listed.
    ///
    /// Args:
    ///     envs: Which environments, as of `reset`, one after the other.
    ///
    /// Returns:
    ///     A structured array: env, geom (2,), body (2,), pos (3,) in m, normal (3,) from the first geom to the second, distance in m
    ///     from the margin, force (3,) in N on the second geom along normal, t1, t2, torque (3,) in N m on it about the same
    ///     directions, of torsional and rolling friction (condim 4 and 6), and frame (3, 3), whose rows are these directions. The
    ///     second geom's torque acts at pos, and |(force_t / mu_slide, torque_n / mu_spin, torque_t / mu_roll)| <= force_n.
    #[pyo3(signature = (envs=None, **others), text_signature = "($self, envs=None)")]
    fn contacts<'py>(
        slf: Reading<'_>,
        py: Python<'py>,
        envs: Option<Bound<'py, PyAny>>,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        no_others("Stepper.contacts", others, &["envs"])?;
        let selection = slf.selection(envs.as_ref())?;
        structured(py, &slf.simulation, selection.envs)
    }

    /// The row that the last call of `step` could not solve.
    ///
    /// Where `status` says NOT_CONVERGED, it is the one with the largest residual in the last step that was not solved.
    ///
    /// Args:
    ///     env: The environment.
    ///
    /// Returns:
    ///     For example 'contact of geom "floor" and geom "foot"', 'limit of joint "knee"' or 'equality "loop"'; None where every step
    ///     was solved, or no single row is to blame.
    #[pyo3(signature = (env=Env(0), **others), text_signature = "($self, env=0)")]
    fn worst_row(slf: Reading<'_>, env: Env, others: Option<&Bound<'_, PyDict>>) -> PyResult<Option<String>> {
        no_others("Stepper.worst_row", others, &["env"])?;
        let row = slf.simulation.worst_row(slf.env(env)?);
        Ok(row.map(|row| row.describe(slf.simulation.model()).to_string()))
    }

    /// Writes the constraint problem of the next step to a file.
    ///
    /// It has the impulses that the solve starts from, so that a hard problem becomes a test of the solver: in Rust,
    /// `stepper_solve::Problem::load(path)` reads it.
    ///
    /// The problem is that of a step from the present state, which does not change. For a step that was not solved (NOT_CONVERGED), go
    /// back to the state before it: `before = sim.get_state()` before the step, and then `sim.set_state(before)`.
    ///
    /// Args:
    ///     path: The file; what is there is replaced.
    ///     env: The environment.
    ///     ctrl: Controls of the step, as `step` takes them; None is those in force.
    ///
    /// Raises:
    ///     OSError: The file cannot be written.
    #[pyo3(signature = (path, env=Env(0), *, ctrl=None, **others), text_signature = "($self, path, env=0, *, ctrl=None)")]
    fn save_problem(
        mut slf: Writing<'_>,
        py: Python<'_>,
        path: PathBuf,
        env: Env,
        ctrl: Option<Bound<'_, PyAny>>,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<()> {
        no_others("Stepper.save_problem", others, &["path", "env", "ctrl"])?;
        let env = slf.env(env)?;
        let ctrl = match ctrl {
            Some(ctrl) => slf.rows(&ctrl, "ctrl", slf.simulation.model().nu())?.as_slice()?.to_vec(),
            None => Vec::new(),
        };
        slf.apply(py)?;
        slf.simulation.save_problem(env, &StepInputs { ctrl: &ctrl, ..StepInputs::default() }, path).map_err(value_error)
    }
}
