//! Equalities: what closes loops and couples joints.

use serde::{Deserialize, Serialize};

use crate::softness::Softness;

/// A bilateral constraint: whatever force it takes, its error is zero.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Equality {
    /// Name; may be empty.
    pub name: String,
    /// What it holds together.
    pub kind: EqualityKind,
    /// Whether it acts; one that does not costs nothing.
    pub active: bool,
    /// Infinite for a hard one, else a spring's, N/m (N m/rad for turning, and for joints and tendons in their own unit).
    pub stiffness: f64,
    /// Of the damper beside the spring of a soft one, N s/m or N m s/rad.
    pub damping: f64,
    /// Softness by MuJoCo's law, which takes no notice of the spring.
    pub softness: Softness,
}

/// What an equality holds together (MuJoCo's `mjtEq`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum EqualityKind {
    /// A point of one body is a point of another, as by a ball joint.
    Connect {
        /// The bodies; 0 is the world.
        bodies: [usize; 2],
        /// The points in the bodies' frames, m.
        anchors: [[f64; 3]; 2],
    },
    /// As [`EqualityKind::Connect`], and the orientations agree.
    Weld {
        /// The bodies; 0 is the world.
        bodies: [usize; 2],
        /// The points in the bodies' frames, m.
        anchors: [[f64; 3]; 2],
        /// Orientation of the second body in the frame of the first.
        relpose: [f64; 4],
        /// Weight of an error of one radian against one of a metre, m; 0 lets them turn.
        torquescale: f64,
    },
    /// `q0 - ref0 = polynomial(q1 - ref1)` for hinges and slides, references from `qpos0`; without a second joint `q0 - ref0 = c0`.
    Joint {
        /// The first joint.
        joint: usize,
        /// The second joint.
        other: Option<usize>,
        /// Coefficients of the powers 0 to 4.
        polycoef: [f64; 5],
    },
    /// The same for the lengths of fixed tendons, references from their lengths at `qpos0`.
    Tendon {
        /// The first tendon.
        tendon: usize,
        /// The second tendon.
        other: Option<usize>,
        /// Coefficients of the powers 0 to 4.
        polycoef: [f64; 5],
    },
}

impl EqualityKind {
    /// The field's word for it.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Connect { .. } => "connect",
            Self::Weld { .. } => "weld",
            Self::Joint { .. } => "joint",
            Self::Tendon { .. } => "tendon",
        }
    }

    /// Rows of the constraint problem.
    pub const fn rows(&self) -> usize {
        match self {
            Self::Connect { .. } => 3,
            Self::Weld { .. } => 6,
            Self::Joint { .. } | Self::Tendon { .. } => 1,
        }
    }
}

impl Equality {
    /// Its numbers in MuJoCo's layout (`eq_data`): connect: both anchors; weld: anchor in the second body, anchor in the first, relpose,
    /// torquescale; couplings: the polynomial. Entries that mean nothing are 0.
    pub fn data(&self) -> [f64; 11] {
        let mut out = [0.0; 11];
        match &self.kind {
            EqualityKind::Connect { anchors, .. } => out[..6].copy_from_slice(anchors.as_flattened()),
            EqualityKind::Weld { anchors: [first, second], relpose, torquescale, .. } => {
                out[..3].copy_from_slice(second);
                out[3..6].copy_from_slice(first);
                out[6..10].copy_from_slice(relpose);
                out[10] = *torquescale;
            }
            EqualityKind::Joint { polycoef, .. } | EqualityKind::Tendon { polycoef, .. } => out[..5].copy_from_slice(polycoef),
        }
        out
    }

    /// Takes numbers over that are laid out as those of [`Equality::data`].
    pub fn set_data(&mut self, data: &[f64; 11]) {
        match &mut self.kind {
            EqualityKind::Connect { anchors, .. } => anchors.as_flattened_mut().copy_from_slice(&data[..6]),
            EqualityKind::Weld { anchors: [first, second], relpose, torquescale, .. } => {
                second.copy_from_slice(&data[..3]);
                first.copy_from_slice(&data[3..6]);
                relpose.copy_from_slice(&data[6..10]);
                *torquescale = data[10];
            }
            EqualityKind::Joint { polycoef, .. } | EqualityKind::Tendon { polycoef, .. } => polycoef.copy_from_slice(&data[..5]),
        }
    }
}
