//! Calls for all environments of a simulation: steps, rollouts, sensor readings, and the inputs for them.

use crate::batch::call::Schedule;
use crate::batch::engine::with_batch;
use crate::batch::inputs::{AppliedInput, StepInputs};
use crate::batch::rollout::Recording;
use crate::batch::simulation::{Error, Simulation, TrueReadings};
use crate::batch::stepping::Watch;
use crate::error::check_length;

impl Simulation {
    /// Controls in force, (num_envs, nu): those that the next step uses if it gets no new ones. [`Simulation::reset`] sets
    /// them to zero.
    pub fn ctrl(&self) -> &[f64] {
        &self.ctrl
    }

    /// Sets the controls of the next steps, (num_envs, nu) or (nu) for all environments. They remain in force until they are replaced.
    ///
    /// # Errors
    /// [`Error::Length`] when `rows` has another number of values.
    pub fn set_ctrl(&mut self, rows: &[f64]) -> Result<(), Error> {
        self.set_ctrl_of(rows, &[])
    }

    /// Sets the controls of the environments in a mask; an empty mask selects all.
    fn set_ctrl_of(&mut self, rows: &[f64], mask: &[bool]) -> Result<(), Error> {
        let nu = self.model.nu();
        if rows.len() != self.ctrl.len() && rows.len() != nu {
            let detail = format!(" ({} environments x {nu})", self.num_envs);
            return Err(Error::Length { name: "ctrl", found: rows.len(), must: self.ctrl.len(), detail });
        }
        self.invalidate_caches();
        let each = rows.len() == self.ctrl.len();
        match mask {
            [] if each => self.ctrl.copy_from_slice(rows),
            _ => {
                for (env, row) in self.ctrl.chunks_exact_mut(nu.max(1)).enumerate().filter(|(env, _)| mask.get(*env) != Some(&false)) {
                    row.copy_from_slice(if each { &rows[env * nu..(env + 1) * nu] } else { rows });
                }
            }
        }
        Ok(())
    }

    /// Sets an applied input (forces, poses of mocap bodies, or active equalities) for all later calls, (num_envs, ...).
    ///
    /// The reset of an environment resets its row of the input. Positions of mocap bodies may be given without orientations, and the
    /// reverse. An empty array clears the input: all environments get its reset value.
    ///
    /// # Errors
    /// [`Error::Length`] when `values` has another number of values; [`Error::Model`] for an active equality that closes a loop with a
    /// force sensor in it.
    pub fn apply(&mut self, input: AppliedInput, values: &[f64]) -> Result<(), Error> {
        if !values.is_empty() {
            check_length(input.name(), values.len(), self.num_envs * input.width(&self.model))?;
        }
        if self.applied.get(input) != values {
            if input == AppliedInput::EqActive {
                self.check_eq_active(values)?;
            }
            self.revision += 1;
            self.applied.set(input, values, &self.model, self.num_envs);
        }
        Ok(())
    }

    /// Applied input in force, (num_envs, ...). Empty if the user has not set it.
    pub fn applied(&self, input: AppliedInput) -> &[f64] {
        self.applied.get(input)
    }

    /// Whether `nstep` steps take at most two or three microseconds, so that releasing Python's interpreter lock costs more than it gains.
    pub fn is_brief(&self, nstep: usize) -> bool {
        with_batch!(&self.engine, batch => batch.is_brief(nstep))
    }

    /// Makes `nstep` steps in every environment. For an empty slice in `inputs`, the present input remains in force.
    ///
    /// # Errors
    /// [`Error::Length`] when a slice has the wrong length. [`Error::MocapPoses`] for positions of mocap bodies without orientations, or
    /// the reverse. [`Error::Model`] for an active equality that closes a loop with a force sensor in it. [`Error::Threads`] when threads
    /// cannot be started.
    pub fn step(&mut self, inputs: &StepInputs<'_>, nstep: usize) -> Result<(), Error> {
        self.make_steps(inputs, nstep, None).map(|_| ())
    }

    /// Makes up to `nstep` steps, and stops early when `watch` returns false. Returns the number of steps made, the same in every
    /// environment.
    ///
    /// The calling thread calls `watch` about every 0.05 s. The result equals that of [`Simulation::step`] with this number of steps,
    /// except for mocap bodies: they have moved along a part of the trajectory for all `nstep` steps.
    ///
    /// # Errors
    /// The errors of [`Simulation::step`].
    pub fn step_watched(&mut self, inputs: &StepInputs<'_>, nstep: usize, watch: &mut dyn FnMut() -> bool) -> Result<usize, Error> {
        self.make_steps(inputs, nstep, Some(watch))
    }

