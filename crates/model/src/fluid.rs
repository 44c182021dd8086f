//! The medium around the bodies.

use serde::{Deserialize, Serialize};

/// What fills the space between the bodies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Medium {
    /// kg/m^3
    pub density: f64,
    /// Pa s
    pub viscosity: f64,
    /// Its velocity in the world frame, m/s.
    pub wind: [f64; 3],
}

impl Medium {
    /// Whether it acts on anything.
    pub fn acts(&self) -> bool {
        self.density != 0.0 || self.viscosity != 0.0
    }
}

/// Coefficients of a geom that the medium acts on as on an ellipsoid. A body without such a geom is taken as the box that has its inertia.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ellipsoid {
    /// Scales all forces.
    pub share: f64,
    /// Drag along the direction of motion, blunt part.
    pub blunt_drag: f64,
    /// Drag along the direction of motion, slender part.
    pub slender_drag: f64,
    /// Drag of rotation.
    pub angular_drag: f64,
    /// Lift by circulation.
    pub kutta_lift: f64,
    /// Lift by spin.
    pub magnus_lift: f64,
    /// Volume of the medium that moves along, per axis, m^3.
    pub virtual_mass: [f64; 3],
    /// Its moment of inertia over its density, per axis, m^5.
    pub virtual_inertia: [f64; 3],
    /// Semi-axes, m.
    pub axes: [f64; 3],
}
