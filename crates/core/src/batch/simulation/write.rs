//! Setters of a simulation: state of environments, new episodes, and random streams.

use crate::batch::engine::with_batch;
use crate::batch::inputs::{Episode, Field, StateRows};
use crate::batch::simulation::{Error, Simulation};
use crate::error::check_length;
use crate::model::Keyframe;

/// Checked state values of a call. Each field has one row for each chosen environment. Fields without values are missing.
struct CheckedRows {
    fields: [(Field, Vec<Vec<f64>>); 3],
    times: Vec<f64>,
}

impl Simulation {
    /// Resets one environment to the model's reset state, with zero controls and no applied inputs. Nothing of the old episode remains.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn reset(&mut self, env: usize) {
        self.assert_env(env);
        let model = self.model.clone();
        with_batch!(self.engine_mut(), batch => {
            batch.write(Field::Qpos, env, &model.qpos0);
            batch.write(Field::Qvel, env, &vec![0.0; model.nv()]);
            batch.write(Field::Act, env, &vec![0.0; model.na()]);
            batch.set_time(env, 0.0);
            batch.clear_memory(env);
            batch.begin_episode(env, None);
        });
        self.ctrl_mut(env).fill(0.0);
        self.applied.reset(env, &model);
    }

    /// Starts a new episode in the environments `envs`, ascending: a [`Simulation::reset`], followed by the changes in `episode`.
    ///
    /// # Errors
    /// [`Error::Environment`] or [`Error::Order`] for `envs`, and those of [`Simulation::set`] and [`Simulation::start_from`]; nothing is
    /// changed then.
    pub fn start_episodes(&mut self, envs: &[usize], episode: &Episode<'_>) -> Result<(), Error> {
        let rows = self.check_rows(envs, &episode.rows)?;
        if let (Some(keyframe), Some(&env)) = (episode.keyframe, envs.first()) {
            self.check_keyframe(env, keyframe)?;
        }
        if let Some(seeds) = episode.seed.filter(|seeds| seeds.len() != 1) {
            check_length("seed", seeds.len(), self.num_envs)?;
        }
        for &env in envs {
            self.reset(env);
            if let Some(seeds) = episode.seed {
                self.begin_episode(env, Some(if let &[seed] = seeds { seed } else { seeds[env] }));
            }
            if let Some(keyframe) = episode.keyframe {
                self.start_from(env, keyframe)?;
            }
        }
        self.write_rows(envs, rows, true);
        Ok(())
    }

    /// Sets one environment to a keyframe of the model: state, time and controls. The environment must have been reset.
    ///
    /// # Errors
    /// The errors of [`Simulation::set`] and [`Simulation::set_time`], and [`Error::Length`] for the controls; nothing is changed then.
    pub fn start_from(&mut self, env: usize, keyframe: &Keyframe) -> Result<(), Error> {
        self.check_keyframe(env, keyframe)?;
        self.set_time(env, keyframe.time)?;
        for (field, values) in fields_of(keyframe) {
            self.set(field, env, values)?;
        }
        self.ctrl_mut(env).copy_from_slice(&keyframe.ctrl);
        with_batch!(self.engine_mut(), batch => batch.set_initial_ctrl(env, &keyframe.ctrl));
        Ok(())
    }

    fn check_keyframe(&self, env: usize, keyframe: &Keyframe) -> Result<(), Error> {
        fields_of(keyframe).into_iter().try_for_each(|(field, values)| self.check_field(field, env, values).map(|_| ()))?;
        check_length("ctrl", keyframe.ctrl.len(), self.model.nu())?;
        self.check_time(env, keyframe.time).map(|_| ())
    }

    /// Sets a state field of one environment. Clears warm start, contacts, and the memory of sensors and actuator pipelines.
    ///
    /// The next steps then depend on the new state alone.
    ///
    /// # Errors
    /// [`Error::Environment`] when there is no such environment, [`Error::Length`], [`Error::NotFinite`], [`Error::TooLarge`], and
    /// [`Error::Quaternion`] for a quaternion of zeros, with its joint; nothing is changed then.
    pub fn set(&mut self, field: Field, env: usize, values: &[f64]) -> Result<(), Error> {
        let values = self.check_field(field, env, values)?;
        self.write_field(field, env, &values, true);
        Ok(())
    }

    /// Corrects a state field of one running environment. Warm start, delays and sensor memory do not change. Use it in observers that
    /// correct the state of a plant.
    ///
    /// # Errors
    /// The errors of [`Simulation::set`]; nothing is changed then.
    pub fn correct(&mut self, field: Field, env: usize, values: &[f64]) -> Result<(), Error> {
        let values = self.check_field(field, env, values)?;
        self.write_field(field, env, &values, false);
        Ok(())
    }

    /// Sets state fields and simulated times of the environments `envs`, which are in ascending order.
    ///
    /// If `cold` is true, the function sets fields in the same way as [`Simulation::set`], which clears the memory of earlier steps.
    /// Otherwise it sets them in the same way as [`Simulation::correct`], which keeps this memory. Setting a time has no other effect in
    /// either case.
    ///
    /// # Errors
    /// [`Error::Environment`] or [`Error::Order`] for `envs`, and the errors of [`Simulation::set`] and [`Simulation::set_time`]. Nothing
    /// is changed then.
    pub fn set_rows(&mut self, envs: &[usize], rows: &StateRows<'_>, cold: bool) -> Result<(), Error> {
        let rows = self.check_rows(envs, rows)?;
        self.write_rows(envs, rows, cold);
        Ok(())
    }

    fn check_rows(&self, envs: &[usize], rows: &StateRows<'_>) -> Result<CheckedRows, Error> {
        self.check_envs(envs)?;
        let check = |field: Field, given: Option<&[f64]>| -> Result<_, Error> {
            let Some(given) = given else { return Ok((field, Vec::new())) };
            let rows = self.rows(field.name(), given, field.width(&self.model))?;
            let checked = envs.iter().map(|&env| self.check_field(field, env, rows(env)));
            Ok((field, checked.collect::<Result<_, _>>()?))
        };
        let fields = [check(Field::Qpos, rows.qpos)?, check(Field::Qvel, rows.qvel)?, check(Field::Act, rows.act)?];
        let times = match rows.time {
            Some(given) => {
                let rows = self.rows("time", given, 1)?;
                envs.iter().map(|&env| self.check_time(env, rows(env)[0])).collect::<Result<_, _>>()?
            }
            None => Vec::new(),
        };
        Ok(CheckedRows { fields, times })
    }

    /// Returns a function that maps the index of an environment to its values in the array `given`. The array has one row of `width` values
    /// per environment, or one row for all.
    ///
    /// # Errors
    /// [`Error::Length`] with the name `name`, if the array has another length.
    fn rows<'a>(&self, name: &'static str, given: &'a [f64], width: usize) -> Result<impl Fn(usize) -> &'a [f64], Error> {
        let shared = given.len() == width;
        if !shared {
            check_length(name, given.len(), self.num_envs * width)?;
        }
        Ok(move |env: usize| if shared { given } else { &given[env * width..(env + 1) * width] })
    }

    fn write_rows(&mut self, envs: &[usize], CheckedRows { fields, times }: CheckedRows, cold: bool) {
        for (field, rows) in &fields {
            envs.iter().zip(rows).for_each(|(&env, row)| self.write_field(*field, env, row, cold));
        }
        envs.iter().zip(times).for_each(|(&env, time)| with_batch!(self.engine_mut(), batch => batch.set_time(env, time)));
    }

    /// Writes checked values to a state field. If `cold` is true, the memory of earlier steps is cleared too.
    fn write_field(&mut self, field: Field, env: usize, values: &[f64], cold: bool) {
        with_batch!(self.engine_mut(), batch => {
            batch.write(field, env, values);
            if cold {
                batch.clear_memory(env);
            } else {
                batch.discard_last_step(env);
            }
        });
    }

    /// Sets the simulated time of one environment, s.
    ///
    /// # Errors
    /// [`Error::Environment`] when there is no such environment, [`Error::NotFinite`] for a time that is not finite.
    pub fn set_time(&mut self, env: usize, time: f64) -> Result<(), Error> {
        let time = self.check_time(env, time)?;
        with_batch!(self.engine_mut(), batch => batch.set_time(env, time));
        Ok(())
    }

    /// Mutable controls of environment `env`, which the next steps use.
    pub(super) fn ctrl_mut(&mut self, env: usize) -> &mut [f64] {
        let nu = self.model.nu();
        &mut self.ctrl[env * nu..(env + 1) * nu]
    }

    /// Sets the index of the random stream from which an environment draws its random numbers. The default is the environment's index in
    /// the batch.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn set_random_stream(&mut self, env: usize, stream: u32) {
        self.assert_env(env);
        with_batch!(self.engine_mut(), batch => batch.set_random_stream(env, stream));
    }

    /// Begins a new episode in one environment: the next one of the present seed, or the first one of the seed `seed`.
    ///
    /// Random numbers differ from episode to episode. The function clears the memory of sensors and actuator pipelines, but keeps
    /// configuration and velocity.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn begin_episode(&mut self, env: usize, seed: Option<u64>) {
        self.assert_env(env);
        with_batch!(self.engine_mut(), batch => batch.begin_episode(env, seed));
    }
}

/// State fields of a keyframe, with their values.
fn fields_of(keyframe: &Keyframe) -> [(Field, &[f64]); 3] {
    [(Field::Qpos, &keyframe.qpos), (Field::Qvel, &keyframe.qvel), (Field::Act, &keyframe.act)]
}
