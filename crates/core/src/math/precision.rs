//! Scalar type of a simulation.

/// Scalar type of the lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// Eight lanes of 64 bits.
    F64,
    /// Sixteen lanes of 32 bits.
    F32,
}

impl Precision {
    /// Default residual at which the solver stops ([`Options::tolerance`](crate::options::Options::tolerance) replaces it), m/s.
    ///
    /// 1e-6 in 64 bits. 1e-4 in 32 bits, whose rounding keeps the residual from going much lower.
    pub const fn tolerance(self) -> f64 {
        match self {
            Self::F64 => 1e-6,
            Self::F32 => 1e-4,
        }
    }
}
