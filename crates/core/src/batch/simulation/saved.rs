//! Saved states of a simulation.

use crate::batch::engine::with_batch;
use crate::batch::saved_state::SavedState;
use crate::batch::simulation::{Error, Simulation};

impl Simulation {
    /// Saved state of all environments: everything that a step hands over to the next, and the controls in force. Applied inputs are not
    /// included.
    pub fn save_state(&self) -> SavedState {
        self.sealed(with_batch!(&self.engine, batch => batch.save(None, &self.ctrl)))
    }

    /// Saved state of one environment. It equals the saved state of a simulation of that environment alone.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn save_state_of(&self, env: usize) -> SavedState {
        self.assert_env(env);
        let nu = self.model.nu();
        self.sealed(with_batch!(&self.engine, batch => batch.save(Some(env), &self.ctrl[env * nu..(env + 1) * nu])))
    }

    /// Saved state of this model and precision with the payload `payload`.
    fn sealed(&self, payload: Vec<u8>) -> SavedState {
        SavedState::new(self.digest(), self.precision, payload)
    }

    /// Digest of the model, computed at the first call. For large meshes it is slow.
    fn digest(&self) -> [u8; 32] {
        *self.digest.get_or_init(|| self.model.digest())
    }

    /// Restores a saved state in all environments. Later steps repeat the same bits.
    ///
    /// The saved state must have the same number of environments, or one environment that goes to all.
    ///
    /// # Errors
    /// [`Error::OtherModel`] for a state of another model, [`Error::StatePrecision`] for one of the other precision. [`Error::StateMisfit`]
    /// for another number of environments, other sensors or actuator models, or damaged contents. Nothing is changed then.
    pub fn restore_state(&mut self, state: &SavedState) -> Result<(), Error> {
        self.restore_state_in(state, &(0..self.num_envs).collect::<Vec<_>>())
    }

    /// Restores a saved state in the environments `envs`, ascending. If one saved environment goes to several, they still draw different
    /// random numbers.
    ///
    /// # Errors
    /// The errors of [`Simulation::restore_state`], and [`Error::Environment`] or [`Error::Order`] for `envs`.
    pub fn restore_state_in(&mut self, state: &SavedState, envs: &[usize]) -> Result<(), Error> {
        self.check_envs(envs)?;
        if state.model() != self.digest() {
            return Err(Error::OtherModel { state: state.model(), model: self.digest(), name: self.model.name.clone() });
        }
        if state.precision() != self.precision {
            return Err(Error::StatePrecision { found: state.precision(), must: self.precision });
        }
        let ctrl = with_batch!(self.engine_mut(), batch => batch.restore(state.payload(), envs)).map_err(Error::StateMisfit)?;
        let nu = self.model.nu();
        for &env in envs {
            let from = if ctrl.len() == nu { 0 } else { env };
            self.ctrl_mut(env).copy_from_slice(&ctrl[from * nu..(from + 1) * nu]);
        }
        Ok(())
    }
}
