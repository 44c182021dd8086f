//! Precision (scalar type) of a simulation.

/// Precision of a simulation: the scalar type of its lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// 64-bit numbers, up to eight lanes per register.
    F64,
    /// 32-bit numbers, up to sixteen lanes per register.
    F32,
}

impl Precision {
    /// Default residual at which the solver stops, m/s. [`Options::tolerance`](crate::options::Options::tolerance) replaces it.
    ///
    /// The default is 1e-6 in 64 bits, and 1e-4 in 32 bits, in which rounding prevents a much smaller residual.
    pub const fn tolerance(self) -> f64 {
        match self {
            Self::F64 => 1e-6,
            Self::F32 => 1e-4,
        }
    }
}
