//! What MuJoCo's contact law needs of a scene: how soft its constraints are, and what softness is relative to.

use serde::{Deserialize, Serialize};

use crate::added_fields;

/// Shape of the friction cones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Cone {
    /// Pyramid whose edges are n + mu_k t_k and n - mu_k t_k, each with a force of its own.
    #[default]
    Pyramidal,
    /// Ellipse `sum (f_k / mu_k)^2 <= f_n^2`.
    Elliptic,
}

/// Softness of a constraint: reference acceleration and impedance (MuJoCo's documentation, "Solver parameters").
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Softness {
    /// Time constant (s) and damping ratio of the error, or minus stiffness and minus damping relative to the mass.
    pub solref: [f64; 2],
    /// Impedance without error and at its largest, the error over which it grows (m or rad), and midpoint and power of the curve.
    pub solimp: [f64; 5],
}

impl Default for Softness {
    /// MuJoCo's own.
    fn default() -> Self {
        Self { solref: [0.02, 1.0], solimp: [0.9, 0.95, 0.001, 0.5, 2.0] }
    }
}

impl Softness {
    /// Softness of a contact of two geoms without priority (MuJoCo's `mj_contactParam`): `share` is the first geom's.
    pub(crate) fn mix(a: Self, b: Self, share: f64) -> Self {
        let blend = |a: f64, b: f64| share * a + (1.0 - share) * b;
        let standard = a.solref[0] > 0.0 && b.solref[0] > 0.0;
        Self {
            solref: std::array::from_fn(|k| if standard { blend(a.solref[k], b.solref[k]) } else { a.solref[k].min(b.solref[k]) }),
            solimp: std::array::from_fn(|k| blend(a.solimp[k], b.solimp[k])),
        }
    }
}

/// A spring and a damper beside it, between what touches: physical softness, in either law of contact.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ContactSpring {
    /// N/m; infinity is rigid.
    pub stiffness: f64,
    /// N s/m.
    pub damping: f64,
}

impl Default for ContactSpring {
    /// Rigid.
    fn default() -> Self {
        Self { stiffness: f64::INFINITY, damping: 0.0 }
    }
}

impl ContactSpring {
    /// Whether nothing gives way.
    pub fn is_rigid(&self) -> bool {
        self.stiffness.is_infinite()
    }

    /// Two surfaces that press on one another: springs in series, which share the depth inversely to their stiffnesses, and the damping
    /// that dissipates what both do at these shares.
    pub(crate) fn in_series([a, b]: [Self; 2]) -> Self {
        if a.is_rigid() || b.is_rigid() {
            return if a.is_rigid() { b } else { a };
        }
        let [share_a, share_b] = [b.stiffness, a.stiffness].map(|k| k / (a.stiffness + b.stiffness));
        Self { stiffness: a.stiffness * share_a, damping: a.damping * share_a * share_a + b.damping * share_b * share_b }
    }
}

/// Magnitude below which MuJoCo takes a number for zero (`mjMINVAL`).
pub const MIN_VALUE: f64 = 1e-15;

/// Share of the first of two geoms in what they mix, from their `solmix`.
pub(crate) fn mixing_share([a, b]: [f64; 2]) -> f64 {
    match (a >= MIN_VALUE, b >= MIN_VALUE) {
        (true, true) => a / (a + b),
        (false, false) => 0.5,
        (true, false) => 1.0,
        (false, true) => 0.0,
    }
}

/// What MuJoCo's contact law needs of a whole scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SoftSettings {
    /// Shape of the friction cone.
    pub cone: Cone,
    /// Ratio of the impedance of friction to that of normal forces.
    pub impratio: f64,
    /// Whether time constants are at least two time steps.
    pub refsafe: bool,
    /// What softness is relative to; `None` lets stepper compute it.
    pub inverse_weights: Option<InverseWeights>,
    /// Sweeps after the solution that take the slip out of friction.
    #[serde(default, with = "added_fields")]
    pub noslip: NoSlip,
}

/// MuJoCo's noslip post-processing: what is left of slip where the regularisation of friction lets contacts creep.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoSlip {
    /// Sweeps at the most; 0 for none.
    pub iterations: u32,
    /// Improvement of the objective at which they stop, relative to the sum of the diagonal of an island's mass matrix.
    pub tolerance: f64,
}

impl Default for NoSlip {
    /// MuJoCo's own.
    fn default() -> Self {
        Self { iterations: 0, tolerance: 1e-6 }
    }
}

impl Default for SoftSettings {
    fn default() -> Self {
        Self { cone: Cone::Pyramidal, impratio: 1.0, refsafe: true, inverse_weights: None, noslip: NoSlip::default() }
    }
}

/// Mean inverse inertia at the reference configuration (MuJoCo's `body_invweight0`, `dof_invweight0`, `tendon_invweight0`): what the
/// regularisation of a row is a fraction of. They are numbers of the model, so that environments with other masses keep them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InverseWeights {
    /// Of every body: translation, 1/kg, and rotation, 1/(kg m^2).
    pub bodies: Vec<[f64; 2]>,
    /// Of every degree of freedom.
    pub dofs: Vec<f64>,
    /// Of every tendon.
    pub tendons: Vec<f64>,
}
