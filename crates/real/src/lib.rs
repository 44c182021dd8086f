//! Number types of `stepper` behind one trait: for one environment, or for several environments in the lanes of vector registers.
//!
//! The simulator's hot path is written once, generic over [`Real`], and instantiated for
//!
//! * `f64`, one environment, the reference;
//! * `F64x1`, `F64Lanes` and `F32Lanes`, once per CPU level: one environment, or one per lane. `F64Lanes` has four lanes with [`baseline`]
//!   and eight with `avx2` and `avx512`. `F32Lanes` has eight with [`baseline`] and `avx2`, and sixteen with `avx512`.
//!
//! On every backend, each lane gets the bits of the same operation on `f64` (or `f32`). This holds for arithmetic, comparisons such as
//! [`Real::min`], and elementary functions. Results thus depend neither on the CPU nor on other environments of the group. The
//! floating-point environment must be that of Rust: round to nearest, with subnormals. (A library built with `-ffast-math` may change it.)
//!
//! [`Real::vectorize`] compiles a kernel with the instructions of a lane type's CPU level, [`at_level!`] selects the lane type of a level
//! at run time, and [`Level`] lists the levels. All functions that a kernel calls must be `#[inline(always)]`: a function that is not
//! inlined is compiled for the baseline.
//!
//! ```
//! use stepper_real::{Level, Real, at_level};
//!
//! /// Lengths of the vectors (x, y).
//! fn norms<R: Real>(x: &[R::Scalar], y: &[R::Scalar], out: &mut [R::Scalar]) {
//!     R::vectorize(
//!         #[inline(always)]
//!         || {
//!             for i in (0..out.len()).step_by(R::LANES) {
//!                 let (x, y) = (R::load(&x[i..]), R::load(&y[i..]));
//!                 (x.square() + y.square()).sqrt().store(&mut out[i..]);
//!             }
//!         },
//!     )
//! }
//!
//! let mut out = [0.0; 16];
//! at_level!(Level::best()?, F64Lanes, norms(&[3.0; 16], &[4.0; 16], &mut out));
//! assert_eq!(out, [5.0; 16]);
//! # Ok::<(), stepper_real::LevelError>(())
//! ```

pub mod array;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
pub mod baseline;
mod coefficients;
#[doc(hidden)]
pub mod elementary;
mod level;
mod mask;
mod operators;
mod real;
#[cfg(target_arch = "x86_64")]
mod registers;
mod scalar;
mod single;
#[cfg(target_arch = "x86_64")]
mod single_lane;
#[cfg(target_arch = "x86_64")]
mod sse2;

pub use baseline::{F32Lanes, F64Lanes, F64x1};
#[cfg(target_arch = "x86_64")]
pub use level::{Avx2, Avx512, HasAvx2, HasAvx512};
pub use level::{Level, LevelError, code_of};
pub use mask::Mask;
pub use real::Real;
pub use scalar::Scalar;
