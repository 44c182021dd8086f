//! `Stepper.step`.

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

    /// Makes `nstep` steps with what is in force, fewer when a signal ends them: then the number is in it.
    fn advance(&mut self, py: Python<'_>, nstep: usize) -> PyResult<Option<Interrupted>> {
        self.apply(py)?;
        let (inputs, simulation) = (StepInputs::default(), &mut self.simulation);
        if simulation.is_brief(nstep) {
            return simulation.step(&inputs, nstep).map(|()| None).map_err(value_error);
        }
        py.detach(|| watched(|watch| simulation.step_watched(&inputs, nstep, watch))).map_err(value_error)
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
    /// Makes `nstep` steps in every environment.
    ///
    /// Args:
    ///     ctrl: Controls, (num_envs, nu) or (nu,) for all, held until others are given; None holds those in force (`Stepper.ctrl`),
    ///         as MuJoCo does.
    ///     nstep: Number of steps.
    ///
    /// Raises:
    ///     ValueError: A wrong shape; the message has both. A control that is NaN is no error: its environment keeps its state and
    ///         says NON_FINITE in `status`.
    ///     KeyboardInterrupt: Ctrl-C in a long call, which looks for signals some twenty times a second. Every environment has then
    ///         made the same number of steps, the exception's `steps`, and all is as a call with that `nstep` leaves it; but mocap
    ///         bodies are where their way has brought them, and a recording in which they were under way replays up to this call
    ///         only. What another signal's handler raises ends the call alike.
    #[pyo3(signature = (ctrl=None, nstep=Whole::Number(1)), text_signature = "($self, ctrl=None, nstep=1)")]
    fn step(slf: &Bound<'_, Self>, ctrl: Option<&Bound<'_, PyAny>>, nstep: Whole<'_>) -> PyResult<()> {
        let mut this = borrow(slf)?;
        let nstep = nstep.from(0, "nstep")? as usize;
        this.take_ctrl(ctrl, nstep)?;
        let interrupted = this.advance(slf.py(), nstep)?;
        if let Some(interrupted) = interrupted {
            return Err(end_early(slf, this, interrupted, nstep));
        }
        if this.recorder.is_none() { Ok(()) } else { tell_of_step(slf, this, nstep) }
    }
}
