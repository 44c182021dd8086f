//! `Stepper.step`.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use stepper_core::{AppliedInput, StepInputs};

use crate::arguments::Whole;
use crate::array::with_numbers;
use crate::error::value_error;
use crate::stepper::interruption::{Interrupted, watched};
use crate::stepper::recording::tell_of_step;
use crate::stepper::{Stepper, borrow};

impl Stepper {
    /// Hands controls for `nstep` steps to the core.
    fn take_ctrl(&mut self, given: Option<&Bound<'_, PyAny>>, nstep: usize) -> PyResult<()> {
        let Some(given) = given else { return Ok(()) };
        let (n, nu) = (self.n(), self.simulation.model().nu());
        let taken = with_numbers(given, |shape, numbers| {
            let fits = matches!(*shape, [row] if row == nu) || (self.batched && matches!(*shape, [rows, row] if rows == n && row == nu));
            if fits {
                self.simulation.set_ctrl(numbers, nstep).expect("checked above");
            }
            fits
        });
        if taken == Some(true) { Ok(()) } else { self.convert_ctrl(given, nstep) }
    }

    /// The same of what is no plain array of the right shape.
    #[cold]
    fn convert_ctrl(&mut self, given: &Bound<'_, PyAny>, nstep: usize) -> PyResult<()> {
        let rows = self.rows(given, "ctrl", self.simulation.model().nu())?;
        self.simulation.set_ctrl(rows.as_slice()?, nstep).map_err(value_error)
    }

    /// Makes `nstep` steps with these inputs and what is in force, fewer when a signal ends them: then the number is in it.
    fn advance(&mut self, py: Python<'_>, inputs: StepInputs<'_>, nstep: usize) -> PyResult<Option<Interrupted>> {
        self.apply(py)?;
        let simulation = &mut self.simulation;
        if simulation.is_brief(nstep) {
            return simulation.step(&inputs, nstep).map(|()| None).map_err(value_error);
        }
        py.detach(|| watched(|watch| simulation.step_watched(&inputs, nstep, watch))).map_err(value_error)
    }

    /// Makes steps of the environments of a mask.
    #[cold]
    fn step_some(
        &mut self,
        py: Python<'_>,
        ctrl: Option<&Bound<'_, PyAny>>,
        nstep: usize,
        mask: &Bound<'_, PyAny>,
    ) -> PyResult<Option<Interrupted>> {
        if self.recorder.is_some() {
            return Err(PyValueError::new_err(
                "mask: a recording has steps of all environments alone; stepper.states.step(sim, ctrl, mask) is recorded",
            ));
        }
        let mask = self.truths(mask)?;
        let rows = ctrl.map(|ctrl| self.rows(ctrl, "ctrl", self.simulation.model().nu())).transpose()?;
        let ctrl = rows.as_ref().map_or(Ok(&[][..]), |rows| rows.as_slice())?;
        self.advance(py, StepInputs { ctrl, mask: &mask, ..StepInputs::default() }, nstep)
    }
}

/// What becomes of a step that a signal has ended: the recorder is told of the steps that were made.
#[cold]
fn end_early(slf: &Bound<'_, Stepper>, this: PyRefMut<'_, Stepper>, interrupted: Interrupted, nstep: usize) -> PyErr {
    let (py, made) = (slf.py(), interrupted.steps);
    let mut also = "";
    if this.recorder.is_some() {
        if this.applied[AppliedInput::MocapPos as usize].is_some() {
            also =
                "; mocap bodies that were on their way had not arrived, and the recording has them arrive: it replays up to this call only";
        }
        if let Err(error) = tell_of_step(slf, this, made) {
            return error;
        }
    }
    interrupted.raise(py, "step", nstep, also)
}

#[pymethods]
impl Stepper {
    /// Makes `nstep` steps in every environment, or in those of a boolean mask (num_envs,).
    ///
    /// Args:
    ///     ctrl: Controls, (num_envs, nu) or (nu,) for all, held until others are given; None holds those in force (`Stepper.ctrl`),
    ///         as MuJoCo does.
    ///     nstep: Number of steps.
    ///     mask: Which environments; None is all. The others stay as they are, to the bit, with their controls, sensors and flags, and
    ///         rows of theirs in `ctrl` are not read. Environments that are worked on together and none of which step cost nothing,
    ///         unless sensors or actuators have delays: then all step, and the others are put back.
    ///
    /// Raises:
    ///     ValueError: A wrong shape; the message has both. A mask while the stepper is recorded. A control that is NaN is no error: its
    ///         environment keeps its state and says NON_FINITE in `status`.
    ///     KeyboardInterrupt: Ctrl-C in a long call, which looks for signals some twenty times a second. Every environment has then
    ///         made the same number of steps, the exception's `steps`, and all is as a call with that `nstep` leaves it; but mocap
    ///         bodies are where their way has brought them, and a recording in which they were under way replays up to this call
    ///         only. What another signal's handler raises ends the call alike.
    #[pyo3(signature = (ctrl=None, nstep=Whole::Number(1), *, mask=None), text_signature = "($self, ctrl=None, nstep=1, *, mask=None)")]
    fn step(slf: &Bound<'_, Self>, ctrl: Option<&Bound<'_, PyAny>>, nstep: Whole<'_>, mask: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let mut this = borrow(slf)?;
        let nstep = nstep.from(0, "nstep")? as usize;
        let interrupted = match mask {
            None => {
                this.take_ctrl(ctrl, nstep)?;
                this.advance(slf.py(), StepInputs::default(), nstep)?
            }
            Some(mask) => this.step_some(slf.py(), ctrl, nstep, mask)?,
        };
        if let Some(interrupted) = interrupted {
            return Err(end_early(slf, this, interrupted, nstep));
        }
        if this.recorder.is_none() { Ok(()) } else { tell_of_step(slf, this, nstep) }
    }
}
