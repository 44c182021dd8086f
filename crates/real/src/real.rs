//! Trait over which the simulator's hot path is generic.

use crate::mask::Mask;
use crate::scalar::Scalar;
use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// A real number per environment. The type determines the number of environments: `f64` or `F64x1` for one, `F64x4` for four, `F64x8` and
/// `F32x8` for eight, `F32x16` for sixteen. Each environment has one lane.
///
/// On every backend, each lane gets the bits of an operation on a single scalar: IEEE 754 arithmetic rounded to nearest, without fused
/// multiply-add and approximate reciprocals. Only the sign and payload of a NaN that an operation returns may differ between CPUs. Never
/// let `copysign` read the sign of a NaN.
///
/// Write code for `R: Real`, not for `f64`. On a plain `f64`, Rust calls the inherent methods instead (`f64::min`, `f64::sin` ...). These
/// have other semantics, or come from the platform's libm.
pub trait Real:
    Copy
    + Debug
    + Default
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + DivAssign
{
    /// Type of the number in one lane.
    type Scalar: Scalar;
    /// Type of a mask: one truth value per lane.
    type Mask: Mask;
    /// Type with a single lane.
    type Single: Real<Scalar = Self::Scalar, Single = Self::Single>;
    /// Number of lanes, each for one environment.
    const LANES: usize;

    /// Value with the number `x` in all lanes.
    fn splat(x: Self::Scalar) -> Self;
    /// Value with the constant `x` in all lanes, rounded to the lane's precision.
    #[inline(always)]
    fn of(x: f64) -> Self {
        Self::splat(Self::Scalar::from_f64(x))
    }
    /// Value 0 in all lanes.
    #[inline(always)]
    fn zero() -> Self {
        Self::splat(Self::Scalar::ZERO)
    }
    /// Value 1 in all lanes.
    #[inline(always)]
    fn one() -> Self {
        Self::splat(Self::Scalar::ONE)
    }
    /// Value whose lanes are the first `LANES` entries of a slice, at any alignment.
    ///
    /// # Panics
    /// If the slice is shorter.
    fn load(s: &[Self::Scalar]) -> Self;
    /// Writes the lanes to the first `LANES` entries of a slice, at any alignment.
    ///
    /// # Panics
    /// If the slice is shorter.
    fn store(self, s: &mut [Self::Scalar]);
    /// Sets the values `out` from consecutive groups of `LANES` numbers. Values remain unchanged if there are not enough numbers for them.
    #[inline(always)]
    fn load_all(from: &[Self::Scalar], out: &mut [Self]) {
        for (x, from) in out.iter_mut().zip(from.chunks_exact(Self::LANES)) {
            *x = Self::load(from);
        }
    }
    /// Writes the lanes of the values `all` to consecutive groups of `LANES` entries of `out`, as far as the slice is long enough.
    #[inline(always)]
    fn store_all(all: &[Self], out: &mut [Self::Scalar]) {
        for (x, out) in all.iter().zip(out.chunks_exact_mut(Self::LANES)) {
            x.store(out);
        }
    }
    /// Number in lane `i`.
    ///
    /// # Panics
    /// If there is no lane `i`.
    fn lane(self, i: usize) -> Self::Scalar;
    /// Number in lane `i`, as a [`Real::Single`].
    ///
    /// # Panics
    /// If there is no lane `i`.
    #[inline(always)]
    fn single_lane(self, i: usize) -> Self::Single {
        Self::Single::splat(self.lane(i))
    }
    /// Replaces the number in lane `i` by `x`.
    ///
    /// # Panics
    /// If there is no lane `i`.
    fn set_lane(&mut self, i: usize, x: Self::Scalar);
    /// Runs `kernel` as a separate function that is compiled with the instructions of this type's CPU level, together with all functions
    /// that it inlines. Ordinary code can thus call several kernels, each compiled once.
    ///
    /// The closure and all functions that it calls must be `#[inline(always)]`. Otherwise they run with baseline instructions, and every
    /// operation is a call. This also holds for the methods `map` and `from_fn` of arrays, which are not always inlined. The macro
    /// [`kernel!`](crate::kernel) adds the attribute to the closure.
    fn vectorize<T>(kernel: impl FnOnce() -> T) -> T;

    /// Lanes in which `self < o`; false for NaN.
    fn lt(self, o: Self) -> Self::Mask;
    /// Lanes in which `self <= o`; false for NaN.
    fn le(self, o: Self) -> Self::Mask;
    /// Lanes in which `self > o`; false for NaN.
    #[inline(always)]
    fn gt(self, o: Self) -> Self::Mask {
        o.lt(self)
    }
    /// Lanes in which `self >= o`; false for NaN.
    #[inline(always)]
    fn ge(self, o: Self) -> Self::Mask {
        o.le(self)
    }
    /// Lanes in which `self == o`; false for NaN, true for zeros of either sign.
    fn eq(self, o: Self) -> Self::Mask;
    /// Value with the bits of `a` in the lanes of the mask `m`, and of `b` elsewhere.
    fn select(m: Self::Mask, a: Self, b: Self) -> Self;
    /// Minimum, computed as `if self < o { self } else { o }`. The result is `o` if either is NaN or both are zero.
    fn min(self, o: Self) -> Self;
    /// Maximum, computed as `if self > o { self } else { o }`. The result is `o` if either is NaN or both are zero.
    fn max(self, o: Self) -> Self;
    /// Maximum of two numbers. The result is NaN if either is NaN.
    #[inline(always)]
    fn max_or_nan(self, o: Self) -> Self {
        // `max` is NaN if `o` is, but not if only `self` is.
        Self::select(self.eq(self), self.max(o), self)
    }
    /// Absolute value: the same bits without the sign.
    fn abs(self) -> Self;
    /// Square root, correctly rounded. It is -0 for -0 and NaN for negative numbers.
    fn sqrt(self) -> Self;
    /// Number with the magnitude of `self` and the sign of `sign`.
    fn copysign(self, sign: Self) -> Self;
    /// Nearest integer, half to even, with the sign of `self`. It is exact for every input. Infinities and NaN are returned unchanged.
    fn round_even(self) -> Self;
    /// Lanes in which the number is neither infinite nor NaN.
    #[inline(always)]
    fn is_finite(self) -> Self::Mask {
        self.abs().lt(Self::splat(Self::Scalar::INFINITY))
    }
    /// Reciprocal `1 / self`, correctly rounded.
    #[inline(always)]
    fn recip(self) -> Self {
        Self::one() / self
    }
    /// Value within [`lo`, `hi`], computed as `self.max(lo).min(hi)`. It is `lo` for NaN.
    #[inline(always)]
    fn clamp(self, lo: Self, hi: Self) -> Self {
        self.max(lo).min(hi)
    }
    /// Square `self * self`.
    #[inline(always)]
    fn square(self) -> Self {
        self * self
    }
    /// Power 2^self for an integral `self` whose power is a normal number (f64: -1022 to 1023, f32: -126 to 127). Other arguments give an
    /// arbitrary number, the same on every machine.
    fn pow2(self) -> Self;
    /// Mantissa m and exponent e of a positive normal number: `self = m 2^e` with m in [1, 2). Other arguments give arbitrary numbers, the
    /// same on every machine.
    fn split(self) -> (Self, Self);

    /// Sine and cosine of an angle in rad, within 0.8 ulp up to 1.6e6 rad (f32: 1.2e4 rad).
    ///
    /// For larger angles the error grows to about one ulp of `self`, and then to anything in [-1, 1]. NaN for infinities.
    fn sin_cos(self) -> (Self, Self);
    /// Sine of an angle in rad, see [`Real::sin_cos`].
    #[inline(always)]
    fn sin(self) -> Self {
        self.sin_cos().0
    }
    /// Cosine of an angle in rad, see [`Real::sin_cos`].
    #[inline(always)]
    fn cos(self) -> Self {
        self.sin_cos().1
    }
    /// Sine and cosine of an angle of at most pi/4 in magnitude, rad, within 0.8 ulp. The bits are those of [`Real::sin_cos`].
    fn sin_cos_octant(self) -> (Self, Self);
    /// Natural logarithm, within 0.85 ulp. It is -infinity for zeros of either sign, and NaN for negative numbers.
    fn ln(self) -> Self;
    /// Natural logarithm of a positive normal number, as [`Real::ln`] computes it. Other arguments give an arbitrary number, the same on
    /// every machine.
    fn ln_normal(self) -> Self;
    /// Exponential e^self, within 0.9 ulp (f32: 0.95). It overflows to infinity, and underflows gradually through the subnormals to 0.
    fn exp(self) -> Self;
    /// Angle of the point (`x`, `self`) in [-pi, pi], rad, within 1.6 ulp. Signed zeros and infinities are as in IEEE 754, in all
    /// quadrants.
    fn atan2(self, x: Self) -> Self;
    /// Arc cosine in [0, pi], rad, within 0.9 ulp (f32: 0.95). NaN outside [-1, 1].
    fn acos(self) -> Self;
}

/// Kernel: runs a closure by [`Real::vectorize`], and inlines it there.
///
/// `kernel!(R, || body)` compiles the body with the instructions of the CPU level of the lane type `R`. All functions that the body calls
/// must be `#[inline(always)]`.
///
/// ```
/// use stepper_real::{Real, kernel};
///
/// /// Multiplies every number.
/// fn scale<R: Real>(by: R, x: &mut [R]) {
///     kernel!(R, || {
///         for x in x {
///             *x *= by;
///         }
///     })
/// }
///
/// let mut x = [1.0, 2.0];
/// scale(3.0, &mut x);
/// assert_eq!(x, [3.0, 6.0]);
/// ```
///
/// [`Real::vectorize`]: crate::Real::vectorize
#[macro_export]
macro_rules! kernel {
    ($lanes:ty, || $body:expr) => {
        <$lanes as $crate::Real>::vectorize(
            #[inline(always)]
            || $body,
        )
    };
}
