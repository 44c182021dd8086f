//! Precision (scalar type) of a simulation.

/// Precision of a simulation: the scalar type of its lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// 64-bit numbers, up to eight lanes per register.
    F64,
    /// 32-bit numbers, up to sixteen lanes per register.
    F32,
}
