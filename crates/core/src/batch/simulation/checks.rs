//! Checks of user input to a simulation. They run before anything is changed.

use crate::analysis::configurations::quaternions;
use crate::batch::inputs::{AppliedInput, Field, StepInputs};
use crate::batch::rollout::{Numbers, Recording};
use crate::batch::simulation::{Error, Simulation};
use crate::error::check_length;
use crate::math::precision::Precision;

impl Simulation {
    /// Panics if there is no environment `env`. Without this check, an index could select an unused lane.
    #[track_caller]
    pub(super) fn assert_env(&self, env: usize) {
        assert!(env < self.num_envs, "env is {env}, must be below {}", self.num_envs);
    }

    pub(super) fn check_env(&self, env: usize) -> Result<(), Error> {
        if env < self.num_envs { Ok(()) } else { Err(Error::Environment { env, num_envs: self.num_envs }) }
    }

    /// Checks a list of environment indices: all exist, in ascending order, without repetition.
    pub(super) fn check_envs(&self, envs: &[usize]) -> Result<(), Error> {
        if let Some(pair) = envs.windows(2).find(|pair| pair[0] >= pair[1]) {
            return Err(Error::Order { env: pair[1], before: pair[0] });
        }
        envs.last().map_or(Ok(()), |&env| self.check_env(env))
    }

    /// Checks values for a field of one environment, and returns them with normalised quaternions.
    ///
    /// # Errors
    /// [`Error::Environment`] when there is no such environment, [`Error::Length`], [`Error::NotFinite`], [`Error::TooLarge`], and
    /// [`Error::Quaternion`] for a quaternion of zeros, with its joint.
    pub(super) fn check_field(&self, field: Field, env: usize, values: &[f64]) -> Result<Vec<f64>, Error> {
        self.check_env(env)?;
        let name = field.name();
        check_length(name, values.len(), field.width(&self.model))?;
        self.check_numbers(values, |i| (format!("{name}[{i}]"), env))?;
        let mut values = values.to_vec();
        if field == Field::Qpos {
            self.normalize_quaternions(env, &mut values)?;
        }
        Ok(values)
    }

    /// Checks that all numbers are finite in the precision of the simulation. For the message, `place` returns the name and the environment
    /// of the number with a given index.
    pub(super) fn check_numbers(&self, values: &[f64], place: impl Fn(usize) -> (String, usize)) -> Result<(), Error> {
        let find = |wrong: &dyn Fn(f64) -> bool| {
            let i = values.iter().position(|&x| wrong(x))?;
            Some((place(i), values[i]))
        };
        if let Some(((place, env), value)) = find(&|x| !x.is_finite()) {
            return Err(Error::NotFinite { place, env, value });
        }
        match find(&|x| self.is_too_large(x)) {
            Some(((place, env), value)) => Err(Error::TooLarge { place, env, value }),
            None => Ok(()),
        }
    }

    /// Whether a number is too large for the precision of the simulation.
    pub(super) fn is_too_large(&self, x: f64) -> bool {
        self.precision == Precision::F32 && !(x as f32).is_finite()
    }

    /// Checks that an array has the length `must` and the precision of the simulation.
    pub(super) fn check_array(&self, name: &'static str, array: &Numbers<'_>, must: usize) -> Result<(), Error> {
        check_length(name, array.len(), must)?;
        match array.precision() == self.precision {
            true => Ok(()),
            false => Err(Error::ArrayPrecision { name, found: array.precision(), must: self.precision }),
        }
    }

    pub(super) fn check_time(&self, env: usize, time: f64) -> Result<f64, Error> {
        self.check_env(env)?;
        if time.is_finite() { Ok(time) } else { Err(Error::NotFinite { place: "time".into(), env, value: time }) }
    }

    fn normalize_quaternions(&self, env: usize, q: &mut [f64]) -> Result<(), Error> {
        for (joint, [at, _]) in quaternions(&self.model) {
            let norm = q[at..at + 4].iter().map(|x| x * x).sum::<f64>().sqrt();
            if norm < 1e-10 || !norm.is_finite() {
                let found = q[at..at + 4].try_into().expect("four numbers");
                return Err(Error::Quaternion { env, joint: self.model.joint_label(joint), address: at, found, norm });
            }
            // A quaternion whose length is 1 within rounding is not changed.
            if (norm - 1.0).abs() > 1e-15 {
                q[at..at + 4].iter_mut().for_each(|x| *x /= norm);
            }
        }
        Ok(())
    }

    /// Checks the lengths of the input arrays of a call for all environments. `controls` is the number of controls that follow one another
    /// in the call.
    pub(super) fn check_inputs(&self, inputs: &StepInputs<'_>, controls: usize) -> Result<(), Error> {
        // Fast check of the usual case, because a single environment needs it at every step.
        let fits = inputs.ctrl.is_empty() || inputs.ctrl.len() == controls.saturating_mul(self.ctrl.len());
        if fits && inputs.mask.is_empty() && inputs.applied().iter().all(|given| given.is_empty()) {
            return Ok(());
        }
        self.check_each_input(inputs, controls, self.num_envs)
    }

    /// Checks the lengths of the input arrays of a call for `n` environments, array by array. `controls` is the number of controls that
    /// follow one another in the call.
    #[cold]
    pub(super) fn check_each_input(&self, inputs: &StepInputs<'_>, controls: usize, n: usize) -> Result<(), Error> {
        let check = |name: &'static str, given: &[f64], controls: usize, row: usize, shared: bool| {
            let must = controls.saturating_mul(n * row);
            let fits = given.is_empty() || given.len() == must || (shared && given.len() == controls.saturating_mul(row));
            let times = if controls == 1 { String::new() } else { format!("{controls} controls x ") };
            let detail = || format!(" ({times}{n} environments x {row})");
            if fits { Ok(()) } else { Err(Error::Length { name, found: given.len(), must, detail: detail() }) }
        };
        check("ctrl", inputs.ctrl, controls, self.model.nu(), true)?;
        for (input, given) in AppliedInput::ALL.into_iter().zip(inputs.applied()).filter(|(_, given)| !given.is_empty()) {
            check(input.name(), given, 1, input.width(&self.model), false)?;
        }
        self.check_eq_active(inputs.eq_active)?;
        if inputs.mocap_pos.is_empty() != inputs.mocap_quat.is_empty() {
            return Err(Error::MocapPoses);
        }
        if inputs.mask.is_empty() { Ok(()) } else { check_length("mask", inputs.mask.len(), n) }
    }

    /// Checks for all environments that the values of `eq_active`, (num_envs, neq), are allowed. No active equality may close a loop that
    /// contains a force sensor.
    pub(super) fn check_eq_active(&self, rows: &[f64]) -> Result<(), Error> {
        let count = self.model.equalities.len();
        let acts = |e: usize| rows.chunks_exact(count).any(|row| row[e] != 0.0);
        if rows.is_empty() { Ok(()) } else { Ok(self.model.check_sensed_loops(acts)?) }
    }

    pub(super) fn check_recording(&self, recording: &Recording<'_>, controls: usize) -> Result<(), Error> {
        let rows = controls.saturating_mul(self.num_envs);
        check_length("status", recording.status.len(), rows)?;
        check_length("residual", recording.residual.len(), rows)?;
        for (quantity, numbers) in &recording.quantities {
            self.check_array(quantity.name(), numbers, rows.saturating_mul(quantity.width(&self.model)))?;
        }
        Ok(())
    }
}
