//! Results of the last call: status flags, residuals and iterations of the solver, contacts.

use std::path::PathBuf;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use stepper_core::StepInputs;

use crate::arguments::{Env, no_others};
use crate::contacts::structured;
use crate::error::value_error;
use crate::getters::getters;
use crate::stepper::{Reading, Stepper, Writing};

#[pymethods]
impl Stepper {
    /// Contacts of the last step: all that the solver considered. If the state was set since then, those of a trial step.
    ///
    /// They are the contacts that the motion can close within the step. Contacts that do not touch (distance > 0) mostly have no force.
    /// Distances are relative to the margin, at which contacts begin to push. The `gap` of a geom, with which MuJoCo 4 also reports
    /// contacts without force, has no effect: farther contacts are not listed.
    ///
    /// Args:
    ///     envs: Environments, as in `reset`. Their contacts are concatenated.
    ///
    /// Returns:
    ///     Structured array with these fields:
    ///
    ///     * env, geom (2,) and body (2,), indices
    ///     * pos (3,), m
    ///     * normal (3,), from the first geom to the second
    ///     * distance, m, relative to the margin
    ///     * force (3,), N, on the second geom along the rows of frame
    ///     * torque (3,), N m, of torsional and rolling friction (condim 4 and 6) on the second geom at pos, about the rows of frame
    ///     * frame (3, 3), with the rows normal, t1 and t2
    ///
    ///     Force and torque satisfy |(force_t / mu_slide, torque_n / mu_spin, torque_t / mu_roll)| <= force_n.
    #[pyo3(signature = (envs=None, **others), text_signature = "($self, envs=None)")]
    fn contacts<'py>(
        mut slf: Writing<'_>,
        py: Python<'py>,
        envs: Option<Bound<'py, PyAny>>,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        no_others("Stepper.contacts", others, &["envs"])?;
        let envs = slf.selection(envs.as_ref())?.envs;
        slf.apply(py)?;
        let simulation = &mut slf.simulation;
        let contacts = py.detach(|| simulation.contacts_at_state(&envs)).map_err(value_error)?;
        structured(py, &envs, &contacts)
    }

    /// Cause of the last unsolved step in the last call of `step`: a constraint, or an element that is not finite or too fast.
    ///
    /// With `status` NOT_CONVERGED it is the constraint with the largest residual, with INFEASIBLE the constraint that misses its target by
    /// most. With NON_FINITE it is the joint, body or actuator whose number is not finite. With UNRESOLVED alone it is the fastest joint,
    /// of the mechanisms that are too fast for the time step if these are known.
    ///
    /// Args:
    ///     env: Index of the environment.
    ///
    /// Returns:
    ///     Text such as 'contact of geom "floor" and geom "foot"', 'limit of joint "knee"', 'equality "loop"', 'number that is not finite:
    ///     actuator "servo"' or 'fastest joint "elbow"'. None if all steps were solved, or if no single constraint is responsible.
    #[pyo3(signature = (env=Env(0), **others), text_signature = "($self, env=0)")]
    fn worst_row(slf: Reading<'_>, env: Env, others: Option<&Bound<'_, PyDict>>) -> PyResult<Option<String>> {
        no_others("Stepper.worst_row", others, &["env"])?;
        let row = slf.simulation.worst_row(slf.env(env)?);
        Ok(row.map(|row| row.describe(slf.simulation.model()).to_string()))
    }

    /// Writes the constraint problem of the next step to a file, for example as a test of the solver.
    ///
    /// The file includes the initial impulses of the solver. In Rust, `stepper_solve::Problem::load(path)` reads it.
    ///
    /// The problem belongs to a step from the current state. The state does not change. For a step that was not solved (NOT_CONVERGED),
    /// first restore the state before it: `before = sim.get_state()` before the step, then `sim.set_state(before)`.
    ///
    /// Args:
    ///     path: File to write. An existing file is overwritten.
    ///     env: Index of the environment.
    ///     ctrl: Controls of the step, as in `step`. None keeps the current controls.
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
        let ctrl = ctrl.map(|ctrl| slf.control_rows(&ctrl, &slf.selection(None)?)).transpose()?;
        let ctrl = ctrl.as_ref().map_or(Ok(&[][..]), |rows| rows.as_slice())?;
        slf.apply(py)?;
        slf.simulation.save_problem(env, &StepInputs { ctrl, ..StepInputs::default() }, path).map_err(value_error)
    }
}

