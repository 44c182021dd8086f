//! Arguments and results of the computation of derivatives.

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

/// Derivative of the step of one environment, a result of [`differentiate`](crate::differentiate).
#[derive(Clone, Debug, PartialEq)]
pub struct Derivative {
    /// Derivatives of the state after the step, (2 nv + na, columns). The rows are qpos (as displacements, nv), qvel (nv) and act (na). The
    /// columns are the coordinates of [`DerivativeQuery::parts`].
    pub slopes: Vec<f64>,
    /// Flags of the kinks that were found for each column of the derivative, see [`kink`](crate::kink).
    pub causes: Vec<u32>,
    /// Distance from the nominal state to the nearest kink, to first order, as a multiple of the displacement in
    /// [`DerivativeQuery::offsets`]. It is infinite if no kink was found.
    pub distance: f64,
    /// Whether the derivative is valid, because the implicit function theorem applies.
    pub sound: bool,
    /// Residual of the solved step, m/s.
    pub residual: f64,
    /// Status flags of the solved step, bits of [`Status`](stepper_core::Status).
    pub status: u32,
    /// State after the step: qpos, qvel and act.
    pub state: [Vec<f64>; 3],
}

impl Derivative {
    /// Derivative before its computation, with `columns` columns for a model with the sizes nq, nv and na.
    pub(crate) fn new([nq, nv, na]: [usize; 3], columns: usize) -> Self {
        Self {
            slopes: vec![0.0; (2 * nv + na) * columns],
            causes: vec![0; columns],
            distance: f64::INFINITY,
            sound: false,
            residual: 0.0,
            status: 0,
            state: [nq, nv, na].map(|width| vec![0.0; width]),
        }
    }

    /// Records how near the displacement of column `c` is to a kink: the displacement at which the constraint of `near` switches (a
    /// contact opens, slips ...). Updates `distance` and `causes`.
    pub(crate) fn note(&mut self, near: SwitchDistance, c: usize) {
        self.distance = self.distance.min(near.distance);
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
