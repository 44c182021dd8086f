//! Saved states of a simulation.

use std::ops::Range;

use crate::batch::engine::with_batch;
use crate::batch::inputs::AppliedInput;
use crate::batch::saved_state::SavedState;
use crate::batch::simulation::{Error, Simulation};

impl Simulation {
    /// Saved state of all environments: everything that a step hands over to the next, and the controls in force. Applied inputs are not
    /// included.
    pub fn save_state(&self) -> SavedState {
        let eq_active = self.switched_equalities(0..self.num_envs);
        self.sealed(with_batch!(&self.engine, batch => batch.save(None, &self.ctrl, eq_active)))
    }

    /// Saved state of one environment. It equals the saved state of a simulation of that environment alone.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn save_state_of(&self, env: usize) -> SavedState {
        self.assert_env(env);
        let nu = self.model.nu();
        let eq_active = self.switched_equalities(env..env + 1);
        self.sealed(with_batch!(&self.engine, batch => batch.save(Some(env), &self.ctrl[env * nu..(env + 1) * nu], eq_active)))
    }

    /// Active equalities of the environments `envs`, neq for each. Empty if all of them have those of the model.
    fn switched_equalities(&self, envs: Range<usize>) -> &[f64] {
        let (rows, reset) = (self.applied.get(AppliedInput::EqActive), AppliedInput::EqActive.at_reset(&self.model));
        if rows.is_empty() {
            return rows;
        }
        let rows = &rows[envs.start * reset.len()..envs.end * reset.len()];
        if rows.chunks(reset.len()).all(|row| row == reset) { &[] } else { rows }
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
        let (ctrl, eq_active) = with_batch!(self.engine_mut(), batch => batch.restore(&state.payload, envs)).map_err(Error::StateMisfit)?;
        let nu = self.model.nu();
        for &env in envs {
            let from = if ctrl.len() == nu { 0 } else { env };
            self.ctrl_mut(env).copy_from_slice(&ctrl[from * nu..(from + 1) * nu]);
        }
        if eq_active.is_empty() && self.applied.get(AppliedInput::EqActive).is_empty() {
            return Ok(());
        }
        self.revision += 1;
        let reset = AppliedInput::EqActive.at_reset(&self.model);
        for &env in envs {
            let saved = if eq_active.len() == reset.len() { &eq_active[..] } else { eq_active.get(env * reset.len()..).unwrap_or(&[]) };
            let row: Vec<f64> = saved.iter().take(reset.len()).map(|&active| f64::from(u8::from(active))).collect();
            let row = if row.is_empty() { &reset } else { &row };
            self.applied.set_row(AppliedInput::EqActive, env, row, &self.model, self.num_envs);
        }
        Ok(())
    }
}
