//! Softness of constraints in MuJoCo's contact law, and the inverse weights that scale it.

use serde::{Deserialize, Serialize};

/// Shape of the friction cones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Cone {
    /// Pyramid with the edges n + mu_k t_k and n - mu_k t_k, each with a separate force. n is the normal, t_k are the tangents, and mu_k
    /// their friction coefficients.
    #[default]
    Pyramidal,
    /// Elliptic cone `sum (f_k / mu_k)^2 <= f_n^2`, with the normal force f_n, the friction forces f_k and the friction coefficients mu_k.
    Elliptic,
}

/// Softness of a constraint: reference acceleration and impedance (MuJoCo's documentation, "Solver parameters").
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Softness {
    /// Time constant (s) and damping ratio with which the position error decays. Negative values are minus stiffness and minus damping, per
    /// unit of mass.
    pub solref: [f64; 2],
    /// Parameters d0, dwidth, width, midpoint and power of the impedance curve. The impedance is d0 at zero error and dwidth from an error
    /// of `width` (m or rad) on.
    pub solimp: [f64; 5],
}

impl Default for Softness {
    /// MuJoCo's default softness.
    fn default() -> Self {
        Self { solref: [0.02, 1.0], solimp: [0.9, 0.95, 0.001, 0.5, 2.0] }
    }
}

impl Softness {
    /// Mixture of the softnesses of two geoms with equal priority (MuJoCo's `mj_contactParam`). `share` is the weight of the first geom,
    /// from 0 to 1.
    pub(crate) fn mix(a: Self, b: Self, share: f64) -> Self {
        let blend = |a: f64, b: f64| share * a + (1.0 - share) * b;
        let standard = a.solref[0] > 0.0 && b.solref[0] > 0.0;
        Self {
            solref: std::array::from_fn(|k| if standard { blend(a.solref[k], b.solref[k]) } else { a.solref[k].min(b.solref[k]) }),
            solimp: std::array::from_fn(|k| blend(a.solimp[k], b.solimp[k])),
        }
    }
}

/// Spring and damper in parallel, of one surface, or between two surfaces in contact. Both contact laws use them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ContactSpring {
    /// Stiffness of the contact spring, N/m; infinite for rigid contact.
    pub stiffness: f64,
    /// Damping of the contact spring, N s/m.
    pub damping: f64,
}

impl Default for ContactSpring {
    /// Spring of a rigid contact, with infinite stiffness and no damping.
    fn default() -> Self {
        Self { stiffness: f64::INFINITY, damping: 0.0 }
    }
}

impl ContactSpring {
    /// Whether the stiffness is infinite, so that the contact is rigid.
    pub fn is_rigid(&self) -> bool {
        self.stiffness.is_infinite()
    }

    /// Combined spring and damper of two surfaces in contact, as two springs in series.
    ///
    /// The penetration is divided between the springs in inverse proportion to their stiffness. The velocity is divided in the same way.
    /// The combined damper dissipates as much as both dampers together.
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

/// Weight of the first of two geoms in the mixture of their parameters, computed from the `solmix` values of both.
pub(crate) fn mixing_share([a, b]: [f64; 2]) -> f64 {
    match (a >= MIN_VALUE, b >= MIN_VALUE) {
        (true, true) => a / (a + b),
        (false, false) => 0.5,
        (true, false) => 1.0,
        (false, true) => 0.0,
    }
}

/// Settings of MuJoCo's contact law that apply to the whole scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SoftSettings {
    /// Shape of the friction cone.
    pub cone: Cone,
    /// Ratio of frictional to normal impedance (`impratio`).
    pub impratio: f64,
    /// Whether the time constants in `solref` are raised to at least two time steps (MuJoCo's flag `refsafe`).
    pub refsafe: bool,
    /// Inverse weights (mean inverse inertias) that scale the softness of constraints. With `None`, stepper computes them from the model.
    pub inverse_weights: Option<InverseWeights>,
    /// Settings of the noslip iterations, which run after the solver and reduce the slip of sticking contacts.
    #[serde(default)]
    pub noslip: NoSlip,
}

/// Settings of MuJoCo's noslip iterations, which reduce the slip that regularised friction allows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoSlip {
    /// Largest number of iterations per step; 0 disables the iterations.
    pub iterations: u32,
    /// Improvement of the cost function by one iteration, divided by the trace of the mass matrix, below which the iterations stop. Cost
    /// function and mass matrix are those of one island (connected bodies).
    pub tolerance: f64,
}

impl Default for NoSlip {
    /// MuJoCo's default: no noslip iterations.
    fn default() -> Self {
        Self { iterations: 0, tolerance: 1e-6 }
    }
}

impl Default for SoftSettings {
    fn default() -> Self {
        Self { cone: Cone::Pyramidal, impratio: 1.0, refsafe: true, inverse_weights: None, noslip: NoSlip::default() }
    }
}

/// Inverse weights: mean inverse inertias in the reference configuration (MuJoCo's `body_invweight0`, `dof_invweight0`,
/// `tendon_invweight0`).
///
/// The regularisation of a constraint row is proportional to the inverse weight of the row. The model stores the inverse weights, so that
/// they are the same in all environments, even if environments have different masses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InverseWeights {
    /// Inverse weights of every body: translation, 1/kg, and rotation, 1/(kg m^2).
    pub bodies: Vec<[f64; 2]>,
    /// Inverse weights of the degrees of freedom, 1/kg or 1/(kg m^2).
    pub dofs: Vec<f64>,
    /// Inverse weights of the tendons, u/(N s^2), where u is the unit of the tendon length (m or rad).
    pub tendons: Vec<f64>,
}
