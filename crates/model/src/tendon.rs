//! Fixed tendons: linear combinations of joint positions.

use serde::{Deserialize, Serialize};

use crate::softness::Softness;

/// Fixed tendon: its length is a linear combination of the positions of hinges and slides. The length has the unit u of the combination, m
/// or rad.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tendon {
    /// Name of the tendon; may be empty.
    pub name: String,
    /// Terms of the length: index of the joint, and coefficient.
    pub joints: Vec<(usize, f64)>,
    /// Lowest and highest tendon length, in the unit u (m or rad); `None` without limits.
    pub range: Option<[f64; 2]>,
    /// Stiffness of the tendon's spring, N/u, where u is the unit of the length (m or rad).
    pub stiffness: f64,
    /// Lowest and highest tendon length at which the spring is slack, in the unit u (m or rad).
    pub spring_length: [f64; 2],
    /// Viscous damping of the tendon, N s/u, where u is the unit of the length (m or rad).
    pub damping: f64,
    /// Inertia that resists changes of the tendon length, N s^2/u, where u is the unit of the length (m or rad).
    pub armature: f64,
    /// Dry friction of the tendon, N.
    pub frictionloss: f64,
    /// Softness of the tendon's limit in MuJoCo's contact law.
    pub limit_softness: Softness,
    /// Softness of the tendon's dry friction in MuJoCo's contact law.
    pub friction_softness: Softness,
}
