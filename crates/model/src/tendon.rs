//! Tendons: linear combinations of joint positions (fixed tendons), and paths through sites and around geoms (spatial tendons).

use crate::shape::Shape;
use crate::softness::Softness;
use serde::{Deserialize, Serialize};

/// Tendon. Its length is the sum of a linear combination of the positions of hinges and slides, and of the length of a path. A fixed tendon
/// has no path, and a spatial tendon no joints. The length has the unit u, m or rad; that of a path is in m.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tendon {
    /// Name of the tendon; may be empty.
    pub name: String,
    /// Terms of the length: index of the joint, and coefficient.
    pub joints: Vec<(usize, f64)>,
    /// Path of a spatial tendon; empty for a fixed tendon.
    #[serde(default)]
    pub path: Vec<PathElement>,
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

/// Element of the path of a spatial tendon.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum PathElement {
    /// Site through which the tendon passes, by its index.
    Site(usize),
    /// Sphere or cylinder around which the tendon wraps between the sites before and after it. A cylinder has no ends here.
    Wrap {
        /// Index of the geom.
        geom: usize,
        /// Index of the side site, near which the tendon passes. A tendon whose side site is inside the geom passes through the geom, and
        /// touches it from the inside. `None` selects the shorter way.
        side: Option<usize>,
    },
    /// Pulley with this divisor. It ends one branch of the path. The length of the next branch counts divided by the divisor.
    Pulley(f64),
}

/// Part of a path between two sites.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathSegment {
    /// Indices of the sites.
    pub sites: [usize; 2],
    /// Geom around which the tendon wraps between them, and side site, by their indices.
    pub wrap: Option<(usize, Option<usize>)>,
    /// Divisor of the length.
    pub divisor: f64,
}

impl Tendon {
    /// Parts of the path between two sites each, in the order of the path.
    pub fn segments(&self) -> Vec<PathSegment> {
        let (mut segments, mut divisor, mut last, mut wrap) = (vec![], 1.0, None, None);
        for &element in &self.path {
            match element {
                PathElement::Pulley(by) => (divisor, last, wrap) = (by, None, None),
                PathElement::Wrap { geom, side } => wrap = Some((geom, side)),
                PathElement::Site(site) => {
                    segments.extend(last.map(|from| PathSegment { sites: [from, site], wrap, divisor }));
                    (last, wrap) = (Some(site), None);
                }
            }
        }
        segments
    }
}

/// Radius of a sphere or cylinder, and whether it is a cylinder; `None` for other shapes, around which no tendon wraps.
pub fn round(shape: &Shape) -> Option<(f64, bool)> {
    match *shape {
        Shape::Sphere { radius } => Some((radius, false)),
        Shape::Cylinder { radius, .. } => Some((radius, true)),
        _ => None,
    }
}
