//! Orientation as an argument of builder functions.

/// Orientation as a quaternion [w, x, y, z]. With the feature `nalgebra`, a `UnitQuaternion` converts to it; nalgebra stores [x, y, z, w].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orientation(pub [f64; 4]);

impl From<[f64; 4]> for Orientation {
    fn from(quat: [f64; 4]) -> Self {
        Self(quat)
    }
}

#[cfg(feature = "nalgebra")]
impl From<nalgebra::UnitQuaternion<f64>> for Orientation {
    fn from(quat: nalgebra::UnitQuaternion<f64>) -> Self {
        Self([quat.w, quat.i, quat.j, quat.k])
    }
}
