//! Methods whose work modules of the package do, in Python: they are called through the stepper, where users look for them.

use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::stepper::Stepper;

#[pymethods]
impl Stepper {
    /// Derivatives of the state after `nstep` steps by the state, controls and parameters now, in all environments; advances nothing.
    ///
    /// Every column is a central difference between two perturbed copies of an environment, or a difference to one side. Copies of all
    /// environments and columns are stepped together, in lanes and on the stepper's threads, with its options and all that environments
    /// have of their own, but to a tighter tolerance; the stepper is only read, and keeps room for copies for the next call. With contact
    /// the step is smooth only between kinks: see `Linearization.near_kink`
    /// and docs/how-to/derivatives.md.
    ///
    /// Args:
    ///     wrt: "qpos", "qvel", "act", "ctrl", and fields of `Stepper.randomize`, whole ("body_mass") or in part, by selector
    ///         ("geom_friction[floor,box][0]", docs/reference/what_can_vary.md). Columns are zero where a mass, size, stiffness or
    ///         frictionloss of 0 says that the model has none. None is ("qpos", "qvel", "act", "ctrl").
    ///     ctrl: Controls held during the steps, (num_envs, nu) or (nu,); None is those in force.
    ///     nstep: Number of steps.
    ///     method: "fd", finite differences of whole steps, or "implicit": the step is solved once, and its derivative is that at the
    ///         modes of the solution, which contacts push, stick and slip, by the implicit function theorem. That is for the midpoint rule,
    ///         Euler's and the implicit one, and for `contact="mujoco"` with "euler", "implicitfast" or "implicit"; by the state and
    ///         the controls. Environments that it says nothing of are taken by differences (`Linearization.implicit`).
    ///     step: Half width of the differences, for coordinates in SI units and for parameters relative to their size; None is the one
    ///         that the tolerance asks for (`stepper.derivatives.perturbations.step_of`), or `stepper.derivatives.implicit.STEP`.
    ///     tolerance: Residual to which copies are solved, m/s; None is 1e-13, or the stepper's own if that is less.
    ///     centered: Whether differences are central. Differences to one side cost half the copies; their error is of first order in the
    ///         step instead of second, and slopes on both sides are not compared.
    ///     extrapolate: Whether differences of twice the width are taken too, and Richardson's extrapolation of both, which costs twice
    ///         the copies and estimates errors.
    ///     sensors: Whether to give derivatives of the ideal sensors' readings too.
    ///
    /// Raises:
    ///     ValueError: An unknown name, a wrong shape, a step or number of steps that is none; of `method="implicit"`, options or
    ///         derivatives that only `method="fd"` takes.
    ///     ModelError: A parameter that cannot be perturbed, with its element.
    #[pyo3(signature = (
        wrt=None, *, ctrl=None, nstep=1, method="fd", step=None, tolerance=None, centered=true, extrapolate=false, sensors=false
    ))]
    #[expect(clippy::too_many_arguments, reason = "each has a name of its own")]
    fn linearize<'py>(
        slf: &Bound<'py, Self>,
        wrt: Option<Bound<'py, PyAny>>,
        ctrl: Option<Bound<'py, PyAny>>,
        nstep: i64,
        method: &str,
        step: Option<Bound<'py, PyAny>>,
        tolerance: Option<Bound<'py, PyAny>>,
        centered: bool,
        extrapolate: bool,
        sensors: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let settings = PyDict::new(slf.py());
        settings.set_item("wrt", wrt)?;
        settings.set_item("ctrl", ctrl)?;
        settings.set_item("nstep", nstep)?;
        settings.set_item("method", method)?;
        settings.set_item("step", step)?;
        settings.set_item("tolerance", tolerance)?;
        settings.set_item("centered", centered)?;
        settings.set_item("extrapolate", extrapolate)?;
        settings.set_item("sensors", sensors)?;
        slf.py().import("stepper.derivatives")?.call_method("linearize", (slf,), Some(&settings))
    }

    /// Values of a quantity for all its elements, or for some by name or index.
    ///
    ///     sim.read("xpos", "torso")  # (num_envs, 3)
    ///     sim.read("qvel", ["left_knee", "right_knee"])  # (num_envs, 2)
    ///
    /// Args:
    ///     name: An attribute of `Stepper`: "xpos", "qvel", "sensordata".
    ///     of: A body, site, geom, joint, actuator or sensor, whichever the quantity is of, or several; None is all. One body, site or
    ///         geom is without its axis: (num_envs, 3). Columns of joints and sensors stand one after the other: (num_envs, n).
    ///
    /// Returns:
    ///     (num_envs, ...) in the stepper's scalar type, the caller's own.
    ///
    /// Raises:
    ///     ValueError: An unknown quantity.
    ///     KeyError, IndexError: No element of that name or index.
    #[pyo3(signature = (name, of=None))]
    fn read<'py>(slf: &Bound<'py, Self>, name: &str, of: Option<Bound<'py, PyAny>>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("stepper._quantities")?.call_method1("read", (slf, name, of))
    }

    /// Forces on the joints that give the present states these accelerations: M qacc + bias - passive.
    ///
    /// This is MuJoCo's `mj_inverse` without constraints. Passive forces are those of springs, dampers, gravity compensation and the
    /// medium. Forces of actuators and applied forces are not subtracted, nor are those of contacts and other constraints, which
    /// `qfrc_constraint` has of the last step.
    ///
    /// Args:
    ///     qacc: Accelerations, (num_envs, nv) or (nv,), m/s^2 or rad/s^2.
    ///
    /// Returns:
    ///     (num_envs, nv) in the stepper's scalar type, N or N m.
    ///
    /// Raises:
    ///     ValueError: Accelerations of another shape.
    fn inverse_dynamics<'py>(slf: &Bound<'py, Self>, qacc: Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("stepper._quantities")?.call_method1("inverse_dynamics", (slf, qacc))
    }

    /// Opens a live view of the environments in the browser, and says where it is.
    ///
    /// Args:
    ///     **settings: Those of `stepper.viewer.View`.
    ///
    /// Raises:
    ///     ModuleNotFoundError: viser is not installed, with how to install it.
    #[pyo3(signature = (**settings))]
    fn view<'py>(slf: &Bound<'py, Self>, settings: Option<&Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("stepper.viewer")?.call_method("view", (slf,), settings)
    }
}
