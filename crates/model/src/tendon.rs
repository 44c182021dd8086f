//! Fixed tendons: linear combinations of joint positions.

use serde::{Deserialize, Serialize};

use crate::softness::Softness;

/// Fixed tendon: its length is a linear combination of the positions of hinges and slides. The length has the unit u of the combination, m
/// or rad.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tendon {
    /// Name; may be empty.
    pub name: String,
    /// Terms of the length: index of the joint, and coefficient.
    pub joints: Vec<(usize, f64)>,
    /// Lowest and highest length, u; `None` without limits.
    pub range: Option<[f64; 2]>,
    /// Spring stiffness, N/u.
    pub stiffness: f64,
    /// Lowest and highest length at which the spring is slack, u.
    pub spring_length: [f64; 2],
    /// Viscous damping, N s/u.
    pub damping: f64,
    /// Inertia that moves with the length, N s^2/u.
    pub armature: f64,
    /// Dry friction, N.
    pub frictionloss: f64,
    /// Softness of the limit in MuJoCo's contact law.
    pub limit_softness: Softness,
    /// Softness of dry friction in MuJoCo's contact law.
    pub friction_softness: Softness,
}
