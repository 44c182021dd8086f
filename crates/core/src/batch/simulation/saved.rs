//! States of a simulation, saved and restored.

use crate::batch::saved_state::SavedState;
use crate::batch::simulation::{Error, Simulation};

impl Simulation {
    /// All that survives a step, of all environments, the controls in force included. What the user applies is no part of it.
    pub fn save_state(&self) -> SavedState {
        self.sealed(self.engine.save(None, &self.ctrl))
    }

    /// The same of one environment, as a simulation of that one would save it.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn save_state_of(&self, env: usize) -> SavedState {
        self.assert_env(env);
        let nu = self.model.nu();
        self.sealed(self.engine.save(Some(env), &self.ctrl[env * nu..(env + 1) * nu]))
    }

    fn sealed(&self, payload: Vec<u8>) -> SavedState {
        SavedState::new(self.digest(), self.precision, payload)
    }

    /// The digest of the model, which takes a while of meshes.
    fn digest(&self) -> [u8; 32] {
        *self.digest.get_or_init(|| self.model.digest())
    }

    /// Takes over what [`Simulation::save_state`] saved, in all environments: from a state of as many, or the same in all from a state of
    /// one. Continuing from it repeats the same bits.
    ///
    /// # Errors
    /// [`Error::OtherModel`] for a state of another model, [`Error::StatePrecision`] for one of the other precision, [`Error::StateMisfit`]
    /// for one of another number of environments, of other sensors or drives, or with damaged contents. Nothing is changed then.
    pub fn restore_state(&mut self, state: &SavedState) -> Result<(), Error> {
        self.restore_state_in(state, &(0..self.num_envs).collect::<Vec<_>>())
    }

    /// The same in the environments `envs`, ascending. Where the state of one environment is given to several, each goes on to draw random
    /// numbers of its own.
    ///
    /// # Errors
    /// As [`Simulation::restore_state`], and [`Error::Environment`] or [`Error::Order`] for `envs`.
    pub fn restore_state_in(&mut self, state: &SavedState, envs: &[usize]) -> Result<(), Error> {
        self.check_envs(envs)?;
        if state.model() != self.digest() {
            return Err(Error::OtherModel { state: state.model(), model: self.digest(), name: self.model.name.clone() });
        }
        if state.precision() != self.precision {
            return Err(Error::StatePrecision { found: state.precision(), must: self.precision });
        }
        let ctrl = self.engine_mut().restore(state.payload(), envs).map_err(Error::StateMisfit)?;
        let nu = self.model.nu();
        for &env in envs {
            let from = if ctrl.len() == nu { 0 } else { env };
            self.ctrl_mut(env).copy_from_slice(&ctrl[from * nu..(from + 1) * nu]);
        }
        Ok(())
    }
}