    /// Makes up to `nstep` steps with one set of controls; see [`Simulation::step_watched`].
    fn make_steps(&mut self, inputs: &StepInputs<'_>, nstep: usize, watch: Watch<'_>) -> Result<usize, Error> {
        self.check_inputs(inputs, 1)?;
        if !inputs.ctrl.is_empty() {
            self.set_ctrl_of(inputs.ctrl, inputs.mask)?;
        }
        self.invalidate_caches();
        // A call without steps keeps the results of the last step, such as its status.
        if nstep == 0 {
            return Ok(0);
        }
        let inputs = StepInputs { ctrl: &self.ctrl, ..self.applied.complete(inputs) };
        with_batch!(&mut self.engine, batch => batch.make_steps(&inputs, Schedule { controls: 1, nstep }, None, watch))
    }

    /// Makes `nstep` steps with each of `controls` controls, (controls, num_envs, nu) or (controls, nu), and records quantities after each
    /// control. Stops early when `watch` returns false (see [`Simulation::step_watched`]). Returns the total number of steps made.
    ///
    /// The bits are the same as those of separate calls of [`Simulation::step`]. Moving mocap bodies are an exception: they reach their
    /// targets at the end of the rollout, not after the first control. The status accumulates flags over all steps. Afterwards, the
    /// controls of the last step are those in force.
    ///
    /// If the rollout stops before the first step with a control, it does not write the output rows of this control. If it stops between
    /// two steps with a control, the rows of this control have the state after the last step made.
    ///
    /// # Errors
    /// The errors of [`Simulation::step`], and [`Error::ArrayPrecision`] for an array of the recording in the wrong precision.
    pub fn rollout(
        &mut self,
        inputs: &StepInputs<'_>,
        controls: usize,
        nstep: usize,
        recording: Recording<'_>,
        watch: Option<&mut dyn FnMut() -> bool>,
    ) -> Result<usize, Error> {
        let schedule = Schedule { controls, nstep };
        if !inputs.mask.is_empty() {
            let detail = String::from(" (rollouts step all environments)");
            return Err(Error::Length { name: "mask", found: inputs.mask.len(), must: 0, detail });
        }
        self.check_inputs(inputs, controls)?;
        self.check_recording(&recording, controls)?;
        self.invalidate_caches();
        let (ctrl, inputs) = (inputs.ctrl, self.applied.complete(inputs));
        if ctrl.is_empty() {
            let held = self.ctrl.repeat(controls);
            let inputs = StepInputs { ctrl: &held, ..inputs };
            return with_batch!(&mut self.engine, batch => batch.make_steps(&inputs, schedule, Some(recording), watch));
        }
        let steps = with_batch!(&mut self.engine, batch => batch.make_steps(&inputs, schedule, Some(recording), watch))?;
        if let Some(last) = steps.checked_sub(1) {
            let row = ctrl.len() / controls;
            self.set_ctrl(&ctrl[last / nstep * row..][..row])?;
        }
        Ok(steps)
    }

    /// Reads all sensors of all environments, (num_envs, nsensordata), with the inputs in force.
    ///
    /// If `truth` is true, `out` gets the true readings of the present state, those of ideal sensors. Otherwise it gets the readings of the
    /// last step after the error models of the sensors. If the user has set the state since that step, they are readings of the present
    /// state. Without error models, both kinds of readings are equal. Repeated calls give the same numbers.
    ///
    /// # Errors
    /// [`Error::Length`] for `out`, and [`Error::Threads`] when threads cannot be started.
    pub fn sense(&mut self, truth: bool, out: &mut [f64]) -> Result<(), Error> {
        check_length("out", out.len(), self.num_envs * self.model.nsensordata())?;
        let inputs = self.applied.complete(&StepInputs::default());
        if !truth {
            return with_batch!(&mut self.engine, batch => batch.read_sensors(&inputs, false, out));
        }
        let TrueReadings { revision, readings } = &mut self.truth;
        if *revision != Some(self.revision) {
            readings.resize(out.len(), 0.0);
            with_batch!(&mut self.engine, batch => batch.read_sensors(&inputs, true, readings))?;
            *revision = Some(self.revision);
        }
        out.copy_from_slice(readings);
        Ok(())
    }
}
