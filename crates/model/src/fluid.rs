//! Fluid around the bodies.

use serde::{Deserialize, Serialize};

/// Fluid between the bodies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Medium {
    /// Density, kg/m^3.
    pub density: f64,
    /// Viscosity, Pa s.
    pub viscosity: f64,
    /// Velocity of the fluid in the world frame, m/s.
    pub wind: [f64; 3],
}

impl Medium {
    /// Whether the fluid causes forces.
    pub fn acts(&self) -> bool {
        self.density != 0.0 || self.viscosity != 0.0
    }
}

/// Coefficients of MuJoCo's ellipsoid model of fluid forces on a geom. A body without such a geom is approximated by the box with its
/// inertia.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ellipsoid {
    /// Factor on all forces.
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
    /// Volume of the fluid that moves with the geom, per axis, m^3.
    pub virtual_mass: [f64; 3],
    /// Moment of inertia of that fluid divided by its density, per axis, m^5.
    pub virtual_inertia: [f64; 3],
    /// Semi-axes, m.
    pub axes: [f64; 3],
}
