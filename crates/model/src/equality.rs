//! Equality constraints, which close loops and couple joints.

use serde::{Deserialize, Serialize};

use crate::softness::Softness;

/// Equality: a bilateral constraint. If it is hard, it keeps an error at zero with any necessary force. If it is soft, it acts on the error
/// as a spring with a damper.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Equality {
    /// Name of the equality; may be empty.
    pub name: String,
    /// Kind of equality, with its elements.
    pub kind: EqualityKind,
    /// Whether the equality is active by default. An inactive equality costs nothing.
    pub active: bool,
    /// Stiffness of a soft equality: N/m, N m/rad for rotations, and the units of the joint or tendon for couplings. Infinite for a hard
    /// equality.
    pub stiffness: f64,
    /// Damping of a soft equality, N s/m or N m s/rad.
    pub damping: f64,
    /// Softness in MuJoCo's contact law, which ignores stiffness and damping.
    pub softness: Softness,
}

named! {
    /// Kind of equality (MuJoCo's `mjtEq`).
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    pub enum EqualityKind {
        /// Connection: a point of one body coincides with a point of another, as in a ball joint.
        Connect {
            /// Indices of the bodies; 0 is the world.
            bodies: [usize; 2],
            /// Position of the connected point in the frame of each of the two bodies, m.
            anchors: [[f64; 3]; 2],
        } = "connect",
        /// Weld: a connection like [`EqualityKind::Connect`], with a fixed relative orientation.
        Weld {
            /// Indices of the bodies; 0 is the world.
            bodies: [usize; 2],
            /// Position of the connected point in the frame of each of the two bodies, m.
            anchors: [[f64; 3]; 2],
            /// Orientation of the second body in the frame of the first, a unit quaternion (w, x, y, z).
            relpose: [f64; 4],
            /// Weight of the rotation error relative to the position error, m/rad. With the weight 0, rotations are free.
            torquescale: f64,
        } = "weld",
        /// Coupling `q0 - ref0 = p(q1 - ref1)` of two hinges or slides with the positions q0 and q1. p is the polynomial, and the
        /// references ref0 and ref1 are the positions in `qpos0`. Without a second joint, the coupling is `q0 - ref0 = c0`, with the
        /// constant c0 of p.
        Joint {
            /// Index of the first joint.
            joint: usize,
            /// Index of the second joint. With `None`, the first joint is fixed at a constant position.
            other: Option<usize>,
            /// Coefficients of the polynomial p, for the powers 0 to 4.
            polycoef: [f64; 5],
        } = "joint",
        /// Coupling `l0 - ref0 = p(l1 - ref1)` of two tendons with the lengths l0 and l1. p is the polynomial, and the references ref0
        /// and ref1 are the lengths at `qpos0`. Without a second tendon, the coupling is `l0 - ref0 = c0`, with the constant c0 of p.
        Tendon {
            /// Index of the first tendon.
            tendon: usize,
            /// Index of the second tendon. With `None`, the first tendon has a constant length.
            other: Option<usize>,
            /// Coefficients of the polynomial p, for the powers 0 to 4.
            polycoef: [f64; 5],
        } = "tendon",
    }
}

impl EqualityKind {
    /// Indices of the first and second body, joint or tendon; `None` for a coupling of one.
    pub const fn objects(&self) -> (usize, Option<usize>) {
        match *self {
            Self::Connect { bodies: [first, second], .. } | Self::Weld { bodies: [first, second], .. } => (first, Some(second)),
            Self::Joint { joint, other, .. } => (joint, other),
            Self::Tendon { tendon, other, .. } => (tendon, other),
        }
    }

    /// Number of rows of the equality in the constraint problem.
    pub const fn rows(&self) -> usize {
        match self {
            Self::Connect { .. } => 3,
            Self::Weld { .. } => 6,
            Self::Joint { .. } | Self::Tendon { .. } => 1,
        }
    }
}

impl Equality {
    /// Parameters in MuJoCo's layout (`eq_data`), with zeros in unused entries.
    ///
    /// Connect: both anchors. Weld: anchor in the second body, anchor in the first, relpose, torquescale. Couplings: coefficients of the
    /// polynomial.
    pub fn data(&self) -> Vec<f64> {
        let mut data = vec![];
        self.clone().visit_data(&mut |x| data.push(*x));
        data
    }

    /// Calls `f` for each of the 11 numbers of [`Equality::data`], which `f` may change. In place of a number that the kind of equality
    /// does not have, `f` gets a zero.
    pub(crate) fn visit_data(&mut self, f: &mut dyn FnMut(&mut f64)) {
        let parts: [&mut [f64]; 4] = match &mut self.kind {
            EqualityKind::Connect { anchors: [first, second], .. } => [first, second, &mut [], &mut []],
            EqualityKind::Weld { anchors: [first, second], relpose, torquescale, .. } => {
                [second, first, relpose, std::slice::from_mut(torquescale)]
            }
            EqualityKind::Joint { polycoef, .. } | EqualityKind::Tendon { polycoef, .. } => [polycoef, &mut [], &mut [], &mut []],
        };
        let others = 11 - parts.iter().map(|part| part.len()).sum::<usize>();
        parts.into_iter().flatten().for_each(&mut *f);
        (0..others).for_each(|_| f(&mut 0.0));
    }
}
