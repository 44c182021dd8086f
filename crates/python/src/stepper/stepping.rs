//! `Stepper.step`.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use stepper_core::{AppliedInput, Precision, StepInputs};

use crate::arguments::{Whole, no_others};
use crate::array::{array, with_numbers};
use crate::error::value_error;
use crate::selection::Selection;
use crate::stepper::interruption::{Interrupted, watched};
use crate::stepper::recording::notify_recorder_of_step;
use crate::stepper::{Stepper, Writing};

impl Stepper {
    /// Copies the controls of the argument `ctrl` to the simulation, where they apply until they are replaced. None keeps the current
    /// controls.
    fn take_ctrl(&mut self, given: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let Some(given) = given else { return Ok(()) };
        let (n, nu) = (self.n(), self.simulation.model().nu());
        let taken = with_numbers(given, |shape, numbers| {
            let fits = matches!(*shape, [row] if row == nu) || (self.batched && matches!(*shape, [rows, row] if rows == n && row == nu));
            if fits {
                self.simulation.set_ctrl(numbers).expect("checked above");
            }
            fits
        });
        if taken == Some(true) { Ok(()) } else { self.convert_ctrl(given) }
    }

    /// Slow path of [`Stepper::take_ctrl`] for controls that must be converted: lists, other dtypes and layouts. A wrong shape is an error.
    #[cold]
    fn convert_ctrl(&mut self, given: &Bound<'_, PyAny>) -> PyResult<()> {
        let rows = self.control_rows(given, &self.selection(None)?)?;
        self.simulation.set_ctrl(rows.as_slice()?).map_err(value_error)
    }

    /// Makes `nstep` steps with the given inputs and the applied inputs (forces, mocap poses ...). A signal can interrupt them, unless they
    /// take only a few microseconds; the result then has the number of steps made.
    fn advance(&mut self, py: Python<'_>, inputs: StepInputs<'_>, nstep: usize) -> PyResult<Option<Interrupted>> {
        self.apply(py)?;
        let simulation = &mut self.simulation;
        if simulation.is_brief(nstep) {
            return simulation.step(&inputs, nstep).map(|()| None).map_err(value_error);
        }
        py.detach(|| watched(|watch| simulation.step_watched(&inputs, nstep, watch))).map_err(value_error)
    }

    /// Makes `nstep` steps of the selected environments only, for a stepper without a recorder.
    #[cold]
    fn step_some(
        &mut self,
        py: Python<'_>,
        ctrl: Option<&Bound<'_, PyAny>>,
        nstep: usize,
        selection: &Selection,
    ) -> PyResult<Option<Interrupted>> {
        let rows = ctrl.map(|ctrl| self.control_rows(ctrl, selection)).transpose()?;
        if selection.envs.is_empty() {
            return Ok(None);
        }
        let ctrl = rows.as_ref().map_or(Ok(&[][..]), |rows| rows.as_slice())?;
        self.advance(py, StepInputs { ctrl, mask: &selection.mask(self.n()), ..StepInputs::default() }, nstep)
    }

    /// Controls of all environments, (num_envs, nu): the argument `ctrl` for the selected environments, and the current controls for the
    /// others.
    fn controls_with(&self, ctrl: Option<&Bound<'_, PyAny>>, selection: &Selection) -> PyResult<Vec<f64>> {
        let nu = self.simulation.model().nu();
        let mut controls = self.simulation.ctrl().to_vec();
        let Some(ctrl) = ctrl else { return Ok(controls) };
        let rows = self.control_rows(ctrl, selection)?;
        let rows = rows.as_slice()?;
        for &env in &selection.envs {
            let at = if rows.len() == nu { 0 } else { env * nu };
            controls[env * nu..(env + 1) * nu].copy_from_slice(&rows[at..at + nu]);
        }
        Ok(controls)
    }
}

