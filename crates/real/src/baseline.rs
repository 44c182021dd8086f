//! Lane types of the level that every CPU has: SSE2 on x86-64, [portable arrays](crate::array) elsewhere.

#[cfg(not(target_arch = "x86_64"))]
pub use crate::array::{F32x8 as F32Lanes, F64x4 as F64Lanes};
#[cfg(target_arch = "x86_64")]
pub use crate::sse2::{F32x8 as F32Lanes, F64x4 as F64Lanes};

/// Single `f64` with baseline instructions.
pub type F64x1 = f64;
