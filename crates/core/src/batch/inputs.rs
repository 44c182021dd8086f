//! Inputs of the user: inputs of a call, fields of the state, values for the state, and starts of episodes.

use crate::model::Model;

/// Inputs of a call of `step`, environment-major. For an empty slice, the present input remains in force; an empty mask selects all
/// environments.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepInputs<'a> {
    /// Controls, (num_envs, nu), or (nu) for all environments. They remain in force after the call.
    ///
    /// A NaN or infinite control is no error, because other environments continue. Such a control remains in force like any other. If it
    /// makes a step non-finite, the environment gets the flag [`Status::NON_FINITE`](crate::Status::NON_FINITE), and the bodies concerned
    /// keep their state.
    pub ctrl: &'a [f64],
    /// Applied generalized forces (`qfrc_applied`) during this call, (num_envs, nv), N or N m.
    pub qfrc: &'a [f64],
    /// Applied force (N) and torque (N m) at every body's centre of mass during this call, world axes, (num_envs, nbody, 6).
    pub xfrc: &'a [f64],
    /// Target positions of the mocap bodies for this call, (num_envs, nmocap, 3), world frame, m.
    pub mocap_pos: &'a [f64],
    /// Target orientations of the mocap bodies for this call, (num_envs, nmocap, 4), quaternions (w, x, y, z).
    pub mocap_quat: &'a [f64],
    /// Whether each equality is active during this call, (num_envs, neq); 0 for an inactive equality.
    pub eq_active: &'a [f64],
    /// Mask of the environments that make steps, (num_envs). The state of other environments does not change, and their inputs have no
    /// effect. An empty mask selects all environments.
    pub mask: &'a [bool],
}

impl<'a> StepInputs<'a> {
    /// Arrays of inputs except controls and mask, in the order of [`AppliedInput::ALL`].
    pub(super) fn applied(&self) -> [&'a [f64]; 5] {
        [self.qfrc, self.xfrc, self.mocap_pos, self.mocap_quat, self.eq_active]
    }
}

stepper_model::named! {
    /// State array that the user can read and write.
    #[non_exhaustive]
    pub enum Field {
        /// Configuration, nq numbers per environment.
        Qpos = "qpos",
        /// Velocity, nv numbers per environment.
        Qvel = "qvel",
        /// Activations, na numbers per environment.
        Act = "act",
    }
}

impl Field {
    /// Number of values per environment.
    pub fn width(self, model: &Model) -> usize {
        match self {
            Self::Qpos => model.nq(),
            Self::Qvel => model.nv(),
            Self::Act => model.na(),
        }
    }
}

stepper_model::named! {
    /// Kind of input other than controls: applied forces, poses of mocap bodies, or active equalities. Values persist until the user
    /// changes them or resets the environment.
    #[non_exhaustive]
    pub enum AppliedInput {
        /// Generalized forces (`qfrc_applied`), (nv), N or N m.
        QfrcApplied = "qfrc_applied",
        /// Force (N) and torque (N m) at every body's centre of mass, world axes, (nbody, 6).
        XfrcApplied = "xfrc_applied",
        /// Target positions of the mocap bodies, (nmocap, 3), world frame, m.
        MocapPos = "mocap_pos",
        /// Target orientations of the mocap bodies, (nmocap, 4), quaternions (w, x, y, z).
        MocapQuat = "mocap_quat",
        /// Whether each equality is active, (neq): 1 for active, 0 for inactive.
        EqActive = "eq_active",
    }
}

impl AppliedInput {
    /// Number of elements of the model with this input, and number of values for each.
    fn rows_and_columns(self, model: &Model) -> [usize; 2] {
        let nmocap = || model.bodies.iter().filter(|b| b.mocap).count();
        match self {
            Self::QfrcApplied => [model.nv(), 1],
            Self::XfrcApplied => [model.bodies.len(), 6],
            Self::MocapPos => [nmocap(), 3],
            Self::MocapQuat => [nmocap(), 4],
            Self::EqActive => [model.equalities.len(), 1],
        }
    }

    /// Shape of the input of one environment. It has one axis if each element has one value.
    pub fn shape(self, model: &Model) -> Vec<usize> {
        match self.rows_and_columns(model) {
            [rows, 1] => vec![rows],
            both => both.to_vec(),
        }
    }

    /// Number of values per environment.
    pub fn width(self, model: &Model) -> usize {
        let [rows, columns] = self.rows_and_columns(model);
        rows * columns
    }

    /// Value of the input for one environment after a reset: no forces, mocap bodies at the poses of the model, and the model's active
    /// equalities.
    pub fn at_reset(self, model: &Model) -> Vec<f64> {
        let mocap = || model.bodies.iter().filter(|b| b.mocap);
        match self {
            Self::QfrcApplied | Self::XfrcApplied => vec![0.0; self.width(model)],
            Self::MocapPos => mocap().flat_map(|b| b.pos).collect(),
            Self::MocapQuat => mocap().flat_map(|b| b.quat).collect(),
            Self::EqActive => model.equalities.iter().map(|equality| f64::from(u8::from(equality.active))).collect(),
        }
    }
}

