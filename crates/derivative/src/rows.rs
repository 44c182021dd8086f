//! Arguments and results of derivatives.

use stepper_core::Error;
use stepper_core::group_step::StatePart;
use stepper_solve::newton::{Switch, SwitchDistance};

use crate::kink::*;

/// Arguments of a derivative; arrays are environment-major.
#[derive(Clone, Copy, Debug)]
pub struct DerivativeQuery<'a> {
    /// Parts in the order of their columns.
    pub parts: &'a [StatePart],
    /// Displacements of every column, (num_envs, points, columns) with one point or two.
    pub offsets: &'a [f64],
    /// Number of points of a column.
    pub points: usize,
    /// Residual to which the step is solved, m/s.
    pub tolerance: f64,
}

/// Results of a derivative, environment-major.
#[derive(Debug)]
pub struct DerivativeRows<'a> {
    /// Derivatives of displacements of qpos, qvel and act after the step, (num_envs, 2 nv + na, columns).
    pub slopes: &'a mut [f64],
    /// Flags of every column, (num_envs, columns), see [`kink`](crate::kink).
    pub causes: &'a mut [u32],
    /// Distance to the nearest kink in widths of the displacements, to first order; infinite without any.
    pub distance: &'a mut [f64],
    /// Whether the derivative is that of the step: 0 where the implicit function theorem does not apply.
    pub sound: &'a mut [u8],
    /// Residual of the step, m/s.
    pub residual: &'a mut [f64],
    /// Flags of the environments, bits of [`Status`](stepper_core::Status).
    pub status: &'a mut [u32],
    /// State after the step: nq, nv and na numbers.
    pub state: [&'a mut [f64]; 3],
}

impl<'a> DerivativeRows<'a> {
    /// Rows of each of `num_envs` environments.
    pub(crate) fn environments(self, num_envs: usize) -> impl Iterator<Item = DerivativeRows<'a>> {
        let Self { slopes, causes, distance, sound, residual, status, state } = self;
        let [mut slopes, mut distance, mut residual] = [slopes, distance, residual].map(|all| each(all, num_envs));
        let [mut causes, mut status] = [causes, status].map(|all| each(all, num_envs));
        let (mut sound, mut state) = (each(sound, num_envs), state.map(|all| each(all, num_envs)));
        std::iter::from_fn(move || {
            Some(DerivativeRows {
                slopes: slopes.next()?,
                causes: causes.next()?,
                distance: distance.next()?,
                sound: sound.next()?,
                residual: residual.next()?,
                status: status.next()?,
                state: state.each_mut().map(|rows| rows.next().unwrap_or_default()),
            })
        })
        .take(num_envs)
    }

    /// Records, for one environment, the constraint that the displacement of column `c` brings closer to another mode.
    pub(crate) fn note(&mut self, near: SwitchDistance, c: usize) {
        self.distance[0] = self.distance[0].min(near.distance);
        if near.distance <= 1.0 {
            self.causes[c] |= match near.switch {
                Switch::Contact => CONTACT,
                Switch::Slip => SLIP,
                Switch::Limit => LIMIT,
                Switch::DryFriction => DRY_FRICTION,
                Switch::Gap => GAP,
            };
        }
    }
}

/// Numbers of each of `num_envs` environments, none of each if there are none.
fn each<T>(all: &mut [T], num_envs: usize) -> impl Iterator<Item = &mut [T]> {
    all.chunks_mut((all.len() / num_envs).max(1)).chain(std::iter::repeat_with(Default::default))
}

/// Checks the length of an array.
pub(crate) fn check_length(name: &'static str, found: usize, must: usize) -> Result<(), Error> {
    if found == must { Ok(()) } else { Err(Error::Length { name, found, must, detail: String::new() }) }
}
