//! The numbers of `stepper`: one environment, or many side by side in the lanes of a vector register, behind one trait.
//!
//! The simulator's hot path is written once, generic over [`Real`], and instantiated for
//!
//! * `f64`, one environment, the reference;
//! * `F64x8` and `F32x16`, eight and sixteen environments, once per CPU level: [`mod@array`] (portable), `avx2` and `avx512`.
//!
//! Every backend gives every lane the bits that `f64` (or `f32`) gives alone, for arithmetic, for [`Real::min`] and its like, and for
//! the elementary functions: so a result depends neither on the CPU nor on an environment's neighbours. This assumes the floating-point
//! environment that Rust assumes: round to nearest, subnormals kept (a library built with `-ffast-math` may have changed it).
//!
//! [`dispatch!`] makes one function per CPU level out of a generic kernel and picks one at run time; [`Level`] says which there are.
//! Everything a kernel calls must be `#[inline(always)]`: a function that is not inlined is compiled for the baseline.
//!
//! ```
//! mod kernels {
//!     use stepper_real::{F64x8, Real};
//!
//!     #[inline(always)]
//!     fn norms<R: Real>(x: &[R::Stored], y: &[R::Stored], out: &mut [R::Stored]) {
//!         let (x, y, out) = (R::view(x), R::view(y), R::view_mut(out));
//!         for i in 0..out.len() {
//!             out[i] = (x[i].square() + y[i].square()).sqrt();
//!         }
//!     }
//!
//!     stepper_real::dispatch! {
//!         /// Lengths of eight vectors at a time.
//!         pub fn norms_f64(x: &[F64x8], y: &[F64x8], out: &mut [F64x8]) = norms::<F64x8>;
//!     }
//! }
//!
//! use stepper_real::{F64x8, Level, Real};
//! let (x, y) = ([F64x8::of(3.0)], [F64x8::of(4.0)]);
//! let mut out = [F64x8::zero()];
//! kernels::norms_f64(Level::best()?, &x, &y, &mut out);
//! assert_eq!(out[0].lane(7), 5.0);
//! # Ok::<(), stepper_real::LevelError>(())
//! ```

pub mod array;
#[cfg(target_arch = "x86_64")]
pub mod avx2;
#[cfg(target_arch = "x86_64")]
pub mod avx512;
mod coefficients;
mod dispatch;
mod elementary;
mod level;
mod mask;
mod operators;
mod real;
mod scalar;
mod single;

pub use array::{F32x16, F64x8};
pub use level::{Level, LevelError};
pub use mask::Mask;
pub use real::Real;
pub use scalar::Scalar;