getters! { Stepper, |slf, py| (Reading<'_>) -> PyResult<Bound<'py, PyAny>>;
    /// Number of steps in the last call of `step` in which each actuator force was clipped, (num_envs, nu) uint32. Bounds are the
    /// `forcerange` of the actuator, the `actuatorfrcrange` of the joint, and the limits and torque-speed curve of the drive.
    actuator_saturation: {
        let counts = (0..slf.n()).flat_map(|env| slf.simulation.actuator_saturation(env));
        slf.counts(py, &[slf.simulation.model().nu()], counts)
    },
    /// Numbers of faults of each sensor in the last call of `step`, (num_envs, nsensor, 2) uint32. Column 0 is the number of clipped
    /// readings, and column 1 the number of lost samples.
    sensor_faults: {
        let counts = (0..slf.n()).flat_map(|env| slf.simulation.sensor_faults(env)).flatten();
        slf.counts(py, &[slf.simulation.model().sensors.len(), 2], counts)
    },
    /// Status flags of the last call of `step`, (num_envs,) uint32; see `stepper.Status`.
    status: slf.per_env(py, |env| slf.simulation.status(env).bits()),
    /// Residual of the last step, (num_envs,), m/s. It is the size of the natural map, a function of impulses and velocities that is zero
    /// at the exact solution. With INFEASIBLE, the residual is at least the largest shortfall of a constraint velocity below its target,
    /// m/s or rad/s. With NON_FINITE it is infinite.
    residual: slf.per_env(py, |env| slf.simulation.outcome(env).residual),
    /// Number of solver iterations in the last step, (num_envs,) uint32: Gauss-Seidel iterations and Newton steps.
    iterations: slf.per_env(py, |env| slf.simulation.outcome(env).sweeps + slf.simulation.outcome(env).newton_steps),
    /// Number of Newton steps of the solver in the last step: the sum over all islands of bodies, (num_envs,) uint32. `iterations` also
    /// includes Gauss-Seidel iterations.
    newton_steps: slf.per_env(py, |env| slf.simulation.outcome(env).newton_steps),
    /// Largest estimated error of the positions in a step of the last call of `step`, (num_envs,) float64, m or rad. The estimate of a step
    /// is a sum over its parts. NaN without `Options(error=...)`.
    error_estimate: slf.per_env(py, |env| slf.simulation.outcome(env).error.unwrap_or(f64::NAN)),
    /// Number of parts in the last call of `step` into which steps were divided, (num_envs,) uint32: by elastic impacts, or to keep
    /// `Options(error=...)`. Steps that are not divided do not count.
    substeps: slf.per_env(py, |env| slf.simulation.outcome(env).substeps),
    /// Largest penetration of a contact beyond its margin in the last call of `step`, (num_envs,) float64, m. A step measures it at contact
    /// detection, which is in the middle of the step for "midpoint" and "rk4". Of a divided step it is the largest of its parts. Above
    /// 1 mm `status` has DEEP.
    max_penetration: slf.per_env(py, |env| slf.simulation.outcome(env).depth),
    /// Largest violation of the range of a joint or tendon after the steps of the last call of `step`, (num_envs,) float64, rad or m. Above
    /// 0.01 `status` has OVER_LIMIT.
    max_limit_violation: slf.per_env(py, |env| slf.simulation.outcome(env).overshoot),
    /// Largest position error of an equality (connect, weld, joint, tendon) after the steps of the last call of `step`, (num_envs,)
    /// float64, m or rad. Above 0.001 `status` has EQUALITY_VIOLATED. It is 0 without equalities. Equalities with a finite stiffness are
    /// springs and are not included. With contact="mujoco" all equalities are soft, and all are included.
    max_equality_violation: slf.per_env(py, |env| slf.simulation.outcome(env).equality_violation),
}
