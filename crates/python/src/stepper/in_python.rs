//! Methods of `Stepper` that are implemented in Python modules of the package.

use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::arguments::no_others;
use crate::stepper::Stepper;

#[pymethods]
impl Stepper {
    /// Derivatives of the state after `nstep` steps with respect to the current state, controls and parameters, in all environments.
    ///
    /// The method does not change the stepper, and returns a `Linearization`. By default each column is a finite difference between
    /// perturbed copies of an environment. Copies of all environments and columns are stepped as one batch, with the options, parameters
    /// and threads of the stepper, but a tighter tolerance. The stepper keeps the memory of the copies for the next call. With contact,
    /// the step is smooth only between kinks: see `Linearization.near_kink` and docs/how-to/derivatives.md.
    ///
    /// Args:
    ///     wrt: Names of the inputs: "qpos", "qvel", "act", "ctrl", and fields of `Stepper.randomize`, whole ("body_mass") or by selector
    ///         ("geom_friction[floor,box][0]", docs/reference/what_can_vary.md). Columns are zero for a mass, size, stiffness or
    ///         frictionloss of 0, which the model does not simulate. None selects ("qpos", "qvel", "act", "ctrl").
    ///     ctrl: Constant controls during the steps, (num_envs, nu) or (nu,). None keeps the current controls.
    ///     nstep: Number of steps.
    ///     method: "fd" is finite differences of whole steps. "implicit" solves the step once and applies the implicit function theorem
    ///         with fixed contact modes (which contacts push, stick and slip). It supports derivatives with respect to state and controls.
    ///         The integrator must be "midpoint", "euler" or "implicit"; with `contact="mujoco"` it must be "euler", "implicitfast" or
    ///         "implicit". Environments in which the theorem does not apply use finite differences (`Linearization.implicit`).
    ///     step: Half width of the differences, in SI units for coordinates and relative for parameters. None chooses it from the tolerance
    ///         (`stepper.derivatives.perturbations.step_of`), or for "implicit" uses `stepper.derivatives.implicit.STEP`.
    ///     tolerance: Solver tolerance of the copies, m/s. None uses 1e-13, or the tolerance of the stepper if that is smaller.
    ///     centered: Whether differences are central. One-sided differences need half the copies. Their error is of first order in `step`
    ///         instead of second, and they cannot compare the slopes on both sides of a kink.
    ///     extrapolate: Whether to apply Richardson extrapolation with differences of twice the width. It needs twice the copies and gives
    ///         error estimates.
    ///     sensors: Whether to compute derivatives of the ideal sensor readings too.
    ///
    /// Raises:
    ///     TypeError: `nstep` is no integer, or `centered`, `extrapolate` or `sensors` is not True or False.
    ///     ValueError: A name is unknown, a shape is wrong, or `step` or `nstep` is not positive. Or `method="implicit"` does not support
    ///         the options or derivatives.
    ///     ModelError: A parameter cannot be perturbed; the message has its element.
    #[pyo3(
        signature = (*arguments, **settings),
        text_signature = "($self, wrt=None, *, ctrl=None, nstep=1, method='fd', step=None, tolerance=None, centered=True, extrapolate=False, sensors=False)"
    )]
    fn linearize<'py>(
        slf: &Bound<'py, Self>,
        arguments: &Bound<'py, PyTuple>,
        settings: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let all = std::iter::once(slf.clone().into_any()).chain(arguments.iter());
        slf.py().import("stepper.derivatives")?.call_method("linearize", PyTuple::new(slf.py(), all.collect::<Vec<_>>())?, settings)
    }

    /// Values of a quantity for all its elements, or for some elements given by name or index.
    ///
    ///     sim.read("xpos", "torso")  # (num_envs, 3)
    ///     sim.read("qvel", ["left_knee", "right_knee"])  # (num_envs, 2)
    ///
    /// Args:
    ///     name: Name of an attribute of `Stepper`, such as "xpos", "qvel" or "sensordata".
    ///     of: Name or index of an element, or a list of several. The quantity determines the kind of element: body, site, geom, joint,
    ///         actuator or sensor. None selects all elements. A single body, site or geom has no axis of elements: (num_envs, 3). The
    ///         columns of joints and sensors are concatenated: (num_envs, n) for n columns.
    ///
    /// Returns:
    ///     New array (num_envs, ...) in the precision of the stepper.
    ///
    /// Raises:
    ///     ValueError: The quantity is unknown.
    ///     KeyError, IndexError: The model has no element of that name or index.
    #[pyo3(signature = (name, of=None, **others), text_signature = "($self, name, of=None)")]
    fn read<'py>(
        slf: &Bound<'py, Self>,
        name: &str,
        of: Option<Bound<'py, PyAny>>,
        others: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        no_others("Stepper.read", others, &["name", "of"])?;
        slf.py().import("stepper._quantities")?.call_method1("read", (slf, name, of))
    }

    /// Joint forces that cause given accelerations at the current states: mass matrix times `qacc`, plus bias, minus passive forces.
    ///
    /// This is MuJoCo's `mj_inverse` without constraints. Passive forces are the forces of springs, dampers, gravity compensation and the
    /// fluid. Actuator forces, applied forces and constraint forces are not subtracted. `qfrc_constraint` has the constraint forces of the
    /// last step.
    ///
    /// Args:
    ///     qacc: Accelerations, (num_envs, nv) or (nv,), m/s^2 or rad/s^2.
    ///
    /// Returns:
    ///     Joint forces, (num_envs, nv), in the precision of the stepper, N or N m.
    ///
    /// Raises:
    ///     ValueError: `qacc` has another shape, or a number that is not finite.
    fn inverse_dynamics<'py>(slf: &Bound<'py, Self>, qacc: Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("stepper._quantities")?.call_method1("inverse_dynamics", (slf, qacc))
    }

    /// Opens a live view of the environments in the browser, and prints its address.
    ///
    /// Args:
    ///     **settings: Arguments of `stepper.viewer.View`.
    ///
    /// Raises:
    ///     ModuleNotFoundError: viser is not installed; the message has the command to install it.
    #[pyo3(signature = (**settings))]
    fn view<'py>(slf: &Bound<'py, Self>, settings: Option<&Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("stepper.viewer")?.call_method("view", (slf,), settings)
    }
}
