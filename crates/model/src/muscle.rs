//! Muscles: force-length-velocity curves, as in MuJoCo.

use serde::{Deserialize, Serialize};

/// Number of parameters of a muscle's gain, and of its bias.
pub const MUSCLE_PARAMETERS: usize = 9;

/// Parameters of a muscle's active force (the gain) and of its passive force (the bias).
///
/// Both lists have nine numbers in MuJoCo's order:
///
/// - lowest and highest operating length, relative to the optimal length,
/// - peak force, N; a negative number selects `scale / acceleration`,
/// - scale,
/// - lowest and highest length with active force, relative to the optimal length,
/// - highest speed of shortening, optimal lengths per s,
/// - passive force at the highest length, relative to the peak force,
/// - active force at the highest speed of lengthening, relative to the peak force.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Muscle {
    /// Lowest and highest length of the actuator, m or rad (MuJoCo's `actuator_lengthrange`).
    pub length_range: [f64; 2],
    /// Magnitude of the acceleration by a unit force in the reference configuration (MuJoCo's `actuator_acc0`).
    pub acceleration: f64,
    /// Parameters of the active force.
    pub gain: [f64; MUSCLE_PARAMETERS],
    /// Parameters of the passive force.
    pub bias: [f64; MUSCLE_PARAMETERS],
}
