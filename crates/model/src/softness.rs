//! Softness of constraints in MuJoCo's contact law, and the inverse weights to which it is relative.

use serde::{Deserialize, Serialize};

use crate::added_fields;

/// Shape of the friction cones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Cone {
    /// Pyramid with edges n + mu_k t_k and n - mu_k t_k, each with a separate force.
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
    /// Impedance without error and its largest value; the error over which it grows (m or rad); midpoint and power of the curve.
    pub solimp: [f64; 5],
}

impl Default for Softness {
    /// MuJoCo's default.
    fn default() -> Self {
        Self { solref: [0.02, 1.0], solimp: [0.9, 0.95, 0.001, 0.5, 2.0] }
    }
}

impl Softness {
    /// Softness of a contact of two geoms with equal priority (MuJoCo's `mj_contactParam`). `share` is the weight of the first geom.
    pub(crate) fn mix(a: Self, b: Self, share: f64) -> Self {
        let blend = |a: f64, b: f64| share * a + (1.0 - share) * b;
        let standard = a.solref[0] > 0.0 && b.solref[0] > 0.0;
        Self {
            solref: std::array::from_fn(|k| if standard { blend(a.solref[k], b.solref[k]) } else { a.solref[k].min(b.solref[k]) }),
            solimp: std::array::from_fn(|k| blend(a.solimp[k], b.solimp[k])),
        }
    }
}

/// Spring and damper in parallel between two surfaces: compliance in both contact laws.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ContactSpring {
    /// Stiffness, N/m; infinite is rigid.
    pub stiffness: f64,
    /// Damping, N s/m.
    pub damping: f64,
}

impl Default for ContactSpring {
    /// Rigid contact.
    fn default() -> Self {
        Self { stiffness: f64::INFINITY, damping: 0.0 }
    }
}

impl ContactSpring {
    /// Whether the contact is rigid.
    pub fn is_rigid(&self) -> bool {
        self.stiffness.is_infinite()
    }

    /// Compliance of two surfaces that press on each other. Springs in series share the penetration inversely to their stiffnesses, and the
    /// damping dissipates as much as both do with these shares.
    pub(crate) fn in_series([a, b]: [Self; 2]) -> Self {
        if a.is_rigid() || b.is_rigid() {
            return if a.is_rigid() { b } else { a };
        }
        let [share_a, share_b] = [b.stiffness, a.stiffness].map(|k| k / (a.stiffness + b.stiffness));
        Self { stiffness: a.stiffness * share_a, damping: a.damping * share_a * share_a + b.damping * share_b * share_b }
    }
}

/// Magnitude below which MuJoCo treats a number as zero (`mjMINVAL`).
pub const MIN_VALUE: f64 = 1e-15;

/// Weight of the first of two geoms in mixed parameters, from their `solmix`.
pub(crate) fn mixing_share([a, b]: [f64; 2]) -> f64 {
    match (a >= MIN_VALUE, b >= MIN_VALUE) {
        (true, true) => a / (a + b),
        (false, false) => 0.5,
        (true, false) => 1.0,
        (false, true) => 0.0,
    }
}

/// Settings of MuJoCo's contact law for the whole scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SoftSettings {
    /// Shape of the friction cone.
    pub cone: Cone,
    /// Ratio of the impedance of friction to that of normal forces.
    pub impratio: f64,
    /// Whether time constants are at least two time steps.
    pub refsafe: bool,
    /// Inverse weights to which softness is relative; `None` lets stepper compute them.
    pub inverse_weights: Option<InverseWeights>,
    /// Noslip iterations after the solution, which remove slip of sticking contacts.
    #[serde(default, with = "added_fields")]
    pub noslip: NoSlip,
}

/// Settings of MuJoCo's noslip iterations, which remove the creep that the regularisation of friction causes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoSlip {
    /// Largest number of iterations; 0 is none.
    pub iterations: u32,
    /// Improvement of the objective at which they stop, relative to the sum of the diagonal of an island's mass matrix.
    pub tolerance: f64,
}

impl Default for NoSlip {
    /// MuJoCo's default.
    fn default() -> Self {
        Self { iterations: 0, tolerance: 1e-6 }
    }
}

impl Default for SoftSettings {
    fn default() -> Self {
        Self { cone: Cone::Pyramidal, impratio: 1.0, refsafe: true, inverse_weights: None, noslip: NoSlip::default() }
    }
}

/// Mean inverse inertia in the reference configuration (MuJoCo's `body_invweight0`, `dof_invweight0`, `tendon_invweight0`). The
/// regularisation of a row is a fraction of it. Inverse weights are numbers of the model, so that environments with other masses have the
/// same ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InverseWeights {
    /// Inverse weights of every body: translation, 1/kg, and rotation, 1/(kg m^2).
    pub bodies: Vec<[f64; 2]>,
    /// Inverse weights of the degrees of freedom.
    pub dofs: Vec<f64>,
    /// Inverse weights of the tendons.
    pub tendons: Vec<f64>,
}