/// Applied inputs in force, for all environments.
#[derive(Clone, Debug, Default)]
pub(super) struct AppliedInputs {
    /// Input arrays in the order of [`AppliedInput::ALL`], (num_envs, ...) each. An array is empty until the user sets the input.
    arrays: [Vec<f64>; 5],
}

impl AppliedInputs {
    /// Array of one kind of input, (num_envs, ...). Empty until the user sets the input.
    pub(super) fn get(&self, input: AppliedInput) -> &[f64] {
        &self.arrays[input as usize]
    }

    /// Sets one kind of input in all environments. An empty array clears it.
    ///
    /// If the user sets only positions or only orientations of mocap bodies, the missing array gets the values of the reset state.
    pub(super) fn set(&mut self, input: AppliedInput, values: &[f64], model: &Model, num_envs: usize) {
        let array = &mut self.arrays[input as usize];
        array.clear();
        array.extend_from_slice(values);
        for [given, missing] in [[AppliedInput::MocapPos, AppliedInput::MocapQuat], [AppliedInput::MocapQuat, AppliedInput::MocapPos]] {
            if !self.get(given).is_empty() && self.get(missing).is_empty() {
                self.arrays[missing as usize] = missing.at_reset(model).repeat(num_envs);
            }
        }
    }

    /// Sets one kind of input in environment `env`. Other environments keep theirs, or get the reset value if none was set.
    pub(super) fn set_row(&mut self, input: AppliedInput, env: usize, row: &[f64], model: &Model, num_envs: usize) {
        let array = &mut self.arrays[input as usize];
        if array.is_empty() {
            *array = input.at_reset(model).repeat(num_envs);
        }
        array[env * row.len()..][..row.len()].copy_from_slice(row);
    }

    /// Resets all applied inputs of environment `env`.
    pub(super) fn reset(&mut self, env: usize, model: &Model) {
        for input in AppliedInput::ALL {
            let array = &mut self.arrays[input as usize];
            if !array.is_empty() {
                let row = input.at_reset(model);
                array[env * row.len()..][..row.len()].copy_from_slice(&row);
            }
        }
    }

    /// Completes the inputs of a call. An array that is empty in `given` is replaced by the input in force.
    pub(super) fn complete<'a>(&'a self, given: &StepInputs<'a>) -> StepInputs<'a> {
        self.complete_with(given, |held| held)
    }

    /// Completes the inputs of a call for environment `env` alone with the inputs in force. The arrays of `given` have one row, for this
    /// environment.
    pub(super) fn complete_one<'a>(&'a self, env: usize, num_envs: usize, given: &StepInputs<'a>) -> StepInputs<'a> {
        self.complete_with(given, |held| &held[env * (held.len() / num_envs)..][..held.len() / num_envs])
    }

    /// Completes the inputs `given` of a call with the inputs in force. `part` selects, from an array of inputs in force, the rows that the
    /// call needs.
    fn complete_with<'a>(&'a self, given: &StepInputs<'a>, part: impl Fn(&'a [f64]) -> &'a [f64]) -> StepInputs<'a> {
        let applied = given.applied();
        let [qfrc, xfrc, mocap_pos, mocap_quat, eq_active] =
            std::array::from_fn(|k| if applied[k].is_empty() { part(&self.arrays[k]) } else { applied[k] });
        StepInputs { qfrc, xfrc, mocap_pos, mocap_quat, eq_active, ..*given }
    }

    /// Memory of the arrays, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.arrays.iter().map(|array| size_of_val(&array[..])).sum()
    }
}

/// Values to write to the state of some environments. Each array has one row per environment of the simulation, or one row for all. `None`
/// writes no value.
#[derive(Clone, Copy, Debug, Default)]
pub struct StateRows<'a> {
    /// Configurations, (num_envs, nq) or (nq): m, rad and quaternions, which are normalised.
    pub qpos: Option<&'a [f64]>,
    /// Velocities, (num_envs, nv) or (nv): m/s and rad/s.
    pub qvel: Option<&'a [f64]>,
    /// Activations, (num_envs, na) or (na).
    pub act: Option<&'a [f64]>,
    /// Simulated times, (num_envs) or one number, s.
    pub time: Option<&'a [f64]>,
}

/// Start of an episode: changes to the reset state of the model.
#[derive(Clone, Copy, Debug, Default)]
pub struct Episode<'a> {
    /// New seed of the random numbers, one number for all or one for each environment of the batch. The episode is the first of this seed.
    /// `None` starts the next episode of the present seed.
    pub seed: Option<&'a [u64]>,
    /// Keyframe of the model from which the episode takes state, time and controls.
    pub keyframe: Option<&'a crate::model::Keyframe>,
    /// State values that replace those of the reset state or of the keyframe.
    pub rows: StateRows<'a>,
}
