//! Arguments and results of the computation of derivatives.

use stepper_core::Error;
use stepper_core::group_step::StatePart;
use stepper_solve::newton::{Switch, SwitchDistance};

use crate::kink::*;

/// Arguments of [`differentiate`](crate::differentiate). The first axis of an array is the environment.
#[derive(Clone, Copy, Debug)]
pub struct DerivativeQuery<'a> {
    /// Parts of the state, or controls, with respect to which the step is differentiated. Each of their coordinates is a column of the
    /// derivative, in this order.
    pub parts: &'a [StatePart],
    /// Displacements of the coordinate of each column, (num_envs, points, columns), in the SI unit of the coordinate.
    pub offsets: &'a [f64],
    /// Number of displaced states at which the step is evaluated for each column, 1 or 2.
    pub points: usize,
    /// Residual to which the step is solved, m/s.
    pub tolerance: f64,
}

/// Result arrays of [`differentiate`](crate::differentiate). The first axis of an array is the environment.
#[derive(Debug)]
pub struct DerivativeRows<'a> {
    /// Derivatives of the state after the step, (num_envs, 2 nv + na, columns). The rows are qpos (as displacements, nv), qvel (nv) and act
    /// (na). The columns are the coordinates of [`DerivativeQuery::parts`].
    pub slopes: &'a mut [f64],
    /// Flags of the kinks that were found for each column of the derivative, (num_envs, columns), see [`kink`](crate::kink).
    pub causes: &'a mut [u32],
    /// Distance from the nominal state to the nearest kink, (num_envs), to first order, as a multiple of the displacement in
    /// [`DerivativeQuery::offsets`]. It is infinite if no kink was found.
    pub distance: &'a mut [f64],
    /// Whether the derivative is valid, (num_envs): 1 if the implicit function theorem applies, otherwise 0.
    pub sound: &'a mut [u8],
    /// Residual of the solved step, m/s, (num_envs).
    pub residual: &'a mut [f64],
    /// Status flags of the solved step, bits of [`Status`](stepper_core::Status), (num_envs).
    pub status: &'a mut [u32],
    /// State after the step: arrays of qpos, qvel and act, with nq, nv and na numbers per environment.
    pub state: [&'a mut [f64]; 3],
}

impl<'a> DerivativeRows<'a> {
    /// Splits the result arrays into `num_envs` parts, one for each environment.
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

    /// Records how near the displacement of column `c` is to a kink: the displacement at which the constraint of `near` switches (a
    /// contact opens, slips ...). Updates `distance` and `causes`.
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

/// Splits an array into `num_envs` equal parts, one for each environment. All parts of an empty array are empty.
fn each<T>(all: &mut [T], num_envs: usize) -> impl Iterator<Item = &mut [T]> {
    all.chunks_mut((all.len() / num_envs).max(1)).chain(std::iter::repeat_with(Default::default))
}

/// Checks that the array `name` has the required length.
pub(crate) fn check_length(name: &'static str, found: usize, must: usize) -> Result<(), Error> {
    if found == must { Ok(()) } else { Err(Error::Length { name, found, must, detail: String::new() }) }
}
