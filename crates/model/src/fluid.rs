//! Fluid that surrounds the bodies.

use serde::{Deserialize, Serialize};

/// Properties of the fluid that surrounds the bodies.
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
    /// Whether the fluid exerts forces: density or viscosity is above zero.
    pub fn acts(&self) -> bool {
        self.density != 0.0 || self.viscosity != 0.0
    }
}

/// Coefficients of MuJoCo's ellipsoid model of fluid forces on a geom. A body without such geoms has the fluid forces of a box with the
/// same inertia as the body.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ellipsoid {
    /// Factor of all fluid forces and torques on the geom.
    pub share: f64,
    /// Coefficient of blunt drag.
    pub blunt_drag: f64,
    /// Coefficient of slender drag.
    pub slender_drag: f64,
    /// Coefficient of the drag that resists rotation.
    pub angular_drag: f64,
    /// Coefficient of Kutta lift, from circulation.
    pub kutta_lift: f64,
    /// Coefficient of Magnus lift, from spin.
    pub magnus_lift: f64,
    /// Volume of fluid that moves with the geom (added mass divided by density), per axis, m^3.
    pub virtual_mass: [f64; 3],
    /// Added moment of inertia divided by the density of the fluid, per axis, m^5.
    pub virtual_inertia: [f64; 3],
    /// Semi-axes of the ellipsoid, m.
    pub axes: [f64; 3],
}
