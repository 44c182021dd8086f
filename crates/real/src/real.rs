//! Trait over which the simulator's hot path is generic.

use crate::mask::Mask;
use crate::scalar::Scalar;
use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// A real number per environment: `f64` or `F64x1` for one, `F64x8` for eight, `F64x16` and `F32x16` for sixteen,
/// `F32x32` for thirty-two environments side by side.
///
/// On every backend, each lane gets the bits of an operation on a single scalar: IEEE 754 arithmetic rounded to nearest, without fused
/// multiply-add and approximate reciprocals. Only which NaN comes out of an operation (its sign and payload) may differ
/// between CPUs, so never let `copysign` read the sign of a NaN.
///
/// Write code against `R: Real`, not against `f64`: on a plain `f64` the inherent methods win (`f64::min`, `f64::sin` ...), and these
/// mean something else or come from the platform's libm.
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
    /// The number in one lane.
    type Scalar: Scalar;
    /// One truth value per lane.
    type Mask: Mask;
    /// Half of the lanes, in half the registers; `Self` where there is one register.
    type Half: Real<Scalar = Self::Scalar, Half = Self::Half>;
    /// Type of a single lane.
    type Single: Real<Scalar = Self::Scalar, Single = Self::Single>;
    /// Environments side by side.
    const LANES: usize;

    /// Number in all lanes.
    fn splat(x: Self::Scalar) -> Self;
    /// Constant in all lanes, rounded to the lane's precision.
    #[inline(always)]
    fn of(x: f64) -> Self {
        Self::splat(Self::Scalar::from_f64(x))
    }
    /// 0 in all lanes.
    #[inline(always)]
    fn zero() -> Self {
        Self::splat(Self::Scalar::ZERO)
    }
    /// 1 in all lanes.
    #[inline(always)]
    fn one() -> Self {
        Self::splat(Self::Scalar::ONE)
    }
    /// The first `LANES` elements, at any alignment.
    ///
    /// # Panics
    /// When `s` is shorter.
    fn load(s: &[Self::Scalar]) -> Self;
    /// Writes the first `LANES` elements, at any alignment.
    ///
    /// # Panics
    /// When `s` is shorter.
    fn store(self, s: &mut [Self::Scalar]);
    /// Loads `out` from consecutive numbers, as far as there are any.
    #[inline(always)]
    fn load_all(from: &[Self::Scalar], out: &mut [Self]) {
        for (x, from) in out.iter_mut().zip(from.chunks_exact(Self::LANES)) {
            *x = Self::load(from);
        }
    }
    /// Writes `all` consecutively, as far as the slice reaches.
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
    /// Replaces the number in lane `i`.
    ///
    /// # Panics
    /// When there is no lane `i`.
    fn set_lane(&mut self, i: usize, x: Self::Scalar);
    /// Gathers lanes into half the registers: lane `sources[i]` becomes lane i, for each lane of `Half`.
    ///
    /// # Panics
    /// When `sources` is shorter than that, or names a lane that does not exist.
    #[inline(always)]
    fn gather_lanes(self, sources: &[u32]) -> Self::Half {
        let mut gathered = Self::Half::zero();
        for (i, &l) in sources[..Self::Half::LANES].iter().enumerate() {
            gathered.set_lane(i, self.lane(l as usize));
        }
        gathered
    }
    /// Replaces the lanes `lanes` by lanes of half the registers: lane i becomes lane `places[i]` of `half`.
    ///
    /// # Panics
    /// When `places` is shorter than all lanes. A place that does not exist gives some number, or panics.
    #[inline(always)]
    fn replace_lanes(mut self, half: Self::Half, places: &[u32], lanes: Self::Mask) -> Self {
        for (i, &place) in places[..Self::LANES].iter().enumerate() {
            if lanes.bits() >> i & 1 == 1 {
                self.set_lane(i, half.lane(place as usize));
            }
        }
        self
    }
    /// Gathers lanes of two vectors: lane `sources[i]` becomes lane i, where the lanes of `high` are numbered after those of `low`. A
    /// source that does not exist gives some number, or panics.
    #[inline(always)]
    fn gather_lanes_of_two(low: Self, high: Self, sources: &[u32]) -> Self {
        let mut gathered = Self::zero();
        for (i, &l) in sources[..Self::LANES].iter().enumerate() {
            let l = l as usize;
            gathered.set_lane(i, if l < Self::LANES { low.lane(l) } else { high.lane(l - Self::LANES) });
        }
        gathered
    }
    /// Runs `kernel` as a separate function that is compiled with the instructions of this type's CPU level, with all functions that it
    /// inlines. A long computation can thus consist of several kernels that ordinary code calls, each compiled once.
    ///
    /// The closure and all functions that it calls must be `#[inline(always)]`. Otherwise they run with baseline instructions, and every
    /// operation is a call. The methods `map` and `from_fn` of arrays are such functions.
    fn vectorize<T>(kernel: impl FnOnce() -> T) -> T;

    /// `self < o`; false where either is NaN.
    fn lt(self, o: Self) -> Self::Mask;
    /// `self <= o`; false where either is NaN.
    fn le(self, o: Self) -> Self::Mask;
    /// `self > o`; false where either is NaN.
    #[inline(always)]
    fn gt(self, o: Self) -> Self::Mask {
        o.lt(self)
    }
    /// `self >= o`; false where either is NaN.
    #[inline(always)]
    fn ge(self, o: Self) -> Self::Mask {
        o.le(self)
    }
    /// `self == o`; false where either is NaN, true for zeros of either sign.
    fn eq(self, o: Self) -> Self::Mask;
    /// `a` where `m`, else `b`, bit for bit.
    fn select(m: Self::Mask, a: Self, b: Self) -> Self;
    /// `if self < o { self } else { o }`: `o` where either is NaN or both are zero.
    fn min(self, o: Self) -> Self;
    /// `if self > o { self } else { o }`: `o` where either is NaN or both are zero.
    fn max(self, o: Self) -> Self;
    /// Clears the sign.
    fn abs(self) -> Self;
    /// Square root, correctly rounded; -0 for -0, NaN below.
    fn sqrt(self) -> Self;
    /// The magnitude of `self` with the sign of `sign`.
    fn copysign(self, sign: Self) -> Self;
    /// Nearest integer, half to even, with the sign of `self`. It is exact for every input; infinities and NaN stay.
    fn round_even(self) -> Self;
    /// Neither infinite nor NaN.
    #[inline(always)]
    fn is_finite(self) -> Self::Mask {
        self.abs().lt(Self::splat(Self::Scalar::INFINITY))
    }
    /// `1 / self`, correctly rounded.
    #[inline(always)]
    fn recip(self) -> Self {
        Self::one() / self
    }
    /// `self.max(lo).min(hi)`: `lo` where `self` is NaN.
    #[inline(always)]
    fn clamp(self, lo: Self, hi: Self) -> Self {
        self.max(lo).min(hi)
    }
    /// `self * self`.
    #[inline(always)]
    fn square(self) -> Self {
        self * self
    }
    /// 2^self for an integral `self` whose power is normal (f64: -1022 to 1023, f32: -126 to 127). Anything else gives some number,
    /// the same everywhere.
    fn pow2(self) -> Self;
    /// (m, e) with `self = m 2^e` and m in [1, 2), of a positive normal number. Anything else gives some numbers, the same everywhere.
    fn split(self) -> (Self, Self);

    /// Sine and cosine, within 0.8 ulp up to 1.6e6 rad (f32: 1.2e4 rad).
    ///
    /// Further out the error grows to about one ulp of `self`, and then to anything in [-1, 1]. NaN for infinities.
    fn sin_cos(self) -> (Self, Self);
    /// Sine; see [`Real::sin_cos`].
    #[inline(always)]
    fn sin(self) -> Self {
        self.sin_cos().0
    }
    /// Cosine; see [`Real::sin_cos`].
    #[inline(always)]
    fn cos(self) -> Self {
        self.sin_cos().1
    }
    /// Sine and cosine of at most pi/4 in magnitude, within 0.8 ulp, as [`Real::sin_cos`] computes them without a reduction of the
    /// argument.
    fn sin_cos_octant(self) -> (Self, Self);
    /// Natural logarithm, within 0.85 ulp. -infinity for zeros of either sign, NaN below.
    fn ln(self) -> Self;
    /// Natural logarithm of a positive normal number, as [`Real::ln`] computes it. Other arguments give an arbitrary number, the same on
    /// every machine.
    fn ln_normal(self) -> Self;
    /// e^self, within 0.9 ulp (f32: 0.95). Overflows to infinity; underflows gradually through the subnormals to 0.
    fn exp(self) -> Self;
    /// The angle of the point (`x`, `self`) in [-pi, pi], with IEEE 754's signed zeros and infinities in all quadrants;
    /// within 1.6 ulp.
    fn atan2(self, x: Self) -> Self;
    /// Arc cosine in [0, pi], within 0.9 ulp (f32: 0.95); NaN outside [-1, 1].
    fn acos(self) -> Self;
}
