//! Inputs of the user: inputs of a call, fields of the state, rows for many environments.

use crate::model::Model;

/// Inputs of a call of `step`, environment-major. An empty slice keeps the input that is in force.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepInputs<'a> {
    /// Controls, (num_envs, nu), or (nu) for all: from this call on.
    ///
    /// A NaN or infinite control is no error, because other environments continue. It stays in force like any other. If a step is not
    /// finite because of it, its environment keeps its state and the flag [`Status::NON_FINITE`](crate::Status::NON_FINITE).
    pub ctrl: &'a [f64],
    /// Forces on the joints in N or N m, (num_envs, nv): in this call.
    pub qfrc: &'a [f64],
    /// Force (N) and torque (N m) at every body's centre of mass, world axes, (num_envs, nbody, 6): in this call.
    pub xfrc: &'a [f64],
    /// Positions of the mocap bodies in m, (num_envs, nmocap, 3): in this call.
    pub mocap_pos: &'a [f64],
    /// Orientations of the mocap bodies, (num_envs, nmocap, 4): in this call.
    pub mocap_quat: &'a [f64],
    /// Activity of equalities, (num_envs, neq), 0 for an inactive one: in this call.
    pub eq_active: &'a [f64],
    /// Mask of the environments that step, (num_envs). The others stay as they are, to the bit, and their inputs are not read.
    pub mask: &'a [bool],
}

impl<'a> StepInputs<'a> {
    /// Inputs without the controls, in the order of [`AppliedInput::ALL`].
    pub(super) fn applied(&self) -> [&'a [f64]; 5] {
        [self.qfrc, self.xfrc, self.mocap_pos, self.mocap_quat, self.eq_active]
    }
}

/// Arrays of the state that can be read and written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Field {
    /// Configuration, nq.
    Qpos,
    /// Velocity, nv.
    Qvel,
    /// Activations, na.
    Act,
}

impl Field {
    /// Name in Python and in messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Qpos => "qpos",
            Self::Qvel => "qvel",
            Self::Act => "act",
        }
    }

    /// Numbers per environment.
    pub fn width(self, model: &Model) -> usize {
        match self {
            Self::Qpos => model.nq(),
            Self::Qvel => model.nv(),
            Self::Act => model.na(),
        }
    }
}

/// Kind of input besides controls: applied forces, poses of mocap bodies, or active equalities. Values persist until the user changes them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum AppliedInput {
    /// Forces on the joints in N or N m, (nv).
    QfrcApplied,
    /// Force (N) and torque (N m) at every body's centre of mass, world axes, (nbody, 6).
    XfrcApplied,
    /// Positions of the mocap bodies in m, (nmocap, 3).
    MocapPos,
    /// Orientations of the mocap bodies, (nmocap, 4).
    MocapQuat,
    /// Activity of equalities, (neq): 1, or 0 for an inactive one.
    EqActive,
}

impl AppliedInput {
    /// All applied inputs.
    pub const ALL: [Self; 5] = [Self::QfrcApplied, Self::XfrcApplied, Self::MocapPos, Self::MocapQuat, Self::EqActive];

    /// Name in Python and in messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::QfrcApplied => "qfrc_applied",
            Self::XfrcApplied => "xfrc_applied",
            Self::MocapPos => "mocap_pos",
            Self::MocapQuat => "mocap_quat",
            Self::EqActive => "eq_active",
        }
    }

    /// Shape of one environment's part.
    pub fn shape(self, model: &Model) -> Vec<usize> {
        let nmocap = || model.bodies.iter().filter(|b| b.mocap).count();
        match self {
            Self::QfrcApplied => vec![model.nv()],
            Self::XfrcApplied => vec![model.bodies.len(), 6],
            Self::MocapPos => vec![nmocap(), 3],
            Self::MocapQuat => vec![nmocap(), 4],
            Self::EqActive => vec![model.equalities.len()],
        }
    }

    /// Part of one environment after a reset: no forces, mocap bodies at the poses of the model, and the model's activity of equalities.
    pub fn at_reset(self, model: &Model) -> Vec<f64> {
        let mocap = || model.bodies.iter().filter(|b| b.mocap);
        match self {
            Self::QfrcApplied | Self::XfrcApplied => vec![0.0; self.shape(model).iter().product()],
            Self::MocapPos => mocap().flat_map(|b| b.pos).collect(),
            Self::MocapQuat => mocap().flat_map(|b| b.quat).collect(),
            Self::EqActive => model.equalities.iter().map(|equality| f64::from(u8::from(equality.active))).collect(),
        }
    }
}