/// Makes recorded steps of the selected environments.
///
/// The call steps all environments, and then restores the states of the unselected ones. The recording contains the steps and the
/// restoration, so that a replay repeats both.
#[cold]
fn step_some_recorded(
    slf: &Bound<'_, Stepper>,
    this: Writing<'_>,
    ctrl: Option<&Bound<'_, PyAny>>,
    nstep: usize,
    selection: &Selection,
) -> PyResult<()> {
    let py = slf.py();
    let controls = this.controls_with(ctrl, selection)?;
    if selection.envs.is_empty() {
        return Ok(());
    }
    let others: Vec<bool> = selection.mask(this.n()).iter().map(|chosen| !chosen).collect();
    let controls = array(py, &this.shape(&[this.simulation.model().nu()]), controls, Precision::F64)?;
    drop(this);
    let before = slf.call_method0("get_state")?;
    let stepped = slf.call_method1("step", (controls, nstep));
    let envs = PyDict::new(py);
    envs.set_item("envs", others)?;
    slf.call_method("set_state", (before,), Some(&envs))?;
    stepped.map(|_| ())
}

/// Creates the exception that an interrupted call of `step` with `nstep` steps raises. Also notifies the recorder of the steps that were
/// made before the interruption; an error of the recorder becomes the result.
#[cold]
fn end_early(slf: &Bound<'_, Stepper>, this: Writing<'_>, interrupted: Interrupted, nstep: usize) -> PyErr {
    let (py, made) = (slf.py(), interrupted.steps);
    let mut also = "";
    if this.recorder.is_some() {
        if this.applied[AppliedInput::MocapPos as usize].is_some() {
            also = "; mocap bodies have not reached their targets, but would reach them in a replay: replay the recording only up to this call";
        }
        if let Err(error) = notify_recorder_of_step(slf, this, made) {
            return error;
        }
    }
    interrupted.raise(py, "step", nstep, also)
}

#[pymethods]
impl Stepper {
    /// Makes `nstep` steps in every environment, or in the environments `envs`.
    ///
    /// Args:
    ///     ctrl: Controls, (num_envs, nu), or (nu,) for all environments. They also apply to later steps without controls. None keeps the
    ///         current controls (`Stepper.ctrl`), as in MuJoCo.
    ///     nstep: Number of steps. With 0, the call only sets the controls, for quantities that follow from them, such as `qacc_smooth`;
    ///         `status` and other results are still those of the last step.
    ///     envs: Environments, as in `reset`. The other environments keep their state, controls, sensor readings and flags. A SIMD group
    ///         without a selected environment takes no time. But if sensors or actuators have delays, or if the stepper is recorded, all
    ///         environments step, and then the states of the unselected environments are restored.
    ///
    /// Raises:
    ///     ValueError: A shape is wrong; the message has the given and the required shape. Or `nstep` is negative, or `envs` has an index
    ///         twice. A NaN control is no error: `status` has NON_FINITE for its environment, and the bodies concerned keep their state.
    ///     TypeError: An index in `envs`, or `nstep`, is no integer.
    ///     IndexError: An index in `envs` is out of range.
    ///     KeyboardInterrupt: Ctrl-C interrupted a long call, which checks for signals about twenty times per second. All selected
    ///         environments have made the same number of steps, which is the exception's attribute `steps`. The results equal those of a
    ///         call with this number as `nstep`, except that moving mocap bodies have not reached their targets. A recording with moving
    ///         mocap bodies can be replayed up to this call only. Exceptions of other signal handlers interrupt the call in the same way.
    #[pyo3(signature = (ctrl=None, nstep=Whole::Number(1), envs=None, **others), text_signature = "($self, ctrl=None, nstep=1, envs=None)")]
    fn step(
        slf: &Bound<'_, Self>,
        ctrl: Option<&Bound<'_, PyAny>>,
        nstep: Whole<'_>,
        envs: Option<&Bound<'_, PyAny>>,
        others: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<()> {
        no_others("Stepper.step", others, &["ctrl", "nstep", "envs"])?;
        let mut this = Writing::try_from(slf)?;
        let nstep = nstep.from(0, "nstep")? as usize;
        let interrupted = match envs {
            None => {
                this.take_ctrl(ctrl)?;
                this.advance(slf.py(), StepInputs::default(), nstep)?
            }
            Some(_) => {
                let selection = this.selection(envs)?;
                if this.recorder.is_some() {
                    return step_some_recorded(slf, this, ctrl, nstep, &selection);
                }
                this.step_some(slf.py(), ctrl, nstep, &selection)?
            }
        };
        if let Some(interrupted) = interrupted {
            return Err(end_early(slf, this, interrupted, nstep));
        }
        if this.recorder.is_none() { Ok(()) } else { notify_recorder_of_step(slf, this, nstep) }
    }
}