/// Applied inputs, in force until the user changes them.
#[derive(Clone, Debug, Default)]
pub(super) struct AppliedInputs {
    /// Arrays in the order of [`AppliedInput::ALL`], (num_envs, ...) each; empty before the first input.
    arrays: [Vec<f64>; 5],
}

impl AppliedInputs {
    /// Array of an input, (num_envs, ...); empty before the first input.
    pub(super) fn get(&self, input: AppliedInput) -> &[f64] {
        &self.arrays[input as usize]
    }

    /// Replaces one array; an empty one clears the input.
    ///
    /// If only positions or only orientations of mocap bodies are given, the others are those of the reset state.
    pub(super) fn set(&mut self, input: AppliedInput, values: &[f64], model: &Model, num_envs: usize) {
        let array = &mut self.arrays[input as usize];
        array.clear();
        array.extend_from_slice(values);
        let poses = [AppliedInput::MocapPos, AppliedInput::MocapQuat];
        let given = poses.map(|pose| !self.arrays[pose as usize].is_empty());
        for (pose, given) in poses.into_iter().zip(given).filter(|_| given[0] != given[1]) {
            if !given {
                self.arrays[pose as usize] = pose.at_reset(model).repeat(num_envs);
            }
        }
    }

    /// Resets one environment's part of every array.
    pub(super) fn reset(&mut self, env: usize, model: &Model) {
        for input in AppliedInput::ALL {
            let array = &mut self.arrays[input as usize];
            if !array.is_empty() {
                let row = input.at_reset(model);
                array[env * row.len()..][..row.len()].copy_from_slice(&row);
            }
        }
    }

    /// Inputs of a call: those given, and those in force where none are given.
    pub(super) fn complete<'a>(&'a self, given: &StepInputs<'a>) -> StepInputs<'a> {
        self.complete_with(given, |held| held)
    }

    /// Inputs of a call for one environment. `given` has the inputs of this environment alone.
    pub(super) fn complete_one<'a>(&'a self, env: usize, num_envs: usize, given: &StepInputs<'a>) -> StepInputs<'a> {
        self.complete_with(given, |held| &held[env * (held.len() / num_envs)..][..held.len() / num_envs])
    }

    /// Inputs of a call, with `part` selecting from each array in force.
    fn complete_with<'a>(&'a self, given: &StepInputs<'a>, part: impl Fn(&'a [f64]) -> &'a [f64]) -> StepInputs<'a> {
        let [qfrc, xfrc, mocap_pos, mocap_quat, eq_active] = &self.arrays;
        let or = |given: &'a [f64], held: &'a [f64]| if given.is_empty() { part(held) } else { given };
        StepInputs {
            ctrl: given.ctrl,
            qfrc: or(given.qfrc, qfrc),
            xfrc: or(given.xfrc, xfrc),
            mocap_pos: or(given.mocap_pos, mocap_pos),
            mocap_quat: or(given.mocap_quat, mocap_quat),
            eq_active: or(given.eq_active, eq_active),
            mask: given.mask,
        }
    }

    /// Memory of the arrays, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.arrays.iter().map(|array| size_of_val(&array[..])).sum()
    }
}

/// Values to write to the state of some environments. Each array has a row for every environment of the simulation, or one row for all.
#[derive(Clone, Copy, Debug, Default)]
pub struct StateRows<'a> {
    /// Configurations, (num_envs, nq) or (nq): m, rad and quaternions, which are normalised.
    pub qpos: Option<&'a [f64]>,
    /// Velocities, (num_envs, nv) or (nv): m/s and rad/s.
    pub qvel: Option<&'a [f64]>,
    /// Activations, (num_envs, na) or (na).
    pub act: Option<&'a [f64]>,
    /// Times in s, (num_envs) or one.
    pub time: Option<&'a [f64]>,
}

/// Initial state of an episode, based on the reset state of the model.
#[derive(Clone, Copy, Debug, Default)]
pub struct Episode<'a> {
    /// New seed, for all or for each environment of the batch, with this as its first episode. `None` starts the next episode under the old
    /// seed.
    pub seed: Option<&'a [u64]>,
    /// Keyframe of the model: state, time and controls in force.
    pub keyframe: Option<&'a crate::model::Keyframe>,
    /// Values that replace those of the reset state.
    pub rows: StateRows<'a>,
}
